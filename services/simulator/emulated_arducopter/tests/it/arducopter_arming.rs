//! Arming, take-off, landing and what the motors do by themselves.

use crate::support::copter::{CopterFlight, VELOCITY, at, level, setpoint};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::modes::arducopter::Mode;
use mavlink::dialect::*;

const ACCEPTED: MavResult = MavResult::MAV_RESULT_ACCEPTED;
const FAILED: MavResult = MavResult::MAV_RESULT_FAILED;

#[test]
fn a_companion_alone_sets_guided_arms_and_takes_off_to_5_m_in_9_4_s() {
    let mut flight = CopterFlight::with(&[]);
    flight.run(6.0);
    assert_eq!(flight.set_mode(Mode::Guided), ACCEPTED);
    assert_eq!(flight.arm(), ACCEPTED);
    assert_eq!(flight.take_off(5.0), ACCEPTED);
    let took_s = flight.run_until(20.0, |f| f.position().z < -4.96).unwrap();
    assert!((took_s - 9.4).abs() < 0.3 * 9.4, "{took_s}");
    flight.run(5.0);
    assert!((flight.position().z + 5.0).abs() < 0.1);
    assert_eq!(flight.copter.aborted(), None);
}

#[test]
fn before_there_is_a_position_guided_and_arming_are_refused() {
    let mut flight = CopterFlight::with(&[]);
    flight.run(1.0);
    assert_eq!(flight.set_mode(Mode::Guided), FAILED);
    assert_eq!(flight.arm(), FAILED);
    assert!(
        flight
            .texts
            .iter()
            .any(|t| t == "Mode change to GUIDED failed: requires position")
    );
    flight.run(5.0);
    assert_eq!(flight.set_mode(Mode::Guided), ACCEPTED);
    assert_eq!(flight.arm(), ACCEPTED);
}

#[test]
fn a_take_off_needs_guided_motors_and_the_ground() {
    let mut flight = CopterFlight::with(&[]);
    flight.run(6.0);
    assert_eq!(flight.take_off(5.0), FAILED);
    flight.set_mode(Mode::Guided);
    assert_eq!(flight.take_off(5.0), FAILED);
    flight.arm();
    assert_eq!(flight.take_off(5.0), ACCEPTED);
    flight.run(12.0);
    assert_eq!(flight.take_off(9.0), FAILED);
}

#[test]
fn setpoints_do_not_lift_a_vehicle_from_the_ground() {
    let mut flight = CopterFlight::with(&[]);
    flight.run(6.0);
    flight.set_mode(Mode::Guided);
    flight.arm();
    let up = nalgebra::Vector3::new(0.0, 0.0, -2.0);
    flight.stream(5.0, 50.0, |_| {
        setpoint(VELOCITY, at(0.0, 0.0), up, level(0.0, 0.0))
    });
    assert!(flight.copter.is_landed() && flight.position().z == 0.0);
}

#[test]
fn armed_and_forgotten_it_disarms_after_ten_seconds() {
    let mut flight = CopterFlight::with(&[]);
    flight.run(6.0);
    flight.set_mode(Mode::Guided);
    flight.arm();
    let took_s = flight.run_until(15.0, |f| !f.copter.is_armed()).unwrap();
    assert!((took_s - 10.0).abs() < 0.1, "{took_s}");
}

#[test]
fn after_a_landing_it_disarms_by_itself_and_not_in_flight() {
    let mut flight = CopterFlight::airborne(&[]);
    let disarm = [0.0; 7];
    assert_eq!(flight.ask(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, disarm), FAILED);
    assert_eq!(flight.set_mode(Mode::Land), ACCEPTED);
    let took_s = flight.run_until(30.0, |f| !f.copter.is_armed()).unwrap();
    assert!(took_s > 5.0 / 0.5, "{took_s}");
    assert!(flight.copter.is_landed());
    assert!(flight.position().xy().norm() < 0.2);
}

#[test]
fn modes_that_fly_by_themselves_cannot_be_armed_in() {
    let mut flight = CopterFlight::with(&[]);
    flight.run(6.0);
    for (mode, result) in [
        (Mode::Brake, FAILED),
        (Mode::Land, FAILED),
        (Mode::Loiter, ACCEPTED),
    ] {
        assert_eq!(flight.set_mode(mode), ACCEPTED);
        assert_eq!(flight.arm(), result, "{mode:?}");
    }
}
