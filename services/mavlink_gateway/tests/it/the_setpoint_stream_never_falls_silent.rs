//! The one promise: whatever comes, comes late, or comes as nonsense, setpoints go out at every beat, finite, with five
//! points, never stamped in the future, and without a jump while the approved trajectory has none.
#![allow(deprecated)] // The trajectory messages are gone from PX4 1.16 on; this profile is for the versions before.

use crate::support::*;
use jink_mavlink_gateway::{Encoder, HandoverState};
use jink_mavlink_link::signing::stamps::Stamps;
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::health::Health;
use jink_shared_types::motion::{ApprovedTrajectory, Trajectory, Verdict};
use jink_shared_types::ring::SectorRing;
use jink_shared_types::vehicle::{COMMAND_LAND, COMMAND_LOITER, COMMAND_NONE, COMMAND_TAKEOFF};
use jink_shared_types::{Coded, Flag};
use mavlink::dialect::*;
use nalgebra::Vector3;
use proptest::prelude::*;

const PERIOD_S: f64 = 0.05;

/// Something that happens to the gateway.
#[derive(Clone, Debug)]
enum Happening {
    Heartbeat(u32),
    Position(f64, f64),
    Attitude(f64),
    Wish(u16, f32, f32, u8),
    Mirror,
    NothingApproved,
    Flight(f64, f64),
    GarbageApproved(Vec<f64>, u32, u8),
    GuardSilent,
    Ring(f32),
    System(u8),
    Event(u16, f64),
    Bytes(Vec<u8>),
    Timesync(i64, i64),
    Command(u16, u8, u8),
    ClockOfTheAutopilot(u32),
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -20.0..20.0f64,
        1 => any::<f64>(),
        1 => Just(f64::NAN),
    ]
}

fn happening() -> impl Strategy<Value = Happening> {
    let single = || number().prop_map(|n| n as f32);
    let modes = prop_oneof![
        Just(MODE_MISSION),
        Just(MODE_HOLD),
        Just(MODE_LAND),
        Just(MODE_TAKEOFF),
        Just(MODE_POSITION),
        any::<u32>(),
    ];
    let commands = prop_oneof![
        Just(COMMAND_NONE),
        Just(COMMAND_LOITER),
        Just(COMMAND_LAND),
        Just(COMMAND_TAKEOFF),
        any::<u16>(),
    ];
    prop_oneof![
        2 => modes.prop_map(Happening::Heartbeat),
        6 => (number(), number()).prop_map(|(x, v)| Happening::Position(x, v)),
        4 => number().prop_map(Happening::Attitude),
        3 => (commands, single(), single(), any::<u8>())
            .prop_map(|(c, x, v, n)| Happening::Wish(c, x, v, n)),
        1 => Just(Happening::Mirror),
        1 => Just(Happening::NothingApproved),
        2 => (-20.0..20.0f64, 0.5..6.0f64).prop_map(|(x, d)| Happening::Flight(x, d)),
        1 => (proptest::collection::vec(number(), 25), any::<u32>(), any::<u8>())
            .prop_map(|(n, len, verdict)| Happening::GarbageApproved(n, len, verdict)),
        1 => Just(Happening::GuardSilent),
        1 => single().prop_map(Happening::Ring),
        1 => (0u8..6).prop_map(Happening::System),
        1 => (any::<u16>(), number()).prop_map(|(id, n)| Happening::Event(id, n)),
        1 => proptest::collection::vec(any::<u8>(), 0..80).prop_map(Happening::Bytes),
        1 => (any::<i64>(), any::<i64>()).prop_map(|(a, b)| Happening::Timesync(a, b)),
        1 => (any::<u16>(), any::<u8>(), any::<u8>()).prop_map(|(c, s, t)| Happening::Command(c, s, t)),
        1 => any::<u32>().prop_map(Happening::ClockOfTheAutopilot),
    ]
}

