//! Handover of a link from one process to another: its descriptors over a local socket, and every byte received.
//!
//! The process that owns the link listens at a path in the instance's folder. A second one (a candidate of a swap, a
//! hot shadow) connects as the standby and receives, in this order:
//!
//! | message | content | when |
//! |---|---|---|
//! | link | the open descriptors (`SCM_RIGHTS`), and the peer of a UDP socket | at once, and whenever the link is opened again |
//! | stream, datagram | bytes with the time they were read, and their sender | at every read |
//! | released | bytes that the owner has not written yet, and the caller's state | at the handover, as the last one |
//!
//! Only the owner reads from and writes to the link. The standby reads these messages and so knows all that the owner
//! knows. After the last message the two swap their roles on the same connection. What the kernel has received
//! meanwhile waits in the descriptor that both have: no byte is read twice, none is lost. If the owner dies the
//! connection ends; the standby then has all it needs to take over ([`super::Link::take_over`]).

use super::transport::{TransportKind, TransportParts};
use jink_shared_types::Timestamp;
use rustix::io::Errno;
use rustix::net::{
    AddressFamily, RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, SendAncillaryBuffer,
    SendAncillaryMessage, SendFlags, SocketAddrUnix, SocketFlags, SocketType,
};
use std::io::{self, IoSlice, IoSliceMut};
use std::mem::MaybeUninit;
use std::net::SocketAddr;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};

/// Descriptors of one link: a listener and its client.
const FDS: usize = 2;
/// Bytes of a message beside the chunk: tag, time, length and text of an address, and some to spare.
const EXTRA_BYTES: usize = 128;

const LINK: u8 = b'L';
const STREAM: u8 = b'S';
const DATAGRAM: u8 = b'D';
const RELEASED: u8 = b'R';

/// What a standby receives.
#[derive(Debug)]
pub(super) enum HandoverMessage {
    /// Nothing now.
    Nothing,
    /// The link's descriptors; `None` while the link is lost.
    Link(Option<TransportParts<OwnedFd>>),
    /// Bytes of a stream and the time at which they were read; the range is in the message buffer.
    Stream(Timestamp, std::ops::Range<usize>),
    /// A datagram and its sender.
    Datagram(Timestamp, Option<SocketAddr>, std::ops::Range<usize>),
    /// The link is the reader's from now on.
    Released {
        /// The former owner's handover state.
        state: std::ops::Range<usize>,
        /// Bytes accepted for sending and not yet taken by the kernel.
        unsent: std::ops::Range<usize>,
    },
    /// The connection is closed.
    Gone,
}

/// Two processes that share one link; seen from one of them.
#[derive(Debug)]
pub(super) struct Handover {
    path: PathBuf,
    listener: Option<OwnedFd>,
    peer: Option<OwnedFd>,
    is_standby: bool,
}

impl Handover {
    /// The owner's side: listens at `path`. A listener left there by a dead process is replaced.
    pub(super) fn host(path: &Path) -> io::Result<Self> {
        Ok(Self {
            listener: Some(listen(path)?),
            path: path.to_owned(),
            peer: None,
            is_standby: false,
        })
    }

    /// The standby's side: connects to the owner at `path`.
    pub(super) fn join(path: &Path) -> io::Result<Self> {
        Ok(Self {
            path: path.to_owned(),
            listener: None,
            peer: Some(connect(path)?),
            is_standby: true,
        })
    }

