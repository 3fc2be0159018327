//! Which processes were started, in a file of the instance's folder: one `pid name` per line. A supervisor that was
//! killed leaves its children flying; whoever comes after it finds them here.
//!
//! A number alone is no proof, process ids are used again: a process only counts as one of the instance's if its own
//! command line says so.

use jink_runtime::Instance;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use std::fmt;
use std::os::fd::{AsFd, OwnedFd};
use std::path::PathBuf;

/// From SIGTERM to SIGKILL (s).
const PATIENCE_S: i64 = 1;

/// A process that outlived its supervisor.
#[derive(Debug)]
pub struct Living {
    name: String,
    pid: u32,
    handle: OwnedFd,
}

/// Processes of a killed supervisor are still running.
#[derive(Debug)]
pub struct LivingError {
    instance: String,
    living: Vec<String>,
}

impl fmt::Display for LivingError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "processes of a supervisor that was killed are still running: {}; stop them with `jink down --instance {}`",
            self.living.join(", "),
            self.instance
        )
    }
}
impl std::error::Error for LivingError {}

/// The file.
#[derive(Debug)]
pub struct Record {
    instance: Instance,
    path: PathBuf,
}

fn path_of(instance: &Instance) -> PathBuf {
    instance.folder().join("processes")
}

/// Removes the record of `instance`.
pub fn remove(instance: &Instance) {
    let _not_there = std::fs::remove_file(path_of(instance));
}

impl Record {
    /// The record of `instance`.
    pub fn new(instance: &Instance) -> Self {
        Self {
            instance: instance.clone(),
            path: path_of(instance),
        }
    }

    /// Replaces the content, all or nothing.
    pub fn write<'a>(&self, processes: impl Iterator<Item = (u32, &'a str)>) -> std::io::Result<()> {
        let text: String = processes.map(|(pid, name)| format!("{pid} {name}\n")).collect();
        let new = self.path.with_extension("new");
        std::fs::write(&new, text)?;
        std::fs::rename(&new, &self.path)
    }

    /// An error if any recorded process is alive: a second set of processes beside them would be two pilots.
    pub fn refuse_living(&self) -> Result<(), LivingError> {
        let living = self.living();
        if living.is_empty() {
            return Ok(());
        }
        Err(LivingError {
            instance: self.instance.to_string(),
            living: living
                .iter()
                .map(|one| format!("{} ({})", one.name, one.pid))
                .collect(),
        })
    }

    /// Ends every recorded process that is alive, last one first; answers how many.
    pub fn end_living(&self) -> std::io::Result<usize> {
        let living = self.living();
        for one in living.iter().rev() {
            tracing::info!(process = one.name, pid = one.pid, "ending");
            let _gone_already = pidfd_send_signal(&one.handle, Signal::TERM);
            if !ended_within(&one.handle, PATIENCE_S)? {
                let _gone_already = pidfd_send_signal(&one.handle, Signal::KILL);
                ended_within(&one.handle, PATIENCE_S)?;
            }
        }
        Ok(living.len())
    }

    fn living(&self) -> Vec<Living> {
        let text = std::fs::read_to_string(&self.path).unwrap_or_default();
        text.lines().filter_map(|line| self.find(line)).collect()
    }

    fn find(&self, line: &str) -> Option<Living> {
        let (pid, name) = line.split_once(' ')?;
        let pid: u32 = pid.parse().ok()?;
        // The handle first: what the command line then proves holds for the handle, whatever becomes of the number.
        let handle = pidfd_open(Pid::from_raw(i32::try_from(pid).ok()?)?, PidfdFlags::empty()).ok()?;
        let command_line = std::fs::read(format!("/proc/{pid}/cmdline")).ok()?;
        is_of(&command_line, &self.instance.to_string(), name).then(|| Living {
            name: name.to_owned(),
            pid,
            handle,
        })
    }
}

/// Whether a command line (arguments ended by zeros, as in /proc) is that of process `name` of `instance`.
fn is_of(command_line: &[u8], instance: &str, name: &str) -> bool {
    let arguments: Vec<&[u8]> = command_line.split(|byte| *byte == 0).collect();
    let says = |key: &str, value: &str| {
        arguments
            .windows(2)
            .any(|pair| pair == [key.as_bytes(), value.as_bytes()])
    };
    says("--instance", instance) && says("--process", name)
}

fn ended_within(handle: &OwnedFd, seconds: i64) -> std::io::Result<bool> {
    let mut fds = [PollFd::from_borrowed_fd(handle.as_fd(), PollFlags::IN)];
    let timeout = Timespec {
        tv_sec: seconds,
        tv_nsec: 0,
    };
    Ok(poll(&mut fds, Some(&timeout))? > 0)
}

#[cfg(test)]
mod tests {
    use super::is_of;

    #[test]
    fn only_a_command_line_that_says_so_belongs_to_the_instance() {
        let line = b"/usr/bin/jink-planner\0--process\0planner\0--instance\0one\0--generation\x002\0";
        assert!(is_of(line, "one", "planner"));
        assert!(!is_of(line, "other", "planner"));
        assert!(!is_of(line, "one", "plan"));
        assert!(!is_of(b"/bin/bash\0", "one", "planner"));
        assert!(!is_of(b"", "one", "planner"));
    }
}
