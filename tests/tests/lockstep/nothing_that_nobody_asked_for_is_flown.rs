//! GUIDED chosen on the ground or in the air, with or without a mission on board: nobody has started one, so none is flown, home
//! is no waypoint, and a take-off is not broken off. A mission that was started is flown once.

use jink_emulated_ground_station::{Outcome, Phase};
use jink_shared_types::events;
use jink_shared_types::vehicle::NavMode;
use jink_tests::flights::Flights;
use jink_tests::lockstep::LockStep;
use jink_tests::pairing::COPTER;
use mavlink::dialect::{COMMAND_LONG_DATA, MavCmd, MavMessage};
use nalgebra::Vector3;

/// Height of the take-offs (m).
const HEIGHT_M: f64 = 5.0;

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

/// Armed in GUIDED, the take-off commanded `after_s` after the start; the mission is on board if `with_mission`.
fn taking_off(after_s: f64, with_mission: bool) -> LockStep {
    let mut flight = LockStep::new(COPTER.forest(1).unwrap()).unwrap();
    flight.silent_station = !with_mission;
    if with_mission {
        assert!(flight.run_until(60.0, |f| f.station().progress().phase > Phase::Upload));
        flight.silent_station = true;
    }
    let wait_s = after_s - flight.truth().time_s;
    flight.run(wait_s.max(0.0));
    COPTER.command_mode(&mut flight, NavMode::Offboard);
    flight.run(0.1);
    flight.send(command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0));
    flight.run(0.1);
    assert!(flight.autopilot().is_armed());
    flight.send(command(MavCmd::MAV_CMD_NAV_TAKEOFF, 0.0, HEIGHT_M as f32));
    flight
}

fn climbs(flight: &mut LockStep) {
    let up = flight.run_until(20.0, |f| f.truth().position.z_m < 0.2 - HEIGHT_M);
    assert!(up, "{:?}", flight.truth());
}

fn stays(flight: &mut LockStep, seconds: f64) {
    let place = Vector3::new(0.0, 0.0, -HEIGHT_M);
    for _ in 0..(seconds * 250.0) as usize {
        flight.step();
        let truth = flight.truth();
        let away_m = (truth.position.vector() - place).norm();
        assert!(away_m < 0.4, "{truth:?}");
        assert_eq!(truth.mode.get(), NavMode::Offboard, "{truth:?}");
    }
}

pub fn hold_flights() -> Flights {
    let mut flights = Flights::new();
    for with_mission in [false, true] {
        flights.add(&format!("with mission {with_mission}"), with_mission, move || {
            let mut flight = taking_off(12.0, with_mission);
            climbs(&mut flight);
            flight.run(2.0);
            stays(&mut flight, 20.0);
        });
    }
    flights
}

#[test]
fn after_a_take_off_in_guided_the_place_is_held_with_a_mission_on_board_and_without() {
    hold_flights().fly_some();
}

/// The autopilot has just reported its position, and whether it stands or flies is not known yet.
pub fn early_flights() -> Flights {
    let mut flights = Flights::new();
    for after_s in [5.2, 5.6, 6.0, 6.5, 7.5] {
        flights.add(
            &format!("after {after_s} s"),
            [5.2, 6.5].contains(&after_s),
            move || {
                climbs(&mut taking_off(after_s, false));
            },
        );
    }
    flights
}

#[test]
fn a_take_off_soon_after_the_start_is_not_broken_off() {
    early_flights().fly_some();
}

pub fn restart_flights() -> Flights {
    let mut flights = Flights::new();
    for restarted_s in [0.0, 1.0, 2.0, 3.0, 5.0] {
        flights.add(
            &format!("restarted at {restarted_s} s"),
            [0.0, 2.0].contains(&restarted_s),
            move || {
                let mut flight = taking_off(12.0, false);
                flight.run(restarted_s);
                flight.board().kill("mavlink_gateway");
                climbs(&mut flight);
                flight.run(2.0);
                stays(&mut flight, 5.0);
            },
        );
    }
    flights
}

#[test]
fn a_gateway_that_is_restarted_on_the_ground_or_in_the_climb_does_not_break_it_off() {
    restart_flights().fly_some();
}

/// In GUIDED on the ground ArduCopter reports a target that nobody has sent, and nothing is wrong with it.
#[test]
fn guided_on_the_ground_is_no_alarm() {
    let mut flight = LockStep::new(COPTER.forest(1).unwrap()).unwrap();
    flight.silent_station = true;
    flight.run(12.0);
    COPTER.command_mode(&mut flight, NavMode::Offboard);
    flight.run(10.0);
    flight.send(command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0));
    flight.run(5.0);
    assert_eq!(flight.count(&events::SETPOINTS_IGNORED), 0);
}

/// The autopilot begins at the first item whenever it is given the mission back; all the same it is flown once, and landed.
pub fn a_mission_that_begins_anew_in_auto_is_flown_once() -> Flights {
    Flights::of_one("a_mission_that_begins_anew_in_auto_is_flown_once", || {
        let mut setup = COPTER.forest(2).unwrap();
        setup.autopilot = setup.autopilot.with_parameter("MIS_RESTART", 1.0);
        let mut flight = LockStep::new(setup).unwrap();
        let (mut changes, mut before) = (0, NavMode::Unknown);
        while flight.outcome().is_none() {
            flight.step();
            let mode = flight.truth().mode.get();
            changes += u32::from(mode != before);
            before = mode;
        }
        assert_eq!(flight.outcome(), Some(&Outcome::Done));
        assert_eq!(flight.truth().collisions, 0);
        assert!(changes < 12, "{changes} changes of mode");
    })
}
