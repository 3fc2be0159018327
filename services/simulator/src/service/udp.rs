//! MAVLink over UDP on loopback, without waiting, every message with the time at which the kernel took it in.

use jink_shared_types::Timestamp;
use mavlink::dialect::MavMessage;
use mavlink::{MAVLinkV2MessageRaw, MavHeader, MavlinkReader};
use nix::cmsg_space;
use nix::errno::Errno;
use nix::sys::socket::{
    ControlMessageOwned, MsgFlags, SockaddrIn, recvmsg, setsockopt, sockopt::ReceiveTimestampns,
};
use nix::sys::time::TimeSpec;
use rustix::time::{ClockId, Timespec, clock_gettime};
use std::collections::VecDeque;
use std::fmt;
use std::io::IoSliceMut;
use std::net::{SocketAddr, SocketAddrV4, UdpSocket};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd};

/// Two clocks read within this time were read at the same time (ns).
const UNDISTURBED_NS: u64 = 20_000;
/// Further readings of both clocks, if the first one was interrupted.
const READINGS: usize = 4;

/// A message with the time it arrived.
#[derive(Clone, Debug)]
pub struct Arrival {
    /// When the kernel took the datagram in, on the board's clock.
    pub time: Timestamp,
    /// Who sent it.
    pub header: MavHeader,
    /// What it says.
    pub message: MavMessage,
}

/// Appends every message that `bytes`, which came at `time`, complete.
pub(super) fn read_messages(
    reader: &mut MavlinkReader<VecDeque<u8>>,
    bytes: &[u8],
    time: Timestamp,
    arrivals: &mut Vec<Arrival>,
) {
    reader.get_mut().extend(bytes);
    while let Ok((header, message)) = reader.read_any_message::<MavMessage>() {
        arrivals.push(Arrival {
            time,
            header,
            message,
        });
    }
}

/// A datagram that was received.
struct Datagram {
    length: usize,
    from: Option<SocketAddr>,
    stamp: Option<TimeSpec>,
}

/// One UDP link.
pub struct MavUdp {
    socket: UdpSocket,
    peer: Option<SocketAddr>,
    reader: MavlinkReader<VecDeque<u8>>,
    datagram: Vec<u8>,
    control: Vec<u8>,
}

impl fmt::Debug for MavUdp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "MavUdp({:?})", self.socket)
    }
}

impl MavUdp {
    /// Binds `local`; sends to `peer`, or, if there is none, to whoever spoke last.
    ///
    /// # Errors
    /// What the system says.
    pub fn open(local: SocketAddr, peer: Option<SocketAddr>) -> std::io::Result<Self> {
        let socket = UdpSocket::bind(local)?;
        socket.set_nonblocking(true)?;
        setsockopt(&socket, ReceiveTimestampns, &true)?;
        Ok(Self {
            socket,
            peer,
            reader: MavlinkReader::new(VecDeque::new()),
            datagram: vec![0; 65_536],
            control: cmsg_space!(TimeSpec),
        })
    }

    /// Readable when something has come.
    pub fn fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }

    /// Appends every message that has come. Errors of the socket (a peer that is not up yet answers with one) pass.
    pub fn receive(&mut self, arrivals: &mut Vec<Arrival>) {
        loop {
            match self.take_datagram() {
                Ok(datagram) => {
                    if let Some(from) = datagram.from
                        && self
                            .peer
                            .is_none_or(|peer| !peer.ip().is_unspecified() && from.port() != peer.port())
                    {
                        self.peer = Some(from);
                    }
                    let time = on_boards_clock(datagram.stamp);
                    let bytes = self.datagram.get(..datagram.length).unwrap_or_default();
                    read_messages(&mut self.reader, bytes, time, arrivals);
                }
                Err(Errno::EAGAIN) => return,
                Err(Errno::ECONNREFUSED | Errno::EINTR) => {}
                Err(error) => {
                    tracing::warn!("UDP: {error}");
                    return;
                }
            }
        }
    }

    fn take_datagram(&mut self) -> Result<Datagram, Errno> {
        let mut into = [IoSliceMut::new(&mut self.datagram)];
        let message = recvmsg::<SockaddrIn>(
            self.socket.as_raw_fd(),
            &mut into,
            Some(&mut self.control),
            MsgFlags::empty(),
        )?;
        let stamp = message.cmsgs()?.find_map(|control| match control {
            ControlMessageOwned::ScmTimestampns(stamp) => Some(stamp),
            _ => None,
        });
        Ok(Datagram {
            length: message.bytes,
            from: message
                .address
                .map(|address| SocketAddr::V4(SocketAddrV4::from(address))),
            stamp,
        })
    }

    /// Sends one message; lost if nobody listens, as UDP does.
    pub fn send(&self, header: &MavHeader, message: &MavMessage) {
        let Some(peer) = self.peer else { return };
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.serialize_message(*header, message);
        let _lost = self.socket.send_to(raw.raw_bytes(), peer);
    }
}

/// The kernel stamps in wall time: what counts is how long ago that was. Without a stamp, now.
fn on_boards_clock(stamp: Option<TimeSpec>) -> Timestamp {
    let Some(stamp) = stamp else {
        return jink_runtime::now();
    };
    let (now, wall) = both_clocks();
    let age_s = (wall.tv_sec - stamp.tv_sec()) as f64 + (wall.tv_nsec - stamp.tv_nsec()) as f64 * 1e-9;
    now.plus_seconds(-age_s.max(0.0))
}

/// The board's clock and the wall clock at one moment: of some readings the one that was interrupted least.
fn both_clocks() -> (Timestamp, Timespec) {
    let read = || {
        let before = jink_runtime::now();
        let wall = clock_gettime(ClockId::Realtime);
        let after = jink_runtime::now();
        (after.ns_since(before), before, wall)
    };
    let mut best = read();
    for _ in 0..READINGS {
        if best.0 < UNDISTURBED_NS {
            break;
        }
        let again = read();
        if again.0 < best.0 {
            best = again;
        }
    }
    (best.1, best.2)
}

#[cfg(test)]
mod tests {
    use super::MavUdp;
    use mavlink::MavHeader;
    use mavlink::dialect::{HEARTBEAT_DATA, MavMessage};
    use std::net::{Ipv4Addr, SocketAddr};
    use std::time::Duration;

    #[test]
    fn a_message_read_late_still_has_the_time_when_it_came() {
        let anywhere = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let mut receiver = MavUdp::open(anywhere, None).unwrap();
        let address = receiver.socket.local_addr().unwrap();
        let sender = MavUdp::open(anywhere, Some(address)).unwrap();
        // The kernel begins to stamp a while after it was asked to, and the test may be interrupted anywhere.
        let reported = (0..50).any(|_| {
            let before = jink_runtime::now();
            sender.send(
                &MavHeader::default(),
                &MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()),
            );
            let after = jink_runtime::now();
            std::thread::sleep(Duration::from_millis(30));
            let mut arrivals = Vec::new();
            receiver.receive(&mut arrivals);
            assert_eq!(arrivals.len(), 1);
            assert_eq!(receiver.peer, Some(sender.socket.local_addr().unwrap()));
            let came = arrivals[0].time;
            came.plus_seconds(1e-3) >= before && came <= after.plus_seconds(1e-3)
        });
        assert!(reported);
    }
}
