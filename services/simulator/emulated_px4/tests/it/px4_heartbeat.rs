//! Which companion PX4 believes in, and what it does without one. Every rule was observed on a real PX4.

#![allow(deprecated)]

use crate::support::{Flight, alone, demand_avoidance};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::Link;
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::*;

const AVOIDANCE: MavSysStatusSensor = MavSysStatusSensor::MAV_SYS_STATUS_OBSTACLE_AVOIDANCE;
const DENIED: &str = "Arming denied! Avoidance system not ready";

/// The avoidance bit in the last SYS_STATUS of the companion's link: present, enabled, healthy.
fn avoidance_bits(flight: &mut Flight) -> (bool, bool, bool) {
    let mut bits = None;
    flight.run_until(1.0, |f| {
        for packet in f.received.iter().filter(|p| p.link == Link::Companion) {
            if let MavMessage::SYS_STATUS(status) = &packet.message {
                bits = Some((
                    status.onboard_control_sensors_present.contains(AVOIDANCE),
                    status.onboard_control_sensors_enabled.contains(AVOIDANCE),
                    status.onboard_control_sensors_health.contains(AVOIDANCE),
                ));
            }
        }
        bits.is_some()
    });
    bits.expect("SYS_STATUS within a second")
}

#[test]
fn without_a_companion_arming_is_refused_with_px4s_text() {
    let mut flight = Flight::with(&[]);
    flight.heartbeat = None;
    flight.run(3.0);
    flight.set_mode(NavMode::Hold);
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_TEMPORARILY_REJECTED);
    flight.step();
    assert_eq!(flight.texts.last().map(String::as_str), Some(DENIED));
    assert_eq!(avoidance_bits(&mut flight), (true, true, false));
    assert!(!flight.autopilot.is_armed());
}

#[test]
fn with_a_healthy_companion_the_bit_is_set_and_arming_succeeds() {
    let mut flight = Flight::with(&[]);
    flight.run(2.0);
    flight.set_mode(NavMode::Hold);
    assert_eq!(avoidance_bits(&mut flight), (true, true, true));
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_ACCEPTED);
}

#[test]
fn without_com_obs_avoid_nobody_needs_a_companion() {
    let mut flight = Flight::with(&[("COM_OBS_AVOID", 0.0)]);
    flight.heartbeat = None;
    flight.run(2.0);
    flight.set_mode(NavMode::Hold);
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_ACCEPTED);
    assert_eq!(avoidance_bits(&mut flight), (false, false, false));
    assert_eq!(flight.questions, 0);
}

#[test]
fn arming_again_within_five_seconds_skips_all_checks() {
    let mut flight = Flight::with(&[]);
    flight.heartbeat = Some((196, MavType::MAV_TYPE_GENERIC, MavState::MAV_STATE_ACTIVE));
    flight.run(2.0);
    flight.set_mode(NavMode::Hold);
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_ACCEPTED);
    // The companion dies and is declared lost; the vehicle is disarmed only after that.
    flight.heartbeat = None;
    flight.run(6.5);
    let disarm = [0.0; 7];
    assert_eq!(
        flight.ask(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, disarm),
        MavResult::MAV_RESULT_ACCEPTED
    );
    flight.run(3.0);
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_ACCEPTED);
    flight.ask(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, disarm);
    flight.run(5.1);
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_TEMPORARILY_REJECTED);
}

#[test]
fn a_lost_companion_of_type_0_refuses_arming_after_six_seconds() {
    let mut flight = Flight::with(&[]);
    flight.heartbeat = Some((196, MavType::MAV_TYPE_GENERIC, MavState::MAV_STATE_ACTIVE));
    flight.run(3.0);
    flight.set_mode(NavMode::Hold);
    flight.heartbeat = None;
    flight.run(5.5);
    assert_eq!(avoidance_bits(&mut flight), (true, true, true));
    flight.run(1.0);
    assert_eq!(avoidance_bits(&mut flight), (true, true, false));
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_TEMPORARILY_REJECTED);
}

#[test]
fn hole_1_a_lost_companion_of_type_18_stays_healthy_and_arming_succeeds() {
    let mut flight = Flight::with(&[]);
    flight.run(3.0);
    flight.set_mode(NavMode::Hold);
    flight.heartbeat = None;
    flight.run(12.0);
    assert!(
        flight
            .texts
            .iter()
            .any(|t| t == "Connection to mission computer lost")
    );
    assert_eq!(avoidance_bits(&mut flight), (true, true, true));
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_ACCEPTED);
}

#[test]
fn a_companion_that_is_not_active_is_unhealthy() {
    for state in [MavState::MAV_STATE_STANDBY, MavState::MAV_STATE_CRITICAL] {
        let mut flight = Flight::with(&[]);
        flight.heartbeat = Some((196, MavType::MAV_TYPE_ONBOARD_CONTROLLER, state));
        flight.run(3.0);
        flight.set_mode(NavMode::Hold);
        assert_eq!(flight.arm(), MavResult::MAV_RESULT_TEMPORARILY_REJECTED);
    }
}

#[test]
fn in_flight_a_silent_heartbeat_changes_nothing_while_replies_continue() {
    let mut flight = Flight::with(&[]);
    flight.start_mission(&[[80.0, 0.0, -5.0]]);
    flight.heartbeat = None;
    flight.run(8.0);
    assert_eq!(flight.autopilot.mode(), NavMode::Mission);
    assert!(flight.autopilot.truth().position.x_m > 15.0);
}

#[test]
fn armed_in_manual_without_sticks_is_a_failsafe() {
    let mut flight = Flight::with(&[]);
    flight.run(2.0);
    assert_eq!(flight.autopilot.mode(), NavMode::Manual);
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_ACCEPTED);
    flight.run(0.5);
    assert!(
        flight
            .texts
            .iter()
            .any(|t| t.contains("No manual control stick input"))
    );
    assert_ne!(flight.autopilot.mode(), NavMode::Manual);
    let critical = flight.run_until(2.0, |f| {
        f.received.iter().any(|p| {
            matches!(&p.message, MavMessage::HEARTBEAT(h)
                if p.header.component_id == 1 && h.system_status == MavState::MAV_STATE_CRITICAL)
        })
    });
    assert!(critical);
    assert!(flight.run_until(15.0, |f| !f.autopilot.is_armed()));
}

#[test]
fn enabled_after_boot_without_a_companion_automatic_modes_fall_back_to_hold() {
    let mut flight = alone();
    flight.start_mission(&[[80.0, 0.0, -5.0]]);
    flight.run(3.0);
    assert_eq!(flight.autopilot.mode(), NavMode::Mission);
    demand_avoidance(&mut flight, 1);
    flight.run(0.2);
    assert_eq!(flight.autopilot.mode(), NavMode::Hold);
    assert_eq!(flight.autopilot.hold_count(), 1);
}
