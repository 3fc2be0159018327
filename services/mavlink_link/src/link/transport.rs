//! The kinds of transport behind one interface: non-blocking reads of chunks, writes of whole frames.

use super::backlog::Backlog;
use super::endpoint::{Endpoint, UNIX_ANSWER};
use super::error::LinkError;
use super::write::Sent;
use jink_runtime::serial;
use rustix::net::{AddressFamily, SocketFlags, SocketType};
use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::net::{IpAddr, SocketAddr, TcpListener, TcpStream, ToSocketAddrs, UdpSocket};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::net::UnixDatagram;
use std::path::PathBuf;

/// How long a peer may leave bytes unacknowledged before the connection counts as lost (ms). The system's own
/// limit is a quarter of an hour, in which a restarted peer could not get in.
const UNACKNOWLEDGED_MS: u32 = 5000;

/// An open transport.
#[derive(Debug)]
pub(super) enum Transport {
    /// Replies to the last sender that is of the kind the link is for.
    UdpIn {
        socket: UdpSocket,
        peer: Option<SocketAddr>,
        last_sender: Option<SocketAddr>,
    },
    UdpOut(UdpSocket),
    TcpIn {
        listener: TcpListener,
        client: Option<(TcpStream, Backlog)>,
    },
    TcpOut(TcpStream, Backlog),
    Serial(File, Backlog),
    Unix(UnixDatagram),
}

/// Kinds of open transports, as numbered in a handover message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum TransportKind {
    UdpIn = 1,
    UdpOut = 2,
    TcpIn = 3,
    TcpOut = 4,
    Serial = 5,
    Unix = 6,
}

impl TransportKind {
    pub(super) fn of(number: u8) -> Option<Self> {
        [
            Self::UdpIn,
            Self::UdpOut,
            Self::TcpIn,
            Self::TcpOut,
            Self::Serial,
            Self::Unix,
        ]
        .into_iter()
        .find(|kind| *kind as u8 == number)
    }
}

/// What an open transport is made of.
#[derive(Debug)]
pub(super) struct TransportParts<Fd> {
    pub(super) kind: TransportKind,
    /// The descriptor; for a listener its client's as well, if there is one.
    pub(super) fds: Vec<Fd>,
    /// The peer to which a listening UDP socket replies.
    pub(super) peer: Option<SocketAddr>,
}

/// What a read brought.
pub(super) enum Chunk {
    /// This many bytes of a stream.
    Stream(usize),
    /// One datagram of this many bytes.
    Datagram(usize),
    /// Nothing now.
    Nothing,
    /// Something from an address that is not among the peers; it is dropped.
    UnknownPeer,
    /// Another file descriptor has to be watched from now on.
    DescriptorChanged,
}

impl Transport {
    pub(super) fn open(endpoint: &Endpoint) -> Result<Self, LinkError> {
        match endpoint {
            Endpoint::UdpIn { host, port } => {
                let socket = with_address(endpoint, host, *port, UdpSocket::bind::<SocketAddr>)?;
                set_nonblocking(endpoint, socket.set_nonblocking(true))?;
                Ok(Transport::UdpIn {
                    socket,
                    peer: None,
                    last_sender: None,
                })
            }
            Endpoint::UdpOut { host, port } => {
                let socket = with_address(endpoint, host, *port, connect_udp)?;
                set_nonblocking(endpoint, socket.set_nonblocking(true))?;
                Ok(Transport::UdpOut(socket))
            }
            Endpoint::TcpIn { host, port } => {
                let listener = with_address(endpoint, host, *port, TcpListener::bind::<SocketAddr>)?;
                set_nonblocking(endpoint, listener.set_nonblocking(true))?;
                Ok(Transport::TcpIn {
                    listener,
                    client: None,
                })
            }
            Endpoint::TcpOut { host, port } => {
                let stream = with_address(endpoint, host, *port, connect_tcp)?;
                Ok(Transport::TcpOut(stream, Backlog::default()))
            }
            Endpoint::Serial { path, baud } => {
                let fd = serial::open(path, *baud).map_err(LinkError::Serial)?;
                Ok(Transport::Serial(fd.into(), Backlog::default()))
            }
            Endpoint::Unix { path } => {
                connect_unix(path)
                    .map(Transport::Unix)
                    .map_err(|source| LinkError::Open {
                        endpoint: endpoint.clone(),
                        source,
                    })
            }
        }
    }

