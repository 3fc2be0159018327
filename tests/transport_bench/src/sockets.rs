//! Unix stream sockets, and UDP over the loopback interface.

use jink_transport_chain::{Fault, Incoming, Outgoing, StageArgs};
use rustix::net::sockopt::{set_socket_recv_buffer_size, set_socket_send_buffer_size};
use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::os::fd::AsFd;
use std::os::unix::net::{UnixListener, UnixStream};
use std::time::{Duration, Instant};

/// The neighbour has this long to be there (s).
const PATIENCE_S: f64 = 20.0;
/// What the kernel may keep of a hop (bytes); it grants what it allows.
const BUFFER: usize = 4 << 20;
/// Bytes of a datagram: few of them, and none longer than the loopback interface takes.
const DATAGRAM: usize = 60_000;

/// Tries until it works.
fn until_there<T>(mut attempt: impl FnMut() -> std::io::Result<T>) -> Result<T, Fault> {
    let until = Instant::now() + Duration::from_secs_f64(PATIENCE_S);
    loop {
        match attempt() {
            Ok(it) => return Ok(it),
            Err(error) if Instant::now() > until => return Err(error.into()),
            Err(_) => std::thread::sleep(Duration::from_millis(5)),
        }
    }
}

/// As large as the kernel allows: a refusal leaves the size it had.
fn enlarge(socket: impl AsFd) {
    let _as_it_was = set_socket_send_buffer_size(&socket, BUFFER);
    let _as_it_was = set_socket_recv_buffer_size(&socket, BUFFER);
}

fn is_late(error: &std::io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
    )
}

/// Sends over a stream.
struct StreamOut {
    stream: UnixStream,
    message: Vec<u8>,
}

impl Outgoing for StreamOut {
    fn send(&mut self, fill: &mut dyn FnMut(&mut [u8])) -> Result<(), Fault> {
        fill(&mut self.message);
        match self.stream.write_all(&self.message) {
            // The chain ends, and the other process was faster.
            Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
            other => Ok(other?),
        }
    }
}

/// Reads from a stream: messages have one size, so none says its length.
struct StreamIn {
    listener: UnixListener,
    stream: Option<UnixStream>,
    message: Vec<u8>,
    len: usize,
}

impl Incoming for StreamIn {
    fn receive(&mut self, patience: Duration, take: &mut dyn FnMut(&[u8])) -> Result<(), Fault> {
        let Self {
            listener,
            stream,
            message,
            len,
        } = self;
        let stream = match stream {
            Some(stream) => stream,
            None => match listener.accept() {
                Ok((accepted, _)) => {
                    enlarge(&accepted);
                    accepted.set_nonblocking(false)?;
                    accepted.set_read_timeout(Some(patience))?;
                    stream.insert(accepted)
                }
                Err(error) if is_late(&error) => {
                    std::thread::sleep(Duration::from_millis(5));
                    return Ok(());
                }
                Err(error) => return Err(error.into()),
            },
        };
        while *len < message.len() {
            match stream.read(&mut message[*len..]) {
                Ok(0) => {
                    // The chain ends.
                    std::thread::sleep(patience);
                    return Ok(());
                }
                Ok(read) => *len += read,
                Err(error) if is_late(&error) => return Ok(()),
                Err(error) => return Err(error.into()),
            }
        }
        *len = 0;
        take(message);
        Ok(())
    }
}

/// The end of hop `hop` of Unix stream sockets that sends.
pub fn stream_out(args: &StageArgs, hop: usize, message: usize) -> Result<Box<dyn Outgoing>, Fault> {
    let file = args.hop_file(hop, "sock");
    let stream = until_there(|| UnixStream::connect(&file))?;
    enlarge(&stream);
    Ok(Box::new(StreamOut {
        stream,
        message: vec![0; message],
    }))
}

