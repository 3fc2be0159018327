//! Writing to what takes only as much as fits now.

use std::io::{self, ErrorKind, Write};

/// What became of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sent {
    /// The kernel has its bytes, or will get them before any later frame's.
    Yes,
    /// Nobody to send it to yet.
    NoPeer,
    /// The link is slower than what it is given; the frame was dropped whole.
    Busy,
}

/// Writes like [`Write::write`], but "not now" is zero bytes and no error.
pub(super) fn write_now(stream: &mut (impl Write + ?Sized), bytes: &[u8]) -> io::Result<usize> {
    match stream.write(bytes) {
        Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => Ok(0),
        written => written,
    }
}