    pub(super) fn fd(&self) -> BorrowedFd<'_> {
        match self {
            Transport::UdpIn { socket, .. } | Transport::UdpOut(socket) => socket.as_fd(),
            Transport::TcpIn {
                client: Some((stream, _)),
                ..
            }
            | Transport::TcpOut(stream, _) => stream.as_fd(),
            Transport::TcpIn {
                listener,
                client: None,
            } => listener.as_fd(),
            Transport::Serial(fd, _) => fd.as_fd(),
            Transport::Unix(socket) => socket.as_fd(),
        }
    }

    /// What another process needs to have the same transport.
    pub(super) fn parts(&self) -> TransportParts<BorrowedFd<'_>> {
        let (kind, peer) = match self {
            Transport::UdpIn { peer, .. } => (TransportKind::UdpIn, *peer),
            Transport::UdpOut(_) => (TransportKind::UdpOut, None),
            Transport::TcpIn { .. } => (TransportKind::TcpIn, None),
            Transport::TcpOut(..) => (TransportKind::TcpOut, None),
            Transport::Serial(..) => (TransportKind::Serial, None),
            Transport::Unix(_) => (TransportKind::Unix, None),
        };
        let mut fds = vec![self.fd()];
        if let Transport::TcpIn { listener, client } = self
            && client.is_some()
        {
            fds.insert(0, listener.as_fd());
        }
        TransportParts { kind, fds, peer }
    }

    /// The transport of another process; `None` if its parts do not fit together.
    pub(super) fn of_parts(parts: TransportParts<OwnedFd>) -> Option<Self> {
        let peer = parts.peer;
        let mut fds = parts.fds.into_iter();
        let fd = fds.next()?;
        Some(match parts.kind {
            TransportKind::UdpIn => Transport::UdpIn {
                socket: UdpSocket::from(fd),
                peer,
                last_sender: None,
            },
            TransportKind::UdpOut => Transport::UdpOut(UdpSocket::from(fd)),
            TransportKind::TcpIn => Transport::TcpIn {
                listener: TcpListener::from(fd),
                client: fds
                    .next()
                    .map(|client| (TcpStream::from(client), Backlog::default())),
            },
            TransportKind::TcpOut => Transport::TcpOut(TcpStream::from(fd), Backlog::default()),
            TransportKind::Serial => Transport::Serial(fd.into(), Backlog::default()),
            TransportKind::Unix => Transport::Unix(UnixDatagram::from(fd)),
        })
    }

    /// What was accepted for sending and not yet taken by the kernel; datagrams never wait.
    pub(super) fn backlog(&mut self) -> Option<&mut Backlog> {
        match self {
            Transport::UdpIn { .. } | Transport::UdpOut(_) | Transport::Unix(_) => None,
            Transport::TcpIn { client, .. } => client.as_mut().map(|(_, backlog)| backlog),
            Transport::TcpOut(_, backlog) | Transport::Serial(_, backlog) => Some(backlog),
        }
    }

    /// Who sent the last datagram to a listening UDP socket.
    pub(super) fn last_sender(&self) -> Option<SocketAddr> {
        match self {
            Transport::UdpIn { last_sender, .. } => *last_sender,
            _ => None,
        }
    }

    /// Another process has read a datagram of `sender` from this transport.
    pub(super) fn set_last_sender(&mut self, sender: Option<SocketAddr>) {
        if let Transport::UdpIn { last_sender, .. } = self {
            *last_sender = sender;
        }
    }

    /// Reads what is there. Listening transports receive only from `peers`, from any if it is empty. Errors are fatal
    /// for the transport.
    pub(super) fn read(&mut self, chunk: &mut [u8], peers: &[IpAddr]) -> io::Result<Chunk> {
        match self {
            Transport::UdpIn {
                socket, last_sender, ..
            } => match socket.recv_from(chunk) {
                Ok((_, sender)) if !is_peer(peers, sender) => Ok(Chunk::UnknownPeer),
                Ok((len, sender)) => {
                    *last_sender = Some(sender);
                    Ok(Chunk::Datagram(len))
                }
                Err(error) => datagram_error(&error),
            },
            Transport::UdpOut(socket) => match socket.recv(chunk) {
                Ok(len) => Ok(Chunk::Datagram(len)),
                Err(error) => datagram_error(&error),
            },
            Transport::TcpIn { listener, client } => match client {
                Some((stream, backlog)) => {
                    let read = backlog.flush(stream).and_then(|()| stream_read(stream, chunk));
                    if read.is_err() {
                        *client = None;
                        return Ok(Chunk::DescriptorChanged);
                    }
                    read
                }
                None => accept(listener).map(|accepted| match accepted {
                    Some((_, from)) if !is_peer(peers, from) => Chunk::UnknownPeer,
                    Some((stream, _)) => {
                        *client = Some((stream, Backlog::default()));
                        Chunk::DescriptorChanged
                    }
                    None => Chunk::Nothing,
                }),
            },
            Transport::TcpOut(stream, backlog) => {
                backlog.flush(stream)?;
                stream_read(stream, chunk)
            }
            Transport::Serial(port, backlog) => {
                backlog.flush(port)?;
                stream_read(port, chunk)
            }
            Transport::Unix(socket) => match socket.recv(chunk) {
                Ok(len) => Ok(Chunk::Datagram(len)),
                Err(error) if error.kind() == ErrorKind::WouldBlock => Ok(Chunk::Nothing),
                Err(error) => Err(error),
            },
        }
    }

    /// Writes one frame. Errors are fatal for the transport.
    pub(super) fn write(&mut self, frame: &[u8]) -> io::Result<Sent> {
        match self {
            Transport::UdpIn { socket, peer, .. } => match peer {
                Some(peer) => datagram_write(|| socket.send_to(frame, *peer)),
                None => Ok(Sent::NoPeer),
            },
            Transport::UdpOut(socket) => datagram_write(|| socket.send(frame)),
            Transport::TcpIn { client, .. } => match client {
                Some((stream, backlog)) => match backlog.write(stream, frame) {
                    Ok(sent) => Ok(sent),
                    // The next read notices the loss, too, and then the listener is watched again.
                    Err(_) => Ok(Sent::NoPeer),
                },
                None => Ok(Sent::NoPeer),
            },
            Transport::TcpOut(stream, backlog) => backlog.write(stream, frame),
            Transport::Serial(port, backlog) => backlog.write(port, frame),
            // Its other side is one socket: if that is gone, another one has to be found.
            Transport::Unix(socket) => match socket.send(frame) {
                Ok(_) => Ok(Sent::Yes),
                Err(error) if error.kind() == ErrorKind::WouldBlock => Ok(Sent::Busy),
                Err(error) => Err(error),
            },
        }
    }

    /// Whether what was read last came from the address that is answered. Where there is none yet, or only one can send, it did.
    pub(super) fn is_from_peer(&self) -> bool {
        match self {
            Transport::UdpIn {
                peer, last_sender, ..
            } => peer.is_none() || peer == last_sender,
            _ => true,
        }
    }

    /// The datagram just read came from the one this link is for: answers go there.
    pub(super) fn set_peer_to_last_sender(&mut self) {
        if let Transport::UdpIn {
            peer,
            last_sender: Some(sender),
            ..
        } = self
        {
            *peer = Some(*sender);
        }
    }
}

