//! Links, heartbeats and what has gone with the trajectory interface in current PX4. Every rule was observed.

#![allow(deprecated)]

use crate::support;
use crate::support::Flight;
use crate::support::current::{ask_for, here, holding, on_ground, reported_modes, send, staying, stream};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::Link;
use jink_emulated_px4::{Px4, Px4Config};
use jink_shared_types::vehicle::NavMode;
use mavlink::Message;
use mavlink::dialect::*;
use std::collections::BTreeMap;

const AVOIDANCE: MavSysStatusSensor = MavSysStatusSensor::MAV_SYS_STATUS_OBSTACLE_AVOIDANCE;
const FAILED: MavResult = MavResult::MAV_RESULT_FAILED;

/// What the autopilot itself sends to the companion within `seconds`, counted by name.
fn counted(flight: &mut Flight, seconds: f64) -> BTreeMap<&'static str, i32> {
    let mut counts = BTreeMap::new();
    flight.run_until(seconds, |f| {
        let own = f.received.iter().filter(|p| p.link == Link::Companion);
        for packet in own.filter(|p| p.header.component_id == 1) {
            *counts.entry(packet.message.message_name()).or_insert(0) += 1;
        }
        false
    });
    counts
}

#[test]
fn the_companions_link_of_current_px4_has_the_observed_rates() {
    let mut flight = holding(&[]);
    let seconds = 8;
    let counts = counted(&mut flight, f64::from(seconds));
    for (name, hz) in [
        ("HEARTBEAT", 1.0),
        ("ATTITUDE", 100.0),
        ("ATTITUDE_QUATERNION", 50.0),
        ("LOCAL_POSITION_NED", 30.0),
        ("ODOMETRY", 30.0),
        ("GLOBAL_POSITION_INT", 50.0),
        ("TIMESYNC", 10.0),
        ("POSITION_TARGET_LOCAL_NED", 10.0),
        ("ALTITUDE", 10.0),
        ("SYS_STATUS", 5.0),
        ("EXTENDED_SYS_STATE", 5.0),
        ("SYSTEM_TIME", 1.0),
        ("MISSION_CURRENT", 1.0),
        ("HOME_POSITION", 0.5),
        ("CURRENT_MODE", 0.5),
    ] {
        let count = f64::from(counts.get(name).copied().unwrap_or(0));
        assert!((count - hz * f64::from(seconds)).abs() <= 1.0, "{name}: {count}");
    }
    assert!(!counts.contains_key("TRAJECTORY_REPRESENTATION_WAYPOINTS"));
}

#[test]
fn odometry_says_what_local_position_says() {
    let mut flight = holding(&[]);
    flight.upload(&[[100.0, 0.0, -5.0]]);
    flight.set_mode(NavMode::Mission);
    flight.run(6.0);
    flight
        .autopilot
        .jump_estimate(nalgebra::Vector3::new(0.5, 0.0, 0.0));
    let mut received = None;
    flight.run_until(0.2, |f| {
        received = f.received.iter().find_map(|p| match &p.message {
            MavMessage::ODOMETRY(o) => Some((o.clone(), *f.autopilot.estimate())),
            _ => None,
        });
        received.is_some()
    });
    let (odometry, estimate) = received.expect("ODOMETRY at 30 Hz");
    assert_eq!(odometry.x, estimate.position.x_m as f32);
    assert_eq!(odometry.vx, estimate.velocity.x_mps as f32);
    assert!(odometry.vx > 3.0);
    assert_eq!(odometry.reset_counter, 1);
    assert_eq!(odometry.child_frame_id, MavFrame::MAV_FRAME_LOCAL_NED);
}

#[test]
fn current_mode_reports_changes_at_once_only_to_those_who_ask_for_it() {
    let mut flight = holding(&[]);
    assert_eq!(ask_for(&mut flight, 436, 0.02), MavResult::MAV_RESULT_ACCEPTED);
    let counts = counted(&mut flight, 8.0);
    let reported = counts.get("CURRENT_MODE").copied().unwrap_or(0);
    assert!((15..=17).contains(&reported), "twice a second: {reported}");
    flight.set_mode(NavMode::Land);
    let from_s = flight.now_s();
    assert!(flight.run_until(1.0, |f| reported_modes(f) == Some((NavMode::Land, NavMode::Land))));
    assert!(flight.now_s() - from_s < 0.05);

    let mut flight = holding(&[]);
    assert!(flight.run_until(3.0, |f| reported_modes(f).is_some()));
    flight.set_mode(NavMode::Land);
    let from_s = flight.now_s();
    assert!(flight.run_until(3.0, |f| reported_modes(f).is_some()));
    assert!(flight.now_s() - from_s > 1.0, "at its own 0.5 Hz");
}

#[test]
fn the_trajectory_interface_is_gone() {
    let mut flight = holding(&[]);
    assert_eq!(ask_for(&mut flight, 332, 0.02), FAILED);
    assert_eq!(ask_for(&mut flight, 333, 0.02), FAILED);
    assert_eq!(flight.autopilot.parameter("COM_OBS_AVOID"), None);
    let unknown = Px4Config {
        parameters: vec![("COM_OBS_AVOID".to_owned(), 1.0)],
        ..Px4Config::current(0.1)
    };
    assert_eq!(Px4::new(unknown).unwrap_err().name, "COM_OBS_AVOID");
    flight.upload(&[[200.0, 0.0, -5.0]]);
    flight.set_mode(NavMode::Mission);
    flight.run(1.0);
    support::reply(&mut flight, 5.0, |f| {
        let north = f.autopilot.truth().position.x_m as f32;
        support::waypoint([north, 20.0, -5.0], [f32::NAN; 3], [f32::NAN; 2])
    });
    let position = flight.autopilot.truth().position;
    assert!(position.y_m.abs() < 0.15 && position.x_m > 10.0, "{position:?}");
    assert_eq!(flight.questions, 0);
}

