//! Datagrams and the frames in them.

use crate::record::{Mode, Record};
use jink_mavlink_link::frame::Splitter;

use jink_emulated_autopilot::modes::arducopter;
use jink_emulated_autopilot::modes::px4::mode_of_custom;
use jink_emulated_ground_station::Make;
use jink_mavlink_link::encoder::Encoder;
use jink_mavlink_link::message::{Body, COMPONENT_AUTOPILOT, COMPONENT_AVOIDANCE, Content};
use jink_shared_types::frames::Point;
use jink_shared_types::geo::GlobalPoint;
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::{MavAutopilot, MavMessage, MavModeFlag};
use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// How long a reader waits before it looks whether the flight is over.
const PATIENCE: Duration = Duration::from_millis(50);

/// A UDP port on loopback and who sends to it.
#[derive(Debug)]
pub struct Wire {
    socket: UdpSocket,
    peer: Mutex<Option<SocketAddr>>,
    encoder: Mutex<Encoder>,
}

impl Wire {
    /// Waits at `port` for whoever sends.
    ///
    /// # Errors
    /// If the port is taken.
    pub fn listen(port: u16) -> io::Result<Self> {
        Self::bound(port, None)
    }

    /// At `port`, sending to `to`.
    ///
    /// # Errors
    /// If the port is taken.
    pub fn towards(port: u16, to: u16) -> io::Result<Self> {
        Self::bound(port, Some(SocketAddr::from(([127, 0, 0, 1], to))))
    }

    fn bound(port: u16, peer: Option<SocketAddr>) -> io::Result<Self> {
        let socket = UdpSocket::bind(("127.0.0.1", port))
            .map_err(|error| io::Error::new(error.kind(), format!("UDP port {port}: {error}")))?;
        socket.set_read_timeout(Some(PATIENCE))?;
        Ok(Self {
            socket,
            peer: Mutex::new(peer),
            encoder: Mutex::new(Encoder::new()),
        })
    }

    /// The next datagram; `None` if none came in a while. Whoever sent it is answered from now on.
    pub fn receive(&self, buffer: &mut [u8]) -> Option<usize> {
        let (length, from) = self.socket.recv_from(buffer).ok()?;
        *self.peer.lock().unwrap_or_else(PoisonError::into_inner) = Some(from);
        Some(length)
    }

    /// Sends bytes as they are. What nobody takes is lost, as on any line.
    pub fn send(&self, bytes: &[u8]) {
        let peer = *self.peer.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(peer) = peer {
            let _lost = self.socket.send_to(bytes, peer);
        }
    }

    /// Sends one message.
    pub fn say(&self, system: u8, component: u8, message: MavMessage) {
        let mut encoder = self.encoder.lock().unwrap_or_else(PoisonError::into_inner);
        let bytes = encoder
            .encode(system, component, &Body::Message(message))
            .to_vec();
        drop(encoder);
        self.send(&bytes);
    }
}

/// A frame of which somebody wants to know.
#[derive(Debug)]
pub struct Seen {
    /// Component that sent it.
    pub component: u8,
    /// Message type.
    pub id: u32,
    /// Bytes on the wire.
    pub bytes: usize,
    /// What it says, if it is known.
    pub message: Option<MavMessage>,
}

impl Seen {
    /// Whether the autopilot itself sent it.
    pub fn is_autopilots(&self) -> bool {
        self.component == COMPONENT_AUTOPILOT
    }
}

/// Calls `each` for every frame in a datagram; `decode` says of which types the content is wanted.
pub fn frames(
    splitter: &mut Splitter,
    datagram: &[u8],
    decode: impl Fn(u32) -> bool,
    mut each: impl FnMut(Seen),
) {
    splitter.load_datagram(datagram);
    while let Some(frame) = splitter.next_frame() {
        let message = match decode(frame.message_id).then(|| Content::of(&frame)).flatten() {
            Some(Content::Message(message)) => Some(message),
            _ => None,
        };
        each(Seen {
            component: frame.header.component_id,
            id: frame.message_id,
            bytes: frame.bytes.len(),
            message,
        });
    }
}

/// Notes what any link reports about the flight.
pub fn note(record: &mut Record, make: Make, seen: &Seen) {
    let Some(message) = &seen.message else { return };
    match message {
        MavMessage::HEARTBEAT(beat)
            if seen.is_autopilots() && beat.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID =>
        {
            record.see_mode(Mode {
                custom: beat.custom_mode,
                mode: mode_of(make, beat.custom_mode),
                is_armed: beat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED),
            });
        }
        MavMessage::HEARTBEAT(beat) if seen.component == COMPONENT_AVOIDANCE => {
            record.see_active(beat.system_status as u8 == 4);
        }
        MavMessage::STATUSTEXT(text) => {
            let words = text.text.to_str().unwrap_or_default();
            record.see_text(text.severity as u8, words.starts_with("jink"), words);
        }
        MavMessage::LOCAL_POSITION_NED(p) if seen.is_autopilots() => {
            record.local = Some(Point::new(f64::from(p.x), f64::from(p.y), f64::from(p.z)));
        }
        MavMessage::GLOBAL_POSITION_INT(p) if seen.is_autopilots() => {
            record.global = Some((GlobalPoint::from_e7(p.lat, p.lon), f64::from(p.alt) * 1e-3));
        }
        MavMessage::MISSION_CURRENT(current) if seen.is_autopilots() => record.see_current(current.seq),
        MavMessage::AUTOPILOT_VERSION(version) if seen.is_autopilots() => {
            let [_, patch, minor, major] = version.flight_sw_version.to_le_bytes();
            // PX4 writes the commit backwards into eight bytes, ArduPilot as eight letters.
            let custom = version.flight_custom_version;
            let commit = if custom.iter().all(u8::is_ascii_hexdigit) {
                String::from_utf8_lossy(&custom).into_owned()
            } else {
                custom.iter().rev().map(|byte| format!("{byte:02x}")).collect()
            };
            record.version = Some(format!("{major}.{minor}.{patch} {commit}"));
        }
        MavMessage::PARAM_VALUE(value) if seen.is_autopilots() => {
            let name = value.param_id.to_str().unwrap_or_default().to_owned();
            record.parameters.insert(name, value.param_value);
        }
        _ => {}
    }
}

/// The mode behind a heartbeat's number.
pub fn mode_of(make: Make, custom: u32) -> NavMode {
    let mode = match make {
        Make::Px4 => mode_of_custom(custom),
        Make::ArduCopter => arducopter::Mode::of_custom(custom).map(arducopter::Mode::nav),
    };
    mode.unwrap_or(NavMode::Unknown)
}

/// A thread that ends with this.
#[derive(Debug)]
pub struct Reader {
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Reader {
    /// Calls `each` with every datagram at `wire`, and with an empty one when none came in a while.
    pub fn start(wire: Arc<Wire>, mut each: impl FnMut(&[u8]) + Send + 'static) -> Self {
        let mut buffer = vec![0; 65536];
        Self::repeat(move || {
            let length = wire.receive(&mut buffer).unwrap_or(0);
            each(&buffer[..length]);
        })
    }

    /// Calls `work` again and again; it waits for what it waits for itself, shortly.
    pub fn repeat(mut work: impl FnMut() + Send + 'static) -> Self {
        let end = Arc::new(AtomicBool::new(false));
        let theirs = Arc::clone(&end);
        let thread = std::thread::spawn(move || {
            while !theirs.load(Ordering::Relaxed) {
                work();
            }
        });
        Self {
            end,
            thread: Some(thread),
        }
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic in there has been printed.
            let _reported = thread.join();
        }
    }
}
