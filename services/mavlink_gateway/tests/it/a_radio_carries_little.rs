//! What jink says to nobody in particular is passed on by an autopilot that passes messages on: where a ground station
//! is seen behind it, that is kept below 1.5 kB/s, and nothing that is new waits for it.
#![allow(deprecated)] // The trajectory messages are gone from PX4 1.16 on; the profile is for the versions before.

use crate::support::*;
use jink_ground_services::computer::BoardReading;
use jink_mavlink_gateway::{Body, Encoder, GatewayConfig, ProfileName};
use jink_shared_types::Timestamp;
use jink_shared_types::motion::Verdict;
use mavlink::dialect::*;
use nalgebra::Vector3;

const FROM: Vector3<f64> = Vector3::new(4.0, -2.0, -3.0);
/// Where it is flown to: 60 m in 30 s.
const WAY: Vector3<f64> = Vector3::new(60.0, 0.0, 0.0);
const DURATION_S: f64 = 30.0;
/// So long after the beginning everything has settled (s).
const SETTLED_S: f64 = 3.0;
/// What a radio may carry of jink (B/s).
const LIMIT_BPS: f64 = 1_500.0;

fn station() -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        mavtype: MavType::MAV_TYPE_GCS,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        ..HEARTBEAT_DATA::default()
    })
}

/// What the gateway has asked for the time in this moment is answered.
fn answer(bench: &mut Bench, now_ns: i64) {
    let asked: Vec<i64> = bench
        .sent
        .iter()
        .rev()
        .take_while(|sent| bench.now.seconds_since(sent.time) < 0.01)
        .filter_map(|sent| match &sent.message {
            MavMessage::TIMESYNC(sync) if sync.tc1 == 0 => Some(sync.ts1),
            _ => None,
        })
        .collect();
    for ts1 in asked {
        bench.receive(MavMessage::TIMESYNC(TIMESYNC_DATA {
            tc1: now_ns,
            ts1,
            ..TIMESYNC_DATA::default()
        }));
    }
}

/// A mission is flown along `way`; the same trajectory comes anew ten times a second, as from the planner. A station is
/// seen for `stays_s`.
fn flown(config: GatewayConfig, way: Vector3<f64>, stays_s: f64) -> Bench {
    let mut bench = Bench::with(config);
    bench.ground.board = Some(BoardReading::default());
    let start = at(0.5);
    let mut id = 1;
    bench.fly(DURATION_S, |bench, t| {
        let tick = (t * 100.0).round() as u32;
        bench.telemetry(t, MODE_MISSION, FROM, Vector3::zeros());
        if tick.is_multiple_of(100) && t < stays_s {
            bench.receive_from(255, 190, station());
        }
        let now_ns = 1_000_000 * i64::from(bench.boot_ms(bench.now));
        if tick.is_multiple_of(10) {
            bench.receive(MavMessage::TIMESYNC(TIMESYNC_DATA {
                ts1: now_ns,
                ..TIMESYNC_DATA::default()
            }));
        }
        answer(bench, now_ns);
        if tick % 10 == 7 {
            id += 1;
            bench.approve(Verdict::Passed, flight(id, start, FROM, way, DURATION_S));
        }
        if let Some(approved) = &mut bench.approved {
            approved.header.publish = bench.now;
        }
        bench.ranges();
    });
    bench
}

/// Bytes that an autopilot passes on between `from` and `to`, per second.
fn carried_bps(bench: &Bench, from: Timestamp, to: Timestamp) -> f64 {
    let mut encoder = Encoder::new();
    let bytes: usize = bench
        .sent
        .iter()
        .filter(|sent| (from..to).contains(&sent.time))
        .filter(|sent| {
            matches!(
                sent.message,
                MavMessage::TRAJECTORY_REPRESENTATION_BEZIER(_)
                    | MavMessage::HEARTBEAT(_)
                    | MavMessage::OBSTACLE_DISTANCE(_)
                    | MavMessage::ONBOARD_COMPUTER_STATUS(_)
                    | MavMessage::STATUSTEXT(_)
                    | MavMessage::TIMESYNC(_)
            )
        })
        .map(|sent| {
            let body = Body::Message(sent.message.clone());
            encoder.encode(SYSTEM, sent.component_id, &body).len()
        })
        .sum();
    bytes as f64 / to.seconds_since(from)
}

