//! The serial port of a scanner: opened raw, lost, and opened again with growing pauses.

use jink_shared_types::Timestamp;
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::termios::{ControlModes, OptionalActions, QueueSelector, SpecialCodeIndex};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

/// First pause before the port is tried again (s), and the longest one; each is twice the one before.
const PAUSE_S: [f64; 2] = [0.1, 2.0];

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

/// A serial port that comes and goes.
#[derive(Debug)]
pub struct Port {
    path: String,
    baud: u32,
    /// The motor of the scanner turns while DTR is off.
    dtr_off: bool,
    fd: Option<OwnedFd>,
    retry_at: Timestamp,
    pause_s: f64,
    /// What was said last: each cause once.
    said: String,
}

impl Port {
    /// `path` at `baud` bit/s, not open; with `dtr_off`, DTR is taken away when it is opened.
    pub fn new(path: &str, baud: u32, dtr_off: bool) -> Self {
        Self {
            path: path.to_owned(),
            baud,
            dtr_off,
            fd: None,
            retry_at: Timestamp::NEVER,
            pause_s: PAUSE_S[0],
            said: String::new(),
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
        match open(&self.path, self.baud, self.dtr_off) {
            Ok(fd) => {
                tracing::info!("{} is open at {} bit/s", self.path, self.baud);
                self.fd = Some(fd);
                self.said.clear();
                true
            }
            Err(error) => {
                let message = self.explained(error);
                self.wait(now, message);
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
            Ok(0) => "hung up".to_owned(),
            Ok(count) => {
                self.pause_s = PAUSE_S[0];
                return Read::Bytes(count);
            }
            Err(Errno::AGAIN | Errno::INTR) => return Read::Nothing,
            Err(error) => error.to_string(),
        };
        self.lose(now, &cause);
        Read::Lost
    }

    /// Writes all of `bytes`; a command that does not fit is lost, and repeated when no answer comes.
    pub fn write(&mut self, now: Timestamp, bytes: &[u8]) {
        let Some(fd) = &self.fd else {
            return;
        };
        match rustix::io::write(fd, bytes) {
            Ok(count) if count == bytes.len() => {}
            Ok(_) | Err(Errno::AGAIN | Errno::INTR) => tracing::debug!("{}: its output is full", self.path),
            Err(error) => self.lose(now, &error.to_string()),
        }
    }

    /// Closes it: another instance has it now.
    pub fn close(&mut self) {
        self.fd = None;
        self.retry_at = Timestamp::NEVER;
        self.pause_s = PAUSE_S[0];
    }

    fn lose(&mut self, now: Timestamp, cause: &str) {
        self.fd = None;
        let message = format!("{}: lost, opening it again: {cause}", self.path);
        self.wait(now, message);
    }

    fn wait(&mut self, now: Timestamp, message: String) {
        self.retry_at = now.plus_seconds(self.pause_s);
        self.pause_s = (2.0 * self.pause_s).min(PAUSE_S[1]);
        if self.said != message {
            tracing::warn!("{message}");
            self.said = message;
        }
    }

    fn explained(&self, error: Errno) -> String {
        let Self { path, baud, .. } = self;
        match error {
            Errno::NOENT | Errno::NXIO | Errno::NODEV => {
                format!("{path}: no such device; is it plugged in, and is the name right?")
            }
            Errno::ACCESS | Errno::PERM => {
                format!("{path}: permission denied; the user must be in the group dialout")
            }
            Errno::BUSY => format!("{path}: another program has it open; `fuser {path}` names it"),
            other => format!("{path}: no serial port that runs at {baud} bit/s: {other}"),
        }
    }
}

/// Opens `path` raw at `baud` bit/s: eight bits, no parity, one stop bit, no flow control; for ourselves alone. What has been waiting in
/// it is old, and dropped.
fn open(path: &str, baud: u32, dtr_off: bool) -> Result<OwnedFd, Errno> {
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let fd = rustix::fs::open(path, flags, Mode::empty())?;
    let mut settings = rustix::termios::tcgetattr(&fd)?;
    settings.make_raw();
    settings.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
    settings.control_modes -= ControlModes::CRTSCTS | ControlModes::CSTOPB | ControlModes::PARENB;
    settings.special_codes[SpecialCodeIndex::VMIN] = 1;
    settings.special_codes[SpecialCodeIndex::VTIME] = 0;
    settings.set_speed(baud)?;
    rustix::termios::tcsetattr(&fd, OptionalActions::Now, &settings)?;
    rustix::termios::ioctl_tiocexcl(&fd)?;
    rustix::termios::tcflush(&fd, QueueSelector::IFlush)?;
    if dtr_off {
        let port = serial2::SerialPort::from(rustix::io::dup(&fd)?);
        if let Err(error) = port.set_dtr(false) {
            tracing::debug!("{path}: DTR cannot be set: {error}");
        }
    }
    Ok(fd)
}
