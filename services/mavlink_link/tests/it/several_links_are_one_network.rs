//! Several links at once, over real sockets and pseudo-terminals: whatever is for somebody else is passed on unchanged,
//! what is for us is received, what is ours reaches whom it is for, and a link that is lost or strange costs the others
//! nothing.

use crate::common::{WATCHDOG, attitude, bytes, free_udp_port, own_path};
use jink_mavlink_link::link::{Link, Progress};
use jink_mavlink_link::links::{LinkSetup, Links};
use jink_mavlink_link::message::{Body, Content, Destination, Outgoing, Receipt, Received};
use jink_mavlink_link::router::OwnIds;
use jink_mavlink_link::signing::{Key, SIGNED_FRAME_MAX, sign};
use jink_mavlink_link::tlog::Tlog;
use jink_runtime::config::{Purpose, Signing};
use jink_shared_types::Timestamp;
use jink_shared_types::events;
use jink_testkit::pseudo_terminal::plug_in;
use mavlink::dialect::*;
use mavlink::{MAVLinkV1MessageRaw, MavHeader, Message, calculate_crc};
use proptest::prelude::*;
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

const US: OwnIds = OwnIds {
    system_id: Some(1),
    components: [196, 191],
};

fn command(target_system: u8, target_component: u8) -> MavMessage {
    MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        target_system,
        target_component,
        ..COMMAND_LONG_DATA::default()
    })
}

fn setup(name: &str, endpoint: &str, purpose: Purpose) -> LinkSetup {
    LinkSetup {
        name: name.to_owned(),
        endpoint: endpoint.parse().unwrap(),
        purpose,
        signing: Signing::Off,
        key: None,
        link_id: 0,
        peers: Vec::new(),
        rate_bps: None,
    }
}

/// The other end of a link over UDP.
struct Peer {
    socket: UdpSocket,
    port: u16,
}

impl Peer {
    fn new(port: u16) -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.set_nonblocking(true).unwrap();
        Self { socket, port }
    }

    fn send(&self, bytes: &[u8]) {
        self.socket.send_to(bytes, ("127.0.0.1", self.port)).unwrap();
    }

    fn receive(&self) -> Vec<Vec<u8>> {
        let mut received = Vec::new();
        let mut datagram = [0; 2000];
        while let Ok(len) = self.socket.recv(&mut datagram) {
            received.push(datagram[..len].to_vec());
        }
        received
    }
}

/// Links over UDP with somebody at the other end of each.
struct NetworkBench {
    links: Links,
    handover_sockets: Vec<PathBuf>,
    peers: Vec<Peer>,
    received: Vec<Received>,
    /// Where the clock stands; `None`: it runs.
    clock: Option<Timestamp>,
}

impl NetworkBench {
    fn new(change: impl FnOnce(&mut Vec<LinkSetup>)) -> Self {
        let ports: Vec<_> = (0..3).map(|_| free_udp_port()).collect();
        let names = [
            ("autopilot", Purpose::Autopilot),
            ("ground", Purpose::GroundStation),
            ("camera", Purpose::GroundStation),
        ];
        let mut setups: Vec<_> = names
            .iter()
            .zip(&ports)
            .map(|((name, purpose), port)| setup(name, &format!("udpin:{port}"), *purpose))
            .collect();
        change(&mut setups);
        let handover_sockets: Vec<_> = setups.iter().map(|_| own_path("handover_socket")).collect();
        Self {
            links: Links::open(setups, &handover_sockets, |first| {
                Link::open(first.endpoint.clone())
            })
            .unwrap(),
            handover_sockets,
            peers: ports.into_iter().map(Peer::new).collect(),
            received: Vec::with_capacity(64),
            clock: None,
        }
    }

