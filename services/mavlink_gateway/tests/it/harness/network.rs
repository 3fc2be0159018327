//! Several links: what comes in goes where a plain model of MAVLink's rules says, byte by byte, and nowhere else.
//!
//! The model is the rules in their simplest form: which sender was seen where, which stamps each signer has used. So
//! nothing goes back where it came from, no key travels, no frame of ours is passed on, and refused frames are ignored.

use super::dice::Dice;
use super::messages;
use jink_mavlink_gateway::{Body, Content, Destination, Outgoing, Receipt, Received};
use jink_mavlink_link::frame::Splitter;
use jink_mavlink_link::link::{Link, Progress};
use jink_mavlink_link::links::{LinkSetup, Links};
use jink_mavlink_link::router::{OwnIds, Sender, Target};
use jink_mavlink_link::signing::{Key, SIGNED_FRAME_MAX, sign};
use jink_runtime::config::{Purpose, Signing};
use jink_shared_types::Timestamp;
use mavlink::MessageData;
use mavlink::dialect::*;
use std::collections::{BTreeMap, BTreeSet};
use std::net::UdpSocket;
use std::path::PathBuf;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

const LINKS: usize = 3;
const US: OwnIds = OwnIds {
    system_id: Some(1),
    components: [196, 191],
};
const SYSTEMS: [u8; 5] = [1, 255, 7, 42, 0];
const COMPONENTS: [u8; 6] = [1, 190, 196, 191, 100, 0];
/// A stream of signatures that is new may be this much behind the newest stamp: a minute.
const BEHIND: u64 = 6_000_000;
/// Who introduces himself at the other end of each link.
const FIRST: [(u8, u8); LINKS] = [(1, 1), (255, 190), (7, 100)];

/// Runs the laws of the network.
pub fn laws(data: &[u8]) {
    let mut dice = Dice::new(data);
    let mut network = Network::begin(&mut dice);
    while !dice.is_empty() {
        network.go_on(&mut dice);
    }
    for door in &network.doors {
        let _it_was_never_opened = std::fs::remove_file(door);
    }
}

/// What the rules make of what was received so far.
#[derive(Default)]
struct Model {
    routes: BTreeMap<(u32, u8), BTreeSet<usize>>,
    stamps: BTreeMap<(u32, u8, u8), u64>,
    newest: u64,
}

/// A frame as the model sees it.
struct Seen {
    bytes: Vec<u8>,
    message_id: u32,
    sender: Sender,
    is_verified: bool,
    content: Option<Content>,
    target: Target,
    signature: Option<[u8; 13]>,
}

struct Network {
    links: Links,
    doors: Vec<PathBuf>,
    peers: Vec<UdpSocket>,
    ports: [u16; LINKS],
    signing: [Signing; LINKS],
    key: Key,
    stamp: u64,
    model: Model,
    received: Vec<Received>,
    /// What was said before: signed frames to be played back, frames of ours to be thrown back.
    said: Vec<Vec<u8>>,
}

fn clock() -> Timestamp {
    Timestamp::from_seconds(1000.0)
}

/// Ports of this process for its links, below those that the kernel gives away while they are not in use.
fn ports() -> [u16; LINKS] {
    static PORTS: OnceLock<[u16; LINKS]> = OnceLock::new();
    *PORTS.get_or_init(|| {
        let first = std::process::id() as u16 % 4000 * LINKS as u16;
        let candidates = (0..4000u16).map(|i| 20_000 + (first + i * LINKS as u16) % 12_000);
        let are_free = |port: &u16| {
            (*port..port + LINKS as u16).all(|port| UdpSocket::bind(("127.0.0.1", port)).is_ok())
        };
        let port = candidates
            .into_iter()
            .find(are_free)
            .expect("three free ports in a row");
        std::array::from_fn(|i| port + i as u16)
    })
}

fn setup(index: usize, port: u16, signing: Signing, key: &Key) -> LinkSetup {
    LinkSetup {
        name: format!("link {index}"),
        endpoint: format!("udpin:127.0.0.1:{port}").parse().unwrap(),
        purpose: if index == 0 {
            Purpose::Autopilot
        } else {
            Purpose::GroundStation
        },
        signing,
        key: Some(key.clone()),
        link_id: index as u8,
        peers: Vec::new(),
        rate_bps: None,
    }
}

