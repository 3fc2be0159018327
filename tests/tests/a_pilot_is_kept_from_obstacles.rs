//! In Position mode, with external avoidance, collision prevention stands between the pilot's sticks and the autopilot: whatever he
//! does, the vehicle keeps its distance.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use jink_shared_types::events;
use jink_shared_types::vehicle::NavMode;
use jink_simulator::ground_station::Phase;
use jink_tests::lockstep::LockStep;
use jink_tests::pairing::PX4_DEVIATION;
use mavlink::dialects::ardupilotmega::{MANUAL_CONTROL_DATA, MavMessage};

/// Between two messages of the sticks (s).
const STICKS_PERIOD_S: f64 = 0.05;
/// Distance that collision prevention keeps (m).
const CP_DIST_M: f64 = 1.5;
/// What of it may be lost: the sensor's noise, a trunk between two rays, the autopilot's overshoot (m).
const LOST_M: f64 = 0.3;

/// Flies the mission until it is under way, then by hand: `stick` says where to, of 1000, at a time since then (s).
fn by_hand(flight: &mut LockStep, seconds: f64, mut stick: impl FnMut(&LockStep, f64) -> [i16; 2]) -> f64 {
    let (mut from_s, mut next_s, mut nearest_m) = (None, 0.0, f64::INFINITY);
    loop {
        flight.step();
        let truth = *flight.truth();
        let was_under_way = from_s.is_some() || truth.mode == NavMode::Mission;
        if flight.station().progress().phase != Phase::Mission || !was_under_way {
            assert_eq!(flight.outcome(), None, "it never was under way");
            continue;
        }
        let time_s = truth.time_s - *from_s.get_or_insert(truth.time_s);
        if time_s >= seconds {
            return nearest_m;
        }
        if truth.time_s >= next_s {
            next_s = truth.time_s + STICKS_PERIOD_S;
            if truth.mode.get() != NavMode::Position {
                PX4_DEVIATION.command_mode(flight, NavMode::Position);
            }
            let [x, y] = stick(flight, time_s);
            flight.send(MavMessage::MANUAL_CONTROL(MANUAL_CONTROL_DATA {
                x,
                y,
                z: 500,
                target: 1,
                ..MANUAL_CONTROL_DATA::default()
            }));
        }
        nearest_m = nearest_m.min(truth.clearance_m);
    }
}

fn forest(seed: u64, distance_m: f64) -> LockStep {
    let mut setup = PX4_DEVIATION.forest(seed).unwrap();
    // The ground station leaves the mode to the pilot.
    setup.plan.resume = false;
    setup.params.set("CP_DIST", distance_m).unwrap();
    setup.params.set("MPC_VEL_MANUAL", 6.0).unwrap();
    LockStep::new(setup).unwrap()
}

#[test]
fn pushed_into_a_forest_at_full_stick_it_touches_nothing() {
    for seed in [1, 2, 3, 4] {
        let mut flight = forest(seed, CP_DIST_M);
        // Ahead, then to all sides.
        let nearest_m = by_hand(&mut flight, 40.0, |_, t| {
            let turn = (t / 5.0).floor() * 0.9;
            [(1000.0 * f64::cos(turn)) as i16, (1000.0 * f64::sin(turn)) as i16]
        });
        let truth = flight.truth();
        let way_m = truth.position.x_m.hypot(truth.position.y_m);
        println!(
            "seed {seed}: nearest {nearest_m:.2} m, {way_m:.1} m away, {} times told",
            flight.count(&events::PREVENTION_ACTS)
        );
        assert_eq!(truth.collisions, 0, "seed {seed}");
        // Told is the distance of the centre, and clearance counts from the hull.
        assert!(nearest_m > CP_DIST_M - 0.3 - LOST_M, "seed {seed}: {nearest_m} m");
        assert!(flight.count(&events::PREVENTION_ACTS) > 0, "seed {seed}");
    }
}

#[test]
fn switched_off_it_says_nothing() {
    let mut flight = forest(1, -1.0);
    let mut counts = Vec::new();
    // Back to where nothing stands.
    by_hand(&mut flight, 8.0, |flight, t| {
        // The change of mode is heard of within half a second.
        if t > 1.0 {
            counts.push(flight.autopilot().setpoint_statistics().count);
        }
        [-300, 0]
    });
    assert!(flight.truth().position.x_m < -3.0, "it is flown");
    assert_eq!(counts.first(), counts.last());
    assert_eq!(flight.count(&events::PREVENTION_ACTS), 0);
}
