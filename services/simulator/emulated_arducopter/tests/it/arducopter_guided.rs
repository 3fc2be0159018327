//! GUIDED: what each setpoint does.

#![allow(deprecated)]

use crate::support;
use crate::support::copter::{
    ACCELERATION, CopterFlight, POSITION, POSITION_VELOCITY, PVA, VELOCITY, VELOCITY_ACCELERATION, at, level,
    setpoint, setpoint_in,
};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::Link;
use jink_emulated_autopilot::modes::arducopter::Mode;
use mavlink::dialect::*;
use nalgebra::Vector3;

/// Puts a number that is none somewhere.
type Spoil = fn(&mut SET_POSITION_TARGET_LOCAL_NED_DATA);

const STOPPED: u16 = 3_079;
const NONE: Vector3<f64> = Vector3::new(0.0, 0.0, 0.0);

/// Position 2 m ahead, 1 m/s, nothing else.
fn go(mask: u16) -> MavMessage {
    setpoint(mask, at(2.0, 0.0), level(1.0, 0.0), NONE)
}

#[test]
fn every_whole_mask_is_flown_with_every_heading_and_reported_by_its_submode() {
    let rows = [
        (PVA, 3_072),
        (POSITION_VELOCITY, 3_072),
        (POSITION, 3_576),
        (VELOCITY, STOPPED),
        (VELOCITY_ACCELERATION, STOPPED),
        (ACCELERATION, 3_135),
    ];
    for (mask, reported) in rows {
        for heading in [0, 1_024, 2_048, 3_072] {
            let mut flight = CopterFlight::airborne(&[]);
            let mask = (mask & !3_072) | heading;
            flight.stream(1.5, 50.0, |t| {
                setpoint(mask, at(1.0 + t, 0.0), level(1.0, 0.0), level(0.5, 0.0))
            });
            assert!(flight.position().x > 0.3, "{mask}: {}", flight.position().x);
            assert_eq!(flight.target().type_mask.bits(), reported, "{mask}");
        }
    }
}

#[test]
fn what_is_not_understood_stops_the_vehicle_and_shows_only_in_the_reported_target() {
    let with = |mask: u16| go(mask);
    let mut lost = go(PVA);
    if let MavMessage::SET_POSITION_TARGET_LOCAL_NED(m) = &mut lost {
        m.vx = f32::NAN;
    }
    let rejected = [
        ("position and acceleration", with(2_048 + 56)),
        ("nothing", with(4_095)),
        ("force with acceleration", with(PVA + 512)),
        ("x ignored, rest of position void", with(2_048 + 1 + 56 + 448)),
        ("mixed axes", with(2_048 + 3 + 32 + 448)),
        ("velocity no number", lost),
    ];
    for (name, message) in rejected {
        let mut flight = CopterFlight::airborne(&[]);
        let before = flight.position();
        flight.stream(2.0, 50.0, |_| message.clone());
        assert!((flight.position() - before).norm() < 0.15, "{name}");
        let target = flight.target();
        assert_eq!(target.type_mask.bits(), STOPPED, "{name}");
        assert_eq!((target.vx, target.vy, target.vz), (0.0, 0.0, 0.0), "{name}");
        assert!(flight.texts.iter().all(|t| !t.contains("setpoint")), "{name}");
        assert_eq!(flight.copter.aborted(), None, "{name}");
    }
}

#[test]
fn one_ignored_axis_ignores_its_whole_group() {
    let mut flight = CopterFlight::airborne(&[]);
    // x is ignored: y and z go with it, velocity remains.
    let message = setpoint(2_048 + 448 + 1, at(0.0, 30.0), level(1.0, 0.0), NONE);
    flight.stream(4.0, 50.0, |_| message.clone());
    assert!(flight.position().x > 2.5 && flight.position().y.abs() < 0.2);
    assert_eq!(flight.target().type_mask.bits(), STOPPED);
}

#[test]
fn a_number_that_is_none_in_a_group_that_counts_ends_the_process() {
    let spoil: [(&str, Spoil); 3] = [
        ("position", |m| m.x = f32::NAN),
        ("acceleration", |m| m.afx = f32::NAN),
        ("yaw", |m| m.yaw = f32::NAN),
    ];
    for (group, spoil) in spoil {
        let mut flight = CopterFlight::airborne(&[]);
        let MavMessage::SET_POSITION_TARGET_LOCAL_NED(mut message) = go(PVA) else {
            panic!("another message");
        };
        spoil(&mut message);
        flight.companion(MavMessage::SET_POSITION_TARGET_LOCAL_NED(message));
        flight.step();
        let abort = flight.copter.aborted().expect(group);
        assert_eq!(abort.group, group);
        assert_eq!(flight.collect(5.0, |packet| Some(packet.clone())), []);
        assert!(!flight.copter.is_armed());
        assert_eq!(flight.position().z, 0.0, "without motors it falls");
    }
}

