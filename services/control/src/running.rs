//! Whether an instance is up: its supervisor holds a lock that the kernel drops when it dies.

use crate::Problem;
use jink_runtime::Instance;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Gid, OFlags, Uid};
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use rustix::thread::{set_thread_groups, set_thread_res_gid, set_thread_res_uid};
use std::fs::{File, TryLockError};
use std::io::{Read, Seek};
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::time::{Duration, Instant};

/// A supervisor that goes on as another binary has the lock again after so long, on a machine that is busy, too.
const GOES_ON: Duration = Duration::from_secs(2);

/// The supervisor of a running instance.
#[derive(Debug)]
pub struct RunningSupervisor {
    /// Its process id.
    pub pid: u32,
    handle: OwnedFd,
}

/// Process id of the supervisor of `instance`, whichever user's it is; `None` if there is none, or it is out of reach.
pub fn holder(instance: &Instance) -> Option<u32> {
    let mut file = open_lock(instance).ok()?;
    held_by(&mut file).ok().flatten()
}

/// The lock file, and nothing that stands in its place.
fn open_lock(instance: &Instance) -> std::io::Result<File> {
    let flags = OFlags::NOFOLLOW | OFlags::NONBLOCK;
    File::options()
        .read(true)
        .custom_flags(flags.bits().cast_signed())
        .open(instance.lock_file())
}

/// Id of the user whose `instance` is; `None` if it has no folder.
pub fn owner(instance: &Instance) -> Option<u32> {
    let folder = std::fs::symlink_metadata(instance.folder()).ok()?;
    Some(folder.uid())
}

/// Becomes the user whose the instance is, where this one may: what root left in its memory would be in its way, and what stands there
/// would be read with root's rights.
fn become_owner(instance: &Instance) -> Result<(), Problem> {
    let Ok(folder) = std::fs::symlink_metadata(instance.folder()) else {
        return Ok(());
    };
    let us = rustix::process::geteuid();
    let (user, group) = (folder.uid(), folder.gid());
    if us.as_raw() == user {
        return Ok(());
    }
    if !us.is_root() {
        return Err(Problem::Other(format!(
            "instance {instance} belongs to the user with id {user}, and this is {}: try `sudo`, or be that user",
            us.as_raw()
        )));
    }
    let (uid, gid) = (Uid::from_raw(user), Gid::from_raw(group));
    set_thread_groups(&[])
        .and_then(|()| set_thread_res_gid(gid, gid, gid))
        .and_then(|()| set_thread_res_uid(uid, uid, uid))
        .map_err(|errno| {
            Problem::Other(format!(
                "instance {instance} belongs to the user with id {user}, which this command cannot become: {errno}"
            ))
        })
}

/// Process id of whoever holds the lock on `file`; `None` if nobody does, and for the instant between taking the lock and writing.
fn held_by(file: &mut File) -> std::io::Result<Option<u32>> {
    match file.try_lock_shared() {
        Ok(()) => {
            file.unlock()?;
            return Ok(None);
        }
        Err(TryLockError::Error(error)) => return Err(error),
        Err(TryLockError::WouldBlock) => {}
    }
    written_in(file)
}

/// The process id in a lock file.
fn written_in(file: &mut File) -> std::io::Result<Option<u32>> {
    let mut text = String::new();
    file.rewind()?;
    file.read_to_string(&mut text)?;
    Ok(text.trim().parse().ok())
}

/// The same, but a supervisor that goes on as another binary is waited for: it lets go of the lock until that binary has taken it.
fn held_by_or_soon(file: &mut File, instance: &Instance) -> std::io::Result<Option<u32>> {
    let begin = Instant::now();
    loop {
        let holder = held_by(file)?;
        let goes_on = holder.is_none() && written_in(file)?.is_some_and(|pid| is_of(pid, instance));
        if !goes_on || begin.elapsed() > GOES_ON {
            return Ok(holder);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Whether process `pid` was started for `instance`.
fn is_of(pid: u32, instance: &Instance) -> bool {
    let command_line = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
    let name = instance.to_string();
    let arguments: Vec<&[u8]> = command_line.split(|byte| *byte == 0).collect();
    arguments
        .windows(2)
        .any(|pair| pair == [b"--instance", name.as_bytes()])
}

/// The supervisor of `instance`, if there is one. Root becomes the user whose it is.
///
/// # Errors
/// The instance is another user's: its memory and its processes are out of reach.
pub fn find(instance: &Instance) -> Result<Option<RunningSupervisor>, Problem> {
    become_owner(instance)?;
    let path = instance.lock_file();
    let mut file = match open_lock(instance) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        other => other.map_err(Problem::io(path.display().to_string()))?,
    };
    let held_by = held_by_or_soon(&mut file, instance).map_err(Problem::io(path.display().to_string()))?;
    // It may have ended meanwhile.
    let pid = held_by.and_then(|pid| Pid::from_raw(i32::try_from(pid).ok()?));
    let Some(handle) = pid.and_then(|pid| pidfd_open(pid, PidfdFlags::empty()).ok()) else {
        return Ok(None);
    };
    Ok(pid.map(|pid| RunningSupervisor {
        pid: pid.as_raw_nonzero().get().unsigned_abs(),
        handle,
    }))
}

/// Whether a supervisor of `instance` was killed and left processes on record.
pub fn has_orphans(instance: &Instance) -> bool {
    instance.folder().join("processes").exists()
}

/// Whether nothing of `instance` runs any more.
pub fn has_ended(instance: &Instance) -> bool {
    holder(instance).is_none() && !has_orphans(instance)
}

impl RunningSupervisor {
    /// Asks it to stop; answers whether it has ended within `patience`.
    pub fn stop(&self, patience: Duration) -> Result<bool, Problem> {
        self.signal(Signal::TERM);
        self.has_ended_within(patience)
    }

    /// Ends it; its processes stay.
    pub fn kill(&self) -> Result<bool, Problem> {
        self.signal(Signal::KILL);
        self.has_ended_within(Duration::from_secs(2))
    }

    fn signal(&self, signal: Signal) {
        // It may have ended meanwhile, which is what is wanted.
        let _gone_already = pidfd_send_signal(&self.handle, signal);
    }

    fn has_ended_within(&self, patience: Duration) -> Result<bool, Problem> {
        let mut fds = [PollFd::from_borrowed_fd(self.handle.as_fd(), PollFlags::IN)];
        let timeout = Timespec {
            tv_sec: i64::try_from(patience.as_secs()).unwrap_or(i64::MAX),
            tv_nsec: i64::from(patience.subsec_nanos()),
        };
        let ready = poll(&mut fds, Some(&timeout))
            .map_err(|error| Problem::io("waiting for the supervisor")(error.into()))?;
        Ok(ready > 0)
    }
}
