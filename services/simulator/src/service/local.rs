//! MAVLink over datagram sockets of this machine (unix(7)): what is sent has arrived.

use super::udp::{Arrival, read_messages};
use jink_runtime::Clock;
use mavlink::dialect::MavMessage;
use mavlink::{MAVLinkV2MessageRaw, MavHeader, MavlinkReader};
use std::collections::VecDeque;
use std::fmt;
use std::io::{self, ErrorKind};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};

/// Longest datagram: a MAVLink frame has 280 bytes at most.
const DATAGRAM_BYTES: usize = 2048;

/// One end of a pair of datagram sockets.
///
/// Both ends connect to each other: the kernel then bounds what is under way by bytes, not by ten datagrams.
#[derive(Debug)]
pub struct LocalSocket {
    socket: UnixDatagram,
    peer: PathBuf,
    is_connected: bool,
}

impl LocalSocket {
    /// Binds `own`, in the place of what somebody has left there; the other end is at `peer`, now or later.
    ///
    /// # Errors
    /// What the system says.
    pub fn bind(own: &Path, peer: &Path) -> io::Result<Self> {
        match std::fs::remove_file(own) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        let socket = UnixDatagram::bind(own)?;
        socket.set_nonblocking(true)?;
        Ok(Self {
            is_connected: socket.connect(peer).is_ok(),
            socket,
            peer: peer.to_owned(),
        })
    }

    /// Sends one datagram; lost if nobody is there.
    pub fn send(&mut self, bytes: &[u8]) {
        for _ in 0..2 {
            if !self.is_connected {
                self.is_connected = self.socket.connect(&self.peer).is_ok();
            }
            if !self.is_connected || self.socket.send(bytes).is_ok() {
                return;
            }
            // Whoever was there is gone; somebody else may be there by now.
            self.is_connected = false;
        }
    }

    /// The next datagram, in `buffer`.
    pub fn receive<'a>(&mut self, buffer: &'a mut [u8]) -> Option<&'a [u8]> {
        if !self.is_connected {
            self.is_connected = self.socket.connect(&self.peer).is_ok();
        }
        let length = self.socket.recv(buffer).ok()?;
        buffer.get(..length)
    }
}

/// One link over a [`LocalSocket`].
pub struct MavLocal {
    socket: LocalSocket,
    reader: MavlinkReader<VecDeque<u8>>,
    clock: Clock,
}

impl fmt::Debug for MavLocal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "MavLocal({:?})", self.socket)
    }
}

impl MavLocal {
    /// Over `socket`; what comes in has come when `clock` says so.
    pub fn new(socket: LocalSocket, clock: Clock) -> Self {
        Self {
            socket,
            reader: MavlinkReader::new(VecDeque::new()),
            clock,
        }
    }

    /// Readable when something has come.
    pub fn fd(&self) -> BorrowedFd<'_> {
        self.socket.socket.as_fd()
    }

    /// Appends every message that has come.
    pub fn receive(&mut self, arrivals: &mut Vec<Arrival>) {
        let mut buffer = [0; DATAGRAM_BYTES];
        let time = self.clock.now();
        while let Some(bytes) = self.socket.receive(&mut buffer) {
            read_messages(&mut self.reader, bytes, time, arrivals);
        }
    }

    /// Sends one message; lost if nobody is there.
    pub fn send(&mut self, header: &MavHeader, message: &MavMessage) {
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.serialize_message(*header, message);
        self.socket.send(raw.raw_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::LocalSocket;

    #[test]
    fn a_hundred_datagrams_wait_and_a_new_peer_is_found() {
        let folder = std::env::temp_dir().join(format!("jink_local_{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let (here, there) = (folder.join("here"), folder.join("there"));
        let mut one = LocalSocket::bind(&here, &there).unwrap();
        let mut buffer = [0; 16];
        one.send(&[0]);
        let mut other = LocalSocket::bind(&there, &here).unwrap();
        assert!(one.receive(&mut buffer).is_none());
        for n in 1..=100 {
            one.send(&[n]);
        }
        let received: Vec<u8> =
            std::iter::from_fn(|| other.receive(&mut buffer).map(|bytes| bytes[0])).collect();
        assert_eq!(received, (1..=100).collect::<Vec<u8>>());
        drop(other);
        one.send(&[101]);
        let mut again = LocalSocket::bind(&there, &here).unwrap();
        one.send(&[102]);
        assert_eq!(again.receive(&mut buffer), Some(&[102][..]));
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
