//! Shared memory with a futex: the floor, since nothing can do less. One ring per hop, one writer, one reader.
#![allow(unsafe_code)]

use jink_transport_chain::{Fault, Incoming, Outgoing, StageArgs};
use rustix::fs::{Mode, OFlags, ftruncate, open};
use rustix::io::Errno;
use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use rustix::thread::futex::{self, Flags, Timespec};
use std::ffi::c_void;
use std::path::Path;
use std::ptr::NonNull;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

/// Messages that a ring has room for: more than are ever under way.
const SLOTS: usize = 16;
/// The counter has a cache line of its own (bytes).
const HEAD: usize = 64;

/// One hop.
struct Ring {
    memory: NonNull<c_void>,
    message: usize,
}

impl Ring {
    /// Maps the ring behind `file`, which is made if it is not there.
    fn open(file: &Path, message: usize) -> Result<Self, Fault> {
        let size = HEAD + SLOTS * message;
        let file = open(file, OFlags::RDWR | OFlags::CREATE, Mode::RUSR | Mode::WUSR)?;
        // A file that is that long already stays as it is.
        ftruncate(&file, size as u64)?;
        let access = ProtFlags::READ | ProtFlags::WRITE;
        // SAFETY: a new mapping of a file that is as long.
        let memory = unsafe { mmap(std::ptr::null_mut(), size, access, MapFlags::SHARED, &file, 0)? };
        let memory = NonNull::new(memory).ok_or("no memory was mapped")?;
        Ok(Self { memory, message })
    }

    /// Messages written so far, modulo 2^32.
    fn written(&self) -> &AtomicU32 {
        // SAFETY: aligned to a page, mapped as long as `self`, and used by both processes as an atomic only.
        unsafe { self.memory.cast::<AtomicU32>().as_ref() }
    }

    /// The slot of message `count`.
    fn slot(&self, count: u32) -> NonNull<u8> {
        // SAFETY: within the mapping, by its size.
        unsafe {
            self.memory
                .cast::<u8>()
                .add(HEAD + count as usize % SLOTS * self.message)
        }
    }
}

impl Drop for Ring {
    fn drop(&mut self) {
        // SAFETY: it was mapped with this size, and nothing borrowed from it outlives it.
        let _goes_with_the_process = unsafe { munmap(self.memory.as_ptr(), HEAD + SLOTS * self.message) };
    }
}

/// Writes into the ring.
struct Writer(Ring);

impl Outgoing for Writer {
    fn send(&mut self, fill: &mut dyn FnMut(&mut [u8])) -> Result<(), Fault> {
        let Self(ring) = self;
        let count = ring.written().load(Ordering::Relaxed);
        // SAFETY: the reader does not look at this slot before the counter says so, and is not so far behind that it still does.
        fill(unsafe { std::slice::from_raw_parts_mut(ring.slot(count).as_ptr(), ring.message) });
        ring.written().store(count.wrapping_add(1), Ordering::Release);
        futex::wake(ring.written(), Flags::empty(), 1)?;
        Ok(())
    }
}

/// Reads out of the ring.
struct Reader {
    ring: Ring,
    read: u32,
}

impl Incoming for Reader {
    fn receive(&mut self, patience: Duration, take: &mut dyn FnMut(&[u8])) -> Result<(), Fault> {
        let Self { ring, read } = self;
        let timeout = Timespec {
            tv_sec: patience.as_secs() as i64,
            tv_nsec: i64::from(patience.subsec_nanos()),
        };
        if ring.written().load(Ordering::Acquire) == *read {
            match futex::wait(ring.written(), Flags::empty(), *read, Some(&timeout)) {
                Ok(()) | Err(Errno::AGAIN | Errno::INTR | Errno::TIMEDOUT) => {}
                Err(error) => return Err(error.into()),
            }
        }
        if ring.written().load(Ordering::Acquire) != *read {
            // SAFETY: written before the counter was, and not written again before the ring has come round.
            take(unsafe { std::slice::from_raw_parts(ring.slot(*read).as_ptr(), ring.message) });
            *read = read.wrapping_add(1);
        }
        Ok(())
    }
}

/// The end of hop `hop` that is written.
pub fn writer(args: &StageArgs, hop: usize, message: usize) -> Result<Box<dyn Outgoing>, Fault> {
    Ok(Box::new(Writer(Ring::open(
        &args.hop_file(hop, "ring"),
        message,
    )?)))
}

/// The end that is read.
pub fn reader(args: &StageArgs, hop: usize, message: usize) -> Result<Box<dyn Incoming>, Fault> {
    let ring = Ring::open(&args.hop_file(hop, "ring"), message)?;
    Ok(Box::new(Reader { ring, read: 0 }))
}
