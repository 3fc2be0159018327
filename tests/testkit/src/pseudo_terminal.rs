//! What stands in for a serial port.

use rustix::pty::OpenptFlags;
use std::os::fd::OwnedFd;
use std::path::Path;

/// A pseudo-terminal: the side of the device, and the path of the port. No program that is started later inherits the line:
/// it would stay open.
pub fn pseudo_terminal() -> (OwnedFd, String) {
    let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
    let control = rustix::pty::openpt(flags).unwrap();
    rustix::pty::grantpt(&control).unwrap();
    rustix::pty::unlockpt(&control).unwrap();
    let path = rustix::pty::ptsname(&control, Vec::new()).unwrap();
    (control, path.into_string().unwrap())
}

/// The device's side of one that is plugged in: the port is found under `link`, where another one may have been before.
pub fn plug_in(link: &Path) -> OwnedFd {
    let (control, path) = pseudo_terminal();
    let _none_before = std::fs::remove_file(link);
    std::os::unix::fs::symlink(path, link).unwrap();
    control
}
