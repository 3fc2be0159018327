//! The server against clients that lose, double and mix up what is said.

use super::packet::{ACK, DATA, NAK, Nak, PAYLOAD, Packet, Payload, op};
use super::{FileServer, PACE_HZ, SESSION_S, SESSIONS, crc32};
use jink_shared_types::Timestamp;
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::SplitMix64;
use std::collections::BTreeMap;

const STATION: (u8, u8) = (255, 190);

fn at(s: f64) -> Timestamp {
    Timestamp::from_seconds(100.0 + s)
}

fn request(seq: u16, opcode: u8) -> Packet {
    Packet {
        seq,
        session: 0,
        opcode,
        size: 0,
        req_opcode: 0,
        burst_complete: false,
        offset: 0,
        data: [0; DATA],
    }
}

fn ask(server: &mut FileServer, s: f64, packet: Packet) -> Packet {
    let answer = server.take(at(s), STATION, &packet.to_payload());
    let answer = Packet::of(&answer.expect("no answer"));
    assert_eq!(answer.seq, packet.seq.wrapping_add(1));
    assert_eq!(answer.req_opcode, packet.opcode);
    answer
}

fn refusal(answer: &Packet) -> Option<u8> {
    (answer.opcode == NAK).then_some(answer.data[0])
}

#[test]
fn a_file_is_listed_opened_read_checked_and_closed() {
    let mut server = FileServer::default();
    let list = ask(&mut server, 0.0, request(1, op::LIST).with(b"/"));
    let text = std::str::from_utf8(list.given().unwrap()).unwrap();
    let (general, parameters) = (server.files[0].bytes.clone(), server.files[1].bytes.clone());
    assert_eq!(
        text,
        format!(
            "Fgeneral.json\t{}\0Fparameters.json\t{}\0",
            general.len(),
            parameters.len()
        )
    );
    let behind = Packet {
        offset: 2,
        ..request(2, op::LIST).with(b"/")
    };
    assert_eq!(
        refusal(&ask(&mut server, 0.0, behind)),
        Some(Nak::EndOfFile as u8)
    );

    let opened = ask(&mut server, 0.1, request(3, op::OPEN).with(b"/general.json"));
    assert_eq!(opened.given().unwrap(), (general.len() as u32).to_le_bytes());
    let read = |offset, size| Packet {
        session: opened.session,
        offset,
        size,
        ..request(4 + offset as u16, op::READ)
    };
    assert_eq!(ask(&mut server, 0.2, read(0, 9)).given().unwrap(), &general[..9]);
    let end = general.len() as u32;
    assert_eq!(
        ask(&mut server, 0.2, read(end - 3, 239)).given().unwrap(),
        &general[general.len() - 3..]
    );
    assert_eq!(
        refusal(&ask(&mut server, 0.2, read(end, 9))),
        Some(Nak::EndOfFile as u8)
    );
    let crc = ask(&mut server, 0.3, request(900, op::CRC).with(b"parameters.json"));
    assert_eq!(crc.given().unwrap(), crc32(&parameters).to_le_bytes());

    let close = |seq| Packet {
        session: opened.session,
        ..request(seq, op::TERMINATE)
    };
    assert_eq!(ask(&mut server, 0.4, close(901)).opcode, ACK);
    assert_eq!(
        ask(&mut server, 0.5, close(901)).opcode,
        ACK,
        "the answer was lost"
    );
    assert_eq!(
        refusal(&ask(&mut server, 0.6, close(902))),
        Some(Nak::InvalidSession as u8)
    );
}

