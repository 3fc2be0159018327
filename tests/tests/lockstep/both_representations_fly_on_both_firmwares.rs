//! The trajectory interface in all four combinations: curves or waypoints, on PX4 before and after its time-out fixes.

use jink_emulated_ground_station::{Ending, Outcome};
use jink_emulated_px4::{Firmware, Px4Config, Variant};
use jink_mavlink_link::profile_name::Representation;
use jink_simulator::autopilot::AutopilotConfig;
use jink_tests::campaign::{Cell, FlightOutcome, fly_as, setup};
use jink_tests::flights::Flights;
use jink_tests::lockstep::LockStep;
use jink_tests::pairing::PX4_TRAJECTORY;

fn forest() -> Cell {
    Cell::forest().unwrap()
}

/// A ground station behind an autopilot that passes messages on: its radio carries the curves, so fewer of them are sent.
pub fn radio_flights() -> Flights {
    let mut flights = Flights::new();
    for seed in [1, 2, 3] {
        flights.add(&format!("seed {seed}"), false, move || {
            let mut setup = PX4_TRAJECTORY.forest(seed).unwrap();
            setup.autopilot = setup.autopilot.with_parameter("MAV_HB_FORW_EN", 1.0);
            setup.plan.ending = Ending::Hold;
            let mut flight = LockStep::new(setup).unwrap();
            assert!(flight.run_until(60.0, |f| f.truth().position.x_m > 3.0));
            let (before, since) = (flight.truth().setpoints, flight.now());
            while flight.outcome().is_none() {
                flight.step();
            }
            let truth = flight.truth();
            let rate_hz = (truth.setpoints - before) as f64 / flight.now().seconds_since(since);
            let what = format!("{seed}: {rate_hz} Hz, {:?}, {truth:?}", flight.outcome());
            assert_eq!(flight.outcome(), Some(&Outcome::Done), "{what}");
            assert!((10.0..13.0).contains(&rate_hz), "{what}");
            assert_eq!((truth.collisions, truth.hold_count), (0, 0), "{what}");
            assert!(truth.setpoint_gap_max_s <= 0.1, "{what}");
        });
    }
    flights
}

pub fn forest_flights() -> Flights {
    let mut flights = Flights::new();
    for representation in [Representation::Bezier, Representation::Waypoints] {
        for variant in [Variant::A, Variant::B] {
            for seed in [1, 2, 3] {
                flights.add(
                    &format!("{representation:?} {variant:?} seed {seed}"),
                    (representation, variant, seed) == (Representation::Waypoints, Variant::B, 1),
                    move || {
                        let cell = forest();
                        let mut setup = setup(&cell, seed).unwrap();
                        setup.representation = representation;
                        setup.autopilot = AutopilotConfig::Px4(Px4Config {
                            firmware: Firmware::Trajectory(variant),
                            ..Px4Config::default()
                        });
                        let report = fly_as(setup, &cell).unwrap();
                        let what = format!("{representation:?} on {variant:?}: {report:?}");
                        println!("{what}");
                        assert_eq!(report.outcome, FlightOutcome::Goal, "{what}");
                        assert_eq!((report.collisions, report.hold_count), (0, 0), "{what}");
                        assert!(report.setpoint_gap_ms <= 100.0, "{what}");
                    },
                );
            }
        }
    }
    flights
}

#[test]
fn through_a_forest() {
    forest_flights().fly_some();
}
