//! MAVLink over UDP on loopback, without waiting.

use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::{MAVLinkV2MessageRaw, MavHeader, MavlinkReader};
use std::collections::VecDeque;
use std::io::Read;
use std::net::{SocketAddr, UdpSocket};
use std::os::fd::{AsFd, BorrowedFd};

/// Bytes received and not yet read as messages.
#[derive(Default)]
struct Feed {
    bytes: VecDeque<u8>,
}

impl Read for Feed {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        self.bytes.read(out)
    }
}

/// One UDP link.
pub struct MavUdp {
    socket: UdpSocket,
    peer: Option<SocketAddr>,
    reader: MavlinkReader<Feed>,
    datagram: Vec<u8>,
}

impl MavUdp {
    /// Binds `local`; sends to `peer`, or, if there is none, to whoever spoke last.
    pub fn open(local: SocketAddr, peer: Option<SocketAddr>) -> std::io::Result<Self> {
        let socket = UdpSocket::bind(local)?;
        socket.set_nonblocking(true)?;
        Ok(Self {
            socket,
            peer,
            reader: MavlinkReader::new(Feed::default()),
            datagram: vec![0; 65_536],
        })
    }

    /// Readable when something has come.
    pub fn fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }

    /// Appends every message that has come. Errors of the socket (a peer that is not up yet answers with one) pass.
    pub fn receive(&mut self, messages: &mut Vec<(MavHeader, MavMessage)>) {
        loop {
            match self.socket.recv_from(&mut self.datagram) {
                Ok((length, from)) => {
                    if self
                        .peer
                        .is_none_or(|peer| !peer.ip().is_unspecified() && from.port() != peer.port())
                    {
                        self.peer = Some(from);
                    }
                    self.reader.get_mut().bytes.extend(&self.datagram[..length]);
                    while let Ok(message) = self.reader.read_any_message::<MavMessage>() {
                        messages.push(message);
                    }
                }
                Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => return,
                Err(error) if error.kind() == std::io::ErrorKind::ConnectionRefused => {}
                Err(error) => {
                    tracing::warn!("UDP: {error}");
                    return;
                }
            }
        }
    }

    /// Sends one message; lost if nobody listens, as UDP does.
    pub fn send(&self, header: &MavHeader, message: &MavMessage) {
        let Some(peer) = self.peer else { return };
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.serialize_message(*header, message);
        let _lost = self.socket.send_to(raw.raw_bytes(), peer);
    }
}
