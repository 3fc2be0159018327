//! A pilot who has flown by hand may switch to the mission at speed. The first plan then departs from the motion that the
//! vehicle has: with a plan from rest it would overshoot the place that was certified for it.

use jink_emulated_ground_station::{Make, Outcome, Phase};
use jink_shared_types::vehicle::NavMode;
use jink_tests::campaign::{Cell, setup};
use jink_tests::flights::Flights;
use jink_tests::lockstep::LockStep;
use mavlink::dialect::{MANUAL_CONTROL_DATA, MavMessage};

/// How long the pilot flies, away from the trees (s).
const BY_HAND_S: f64 = 3.0;
/// Between two messages of the sticks (s).
const STICKS_PERIOD_S: f64 = 0.05;
/// What the reference may differ from the vehicle's own motion at the hand-over (m/s, m): what a change of speed with
/// 3 m/s2 makes between the measurement and the departure.
const LEAP_MPS: f64 = 1.0;
const LEAP_M: f64 = 0.7;

/// Full stick is 10 m/s.
fn back(stick: i16) -> MavMessage {
    MavMessage::MANUAL_CONTROL(MANUAL_CONTROL_DATA {
        x: -stick,
        z: 500,
        target: 1,
        ..MANUAL_CONTROL_DATA::default()
    })
}

pub fn forest_flights() -> Flights {
    let mut flights = Flights::new();
    for (seed, stick, is_plannable) in [(1, 200, true), (2, 300, true), (3, 600, false)] {
        flights.add(&format!("seed {seed}"), seed == 2, move || {
            // Faster than any plan it is stopped; the autopilot brakes too hard by itself by then to be met exactly.
            let cell = Cell {
                limit_s: 180.0,
                ..Cell::forest().unwrap()
            };
            let mut flight = LockStep::new(setup(&cell, seed).unwrap()).unwrap();
            let (mut from_s, mut next_s) = (None, 0.0);
            let mut entry = None;
            while flight.outcome().is_none() {
                flight.step();
                let time_s = flight.truth().time_s;
                if flight.station().progress().phase != Phase::Mission {
                    continue;
                }
                let hand_over_s = *from_s.get_or_insert(time_s) + BY_HAND_S;
                if time_s < hand_over_s {
                    if time_s >= next_s {
                        next_s = time_s + STICKS_PERIOD_S;
                        if flight.truth().mode.get() != NavMode::Position {
                            flight.send(Make::Px4.mode_command(NavMode::Position, 1).unwrap());
                        }
                        flight.send(back(stick));
                    }
                    continue;
                }
                if flight.truth().mode.get() != NavMode::Mission {
                    flight.send(Make::Px4.mode_command(NavMode::Mission, 1).unwrap());
                }
                if entry.is_none()
                    && let Some(reference) = flight.reference()
                {
                    let truth = flight.truth();
                    let speed_mps = truth.velocity.vector().norm();
                    let leap_mps = (reference.velocity.vector() - truth.velocity.vector()).norm();
                    let leap_m = (reference.position.vector() - truth.position.vector()).norm();
                    entry = Some((speed_mps, leap_mps, leap_m));
                }
            }
            let (speed_mps, leap_mps, leap_m) = entry.unwrap();
            println!("seed {seed}: handed over at {speed_mps:.2} m/s, leap {leap_mps:.2} m/s, {leap_m:.2} m");
            assert!(speed_mps > 0.5, "seed {seed}: {speed_mps} m/s is no motion");
            assert_eq!(speed_mps < 3.0, is_plannable, "seed {seed}: {speed_mps} m/s");
            assert!(
                !is_plannable || leap_mps < LEAP_MPS && leap_m < LEAP_M,
                "seed {seed}: {leap_mps} m/s, {leap_m} m"
            );
            assert_eq!(flight.truth().collisions, 0, "seed {seed}");
            assert_eq!(flight.outcome(), Some(&Outcome::Done), "seed {seed}");
        });
    }
    flights
}

#[test]
fn and_the_plan_departs_from_it() {
    forest_flights().fly_some();
}