fn let_happen(bench: &mut Bench, happening: &Happening) {
    match happening {
        Happening::Heartbeat(mode) => bench.receive_heartbeat(*mode, true),
        Happening::Position(x, v) => {
            bench.receive_position(Vector3::new(*x, 1.0, -2.0), Vector3::new(*v, 0.0, 0.0));
        }
        Happening::Attitude(yaw) => bench.receive_attitude(*yaw),
        Happening::Wish(command, x, v, valid) => {
            let mut data = waypoints([(Vector3::new(f64::from(*x), 2.0, -5.0), *command); 3]);
            data.vel_z[0] = *v;
            data.pos_yaw[0] = *v;
            data.valid_points = *valid;
            if command % 3 == 0 {
                data.pos_z[0] = f32::NAN;
            }
            bench.receive(MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(data));
        }
        Happening::Mirror => bench.approve(Verdict::Passed, mirror()),
        Happening::NothingApproved => bench.approve(Verdict::Hold, Trajectory::default()),
        Happening::Flight(x, duration_s) => {
            let id = bench.now.ns;
            let way = Vector3::new(*x, -1.0, 0.5);
            bench.approve(
                Verdict::Passed,
                flight(id, bench.now, Vector3::new(*x, 0.0, -2.0), way, *duration_s),
            );
        }
        Happening::GarbageApproved(numbers, len, verdict) => {
            let mut trajectory = flight(bench.now.ns, bench.now, Vector3::zeros(), Vector3::x(), 3.0);
            for (i, n) in numbers.iter().enumerate().take(18) {
                let point = &mut trajectory.pieces[i / 9].position[i % 6];
                match i % 3 {
                    0 => point.x_m = *n,
                    1 => point.y_m = *n,
                    _ => point.z_m = *n,
                }
            }
            trajectory.pieces[0].duration_s = numbers[18];
            trajectory.pieces[1].yaw_rad[2] = numbers[19];
            trajectory.len = *len % 25;
            bench.approve(Verdict::Passed, trajectory);
            if let Some(approved) = &mut bench.approved {
                approved.value.verdict = Coded::new(match verdict % 4 {
                    0 => Verdict::Hold,
                    1 => Verdict::Passed,
                    2 => Verdict::Kept,
                    _ => Verdict::Braked,
                });
                approved.header.capture.ns = u64::from(*len);
            }
        }
        Happening::GuardSilent => bench.approved = None,
        Happening::Ring(d) => {
            bench.ring = Some(Sample::new(
                SectorRing {
                    distance_m: [*d; 72],
                    range_max_m: [*d; 72],
                    range_min_m: *d,
                    ..SectorRing::default()
                },
                bench.now,
            ));
        }
        Happening::System(health) => bench.healthy(match health {
            0 => Health::Starting,
            1 => Health::Healthy,
            2 => Health::Degraded,
            3 => Health::Failed,
            _ => Health::Stopping,
        }),
        Happening::Event(id, n) => {
            let row = &events::TABLE[usize::from(*id) % events::TABLE.len()];
            bench.events.push(EventSample {
                id: *id,
                ..EventSample::new(row, "planner", [*n; 2])
            });
        }
        Happening::Bytes(bytes) => bench.receive_bytes(bytes),
        Happening::Timesync(tc1, ts1) => bench.receive(MavMessage::TIMESYNC(TIMESYNC_DATA {
            tc1: *tc1,
            ts1: *ts1,
            ..TIMESYNC_DATA::default()
        })),
        Happening::Command(command, system, component) => {
            let mut payload = vec![0xfd, 33, 0, 0, 0, 255, 190, 76, 0, 0];
            payload.extend_from_slice(&[0; 28]);
            payload.extend_from_slice(&command.to_le_bytes());
            payload.extend_from_slice(&[*system, *component, 0]);
            let crc = mavlink::calculate_crc(&payload[1..], 152);
            payload.extend_from_slice(&crc.to_le_bytes());
            bench.receive_bytes(&payload);
        }
        Happening::ClockOfTheAutopilot(ms) => bench.boot_ms_at_zero = *ms,
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn whatever_happens_setpoints_go_on(
        story in proptest::collection::vec((happening(), 0u64..120), 1..120),
        lateness in 0.0..0.45f64,
    ) {
        let mut bench = Bench::new();
        bench.receive_position(Vector3::new(1.0, 1.0, -2.0), Vector3::zeros());
        bench.step();
        for (happening, pause_ms) in story {
            let until = bench.now.plus_seconds(pause_ms as f64 * 1e-3);
            // Woken late, but by less than half a period.
            loop {
                let wake = bench.gateway.next_wake(bench.now).max(bench.now).plus_seconds(lateness * PERIOD_S);
                if wake > until {
                    break;
                }
                bench.now = wake;
                bench.step();
            }
            bench.now = until.max(bench.now);
            let_happen(&mut bench, &happening);
            if matches!(happening, Happening::ClockOfTheAutopilot(_)) {
                // A new start of the autopilot: two positions show it, the next one ends the only excuse for silence.
                for _ in 0..3 {
                    bench.receive_position(Vector3::zeros(), Vector3::zeros());
                    bench.step();
                    bench.boot_ms_at_zero = bench.boot_ms_at_zero.wrapping_add(1);
                }
            }
            bench.step();
        }
        let curves = bench.curves();
        for pair in curves.windows(2) {
            let gap_s = pair[1].0.seconds_since(pair[0].0);
            prop_assert!(gap_s <= 1.5 * PERIOD_S + 1e-6, "silent for {gap_s} s");
        }
        let last_s = curves.last().map_or(f64::INFINITY, |(time, _)| bench.now.seconds_since(*time));
        let age_s = bench.now.seconds_since(at(0.0));
        prop_assert!(last_s <= 1.5 * PERIOD_S || age_s < 0.25, "silent for the last {last_s} s");
        for (_, curve) in &curves {
            prop_assert_eq!(curve.valid_points, 5);
            prop_assert!(curve.delta[4].is_finite() && curve.delta[4] >= 0.3);
            prop_assert!(control_points(curve).iter().all(|p| p.iter().all(|c| c.is_finite())));
            prop_assert!(curve.pos_yaw.iter().all(|yaw| yaw.is_finite()));
        }
    }

    #[test]
    fn a_continuous_plan_is_flown_without_a_jump_whatever_drops_out(
        silences in proptest::collection::vec((0.0..8.0f64, 0.05..1.5f64, 0u8..3), 0..6),
        lateness in 0.0..0.45f64,
        way in (2.0..12.0f64, -6.0..6.0f64, -2.0..2.0f64),
    ) {
        let mut bench = Bench::new();
        let here = Vector3::new(3.0, 4.0, -5.0);
        let far = Vector3::new(60.0, 0.0, -5.0);
        bench.fly(0.5, |bench, t| {
            bench.telemetry(t, MODE_MISSION, here, Vector3::zeros());
            bench.receive(wish([(far, COMMAND_NONE); 3]));
            bench.approve(Verdict::Hold, Trajectory::default());
        });
        let plan = flight(11, bench.now, here, Vector3::new(way.0, way.1, way.2), 6.0);
        let silent = |t: f64, who: u8| {
            silences.iter().any(|(from, length, which)| *which == who && (*from..from + length).contains(&t))
        };
        bench.approve(Verdict::Passed, plan);
        bench.fly(8.0, |bench, t| {
            let there = plan.at(bench.now).unwrap();
            if !silent(t, 0) {
                bench.telemetry(t, MODE_MISSION, there.position.vector(), there.velocity.vector());
            }
            if !silent(t, 1) && ((t * 100.0).round() as u32).is_multiple_of(3) {
                bench.approved.as_mut().unwrap().header.publish = bench.now;
            }
            if !silent(t, 2) && ((t * 100.0).round() as u32).is_multiple_of(20) {
                bench.receive(wish([(far, COMMAND_NONE); 3]));
            }
            bench.now = bench.now.plus_seconds(lateness * 0.01);
        });
        let curves: Vec<_> = bench.curves().into_iter().filter(|(time, _)| *time > plan.start).collect();
        for pair in curves.windows(2) {
            let swap = pair[1].0;
            let gap_s = swap.seconds_since(pair[0].0);
            prop_assert!(gap_s <= 1.5 * PERIOD_S, "silent for {} s", gap_s);
            let (old, new) = (evaluate(&pair[0].1, swap), evaluate(&pair[1].1, swap));
            let jump_m = (old.unwrap() - new.unwrap()).norm();
            prop_assert!(jump_m < 0.05, "a jump of {jump_m} m at {} s", swap.seconds_since(plan.start));
        }
    }
}

#[test]
fn a_flood_of_requests_does_not_push_out_a_setpoint() {
    let mut bench = Bench::new();
    bench.fly(1.0, |bench, t| {
        bench.telemetry(t, MODE_HOLD, Vector3::zeros(), Vector3::zeros());
    });
    let (began, before) = (bench.now, bench.curves().len());
    while bench.now.seconds_since(began) < 1.0 {
        bench.now = bench.gateway.next_wake(bench.now);
        for _ in 0..200 {
            bench.receive(MavMessage::TIMESYNC(TIMESYNC_DATA {
                ts1: 5,
                ..TIMESYNC_DATA::default()
            }));
        }
        bench.step();
    }
    let sent = bench.curves().len() - before;
    assert!(sent >= 20, "{sent}");
}

#[test]
fn with_the_autopilot_lost_the_stream_goes_on() {
    let mut bench = Bench::new();
    bench.fly(1.0, |bench, t| {
        bench.telemetry(t, MODE_MISSION, Vector3::zeros(), Vector3::zeros());
    });
    let before = bench.curves().len();
    bench.idle_until(bench.now.plus_seconds(10.0));
    assert!(bench.curves().len() - before >= 199);
}

#[test]
fn an_unsound_sample_in_shared_memory_is_no_panic() {
    let mut bench = Bench::new();
    bench.fly(0.5, |bench, t| {
        bench.telemetry(t, MODE_MISSION, Vector3::zeros(), Vector3::zeros());
    });
    let mut approved = ApprovedTrajectory {
        trajectory: flight(1, bench.now, Vector3::zeros(), Vector3::x(), 1.0),
        ..ApprovedTrajectory::default()
    };
    approved.trajectory.len = u32::MAX;
    approved.trajectory.reaches_goal = Flag::YES;
    approved.trajectory.start.ns = u64::MAX;
    bench.approved = Some(Sample::new(approved, bench.now));
    bench.step();
    bench.idle_until(bench.now.plus_seconds(0.1));
    assert!(bench.last_curve().pos_x.iter().all(|x| x.is_finite()));
}

#[test]
fn a_baton_with_a_time_to_come_does_not_silence_the_next_one() {
    let mut bench = Bench::new();
    bench.fly(1.0, |bench, t| {
        bench.telemetry(t, MODE_HOLD, Vector3::zeros(), Vector3::zeros());
    });
    let mut encoder = Encoder::new();
    let mut bytes = HandoverState::of(&bench.gateway, &encoder, Stamps::default()).to_bytes();
    bytes[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    let handover = HandoverState::of_bytes(&bytes).unwrap();
    handover.hand_to(bench.now, &mut bench.gateway, &mut encoder);
    let before = bench.curves().len();
    bench.idle_until(bench.now.plus_seconds(1.0));
    assert!(bench.curves().len() - before >= 19);
}
