//! After construction the hot path (splitting, decoding, stepping, encoding) asks the allocator for nothing.
#![allow(deprecated)] // The trajectory messages are gone from PX4 1.16 on; this profile is for the versions before.

use crate::support::{MODE_MISSION, MODE_POSITION, Sample, at, flight, heartbeat, wish};
use allocation_counter::measure;
use jink_mavlink_gateway::assist::record::AssistRecord;
use jink_mavlink_gateway::executive::FlightGoal;
use jink_mavlink_gateway::executive::items::Course;
use jink_mavlink_gateway::executive::record::Record;
use jink_mavlink_gateway::landed_state::LandedState;
use jink_mavlink_gateway::{
    Body, Content, Destination, Encoder, Gateway, GatewayConfig, Inputs, Outgoing, Outputs, ProfileName,
    Receipt, Received,
};
use jink_mavlink_link::budget::TrafficClass;
use jink_mavlink_link::frame::Splitter;
use jink_mavlink_link::link::Link;
use jink_mavlink_link::links::{LinkSetup, Links};
use jink_mavlink_link::router::OwnIds;
use jink_mavlink_link::signing::Key;
use jink_runtime::config::{Purpose, Signing};
use jink_shared_types::motion::{ApprovedTrajectory, Verdict};
use jink_shared_types::params::ParamSet;
use jink_shared_types::prevention::{PreventedDemand, PreventionState};
use jink_shared_types::ring::SectorRing;
use jink_shared_types::vehicle::NavMode;
use jink_shared_types::{Coded, Timestamp, Velocity};
use mavlink::MavHeader;
use mavlink::dialect::*;
use mavlink::{Message, calculate_crc};
use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::net::UdpSocket;

/// One second of an autopilot's messages as bytes, per 10 ms.
fn telemetry() -> Vec<Vec<u8>> {
    let mut encoder = Encoder::new();
    let mut bytes = |message: MavMessage| encoder.encode(1, 1, &Body::Message(message)).to_vec();
    (0..200u32)
        .map(|i| {
            let time_boot_ms = 5000 + 10 * i;
            let mut tick = Vec::new();
            if i % 100 == 0 {
                tick.extend(bytes(heartbeat(MODE_MISSION, true)));
            }
            if i % 20 == 0 {
                tick.extend(bytes(wish([(Vector3::new(40.0, 0.0, -5.0), u16::MAX); 3])));
            }
            tick.extend(bytes(MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
                time_boot_ms,
                ..LOCAL_POSITION_NED_DATA::default()
            })));
            tick.extend(bytes(MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
                time_boot_ms,
                q1: 1.0,
                ..ATTITUDE_QUATERNION_DATA::default()
            })));
            tick.extend(bytes(MavMessage::TIMESYNC(TIMESYNC_DATA {
                ts1: 1,
                ..TIMESYNC_DATA::default()
            })));
            tick
        })
        .collect()
}

#[test]
fn from_bytes_to_bytes_without_the_allocator() {
    let telemetry = telemetry();
    let mut gateway = Gateway::new(GatewayConfig {
        is_proven: true,
        ..GatewayConfig::default()
    });
    let mut outputs = Outputs::default();
    let mut splitter = Splitter::new();
    let mut encoder = Encoder::new();
    let mut messages: Vec<Received> = Vec::with_capacity(64);
    let mut approved = Sample::new(
        ApprovedTrajectory {
            trajectory: flight(1, at(0.0), Vector3::zeros(), Vector3::new(9.0, 0.0, 0.0), 8.0),
            verdict: Coded::new(Verdict::Passed),
            ..ApprovedTrajectory::default()
        },
        at(0.0),
    );
    let mut ring = Some(Sample::new(SectorRing::default(), at(0.0)));
    let mut cycle = |now: Timestamp, bytes: &[u8], id: u64| -> usize {
        approved.value.trajectory.id = id;
        approved.header.publish = now;
        if let Some(ring) = &mut ring {
            ring.header.publish = now;
        }
        messages.clear();
        splitter.push(bytes);
        while let Some(frame) = splitter.next_frame() {
            if let Some(content) = Content::of(&frame) {
                messages.push(Received {
                    header: frame.header,
                    content,
                    time: now,
                    link: 0,
                });
            }
        }
        let inputs = Inputs {
            messages: &messages,
            link: Default::default(),
            approved: jink_shared_types::Reading::Fresh(jink_shared_types::Stamped {
                sample: &*approved.value,
                header: &approved.header,
            }),
            prevented: jink_shared_types::Reading::Never,
            ring: Sample::reading(&ring, now, 200.0),
            system: jink_shared_types::Reading::Never,
            events: &[],
            parameters: None,
            answers: &[],
        };
        gateway.step(now, &inputs, &mut outputs);
        let mut sent = 0;
        for message in outputs.messages() {
            sent += encoder
                .encode(message.system_id, message.component_id, &message.body)
                .len();
            gateway.wire(now, message.receipt);
        }
        sent
    };
    // The first second holds the only event, whose text is formatted on the heap.
    for (i, bytes) in telemetry[..100].iter().enumerate() {
        cycle(at(i as f64 / 100.0), bytes, 1);
    }
    let mut sent = 0;
    let allocated = measure(|| {
        for (i, bytes) in telemetry.iter().enumerate().skip(100) {
            sent += cycle(at(i as f64 / 100.0), bytes, 1 + i as u64 / 3);
        }
    })
    .count_total;
    assert_eq!(allocated, 0);
    assert!(sent > 5000, "{sent} bytes");
}

