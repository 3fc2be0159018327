//! Links and protocols of the emulated PX4. Rates and rules were observed on a real one.

#![allow(deprecated)]

use crate::support;
use crate::support::{Answer, Flight, alone, waypoint_item};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::{Link, script};
use jink_shared_types::vehicle::NavMode;
use mavlink::Message;
use mavlink::dialect::*;

#[test]
fn the_companions_link_has_the_observed_rates() {
    let mut flight = Flight::with(&[]);
    flight.run(2.0);
    flight.set_mode(NavMode::Hold);
    flight.arm();
    flight.run(1.0);
    let mut counts = std::collections::BTreeMap::new();
    let seconds: i32 = 8;
    flight.run_until(f64::from(seconds), |f| {
        for packet in f
            .received
            .iter()
            .filter(|p| p.link == Link::Companion && p.header.component_id == 1)
        {
            *counts.entry(packet.message.message_name()).or_insert(0) += 1;
        }
        false
    });
    for (name, hz) in [
        ("HEARTBEAT", 1),
        ("ATTITUDE", 100),
        ("ATTITUDE_QUATERNION", 50),
        ("LOCAL_POSITION_NED", 30),
        ("GLOBAL_POSITION_INT", 50),
        ("TIMESYNC", 10),
        ("POSITION_TARGET_LOCAL_NED", 10),
        ("SYS_STATUS", 5),
        ("SYSTEM_TIME", 1),
        ("ALTITUDE", 10),
        ("TRAJECTORY_REPRESENTATION_WAYPOINTS", 5),
    ] {
        let count = counts.get(name).copied().unwrap_or(0);
        assert!((count - hz * seconds).abs() <= 1, "{name}: {count}");
    }
}

#[test]
fn the_links_forward_to_each_other() {
    assert_eq!(forwarded(&[("MAV_HB_FORW_EN", 1.0)]), [true, true]);
}

#[test]
fn a_board_passes_no_stations_heartbeat_to_its_companion() {
    assert_eq!(forwarded(&[]), [false, true]);
}

/// Whether the companion receives what the station sends, and the station what the companion sends.
fn forwarded(parameters: &[(&'static str, f64)]) -> [bool; 2] {
    let mut flight = Flight::with(parameters);
    flight.run(0.1);
    let beat = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        mavtype: MavType::MAV_TYPE_GCS,
        ..HEARTBEAT_DATA::default()
    });
    flight.from(Link::GroundStation, 255, 190, beat);
    flight.companion(196, support::no_waypoint());
    flight.step();
    let received = |link, system, component| {
        flight
            .received
            .iter()
            .any(|p| p.link == link && (p.header.system_id, p.header.component_id) == (system, component))
    };
    [
        received(Link::Companion, 255, 190),
        received(Link::GroundStation, 1, 196),
    ]
}

#[test]
fn the_heartbeats_interval_is_refused_with_4_and_others_can_be_changed() {
    let mut flight = Flight::with(&[]);
    flight.run(1.0);
    let interval = |id: f32| [id, 100_000.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let set = MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL;
    assert_eq!(flight.ask(set, interval(0.0)) as u32, 4);
    assert_eq!(flight.ask(set, interval(1.0)) as u32, 0);
    assert_eq!(flight.ask(set, interval(332.0)) as u32, 0);
    assert_eq!(
        flight.ask(MavCmd::MAV_CMD_DO_DIGICAM_CONTROL, [0.0; 7]),
        MavResult::MAV_RESULT_UNSUPPORTED
    );
}

#[test]
fn a_mission_survives_upload_and_download_and_bad_items_are_refused() {
    let mut flight = alone();
    flight.run(1.0);
    let item = waypoint_item(
        MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        473_980_000,
        85_456_000,
        7.0,
    );
    assert_eq!(
        flight.upload_items(&[item.clone(), item.clone()]),
        MavMissionResult::MAV_MISSION_ACCEPTED
    );
    let spline = MISSION_ITEM_INT_DATA {
        command: MavCmd::MAV_CMD_NAV_SPLINE_WAYPOINT,
        ..item.clone()
    };
    assert_eq!(
        flight.upload_items(&[item.clone(), spline]),
        MavMissionResult::MAV_MISSION_UNSUPPORTED
    );
    let request = MavMessage::MISSION_REQUEST_INT(MISSION_REQUEST_INT_DATA {
        seq: 1,
        target_system: 1,
        target_component: 1,
        ..MISSION_REQUEST_INT_DATA::default()
    });
    flight.from(Link::GroundStation, 255, 190, request);
    flight.step();
    let downloaded = flight.received.iter().find_map(|p| match &p.message {
        MavMessage::MISSION_ITEM_INT(item) => Some(item.clone()),
        _ => None,
    });
    let downloaded = downloaded.expect("the second item of the first mission");
    assert_eq!((downloaded.seq, downloaded.x, downloaded.z), (1, item.x, item.z));
    let clear = MavMessage::MISSION_CLEAR_ALL(MISSION_CLEAR_ALL_DATA {
        target_system: 1,
        target_component: 1,
        ..MISSION_CLEAR_ALL_DATA::default()
    });
    flight.from(Link::GroundStation, 255, 190, clear);
    flight.run(0.1);
    assert_eq!(flight.autopilot.mission().total, 0);
    assert_eq!(
        flight.set_mode(NavMode::Mission),
        MavResult::MAV_RESULT_TEMPORARILY_REJECTED
    );
}

#[test]
fn a_lost_item_is_asked_for_again() {
    let mut flight = alone();
    flight.run(1.0);
    let count = MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
        count: 2,
        target_system: 1,
        target_component: 1,
        ..MISSION_COUNT_DATA::default()
    });
    flight.from(Link::GroundStation, 255, 190, count);
    let mut requests = 0;
    let cancelled = flight.run_until(8.0, |f| {
        f.received.iter().any(|p| {
            requests += usize::from(matches!(p.message, MavMessage::MISSION_REQUEST_INT(_)));
            matches!(&p.message, MavMessage::MISSION_ACK(a)
                if a.mavtype == MavMissionResult::MAV_MISSION_OPERATION_CANCELLED)
        })
    });
    assert!(cancelled);
    assert!(
        (15..25).contains(&requests),
        "four times a second for five seconds: {requests}"
    );
}