#[test]
fn a_number_that_is_none_in_an_ignored_field_is_harmless() {
    let mut flight = CopterFlight::airborne(&[]);
    let nan = Vector3::repeat(f64::NAN);
    flight.stream(1.0, 50.0, |_| setpoint(POSITION, at(1.0, 0.0), nan, nan));
    flight.stream(1.0, 50.0, |_| setpoint(VELOCITY, nan, level(1.0, 0.0), nan));
    flight.stream(1.0, 50.0, |_| setpoint(ACCELERATION, nan, nan, level(0.1, 0.0)));
    assert_eq!(flight.copter.aborted(), None);
    assert!(flight.position().x > 1.0);
}

#[test]
fn frames_differ_in_axes_and_origin_and_unknown_ones_stop() {
    use MavFrame as F;
    let rows = [
        (F::MAV_FRAME_LOCAL_NED, [3.0, 0.0]),
        (F::MAV_FRAME_LOCAL_OFFSET_NED, [4.0, 0.0]),
        (F::MAV_FRAME_BODY_NED, [1.0, 3.0]),
        (F::MAV_FRAME_BODY_OFFSET_NED, [1.0, 3.0]),
        (F::MAV_FRAME_BODY_FRD, [1.0, 0.0]),
        (F::MAV_FRAME_GLOBAL_RELATIVE_ALT, [1.0, 0.0]),
        (F::MAV_FRAME_LOCAL_FRD, [1.0, 0.0]),
        (F::MAV_FRAME_GLOBAL, [1.0, 0.0]),
    ];
    for (frame, [north, east]) in rows {
        let mut flight = CopterFlight::heading(90.0, &[("WP_YAW_BEHAVIOR", 0.0)]).lifted(5.0);
        flight.companion(setpoint(POSITION + 1_024, at(1.0, 0.0), NONE, NONE));
        flight.run(6.0);
        let z = if frame == F::MAV_FRAME_LOCAL_NED {
            -5.0
        } else {
            0.0
        };
        let message = setpoint_in(frame, POSITION + 1_024, Vector3::new(3.0, 0.0, z), NONE, NONE);
        flight.companion(message);
        flight.run(8.0);
        let p = flight.position();
        assert!((p.x - north).hypot(p.y - east) < 0.2, "{frame:?} {p}");
    }
}

#[test]
fn body_velocities_are_the_vehicles_and_offset_velocities_the_worlds() {
    for (frame, east) in [
        (MavFrame::MAV_FRAME_LOCAL_OFFSET_NED, false),
        (MavFrame::MAV_FRAME_BODY_NED, true),
        (MavFrame::MAV_FRAME_BODY_OFFSET_NED, true),
    ] {
        let mut flight = CopterFlight::heading(90.0, &[("WP_YAW_BEHAVIOR", 0.0)]).lifted(5.0);
        let mask = VELOCITY + 1_024;
        flight.stream(3.0, 20.0, |_| {
            setpoint_in(frame, mask, NONE, level(1.0, 0.0), NONE)
        });
        let p = flight.position();
        let (along, across) = if east { (p.y, p.x) } else { (p.x, p.y) };
        assert!(along > 1.5 && across.abs() < 0.3, "{frame:?} {p}");
    }
}

#[test]
fn a_relative_heading_streamed_keeps_turning() {
    let mut flight = CopterFlight::heading(90.0, &[]).lifted(5.0);
    flight.stream(2.0, 50.0, |_| {
        let mut message = setpoint_in(MavFrame::MAV_FRAME_BODY_NED, VELOCITY, NONE, NONE, NONE);
        if let MavMessage::SET_POSITION_TARGET_LOCAL_NED(m) = &mut message {
            m.yaw = std::f32::consts::FRAC_PI_2;
        }
        message
    });
    let turned_deg = (flight.heading_deg() - 90.0).rem_euclid(360.0);
    assert!((turned_deg - 102.0).abs() < 0.2 * 102.0, "{turned_deg}");
}