#[test]
fn an_assisted_flight_asks_the_allocator_for_nothing() {
    let mut params = ParamSet::default();
    params.set("CP_DIST", 2.0).unwrap();
    let config = GatewayConfig {
        is_proven: true,
        ..GatewayConfig::from_params(&params, ProfileName::Px4Offboard)
    };
    let record = Record {
        vehicle: Some((1, 0)),
        written: at(0.0),
        mode: NavMode::Position,
        armed: true,
        landed_state: LandedState::InAir,
        flight_goal: FlightGoal::None,
        returns_to_hold: false,
        index: None,
        course: Course::default(),
        assist: Some(AssistRecord {
            pilots_mode: MODE_POSITION,
            calibration: None,
        }),
    };
    let mut gateway = Gateway::new(config)
        .with_params(&params)
        .resuming(at(0.0), Some(record));
    let mut outputs = Outputs::default();
    let mut prevented = Sample::new(
        PreventedDemand {
            velocity: Velocity::new(1.0, 0.5, 0.0),
            state: Coded::new(PreventionState::Acting),
            ..PreventedDemand::default()
        },
        at(0.0),
    );
    let mut messages: Vec<Received> = Vec::with_capacity(8);
    let mut setpoints = 0;
    let mut fly = |steps: std::ops::Range<u32>| {
        setpoints = 0;
        for i in steps {
            let now = at(f64::from(i) / 100.0);
            let time_boot_ms = 5000 + 10 * i;
            messages.clear();
            for message in [
                heartbeat(6 << 16, true),
                MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
                    time_boot_ms,
                    ..LOCAL_POSITION_NED_DATA::default()
                }),
                MavMessage::MANUAL_CONTROL(MANUAL_CONTROL_DATA {
                    x: 900,
                    z: 700,
                    r: 300,
                    ..MANUAL_CONTROL_DATA::default()
                }),
            ] {
                messages.push(Received {
                    header: MavHeader {
                        system_id: 1,
                        component_id: 1,
                        sequence: 0,
                    },
                    content: Content::Message(message),
                    time: now,
                    link: 0,
                });
            }
            prevented.header.publish = now;
            let prevented = jink_shared_types::Reading::Fresh(jink_shared_types::Stamped {
                sample: &*prevented.value,
                header: &prevented.header,
            });
            let inputs = Inputs {
                messages: &messages,
                link: Default::default(),
                approved: jink_shared_types::Reading::Never,
                prevented,
                ring: jink_shared_types::Reading::Never,
                system: jink_shared_types::Reading::Never,
                events: &[],
                parameters: None,
                answers: &[],
            };
            gateway.step(now, &inputs, &mut outputs);
            for message in outputs.messages() {
                setpoints += usize::from(matches!(message.receipt, Receipt::Setpoint { .. }));
                gateway.wire(now, message.receipt);
            }
        }
    };
    // By then everything was asked for that is not answered here.
    fly(0..1200);
    let allocated = measure(|| fly(1200..2000)).count_total;
    assert_eq!(allocated, 0);
    assert!(setpoints >= 399, "{setpoints} setpoints in 8 s");
}