fn set_nonblocking(endpoint: &Endpoint, done: io::Result<()>) -> Result<(), LinkError> {
    done.map_err(|source| LinkError::Open {
        endpoint: endpoint.clone(),
        source,
    })
}

/// Tries `open` on every address of the host until one works.
fn with_address<T>(
    endpoint: &Endpoint,
    host: &str,
    port: u16,
    open: impl Fn(SocketAddr) -> io::Result<T>,
) -> Result<T, LinkError> {
    let resolve_error = |source| LinkError::Resolve {
        endpoint: endpoint.clone(),
        source,
    };
    let name = host.trim_start_matches('[').trim_end_matches(']');
    let mut failure = io::Error::new(ErrorKind::NotFound, "the name has no address");
    for address in (name, port).to_socket_addrs().map_err(resolve_error)? {
        match open(address) {
            Ok(opened) => return Ok(opened),
            Err(error) => failure = error,
        }
    }
    Err(match failure.kind() {
        ErrorKind::AddrInUse => LinkError::AddressInUse {
            endpoint: endpoint.clone(),
            port,
        },
        _ => LinkError::Open {
            endpoint: endpoint.clone(),
            source: failure,
        },
    })
}

/// Connecting a datagram socket only fixes the peer: foreign datagrams are dropped by the kernel, and a peer that is
/// not up yet shows as a refusal that is not fatal.
fn connect_udp(peer: SocketAddr) -> io::Result<UdpSocket> {
    let any = if peer.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
    let socket = UdpSocket::bind(any)?;
    socket.connect(peer)?;
    Ok(socket)
}

