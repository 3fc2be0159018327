//! Whatever bytes arrive, in whatever pieces: every intact frame comes out, nothing else does, and nothing panics.

use jink_mavlink_link::encoder::Encoder;
use jink_mavlink_link::frame::{SPLITTER_BYTES, Splitter};
use jink_mavlink_link::message::{Body, CommandAck, Content};
use mavlink::dialect::*;
use mavlink::{MAVLinkV1MessageRaw, MavHeader, Message, MessageData, calculate_crc};
use proptest::prelude::*;

fn attitude(n: u32) -> MavMessage {
    // Values whose bytes hold no start byte.
    MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
        time_boot_ms: n % 100,
        q1: 1.0,
        ..ATTITUDE_QUATERNION_DATA::default()
    })
}

fn encoded(encoder: &mut Encoder, message: MavMessage) -> Vec<u8> {
    encoder.encode(1, 1, &Body::Message(message)).to_vec()
}

/// Feeds `bytes` in pieces of the given sizes; returns what came out as (sequence, message id, payload).
fn split(splitter: &mut Splitter, bytes: &[u8], sizes: &[usize]) -> Vec<(u8, u32, Vec<u8>)> {
    let mut frames = Vec::new();
    let mut rest = bytes;
    let mut sizes = sizes.iter().cycle();
    while !rest.is_empty() {
        let size = (*sizes.next().unwrap()).clamp(1, rest.len());
        let taken = splitter.push(&rest[..size]);
        assert_eq!(taken, size);
        rest = &rest[size..];
        while let Some(frame) = splitter.next_frame() {
            frames.push((frame.header.sequence, frame.message_id, frame.payload.to_vec()));
        }
    }
    frames
}

fn garbage_without_start_bytes() -> impl Strategy<Value = Vec<u8>> {
    proptest::collection::vec(any::<u8>().prop_filter("no start byte", |b| *b < 0xfd), 0..200)
}

fn known_ids() -> Vec<u32> {
    (0..70_000)
        .filter(|id| MavMessage::default_message_from_id(*id).is_some())
        .collect()
}