#[test]
fn a_heading_with_a_rate_settles_a_little_ahead_of_it() {
    let mut flight = CopterFlight::airborne(&[]);
    flight.stream(6.0, 50.0, |_| {
        let mut message = setpoint(0, at(0.0, 0.0), NONE, NONE);
        if let MavMessage::SET_POSITION_TARGET_LOCAL_NED(m) = &mut message {
            m.yaw = std::f32::consts::FRAC_PI_2;
            m.yaw_rate = 0.3;
        }
        message
    });
    assert!(
        (flight.heading_deg() - 93.0).abs() < 1.5,
        "{}",
        flight.heading_deg()
    );
}

#[test]
fn without_a_heading_a_short_move_holds_it_and_a_velocity_turns_along_the_track() {
    let mut flight = CopterFlight::heading(90.0, &[]).lifted(5.0);
    flight.companion(setpoint(POSITION + 1_024, at(0.4, 0.0), NONE, NONE));
    flight.run(4.0);
    assert!(
        (flight.heading_deg() - 90.0).abs() < 1.0,
        "{}",
        flight.heading_deg()
    );
    flight.stream(2.0, 50.0, |_| {
        setpoint(VELOCITY + 1_024, NONE, level(1.0, 0.0), NONE)
    });
    let left_deg = flight.heading_deg();
    assert!((5.0..30.0).contains(&left_deg), "{left_deg}");
}

#[test]
fn one_position_is_enough_and_is_flown_to_at_up_to_10_m_s() {
    let mut flight = CopterFlight::airborne(&[]);
    flight.companion(setpoint(POSITION, at(18.0, 0.0), NONE, NONE));
    let took_s = flight.run_until(12.0, |f| f.position().x > 17.5).unwrap();
    assert!(took_s < 10.0, "{took_s}");
    flight.run(10.0);
    assert!((flight.position() - at(18.0, 0.0)).norm() < 0.1);
}

#[test]
fn a_step_of_50_m_is_flown_at_its_height() {
    let mut flight = CopterFlight::airborne(&[]);
    let (mut fastest, mut off_level) = (0.0f64, 0.0f64);
    for _ in 0..250 {
        flight.companion(setpoint(PVA, at(50.0, 0.0), NONE, NONE));
        flight.run(0.02);
        fastest = fastest.max(flight.speed());
        off_level = off_level.max((flight.position().z + 5.0).abs());
    }
    assert!((fastest - 8.5).abs() < 0.3 * 8.5, "{fastest}");
    assert!(off_level < 0.4, "{off_level}");
}

#[test]
fn every_rate_above_the_timeout_is_as_good_and_half_a_hertz_works_with_a_swing() {
    let north = |t: f64| setpoint(PVA, at(3.0 * t, 0.0), level(3.0, 0.0), NONE);
    for (rate_hz, allowed_m) in [
        (50.0, 0.25),
        (10.0, 0.25),
        (5.0, 0.25),
        (2.0, 0.25),
        (1.0, 0.3),
        (0.5, 1.2),
    ] {
        let mut flight = CopterFlight::airborne(&[]);
        let every = (250.0 / rate_hz) as usize;
        for step in 0..4_000 {
            let t = step as f64 * 0.004;
            if step % every == 0 {
                flight.companion(north(t));
            }
            flight.step();
            let error = (flight.position().x - 3.0 * t).abs();
            assert!(t < 8.0 || error < allowed_m, "{rate_hz} Hz {error}");
        }
    }
}

#[test]
fn the_timeout_can_be_set_in_flight() {
    let mut flight = support::copter_tracking::at_cruise(PVA, &[]);
    flight.set("GUID_TIMEOUT", 0.5);
    let after = support::copter_tracking::watch(&mut flight, 15.0, |_, _| {});
    assert!((after.max - 7.9).abs() < 0.3 * 7.9, "{}", after.max);
    assert_eq!(flight.copter.flight_mode(), Mode::Guided);
    assert_eq!(flight.texts.last().map(String::as_str), Some("Arming motors"));
}

#[test]
fn a_target_is_extrapolated_and_then_frozen_without_speed() {
    let mut flight = CopterFlight::airborne(&[]);
    flight.companion(setpoint(PVA, at(0.0, 0.0), level(2.0, 0.0), NONE));
    flight.run(2.0);
    let target = flight.target();
    assert!((target.x - 4.0).abs() < 0.05 && target.vx == 2.0, "{}", target.x);
    flight.run(2.0);
    let target = flight.target();
    assert!((target.x - 6.0).abs() < 0.05 && target.vx == 0.0, "{}", target.x);
}

