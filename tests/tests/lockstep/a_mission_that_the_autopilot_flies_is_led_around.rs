//! Current PX4 flies its own mission and takes velocities and accelerations in: it is led around what stands in its way, and
//! flies on alone where nothing is planned.

use jink_emulated_ground_station::Outcome;
use jink_shared_types::events;
use jink_shared_types::vehicle::NavMode;
use jink_tests::campaign::{Cell, FlightOutcome, fly_as};
use jink_tests::flights::Flights;
use jink_tests::lockstep::LockStep;
use jink_tests::pairing::PX4_DEVIATION;

pub fn forest_flights() -> Flights {
    let mut flights = Flights::new();
    for seed in [1, 2, 3, 4] {
        flights.add(&format!("seed {seed}"), seed == 1, move || {
            let report = fly_as(PX4_DEVIATION.forest(seed).unwrap(), &Cell::forest().unwrap()).unwrap();
            println!("{report:?}");
            assert_eq!(report.outcome, FlightOutcome::Goal, "{report:?}");
            assert_eq!((report.collisions, report.hold_count), (0, 0), "{report:?}");
            assert!(report.setpoint_gap_ms < 100.0, "{report:?}");
        });
    }
    flights
}

#[test]
fn through_a_forest() {
    forest_flights().fly_some();
}

/// The mode is the autopilot's own all the time, and nothing is sent but in its mission.
#[test]
fn the_mission_stays_the_autopilots_and_so_does_the_landing() {
    let mut flight = LockStep::new(PX4_DEVIATION.forest(2).unwrap()).unwrap();
    let mut modes = Vec::new();
    let mut sent_before = 0;
    while flight.outcome().is_none() {
        flight.step();
        let mode = flight.truth().mode.get();
        if modes.last() != Some(&mode) {
            modes.push(mode);
        }
        let sent = flight.autopilot().setpoint_statistics().count;
        if mode == NavMode::Takeoff {
            assert_eq!(sent, 0, "a take-off is the autopilot's own");
        }
        if mode == NavMode::Land && flight.truth().time_s > 1.0 {
            // The change of mode is known within half a second.
            assert!(sent <= sent_before + 60, "a landing, too");
        } else {
            sent_before = sent;
        }
    }
    assert_eq!(flight.outcome(), Some(&Outcome::Done));
    assert!(!modes.contains(&NavMode::Offboard), "{modes:?}");
    assert!(sent_before > 500, "{sent_before}");
    assert_eq!(flight.count(&events::UNGUARDED), 0);
}

pub fn a_gateway_that_is_restarted_leads_on() -> Flights {
    Flights::of_one("a_gateway_that_is_restarted_leads_on", || {
        let mut flight = LockStep::new(PX4_DEVIATION.forest(1).unwrap()).unwrap();
        let mut restarts = 0;
        while flight.outcome().is_none() {
            flight.step();
            if restarts < 3 && flight.truth().position.x_m > 10.0 * f64::from(restarts + 1) {
                flight.board().kill("mavlink_gateway");
                restarts += 1;
            }
        }
        assert_eq!(flight.outcome(), Some(&Outcome::Done));
        assert_eq!((restarts, flight.truth().collisions), (3, 0));
    })
}
