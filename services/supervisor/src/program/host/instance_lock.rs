//! The lock on an instance: one that the kernel drops when its owner dies, and the right to remove the instance's
//! memory that comes with it.

use jink_runtime::Instance;
use rustix::fs::OFlags;
use std::cell::Cell;
use std::fmt;
use std::fs::{File, TryLockError};
use std::io::{Read, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::PathBuf;
use std::time::Duration;

/// A command that only checks whether the instance is up holds the lock for an instant: that passes.
const ATTEMPTS: u32 = 20;
const PAUSE: Duration = Duration::from_millis(5);

/// Why an instance cannot be had.
#[derive(Debug)]
pub enum InstanceLockError {
    /// Another supervisor holds it.
    Held {
        /// The instance.
        instance: String,
        /// The other supervisor's process id, as it wrote it down.
        pid: String,
    },
    /// Its folder cannot be made, or is not ours alone.
    Folder(std::io::Error),
    /// The lock file cannot be made.
    Io {
        /// The lock file.
        path: PathBuf,
        /// Why.
        cause: std::io::Error,
    },
}

impl fmt::Display for InstanceLockError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Held { instance, pid } => write!(
                f,
                "instance {instance} is already up, held by the supervisor with process id {pid}"
            ),
            Self::Folder(cause) => write!(f, "{cause}"),
            Self::Io { path, cause } => write!(f, "{}: {cause}", path.display()),
        }
    }
}
impl std::error::Error for InstanceLockError {}

/// Being the only supervisor of an instance, as long as this lives.
#[derive(Debug)]
pub struct InstanceLock {
    instance: Instance,
    lock: File,
    /// What is in the folder is of this run.
    is_cleared: Cell<bool>,
}

impl InstanceLock {
    /// Locks the instance, or returns the process id of its owner. The lock file is empty until [`Self::announce`].
    pub fn take(instance: &Instance) -> Result<Self, InstanceLockError> {
        let path = instance.lock_file();
        let failed = |cause: std::io::Error| InstanceLockError::Io {
            path: path.clone(),
            cause,
        };
        for _ in 0..ATTEMPTS {
            instance.make_folder().map_err(InstanceLockError::Folder)?;
            let open = File::options()
                .create(true)
                .truncate(false)
                .read(true)
                .write(true)
                .custom_flags(OFlags::NOFOLLOW.bits().cast_signed())
                .open(&path);
            let file = match open {
                // The folder was removed by a supervisor that is just ending.
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => continue,
                other => other.map_err(failed)?,
            };
            match file.try_lock() {
                // The file may have been removed between opening and locking it: then the lock is worth nothing.
                Ok(()) if is_still(&path, &file) => {
                    file.set_len(0).map_err(failed)?;
                    return Ok(Self {
                        instance: instance.clone(),
                        lock: file,
                        is_cleared: Cell::new(false),
                    });
                }
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => std::thread::sleep(PAUSE),
                Err(TryLockError::Error(cause)) => return Err(failed(cause)),
            }
        }
        let mut pid = String::new();
        let _ = File::open(&path).and_then(|mut file| file.read_to_string(&mut pid));
        Err(InstanceLockError::Held {
            instance: instance.to_string(),
            pid: pid.trim().to_owned(),
        })
    }

    /// Writes our process id into the lock file. Nothing of an earlier run is left by then that could be taken for ours.
    pub fn announce(&self) -> std::io::Result<()> {
        writeln!(&self.lock, "{}", std::process::id())
    }

    /// Lets go without a start: leaves what an earlier run had left if it was not cleared yet, and no folder otherwise.
    pub fn abandon(&self) {
        let folder = self.instance.folder();
        let holds_more = std::fs::read_dir(&folder).is_ok_and(|entries| entries.count() > 1);
        if self.is_cleared.get() || !holds_more {
            // A folder that stays is found and removed like that of any run.
            let _stays = self.release();
        }
    }

    /// Removes everything the instance left in memory, logs included.
    pub fn clear(&self) -> std::io::Result<()> {
        self.is_cleared.set(true);
        let _was_none = std::fs::remove_file(self.instance.recording());
        self.instance.wipe()
    }

    /// Removes everything but the logs; where all of them are on a disk (`are_carried`), the link to that is what is left.
    pub fn clear_but_logs(&self, are_carried: bool) -> std::io::Result<()> {
        let on_disk = self.instance.log_on_disk();
        let logs = match are_carried && on_disk.is_symlink() {
            true => on_disk,
            false => self.instance.log_folder(),
        };
        let aside = logs.with_extension("kept");
        std::fs::rename(&logs, &aside)?;
        self.instance.wipe()?;
        std::fs::rename(&aside, &logs)?;
        super::record::remove(&self.instance);
        Ok(())
    }

    /// Removes everything, the instance's folder included.
    pub fn release(&self) -> std::io::Result<()> {
        self.instance.wipe()?;
        std::fs::remove_dir_all(self.instance.folder())
    }
}

fn is_still(path: &std::path::Path, file: &File) -> bool {
    match (std::fs::metadata(path), file.metadata()) {
        (Ok(named), Ok(held)) => (named.dev(), named.ino()) == (held.dev(), held.ino()),
        _ => false,
    }
}
