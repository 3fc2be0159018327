//! What the autopilot's rangefinders and other components say of distances comes out as scans; what is not configured, or of another
//! vehicle, does not; and the autopilot is asked for what it does not send by itself.

use crate::support::{Bench, MODE_HOLD, SYSTEM};
use jink_mavlink_gateway::ranges::{RANGEFINDER, ROW, RangeSources, SensorTable};
use jink_mavlink_gateway::{Gateway, GatewayConfig};
use jink_mavlink_link::router::LinkSet;
use jink_shared_types::ranges::RangeScan;
use mavlink::MessageData;
use mavlink::dialect::*;
use nalgebra::Vector3;

/// The link of a ground station.
const GROUND: u8 = 1;

fn bench() -> Bench {
    let front = SensorTable {
        name: "front".to_owned(),
        kind: RANGEFINDER.to_owned(),
        id: Some(2),
        ..SensorTable::default()
    };
    let radar = SensorTable {
        name: "radar".to_owned(),
        kind: ROW.to_owned(),
        component: Some(195),
        ..SensorTable::default()
    };
    let mut bench = Bench::new();
    let sources = RangeSources::new(&[front, radar]).unwrap();
    bench.gateway = Gateway::new(GatewayConfig {
        is_proven: true,
        ground_station_links: LinkSet::default().with(GROUND),
        ..GatewayConfig::default()
    })
    .with_range_sources(sources);
    bench
}

fn beam(id: u8, distance_cm: u16) -> MavMessage {
    MavMessage::DISTANCE_SENSOR(DISTANCE_SENSOR_DATA {
        id,
        min_distance: 20,
        max_distance: 1000,
        current_distance: distance_cm,
        ..DISTANCE_SENSOR_DATA::default()
    })
}

fn row(distance_cm: u16) -> MavMessage {
    MavMessage::OBSTACLE_DISTANCE(OBSTACLE_DISTANCE_DATA {
        min_distance: 20,
        max_distance: 1000,
        increment: 5,
        distances: [distance_cm; 72],
        frame: MavFrame::MAV_FRAME_BODY_FRD,
        ..OBSTACLE_DISTANCE_DATA::default()
    })
}

/// What one step makes of messages, each from a system and a component: number of the sensor and its nearest range.
fn taken(bench: &mut Bench, messages: &[(u8, u8, MavMessage)]) -> Vec<(usize, f32)> {
    for (system, component, message) in messages {
        bench.receive_from(*system, *component, message.clone());
    }
    bench.step();
    let nearest = |scan: &RangeScan| {
        let ranges = scan.range_m[..scan.beams as usize].iter();
        ranges.copied().fold(f32::INFINITY, f32::min)
    };
    let scans = bench.outputs.scans().iter();
    scans.map(|scan| (scan.source, nearest(&scan.scan))).collect()
}

#[test]
fn ours_are_taken_and_all_others_passed_over() {
    let mut bench = bench();
    // Nobody is known yet.
    assert!(taken(&mut bench, &[(SYSTEM, 1, beam(2, 300))]).is_empty());
    bench.fly(1.0, |bench, t| {
        bench.telemetry(t, MODE_HOLD, Vector3::zeros(), Vector3::zeros());
    });
    let scans = taken(
        &mut bench,
        &[
            (SYSTEM, 1, beam(2, 300)),
            (SYSTEM, 1, beam(3, 100)),
            (SYSTEM, 195, row(450)),
            (SYSTEM, 194, row(100)),
            (7, 1, beam(2, 100)),
            (7, 195, row(100)),
            (SYSTEM, 1, row(100)),
            // A rangefinder is the autopilot's.
            (SYSTEM, 195, beam(2, 100)),
        ],
    );
    assert_eq!(scans, [(0, 3.0), (1, 4.5)]);
    assert!(taken(&mut bench, &[]).is_empty(), "each of them once");
    bench.link = GROUND;
    let from_a_station = [(SYSTEM, 1, beam(2, 100)), (SYSTEM, 195, row(100))];
    assert!(taken(&mut bench, &from_a_station).is_empty());
}

#[test]
fn a_rangefinder_that_does_not_come_is_asked_for() {
    let mut bench = bench();
    bench.fly(12.0, |bench, t| {
        bench.telemetry(t, MODE_HOLD, Vector3::zeros(), Vector3::zeros());
    });
    let is_asked = |message: &MavMessage| {
        matches!(message, MavMessage::COMMAND_LONG(command)
        if command.command == MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL && command.param1 == DISTANCE_SENSOR_DATA::ID as f32 && command.param2 == 50_000.0)
    };
    assert!(bench.sent.iter().any(|sent| is_asked(&sent.message)));
}