/// The end that reads.
pub fn stream_in(args: &StageArgs, hop: usize, message: usize) -> Result<Box<dyn Incoming>, Fault> {
    let listener = UnixListener::bind(args.hop_file(hop, "sock"))?;
    listener.set_nonblocking(true)?;
    Ok(Box::new(StreamIn {
        listener,
        stream: None,
        message: vec![0; message],
        len: 0,
    }))
}

/// Sends datagrams, each with the number of its message and its place in it.
struct DatagramsOut {
    socket: UdpSocket,
    message: Vec<u8>,
    datagram: Vec<u8>,
    count: u32,
}

/// Number of the message and of the datagram within it, both u32.
const NUMBERS: usize = 8;

impl Outgoing for DatagramsOut {
    fn send(&mut self, fill: &mut dyn FnMut(&mut [u8])) -> Result<(), Fault> {
        let Self {
            socket,
            message,
            datagram,
            count,
        } = self;
        fill(message);
        *count = count.wrapping_add(1);
        for (place, part) in (0u32..).zip(message.chunks(DATAGRAM)) {
            datagram.clear();
            datagram.extend(count.to_ne_bytes());
            datagram.extend(place.to_ne_bytes());
            datagram.extend(part);
            match socket.send(datagram) {
                // The chain ends, and the other process was faster.
                Err(error) if error.kind() == ErrorKind::ConnectionRefused => {}
                other => {
                    other?;
                }
            }
        }
        Ok(())
    }
}

/// Puts datagrams together; a message of which one is missing is lost.
struct DatagramsIn {
    socket: UdpSocket,
    message: Vec<u8>,
    datagram: Vec<u8>,
    /// Number of the message, and the datagram of it that comes next.
    next: [u32; 2],
}

impl Incoming for DatagramsIn {
    fn receive(&mut self, patience: Duration, take: &mut dyn FnMut(&[u8])) -> Result<(), Fault> {
        let Self {
            socket,
            message,
            datagram,
            next,
        } = self;
        socket.set_read_timeout(Some(patience))?;
        loop {
            let len = match socket.recv(datagram) {
                Ok(len) => len,
                Err(error) if is_late(&error) => return Ok(()),
                Err(error) => return Err(error.into()),
            };
            let ([count, place], part) = match datagram[..len].split_at_checked(NUMBERS) {
                Some((numbers, part)) => {
                    let (words, _) = numbers.as_chunks();
                    ([0, 1].map(|word: usize| u32::from_ne_bytes(words[word])), part)
                }
                None => continue,
            };
            if place == 0 {
                *next = [count, 0];
            }
            let from = place as usize * DATAGRAM;
            if [count, place] != *next || from + part.len() > message.len() {
                continue;
            }
            message[from..from + part.len()].copy_from_slice(part);
            *next = [count, place + 1];
            if from + part.len() == message.len() {
                take(message);
                return Ok(());
            }
        }
    }
}

/// The end of hop `hop` of UDP that sends.
pub fn datagrams_out(args: &StageArgs, hop: usize, message: usize) -> Result<Box<dyn Outgoing>, Fault> {
    let file = args.hop_file(hop, "port");
    let port: u16 = until_there(|| {
        let text = std::fs::read_to_string(&file)?;
        text.trim().parse().map_err(std::io::Error::other)
    })?;
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
    enlarge(&socket);
    socket.connect(SocketAddr::from((Ipv4Addr::LOCALHOST, port)))?;
    Ok(Box::new(DatagramsOut {
        socket,
        message: vec![0; message],
        datagram: Vec::with_capacity(DATAGRAM + NUMBERS),
        count: 0,
    }))
}

/// The end that reads.
pub fn datagrams_in(args: &StageArgs, hop: usize, message: usize) -> Result<Box<dyn Incoming>, Fault> {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
    enlarge(&socket);
    std::fs::write(
        args.hop_file(hop, "port"),
        socket.local_addr()?.port().to_string(),
    )?;
    Ok(Box::new(DatagramsIn {
        socket,
        message: vec![0; message],
        datagram: vec![0; DATAGRAM + NUMBERS],
        next: [0; 2],
    }))
}
