//! Serial ports: opened raw ([`open`]); and one of a device, which is lost and opened again with growing pauses ([`Port`]).

use jink_shared_types::Timestamp;
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::termios::{ControlModes, OptionalActions, QueueSelector, SpecialCodeIndex};
use std::fmt;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

/// First pause before a port is tried again (s), and the longest one; each is twice the one before.
const PAUSE_S: [f64; 2] = [0.1, 2.0];

/// Why a port is not open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SerialError {
    /// The device file does not exist.
    NoDevice {
        /// Its path.
        path: String,
    },
    /// The device may not be opened.
    Permission {
        /// Its path.
        path: String,
    },
    /// Another program holds it.
    Busy {
        /// Its path.
        path: String,
    },
    /// The file is no serial port, or does not take this speed.
    NotSerial {
        /// Its path.
        path: String,
        /// The speed asked for (bit/s).
        baud: u32,
        /// What the system says.
        source: Errno,
    },
    /// It was open, and broke or was unplugged.
    Lost {
        /// Its path.
        path: String,
        /// What the system says; `None`: the other end has hung up.
        source: Option<Errno>,
    },
}

impl SerialError {
    fn opening(path: &str, baud: u32, source: Errno) -> Self {
        let path = path.to_owned();
        match source {
            Errno::NOENT | Errno::NXIO | Errno::NODEV => Self::NoDevice { path },
            Errno::ACCESS | Errno::PERM => Self::Permission { path },
            Errno::BUSY => Self::Busy { path },
            _ => Self::NotSerial { path, baud, source },
        }
    }
}

impl fmt::Display for SerialError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoDevice { path } => {
                write!(
                    f,
                    "{path}: no such device; is it plugged in, and is the name right?"
                )
            }
            Self::Permission { path } => {
                write!(
                    f,
                    "{path}: permission denied; the user must be in the group dialout"
                )
            }
            Self::Busy { path } => write!(f, "{path}: another program has it open; `fuser {path}` names it"),
            Self::NotSerial { path, baud, source } => {
                write!(f, "{path}: no serial port that runs at {baud} bit/s: {source}")
            }
            Self::Lost { path, source } => match source {
                Some(source) => write!(f, "{path}: lost, opening it again: {source}"),
                None => write!(f, "{path}: lost, opening it again: hung up"),
            },
        }
    }
}
impl std::error::Error for SerialError {}

/// Opens `path` raw at `baud` bit/s: eight bits, no parity, one stop bit, no flow control, modem lines ignored. Reads and writes do not
/// wait; a read of zero bytes means that the port is gone.
///
/// # Errors
/// If there is no such device, it may not be opened, or is no serial port that takes this speed.
pub fn open(path: &str, baud: u32) -> Result<OwnedFd, SerialError> {
    open_raw(path, baud).map_err(|error| SerialError::opening(path, baud, error))
}

/// As [`open`], for ourselves alone. What has been waiting in it is old, and dropped.
fn open_alone(path: &str, baud: u32) -> Result<OwnedFd, SerialError> {
    let alone = || {
        let fd = open_raw(path, baud)?;
        rustix::termios::ioctl_tiocexcl(&fd)?;
        rustix::termios::tcflush(&fd, QueueSelector::IFlush)?;
        Ok(fd)
    };
    alone().map_err(|error| SerialError::opening(path, baud, error))
}

fn open_raw(path: &str, baud: u32) -> Result<OwnedFd, Errno> {
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let fd = rustix::fs::open(path, flags, Mode::empty())?;
    let mut settings = rustix::termios::tcgetattr(&fd)?;
    settings.make_raw();
    settings.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
    settings.control_modes -= ControlModes::CRTSCTS | ControlModes::CSTOPB | ControlModes::PARENB;
    // At least one byte per read: only then does a read of zero bytes mean "unplugged" and not "nothing now".
    settings.special_codes[SpecialCodeIndex::VMIN] = 1;
    settings.special_codes[SpecialCodeIndex::VTIME] = 0;
    settings.set_speed(baud)?;
    rustix::termios::tcsetattr(&fd, OptionalActions::Now, &settings)?;
    Ok(fd)
}

