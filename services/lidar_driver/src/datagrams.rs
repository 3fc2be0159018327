//! Where datagrams come from: a UDP socket, or a recording that is played at its own pace.

use crate::capture::{Capture, CaptureError};
use crate::config::Device;
use jink_shared_types::Timestamp;
use rustix::net::sockopt;
use std::fmt;
use std::io::ErrorKind;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use std::os::fd::{AsFd, BorrowedFd};
use std::path::PathBuf;

/// First pause before the source is tried again (s), and the longest one; each is twice the one before.
const PAUSE_S: [f64; 2] = [0.1, 2.0];
/// Room for what arrives while the process does not run (bytes): a tenth of a second of the fastest lidar. The system
/// may grant less.
const RECEIVE_BYTES: usize = 4 << 20;
/// The longest datagram.
const DATAGRAM_BYTES: usize = 65_536;
/// Between the end of a recording and its next beginning (s).
const LOOP_PAUSE_S: f64 = 0.1;
/// Longest gap in a recording that is waited for (s): pauses between two runs of a recorder are not.
const GAP_S: f64 = 1.0;

/// Why there are no datagrams.
#[derive(Debug)]
pub enum SourceError {
    /// The address cannot be bound.
    Bind {
        /// The address.
        address: SocketAddr,
        /// The system's error.
        source: std::io::Error,
    },
    /// The recording cannot be read.
    Capture(CaptureError),
}

impl fmt::Display for SourceError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bind { address, source } => {
                write!(f, "udp:{address} cannot be bound: {source}")?;
                match source.kind() {
                    ErrorKind::AddrInUse => {
                        f.write_str("; another program has this port, `ss -lunp` names it")
                    }
                    ErrorKind::AddrNotAvailable => {
                        f.write_str("; no interface has this address, `ip addr` names them")
                    }
                    _ => Ok(()),
                }
            }
            Self::Capture(error) => error.fmt(f),
        }
    }
}
impl std::error::Error for SourceError {}

/// A recording that is being played.
struct Player {
    capture: Capture,
    /// Time of the recording (ns) and of the board at which they are the same.
    begun: Option<(u64, Timestamp)>,
    /// The datagram that comes next, and when.
    next: Option<(Timestamp, IpAddr)>,
    payload: Vec<u8>,
}

enum Open {
    Udp(UdpSocket),
    Pcap(Box<Player>),
}

/// A source of datagrams that comes and goes.
pub struct Datagrams {
    device: Device,
    open: Option<Open>,
    buffer: Box<[u8]>,
    retry_at: Timestamp,
    pause_s: f64,
    /// The last error logged: each cause once.
    said: String,
    ended: bool,
}

impl fmt::Debug for Datagrams {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "Datagrams({:?}, {})",
            self.device,
            if self.open.is_some() { "open" } else { "closed" }
        )
    }
}

impl Datagrams {
    /// Of `device`, not open.
    pub fn new(device: &Device) -> Self {
        Self {
            device: device.clone(),
            open: None,
            buffer: vec![0; DATAGRAM_BYTES].into_boxed_slice(),
            retry_at: Timestamp::NEVER,
            pause_s: PAUSE_S[0],
            said: String::new(),
            ended: false,
        }
    }

    /// The port that is bound; zero while none is.
    pub fn port(&self) -> u16 {
        match &self.open {
            Some(Open::Udp(socket)) => socket.local_addr().map_or(0, |address| address.port()),
            _ => 0,
        }
    }