#[test]
fn parameters_are_listed_read_and_set_with_integers_as_bits() {
    let mut flight = alone();
    flight.run(1.0);
    let list = MavMessage::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA {
        target_system: 1,
        target_component: 1,
    });
    flight.from(Link::GroundStation, 255, 190, list);
    let mut seen = Vec::new();
    flight.run_until(1.0, |f| {
        for packet in f.received.iter().filter(|p| p.link == Link::GroundStation) {
            if let MavMessage::PARAM_VALUE(value) = &packet.message {
                assert_eq!(usize::from(value.param_index), seen.len());
                seen.push((value.param_id.to_str().unwrap().to_owned(), value.param_count));
            }
        }
        false
    });
    assert_eq!(usize::from(seen[0].1), seen.len());
    for name in [
        "COM_OBS_AVOID",
        "MPC_XY_CRUISE",
        "MIS_TAKEOFF_ALT",
        "NAV_ACC_RAD",
        "CP_DIST",
        "MPC_JERK_AUTO",
    ] {
        assert!(seen.iter().any(|(n, _)| n == name), "{name}");
    }
    let set = |value, param_type| script::parameter("COM_OBS_AVOID", value, param_type);
    let integer = set(f32::from_bits(1), MavParamType::MAV_PARAM_TYPE_INT32);
    flight.from(Link::GroundStation, 255, 190, integer);
    flight.step();
    assert_eq!(flight.autopilot.parameter("COM_OBS_AVOID"), Some(1.0));
    let wrong_type = set(0.0, MavParamType::MAV_PARAM_TYPE_REAL32);
    flight.from(Link::GroundStation, 255, 190, wrong_type);
    flight.run(0.1);
    assert_eq!(flight.autopilot.parameter("COM_OBS_AVOID"), Some(1.0));
}

#[test]
fn a_timesync_request_is_answered_with_the_boot_time() {
    let mut flight = alone();
    flight.run(1.0);
    let request = MavMessage::TIMESYNC(TIMESYNC_DATA {
        ts1: 4_711,
        ..TIMESYNC_DATA::default()
    });
    flight.companion(196, request);
    flight.step();
    let answered = flight.received.iter().any(|p| {
        matches!(&p.message, MavMessage::TIMESYNC(t)
            if t.ts1 == 4_711 && t.tc1 == 1_000_000_000)
    });
    assert!(answered);
}

#[test]
fn arming_before_the_estimator_is_ready_is_refused_and_works_later() {
    let mut flight = alone();
    flight.run(0.2);
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_TEMPORARILY_REJECTED);
    flight.step();
    assert!(flight.texts.iter().any(|t| t.contains("ekf2")));
    flight.run(1.0);
    flight.set_mode(NavMode::Hold);
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_ACCEPTED);
}

#[test]
fn setpoints_are_counted_and_gaps_seen_in_automatic_flight_only() {
    let mut flight = Flight::with(&[]);
    flight.answer = Answer::Stream(0.1);
    flight.start_mission(&[[200.0, 0.0, -5.0]]);
    flight.run(3.0);
    let before = *flight.autopilot.setpoint_statistics();
    assert!(before.count > 50);
    assert!(before.gap_max_s < 0.11, "{}", before.gap_max_s);
    flight.answer = Answer::Silent;
    flight.run(0.3);
    flight.answer = Answer::Stream(0.1);
    flight.run(0.5);
    let after = *flight.autopilot.setpoint_statistics();
    assert!((0.28..0.42).contains(&after.gap_max_s), "{}", after.gap_max_s);
    let scan = MavMessage::OBSTACLE_DISTANCE(OBSTACLE_DISTANCE_DATA::default());
    flight.companion(196, scan);
    flight.step();
    assert_eq!(flight.autopilot.setpoint_statistics().obstacle_distances, 1);
}
