//! Room for open files, made before a process has threads.
//!
//! The kernel's table of a process's descriptors grows when it is full: at 64, at 128, at 256. In a process with more than one
//! thread that growth waits until every processor has passed through its scheduler (`expand_files`, `synchronize_rcu` in Linux's
//! fs/file.c): milliseconds as a rule, and seconds were measured on busy virtual processors. A reader that joins a topic opens
//! descriptors in every process of that topic, so it would happen in flight. Grown while there is one thread, the table waits for
//! nobody.

use rustix::process::{Resource, getrlimit};
use std::os::fd::AsFd;

/// As many as are made room for: a gateway with all topics open has 190, and each reader more adds some. Table and bits
/// take 9 KiB.
const RESERVED: u64 = 1024;

/// Makes room for 1,024 descriptors, or for as many as the process may have (`LimitNOFILE`). To be called before the first
/// thread is started. Where the kernel refuses, the table grows when it must, as without this.
pub fn reserve() {
    let allowed = getrlimit(Resource::Nofile).current.unwrap_or(RESERVED);
    let Some(last) = RESERVED.min(allowed).checked_sub(1) else {
        return;
    };
    if let Ok(root) = std::fs::File::open("/") {
        // The table keeps its size when its last descriptor is closed again.
        let _closed_again = rustix::io::fcntl_dupfd_cloexec(root.as_fd(), last as i32);
    }
}

#[cfg(test)]
mod tests {
    use super::{RESERVED, reserve};

    #[test]
    fn the_table_of_descriptors_has_its_size_from_the_beginning() {
        reserve();
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let size = status.lines().find_map(|line| line.strip_prefix("FDSize:"));
        assert!(size.unwrap().trim().parse::<u64>().unwrap() >= RESERVED);
    }
}