#[test]
fn trajectories_do_not_keep_offboard_alive() {
    let mut flight = staying(&[]);
    support::reply(&mut flight, 2.0, |_| {
        support::waypoint([0.0, 0.0, -5.0], [0.0; 3], [0.0; 2])
    });
    assert_eq!(flight.autopilot.mode(), NavMode::Return);
}

#[test]
fn nobody_needs_a_companion_to_arm_and_the_avoidance_bit_is_never_set() {
    for kind in [None, Some(MavType::MAV_TYPE_ONBOARD_CONTROLLER)] {
        let mut flight = on_ground(&[]);
        flight.heartbeat = kind.map(|kind| (196, kind, MavState::MAV_STATE_ACTIVE));
        flight.run(2.0);
        flight.set_mode(NavMode::Hold);
        assert_eq!(flight.arm(), MavResult::MAV_RESULT_ACCEPTED);
        let mut looked = 0;
        flight.run_until(4.0, |f| {
            for packet in &f.received {
                if let MavMessage::SYS_STATUS(s) = &packet.message {
                    looked += 1;
                    let present = s.onboard_control_sensors_present;
                    let bits = present | s.onboard_control_sensors_enabled | s.onboard_control_sensors_health;
                    assert!(!bits.contains(AVOIDANCE));
                }
            }
            false
        });
        assert!(looked > 10);
    }
}

/// Seconds from `from_s` to the text.
fn until_said(
    flight: &mut Flight,
    text: &str,
    limit_s: f64,
    stay: &SET_POSITION_TARGET_LOCAL_NED_DATA,
) -> f64 {
    let from_s = flight.now_s();
    while flight.now_s() - from_s < limit_s && !flight.texts.iter().any(|t| t == text) {
        send(flight, stay);
        flight.run(0.1);
    }
    flight.now_s() - from_s
}

#[test]
fn a_lost_onboard_controller_is_a_text_and_so_is_its_return() {
    let mut flight = staying(&[]);
    let stay = here(&flight);
    let state = MavState::MAV_STATE_CRITICAL;
    // Any component, any state: the type alone counts.
    flight.heartbeat = Some((25, MavType::MAV_TYPE_ONBOARD_CONTROLLER, state));
    stream(&mut flight, &stay, 0.05, 2.1);
    flight.heartbeat = None;
    let lost_s = until_said(&mut flight, "Connection to mission computer lost", 20.0, &stay);
    assert!((6.2..=7.1).contains(&lost_s), "{lost_s}");
    flight.heartbeat = Some((196, MavType::MAV_TYPE_ONBOARD_CONTROLLER, state));
    let back_s = until_said(&mut flight, "Onboard controller regained", 20.0, &stay);
    assert!((0.8..=1.6).contains(&back_s), "{back_s}");
    assert_eq!(flight.autopilot.mode(), NavMode::Offboard, "setpoints go on");
    assert_eq!(flight.autopilot.hold_count(), 0);
}

#[test]
fn a_companion_of_type_0_is_not_missed() {
    let mut flight = staying(&[]);
    let stay = here(&flight);
    flight.heartbeat = Some((196, MavType::MAV_TYPE_GENERIC, MavState::MAV_STATE_ACTIVE));
    stream(&mut flight, &stay, 0.05, 2.0);
    flight.heartbeat = None;
    stream(&mut flight, &stay, 0.05, 12.0);
    assert!(!flight.texts.iter().any(|t| t.contains("mission computer")));
}

#[test]
fn a_lost_ground_station_is_a_text_some_fourteen_seconds_later_and_offboard_goes_on() {
    let mut flight = staying(&[]);
    let stay = here(&flight);
    for _ in 0..3 {
        let beat = HEARTBEAT_DATA {
            mavtype: MavType::MAV_TYPE_GCS,
            ..HEARTBEAT_DATA::default()
        };
        flight.from(Link::GroundStation, 255, 190, MavMessage::HEARTBEAT(beat));
        stream(&mut flight, &stay, 0.05, 1.0);
    }
    let lost_s = until_said(&mut flight, "Connection to ground station lost", 30.0, &stay) + 1.0;
    assert!((13.0..=15.2).contains(&lost_s), "{lost_s}");
    assert_eq!(flight.autopilot.mode(), NavMode::Offboard);
}

#[test]
fn timesync_is_answered_and_changes_no_stamp_of_the_autopilots_own() {
    let mut flight = on_ground(&[]);
    flight.clock_ahead_us = Some(7_000_000_000);
    flight.run(62.0);
    let request = TIMESYNC_DATA {
        ts1: 4_711,
        ..TIMESYNC_DATA::default()
    };
    flight.companion(196, MavMessage::TIMESYNC(request));
    let mut answered = false;
    let mut stamps = 0;
    flight.run_until(1.0, |f| {
        let now_us = (f.now_s() * 1e6).round() as u64;
        for packet in f.received.iter().filter(|p| p.header.component_id == 1) {
            match &packet.message {
                MavMessage::TIMESYNC(t) => answered |= t.ts1 == 4_711 && t.tc1 / 1_000_000_000 == 62,
                MavMessage::ODOMETRY(o) => {
                    assert_eq!(o.time_usec, now_us);
                    stamps += 1;
                }
                MavMessage::ATTITUDE(a) => assert_eq!(u64::from(a.time_boot_ms), now_us / 1_000),
                _ => {}
            }
        }
        false
    });
    assert!(answered && stamps > 20);
}
