//! One of several range sensors falls silent in the middle of a forest: the flight goes on in what the others see,
//! slower, and the pilot is notified. Without any sensor the vehicle comes to rest, and goes on when one is back.

use jink_emulated_ground_station::Outcome;
use jink_shared_types::events::{self, Event};
use jink_shared_types::vehicle::NavMode;
use jink_simulated_world::sensors::{SensorKind, SensorSpec};
use jink_tests::campaign::{Cell, default_sensors, setup};
use jink_tests::flights::Flights;
use jink_tests::lockstep::LockStep;
use std::collections::BTreeSet;

fn flight(seed: u64) -> LockStep {
    let cell = Cell {
        limit_s: 240.0,
        ..Cell::forest().unwrap()
    };
    let mut setup = setup(&cell, seed).unwrap();
    setup.sensors = default_sensors();
    setup.sensors.push(SensorSpec::new("planar", SensorKind::Lidar2d));
    LockStep::new(setup).unwrap()
}

/// Steps for `seconds` of the mission, or to the end of the flight; the highest speed.
fn fly(flight: &mut LockStep, seconds: f64) -> f64 {
    let end_s = flight.truth().time_s + seconds;
    let mut top_mps = 0.0f64;
    while flight.outcome().is_none() && flight.truth().time_s < end_s {
        flight.step();
        top_mps = top_mps.max(flight.truth().velocity.vector().norm());
        assert_eq!(flight.truth().collisions, 0, "at {:.1} s", flight.truth().time_s);
    }
    top_mps
}

fn reach_the_mission(flight: &mut LockStep) {
    while flight.truth().mode.get() != NavMode::Mission {
        flight.step();
    }
    fly(flight, 8.0);
}

fn reported(flight: &LockStep, event: &Event) -> usize {
    flight.count(event)
}

pub fn one_of_two_flights() -> Flights {
    let mut flights = Flights::new();
    for seed in 1..=4 {
        flights.add(&format!("seed {seed}"), seed == 1, move || {
            let mut flight = flight(seed);
            reach_the_mission(&mut flight);
            assert_eq!(reported(&flight, &events::SENSOR_LOST), 0);
            flight.silent_sensors = BTreeSet::from([1]);
            // The committed trajectory is flown on, and was made for the higher speed.
            fly(&mut flight, 5.0);
            assert_eq!(reported(&flight, &events::SENSOR_LOST), 1, "seed {seed}");
            let slow_mps = fly(&mut flight, 6.0);
            // Half the speed, and what an autopilot that speeds up overshoots.
            assert!(
                slow_mps < 1.5 + 0.3,
                "seed {seed}: {slow_mps} m/s with one sensor of two"
            );
            flight.silent_sensors.clear();
            fly(&mut flight, f64::INFINITY);
            assert_eq!(reported(&flight, &events::SENSOR_BACK), 1, "seed {seed}");
            assert_eq!(flight.outcome(), Some(&Outcome::Done), "seed {seed}");
            assert_eq!(flight.truth().hold_count, 0, "seed {seed}");
        });
    }
    flights
}

#[test]
fn of_two_sensors_one_dies_and_comes_back() {
    one_of_two_flights().fly_some();
}

pub fn all_around_flights() -> Flights {
    let mut flights = Flights::new();
    for seed in 1..=4 {
        flights.add(&format!("seed {seed}"), false, move || {
            let mut flight = flight(seed);
            reach_the_mission(&mut flight);
            flight.silent_sensors = BTreeSet::from([0]);
            fly(&mut flight, 30.0);
            flight.silent_sensors.clear();
            fly(&mut flight, f64::INFINITY);
            assert_eq!(flight.outcome(), Some(&Outcome::Done), "seed {seed}");
            assert_eq!(flight.truth().hold_count, 0, "seed {seed}");
        });
    }
    flights
}

pub fn without_any_flights() -> Flights {
    let mut flights = Flights::new();
    for seed in 1..=4 {
        flights.add(&format!("seed {seed}"), false, move || {
            let mut flight = flight(seed);
            reach_the_mission(&mut flight);
            flight.silent_sensors = BTreeSet::from([0, 1]);
            fly(&mut flight, 1.0);
            // What was committed with the last ranges is flown to its end at rest, and nothing is committed after it.
            let last = flight.approved().trajectory;
            let left_s = last.end().seconds_since(flight.now());
            fly(&mut flight, left_s.max(0.0) + 1.0);
            let rest_mps = fly(&mut flight, 4.0);
            assert_eq!(flight.approved().trajectory.id, last.id, "seed {seed}");
            assert!(rest_mps < 0.3, "seed {seed}: {rest_mps} m/s without any sensor");
            flight.silent_sensors.clear();
            fly(&mut flight, f64::INFINITY);
            assert_eq!(flight.outcome(), Some(&Outcome::Done), "seed {seed}");
            assert_eq!(flight.truth().hold_count, 0, "seed {seed}");
        });
    }
    flights
}