    /// Everybody has sent one frame: the autopilot 1/1, a station 255/190, a camera 1/100.
    fn introduced(change: impl FnOnce(&mut Vec<LinkSetup>)) -> Self {
        let mut bench = Self::new(change);
        // The extra links open at the first reception.
        bench.poll();
        for (peer, (system, component)) in [(1, 1), (255, 190), (1, 100)].into_iter().enumerate() {
            bench.peers[peer].send(&bytes(system, component, attitude(0)));
            bench.until("an introduction", |bench| bench.received.len() == 1);
        }
        bench.until("the last introduction is passed on", |bench| {
            !bench.peers[0].receive().is_empty()
        });
        bench.peers.iter().for_each(|peer| drop(peer.receive()));
        bench
    }

    fn poll(&mut self) {
        self.received.clear();
        let clock = self.clock;
        let now = || clock.unwrap_or_else(jink_runtime::now);
        while self.links.receive(now, US, &mut self.received) == Progress::More {}
    }

    fn until(&mut self, what: &str, mut done: impl FnMut(&mut Self) -> bool) {
        let started = Instant::now();
        loop {
            self.poll();
            if done(self) {
                return;
            }
            assert!(started.elapsed() < WATCHDOG, "{what} never happened");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// `frame` comes from peer `from`, and after it something for all: answers who received it, and whether we did.
    fn passes(&mut self, from: usize, frame: &[u8]) -> (Vec<usize>, bool) {
        let sender = [(1, 1), (255, 190), (1, 100)][from];
        let end = bytes(sender.0, sender.1, attitude(99));
        self.peers[from].send(frame);
        self.peers[from].send(&end);
        let (mut received, mut ours) = (vec![Vec::new(); 3], 0);
        self.until("the message behind it", |bench| {
            ours += bench.received.len();
            for (all, peer) in received.iter_mut().zip(&bench.peers) {
                all.extend(peer.receive());
            }
            (0..3)
                .filter(|peer| *peer != from)
                .all(|peer| received[peer].contains(&end))
        });
        assert!(received[from].is_empty(), "sent back: {received:?}");
        let who = (0..3).filter(|peer| received[*peer].iter().any(|one| one == frame));
        (who.collect(), ours == 2)
    }

    fn outgoing(to: Destination, message: MavMessage) -> Outgoing {
        Outgoing {
            system_id: 1,
            component_id: 196,
            body: Body::Message(message),
            to,
            receipt: Receipt::Plain,
        }
    }

    fn send(&mut self, to: Destination, message: MavMessage) -> Vec<usize> {
        let sent = self.links.send(jink_runtime::now(), &Self::outgoing(to, message));
        (0..3).filter(|link| sent.contains(*link as u8)).collect()
    }
}

/// A message type that the dialect does not know, with a checksum nobody here can verify.
fn foreign(payload: &[u8]) -> Vec<u8> {
    let id = 60_000u32;
    assert!(MavMessage::default_message_from_id(id).is_none());
    let mut frame = vec![0xfd, payload.len() as u8, 0, 0, 7, 255, 190];
    frame.extend_from_slice(&id.to_le_bytes()[..3]);
    frame.extend_from_slice(payload);
    let crc = calculate_crc(&frame[1..], 77);
    frame.extend_from_slice(&crc.to_le_bytes());
    frame
}

#[test]
fn what_is_for_others_is_passed_on_unchanged_and_what_is_for_us_is_received() {
    let mut bench = NetworkBench::introduced(|_| {});
    let mut v1 = MAVLinkV1MessageRaw::new();
    let station = MavHeader {
        system_id: 255,
        component_id: 190,
        sequence: 5,
    };
    v1.serialize_message(station, &command(1, 1));
    let v1 = v1.raw_bytes().to_vec();
    assert_eq!(v1[0], 0xfe);
    let key = Key::of_bytes(&[3; 32]).unwrap();
    let mut signed = [0; SIGNED_FRAME_MAX];
    let signed = sign(&bytes(255, 190, command(1, 1)), &key, 9, 1234, &mut signed)
        .unwrap()
        .to_vec();
    let secret = MavMessage::SETUP_SIGNING(SETUP_SIGNING_DATA {
        target_system: 1,
        target_component: 1,
        ..SETUP_SIGNING_DATA::default()
    });
    let station = |message| bytes(255, 190, message);
    for (what, from, frame, to, ours) in [
        ("for all", 0, bytes(1, 1, attitude(5)), vec![1, 2], true),
        ("for all", 1, station(attitude(6)), vec![0, 2], true),
        ("the autopilot's", 1, station(command(1, 1)), vec![0], false),
        ("the camera's", 1, station(command(1, 100)), vec![2], false),
        ("our system's", 1, station(command(1, 0)), vec![0, 2], true),
        ("the station's", 0, bytes(1, 1, command(255, 190)), vec![1], false),
        ("ours", 1, station(command(1, 196)), vec![], true),
        ("nobody's", 1, station(command(88, 1)), vec![], false),
        ("an old frame", 1, v1, vec![0], false),
        ("a signed frame", 1, signed, vec![0], false),
        ("a key", 1, station(secret), vec![], false),
        ("a foreign frame", 1, foreign(&[1, 2, 0xfd, 4]), vec![0, 2], false),
        ("our own, come back", 1, bytes(1, 196, attitude(7)), vec![], false),
    ] {
        let (received, received_here) = bench.passes(from, &frame);
        assert_eq!((received, received_here), (to, ours), "{what}");
    }
    let report = bench.links.report();
    assert_eq!(report.garbage_bytes(), 0);
    assert!(report.links[0].forwarded >= 8, "{report:?}");
}

#[test]
fn what_is_ours_reaches_whom_it_is_for() {
    let mut bench = NetworkBench::introduced(|_| {});
    assert_eq!(bench.send(Destination::Everyone, attitude(1)), [0, 1, 2]);
    assert_eq!(bench.send(Destination::Link(0), attitude(2)), [0]);
    assert_eq!(bench.send(Destination::Everyone, command(255, 190)), [1]);
    assert_eq!(bench.send(Destination::Everyone, command(1, 100)), [2]);
    assert!(bench.send(Destination::Everyone, command(88, 1)).is_empty());
    // Each link counts for itself: nobody sees a gap in the numbers.
    let numbers = bench.peers.iter().map(|peer| {
        let received = peer.receive();
        received.iter().map(|frame| frame[4]).collect::<Vec<_>>()
    });
    assert_eq!(numbers.collect::<Vec<_>>(), [vec![0, 1], vec![0, 1], vec![0, 1]]);
}

#[test]
fn no_message_of_a_stranger_moves_the_address() {
    let mut bench = NetworkBench::introduced(|_| {});
    let [autopilot, stranger] = [0, 0].map(|link: usize| Peer::new(bench.peers[link].port));
    let autopilot = std::mem::replace(&mut bench.peers[0], autopilot);
    bench.clock = Some(jink_runtime::now());
    let mut told = 0;
    let mut count = 0;
    for id in MavMessage::all_ids() {
        let message = MavMessage::default_message_from_id(*id).unwrap();
        // Another vehicle, another component of ours, a station, and one who says that it is our autopilot.
        for (system, component) in [(42, 1), (1, 100), (255, 190), (1, 1)] {
            stranger.send(&bytes(system, component, message.clone()));
            count += 1;
            let mut impostors = 0;
            autopilot.send(&bytes(1, 1, attitude(count)));
            bench.until("the autopilot's message behind it", |bench| {
                let of_autopilot =
                    |one: &&Received| (one.header.system_id, one.header.component_id) == (1, 1);
                let ours: Vec<_> = bench.received.iter().filter(of_autopilot).collect();
                impostors += ours.len();
                !ours.is_empty()
            });
            assert_eq!(impostors, 1, "{} is believed", message.message_name());
            told += bench
                .links
                .take_events()
                .filter(|event| event.id == events::SECOND_SENDER.id)
                .count();
            assert_eq!(bench.send(Destination::Link(0), command(1, 1)), [0]);
            assert!(stranger.receive().is_empty(), "{}", message.message_name());
            bench.peers[1].receive();
            bench.peers[2].receive();
        }
    }
    assert_eq!(told, 1, "the pilot is told once");
    let report = bench.links.report();
    assert_eq!(report.links[0].unknown_peers, MavMessage::all_ids().len() as u64);
    assert!(!autopilot.receive().is_empty());

    // The autopilot has fallen silent: who speaks as it is it, on another port.
    bench.clock = bench.clock.map(|clock| clock.plus_seconds(2.0));
    stranger.send(&bytes(1, 1, attitude(0)));
    bench.until("the new address", |bench| !bench.received.is_empty());
    bench.send(Destination::Link(0), command(1, 1));
    assert!(!stranger.receive().is_empty());
}

#[test]
fn who_says_on_a_stations_link_that_it_is_our_autopilot_gets_none_of_its_messages() {
    let mut bench = NetworkBench::introduced(|_| {});
    for boot_ms in [9_000, 10, 20, 30] {
        let time = MavMessage::SYSTEM_TIME(SYSTEM_TIME_DATA {
            time_boot_ms: boot_ms,
            ..SYSTEM_TIME_DATA::default()
        });
        let from = usize::from(boot_ms < 9_000);
        bench.passes(from, &bytes(1, 1, time));
    }
    assert_eq!(bench.passes(2, &bytes(254, 190, command(1, 1))), (vec![0], false));
}

#[test]
fn a_telemetry_log_that_cannot_be_begun_is_reported() {
    let mut bench = NetworkBench::introduced(|_| {});
    bench
        .links
        .record(Tlog::begin(Path::new("/dev/null/no/folder"), 1, 0));
    let reported: Vec<u16> = bench.links.take_events().map(|event| event.id).collect();
    assert_eq!(reported, [events::TELEMETRY_LOG_LOST.id]);
}

/// An autopilot on USB appears seconds after the board, and vanishes whenever it starts anew.
#[test]
fn the_autopilots_device_is_waited_for_and_reported_once_and_another_mistake_is_an_error() {
    let (device, socket) = (own_path("autopilot"), own_path("autopilot_handover"));
    let opened = |address: &str| {
        let setups = vec![setup("autopilot", address, Purpose::Autopilot)];
        Links::open(setups, std::slice::from_ref(&socket), |first| {
            Link::open(first.endpoint.clone())
        })
    };
    assert!(opened("serial:/dev/null:57600").is_err(), "no serial port");
    let mut links = opened(&format!("serial:{}:57600", device.display())).unwrap();
    let mut reported = Vec::new();
    let mut received = Vec::with_capacity(8);
    let mut until = |count: usize| {
        let begin = Instant::now();
        while reported.len() < count {
            assert!(begin.elapsed() < WATCHDOG, "{reported:?}");
            let _ = links.receive(jink_runtime::now, US, &mut received);
            reported.extend(links.take_events().map(|event| event.id));
            std::thread::sleep(Duration::from_millis(2));
        }
        (reported.clone(), links.report().links[0].is_waited_for.is_set())
    };
    let waited = [
        events::LINK_WAITED.id,
        events::LINK_OPEN.id,
        events::LINK_WAITED.id,
    ];
    assert_eq!(until(1), (waited[..1].to_vec(), true));
    let control = plug_in(&device);
    assert_eq!(until(2), (waited[..2].to_vec(), false));
    drop(control);
    assert_eq!(until(3), (waited.to_vec(), true));
}

#[test]
fn the_telemetry_log_holds_what_is_received_and_sent_on_every_link_once_and_no_key() {
    let mut bench = NetworkBench::introduced(|_| {});
    let folder = own_path("tlog");
    let log = Tlog::begin(&folder, 1, 0).unwrap();
    let path = log.path().to_owned();
    bench.links.record(Ok(log));
    let (autopilots, stations) = (bytes(1, 1, attitude(5)), bytes(255, 190, command(1, 1)));
    let _ = (bench.passes(0, &autopilots), bench.passes(1, &stations));
    let secret_key = *b"a key that somebody has set here";
    let setup = MavMessage::SETUP_SIGNING(SETUP_SIGNING_DATA {
        target_system: 1,
        target_component: 1,
        secret_key,
        ..SETUP_SIGNING_DATA::default()
    });
    let _ = bench.passes(1, &bytes(255, 190, setup));
    bench.send(Destination::Link(0), attitude(6));
    bench.send(Destination::Link(2), attitude(7));
    drop(bench);
    let written = std::fs::read(&path).unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    for frame in [
        autopilots,
        stations,
        bytes(1, 196, attitude(6)),
        bytes(1, 196, attitude(7)),
    ] {
        let count = written
            .windows(frame.len())
            .filter(|window| *window == frame)
            .count();
        assert_eq!(count, 1, "{frame:?}");
    }
    assert!(
        !written
            .windows(secret_key.len())
            .any(|window| window == secret_key)
    );
}

#[test]
fn a_lost_link_costs_the_others_nothing_and_comes_back_by_itself() {
    let device = own_path("tty");
    let mut bench = NetworkBench::new(|setups| {
        let endpoint = format!("serial:{}:57600", device.display());
        setups[2].endpoint = endpoint.parse().unwrap();
    });
    // It is not plugged in, and everything else works.
    bench.peers[0].send(&bytes(1, 1, attitude(1)));
    bench.until("the autopilot's message", |bench| bench.received.len() == 1);
    bench.peers[1].send(&bytes(255, 190, command(1, 1)));
    bench.until("the station's message at the autopilot", |bench| {
        !bench.peers[0].receive().is_empty()
    });
    assert_eq!(bench.send(Destination::Everyone, attitude(1)), [0, 1]);
    assert!(bench.links.next_wake().is_some());

    let control = plug_in(&device);
    bench.until("the port is found", |bench| {
        bench.send(Destination::Everyone, attitude(2)) == [0, 1, 2]
    });
    rustix::io::write(&control, &bytes(1, 100, attitude(3))).unwrap();
    bench.until("the camera's message", |bench| {
        bench.received.iter().any(|received| received.link == 2)
    });
    drop(control);
    bench.until("the loss", |bench| {
        bench.send(Destination::Everyone, attitude(3)) == [0, 1]
    });
    let control = plug_in(&device);
    bench.until("the port again", |bench| {
        bench.links.report().links[2].reopened == 1
    });
    drop(control);
    std::fs::remove_file(&device).unwrap();
}

#[test]
fn only_peers_are_received_where_peers_are_named() {
    let mut bench = NetworkBench::new(|setups| setups[1].peers = vec!["127.0.0.2".parse().unwrap()]);
    bench.poll();
    let port = bench.peers[1].port;
    let friend = UdpSocket::bind("127.0.0.2:0").unwrap();
    bench.peers[1].send(&bytes(255, 190, attitude(1)));
    friend
        .send_to(&bytes(255, 190, attitude(2)), ("127.0.0.1", port))
        .unwrap();
    let mut received = Vec::new();
    bench.until("the peer's message", |bench| {
        received.extend(
            bench
                .received
                .iter()
                .filter_map(|received| match &received.content {
                    Content::Message(MavMessage::ATTITUDE_QUATERNION(data)) => Some(data.time_boot_ms),
                    _ => None,
                }),
        );
        received == [2]
    });
    assert_eq!(bench.links.report().links[1].unknown_peers, 1);
    // Nothing is sent to who is no peer.
    bench.send(Destination::Link(1), attitude(3));
    assert!(bench.peers[1].receive().is_empty());
}

#[test]
fn where_signatures_are_required_only_frames_with_the_key_are_accepted() {
    let (right, wrong) = ([5; 32], [6; 32]);
    let key = |bytes: &[u8; 32]| Key::of_bytes(bytes).unwrap();
    let stamps = own_path("stamps");
    let mut bench = NetworkBench::new(|setups| {
        setups[1].signing = Signing::Require;
        setups[1].key = Some(key(&right));
        setups[1].link_id = 4;
    });
    bench.links.sign_with_stamps_at(&stamps).unwrap();
    bench.poll();
    let now = jink_mavlink_link::signing::stamps::wall();
    let mut into = [0; SIGNED_FRAME_MAX];
    let frame = bytes(255, 190, attitude(1));
    bench.peers[1].send(&frame);
    bench.peers[1].send(sign(&frame, &key(&wrong), 0, now, &mut into).unwrap());
    let good = sign(&frame, &key(&right), 0, now, &mut into).unwrap().to_vec();
    bench.peers[1].send(&good);
    bench.peers[1].send(&good);
    let mut received = 0;
    bench.until("all four", |bench| {
        received += bench.received.len();
        bench.links.report().links[1].replayed == 1
    });
    let traffic = bench.links.report().links[1];
    assert_eq!(
        (received, traffic.unsigned_refused, traffic.signature_refused),
        (1, 1, 1),
        "{traffic:?}"
    );
    // We sign there, and nowhere else; the stamps grow.
    bench.peers[0].send(&bytes(1, 1, attitude(1)));
    bench.until("the autopilot", |bench| !bench.received.is_empty());
    for n in 0..3 {
        assert_eq!(bench.send(Destination::Everyone, attitude(n)), [0, 1]);
    }
    let is_signed = |frame: &Vec<u8>| frame[2] == 1;
    assert!(bench.peers[0].receive().iter().all(|frame| !is_signed(frame)));
    let signed = bench.peers[1].receive();
    let ours: Vec<_> = signed.iter().filter(|frame| frame[6] == 196).collect();
    assert!(ours.len() == 3 && ours.iter().all(|frame| is_signed(frame)));
    let stamp = |frame: &[u8]| {
        let tail = &frame[frame.len() - 13..];
        assert_eq!(tail[0], 4, "the link's number");
        tail[1..7]
            .iter()
            .rev()
            .fold(0u64, |sum, byte| sum << 8 | u64::from(*byte))
    };
    assert!(ours.windows(2).all(|pair| stamp(pair[0]) < stamp(pair[1])));
    std::fs::remove_file(&stamps).unwrap();
}

#[test]
fn a_slow_link_is_given_what_it_carries_and_reports_it() {
    let mut bench = NetworkBench::new(|setups| setups[0].rate_bps = Some(1000.0));
    bench.peers[0].send(&bytes(1, 1, attitude(1)));
    bench.until("the autopilot", |bench| !bench.received.is_empty());
    let curve = || {
        #[allow(deprecated)]
        let message = MavMessage::TRAJECTORY_REPRESENTATION_BEZIER(TRAJECTORY_REPRESENTATION_BEZIER_DATA {
            valid_points: 5,
            ..TRAJECTORY_REPRESENTATION_BEZIER_DATA::default()
        });
        NetworkBench::outgoing(Destination::Link(0), message)
    };
    let mut events = Vec::new();
    let start = jink_runtime::now();
    // Ten seconds of a clock that runs as fast as the test, the parts of it that the links see.
    for tick in 0..200 {
        let now = start.plus_seconds(f64::from(tick) * 0.05);
        bench.links.send(now, &curve());
        bench.received.clear();
        let _ = bench.links.receive(|| now, US, &mut bench.received);
        events.extend(bench.links.take_events().map(|event| event.text()));
    }
    // 2420 B/s, one curve more or less in the two seconds that were judged.
    let [event] = &events[..] else {
        panic!("{events:?}")
    };
    assert!(
        event.starts_with("jink: link autopilot slow, 1000 of 24"),
        "{event}"
    );
    let traffic = bench.links.report().links[0];
    let (sent, dropped) = (traffic.sent_bytes[1], traffic.dropped[1]);
    assert!((10_000..=10_000 + 1500).contains(&sent), "{sent} bytes");
    assert_eq!(sent / 121 + dropped, 200);
}

#[test]
fn all_links_pass_on_together_and_their_numbers_go_on() {
    let mut bench = NetworkBench::introduced(|_| {});
    let setups = ["autopilot", "ground", "camera"].map(|name| {
        // A standby has no use for addresses: it is given the open links.
        setup(name, "udpin:1", Purpose::GroundStation)
    });
    let mut standby = Links::join(setups.to_vec(), &bench.handover_sockets).unwrap();
    let mut received = Vec::with_capacity(64);
    bench.send(Destination::Everyone, attitude(1));
    assert!(!standby.is_owner());
    bench.peers[0].send(&bytes(1, 1, attitude(2)));
    bench.until("both receive", |_| {
        let _ = standby.receive(jink_runtime::now, US, &mut received);
        received.len() == 1
    });
    bench.until("the camera gets it", |bench| bench.peers[2].receive().len() >= 2);
    bench.peers.iter().for_each(|peer| drop(peer.receive()));
    assert!(bench.links.release(b"a state") && !bench.links.is_owner());
    let started = Instant::now();
    while !standby.is_owner() {
        assert!(started.elapsed() < WATCHDOG);
        let _ = standby.receive(jink_runtime::now, US, &mut received);
    }
    assert_eq!(standby.take_handover_state().unwrap(), b"a state");
    let _ = standby.receive(jink_runtime::now, US, &mut received);
    let message = NetworkBench::outgoing(Destination::Everyone, attitude(3));
    let sent = standby.send(jink_runtime::now(), &message);
    assert!((0..3).all(|link| sent.contains(link)));
    // On the first link the state's owner carries the numbers on; on the others they carry themselves on.
    for peer in &bench.peers[1..] {
        assert_eq!(peer.receive().last().unwrap()[4], 1);
    }
    // What is passed on is passed on by the new owner, once.
    bench.peers[0].send(&bytes(1, 1, attitude(4)));
    let mut count = 0;
    bench.until("it is passed on", |bench| {
        let _ = standby.receive(jink_runtime::now, US, &mut received);
        count += bench.peers[1].receive().len();
        count > 0
    });
    std::thread::sleep(Duration::from_millis(20));
    bench.poll();
    assert!(count == 1 && bench.peers[1].receive().is_empty());
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(64) })]

    #[test]
    fn foreign_frames_pass_a_stream_in_any_pieces_and_garbage_does_not(
        frames in proptest::collection::vec(prop_oneof![
            2 => (0..100u32).prop_map(|n| (true, bytes(255, 190, attitude(n)))),
            2 => proptest::collection::vec(0..0xfdu8, 0..60)
                .prop_map(|payload| (true, foreign(&payload)))
                .prop_filter("no start byte inside", |(_, frame)| frame[1..].iter().all(|byte| ![0xfd, 0xfe].contains(byte))),
            1 => proptest::collection::vec(any::<u8>().prop_filter("no start byte", |byte| *byte < 0xfd), 1..50)
                .prop_map(|garbage| (false, garbage)),
        ], 1..30),
        pieces in proptest::collection::vec(1..200usize, 1..10),
    ) {
        let mut splitter = jink_mavlink_link::frame::Splitter::new();
        splitter.with_unknown();
        let mut stream: Vec<u8> = frames.iter().flat_map(|(_, bytes)| bytes.clone()).collect();
        let close = bytes(255, 190, attitude(1000));
        stream.extend_from_slice(&close);
        let (mut rest, mut pieces, mut out) = (&stream[..], pieces.iter().cycle(), Vec::new());
        while !rest.is_empty() {
            let (piece, behind) = rest.split_at((*pieces.next().unwrap()).min(rest.len()));
            rest = behind;
            prop_assert_eq!(splitter.push(piece), piece.len());
            while let Some(frame) = splitter.next_frame() {
                out.push(frame.bytes.to_vec());
            }
        }
        // Every frame of ours comes out; a foreign one between two frames as well; nothing else.
        let mut wanted = Vec::new();
        let mut border = false;
        for (i, (is_frame, bytes)) in frames.iter().enumerate() {
            let is_foreign = *is_frame && bytes[7..10] == 60_000u32.to_le_bytes()[..3];
            let ends_well = frames[i + 1..]
                .iter()
                .take_while(|(is_frame, bytes)| *is_frame && bytes[7..10] == 60_000u32.to_le_bytes()[..3])
                .count();
            let proved = frames.get(i + 1 + ends_well).is_none_or(|(is_frame, _)| *is_frame) || ends_well >= 3;
            let passes = *is_frame && (!is_foreign || border && proved);
            if passes {
                wanted.push(bytes.clone());
            }
            border = passes;
        }
        wanted.push(close);
        prop_assert_eq!(out, wanted);
    }
}
