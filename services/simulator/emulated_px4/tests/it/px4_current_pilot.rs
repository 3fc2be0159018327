//! Sticks and current PX4 in OFFBOARD: taking over, falling silent. Every rule was observed on a real one.

#![allow(deprecated)]

use crate::support::Flight;
use crate::support::current::{here, holding, lift, on_ground, send, staying, stick, stream};
use jink_emulated_autopilot::Autopilot;
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::*;

const TAKEN: &str = "Pilot took over using sticks";

/// In OFFBOARD with setpoints and centred sticks at 20 Hz for a second.
fn with_sticks() -> Flight {
    let mut flight = staying(&[]);
    fly_sticks(&mut flight, 1.0, |_| 0.0);
    assert_eq!(flight.autopilot.mode(), NavMode::Offboard);
    flight
}

/// Setpoints and sticks at 20 Hz for `seconds`; `forward`: deflection at a time since the call.
fn fly_sticks(flight: &mut Flight, seconds: f64, forward: impl Fn(f64) -> f64) {
    let stay = here(flight);
    for i in 0..(seconds * 20.0) as u32 {
        let deflection = forward(f64::from(i) * 0.05).clamp(0.0, 1.0);
        stick(flight, (deflection * 1_000.0).round() as i16);
        send(flight, &stay);
        flight.run(0.05);
    }
}

#[test]
fn fast_sticks_take_over_and_setpoints_that_go_on_do_not_take_it_back() {
    for full_within_s in [0.4, 1.0] {
        let mut flight = with_sticks();
        fly_sticks(&mut flight, 1.5, |t| t / full_within_s);
        assert_eq!(flight.autopilot.mode(), NavMode::Position, "{full_within_s} s");
        assert_eq!(flight.autopilot.intended_mode(), NavMode::Position);
        assert!(flight.texts.iter().any(|t| t == TAKEN));
        fly_sticks(&mut flight, 5.0, |_| 0.0);
        assert_eq!(flight.autopilot.mode(), NavMode::Position);
        assert_eq!(flight.set_mode(NavMode::Offboard), MavResult::MAV_RESULT_ACCEPTED);
    }
}

#[test]
fn slow_sticks_and_a_jump_of_them_change_nothing() {
    for deflection in [|t: f64| t / 2.0, |t: f64| f64::from(t > 0.5)] {
        let mut flight = with_sticks();
        fly_sticks(&mut flight, 4.0, deflection);
        assert_eq!(flight.autopilot.mode(), NavMode::Offboard);
        assert!(!flight.texts.iter().any(|t| t == TAKEN));
    }
}

#[test]
fn fast_sticks_take_over_from_a_mission_too() {
    let mut flight = holding(&[]);
    flight.upload(&[[200.0, 0.0, -5.0]]);
    assert_eq!(flight.set_mode(NavMode::Mission), MavResult::MAV_RESULT_ACCEPTED);
    fly_sticks(&mut flight, 2.0, |t| (t - 0.5) / 0.5);
    assert_eq!(flight.autopilot.mode(), NavMode::Position);
}

#[test]
fn sticks_received_and_then_lost_are_hold_for_five_seconds_and_a_return_although_setpoints_go_on() {
    let mut flight = with_sticks();
    let stay = here(&flight);
    let from_s = flight.now_s();
    let mut left_s = [None; 2];
    for _ in 0..1_750 {
        if ((flight.now_s() * 250.0).round() as u64).is_multiple_of(12) {
            send(&mut flight, &stay);
        }
        flight.step();
        let after_s = flight.now_s() - from_s;
        match flight.autopilot.mode() {
            NavMode::Hold => left_s[0] = left_s[0].or(Some(after_s)),
            NavMode::Return => left_s[1] = left_s[1].or(Some(after_s)),
            _ => {}
        }
    }
    // The last stick message came up to 0.05 s before; the link adds 0.02 s to what was seen.
    let [hold_s, return_s] = left_s.map(|s| s.expect("both stages") + 0.02);
    assert!((0.6..=0.7).contains(&hold_s), "{hold_s}");
    assert!((5.6..=5.75).contains(&return_s), "{return_s}");
    let said = "Failsafe activated: entering Hold for 5 seconds";
    assert!(flight.texts.iter().any(|t| t == said), "{:?}", flight.texts);
    stream(&mut flight, &stay, 0.05, 3.0);
    assert_eq!(
        flight.autopilot.mode(),
        NavMode::Return,
        "setpoints do not end it"
    );
    assert_eq!(flight.set_mode(NavMode::Offboard), MavResult::MAV_RESULT_ACCEPTED);
}

#[test]
fn sticks_never_received_are_not_missed_and_neither_are_those_of_before_arming() {
    let mut flight = staying(&[]);
    let stay = here(&flight);
    stream(&mut flight, &stay, 0.05, 10.0);
    assert_eq!(flight.autopilot.mode(), NavMode::Offboard);

    let mut flight = on_ground(&[]);
    flight.run(0.5);
    stick(&mut flight, 0);
    lift(&mut flight);
    assert_eq!(flight.autopilot.mode(), NavMode::Hold);
    assert!(!flight.texts.iter().any(|t| t.starts_with("Failsafe")));
}

#[test]
fn com_rc_override_is_gone_and_man_override_spd_switches_the_take_over_off() {
    let mut flight = staying(&[("MAN_OVERRIDE_SPD", 0.0)]);
    assert_eq!(flight.autopilot.parameter("COM_RC_OVERRIDE"), None);
    assert_eq!(flight.autopilot.parameter("MAN_OVERRIDE_SPD"), Some(0.0));
    fly_sticks(&mut flight, 2.0, |t| (t - 0.5) / 0.4);
    assert_eq!(flight.autopilot.mode(), NavMode::Offboard);
}
