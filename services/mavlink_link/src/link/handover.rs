//! A link that passes from one process to another: its descriptors over a local socket, and every byte that came in.
//!
//! The process that holds the link listens at a path in the instance's folder. A second one (a candidate of a swap, a
//! hot shadow) connects as a guest and is sent, in this order:
//!
//! | letter | content | when |
//! |---|---|---|
//! | link | the open descriptors (`SCM_RIGHTS`), and whom a UDP socket answers | at once, and whenever the link is opened again |
//! | stream, datagram | bytes with the time they were read, and their sender | at every read |
//! | released | what the holder has not handed to the kernel yet, and the caller's baton | when ownership passes on, as the last one |
//!
//! Only the holder reads from and writes to the link; the guest lives on the letters, so it is as warm as the
//! holder. After the last letter the two change their parts on the same connection. What the kernel has received
//! meanwhile waits in the descriptor that both have: no byte is read twice, none is lost. If the holder dies the
//! connection ends; the guest then holds all it needs to go on ([`super::Link::take`]).

use super::transport::{Kind, Parts};
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
/// Bytes of a letter beside the chunk: tag, time, length and text of an address, with room to spare.
const EXTRA_BYTES: usize = 128;

const LINK: u8 = b'L';
const STREAM: u8 = b'S';
const DATAGRAM: u8 = b'D';
const RELEASED: u8 = b'R';

/// What a guest is told.
#[derive(Debug)]
pub(super) enum Letter {
    /// Nothing now.
    Nothing,
    /// The link's descriptors; `None` while the link is lost.
    Link(Option<Parts<OwnedFd>>),
    /// Bytes of a stream, read at a time, in the letter box.
    Stream(Timestamp, std::ops::Range<usize>),
    /// A datagram and its sender.
    Datagram(Timestamp, Option<SocketAddr>, std::ops::Range<usize>),
    /// The link is the reader's from now on.
    Released {
        /// What the former holder wanted the next one to know.
        baton: std::ops::Range<usize>,
        /// Bytes accepted for sending and not yet taken by the kernel.
        unsent: std::ops::Range<usize>,
    },
    /// The other side is gone.
    Gone,
}

/// Two processes that share one link; seen from one of them.
#[derive(Debug)]
pub(super) struct Handover {
    path: PathBuf,
    listener: Option<OwnedFd>,
    peer: Option<OwnedFd>,
    is_guest: bool,
}

impl Handover {
    /// The holder's side: listens at `path`. A listener left there by a dead process is replaced.
    pub(super) fn host(path: &Path) -> io::Result<Self> {
        Ok(Self {
            listener: Some(listen(path)?),
            path: path.to_owned(),
            peer: None,
            is_guest: false,
        })
    }

    /// The guest's side: connects to the holder at `path`.
    pub(super) fn join(path: &Path) -> io::Result<Self> {
        Ok(Self {
            path: path.to_owned(),
            listener: None,
            peer: Some(connect(path)?),
            is_guest: true,
        })
    }