/// MAVProxy asks for ArduPilot's file of parameters first, and for the list of them when that is refused.
#[test]
fn a_file_of_parameters_that_is_not_here_is_refused_at_once_whoever_else_reads() {
    let mut server = FileServer::default();
    for number in 0..SESSIONS as u8 {
        let open = request(0, op::OPEN).with(b"general.json").to_payload();
        let answer = server.take(at(0.0), (1, number), &open).unwrap();
        assert_eq!(Packet::of(&answer).opcode, ACK);
    }
    let end = Packet {
        session: 183,
        ..request(0, op::TERMINATE)
    };
    assert_eq!(
        refusal(&ask(&mut server, 0.0, end)),
        Some(Nak::InvalidSession as u8)
    );
    let open = request(1, op::OPEN).with(b"@PARAM/param.pck?withdefaults=1");
    assert_eq!(
        refusal(&ask(&mut server, 0.0, open)),
        Some(Nak::FileNotFound as u8)
    );
}

#[test]
fn nothing_can_be_written_and_nonsense_is_refused_with_its_reason() {
    let mut server = FileServer::default();
    for (seq, (packet, reason)) in [
        (request(0, op::OPEN).with(b"/etc/passwd"), Nak::FileNotFound),
        (request(0, op::OPEN).with(b"@PARAM/param.pck"), Nak::FileNotFound),
        (request(0, op::LIST).with(b"/etc"), Nak::FileNotFound),
        (
            Packet {
                size: 250,
                ..request(0, op::OPEN)
            },
            Nak::InvalidDataSize,
        ),
        (request(0, op::READ), Nak::InvalidSession),
        (request(0, op::BURST), Nak::InvalidSession),
        (request(0, 6).with(b"general.json"), Nak::FileProtected),
        (request(0, 8).with(b"general.json"), Nak::FileProtected),
        (request(0, 0), Nak::UnknownCommand),
        (request(0, 99), Nak::UnknownCommand),
    ]
    .into_iter()
    .enumerate()
    {
        let packet = Packet {
            seq: seq as u16,
            ..packet
        };
        assert_eq!(
            refusal(&ask(&mut server, 0.0, packet)),
            Some(reason as u8),
            "{seq}"
        );
    }
    assert!(
        server
            .take(at(0.0), STATION, &request(1, ACK).to_payload())
            .is_none()
    );
}

#[test]
fn whoever_names_no_session_means_the_one_it_has_opened_last() {
    let mut server = FileServer::default();
    let read = |seq| Packet {
        size: 10,
        ..request(seq, op::READ)
    };
    assert_eq!(
        refusal(&ask(&mut server, 0.0, read(1))),
        Some(Nak::InvalidSession as u8)
    );
    for (seq, file) in [(10, 0), (20, 1)] {
        let file = server.files[file].clone();
        let opened = ask(
            &mut server,
            f64::from(seq),
            request(seq, op::OPEN).with(file.name.as_bytes()),
        );
        assert_ne!(opened.session, 0, "nobody is given it");
        let piece = ask(&mut server, f64::from(seq), read(seq + 1));
        assert_eq!(piece.given(), Some(&file.bytes[..10]), "{}", file.name);
    }
    // The last one, then the one before, then none is left.
    let ends = [30, 31, 32].map(|seq| ask(&mut server, 21.0, request(seq, op::TERMINATE)).opcode);
    assert_eq!(ends, [ACK, ACK, NAK]);
}

#[test]
fn sessions_run_out_and_come_back_and_belong_to_whoever_opened_them() {
    let mut server = FileServer::default();
    let open = |seq| request(seq, op::OPEN).with(b"general.json");
    let ids: Vec<u8> = (0..SESSIONS as u16)
        .map(|seq| ask(&mut server, 0.0, open(seq)).session)
        .collect();
    assert_eq!(
        refusal(&ask(&mut server, 1.0, open(90))),
        Some(Nak::NoSessionsAvailable as u8)
    );
    let read = Packet {
        session: ids[0],
        ..request(91, op::READ)
    };
    let unknown_peer = server.take(at(1.0), (7, 7), &read.to_payload()).unwrap();
    assert_eq!(
        refusal(&Packet::of(&unknown_peer)),
        Some(Nak::InvalidSession as u8)
    );
    assert_eq!(ask(&mut server, SESSION_S, read).opcode, ACK);
    let late = SESSION_S + 0.1;
    let again = ask(&mut server, late, open(92));
    assert_eq!(again.opcode, ACK);
    assert!(!ids.contains(&again.session));
    assert_eq!(
        ask(&mut server, late, Packet { seq: 93, ..read }).opcode,
        ACK,
        "it was in use"
    );
    assert_eq!(ask(&mut server, late, request(94, op::RESET)).opcode, ACK);
    assert_eq!(
        refusal(&ask(&mut server, late, Packet { seq: 95, ..read })),
        Some(Nak::InvalidSession as u8)
    );
}

