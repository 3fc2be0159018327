//! An emulated autopilot on UDP in a thread of its own, in real time, with faults of its line and company.
//!
//! | in | out |
//! |---|---|
//! | an autopilot, [`Faults`], the port on this machine that it talks to | datagrams, until this is dropped |
// A harness for tests: without its thread and port there is nothing to test.
#![allow(clippy::expect_used)]

use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::{Link, Packet};
use jink_mavlink_link::encoder::Encoder;
use jink_mavlink_link::frame::Splitter;
use jink_mavlink_link::message::{Body, Content};
use jink_mavlink_link::signing::{Key, SIGNED_FRAME_MAX, sign, stamps};
use jink_simulated_world::vehicle::STEP_US;
use mavlink::dialect::MavMessage;
use mavlink::{MAVLinkV1MessageRaw, MavHeader, Message};
use std::net::UdpSocket;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// What is wrong with the line, and who else sends on it.
#[derive(Clone, Debug, Default)]
pub struct Faults {
    /// The autopilot receives nothing.
    pub is_deaf: bool,
    /// Message types that do not come through.
    pub lost: Vec<u32>,
    /// Message type of which only every so many come through.
    pub thinned: Option<(u32, u32)>,
    /// Everything leaves as MAVLink 1, where that has it.
    pub version_1: bool,
    /// Everything leaves with a signature of this key.
    pub key: Option<Key>,
    /// What others say once a second: system, component, message.
    pub others: Vec<(u8, u8, MavMessage)>,
}

/// A thread that is ended with this.
#[derive(Debug)]
pub struct OnUdp {
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl OnUdp {
    /// `autopilot`, if there is one, talks to `port` from now on.
    ///
    /// # Panics
    /// If there is no port for it.
    pub fn begin(port: u16, autopilot: Option<Box<dyn Autopilot + Send>>, faults: Faults) -> Self {
        let mut mouth = Mouth::new(port, faults);
        Self::run(move |end| mouth.speak(autopilot, end))
    }

    /// Somebody sends datagrams to `port` that are no MAVLink.
    ///
    /// # Panics
    /// If there is no port for it.
    pub fn noise(port: u16) -> Self {
        let socket = UdpSocket::bind(("127.0.0.1", 0)).expect("a UDP port");
        Self::run(move |end| {
            while !end.load(Ordering::Relaxed) {
                let _lost = socket.send_to(
                    b"$GPGGA,120000.00,4723.86,N,00832.73,E,1,08,1.0,488.0,M\r\n",
                    ("127.0.0.1", port),
                );
                std::thread::sleep(Duration::from_millis(20));
            }
        })
    }

    fn run(work: impl FnOnce(&AtomicBool) + Send + 'static) -> Self {
        let end = Arc::new(AtomicBool::new(false));
        let theirs = Arc::clone(&end);
        Self {
            end,
            thread: Some(std::thread::spawn(move || work(&theirs))),
        }
    }
}

impl Drop for OnUdp {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic in there has been printed.
            let _reported = thread.join();
        }
    }
}

struct Mouth {
    socket: UdpSocket,
    port: u16,
    faults: Faults,
    encoders: Vec<(u8, Encoder)>,
    thinned: u32,
    sequence: u8,
    stamp: u64,
    splitter: Splitter,
}

impl Mouth {
    fn new(port: u16, faults: Faults) -> Self {
        let socket = UdpSocket::bind(("127.0.0.1", 0)).expect("a UDP port");
        socket.set_nonblocking(true).expect("a socket that does not wait");
        Self {
            socket,
            port,
            faults,
            encoders: Vec::new(),
            thinned: 0,
            sequence: 0,
            stamp: stamps::wall(),
            splitter: Splitter::new(),
        }
    }

    fn speak(&mut self, mut autopilot: Option<Box<dyn Autopilot + Send>>, end: &AtomicBool) {
        let begin = Instant::now();
        let (mut steps, mut seconds) = (0u64, 0u64);
        let (mut inbox, mut outbox) = (Vec::new(), Vec::new());
        while !end.load(Ordering::Relaxed) {
            self.receive(&mut inbox);
            let due = begin.elapsed().as_micros() as u64 / STEP_US;
            while steps < due {
                steps += 1;
                outbox.clear();
                if let Some(autopilot) = &mut autopilot {
                    autopilot.step(&inbox, &mut outbox);
                }
                inbox.clear();
                for packet in outbox.iter().filter(|packet| packet.link == Link::Companion) {
                    self.say_own(packet);
                }
            }
            if begin.elapsed().as_secs() > seconds {
                seconds += 1;
                for (system_id, component_id, message) in self.faults.others.clone() {
                    self.say(system_id, component_id, &message);
                }
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    fn receive(&mut self, inbox: &mut Vec<Packet>) {
        let mut datagram = [0; 2048];
        while let Ok(length) = self.socket.recv(&mut datagram) {
            self.splitter.load_datagram(&datagram[..length]);
            while let Some(frame) = self.splitter.next_frame() {
                if let Some(Content::Message(message)) = Content::of(&frame)
                    && !self.faults.is_deaf
                {
                    inbox.push(Packet {
                        link: Link::Companion,
                        header: frame.header,
                        message,
                    });
                }
            }
        }
    }

    fn say_own(&mut self, packet: &Packet) {
        let id = packet.message.message_id();
        if self.faults.lost.contains(&id) {
            return;
        }
        if let Some((thin, every)) = self.faults.thinned
            && thin == id
        {
            self.thinned += 1;
            if !self.thinned.is_multiple_of(every) {
                return;
            }
        }
        self.say(
            packet.header.system_id as u8,
            packet.header.component_id,
            &packet.message,
        );
    }

    fn say(&mut self, system_id: u8, component_id: u8, message: &MavMessage) {
        if self.faults.version_1 {
            self.say_in_version_1(system_id, component_id, message);
            return;
        }
        let at = match self.encoders.iter().position(|(system, _)| *system == system_id) {
            Some(at) => at,
            None => {
                self.encoders.push((system_id, Encoder::new()));
                self.encoders.len() - 1
            }
        };
        let frame = self.encoders[at]
            .1
            .encode(system_id, component_id, &Body::Message(message.clone()));
        let mut signed = [0; SIGNED_FRAME_MAX];
        let bytes = match &self.faults.key {
            Some(key) => {
                self.stamp += 1;
                sign(frame, key, 0, self.stamp, &mut signed)
            }
            None => Some(frame),
        };
        if let Some(bytes) = bytes {
            let _lost = self.socket.send_to(bytes, ("127.0.0.1", self.port));
        }
    }

    fn say_in_version_1(&mut self, system_id: u8, component_id: u8, message: &MavMessage) {
        if message.message_id() > u32::from(u8::MAX) {
            return;
        }
        self.sequence = self.sequence.wrapping_add(1);
        let mut raw = MAVLinkV1MessageRaw::new();
        let header = MavHeader {
            system_id: u32::from(system_id),
            component_id,
            sequence: self.sequence,
        };
        raw.serialize_message(header, message);
        let _lost = self.socket.send_to(raw.raw_bytes(), ("127.0.0.1", self.port));
    }
}