#[test]
fn anybody_may_send_to_any_component_of_this_system_and_not_to_another() {
    for (system, component, to, received) in [
        (1, 195, (1, 1), true),
        (2, 1, (1, 190), true),
        (255, 190, (1, 191), true),
        (77, 5, (0, 0), true),
        (1, 191, (12, 1), false),
    ] {
        let mut flight = CopterFlight::airborne(&[]);
        let MavMessage::SET_POSITION_TARGET_LOCAL_NED(mut message) =
            setpoint(VELOCITY, NONE, level(1.0, 0.0), NONE)
        else {
            panic!("another message");
        };
        (message.target_system, message.target_component) = to;
        flight.from(
            Link::Companion,
            system,
            component,
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(message),
        );
        flight.run(2.0);
        assert_eq!(
            flight.position().x > 0.5,
            received,
            "{system}/{component} to {to:?}"
        );
    }
}

#[test]
fn in_other_modes_setpoints_are_ignored_without_a_trace() {
    let mut flight = CopterFlight::airborne(&[]);
    flight.set_mode(Mode::Brake);
    let texts = flight.texts.len();
    flight.stream(2.0, 50.0, |_| setpoint(PVA, at(20.0, 0.0), level(3.0, 0.0), NONE));
    assert!(flight.position().x.abs() < 0.2);
    assert_eq!(
        (flight.copter.flight_mode(), flight.texts.len()),
        (Mode::Brake, texts)
    );
    flight.companion(setpoint(PVA, Vector3::repeat(f64::NAN), NONE, NONE));
    flight.step();
    assert_eq!(flight.copter.aborted(), None);
}

#[test]
fn paused_it_ignores_setpoints_until_it_may_continue() {
    let mut flight = CopterFlight::airborne(&[]);
    let north = |_| setpoint(VELOCITY, NONE, level(2.0, 0.0), NONE);
    flight.stream(4.0, 50.0, north);
    let pause = MavCmd::MAV_CMD_DO_PAUSE_CONTINUE;
    assert_eq!(flight.ask(pause, [0.0; 7]), MavResult::MAV_RESULT_ACCEPTED);
    let before = flight.position().x;
    flight.stream(5.0, 50.0, north);
    let moved_m = flight.position().x - before;
    assert!((moved_m - 1.4).abs() < 0.5, "{moved_m}");
    let go_on = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    assert_eq!(flight.ask(pause, go_on), MavResult::MAV_RESULT_ACCEPTED);
    flight.stream(3.0, 50.0, north);
    assert!(flight.position().x - before > 4.0);
}

#[test]
fn faster_than_wpnav_speed_falls_behind() {
    let mut flight = CopterFlight::airborne(&[]);
    let mut fastest = 0.0f64;
    for step in 0..700 {
        let t = f64::from(step) * 0.02;
        flight.companion(setpoint(POSITION, at(12.0 * t, 0.0), NONE, NONE));
        flight.run(0.02);
        fastest = fastest.max(flight.speed());
    }
    assert!(fastest < 10.5, "{fastest}");
    assert!(12.0 * 14.0 - flight.position().x > 20.0);
}

#[test]
fn a_global_position_is_flown_to_like_a_local_one() {
    let mut flight = CopterFlight::airborne(&[]);
    let projection =
        jink_shared_types::geo::Projection::new(jink_emulated_arducopter::ArduCopterConfig::default().origin);
    let (lat_int, lon_int) = projection.to_global(nalgebra::Vector2::new(4.0, -3.0)).to_e7();
    flight.companion(MavMessage::SET_POSITION_TARGET_GLOBAL_INT(
        SET_POSITION_TARGET_GLOBAL_INT_DATA {
            lat_int,
            lon_int,
            alt: 6.0,
            type_mask: PositionTargetTypemask::from_bits_retain(POSITION),
            coordinate_frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
            target_system: 1,
            ..SET_POSITION_TARGET_GLOBAL_INT_DATA::default()
        },
    ));
    flight.run(10.0);
    assert!((flight.position() - Vector3::new(4.0, -3.0, -6.0)).norm() < 0.1);
}

#[test]
fn a_jump_of_the_estimate_does_not_throw_the_vehicle() {
    let mut flight = CopterFlight::airborne(&[]);
    flight.copter.jump_estimate(Vector3::new(2.0, 0.0, 0.0));
    flight.run(5.0);
    assert!(flight.position().x.abs() < 2.2 && flight.speed() < 1.0);
}