#[test]
fn bursts_of_several_clients_share_one_pace() {
    let mut server = FileServer::default();
    let peers = [(255, 190), (254, 190), (253, 190)];
    for peer in peers {
        let opened = server.take(
            at(0.0),
            peer,
            &request(1, op::OPEN).with(b"parameters.json").to_payload(),
        );
        let burst = Packet {
            session: Packet::of(&opened.unwrap()).session,
            ..request(2, op::BURST)
        };
        assert!(server.take(at(0.0), peer, &burst.to_payload()).is_none());
    }
    let mut pieces = BTreeMap::new();
    for ms in 0..3000u32 {
        let now = at(f64::from(ms) / 1e3);
        assert!(server.next_wake().is_some());
        if let Some((peer, _)) = server.next(now) {
            *pieces.entry(peer).or_insert(0) += 1;
        }
    }
    let all: u32 = pieces.values().sum();
    assert!(all <= 1 + (3.0 * PACE_HZ) as u32);
    assert!(pieces.values().all(|count| *count == 5), "{pieces:?}");
}

/// A line that loses a fifth, doubles some and delays others.
struct Line {
    random: SplitMix64,
    under_way: Vec<(f64, Payload)>,
}

impl Line {
    fn throw(&mut self) -> f64 {
        self.random.random()
    }

    fn send(&mut self, s: f64, payload: Payload) {
        let copies = match self.throw() {
            lost if lost < 0.2 => 0,
            doubled if doubled < 0.35 => 2,
            _ => 1,
        };
        for _ in 0..copies {
            let delay_s = if self.throw() < 0.3 {
                0.6 * self.throw()
            } else {
                0.01
            };
            self.under_way.push((s + delay_s, payload));
        }
    }

    fn arrived(&mut self, s: f64) -> Vec<Payload> {
        let (here, later) = self.under_way.drain(..).partition(|(when, _)| *when <= s);
        self.under_way = later;
        let mut here: Vec<(f64, Payload)> = here;
        here.sort_by(|a, b| a.0.total_cmp(&b.0));
        here.into_iter().map(|(_, payload)| payload).collect()
    }
}

/// What a ground station does: open, one burst after the other, single pieces for what was lost, close. It repeats what is
/// not answered within half a second.
struct Client {
    path: &'static [u8],
    seq: u16,
    session: Option<u8>,
    size: usize,
    pieces: BTreeMap<u32, Vec<u8>>,
    burst: bool,
    asked: Option<(f64, Packet)>,
}

impl Client {
    fn new(path: &'static [u8]) -> Self {
        Self {
            path,
            seq: 0,
            session: None,
            size: 0,
            pieces: BTreeMap::new(),
            burst: false,
            asked: None,
        }
    }

    fn missing(&self) -> Option<u32> {
        let mut end = 0;
        for (offset, piece) in &self.pieces {
            if *offset > end {
                break;
            }
            end = end.max(offset + piece.len() as u32);
        }
        ((end as usize) < self.size).then_some(end)
    }

    fn is_done(&self) -> bool {
        self.session.is_some() && self.missing().is_none()
    }

    fn content(&self) -> Vec<u8> {
        let mut content = vec![0; self.size];
        for (offset, piece) in &self.pieces {
            content[*offset as usize..][..piece.len()].copy_from_slice(piece);
        }
        content
    }

