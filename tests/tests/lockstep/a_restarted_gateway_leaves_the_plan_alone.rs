//! A gateway that has just been started does not know the mode before the next heartbeat, up to a second later. The plan
//! goes on meanwhile: were it dropped, the next one would begin at rest in the middle of a motion.

use jink_emulated_ground_station::Outcome;
use jink_shared_types::motion::MotionState;
use jink_shared_types::vehicle::NavMode;
use jink_tests::campaign::{Cell, setup};
use jink_tests::flights::Flights;
use jink_tests::lockstep::LockStep;

/// Time between two restarts (s): longer than the time between two heartbeats, and no multiple of it.
const APART_S: f64 = 2.3;
/// The reference moves by no more than this within a step of 4 ms (m): 3.3 m/s and rounding.
const STEP_M: f64 = 0.02;

pub fn forest_flights() -> Flights {
    let mut flights = Flights::new();
    for seed in [3, 102] {
        flights.add(&format!("seed {seed}"), seed == 3, move || {
            let cell = Cell {
                limit_s: 180.0,
                ..Cell::forest().unwrap()
            };
            let setup = setup(&cell, seed).unwrap();
            let mut flight = LockStep::new(setup).unwrap();
            let (mut next_s, mut before, mut restarts) = (0.0, None, 0);
            while flight.outcome().is_none() {
                flight.step();
                let time_s = flight.truth().time_s;
                let flies = flight.truth().mode.get() == NavMode::Mission;
                if flies && time_s > next_s {
                    next_s = time_s + APART_S;
                    restarts += 1;
                    flight.board().kill("mavlink_gateway");
                }
                let reference = flight.reference().filter(|_| flies);
                let dropped = flies && before.is_some() && reference.is_none();
                assert!(!dropped, "seed {seed}: the plan was dropped at {time_s:.2} s");
                if let (Some(before), Some(now)) = (before, reference) {
                    let (before, now): (MotionState, MotionState) = (before, now);
                    let moved_m = (now.position.vector() - before.position.vector()).norm();
                    assert!(
                        moved_m < STEP_M,
                        "seed {seed}: the reference jumped by {moved_m:.2} m at {time_s:.2} s"
                    );
                }
                before = reference;
            }
            assert!(restarts > 5, "seed {seed}: {restarts}");
            assert_eq!(flight.truth().collisions, 0, "seed {seed}");
            assert_eq!(flight.truth().hold_count, 0, "seed {seed}");
            assert_eq!(flight.outcome(), Some(&Outcome::Done), "seed {seed}");
        });
    }
    flights
}

#[test]
fn in_the_middle_of_a_forest_again_and_again() {
    forest_flights().fly_some();
}
