//! Which processes were started, in a file of the instance's folder: one JSON object a line. A supervisor that was
//! killed leaves its children flying; the next one finds them here, and adopts them.
//!
//! A number alone is no proof, process ids are used again: a process only counts as one of the instance's if it is this user's, and
//! its own command line has so.

use crate::supervision::Adopted;
use jink_runtime::{Instance, programs};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use serde::{Deserialize, Serialize};
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};

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
    /// The program on record, if it is what runs: anything else is no reason to start it again.
    pub program: Option<PathBuf>,
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
        let of_kernel = PathBuf::from(format!("/proc/{}", entry.pid));
        let command_line = std::fs::read(of_kernel.join("cmdline")).ok()?;
        let status = std::fs::read_to_string(of_kernel.join("status")).ok()?;
        if !is_users(&status, rustix::process::geteuid().as_raw())
            || !is_of(&command_line, &self.instance.to_string(), &entry.name)
        {
            return None;
        }
        let file = std::fs::read_link(of_kernel.join("exe")).ok();
        let runs = file.is_some_and(|file| is_program(&entry.program, &file, &command_line));
        Some(SurvivingProcess {
            program: runs.then(|| entry.program.clone()),
            entry,
            handle,
        })
    }
}

/// Whether a process belongs to user `id`: its `status`, as in /proc, has so of the real and of the effective one.
fn is_users(status: &str, id: u32) -> bool {
    let ids = status.lines().find_map(|line| line.strip_prefix("Uid:"));
    let mut ids = ids.unwrap_or_default().split_whitespace();
    let id = id.to_string();
    ids.next() == Some(&id) && ids.next() == Some(&id)
}

/// Whether a process that was started from `file` with this command line runs `program`, which may be a script.
fn is_program(program: &Path, file: &Path, command_line: &[u8]) -> bool {
    let program = programs::file_of(program);
    let file = file.to_string_lossy();
    // The kernel's word for a file that has been replaced since.
    let file = Path::new(file.strip_suffix(" (deleted)").unwrap_or(&file));
    let is_file = program.canonicalize().is_ok_and(|program| program == file);
    let script = command_line.split(|byte| *byte == 0).nth(1);
    is_file || script == Some(program.as_os_str().as_bytes())
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
    use super::{is_of, is_program, is_users};
    use std::path::Path;

    #[test]
    fn only_this_users_processes_count() {
        let status = "Name:\tjink-planner\nUid:\t7\t7\t7\t7\nGid:\t8\t8\t8\t8\n";
        assert!(is_users(status, 7));
        assert!(!is_users(status, 8) && !is_users("", 0) && !is_users("Uid:\t7\t0\t0\t0\n", 0));
    }

    #[test]
    fn a_program_is_believed_if_it_is_what_runs() {
        let own = std::env::current_exe().unwrap();
        let replaced = format!("{} (deleted)", own.display());
        assert!(is_program(&own, &own, b""));
        assert!(is_program(&own, Path::new(&replaced), b""));
        assert!(!is_program(
            &own,
            Path::new("/usr/bin/python3"),
            b"python3\0other\0"
        ));
        let script = format!("python3\0{}\0--process\0", own.display());
        assert!(is_program(&own, Path::new("/usr/bin/python3"), script.as_bytes()));
        assert!(!is_program(Path::new("/nowhere"), &own, b""));
    }

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