    fn receive(&mut self, payload: &Payload) {
        let answer = Packet::of(payload);
        let expected = self
            .asked
            .is_some_and(|(_, asked)| asked.seq.wrapping_add(1) == answer.seq);
        match (answer.opcode, answer.req_opcode) {
            (ACK, op::OPEN) if expected && self.session.is_none() => {
                self.session = Some(answer.session);
                self.size = u32::from_le_bytes(answer.data[..4].try_into().unwrap()) as usize;
                self.asked = None;
            }
            (ACK, op::READ | op::BURST) if self.session == Some(answer.session) => {
                self.pieces
                    .insert(answer.offset, answer.given().unwrap().to_vec());
                if answer.req_opcode == op::READ && expected || answer.burst_complete {
                    self.asked = None;
                }
            }
            // The session is over on the other side.
            (NAK, _) if expected && answer.data[0] == Nak::InvalidSession as u8 => {
                self.session = None;
                self.asked = None;
            }
            (NAK, _) if expected => self.asked = None,
            _ => {}
        }
    }

    fn speak(&mut self, s: f64) -> Option<Payload> {
        if let Some((since, packet)) = &mut self.asked {
            if s - *since < 0.5 {
                return None;
            }
            *since = s;
            // Of a burst that broke off only the rest is asked for.
            if packet.opcode == op::BURST {
                self.asked = None;
            } else {
                return Some(packet.to_payload());
            }
        }
        self.seq = self.seq.wrapping_add(1);
        let packet = match (self.session, self.missing()) {
            (None, _) => request(self.seq, op::OPEN).with(self.path),
            (Some(_), None) => return None,
            (Some(session), Some(offset)) => {
                self.burst = !self.burst;
                Packet {
                    session,
                    offset,
                    size: 80,
                    ..request(self.seq, if self.burst { op::BURST } else { op::READ })
                }
            }
        };
        self.asked = Some((s, packet));
        Some(packet.to_payload())
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn under_loss_doubling_and_delay_every_file_is_read_exactly(seed in any::<u64>()) {
        let mut server = FileServer::default();
        for file in 0..server.files.len() {
            let expected = server.files[file].bytes.clone();
            let line = |seed| Line { random: SplitMix64::seed_from_u64(seed), under_way: Vec::new() };
            let (mut there, mut back) = (line(seed), line(!seed));
            let mut client = Client::new([&b"/general.json"[..], b"parameters.json"][file]);
            let mut s = 100.0 * file as f64;
            while !client.is_done() {
                prop_assert!(s < 100.0 * file as f64 + 5000.0, "not read in more than an hour");
                s += 0.02;
                if let Some(payload) = client.speak(s) {
                    there.send(s, payload);
                }
                for payload in there.arrived(s) {
                    if let Some(answer) = server.take(at(s), STATION, &payload) {
                        back.send(s, answer);
                    }
                }
                if let Some((peer, piece)) = server.next(at(s)) {
                    prop_assert_eq!(peer, STATION);
                    back.send(s, piece);
                }
                for payload in back.arrived(s) {
                    client.receive(&payload);
                }
            }
            prop_assert_eq!(client.content(), expected);
        }
    }

    #[test]
    fn any_garbage_gets_at_most_one_answer_and_no_burst_without_a_session(
        requests in proptest::collection::vec((proptest::collection::vec(any::<u8>(), PAYLOAD), any::<u8>(), 0..4u8), 1..100),
    ) {
        let mut server = FileServer::default();
        for (i, (mut bytes, opcode, peer)) in requests.into_iter().enumerate() {
            bytes[3] = opcode % 20;
            let payload: Payload = bytes.try_into().unwrap();
            let now = at(i as f64 / 10.0);
            if let Some(answer) = server.take(now, (peer, 1), &payload) {
                let answer = Packet::of(&answer);
                prop_assert!(matches!(answer.opcode, ACK | NAK));
                prop_assert_eq!(answer.req_opcode, opcode % 20);
                prop_assert!(answer.given().is_some());
            }
            prop_assert!(server.next(now).is_none());
        }
    }
}
