//! Clock, memory locking and scheduling: what a process may have of it depends on its rights, and it says so.
//!
//! This module holds the runtime's calls into libc for which the safe wrappers have no name.
#![allow(unsafe_code)]

use jink_shared_types::Timestamp;
use rustix::time::{ClockId, clock_gettime};

/// CLOCK_MONOTONIC now.
pub fn now() -> Timestamp {
    let time = clock_gettime(ClockId::Monotonic);
    Timestamp::from_ns(time.tv_sec.unsigned_abs() * 1_000_000_000 + time.tv_nsec.unsigned_abs())
}

/// CPU time this process has used (ms).
pub fn cpu_time_ms() -> u32 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    (time.tv_sec * 1_000 + time.tv_nsec / 1_000_000) as u32
}

/// What a process asks of the kernel's scheduler and memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RealtimeWish {
    /// SCHED_FIFO priority 1 to 99; 0 = ordinary scheduling.
    pub priority: u8,
    /// Core to stay on; `None` = any.
    pub core: Option<usize>,
    /// Keep all pages in memory.
    pub lock_memory: bool,
}

/// Grants as much of `wish` as the rights of the process allow; returns one sentence per refusal.
pub fn apply(wish: RealtimeWish) -> Vec<String> {
    let mut refused = Vec::new();
    if wish.lock_memory {
        // ONFAULT: pages stay once touched. Without it every mapped segment would be filled at once, tens of
        // megabytes for a point cloud topic, and a restart would take as many milliseconds longer.
        let flags = libc::MCL_CURRENT | libc::MCL_FUTURE | libc::MCL_ONFAULT;
        // SAFETY: a system call without pointers.
        if unsafe { libc::mlockall(flags) } != 0 {
            refused.push(format!(
                "memory not locked ({}): raise LimitMEMLOCK or grant CAP_IPC_LOCK; page faults may delay a cycle",
                std::io::Error::last_os_error()
            ));
        }
    }
    if let Some(core) = wish.core {
        let mut set = rustix::thread::CpuSet::new();
        if core < rustix::thread::CpuSet::MAX_CPU {
            set.set(core);
        }
        if let Err(error) = rustix::thread::sched_setaffinity(None, &set) {
            refused.push(format!("not bound to core {core} ({error}): does it exist?"));
        }
    }
    if wish.priority > 0 {
        let parameter = libc::sched_param {
            sched_priority: i32::from(wish.priority),
        };
        // SAFETY: the pointer is to a live local.
        if unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameter) } != 0 {
            refused.push(format!(
                "no SCHED_FIFO priority {} ({}): grant CAP_SYS_NICE or LimitRTPRIO; other processes may delay a cycle",
                wish.priority,
                std::io::Error::last_os_error()
            ));
        }
    }
    refused
}

#[cfg(test)]
mod tests {
    use super::{RealtimeWish, apply, now};

    #[test]
    fn the_clock_runs_forward() {
        let first = now();
        assert!(now() >= first && first.is_set());
    }

    #[test]
    fn a_wish_for_nothing_is_never_refused() {
        assert!(apply(RealtimeWish::default()).is_empty());
    }

    #[test]
    fn an_impossible_core_is_refused_in_words() {
        let refused = apply(RealtimeWish {
            core: Some(100_000),
            ..RealtimeWish::default()
        });
        assert_eq!(refused.len(), 1);
        assert!(refused[0].contains("core 100000"));
    }
}