    /// What is to be watched for data.
    pub fn watched(&self) -> Option<BorrowedFd<'_>> {
        match &self.open {
            Some(Open::Udp(socket)) => Some(socket.as_fd()),
            _ => None,
        }
    }

    /// When the next datagram of a recording is due, or a source that is not open is tried again.
    pub fn due(&self) -> Timestamp {
        match &self.open {
            Some(Open::Pcap(player)) => player.next.map_or(Timestamp::NEVER, |(due, _)| due),
            Some(Open::Udp(_)) => Timestamp::from_ns(u64::MAX),
            None if self.ended => Timestamp::from_ns(u64::MAX),
            None => self.retry_at,
        }
    }

    /// Opens the source if it is closed and due. Whether it has just been opened.
    pub fn open_if_due(&mut self, now: Timestamp) -> bool {
        if self.open.is_some() || self.ended || now < self.retry_at {
            return false;
        }
        match open(&self.device) {
            Ok(opened) => {
                let first = self.said != OPENED;
                if first {
                    tracing::info!("{} is open", described(&self.device));
                }
                OPENED.clone_into(&mut self.said);
                self.open = Some(opened);
                self.pause_s = PAUSE_S[0];
                true
            }
            Err(error) => {
                self.fail(now, error.to_string());
                false
            }
        }
    }

    /// The next datagram that is there, and its sender.
    pub fn next(&mut self, now: Timestamp) -> Option<(IpAddr, &[u8])> {
        match &mut self.open {
            None => None,
            Some(Open::Udp(socket)) => match socket.recv_from(&mut self.buffer) {
                Ok((length, from)) => Some((from.ip(), &self.buffer[..length])),
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => None,
                // A message that a host or port is unreachable concerns what was sent.
                Err(error) if error.kind() == ErrorKind::ConnectionRefused => None,
                Err(error) => {
                    self.fail(
                        now,
                        format!("{}: lost, opening it again: {error}", described(&self.device)),
                    );
                    None
                }
            },
            Some(Open::Pcap(_)) => self.played(now),
        }
    }

    /// Closes it: another instance has it now.
    pub fn close(&mut self) {
        self.open = None;
        self.retry_at = Timestamp::NEVER;
        self.pause_s = PAUSE_S[0];
    }

    fn played(&mut self, now: Timestamp) -> Option<(IpAddr, &[u8])> {
        let Some(Open::Pcap(player)) = &mut self.open else {
            return None;
        };
        if player.next.is_none() {
            match player.advance(now) {
                Ok(true) => {}
                Ok(false) => {
                    self.end_of_recording(now);
                    return None;
                }
                Err(error) => {
                    self.fail(now, error.to_string());
                    return None;
                }
            }
        }
        let Some(Open::Pcap(player)) = &mut self.open else {
            return None;
        };
        let (_, source) = player.next.filter(|(due, _)| *due <= now)?;
        player.next = None;
        Some((source, &player.payload))
    }

    fn end_of_recording(&mut self, now: Timestamp) {
        self.open = None;
        self.retry_at = now.plus_seconds(LOOP_PAUSE_S);
        if let Device::Pcap { path, loops: false } = &self.device {
            tracing::info!("{}: played to its end", path.display());
            self.ended = true;
        }
    }

    fn fail(&mut self, now: Timestamp, error: String) {
        self.open = None;
        self.retry_at = now.plus_seconds(self.pause_s);
        self.pause_s = (2.0 * self.pause_s).min(PAUSE_S[1]);
        if self.said != error {
            tracing::warn!("{error}");
            self.said = error;
        }
    }
}

/// Stands for the last message while all is well.
const OPENED: &str = "open";

fn described(device: &Device) -> String {
    match device {
        Device::Udp(address) => format!("udp:{address}"),
        Device::Pcap { path, .. } => format!("pcap:{}", path.display()),
        Device::Serial { path, .. } => path.clone(),
    }
}

fn open(device: &Device) -> Result<Open, SourceError> {
    let path = match device {
        Device::Udp(address) => return bind(*address).map(Open::Udp),
        Device::Pcap { path, .. } => path.clone(),
        Device::Serial { path, .. } => PathBuf::from(path),
    };
    let capture = Capture::open(&path).map_err(SourceError::Capture)?;
    Ok(Open::Pcap(Box::new(Player {
        capture,
        begun: None,
        next: None,
        payload: Vec::with_capacity(DATAGRAM_BYTES),
    })))
}

/// A socket for datagrams to `address`.
pub(crate) fn bind(address: SocketAddr) -> Result<UdpSocket, SourceError> {
    let failed = |source| SourceError::Bind { address, source };
    let socket = UdpSocket::bind(address).map_err(failed)?;
    socket.set_nonblocking(true).map_err(failed)?;
    // Less than this is no reason to do without.
    let _ = sockopt::set_socket_recv_buffer_size(&socket, RECEIVE_BYTES);
    Ok(socket)
}

impl Player {
    /// Fetches the datagram that comes next; `false` at the end.
    fn advance(&mut self, now: Timestamp) -> Result<bool, CaptureError> {
        let Some(datagram) = self.capture.next_datagram()? else {
            return Ok(false);
        };
        let (recorded_ns, played) = *self.begun.get_or_insert((datagram.time_ns, now));
        let since_s = datagram.time_ns.saturating_sub(recorded_ns) as f64 * 1e-9;
        let mut due = played.plus_seconds(since_s);
        if due.seconds_since(now) > GAP_S || datagram.time_ns < recorded_ns {
            self.begun = Some((datagram.time_ns, now));
            due = now;
        }
        self.payload.clear();
        self.payload.extend_from_slice(datagram.payload);
        self.next = Some((due, datagram.address.source.ip()));
        Ok(true)
    }
}

/// The address that this computer has on its way to `peer`.
pub(crate) fn address_towards(peer: IpAddr) -> Option<Ipv4Addr> {
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).ok()?;
    socket.connect((peer, 9)).ok()?;
    match socket.local_addr().ok()?.ip() {
        IpAddr::V4(address) => Some(address),
        IpAddr::V6(_) => None,
    }
}