/// What a read came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Read {
    /// So many bytes.
    Bytes(usize),
    /// Nothing now.
    Nothing,
    /// The port was lost.
    Lost,
}

/// The serial port of a device, ours alone, which comes and goes.
#[derive(Debug)]
pub struct Port {
    path: String,
    baud: u32,
    fd: Option<OwnedFd>,
    retry_at: Timestamp,
    pause_s: f64,
    /// What was said last: each cause once.
    said: Option<SerialError>,
}

impl Port {
    /// `path` at `baud` bit/s, not open.
    pub fn new(path: &str, baud: u32) -> Self {
        Self {
            path: path.to_owned(),
            baud,
            fd: None,
            retry_at: Timestamp::NEVER,
            pause_s: PAUSE_S[0],
            said: None,
        }
    }

    /// Whether it is open.
    pub fn is_open(&self) -> bool {
        self.fd.is_some()
    }

    /// What is to be watched for data.
    pub fn watched(&self) -> Option<BorrowedFd<'_>> {
        self.fd.as_ref().map(AsFd::as_fd)
    }

    /// When it is tried again; never while it is open.
    pub fn due(&self) -> Timestamp {
        match self.fd {
            Some(_) => Timestamp::from_ns(u64::MAX),
            None => self.retry_at,
        }
    }

    /// Opens it if it is closed and due. Whether it has just been opened.
    pub fn open_if_due(&mut self, now: Timestamp) -> bool {
        if self.fd.is_some() || now < self.retry_at {
            return false;
        }
        match open_alone(&self.path, self.baud) {
            Ok(fd) => {
                tracing::info!("{} is open at {} bit/s", self.path, self.baud);
                self.fd = Some(fd);
                self.said = None;
                true
            }
            Err(error) => {
                self.wait(now, error);
                false
            }
        }
    }

    /// Reads what is there, at most as much as `bytes` hold.
    pub fn read(&mut self, now: Timestamp, bytes: &mut [u8]) -> Read {
        let Some(fd) = &self.fd else {
            return Read::Nothing;
        };
        let cause = match rustix::io::read(fd, bytes) {
            // With VMIN = 1 a read of nothing is an end, not a pause.
            Ok(0) => None,
            Ok(count) => {
                self.pause_s = PAUSE_S[0];
                return Read::Bytes(count);
            }
            Err(Errno::AGAIN | Errno::INTR) => return Read::Nothing,
            Err(error) => Some(error),
        };
        self.lose(now, cause);
        Read::Lost
    }

    /// Writes all of `bytes`; a command that does not fit is lost, and repeated by whoever waits for its effect.
    pub fn write(&mut self, now: Timestamp, bytes: &[u8]) {
        let Some(fd) = &self.fd else {
            return;
        };
        match rustix::io::write(fd, bytes) {
            Ok(count) if count == bytes.len() => {}
            Ok(_) | Err(Errno::AGAIN | Errno::INTR) => tracing::debug!("{}: its output is full", self.path),
            Err(error) => self.lose(now, Some(error)),
        }
    }

    /// Closes it: another instance has it now.
    pub fn close(&mut self) {
        self.fd = None;
        self.retry_at = Timestamp::NEVER;
        self.pause_s = PAUSE_S[0];
    }

    fn lose(&mut self, now: Timestamp, source: Option<Errno>) {
        self.fd = None;
        let path = self.path.clone();
        self.wait(now, SerialError::Lost { path, source });
    }

    fn wait(&mut self, now: Timestamp, error: SerialError) {
        self.retry_at = now.plus_seconds(self.pause_s);
        self.pause_s = (2.0 * self.pause_s).min(PAUSE_S[1]);
        if self.said.as_ref() != Some(&error) {
            tracing::warn!("{error}");
            self.said = Some(error);
        }
    }
}