impl Network {
    fn begin(dice: &mut Dice<'_>) -> Self {
        static COUNT: AtomicU64 = AtomicU64::new(0);
        let key = Key::of_bytes(&[7; 32]).unwrap();
        let signing =
            [(); LINKS].map(|()| dice.pick(&[Signing::Off, Signing::Off, Signing::Accept, Signing::Require]));
        let ports = ports();
        let doors: Vec<_> = (0..LINKS)
            .map(|_| {
                let count = COUNT.fetch_add(1, Ordering::Relaxed);
                std::env::temp_dir().join(format!("jink-laws-door-{}-{count}", std::process::id()))
            })
            .collect();
        let setups = (0..LINKS).map(|i| setup(i, ports[i], signing[i], &key)).collect();
        let links = Links::open(setups, &doors, |first| Link::open(first.endpoint.clone())).unwrap();
        let peers = (0..LINKS)
            .map(|_| {
                let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
                socket.set_nonblocking(true).unwrap();
                socket
            })
            .collect();
        let mut network = Self {
            links,
            doors,
            peers,
            ports,
            signing,
            key,
            stamp: 1_000_000_000,
            model: Model::default(),
            received: Vec::with_capacity(64),
            said: Vec::new(),
        };
        // The links behind the first open at the first reception.
        network.poll();
        for (index, from) in FIRST.into_iter().enumerate() {
            let hello = messages::frame(ATTITUDE_QUATERNION_DATA::ID, from, &[index as u8 + 1; 28]);
            let hello = network.signed(&hello);
            network.say(index, &hello);
            network.poll();
            network.account(index, &hello);
            for peer in 0..LINKS {
                drop(network.receive(peer));
            }
        }
        network
    }

    fn go_on(&mut self, dice: &mut Dice<'_>) {
        let from = usize::from(dice.below(LINKS as u8));
        if dice.once_in(8) {
            return self.we_say(dice);
        }
        let mut datagram = Vec::new();
        for _ in 0..=dice.below(3) {
            let piece = self.piece(dice);
            datagram.extend(piece);
        }
        if datagram.is_empty() {
            return;
        }
        self.say(from, &datagram);
        self.poll();
        let (received, ours) = self.account(from, &datagram);
        for (peer, expected) in received.into_iter().enumerate() {
            assert_eq!(self.receive(peer), expected, "link {peer}, from link {from}");
        }
        let received: Vec<_> = self
            .received
            .iter()
            .map(|one| {
                (
                    one.header.system_id,
                    one.header.component_id,
                    usize::from(one.link),
                )
            })
            .collect();
        assert_eq!(received, ours, "for us, from link {from}");
    }

    /// Something in a datagram.
    fn piece(&mut self, dice: &mut Dice<'_>) -> Vec<u8> {
        let sender = (dice.pick(&SYSTEMS), dice.pick(&COMPONENTS));
        let target = (dice.pick(&SYSTEMS), dice.pick(&COMPONENTS));
        let len = usize::from(dice.below(64));
        let frame = match dice.below(8) {
            0 | 1 => {
                let mut payload = [0; 33];
                payload[30..32].copy_from_slice(&[target.0, target.1]);
                messages::frame(COMMAND_LONG_DATA::ID, sender, &payload)
            }
            2 => {
                let mut payload = [9; 42];
                payload[8..10].copy_from_slice(&[target.0, target.1]);
                messages::frame(SETUP_SIGNING_DATA::ID, sender, &payload)
            }
            3 => messages::frame(60_000, sender, dice.take(len)),
            4 => messages::frame(RADIO_STATUS_DATA::ID, sender, dice.take(len)),
            5 if !self.said.is_empty() => {
                let which = usize::from(dice.byte()) % self.said.len();
                return self.said[which].clone();
            }
            6 => return dice.take(len).to_vec(),
            // The clock of a system is a rule of its own, with tests of its own.
            _ => match dice.known_id() {
                SYSTEM_TIME_DATA::ID => Vec::new(),
                id => messages::frame(id, sender, dice.take(len)),
            },
        };
        match dice.below(4) {
            0 => frame,
            1 => {
                let mut damaged = self.signed(&frame);
                if let Some(last) = damaged.last_mut() {
                    *last ^= 1;
                }
                damaged
            }
            2 => {
                // An old stamp.
                let now = std::mem::replace(&mut self.stamp, u64::from(dice.u32()));
                let old = self.signed(&frame);
                self.stamp = now;
                old
            }
            _ => {
                let signed = self.signed(&frame);
                self.said.push(signed.clone());
                signed
            }
        }
    }

    fn signed(&mut self, frame: &[u8]) -> Vec<u8> {
        self.stamp += 1;
        let mut into = [0; SIGNED_FRAME_MAX];
        sign(frame, &self.key, 9, self.stamp, &mut into)
            .unwrap_or(frame)
            .to_vec()
    }

