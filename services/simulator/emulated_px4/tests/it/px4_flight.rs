//! Whole flights of the emulated PX4.

#![allow(deprecated)]

use crate::support::{Flight, alone, waypoint_item};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::Link;
use jink_emulated_px4::Px4Config;
use jink_shared_types::vehicle::NavMode;
use jink_simulated_world::vehicle::wind::WindConfig;
use mavlink::dialect::*;
use nalgebra::Vector3;

#[test]
fn a_whole_flight_without_companion_takes_off_flies_lands_and_disarms() {
    let mut flight = alone();
    flight.run(2.0);
    let items = [[30.0, 0.0], [30.0, 20.0]].map(|[x, y]| {
        let origin = jink_shared_types::geo::Projection::new(Px4Config::default().origin);
        let (lat, lon) = origin.to_global(nalgebra::Vector2::new(x, y)).to_e7();
        waypoint_item(MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, lat, lon, 5.0)
    });
    assert_eq!(
        flight.upload_items(&items),
        MavMissionResult::MAV_MISSION_ACCEPTED
    );
    flight.set_mode(NavMode::Hold);
    assert_eq!(flight.arm(), MavResult::MAV_RESULT_ACCEPTED);
    flight.set_mode(NavMode::Takeoff);
    let from_s = flight.now_s();
    assert!(flight.run_until(10.0, |f| !f.autopilot.truth().on_ground));
    let ramp_s = flight.now_s() - from_s;
    assert!(
        (2.5..5.0).contains(&ramp_s),
        "some three seconds of motor ramp: {ramp_s}"
    );
    assert!(flight.run_until(20.0, |f| f.autopilot.mode() == NavMode::Hold));
    flight.run(5.0);
    assert!((flight.autopilot.truth().position.z_m + 2.5).abs() < 0.15);

    flight.set_mode(NavMode::Mission);
    let (mut peak, mut reached) = (0.0f64, Vec::new());
    let done = flight.run_until(40.0, |f| {
        peak = peak.max(f.autopilot.truth().velocity.vector().xy().norm());
        for packet in f.received.iter().filter(|p| p.link == Link::GroundStation) {
            if let MavMessage::MISSION_ITEM_REACHED(item) = &packet.message {
                reached.push(item.seq);
            }
        }
        f.autopilot.mission().done
    });
    assert!(done);
    assert!((4.7..=5.05).contains(&peak), "cruise {peak}");
    flight.step();
    assert_eq!(reached, [0, 1]);
    assert_eq!(flight.autopilot.mission().total, 2);
    flight.run(6.0);
    assert_eq!(flight.autopilot.mode(), NavMode::Mission);
    let position = flight.autopilot.truth().position.vector();
    assert!(
        (position - Vector3::new(30.0, 20.0, -5.0)).norm() < 0.3,
        "{position}"
    );

    flight.set_mode(NavMode::Land);
    assert!(flight.run_until(30.0, |f| f.autopilot.is_landed()));
    assert!(flight.run_until(3.0, |f| !f.autopilot.is_armed()));
    assert!(flight.autopilot.truth().on_ground);
    assert!(
        (flight.autopilot.truth().position.vector().xy() - nalgebra::Vector2::new(30.0, 20.0)).norm() < 0.5
    );
    assert_eq!(flight.autopilot.hold_count(), 0);
}

#[test]
fn a_mission_of_every_kind_of_item_takes_off_slows_down_waits_and_lands() {
    let mut flight = alone();
    flight.run(2.0);
    let local = |command, x: f64, y: f64, z: f32, param1: f32| MISSION_ITEM_INT_DATA {
        command,
        param1,
        ..waypoint_item(
            MavFrame::MAV_FRAME_LOCAL_NED,
            (x * 1e4) as i32,
            (y * 1e4) as i32,
            z,
        )
    };
    let items = [
        local(MavCmd::MAV_CMD_NAV_TAKEOFF, 0.0, 0.0, -4.0, 0.0),
        MISSION_ITEM_INT_DATA {
            param2: 2.0,
            frame: MavFrame::MAV_FRAME_MISSION,
            ..local(MavCmd::MAV_CMD_DO_CHANGE_SPEED, 0.0, 0.0, 0.0, 1.0)
        },
        local(MavCmd::MAV_CMD_NAV_WAYPOINT, 20.0, 0.0, -4.0, 9.0),
        local(MavCmd::MAV_CMD_NAV_LAND, 20.0, 10.0, 0.0, 0.0),
    ];
    assert_eq!(
        flight.upload_items(&items),
        MavMissionResult::MAV_MISSION_ACCEPTED
    );
    flight.set_mode(NavMode::Hold);
    flight.arm();
    flight.set_mode(NavMode::Mission);
    assert!(flight.run_until(30.0, |f| f.autopilot.mission().current == 2));
    let mut peak = 0.0f64;
    let mut slow_s = 0.0;
    assert!(flight.run_until(40.0, |f| {
        let speed = f.autopilot.truth().velocity.vector().xy().norm();
        peak = peak.max(speed);
        if speed < 0.1 && f.autopilot.truth().position.x_m > 18.0 {
            slow_s += 0.004;
        }
        f.autopilot.mission().current == 3
    }));
    assert!((1.8..2.2).contains(&peak), "{peak}");
    assert!(slow_s > 0.5, "it waits at the waypoint: {slow_s}");
    assert!(flight.run_until(60.0, |f| !f.autopilot.is_armed()));
    let end = flight.autopilot.truth().position;
    assert!((end.x_m - 20.0).hypot(end.y_m - 10.0) < 1.0, "{end:?}");
    assert!(flight.autopilot.mission().done);
}

