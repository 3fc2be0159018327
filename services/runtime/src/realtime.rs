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

/// SCHED_FIFO priority of a process while it starts: above every program without a priority, below every service that has
/// been given more.
pub const STARTING_PRIORITY: u8 = 1;

/// How the kernel's scheduler treats a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scheduling {
    /// As every other program.
    Ordinary,
    /// SCHED_FIFO with this priority, and whatever it starts likewise.
    Fifo(u8),
    /// SCHED_FIFO with this priority; what it starts is ordinary.
    FifoItself(u8),
}

/// Puts a process, or the calling thread if `pid` is 0, under `scheduling`.
///
/// # Errors
/// What the kernel says: EPERM without CAP_SYS_NICE or a limit that allows the priority; ESRCH if there is no such process.
pub fn schedule(pid: u32, scheduling: Scheduling) -> std::io::Result<()> {
    let (policy, priority) = match scheduling {
        Scheduling::Ordinary => (libc::SCHED_OTHER, 0),
        Scheduling::Fifo(priority) => (libc::SCHED_FIFO, priority),
        Scheduling::FifoItself(priority) => (libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK, priority),
    };
    let parameter = libc::sched_param {
        sched_priority: i32::from(priority),
    };
    let pid = libc::pid_t::try_from(pid).map_err(std::io::Error::other)?;
    // SAFETY: the pointer is to a live local.
    match unsafe { libc::sched_setscheduler(pid, policy, &raw const parameter) } {
        0 => Ok(()),
        _ => Err(std::io::Error::last_os_error()),
    }
}

/// Binds the calling thread to `core`.
///
/// # Errors
/// What the kernel says: there is no such core, or it is not for this process.
pub fn bind_to_core(core: usize) -> std::io::Result<()> {
    let mut set = rustix::thread::CpuSet::new();
    if core < rustix::thread::CpuSet::MAX_CPU {
        set.set(core);
    }
    Ok(rustix::thread::sched_setaffinity(None, &set)?)
}

/// What a process asks of the kernel's scheduler and memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RealtimeWish {
    /// SCHED_FIFO priority 1 to 99; 0 = as it was started.
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
    if let Some(core) = wish.core
        && let Err(error) = bind_to_core(core)
    {
        refused.push(format!("not bound to core {core} ({error}): does it exist?"));
    }
    if wish.priority > 0
        && let Err(error) = schedule(0, Scheduling::Fifo(wish.priority))
    {
        refused.push(format!(
            "no SCHED_FIFO priority {} ({error}): grant CAP_SYS_NICE or LimitRTPRIO; other processes may delay a cycle",
            wish.priority
        ));
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