fn gaps_s(bench: &Bench, from: Timestamp) -> impl Iterator<Item = f64> {
    let times: Vec<Timestamp> = bench.curves().into_iter().map(|(time, _)| time).collect();
    let pairs: Vec<f64> = times
        .windows(2)
        .filter(|pair| pair[0] >= from)
        .map(|pair| pair[1].seconds_since(pair[0]))
        .collect();
    pairs.into_iter()
}

#[test]
fn of_curves_while_a_station_is_received() {
    let bench = flown(GatewayConfig::default(), WAY, DURATION_S);
    let settled = at(SETTLED_S);
    let bps = carried_bps(&bench, settled, at(DURATION_S));
    assert!(bps < LIMIT_BPS, "{bps} B/s");
    let longest_s = gaps_s(&bench, settled).fold(0.0, f64::max);
    assert!((0.09..0.1).contains(&longest_s), "{longest_s} s");
}

#[test]
fn everything_goes_out_at_its_rate_while_none_is_received_and_again_when_it_is_gone() {
    let alone = flown(GatewayConfig::default(), WAY, 0.0);
    let left = flown(GatewayConfig::default(), WAY, 5.0);
    for (bench, from) in [(&alone, at(SETTLED_S)), (&left, at(16.0))] {
        let longest_s = gaps_s(bench, from).fold(0.0, f64::max);
        assert!(longest_s < 0.055, "{longest_s} s");
        assert!(carried_bps(bench, from, at(DURATION_S)) > 2.0 * LIMIT_BPS);
    }
}

#[test]
fn a_trajectory_that_leads_elsewhere_does_not_wait() {
    let mut bench = flown(GatewayConfig::default(), WAY, DURATION_S);
    for turn in 1..=20 {
        bench.receive_from(255, 190, station());
        bench.idle_until(bench.now.plus_seconds(0.137));
        bench.telemetry(0.0, MODE_MISSION, FROM, Vector3::zeros());
        let aside = Vector3::new(0.0, f64::from(turn), 0.0);
        let start = bench.now.plus_seconds(-1.0);
        bench.approve(
            Verdict::Passed,
            flight(1000 + turn as u64, start, FROM, aside, 2.0),
        );
        let asked = bench.now;
        bench.step();
        assert!(bench.outputs.reported.is_none());
        bench.idle_until(bench.now.plus_seconds(0.02));
        let (sent, _) = bench.curves().pop().unwrap();
        let waited_s = sent.seconds_since(asked);
        assert!((0.0..0.02).contains(&waited_s), "{turn}: {waited_s} s");
        // The same once more is known already, unless it turns so sharply that curves must be short.
        if turn > 3 {
            continue;
        }
        bench.approve(
            Verdict::Passed,
            flight(2000 + turn as u64, start, FROM, aside, 2.0),
        );
        bench.step();
        assert!(bench.outputs.reported.is_some(), "{turn}");
    }
}

#[test]
fn setpoints_with_an_addressee_stay_what_they_are() {
    let config = GatewayConfig::from_params(&Default::default(), ProfileName::Px4Offboard);
    let bench = flown(config, WAY, DURATION_S);
    let maps = bench
        .sent
        .iter()
        .filter(|sent| sent.time >= at(SETTLED_S) && matches!(sent.message, MavMessage::OBSTACLE_DISTANCE(_)))
        .count() as f64;
    assert!((4.9..5.1).contains(&(maps / (DURATION_S - SETTLED_S))), "{maps}");
}
