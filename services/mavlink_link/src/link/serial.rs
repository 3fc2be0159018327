//! Serial ports: raw mode through termios.

use super::error::LinkError;
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::termios::{ControlModes, OptionalActions, SpecialCodeIndex};
use std::io::{self, Read, Write};
use std::os::fd::{AsFd, OwnedFd};

/// Opens `path` raw at `baud` bit/s: eight bits, no parity, one stop bit, no flow control, modem lines ignored.
pub(super) fn open(path: &str, baud: u32) -> Result<OwnedFd, LinkError> {
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let fd = rustix::fs::open(path, flags, Mode::empty()).map_err(|error| match error {
        Errno::NOENT | Errno::NXIO | Errno::NODEV => LinkError::NoDevice {
            path: path.to_owned(),
        },
        Errno::ACCESS | Errno::PERM => LinkError::Permission {
            path: path.to_owned(),
        },
        other => not_serial(path, baud, other),
    })?;
    make_raw(&fd, baud).map_err(|error| not_serial(path, baud, error))?;
    Ok(fd)
}

fn not_serial(path: &str, baud: u32, error: Errno) -> LinkError {
    LinkError::NotSerial {
        path: path.to_owned(),
        baud,
        source: error.into(),
    }
}

fn make_raw(fd: &impl AsFd, baud: u32) -> Result<(), Errno> {
    let mut settings = rustix::termios::tcgetattr(fd)?;
    settings.make_raw();
    settings.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
    settings.control_modes -= ControlModes::CRTSCTS | ControlModes::CSTOPB | ControlModes::PARENB;
    // At least one byte per read: only then does a read of zero bytes mean "unplugged" and not "nothing now".
    settings.special_codes[SpecialCodeIndex::VMIN] = 1;
    settings.special_codes[SpecialCodeIndex::VTIME] = 0;
    settings.set_speed(baud)?;
    rustix::termios::tcsetattr(fd, OptionalActions::Now, &settings)
}

/// Reads and writes of an open port.
pub(super) struct Port<'a>(pub(super) &'a OwnedFd);

impl Read for Port<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        Ok(rustix::io::read(self.0, bytes)?)
    }
}

impl Write for Port<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        Ok(rustix::io::write(self.0, bytes)?)
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