/// Three links over UDP: an autopilot's, a ground station's that asks for signatures, a slow one.
fn links() -> (Links, Vec<UdpSocket>) {
    let free_port = || {
        UdpSocket::bind("127.0.0.1:0")
            .unwrap()
            .local_addr()
            .unwrap()
            .port()
    };
    let ports: Vec<_> = (0..3).map(|_| free_port()).collect();
    let setups = ports.iter().enumerate().map(|(index, port)| LinkSetup {
        name: format!("link_{index}"),
        endpoint: format!("udpin:{port}").parse().unwrap(),
        purpose: [Purpose::Autopilot, Purpose::GroundStation][index.min(1)],
        signing: [Signing::Off, Signing::Accept, Signing::Off][index],
        key: Key::of_bytes(&[7; 32]),
        link_id: index as u8,
        peers: Vec::new(),
        rate_bps: (index == 2).then_some(2000.0),
    });
    let folder = std::env::temp_dir();
    let path = |what: &str| folder.join(format!("jink-alloc-{}-{what}", std::process::id()));
    let doors = ["a", "b", "c"].map(path);
    let mut links = Links::open(setups.collect(), &doors, |first| {
        Link::open(first.endpoint.clone())
    })
    .unwrap();
    links.sign_with_stamps_at(&path("stamps")).unwrap();
    let peers = ports.iter().map(|port| {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.connect(("127.0.0.1", *port)).unwrap();
        socket.set_nonblocking(true).unwrap();
        socket
    });
    (links, peers.collect())
}

/// Frames of every type with any payload, and garbage between them.
fn anything() -> Vec<u8> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
    let mut next = move || random.next_u64().to_le_bytes();
    let mut stream = Vec::new();
    for id in MavMessage::all_ids().iter().chain(&[60_000, 0x00fd_fdfd]) {
        for _ in 0..4 {
            let len = usize::from(next()[0]);
            let payload: Vec<u8> = (0..32).flat_map(|_| next()).take(len).collect();
            let mut frame = vec![0xfd, payload.len() as u8, 0, 0, 0, 1, 1];
            frame.extend_from_slice(&id.to_le_bytes()[..3]);
            frame.extend_from_slice(&payload);
            let crc = calculate_crc(&frame[1..], MavMessage::extra_crc(*id));
            stream.extend_from_slice(&frame);
            stream.extend_from_slice(&crc.to_le_bytes());
        }
        stream.extend_from_slice(&next());
    }
    stream
}

#[test]
fn whatever_bytes_come_they_cost_no_memory() {
    let stream = anything();
    let mut splitter = Splitter::new();
    splitter.with_unknown();
    let (mut understood, mut others) = (0, 0);
    let allocated = measure(|| {
        for piece in stream.chunks(700) {
            assert_eq!(splitter.push(piece), piece.len());
            while let Some(frame) = splitter.next_frame() {
                match Content::of(&frame) {
                    Some(_) => understood += 1,
                    None => others += 1,
                }
            }
        }
    })
    .count_total;
    assert_eq!(allocated, 0);
    assert!(understood > 100 && others > 20, "{understood}, {others}");
}

#[test]
fn from_link_to_link_without_the_allocator() {
    let (mut links, peers) = links();
    let us = OwnIds {
        system_id: Some(1),
        components: [196, 191],
    };
    let mut frames = Vec::new();
    for (index, sender) in [(1, 1), (255, 190), (1, 100)].into_iter().enumerate() {
        let mut encoder = Encoder::new();
        let mut frame = encoder
            .encode(sender.0, sender.1, &Body::Message(heartbeat(0, true)))
            .to_vec();
        if index == 1 {
            // And one of a dialect that nobody here knows, in the same datagram.
            frame.extend_from_within(..);
            let second = frame.len() / 2;
            frame[second + 7..second + 10].copy_from_slice(&60_000u32.to_le_bytes()[..3]);
        }
        frames.push(frame);
    }
    let own = Outgoing {
        system_id: 1,
        component_id: 196,
        body: Body::Message(heartbeat(0, true)),
        to: Destination::Everyone,
        receipt: Receipt::Plain,
    };
    let mut received: Vec<Received> = Vec::with_capacity(64);
    let mut datagram = [0; 512];
    let (mut count, mut sent) = (0, 0);
    let mut carry = || {
        for _ in 0..100 {
            for (peer, frame) in peers.iter().zip(&frames) {
                peer.send(frame).unwrap();
            }
            received.clear();
            let _more = links.receive(jink_runtime::now, us, &mut received);
            count += received.len();
            let to = links.send(jink_runtime::now(), &own);
            sent += (0..3).filter(|link| to.contains(*link)).count();
            for peer in &peers {
                while peer.recv(&mut datagram).is_ok() {}
            }
        }
    };
    carry();
    let allocated = measure(carry).count_total;
    assert_eq!(allocated, 0);
    let report = links.report();
    // Two links have everything, the slow one what it carries.
    assert!(count >= 500 && sent >= 400, "{count} received, {sent} sent");
    assert!(report.links[0].forwarded >= 500, "{report:?}");
    assert!(
        report.links[2].dropped[TrafficClass::Forwarded as usize] > 0,
        "{report:?}"
    );
}
