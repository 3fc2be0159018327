//! Whole frames over a byte stream that takes only what fits: the rest of a frame waits, later ones are dropped whole.

use super::write::{Sent, write_now};
use std::io::{self, Write};

/// Bytes that may wait. Small on purpose: what waits is old when it arrives. 1024 bytes are eight setpoints, 90 ms at
/// 115200 bit/s.
const BACKLOG_BYTES: usize = 1024;

/// Bytes not yet taken by the kernel.
#[derive(Debug)]
pub(super) struct Backlog {
    bytes: Vec<u8>,
}

impl Default for Backlog {
    fn default() -> Self {
        Self {
            bytes: Vec::with_capacity(BACKLOG_BYTES),
        }
    }
}

impl Backlog {
    /// The bytes that wait.
    pub(super) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Takes over the bytes that waited in another process; forgets its own.
    pub(super) fn replace(&mut self, bytes: &[u8]) {
        self.bytes.clear();
        self.bytes.extend_from_slice(bytes);
    }

    /// Hands over as much as the stream takes now.
    pub(super) fn flush(&mut self, stream: &mut impl Write) -> io::Result<()> {
        if !self.bytes.is_empty() {
            let written = write_now(stream, &self.bytes)?;
            self.bytes.drain(..written);
        }
        Ok(())
    }

    /// Writes `frame` behind everything that still waits.
    pub(super) fn write(&mut self, stream: &mut impl Write, frame: &[u8]) -> io::Result<Sent> {
        self.flush(stream)?;
        if self.bytes.len() + frame.len() > BACKLOG_BYTES {
            return Ok(Sent::Busy);
        }
        let written = if self.bytes.is_empty() {
            write_now(stream, frame)?
        } else {
            0
        };
        self.bytes.extend_from_slice(&frame[written..]);
        Ok(Sent::Yes)
    }
}

#[cfg(test)]
mod tests {
    use super::{BACKLOG_BYTES, Backlog};
    use crate::link::write::Sent;
    use proptest::prelude::*;
    use std::io;

    /// Takes only as many bytes as it is allowed to, per call.
    struct Narrow {
        allowed: usize,
        taken: Vec<u8>,
    }
    impl io::Write for Narrow {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            if self.allowed == 0 {
                return Err(io::ErrorKind::WouldBlock.into());
            }
            let len = bytes.len().min(self.allowed);
            self.taken.extend_from_slice(&bytes[..len]);
            Ok(len)
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    proptest! {
        #[test]
        fn a_slow_line_gets_whole_frames_in_order_and_never_half_of_one(
            allowances in proptest::collection::vec(0usize..60, 1..60),
        ) {
            let mut stream = Narrow { allowed: 0, taken: Vec::new() };
            let mut backlog = Backlog::default();
            let mut accepted = Vec::new();
            for (number, allowed) in allowances.into_iter().enumerate() {
                stream.allowed = allowed;
                let frame = [number as u8; 100];
                if backlog.write(&mut stream, &frame).unwrap() == Sent::Yes {
                    accepted.extend_from_slice(&frame);
                }
                prop_assert!(backlog.bytes.len() <= BACKLOG_BYTES);
            }
            stream.allowed = usize::MAX;
            backlog.flush(&mut stream).unwrap();
            prop_assert_eq!(stream.taken, accepted);
        }
    }
}