    /// The standby's side before there is an owner.
    pub(super) fn wait(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            listener: None,
            peer: None,
            is_standby: true,
        }
    }

    /// Gives the link up without a successor.
    pub(super) fn abandon(&mut self) {
        self.is_standby = true;
        self.listener = None;
        self.peer = None;
    }

    pub(super) fn is_standby(&self) -> bool {
        self.is_standby
    }

    /// Whether the other side is there.
    pub(super) fn has_peer(&self) -> bool {
        self.peer.is_some()
    }

    /// Of a standby: connects again to the present owner.
    pub(super) fn reconnect(&mut self) -> bool {
        self.peer = connect(&self.path).ok();
        self.peer.is_some()
    }

    /// Becomes the owner; the other side, if connected, is the standby from now on.
    pub(super) fn become_owner(&mut self) {
        self.is_standby = false;
        // Without a listener there can be no next standby; the flight continues.
        match listen(&self.path) {
            Ok(listener) => self.listener = Some(listener),
            Err(error) => tracing::warn!("no handover at {}: {error}", self.path.display()),
        }
    }

    /// Accepts a standby, if one is waiting and there is none; the caller sends its first messages.
    pub(super) fn accept(&mut self) -> bool {
        let Some(listener) = self.listener.as_ref().filter(|_| self.peer.is_none()) else {
            return false;
        };
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        self.peer = rustix::net::accept_with(listener, flags).ok();
        self.peer.is_some()
    }

    /// Detects that the standby has gone; a standby sends nothing, so anything readable is the end of the connection.
    pub(super) fn detect_disconnect(&mut self) {
        if let Some(peer) = self.peer.as_ref().filter(|_| !self.is_standby) {
            let mut nothing = [0u8; 1];
            match rustix::net::recv(peer, &mut nothing[..], RecvFlags::DONTWAIT) {
                Err(Errno::AGAIN | Errno::INTR) => {}
                _ => self.peer = None,
            }
        }
    }

    /// The descriptors to watch: a standby's messages; of an owner the listening socket and its standby's disconnect.
    pub(super) fn fds(&self) -> [Option<BorrowedFd<'_>>; 2] {
        let handover_socket = self.listener.as_ref().filter(|_| self.peer.is_none());
        [
            self.peer.as_ref().map(AsFd::as_fd),
            handover_socket.map(AsFd::as_fd),
        ]
    }

    pub(super) fn send_link(&mut self, parts: Option<&TransportParts<BorrowedFd<'_>>>) {
        let (kind, fds, address) = match parts {
            Some(parts) => (parts.kind as u8, parts.fds.as_slice(), parts.peer),
            None => (0, &[][..], None),
        };
        let address = text(address);
        let head = [LINK, kind, address.len() as u8];
        let _ = self.send(&[&head, address.as_bytes()], fds);
    }

    pub(super) fn send_stream(&mut self, time: Timestamp, bytes: &[u8]) {
        let _ = self.send(&[&[STREAM], &time.ns.to_le_bytes(), bytes], &[]);
    }

    pub(super) fn send_datagram(&mut self, time: Timestamp, sender: Option<SocketAddr>, bytes: &[u8]) {
        if self.peer.is_none() {
            return;
        }
        let sender = text(sender);
        let head = [sender.len() as u8];
        let _ = self.send(
            &[
                &[DATAGRAM],
                &time.ns.to_le_bytes(),
                &head,
                sender.as_bytes(),
                bytes,
            ],
            &[],
        );
    }

    /// Sends the last message. Returns whether the other side has it: then this side is the standby.
    pub(super) fn release(&mut self, state: &[u8], unsent: &[u8]) -> bool {
        let released = self.send(&[&[RELEASED, state.len() as u8], state, unsent], &[]);
        if released {
            self.is_standby = true;
            self.listener = None;
        }
        released
    }

    /// A standby that does not read is disconnected: the link never waits for it.
    fn send(&mut self, parts: &[&[u8]], fds: &[BorrowedFd<'_>]) -> bool {
        let Some(peer) = &self.peer else { return false };
        let slices: Vec<IoSlice<'_>> = parts.iter().map(|part| IoSlice::new(part)).collect();
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(FDS))];
        let mut control = SendAncillaryBuffer::new(&mut space);
        if !fds.is_empty() {
            control.push(SendAncillaryMessage::ScmRights(fds));
        }
        let flags = SendFlags::DONTWAIT | SendFlags::NOSIGNAL;
        let sent = loop {
            match rustix::net::sendmsg(peer, &slices, &mut control, flags) {
                Err(Errno::INTR) => {}
                sent => break sent,
            }
        };
        if let Err(error) = sent {
            tracing::warn!("the second instance on the link is let go: {error}");
            self.peer = None;
        }
        sent.is_ok()
    }

    /// The next message of a standby; its bytes are in `message_buffer` at the ranges returned.
    pub(super) fn next_message(&mut self, message_buffer: &mut [u8]) -> HandoverMessage {
        let Some(peer) = &self.peer else {
            return HandoverMessage::Gone;
        };
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(FDS))];
        let mut control = RecvAncillaryBuffer::new(&mut space);
        let flags = RecvFlags::DONTWAIT | RecvFlags::CMSG_CLOEXEC;
        let mut into = [IoSliceMut::new(message_buffer)];
        let length = match rustix::net::recvmsg(peer, &mut into, &mut control, flags) {
            Ok(message) if message.bytes > 0 => message.bytes,
            Err(Errno::AGAIN | Errno::INTR) => return HandoverMessage::Nothing,
            _ => {
                self.peer = None;
                return HandoverMessage::Gone;
            }
        };
        let fds = control.drain().filter_map(|message| match message {
            RecvAncillaryMessage::ScmRights(fds) => Some(fds),
            _ => None,
        });
        let message = read(&message_buffer[..length], fds.flatten().collect());
        message.unwrap_or_else(|| {
            tracing::warn!("a letter about the link that cannot be read: another version?");
            self.peer = None;
            HandoverMessage::Gone
        })
    }
}