    /// The guest's side before there is a holder.
    pub(super) fn wait(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            listener: None,
            peer: None,
            is_guest: true,
        }
    }

    /// Holds no more, without anybody who goes on.
    pub(super) fn let_go(&mut self) {
        self.is_guest = true;
        self.listener = None;
        self.peer = None;
    }

    pub(super) fn is_guest(&self) -> bool {
        self.is_guest
    }

    /// Whether the other side is there.
    pub(super) fn has_peer(&self) -> bool {
        self.peer.is_some()
    }

    /// Of a guest: connects again to whoever holds the link now.
    pub(super) fn rejoin(&mut self) -> bool {
        self.peer = connect(&self.path).ok();
        self.peer.is_some()
    }

    /// Becomes the holder; the other side, if there is one, is the guest from now on.
    pub(super) fn become_holder(&mut self) {
        self.is_guest = false;
        // Without a listener there will be no next guest, and the flight goes on.
        match listen(&self.path) {
            Ok(listener) => self.listener = Some(listener),
            Err(error) => tracing::warn!("no handover at {}: {error}", self.path.display()),
        }
    }

    /// Accepts a guest, if one is waiting and there is none: its first letters are the caller's.
    pub(super) fn accept(&mut self) -> bool {
        let Some(listener) = self.listener.as_ref().filter(|_| self.peer.is_none()) else {
            return false;
        };
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        self.peer = rustix::net::accept_with(listener, flags).ok();
        self.peer.is_some()
    }

    /// Whether the guest has gone; a guest sends nothing, so anything readable is its end.
    pub(super) fn notice_departure(&mut self) {
        if let Some(peer) = self.peer.as_ref().filter(|_| !self.is_guest) {
            let mut nothing = [0u8; 1];
            match rustix::net::recv(peer, &mut nothing[..], RecvFlags::DONTWAIT) {
                Err(Errno::AGAIN | Errno::INTR) => {}
                _ => self.peer = None,
            }
        }
    }

    /// What to watch: a guest its letters, a holder its door and its guest's departure.
    pub(super) fn fds(&self) -> [Option<BorrowedFd<'_>>; 2] {
        let door = self.listener.as_ref().filter(|_| self.peer.is_none());
        [self.peer.as_ref().map(AsFd::as_fd), door.map(AsFd::as_fd)]
    }

    pub(super) fn send_link(&mut self, parts: Option<&Parts<BorrowedFd<'_>>>) {
        let (kind, fds, address) = match parts {
            Some(parts) => (parts.kind as u8, parts.fds.as_slice(), parts.peer),
            None => (0, &[][..], None),
        };
        let address = text(address);
        let head = [LINK, kind, address.len() as u8];
        let _goes = self.send(&[&head, address.as_bytes()], fds);
    }

    pub(super) fn send_stream(&mut self, time: Timestamp, bytes: &[u8]) {
        let _goes = self.send(&[&[STREAM], &time.ns.to_le_bytes(), bytes], &[]);
    }

    pub(super) fn send_datagram(&mut self, time: Timestamp, sender: Option<SocketAddr>, bytes: &[u8]) {
        if self.peer.is_none() {
            return;
        }
        let sender = text(sender);
        let head = [sender.len() as u8];
        let _goes = self.send(
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

    /// The last letter. Returns whether the other side has it: then this side is the guest.
    pub(super) fn release(&mut self, baton: &[u8], unsent: &[u8]) -> bool {
        let released = self.send(&[&[RELEASED, baton.len() as u8], baton, unsent], &[]);
        if released {
            self.is_guest = true;
            self.listener = None;
        }
        released
    }

    /// A guest that does not read falls out: the link waits for nobody.
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

    /// The next letter of a guest; its bytes are in `letter_box` at the ranges told.
    pub(super) fn next_letter(&mut self, letter_box: &mut [u8]) -> Letter {
        let Some(peer) = &self.peer else {
            return Letter::Gone;
        };
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(FDS))];
        let mut control = RecvAncillaryBuffer::new(&mut space);
        let flags = RecvFlags::DONTWAIT | RecvFlags::CMSG_CLOEXEC;
        let mut into = [IoSliceMut::new(letter_box)];
        let length = match rustix::net::recvmsg(peer, &mut into, &mut control, flags) {
            Ok(message) if message.bytes > 0 => message.bytes,
            Err(Errno::AGAIN | Errno::INTR) => return Letter::Nothing,
            _ => {
                self.peer = None;
                return Letter::Gone;
            }
        };
        let fds = control.drain().filter_map(|message| match message {
            RecvAncillaryMessage::ScmRights(fds) => Some(fds),
            _ => None,
        });
        let letter = read(&letter_box[..length], fds.flatten().collect());
        letter.unwrap_or_else(|| {
            tracing::warn!("a letter about the link that cannot be read: another version?");
            self.peer = None;
            Letter::Gone
        })
    }
}

/// Size of a letter box for chunks of `chunk_bytes`.
pub(super) fn letter_box(chunk_bytes: usize) -> Box<[u8]> {
    vec![0; chunk_bytes + EXTRA_BYTES].into_boxed_slice()
}

fn read(letter: &[u8], fds: Vec<OwnedFd>) -> Option<Letter> {
    let time = || {
        let bytes = letter.get(1..9)?.try_into().ok()?;
        Some(Timestamp::from_ns(u64::from_le_bytes(bytes)))
    };
    let address = |at: usize| {
        let end = at + 1 + usize::from(*letter.get(at)?);
        let text = std::str::from_utf8(letter.get(at + 1..end)?).ok()?;
        Some((text.parse().ok(), end))
    };
    match *letter.first()? {
        LINK if letter.get(1)? == &0 => Some(Letter::Link(None)),
        LINK => Some(Letter::Link(Some(Parts {
            kind: Kind::of(*letter.get(1)?)?,
            fds,
            peer: address(2)?.0,
        }))),
        STREAM => Some(Letter::Stream(time()?, 9..letter.len())),
        DATAGRAM => {
            let (sender, begin) = address(9)?;
            Some(Letter::Datagram(time()?, sender, begin..letter.len()))
        }
        RELEASED => {
            let begin = 2 + usize::from(*letter.get(1)?);
            letter.get(begin..)?;
            Some(Letter::Released {
                baton: 2..begin,
                unsent: begin..letter.len(),
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
        fn a_letter_of_any_bytes_is_read_or_refused(letter in proptest::collection::vec(any::<u8>(), 0..200)) {
            if let Some(super::Letter::Released { baton, unsent }) = read(&letter, Vec::new()) {
                prop_assert!(letter.get(baton).is_some() && letter.get(unsent).is_some());
            }
        }
    }
}