#[test]
fn every_message_of_the_dialect_survives_the_round_trip() {
    let mut splitter = Splitter::new();
    let mut encoder = Encoder::new();
    let mut known = 0;
    for message in known_ids()
        .into_iter()
        .filter_map(MavMessage::default_message_from_id)
    {
        splitter.load_datagram(&encoded(&mut encoder, message.clone()));
        let frame = splitter.next_frame().unwrap();
        assert_eq!(frame.message_id, message.message_id());
        assert_eq!((frame.header.system_id, frame.header.component_id), (1, 1));
        assert_eq!(format!("{:?}", frame.decode().unwrap()), format!("{message:?}"));
        known += 1;
    }
    assert!(known > 60, "{known}");
    assert_eq!(splitter.garbage_bytes(), 0);
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn garbage_between_frames_costs_no_frame_and_is_counted(
        garbage in proptest::collection::vec(garbage_without_start_bytes(), 1..12),
        sizes in proptest::collection::vec(1usize..400, 1..10),
    ) {
        let mut encoder = Encoder::new();
        let mut bytes = Vec::new();
        for (i, garbage) in garbage.iter().enumerate() {
            bytes.extend_from_slice(garbage);
            bytes.extend(encoded(&mut encoder, attitude(i as u32)));
        }
        let mut splitter = Splitter::new();
        let frames = split(&mut splitter, &bytes, &sizes);
        let sequences: Vec<_> = frames.iter().map(|(sequence, ..)| usize::from(*sequence)).collect();
        prop_assert_eq!(sequences, (0..garbage.len()).collect::<Vec<_>>());
        prop_assert_eq!(splitter.garbage_bytes(), garbage.iter().map(Vec::len).sum::<usize>() as u64);
    }

    #[test]
    fn any_bytes_are_accounted_for_and_the_stream_recovers(
        bytes in proptest::collection::vec(prop_oneof![any::<u8>(), Just(0xfdu8), Just(0xfeu8)], 0..1500),
        sizes in proptest::collection::vec(1usize..400, 1..10),
    ) {
        let mut splitter = Splitter::new();
        let mut frames = split(&mut splitter, &bytes, &sizes);
        let mut encoder = Encoder::new();
        let sound: Vec<u8> = (0..20).flat_map(|i| encoded(&mut encoder, attitude(i))).collect();
        frames.extend(split(&mut splitter, &sound, &sizes));
        // A false start can hold back up to one longest frame, no more.
        prop_assert!(frames.iter().any(|(sequence, ..)| *sequence == 19), "not recovered after a burst of garbage");
        // Random bytes may pass a 16-bit checksum now and then, as frames of either version, signed or not.
        let (least, most) = frames.iter().fold((0, 0), |(least, most), (_, _, payload)| {
            (least + payload.len() + 8, most + payload.len() + 28)
        });
        let unframed = splitter.pending() + splitter.garbage_bytes() as usize;
        let total = bytes.len() + sound.len();
        prop_assert!((least + unframed..=most + unframed).contains(&total));
    }

    #[test]
    fn a_changed_or_cut_frame_never_comes_out_as_another(
        n in 0u32..100, at in any::<prop::sample::Index>(), value in any::<u8>(), keep in any::<prop::sample::Index>(),
    ) {
        let whole = encoded(&mut Encoder::new(), attitude(n));
        let mut changed = whole.clone();
        changed[at.index(whole.len())] = value;
        let cut = &whole[..keep.index(whole.len())];
        let mut splitter = Splitter::new();
        for bytes in [&changed[..], cut] {
            splitter.load_datagram(bytes);
            while let Some(frame) = splitter.next_frame() {
                prop_assert!(bytes == &whole[..], "{:?}", frame);
            }
        }
        splitter.load_datagram(&whole);
        prop_assert!(splitter.next_frame().is_some(), "a bad datagram spoilt the next one");
    }

    #[test]
    fn no_datagram_panics(datagram in proptest::collection::vec(any::<u8>(), 0..SPLITTER_BYTES + 500)) {
        let mut splitter = Splitter::new();
        splitter.load_datagram(&datagram);
        while let Some(frame) = splitter.next_frame() {
            let _ = Content::of(&frame);
        }
        prop_assert_eq!(splitter.pending(), 0);
    }

    #[test]
    fn no_payload_panics_in_decoding(
        id in proptest::sample::select(known_ids()), payload in proptest::collection::vec(any::<u8>(), 0..=255),
    ) {
        let mut bytes = vec![0xfd, payload.len() as u8, 0, 0, 0, 1, 1];
        bytes.extend_from_slice(&id.to_le_bytes()[..3]);
        bytes.extend_from_slice(&payload);
        let crc = calculate_crc(&bytes[1..], MavMessage::extra_crc(id));
        bytes.extend_from_slice(&crc.to_le_bytes());
        let mut splitter = Splitter::new();
        splitter.load_datagram(&bytes);
        let frame = splitter.next_frame();
        prop_assert!(frame.is_some());
        if let Some(frame) = frame {
            let _ = Content::of(&frame);
        }
    }
}

#[test]
fn a_frame_inside_a_false_start_is_found() {
    let frame = encoded(&mut Encoder::new(), attitude(7));
    let mut bytes = vec![0xfd, 200, 0, 0];
    bytes.extend_from_slice(&frame);
    bytes.extend_from_slice(&[0; 300]);
    let frames = split(&mut Splitter::new(), &bytes, &[1000]);
    assert_eq!(frames.len(), 1);
}

#[test]
fn mavlink_1_is_understood() {
    let mut raw = MAVLinkV1MessageRaw::new();
    let header = MavHeader {
        system_id: 3,
        component_id: 1,
        sequence: 9,
    };
    raw.serialize_message(header, &attitude(5));
    let mut splitter = Splitter::new();
    splitter.load_datagram(raw.raw_bytes());
    let frame = splitter.next_frame().unwrap();
    assert_eq!(frame.header, header);
    assert!(matches!(frame.decode(), Ok(MavMessage::ATTITUDE_QUATERNION(data)) if data.time_boot_ms == 5));
}

#[test]
fn signed_frames_and_wide_system_ids_are_understood() {
    let payload = [1, 2, 3, 4, 5, 6, 7, 8, 9];
    for (flags, system) in [(1u8, vec![5]), (2, vec![5, 0, 0, 1]), (3, vec![5, 0, 0, 1])] {
        let mut bytes = vec![0xfd, payload.len() as u8, flags, 0, 42];
        bytes.extend_from_slice(&system);
        bytes.extend_from_slice(&[1, 0, 0, 0]);
        bytes.extend_from_slice(&payload);
        let crc = calculate_crc(&bytes[1..], HEARTBEAT_DATA::EXTRA_CRC);
        bytes.extend_from_slice(&crc.to_le_bytes());
        if flags & 1 != 0 {
            bytes.extend_from_slice(&[0xfd; 13]);
        }
        let len = bytes.len();
        bytes.extend(encoded(&mut Encoder::new(), attitude(1)));
        let mut splitter = Splitter::new();
        splitter.load_datagram(&bytes);
        let frame = splitter.next_frame().unwrap();
        assert_eq!(frame.payload, payload);
        assert_eq!(
            frame.header.system_id,
            if flags & 2 == 0 { 5 } else { 0x0100_0005 }
        );
        assert_eq!((frame.header.component_id, frame.header.sequence), (1, 42));
        assert!(splitter.next_frame().is_some(), "{len} bytes");
        assert_eq!(splitter.garbage_bytes(), 0);
    }
}