    fn we_say(&mut self, dice: &mut Dice<'_>) {
        let target = Target {
            system_id: u32::from(dice.pick(&SYSTEMS)),
            component_id: dice.pick(&COMPONENTS),
        };
        let link = dice.below(8);
        let to = if link < LINKS as u8 {
            Destination::Link(link)
        } else {
            Destination::Everyone
        };
        let message = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            target_system: target.system_id as u8,
            target_component: target.component_id,
            ..COMMAND_LONG_DATA::default()
        });
        let outgoing = Outgoing {
            system_id: 1,
            component_id: dice.pick(&[196, 191]),
            body: Body::Message(message),
            to,
            receipt: Receipt::Plain,
        };
        let sent = self.links.send(clock(), &outgoing);
        let reached = self.model.reaches(target);
        for peer in 0..LINKS {
            let meant = match to {
                Destination::Link(link) => usize::from(link) == peer,
                Destination::Everyone => reached.contains(&peer),
            };
            // Nobody keeps stamps here, so nothing of ours may leave where signatures are asked for.
            let expected = meant && self.signing[peer] == Signing::Off;
            assert_eq!(sent.contains(peer as u8), expected, "link {peer}");
            let received = self.receive(peer);
            assert_eq!(received.len(), usize::from(expected), "link {peer}");
            self.said.extend(received);
        }
    }

    /// What the model expects of `datagram`: what each peer receives, and whose messages we receive.
    #[allow(clippy::type_complexity)]
    fn account(&mut self, from: usize, datagram: &[u8]) -> ([Vec<Vec<u8>>; LINKS], Vec<(u32, u8, usize)>) {
        let mut received = [(); LINKS].map(|()| Vec::new());
        let mut ours = Vec::new();
        for frame in frames(datagram) {
            let admitted = self.model.admits(self.signing[from], &frame);
            if !admitted || US.sent(frame.sender) {
                continue;
            }
            if frame.is_verified {
                self.model.learn(from, frame.sender);
            }
            for peer in self.model.reaches(frame.target) {
                if peer != from && frame.message_id != SETUP_SIGNING_DATA::ID {
                    received[peer].push(frame.bytes.clone());
                }
            }
            if frame.content.is_some() && US.accepts(frame.target) {
                ours.push((frame.sender.system_id, frame.sender.component_id, from));
            }
        }
        (received, ours)
    }

    fn say(&self, peer: usize, bytes: &[u8]) {
        self.peers[peer]
            .send_to(bytes, ("127.0.0.1", self.ports[peer]))
            .unwrap();
    }

    fn receive(&self, peer: usize) -> Vec<Vec<u8>> {
        let mut received = Vec::new();
        let mut datagram = [0; 2000];
        while let Ok(len) = self.peers[peer].recv(&mut datagram) {
            received.push(datagram[..len].to_vec());
        }
        received
    }

    fn poll(&mut self) {
        self.received.clear();
        while self.links.receive(clock, US, &mut self.received) == Progress::More {}
    }
}

impl Model {
    fn admits(&mut self, signing: Signing, frame: &Seen) -> bool {
        if signing == Signing::Off || frame.message_id == RADIO_STATUS_DATA::ID && frame.is_verified {
            return true;
        }
        let Some(signature) = frame.signature else {
            return signing == Signing::Accept;
        };
        let Some((stream, stamp)) = genuine(frame, &signature) else {
            return false;
        };
        let fits = match self.stamps.get(&stream) {
            Some(last) => stamp > *last,
            None => stamp >= self.newest.saturating_sub(BEHIND),
        };
        if fits {
            self.stamps.insert(stream, stamp);
            // Nobody signs here: our own clock stands at zero, and who is ahead of it by more than a minute makes nobody old.
            if stamp <= BEHIND {
                self.newest = self.newest.max(stamp);
            }
        }
        fits
    }

    fn learn(&mut self, from: usize, sender: Sender) {
        // Nobody on a ground station's link is our autopilot.
        let is_where_it_says = from == 0 || !US.is_autopilot(sender);
        if sender.system_id != 0 && sender.component_id != 0 && is_where_it_says {
            let key = (sender.system_id, sender.component_id);
            self.routes.entry(key).or_default().insert(from);
        }
    }

    fn reaches(&self, target: Target) -> BTreeSet<usize> {
        if target.system_id == 0 {
            return (0..LINKS).collect();
        }
        let meant = |(system, component): &(u32, u8)| {
            *system == target.system_id && (target.component_id == 0 || *component == target.component_id)
        };
        let routes = self.routes.iter().filter(|(sender, _)| meant(sender));
        routes.flat_map(|(_, links)| links.iter().copied()).collect()
    }
}

/// Whose stream it is and its stamp, if the signature is right: signing it anew gives the same bytes.
fn genuine(frame: &Seen, signature: &[u8; 13]) -> Option<((u32, u8, u8), u64)> {
    let mut stamp = [0; 8];
    stamp[..6].copy_from_slice(&signature[1..7]);
    let stamp = u64::from_le_bytes(stamp);
    let mut plain = frame.bytes[..frame.bytes.len() - 13].to_vec();
    plain[2] = 0;
    let mut into = [0; SIGNED_FRAME_MAX];
    let key = Key::of_bytes(&[7; 32])?;
    let again = sign(&plain, &key, signature[0], stamp, &mut into)?;
    let stream = (frame.sender.system_id, frame.sender.component_id, signature[0]);
    (again[again.len() - 6..] == signature[7..]).then_some((stream, stamp))
}

fn frames(datagram: &[u8]) -> Vec<Seen> {
    let mut splitter = Splitter::new();
    splitter.with_unknown();
    splitter.load_datagram(datagram);
    let mut frames = Vec::new();
    while let Some(frame) = splitter.next_frame() {
        frames.push(Seen {
            bytes: frame.bytes.to_vec(),
            message_id: frame.message_id,
            sender: Sender {
                system_id: frame.header.system_id,
                component_id: frame.header.component_id,
            },
            is_verified: frame.is_verified,
            target: frame.target(),
            content: if frame.is_verified {
                Content::of(&frame)
            } else {
                None
            },
            signature: frame.signature().copied(),
        });
    }
    frames
}
