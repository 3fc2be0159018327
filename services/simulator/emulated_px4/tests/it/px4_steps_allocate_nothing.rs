//! A step of autopilot and vehicle takes no memory from the heap once it flies.

#![allow(deprecated)]

use crate::support;
use allocation_counter::measure;
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::{Link, Packet};
use mavlink::MavHeader;
use mavlink::dialect::{MANUAL_CONTROL_DATA, MavFrame, MavMessage};

#[test]
fn a_step_in_flight_allocates_nothing() {
    let mut flight = support::cruising();
    flight.run(2.0);
    let (_, desired) = flight.desired.clone().expect("a question");
    let reply = Packet {
        link: Link::Companion,
        header: MavHeader {
            system_id: 1,
            component_id: 196,
            sequence: 0,
        },
        message: support::mirror(&desired),
    };
    let inbox = [reply];
    let mut outbox = Vec::with_capacity(256);
    let mut sent = 0;
    let allocated = measure(|| {
        for step in 0..2_000 {
            outbox.clear();
            let received = if step % 12 == 0 { &inbox[..] } else { &[] };
            flight.autopilot.step(received, &mut outbox);
            sent += outbox.len();
        }
    })
    .count_total;
    assert_eq!(allocated, 0);
    assert!(sent > 2_000);
}

#[test]
fn a_step_in_offboard_allocates_nothing_and_neither_do_loss_return_and_refusals() {
    let mut flight = support::current::staying(&[]);
    let packet = |setpoint| Packet {
        link: Link::Companion,
        header: MavHeader {
            system_id: 1,
            component_id: 196,
            sequence: 0,
        },
        message: MavMessage::SET_POSITION_TARGET_LOCAL_NED(setpoint),
    };
    let good = [packet(support::current::here(&flight))];
    let empty = [packet(support::current::setpoint([0.0; 3], [0.0; 3], 0xfff))];
    let mut outbox = Vec::with_capacity(256);
    let mut texts = 0;
    let allocated = measure(|| {
        for step in 0..4_000 {
            outbox.clear();
            let received = match step {
                0..1_000 | 3_000.. if step % 5 == 0 => &good[..],
                2_000 => &empty[..],
                _ => &[],
            };
            flight.autopilot.step(received, &mut outbox);
            texts += outbox
                .iter()
                .filter(|p| matches!(p.message, MavMessage::STATUSTEXT(_)))
                .count();
        }
    })
    .count_total;
    assert_eq!(allocated, 0);
    assert_eq!(
        texts,
        2 * 3,
        "the loss, the return and the refusal, on both links"
    );
    assert_eq!(flight.autopilot.hold_count(), 1);
}

#[test]
fn a_step_under_sticks_among_obstacles_allocates_nothing() {
    let mut flight = support::obstacles::in_position(&[("CP_DIST", 2.0)]);
    let packet = |link, message| Packet {
        link,
        header: MavHeader {
            system_id: 1,
            component_id: 196,
            sequence: 0,
        },
        message,
    };
    let pushed = MavMessage::MANUAL_CONTROL(MANUAL_CONTROL_DATA {
        x: 1_000,
        z: 500,
        target: 1,
        ..MANUAL_CONTROL_DATA::default()
    });
    let wall = support::obstacles::wall(20.0);
    let scan = |frame| MavMessage::OBSTACLE_DISTANCE(support::obstacles::scan(&flight, &wall, frame));
    let seen = scan(MavFrame::MAV_FRAME_BODY_FRD);
    let refused = scan(MavFrame::MAV_FRAME_LOCAL_ENU);
    let stick = [packet(Link::GroundStation, pushed)];
    let scans = [packet(Link::Companion, seen), packet(Link::Companion, refused)];
    let mut outbox = Vec::with_capacity(256);
    let mut maps = 0;
    let allocated = measure(|| {
        for step in 0..4_000 {
            outbox.clear();
            let received = match step % 25 {
                0 | 12 => &stick[..],
                5 if step < 2_000 => &scans[..1],
                6 if step < 2_000 => &scans[1..],
                _ => &[],
            };
            flight.autopilot.step(received, &mut outbox);
            let fused = |p: &&Packet| {
                p.header.component_id == 1 && matches!(p.message, MavMessage::OBSTACLE_DISTANCE(_))
            };
            maps += outbox.iter().filter(fused).count();
        }
    })
    .count_total;
    assert_eq!(allocated, 0);
    assert!(maps > 100, "{maps}");
    assert_eq!(flight.autopilot.hold_count(), 1, "without scans it holds");
}
