// Counts what a process asks of the allocator: loaded before the C library (LD_PRELOAD), it adds one to a number in the file
// $JINK_ALLOCATIONS/<pid> for every request, and passes the request on.
#include <fcntl.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

extern void *__libc_malloc(size_t);
extern void *__libc_calloc(size_t, size_t);
extern void *__libc_realloc(void *, size_t);
extern void *__libc_memalign(size_t, size_t);

// Counted before the file is there, too.
static _Atomic uint64_t before;
static _Atomic uint64_t *count = &before;

__attribute__((constructor)) static void begin(void) {
    const char *folder = getenv("JINK_ALLOCATIONS");
    char name[512];
    if (!folder || snprintf(name, sizeof name, "%s/%d", folder, (int)getpid()) >= (int)sizeof name) {
        return;
    }
    int file = open(name, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (file < 0) {
        return;
    }
    if (ftruncate(file, sizeof *count) == 0) {
        void *memory = mmap(NULL, sizeof *count, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
        if (memory != MAP_FAILED) {
            atomic_store((_Atomic uint64_t *)memory, atomic_load(&before));
            count = memory;
        }
    }
    close(file);
}

static void counts(void) {
    atomic_fetch_add_explicit(count, 1, memory_order_relaxed);
}

void *malloc(size_t size) {
    counts();
    return __libc_malloc(size);
}

void *calloc(size_t number, size_t size) {
    counts();
    return __libc_calloc(number, size);
}

void *realloc(void *old, size_t size) {
    counts();
    return __libc_realloc(old, size);
}

void *memalign(size_t alignment, size_t size) {
    counts();
    return __libc_memalign(alignment, size);
}

void *aligned_alloc(size_t alignment, size_t size) {
    counts();
    return __libc_memalign(alignment, size);
}

int posix_memalign(void **memory, size_t alignment, size_t size) {
    counts();
    *memory = __libc_memalign(alignment, size);
    return *memory ? 0 : 12;  // ENOMEM
}