#[test]
fn every_component_numbers_its_own_messages() {
    let mut encoder = Encoder::new();
    let mut splitter = Splitter::new();
    let mut sequence = |component| {
        let bytes = encoder.encode(1, component, &Body::Message(attitude(1))).to_vec();
        splitter.load_datagram(&bytes);
        splitter.next_frame().unwrap().header.sequence
    };
    for n in 0..300u32 {
        assert_eq!(sequence(196), n as u8);
    }
    assert_eq!((sequence(191), sequence(196), sequence(191)), (0, 44, 1));
}

#[test]
fn an_unknown_command_keeps_its_number_in_both_directions() {
    let mut command = vec![0u8; 33];
    command[28..30].copy_from_slice(&65_432u16.to_le_bytes());
    command[30] = 1;
    command[31] = 196;
    let mut bytes = vec![0xfd, 33, 0, 0, 0, 255, 190, 76, 0, 0];
    bytes.extend_from_slice(&command);
    let crc = calculate_crc(&bytes[1..], COMMAND_LONG_DATA::EXTRA_CRC);
    bytes.extend_from_slice(&crc.to_le_bytes());
    let mut splitter = Splitter::new();
    splitter.load_datagram(&bytes);
    let content = Content::of(&splitter.next_frame().unwrap());
    assert!(matches!(
        content,
        Some(Content::UnknownCommand {
            command: 65_432,
            target_system: 1,
            target_component: 196
        })
    ));

    let ack = CommandAck {
        command: 65_432,
        result: MavResult::MAV_RESULT_UNSUPPORTED,
        target_system: 255,
        target_component: 190,
    };
    splitter.load_datagram(Encoder::new().encode(1, 196, &Body::CommandAck(ack)));
    let frame = splitter.next_frame().unwrap();
    assert_eq!(frame.message_id, COMMAND_ACK_DATA::ID);
    assert_eq!(frame.payload, [0x98, 0xff, 3, 0, 0, 0, 0, 0, 255, 190]);
}

/// A frame with any payload, its checksum seeded for the type or, for types of other dialects, for none.
fn frame(message_id: u32, payload: &[u8]) -> Vec<u8> {
    let mut frame = vec![0xfd, payload.len() as u8, 0, 0, 0, 1, 1];
    frame.extend_from_slice(&message_id.to_le_bytes()[..3]);
    frame.extend_from_slice(payload);
    let crc = calculate_crc(&frame[1..], MavMessage::extra_crc(message_id));
    frame.extend_from_slice(&crc.to_le_bytes());
    frame
}

#[test]
fn a_frame_of_another_dialect_passes_or_not_however_its_bytes_arrive() {
    // In the tail of a foreign frame begins one of ours, which reaches beyond it over a third one that follows.
    let third = frame(HEARTBEAT_DATA::ID, &[1; 9]);
    let mut payload = vec![0; 2];
    payload.extend_from_slice(&third);
    payload.extend_from_slice(&[0; 40]);
    let second = frame(TUNNEL_DATA::ID, &payload);
    let mut first = frame(60_000, &[&[7; 5][..], &second[..10]].concat());
    // What would be its checksum is the beginning of the payload of the second.
    first.truncate(first.len() - 2);
    let mut stream = encoded(&mut Encoder::new(), attitude(1));
    stream.extend_from_slice(&first);
    stream.extend_from_slice(&second[10..]);
    stream.extend_from_slice(&[0; 300]);
    let mut results = [stream.len(), 1, 7, 40].map(|size| {
        let mut splitter = Splitter::new();
        splitter.with_unknown();
        split(&mut splitter, &stream, &[size])
    });
    assert!(results[0].len() > 1, "{:?}", results[0]);
    let whole = std::mem::take(&mut results[0]);
    for pieces in &results[1..] {
        assert_eq!(pieces, &whole);
    }
}
