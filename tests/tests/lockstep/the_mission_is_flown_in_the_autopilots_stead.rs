//! Where the autopilot only follows setpoints, jink takes its mission over in the air, flies it, and gives it back: on PX4 of
//! today and of 2021 in OFFBOARD, on ArduCopter in GUIDED.

use jink_emulated_ground_station::Outcome;
use jink_shared_types::events;
use jink_shared_types::vehicle::NavMode;
use jink_tests::campaign::{Cell, FlightOutcome, fly_as};
use jink_tests::flights::Flights;
use jink_tests::lockstep::{FlightSetup, LockStep};
use jink_tests::pairing::{COPTER, FOLLOWERS, PX4_2021_OFFBOARD, PX4_CURRENT, Pairing};
use mavlink::dialect::{COMMAND_LONG_DATA, MavCmd, MavMessage};
use nalgebra::Vector3;

/// Following setpoints, and well on its way.
fn under_way(setup: FlightSetup) -> LockStep {
    let mut flight = LockStep::new(setup).unwrap();
    while flight.truth().position.x_m < 8.0 {
        flight.step();
        assert_eq!(flight.outcome(), None, "{:?}", flight.station().progress());
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

fn lands_safely(flight: &mut LockStep, whose: Pairing) {
    while flight.outcome().is_none() {
        flight.step();
    }
    assert_eq!(flight.outcome(), Some(&Outcome::Done), "{whose:?}");
    assert_eq!(flight.truth().collisions, 0, "{whose:?}");
    assert_eq!(flight.autopilot().aborted(), None, "{whose:?}");
    assert_eq!(flight.count(&events::SETPOINTS_IGNORED), 0, "{whose:?}");
}

pub fn forest_flights() -> Flights {
    let mut flights = Flights::new();
    for whose in FOLLOWERS {
        for seed in [1, 2, 3, 4] {
            flights.add(
                &format!("{} seed {seed}", whose.name()),
                (whose, seed) == (PX4_CURRENT, 1),
                move || {
                    let report = fly_as(whose.forest(seed).unwrap(), &Cell::forest().unwrap()).unwrap();
                    println!("{} {report:?}", whose.autopilot);
                    assert_eq!(report.outcome, FlightOutcome::Goal, "{whose:?} {report:?}");
                    assert_eq!(
                        (report.collisions, report.hold_count),
                        (0, 0),
                        "{whose:?} {report:?}"
                    );
                    assert!(report.setpoint_gap_ms <= 100.0, "{whose:?} {report:?}");
                },
            );
        }
    }
    flights
}

#[test]
fn through_a_forest() {
    forest_flights().fly_some();
}

/// It knows neither mission nor mode at first, and what is committed is flown on meanwhile.
pub fn restart_flights() -> Flights {
    let mut flights = Flights::new();
    for whose in FOLLOWERS {
        flights.add(whose.name(), false, move || {
            let mut flight = under_way(whose.forest(1).unwrap());
            for _ in 0..3 {
                flight.board().kill("mavlink_gateway");
                fly_for(&mut flight, 3.0);
                assert_eq!(flight.truth().mode.get(), NavMode::Offboard, "{whose:?}");
            }
            lands_safely(&mut flight, whose);
        });
    }
    flights
}

pub fn takeover_flights() -> Flights {
    let mut flights = Flights::new();
    for whose in FOLLOWERS {
        flights.add(whose.name(), false, move || {
            let mut setup = whose.forest(1).unwrap();
            setup.plan.resume = false;
            let mut flight = under_way(setup);
            whose.command_mode(&mut flight, NavMode::Hold);
            fly_for(&mut flight, 2.0);
            for _ in 0..2500 {
                assert_eq!(flight.truth().mode.get(), NavMode::Hold, "{whose:?}");
                flight.step();
            }
            whose.command_mode(&mut flight, NavMode::Mission);
            fly_for(&mut flight, 4.0);
            assert_eq!(flight.truth().mode.get(), NavMode::Offboard, "{whose:?}");
            lands_safely(&mut flight, whose);
        });
    }
    flights
}

/// Somebody chooses the mode himself, hovering: where missions are not taken over it is flown from its current item on, and else
/// the place is held, since nobody has asked for a flight.
pub fn whoever_chooses_the_mode_himself_gets_the_mission_flown_only_where_none_is_taken_over() -> Flights {
    Flights::of_one(
        "whoever_chooses_the_mode_himself_gets_the_mission_flown_only_where_none_is_taken_over",
        || {
            for whose in [PX4_CURRENT, PX4_2021_OFFBOARD] {
                for takes_missions in [false, true] {
                    let mut setup = whose.forest(2).unwrap();
                    setup.takes_missions = takes_missions;
                    let mut flight = LockStep::new(setup).unwrap();
                    while flight.truth().mode.get() != NavMode::Hold || flight.truth().position.z_m > -1.5 {
                        flight.step();
                    }
                    flight.silent_station = takes_missions;
                    whose.command_mode(&mut flight, NavMode::Offboard);
                    let end_s = flight.truth().time_s + 20.0;
                    while flight.truth().position.x_m < 5.0 && flight.truth().time_s < end_s {
                        flight.step();
                    }
                    assert_eq!(flight.truth().mode.get(), NavMode::Offboard, "{whose:?}");
                    assert_eq!(flight.truth().position.x_m < 1.0, takes_missions, "{whose:?}");
                    assert_eq!(
                        flight.count(&events::NO_GOAL),
                        usize::from(takes_missions),
                        "{whose:?}"
                    );
                }
            }
        },
    )
}

fn command(command: MavCmd, param1: f32, param7: f32) -> MavMessage {
    MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        target_system: 1,
        target_component: 1,
        command,
        param1,
        param7,
        ..COMMAND_LONG_DATA::default()
    })
}

/// The first setpoint would end ArduCopter's take-off wherever it is. Then the place is held, without a mission.
#[test]
fn a_take_off_in_guided_is_not_broken_off() {
    let mut flight = LockStep::new(COPTER.forest(1).unwrap()).unwrap();
    flight.silent_station = true;
    fly_for(&mut flight, 10.0);
    COPTER.command_mode(&mut flight, NavMode::Offboard);
    fly_for(&mut flight, 3.0);
    flight.send(command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0));
    fly_for(&mut flight, 0.5);
    flight.send(command(MavCmd::MAV_CMD_NAV_TAKEOFF, 0.0, 5.0));
    let begin_s = flight.truth().time_s;
    while flight.truth().position.z_m > -4.8 {
        flight.step();
        assert!(flight.truth().time_s < begin_s + 20.0, "{:?}", flight.truth());
    }
    assert_eq!(flight.truth().mode.get(), NavMode::Offboard);
    fly_for(&mut flight, 3.0);
    for _ in 0..1000 {
        flight.step();
        let position = flight.truth().position;
        let away_m = (position.vector() - Vector3::new(0.0, 0.0, -5.0)).norm();
        assert!(away_m < 0.3, "{position:?}");
    }
    // Without a goal nothing more is sent once the autopilot holds the place: a station's go-to would be lost by it.
    let setpoints = flight.autopilot().setpoint_statistics();
    assert!((1..150).contains(&setpoints.count), "{setpoints:?}");
}
