//! Which SET_POSITION_TARGET_LOCAL_NED current PX4 takes, and what it says to the others. Every rule was observed.

#![allow(deprecated)]

use crate::support::current::{
    NO_ACCELERATION, NO_POSITION, NO_YAW_RATE, here, place, setpoint, staying, stream,
};
use crate::support::{Flight, north_east, speed};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::Link;
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::*;

type Setpoint = SET_POSITION_TARGET_LOCAL_NED_DATA;

/// Sends `message` at 20 Hz for 2 s from `system` and `component`; whether OFFBOARD lives on.
fn keeps_offboard(flight: &mut Flight, system: u32, component: u8, message: &Setpoint) -> bool {
    for _ in 0..40 {
        let message = MavMessage::SET_POSITION_TARGET_LOCAL_NED(message.clone());
        flight.from(Link::Companion, system, component, message);
        flight.run(0.05);
    }
    flight.autopilot.mode() == NavMode::Offboard
}

/// How many messages of 40 were answered with `text`.
fn said(flight: &Flight, text: &str) -> usize {
    flight.texts.iter().filter(|t| *t == text).count()
}

#[test]
fn the_sender_is_not_checked() {
    for (system, component) in [(1, 191), (42, 25)] {
        let mut flight = staying(&[]);
        let stay = here(&flight);
        assert!(keeps_offboard(&mut flight, system, component, &stay));
    }
}

#[test]
fn targets_1_1_and_0_0_are_meant_and_another_component_counts_as_loss() {
    for (system, component, kept) in [(1, 1, true), (0, 0, true), (1, 2, false)] {
        let mut flight = staying(&[]);
        let mut stay = here(&flight);
        (stay.target_system, stay.target_component) = (system, component);
        assert_eq!(
            keeps_offboard(&mut flight, 1, 196, &stay),
            kept,
            "{system}/{component}"
        );
    }
}

#[test]
fn the_time_stamp_is_not_used() {
    let mut flight = staying(&[]);
    let mut stay = here(&flight);
    for stamp in [0, 1, u32::MAX] {
        stay.time_boot_ms = stamp;
        assert!(keeps_offboard(&mut flight, 1, 196, &stay));
    }
}

#[test]
fn body_ned_turns_velocity_by_the_heading_and_drops_the_position() {
    let mut flight = staying(&[]);
    let start = north_east(&flight);
    let down = flight.autopilot.truth().position.z_m;
    // Heading east first.
    let mut turn = here(&flight);
    turn.yaw = std::f32::consts::FRAC_PI_2;
    stream(&mut flight, &turn, 0.05, 4.0);
    let mut forward = setpoint(
        [500.0, 500.0, down],
        [2.0, 0.0, 0.0],
        NO_ACCELERATION | NO_YAW_RATE,
    );
    forward.coordinate_frame = MavFrame::MAV_FRAME_BODY_NED;
    forward.yaw = std::f32::consts::FRAC_PI_2;
    stream(&mut flight, &forward, 0.05, 5.0);
    let (north, east) = north_east(&flight);
    assert!(
        (north - start.0).abs() < 0.5 && (6.0..11.0).contains(&(east - start.1)),
        "{north} {east}"
    );
    assert_eq!(flight.autopilot.mode(), NavMode::Offboard);
}

#[test]
fn another_frame_is_refused_in_words_at_every_message_and_counts_as_loss() {
    let mut flight = staying(&[]);
    let mut stay = here(&flight);
    stay.coordinate_frame = MavFrame::MAV_FRAME_BODY_OFFSET_NED;
    assert!(!keeps_offboard(&mut flight, 1, 196, &stay));
    assert_eq!(said(&flight, "coordinate frame 9 unsupported"), 40);
}

#[test]
fn not_a_number_is_the_same_as_an_ignore_bit() {
    let mut flight = staying(&[]);
    let start = flight.autopilot.truth().position;
    let mut masked = place([start.x_m + 3.0, start.y_m, start.z_m]);
    masked.type_mask = PositionTargetTypemask::empty();
    let unset = f32::NAN;
    (masked.vx, masked.vy, masked.vz) = (unset, unset, unset);
    (masked.afx, masked.afy, masked.afz, masked.yaw_rate) = (unset, unset, unset, unset);
    stream(&mut flight, &masked, 0.05, 8.0);
    let moved = flight.autopilot.truth().position.x_m - start.x_m;
    assert!((moved - 3.0).abs() < 0.2, "{moved}");
}

#[test]
fn nothing_but_nan_or_a_full_mask_is_refused_in_words_at_every_message_and_counts_as_loss() {
    let nan = f64::NAN;
    let mut all_nan = setpoint([nan; 3], [nan; 3], 0);
    (all_nan.afx, all_nan.afy, all_nan.afz) = (f32::NAN, f32::NAN, f32::NAN);
    for message in [all_nan, setpoint([0.0; 3], [0.0; 3], 0xfff)] {
        let mut flight = staying(&[]);
        assert!(!keeps_offboard(&mut flight, 1, 196, &message));
        assert_eq!(said(&flight, "SET_POSITION_TARGET_LOCAL_NED invalid"), 40);
        assert!(said(&flight, "Failsafe activated") >= 1);
    }
}

#[test]
fn a_horizontal_velocity_with_nothing_in_z_stops_and_waits_in_offboard_without_a_word() {
    let mut flight = staying(&[]);
    let down = flight.autopilot.truth().position.z_m;
    let velocity_only = NO_POSITION | NO_ACCELERATION | NO_YAW_RATE;
    stream(
        &mut flight,
        &setpoint([0.0; 3], [3.0, 0.0, 0.0], velocity_only),
        0.05,
        4.0,
    );
    assert!(speed(&flight) > 2.5);
    let texts = flight.texts.len();
    const NO_VELOCITY_DOWN: u16 = 0x020;
    let open = setpoint([0.0; 3], [3.0, 0.0, 0.0], velocity_only | NO_VELOCITY_DOWN);
    stream(&mut flight, &open, 0.05, 6.0);
    assert_eq!(flight.autopilot.mode(), NavMode::Offboard);
    assert!(speed(&flight) < 0.2, "{}", speed(&flight));
    assert!((flight.autopilot.truth().position.z_m - down).abs() < 0.5);
    assert_eq!(flight.texts.len(), texts);
}
