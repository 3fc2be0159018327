//! No ranges, no motion: half a second after the last one the pilot's sticks move nothing, and he is notified; after
//! five the autopilot is asked for Hold. Of several sensors a dead one leaves directions that nobody covers, and nobody
//! flies there.

use jink_shared_types::events::{self, Event};
use jink_shared_types::vehicle::NavMode;
use jink_simulated_world::sensors::{SensorKind, SensorSpec};
use jink_simulated_world::world::{World, WorldKind};
use jink_tests::lockstep::LockStep;
use jink_tests::pairing::PX4_DEVIATION;
use jink_tests::pilot::by_hand;
use std::collections::BTreeSet;
use std::ops::RangeInclusive;

const AHEAD: [i16; 2] = [400, 0];

/// Over an empty plain with planar sensors that look to these directions (deg), each half around.
fn flight(looking_deg: &[f64]) -> LockStep {
    let mut setup = PX4_DEVIATION.forest(1).unwrap();
    setup.plan.resume = false;
    setup.world = World::generate(WorldKind::Empty, 1).unwrap();
    setup.params.set("CP_DIST", 1.5).unwrap();
    setup.params.set("MPC_VEL_MANUAL", 6.0).unwrap();
    for (number, yaw_deg) in looking_deg.iter().enumerate() {
        let mut half = SensorSpec::new(&format!("half_{number}"), SensorKind::Lidar2d);
        half.fov_horizontal_deg = Some(180.0);
        half.yaw_deg = *yaw_deg;
        setup.sensors.push(half);
    }
    // The first one is for the mission's take-off and first leg: it falls silent with the pilot's first stick.
    LockStep::new(setup).unwrap()
}

/// When an event was first raised after `from_s` (s since then).
fn after(flight: &LockStep, event: &Event, from_s: f64) -> Option<f64> {
    let mut events = flight.events.iter();
    events
        .find(|(time_s, sample)| sample.id == event.id && *time_s >= from_s)
        .map(|(time_s, _)| time_s - from_s)
}

fn speed_mps(flight: &LockStep) -> f64 {
    flight.truth().velocity.vector().xy().norm()
}

/// Clouds count for a quarter of a second, scans for half of one; when the sensors fall silent the last one is up to a tenth old.
#[test]
fn half_a_second_without_any_range_stops_and_five_seconds_hold() {
    falls_silent(&[], 0.15..=0.35);
    falls_silent(&[0.0, 180.0], 0.4..=0.65);
}

fn falls_silent(looking_deg: &[f64], reported_within_s: RangeInclusive<f64>) {
    let mut flight = flight(looking_deg);
    let mut silent_s = 0.0;
    let (mut stopped_s, mut held_s) = (None, None);
    by_hand(&mut flight, 20.0, |flight, t| {
        let truth = *flight.truth();
        if t <= 4.0 && !looking_deg.is_empty() {
            flight.silent_sensors = BTreeSet::from([0]);
        }
        if t > 4.0 && silent_s == 0.0 {
            assert!(speed_mps(flight) > 1.5, "it is flown: {} m/s", speed_mps(flight));
            flight.silent_sensors = BTreeSet::from([0, 1, 2]);
            silent_s = truth.time_s;
        }
        if silent_s > 0.0 {
            let since_s = truth.time_s - silent_s;
            if speed_mps(flight) < 0.2 {
                stopped_s.get_or_insert(since_s);
            }
            if truth.mode == NavMode::Hold {
                held_s.get_or_insert(since_s);
            }
        }
        AHEAD
    });
    let reported_s = after(&flight, &events::PREVENTION_BLIND, silent_s).unwrap();
    let asked_s = after(&flight, &events::PREVENTION_HOLDS, silent_s).unwrap();
    let (stopped_s, held_s) = (stopped_s.unwrap(), held_s.unwrap());
    println!(
        "reported after {reported_s:.2} s, at rest after {stopped_s:.2} s, Hold asked for after {asked_s:.2} s, in Hold after {held_s:.2} s"
    );
    assert!(reported_within_s.contains(&reported_s), "{reported_s}");
    assert!((4.85..=5.15).contains(&asked_s), "{asked_s}");
    assert!(stopped_s < 3.5 && held_s < 6.0, "{stopped_s} {held_s}");
    assert_eq!(flight.count(&events::PREVENTION_BLIND), 1, "reported once");
}

#[test]
fn ranges_that_come_back_let_go() {
    let mut flight = flight(&[]);
    let mut later_mps = 0.0;
    by_hand(&mut flight, 14.0, |flight, t| {
        flight.silent_sensors = if (4.0..7.0).contains(&t) {
            BTreeSet::from([0])
        } else {
            BTreeSet::new()
        };
        if t > 13.0 {
            later_mps = speed_mps(flight);
        }
        AHEAD
    });
    assert_eq!(flight.count(&events::PREVENTION_BLIND), 1);
    assert_eq!(flight.count(&events::PREVENTION_HOLDS), 0);
    assert!(later_mps > 1.5, "{later_mps} m/s");
}

#[test]
fn of_two_sensors_the_dead_one_leaves_directions_where_nobody_flies() {
    // Half ahead and half behind; the one that sees all around is silent from the beginning of the manual flight.
    let mut flight = flight(&[0.0, 180.0]);
    let (mut ahead_mps, mut refused_mps, mut back_mps) = (0.0f64, 0.0f64, 0.0f64);
    by_hand(&mut flight, 18.0, |flight, t| {
        flight.silent_sensors = if t < 6.0 {
            BTreeSet::from([0])
        } else {
            BTreeSet::from([0, 1])
        };
        match t {
            t if t < 6.0 => ahead_mps = speed_mps(flight),
            // What it was flying with is braked away.
            t if t < 10.0 => {}
            t if t < 12.0 => refused_mps = refused_mps.max(speed_mps(flight)),
            _ => back_mps = back_mps.max(speed_mps(flight)),
        }
        if t < 12.0 { AHEAD } else { [-400, 0] }
    });
    println!(
        "both {ahead_mps:.2} m/s, into the dead one's sectors {refused_mps:.2} m/s, away from them {back_mps:.2} m/s"
    );
    assert!(ahead_mps > 1.5, "with both it flies ahead: {ahead_mps} m/s");
    assert!(refused_mps < 0.2, "nobody looks ahead: {refused_mps} m/s");
    assert!(back_mps > 1.2, "behind is seen: {back_mps} m/s");
    assert_eq!(flight.count(&events::PREVENTION_BLIND), 0, "not all is lost");
}
