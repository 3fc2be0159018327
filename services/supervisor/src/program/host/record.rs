//! Which processes were started, in a file of the instance's folder: one JSON object a line. A supervisor that was
//! killed leaves its children flying; the next one finds them here, and adopts them.
//!
//! A number alone is no proof, process ids are used again: a process only counts as one of the instance's if its own
//! command line has so.

use crate::supervision::Adopted;
use jink_runtime::Instance;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use serde::{Deserialize, Serialize};
use std::os::fd::{AsFd, OwnedFd};
use std::path::PathBuf;

/// From SIGTERM to SIGKILL (s).
const PATIENCE_S: i64 = 1;

/// One process on record.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordEntry {
    /// Its name in the process table.
    pub name: String,
    /// Its process id.
    pub pid: u32,
    /// Its program.
    pub program: PathBuf,
    /// What a new supervisor must know to adopt it; `None` = a second instance, which is not adopted.
    #[serde(with = "adoptable")]
    pub found: Option<Adopted>,
}

/// A process that outlived its supervisor.
#[derive(Debug)]
pub struct SurvivingProcess {
    /// What is on record of it.
    pub entry: RecordEntry,
    /// Its handle.
    pub handle: OwnedFd,
}

/// [`Adopted`] as the numbers it consists of.
mod adoptable {
    use crate::supervision::Adopted;
    use jink_shared_types::Timestamp;
    use jink_shared_types::coded::Wire;
    use jink_shared_types::health::ReplaceReason;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(found: &Option<Adopted>, to: S) -> Result<S::Ok, S::Error> {
        let numbers = found.as_ref().map(|found| {
            let counts = [
                found.generation,
                found.last_generation,
                found.epoch,
                found.restarts,
                found.pid,
                found.last_exit,
            ];
            (counts, found.reason.code(), found.started.ns)
        });
        numbers.serialize(to)
    }

    pub fn deserialize<'a, D: Deserializer<'a>>(from: D) -> Result<Option<Adopted>, D::Error> {
        let numbers = Option::<([u32; 6], u8, u64)>::deserialize(from)?;
        Ok(numbers.map(|(counts, reason, started_ns)| {
            let [generation, last_generation, epoch, restarts, pid, last_exit] = counts;
            Adopted {
                generation,
                last_generation,
                epoch,
                restarts,
                pid,
                last_exit,
                reason: ReplaceReason::from_code(reason).unwrap_or(ReplaceReason::UNKNOWN),
                started: Timestamp::from_ns(started_ns),
            }
        }))
    }
}

/// The file.
#[derive(Debug)]
pub struct ProcessRecord {
    instance: Instance,
    path: PathBuf,
}

fn path_of(instance: &Instance) -> PathBuf {
    instance.folder().join("processes")
}

/// Removes the record of `instance`.
pub fn remove(instance: &Instance) {
    let _ = std::fs::remove_file(path_of(instance));
}

impl ProcessRecord {
    /// The record of `instance`.
    pub fn new(instance: &Instance) -> Self {
        Self {
            instance: instance.clone(),
            path: path_of(instance),
        }
    }

    /// Replaces the content, all or nothing.
    pub fn write(&self, entries: &[RecordEntry]) -> std::io::Result<()> {
        let mut text = String::new();
        for entry in entries {
            text += &serde_json::to_string(entry).map_err(std::io::Error::other)?;
            text.push('\n');
        }
        let new = self.path.with_extension("new");
        std::fs::write(&new, text)?;
        std::fs::rename(&new, &self.path)
    }

    /// Ends every recorded process that is alive, last one first; answers how many.
    pub fn end_surviving(&self) -> std::io::Result<usize> {
        let surviving = self.surviving();
        for one in surviving.iter().rev() {
            tracing::info!(process = one.entry.name, pid = one.entry.pid, "ending");
            let _ = pidfd_send_signal(&one.handle, Signal::TERM);
            if !ended_within(&one.handle, PATIENCE_S)? {
                let _ = pidfd_send_signal(&one.handle, Signal::KILL);
                ended_within(&one.handle, PATIENCE_S)?;
            }
        }
        Ok(surviving.len())
    }

    /// Every recorded process that is alive.
    pub fn surviving(&self) -> Vec<SurvivingProcess> {
        let text = std::fs::read_to_string(&self.path).unwrap_or_default();
        text.lines().filter_map(|line| self.find(line)).collect()
    }

    fn find(&self, line: &str) -> Option<SurvivingProcess> {
        let entry: RecordEntry = serde_json::from_str(line).ok()?;
        // The handle first: what the command line then proves holds for the handle, whatever becomes of the number.
        let pid = Pid::from_raw(i32::try_from(entry.pid).ok()?)?;
        let handle = pidfd_open(pid, PidfdFlags::empty()).ok()?;
        let command_line = std::fs::read(format!("/proc/{}/cmdline", entry.pid)).ok()?;
        is_of(&command_line, &self.instance.to_string(), &entry.name)
            .then_some(SurvivingProcess { entry, handle })
    }
}

/// Whether a command line (arguments ended by zeros, as in /proc) is that of process `name` of `instance`.
fn is_of(command_line: &[u8], instance: &str, name: &str) -> bool {
    let arguments: Vec<&[u8]> = command_line.split(|byte| *byte == 0).collect();
    let has = |key: &str, value: &str| {
        arguments
            .windows(2)
            .any(|pair| pair == [key.as_bytes(), value.as_bytes()])
    };
    has("--instance", instance) && has("--process", name)
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