/// A message buffer for chunks of `chunk_bytes`.
pub(super) fn message_buffer(chunk_bytes: usize) -> Box<[u8]> {
    vec![0; chunk_bytes + EXTRA_BYTES].into_boxed_slice()
}

fn read(message: &[u8], fds: Vec<OwnedFd>) -> Option<HandoverMessage> {
    let time = || {
        let bytes = message.get(1..9)?.try_into().ok()?;
        Some(Timestamp::from_ns(u64::from_le_bytes(bytes)))
    };
    let address = |at: usize| {
        let end = at + 1 + usize::from(*message.get(at)?);
        let text = std::str::from_utf8(message.get(at + 1..end)?).ok()?;
        Some((text.parse().ok(), end))
    };
    match *message.first()? {
        LINK if message.get(1)? == &0 => Some(HandoverMessage::Link(None)),
        LINK => Some(HandoverMessage::Link(Some(TransportParts {
            kind: TransportKind::of(*message.get(1)?)?,
            fds,
            peer: address(2)?.0,
        }))),
        STREAM => Some(HandoverMessage::Stream(time()?, 9..message.len())),
        DATAGRAM => {
            let (sender, begin) = address(9)?;
            Some(HandoverMessage::Datagram(time()?, sender, begin..message.len()))
        }
        RELEASED => {
            let begin = 2 + usize::from(*message.get(1)?);
            message.get(begin..)?;
            Some(HandoverMessage::Released {
                state: 2..begin,
                unsent: begin..message.len(),
            })
        }
        _ => None,
    }
}

fn text(address: Option<SocketAddr>) -> String {
    address.map_or_else(String::new, |address| address.to_string())
}

fn local_socket() -> io::Result<OwnedFd> {
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    Ok(rustix::net::socket_with(
        AddressFamily::UNIX,
        SocketType::SEQPACKET,
        flags,
        None,
    )?)
}

fn listen(path: &Path) -> io::Result<OwnedFd> {
    let socket = local_socket()?;
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    rustix::net::bind(&socket, &SocketAddrUnix::new(path)?)?;
    rustix::net::listen(&socket, 1)?;
    Ok(socket)
}

fn connect(path: &Path) -> io::Result<OwnedFd> {
    let socket = local_socket()?;
    rustix::net::connect(&socket, &SocketAddrUnix::new(path)?)?;
    Ok(socket)
}

#[cfg(test)]
mod tests {
    use super::read;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_handover_message_of_any_bytes_is_read_or_rejected(message in proptest::collection::vec(any::<u8>(), 0..200)) {
            if let Some(super::HandoverMessage::Released { state, unsent }) = read(&message, Vec::new()) {
                prop_assert!(message.get(state).is_some() && message.get(unsent).is_some());
            }
        }
    }
}
