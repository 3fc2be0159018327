//! What processes write for a disk goes into the instance's memory, from where one process carries it to the disk: a disk that hangs,
//! is full or gone hangs nobody who flies.
//!
//! | written by | in memory | on the disk |
//! |---|---|---|
//! | every process, its standard error | `log/NAME.log` | [`run_logs`] |
//! | supervisor, how a process ended | `log/NAME.end.json` | the same, beside it |
//! | gateway | `spool/GENERATION-NUMBER.tlog` | [`spooled_files`] |
//!
//! The recorder carries twice a second; what is left at the end the supervisor does.

pub mod run_logs;
pub mod spooled_files;

use crate::Instance;
use crate::config::Config;
use run_logs::RunLogs;
use spooled_files::SpooledFiles;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// How much is carried by one write (bytes).
const PIECE_BYTES: usize = 256 << 10;

/// Whether `config`, or the service manager, names a folder to carry something to.
pub fn is_wanted(config: &Config) -> bool {
    log_dir(config).is_some() || !config.link.tlog.is_empty()
}

/// Where the logs are to be kept: the folder of the configuration, else `LogsDirectory=` of the unit (systemd.exec(5)).
fn log_dir(config: &Config) -> Option<PathBuf> {
    let of_the_service_manager = || {
        let folders = std::env::var("LOGS_DIRECTORY").ok()?;
        let first = folders.split(':').next().filter(|folder| !folder.is_empty())?;
        Some(PathBuf::from(first))
    };
    config.log_dir.clone().or_else(of_the_service_manager)
}

/// Carries from memory to the disk.
#[derive(Debug)]
pub struct Carrier {
    logs: Option<RunLogs>,
    tlog: Option<SpooledFiles>,
}

/// What could not be carried, and why.
#[derive(Debug, Default)]
pub struct NotCarried {
    /// The logs.
    pub logs: Option<String>,
    /// The telemetry log.
    pub tlog: Option<String>,
}

impl Carrier {
    /// Of a running `instance`. Nothing is touched yet.
    pub fn new(instance: &Instance, config: &Config) -> Self {
        let (tlog, max_bytes) = (&config.link.tlog, u64::from(config.link.tlog_max_mb) * 1_000_000);
        Self {
            logs: log_dir(config).map(|log_dir| RunLogs::new(instance, &log_dir, config.log_max_mb)),
            tlog: (!tlog.is_empty())
                .then(|| SpooledFiles::new(&instance.spool(), Path::new(tlog), "tlog", max_bytes)),
        }
    }

    /// Carries what has been written since the last time; it is tried again the next time if that fails. Waits for the disk.
    pub fn carry(&mut self) -> NotCarried {
        let why = |carried: Option<io::Result<()>>| carried?.err().map(|error| error.to_string());
        NotCarried {
            logs: why(self.logs.as_mut().map(RunLogs::carry)),
            tlog: why(self.tlog.as_mut().map(SpooledFiles::carry)),
        }
    }
}

/// Appends what `from` holds behind `position`, up to `end`, to the file at `to`, which is made if it is not there; `position` follows
/// what has been written.
fn append(from: &std::fs::File, position: &mut u64, end: u64, to: &Path) -> io::Result<()> {
    if *position >= end {
        return Ok(());
    }
    let mut file = std::fs::File::options().create(true).append(true).open(to)?;
    let mut piece = vec![0; PIECE_BYTES.min(usize::try_from(end - *position).unwrap_or(PIECE_BYTES))];
    while *position < end {
        let wanted = piece
            .len()
            .min(usize::try_from(end - *position).unwrap_or(PIECE_BYTES));
        let read = from.read_at(&mut piece[..wanted], *position)?;
        if read == 0 {
            break;
        }
        let mut rest = &piece[..read];
        while !rest.is_empty() {
            match io::Write::write(&mut file, rest)? {
                0 => return Err(io::ErrorKind::WriteZero.into()),
                written => {
                    *position += written as u64;
                    rest = &rest[written..];
                }
            }
        }
    }
    Ok(())
}