#[test]
fn disarming_in_the_air_is_refused() {
    let mut flight = alone();
    flight.start_mission(&[[50.0, 0.0, -5.0]]);
    flight.run(1.0);
    let disarm = flight.ask(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [0.0; 7]);
    assert_eq!(disarm, MavResult::MAV_RESULT_TEMPORARILY_REJECTED);
    assert!(flight.autopilot.is_armed());
}

#[test]
fn a_jump_of_the_estimate_moves_the_vehicle_and_is_counted() {
    let mut flight = alone();
    flight.start_mission(&[[60.0, 0.0, -5.0]]);
    flight.run(4.0);
    flight.set_mode(NavMode::Hold);
    flight.run(6.0);
    let before = flight.autopilot.truth().position;
    flight.autopilot.jump_estimate(Vector3::new(0.0, 3.0, 0.0));
    flight.step();
    assert_eq!(flight.autopilot.estimate().resets, 1);
    flight.run(10.0);
    // It holds a place of the earth that its estimate now calls three metres further east.
    let moved = flight.autopilot.truth().position.y_m - before.y_m;
    assert!((moved + 3.0).abs() < 0.3, "{moved}");
}

#[test]
fn the_same_packets_in_the_same_steps_are_the_same_flight_to_the_bit() {
    let fly = || {
        let mut config = Px4Config::default();
        config.vehicle.wind = WindConfig {
            mean_mps: [1.0, -2.0, 0.0],
            gust_sigma_mps: 0.7,
            gust_time_s: 2.0,
        };
        config.vehicle.seed = 11;
        let mut flight = Flight::new(config);
        flight.start_mission(&[[40.0, 0.0, -5.0], [40.0, 20.0, -6.0]]);
        let mut track = Vec::new();
        for _ in 0..2_000 {
            flight.step();
            let truth = flight.autopilot.truth();
            track.push([truth.position.x_m, truth.position.y_m, truth.position.z_m].map(f64::to_bits));
        }
        // As text, because a field that is not given equals nothing.
        (track, format!("{:?} {:?}", flight.received, flight.desired))
    };
    assert_eq!(fly(), fly());
}

#[test]
fn a_steady_wind_is_leaned_against() {
    let mut config = Px4Config::default();
    config.vehicle.wind.mean_mps = [0.0, 6.0, 0.0];
    let mut flight = Flight::new(config);
    flight.start_mission(&[[120.0, 0.0, -5.0]]);
    flight.run(14.0);
    assert!(flight.autopilot.truth().position.y_m.abs() < 0.6);
    assert!(flight.autopilot.truth().velocity.vector().xy().norm() > 4.0);
}

#[test]
fn offboard_needs_a_stream_and_lands_when_it_stops() {
    let mut flight = alone();
    flight.start_mission(&[[50.0, 0.0, -5.0]]);
    flight.set_mode(NavMode::Hold);
    flight.run(6.0);
    assert_eq!(
        flight.set_mode(NavMode::Offboard),
        MavResult::MAV_RESULT_TEMPORARILY_REJECTED
    );
    let start = flight.autopilot.truth().position;
    let setpoint = MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
        x: start.x_m as f32 + 4.0,
        y: 2.0,
        z: -6.0,
        type_mask: PositionTargetTypemask::from_bits_truncate(0b1101_1111_1000),
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
        target_system: 1,
        target_component: 1,
        ..SET_POSITION_TARGET_LOCAL_NED_DATA::default()
    });
    flight.companion(191, setpoint.clone());
    flight.step();
    assert_eq!(flight.set_mode(NavMode::Offboard), MavResult::MAV_RESULT_ACCEPTED);
    for _ in 0..200 {
        flight.companion(191, setpoint.clone());
        flight.run(0.05);
    }
    let position = flight.autopilot.truth().position;
    assert!((position.x_m - start.x_m - 4.0).abs() < 0.2 && (position.z_m + 6.0).abs() < 0.2);
    assert_eq!(flight.autopilot.mode(), NavMode::Offboard);
    flight.run(1.2);
    assert_eq!(flight.autopilot.mode(), NavMode::Land);
    assert!(flight.run_until(60.0, |f| !f.autopilot.is_armed()));
}
