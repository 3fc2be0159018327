//! Where the autopilot only follows setpoints, jink takes its mission over in the air, flies it, and gives it back.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use jink_mavlink_gateway::ProfileName;
use jink_shared_types::vehicle::NavMode;
use jink_simulator::ground_station::{Outcome, mode_command};
use jink_tests::campaign::{Cell, FlightOutcome, fly_as, setup};
use jink_tests::lockstep::{FlightSetup, LockStep};

fn cell() -> Cell {
    Cell {
        kind: "forest".parse().unwrap(),
        density_per_m2: None,
        speed_mps: 3.0,
        limit_s: 120.0,
    }
}

fn offboard(seed: u64) -> FlightSetup {
    let mut setup = setup(&cell(), seed).unwrap();
    setup.profile = ProfileName::Px4Offboard;
    setup.autopilot.parameters.push(("COM_OBS_AVOID".into(), 0.0));
    setup
}

/// In OFFBOARD and well on its way.
fn under_way(setup: FlightSetup) -> LockStep {
    let mut flight = LockStep::new(setup).unwrap();
    while flight.truth().position.x_m < 8.0 {
        flight.step();
    }
    assert_eq!(flight.truth().mode.get(), NavMode::Offboard);
    flight
}

fn fly_for(flight: &mut LockStep, seconds: f64) {
    let end_s = flight.truth().time_s + seconds;
    while flight.truth().time_s < end_s {
        flight.step();
    }
}

#[test]
fn through_a_forest_in_offboard() {
    for seed in [1, 2, 3, 4] {
        let report = fly_as(offboard(seed), 3.0).unwrap();
        println!("{report:?}");
        assert_eq!(report.outcome, FlightOutcome::Goal, "{report:?}");
        assert_eq!((report.collisions, report.hold_count), (0, 0), "{report:?}");
        assert!(report.setpoint_gap_ms <= 100.0, "{report:?}");
    }
}

/// It knows neither mission nor mode at first, and what is committed is flown on meanwhile.
#[test]
fn a_gateway_that_is_restarted_in_flight_goes_on_at_the_current_item() {
    let mut flight = under_way(offboard(1));
    for _ in 0..3 {
        flight.restart_gateway();
        fly_for(&mut flight, 3.0);
        assert_eq!(flight.truth().mode.get(), NavMode::Offboard);
    }
    while flight.outcome().is_none() {
        flight.step();
    }
    assert_eq!(flight.outcome(), Some(&Outcome::Done));
    assert_eq!(flight.truth().collisions, 0);
}

#[test]
fn a_pilot_who_takes_over_is_left_alone_until_he_lets_the_mission_be_flown_again() {
    let mut setup = offboard(1);
    setup.plan.resume = false;
    let mut flight = under_way(setup);
    flight.send(mode_command(NavMode::Hold, 1));
    fly_for(&mut flight, 2.0);
    for _ in 0..2500 {
        assert_eq!(flight.truth().mode.get(), NavMode::Hold);
        flight.step();
    }
    flight.send(mode_command(NavMode::Mission, 1));
    fly_for(&mut flight, 4.0);
    assert_eq!(flight.truth().mode.get(), NavMode::Offboard);
    while flight.outcome().is_none() {
        flight.step();
    }
    assert_eq!(flight.outcome(), Some(&Outcome::Done));
    assert_eq!(flight.truth().collisions, 0);
}

/// Somebody chooses the mode himself, hovering: the mission is flown from its current item on.
#[test]
fn whoever_chooses_the_mode_himself_gets_the_mission_flown() {
    let mut flight = LockStep::new(offboard(2)).unwrap();
    while flight.truth().mode.get() != NavMode::Hold || flight.truth().position.z_m > -1.5 {
        flight.step();
    }
    flight.send(mode_command(NavMode::Offboard, 1));
    while flight.truth().position.x_m < 5.0 {
        flight.step();
        assert!(flight.truth().time_s < 90.0, "it does not move");
    }
    assert_eq!(flight.truth().mode.get(), NavMode::Offboard);
}