/// A socket of its own beside the other side's. What a dead process has left there is replaced.
fn connect_unix(path: &str) -> io::Result<UnixDatagram> {
    let own = PathBuf::from(format!("{path}{UNIX_ANSWER}"));
    match std::fs::remove_file(&own) {
        Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    let socket = UnixDatagram::bind(own)?;
    socket.set_nonblocking(true)?;
    socket.connect(path)?;
    Ok(socket)
}

/// Starts a connection without waiting for it: until it stands reads bring nothing, and a failure shows as a read
/// error.
fn connect_tcp(peer: SocketAddr) -> io::Result<TcpStream> {
    let family = if peer.is_ipv4() {
        AddressFamily::INET
    } else {
        AddressFamily::INET6
    };
    let flags = SocketFlags::NONBLOCK | SocketFlags::CLOEXEC;
    let socket = rustix::net::socket_with(family, SocketType::STREAM, flags, None)?;
    match rustix::net::connect(&socket, &peer) {
        Ok(()) | Err(rustix::io::Errno::INPROGRESS) => {}
        Err(error) => return Err(error.into()),
    }
    let stream = TcpStream::from(socket);
    tune(&stream)?;
    Ok(stream)
}

/// Frames leave at once, and a peer that vanishes without closing is detected.
fn tune(stream: &TcpStream) -> io::Result<()> {
    stream.set_nodelay(true)?;
    Ok(rustix::net::sockopt::set_tcp_user_timeout(
        stream,
        UNACKNOWLEDGED_MS,
    )?)
}

fn accept(listener: &TcpListener) -> io::Result<Option<(TcpStream, SocketAddr)>> {
    match listener.accept() {
        Ok((stream, from)) => {
            stream.set_nonblocking(true)?;
            tune(&stream)?;
            Ok(Some((stream, from)))
        }
        // A client that is gone before it was accepted is no fault of the listener.
        Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::ConnectionAborted) => {
            Ok(None)
        }
        Err(error) if error.kind() == ErrorKind::Interrupted => Ok(None),
        Err(error) => Err(error),
    }
}

/// A socket for both families reports IPv4 addresses in the form of IPv6.
fn is_peer(peers: &[IpAddr], sender: SocketAddr) -> bool {
    peers.is_empty() || peers.contains(&sender.ip().to_canonical())
}

/// No error of a datagram socket ends the link: a refusal means that the peer is not up (yet), anything else concerns
/// one datagram. A refusal clears itself, so the next read goes on behind it.
fn datagram_error(error: &io::Error) -> io::Result<Chunk> {
    match error.kind() {
        ErrorKind::WouldBlock => Ok(Chunk::Nothing),
        _ => Ok(Chunk::Datagram(0)),
    }
}

/// A refusal of an earlier datagram is reported on this one, which was then not sent: one more attempt.
fn datagram_write(send: impl Fn() -> io::Result<usize>) -> io::Result<Sent> {
    match send().or_else(|_| send()) {
        Ok(_) => Ok(Sent::Yes),
        Err(error) if error.kind() == ErrorKind::WouldBlock => Ok(Sent::Busy),
        Err(_) => Ok(Sent::NoPeer),
    }
}

fn stream_read(stream: &mut (impl Read + ?Sized), chunk: &mut [u8]) -> io::Result<Chunk> {
    match stream.read(chunk) {
        Ok(0) => Err(io::Error::new(
            ErrorKind::UnexpectedEof,
            "closed by the other side",
        )),
        Ok(len) => Ok(Chunk::Stream(len)),
        Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {
            Ok(Chunk::Nothing)
        }
        Err(error) => Err(error),
    }
}
