//! Passes datagrams between the autopilot's fixed ports and those of jink and the ground station, byte for byte, and shows what
//! they say to the [`AutopilotWatch`].

use super::ports::PortError;
use super::watch::AutopilotWatch;
use mavlink::MavlinkReader;
use mavlink::dialect::MavMessage;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::collections::VecDeque;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Largest datagram (bytes).
const DATAGRAM_BYTES: usize = 65_536;
/// How often an idle relay looks whether it is to end.
const LOOK: Timespec = Timespec {
    tv_sec: 0,
    tv_nsec: 50_000_000,
};

/// One link: the end at the autopilot and the end at the companion or station.
pub struct RelayLink {
    autopilot: UdpSocket,
    /// The address from which the autopilot sends, once it has sent anything.
    autopilot_at: Option<SocketAddr>,
    other: UdpSocket,
    other_at: SocketAddr,
    from_autopilot: MavlinkReader<VecDeque<u8>>,
    from_other: MavlinkReader<VecDeque<u8>>,
}

impl RelayLink {
    /// Binds `port`, to which the autopilot sends, for whoever listens at `other_at`.
    pub fn open(port: u16, other_at: SocketAddr) -> Result<Self, PortError> {
        let io = |cause: std::io::Error| PortError::Io {
            cause: format!("UDP port {port}: {cause}"),
        };
        let autopilot = UdpSocket::bind((Ipv4Addr::LOCALHOST, port)).map_err(io)?;
        let other = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).map_err(io)?;
        autopilot.set_nonblocking(true).map_err(io)?;
        other.set_nonblocking(true).map_err(io)?;
        Ok(Self {
            autopilot,
            autopilot_at: None,
            other,
            other_at,
            from_autopilot: MavlinkReader::new(VecDeque::new()),
            from_other: MavlinkReader::new(VecDeque::new()),
        })
    }

    /// Passes on what has come.
    fn pass(&mut self, buffer: &mut [u8], now_s: f64, watch: &Mutex<AutopilotWatch>) {
        while let Some((length, from)) = receive(&self.autopilot, buffer) {
            self.autopilot_at = Some(from);
            let bytes = buffer.get(..length).unwrap_or_default();
            // Nobody listens there yet, or any more: datagrams get lost.
            let _lost = self.other.send_to(bytes, self.other_at);
            read(&mut self.from_autopilot, bytes, |header, message| {
                lock(watch).see_autopilot(now_s, header, message);
            });
        }
        while let Some((length, _)) = receive(&self.other, buffer) {
            let bytes = buffer.get(..length).unwrap_or_default();
            if let Some(autopilot_at) = self.autopilot_at {
                let _lost = self.autopilot.send_to(bytes, autopilot_at);
            }
            read(&mut self.from_other, bytes, |header, message| {
                lock(watch).see_companion(now_s, header, message);
            });
        }
    }
}

/// The watch, whatever became of another thread that had it.
pub fn lock(watch: &Mutex<AutopilotWatch>) -> std::sync::MutexGuard<'_, AutopilotWatch> {
    watch.lock().unwrap_or_else(PoisonError::into_inner)
}

fn receive(socket: &UdpSocket, buffer: &mut [u8]) -> Option<(usize, SocketAddr)> {
    loop {
        match socket.recv_from(buffer) {
            Ok(received) => return Some(received),
            // The answer to a datagram that nobody took.
            Err(error) if error.kind() == std::io::ErrorKind::ConnectionRefused => {}
            Err(_) => return None,
        }
    }
}

fn read(
    reader: &mut MavlinkReader<VecDeque<u8>>,
    bytes: &[u8],
    mut see: impl FnMut(&mavlink::MavHeader, &MavMessage),
) {
    reader.get_mut().extend(bytes);
    while let Ok((header, message)) = reader.read_any_message::<MavMessage>() {
        see(&header, &message);
    }
}

/// Passes on everything on `links` until `stop`; `now_us` is the simulated time.
pub fn run(
    mut links: Vec<RelayLink>,
    watch: &Arc<Mutex<AutopilotWatch>>,
    now_us: &AtomicU64,
    stop: &AtomicBool,
) {
    let mut buffer = vec![0; DATAGRAM_BYTES];
    while !stop.load(Ordering::Relaxed) {
        let mut fds: Vec<PollFd<'_>> = links
            .iter()
            .flat_map(|link| [&link.autopilot, &link.other])
            .map(|socket| PollFd::new(socket, PollFlags::IN))
            .collect();
        let _interrupted = poll(&mut fds, Some(&LOOK));
        let now_s = now_us.load(Ordering::Relaxed) as f64 * 1e-6;
        for link in &mut links {
            link.pass(&mut buffer, now_s, watch);
        }
    }
}
