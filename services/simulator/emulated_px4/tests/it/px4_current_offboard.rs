//! How current PX4 enters OFFBOARD, when it leaves it, and how it comes back. Every rule was observed on a real one.

#![allow(deprecated)]

use crate::support;
use crate::support::Flight;
use crate::support::current::{Speech, here};
use crate::support::current::{
    ask_for, cruise_north, holding, lift, on_ground, place, reported_modes, send, staying, stick, stream,
    watch,
};
use jink_emulated_autopilot::Autopilot;
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::*;

/// CURRENT_MODE.
const CURRENT_MODE: u32 = 436;
const ACCEPTED: MavResult = MavResult::MAV_RESULT_ACCEPTED;
const REJECTED: MavResult = MavResult::MAV_RESULT_TEMPORARILY_REJECTED;

/// Runs until CURRENT_MODE reports a mode other than `before`: how long that took (s), and which.
fn until_reported(flight: &mut Flight, before: NavMode, sticks: bool) -> (f64, NavMode) {
    let from_s = flight.now_s();
    let mut reported = None;
    for step in 0..5_000 {
        if sticks && step % 12 == 0 {
            stick(flight, 0);
        }
        flight.step();
        reported = reported_modes(flight).filter(|(mode, _)| *mode != before);
        if reported.is_some() {
            break;
        }
    }
    (flight.now_s() - from_s, reported.expect("another mode").0)
}

/// In OFFBOARD with the stream, CURRENT_MODE asked for at 50 Hz.
fn watched(parameters: &[(&str, f64)]) -> Flight {
    let mut flight = staying(parameters);
    assert_eq!(ask_for(&mut flight, CURRENT_MODE, 0.02), ACCEPTED);
    let stay = here(&flight);
    stream(&mut flight, &stay, 0.05, 1.0);
    flight
}

#[test]
fn in_the_air_one_setpoint_younger_than_the_loss_time_opens_offboard() {
    let mut flight = holding(&[]);
    assert_eq!(flight.set_mode(NavMode::Offboard), REJECTED);
    flight.step();
    assert_eq!(
        flight.texts.last().map(String::as_str),
        Some("Switching to Offboard is currently not available")
    );
    let stay = here(&flight);
    send(&mut flight, &stay);
    flight.run(1.1);
    assert_eq!(flight.set_mode(NavMode::Offboard), REJECTED, "too old");
    send(&mut flight, &stay);
    flight.run(0.8);
    assert_eq!(ask_for(&mut flight, CURRENT_MODE, 0.02), ACCEPTED);
    let from_s = flight.now_s();
    assert_eq!(flight.set_mode(NavMode::Offboard), ACCEPTED);
    assert!(flight.run_until(1.0, |f| {
        reported_modes(f).is_some_and(|(mode, _)| mode == NavMode::Offboard)
    }));
    let seen_s = flight.now_s() - from_s;
    assert!((0.015..=0.035).contains(&seen_s), "{seen_s}");
}

#[test]
fn on_the_ground_offboard_is_accepted_without_a_stream_and_arming_in_it_is_not() {
    let mut flight = on_ground(&[]);
    flight.run(2.0);
    assert_eq!(flight.set_mode(NavMode::Offboard), ACCEPTED);
    assert_eq!(flight.autopilot.mode(), NavMode::Offboard);
    assert_eq!(flight.arm(), REJECTED);
    flight.step();
    assert_eq!(
        flight.texts.last().map(String::as_str),
        Some("Arming denied: Resolve system health failures first")
    );
    stream(&mut flight, &place([0.0, 0.0, -4.5]), 0.05, 0.5);
    assert_eq!(flight.arm(), ACCEPTED);
}

#[test]
fn armed_in_offboard_it_takes_off_by_itself_to_the_setpoint() {
    let mut flight = on_ground(&[]);
    flight.run(2.0);
    let up = place([0.0, 0.0, -4.5]);
    stream(&mut flight, &up, 0.05, 0.5);
    flight.set_mode(NavMode::Offboard);
    assert_eq!(flight.arm(), ACCEPTED);
    stream(&mut flight, &up, 0.05, 7.0);
    let height = -flight.autopilot.truth().position.z_m;
    assert!((4.0..4.8).contains(&height), "4.5 m within some 6 s: {height}");
    assert_eq!(flight.autopilot.mode(), NavMode::Offboard);
}

#[test]
fn setpoints_at_1_05_hz_keep_the_mode_and_slower_ones_lose_it_about_every_two_seconds() {
    for (rate_hz, falls) in [(1.05, 0..=0), (0.95, 3..=5), (0.5, 4..=5)] {
        let mut flight = staying(&[]);
        let stay = here(&flight);
        stream(&mut flight, &stay, 1.0 / rate_hz, 8.0);
        let count = flight.autopilot.hold_count();
        assert!(falls.contains(&count), "{rate_hz} Hz: {count}");
    }
}

#[test]
fn a_stopped_stream_is_a_return_after_a_second_without_sticks_and_position_mode_with_them() {
    for sticks in [false, true] {
        let mut flight = watched(&[]);
        if sticks {
            let stay = here(&flight);
            for _ in 0..20 {
                stick(&mut flight, 0);
                stream(&mut flight, &stay, 0.05, 0.05);
            }
        }
        let stay = here(&flight);
        send(&mut flight, &stay);
        flight.step();
        let (after_s, mode) = until_reported(&mut flight, NavMode::Offboard, sticks);
        assert!((1.01..=1.13).contains(&after_s), "{after_s}");
        assert_eq!(
            mode,
            if sticks {
                NavMode::Position
            } else {
                NavMode::Return
            }
        );
        assert_eq!(flight.autopilot.intended_mode(), NavMode::Offboard);
        assert!(flight.texts.iter().any(|t| t == "Failsafe activated"));
        let returns = flight.texts.iter().any(|t| t.starts_with("RTL: start return at"));
        assert_eq!(returns, !sticks);
        assert_eq!(flight.autopilot.hold_count(), 1);
    }
}

#[test]
fn com_obl_rc_act_5_holds_and_com_of_loss_t_shortens_the_wait() {
    let hold = ("COM_OBL_RC_ACT", 5.0);
    for (parameters, expected) in [
        (vec![hold], 1.01..=1.13),
        (vec![hold, ("COM_OF_LOSS_T", 0.3)], 0.31..=0.43),
    ] {
        let mut flight = watched(&parameters);
        let stay = here(&flight);
        send(&mut flight, &stay);
        flight.step();
        let (after_s, mode) = until_reported(&mut flight, NavMode::Offboard, false);
        assert!(expected.contains(&after_s), "{after_s}");
        assert_eq!(mode, NavMode::Hold);
        assert!(flight.texts.iter().any(|t| t == "Failsafe activated"));
        flight.run(8.0);
        assert_eq!(flight.autopilot.mode(), NavMode::Hold, "no second stage follows");
    }
}

#[test]
fn the_stream_coming_back_re_enters_offboard_by_itself_however_late() {
    for (parameters, silence_s, sticks, meanwhile) in [
        (vec![], 12.0, false, NavMode::Return),
        (vec![("COM_OBL_RC_ACT", 5.0)], 4.0, false, NavMode::Hold),
        (vec![], 3.0, true, NavMode::Position),
    ] {
        let mut flight = watched(&parameters);
        // Far from home: the return is still on its way when the stream comes back.
        stream(&mut flight, &place([40.0, 0.0, -5.0]), 0.05, 15.0);
        watch(&mut flight, 0.2, sticks, |_| {});
        watch(&mut flight, silence_s, sticks, |_| {});
        assert_eq!(flight.autopilot.mode(), meanwhile);
        flight.run_until(1.0, |f| reported_modes(f).is_some());
        let stay = here(&flight);
        send(&mut flight, &stay);
        let (after_s, mode) = until_reported(&mut flight, meanwhile, sticks);
        assert_eq!(mode, NavMode::Offboard);
        assert!((0.025..=0.055).contains(&after_s), "{after_s}");
    }
}

#[test]
fn it_comes_back_from_a_return_that_has_climbed_and_flies_the_setpoint_again() {
    let mut flight = staying(&[]);
    let far = place([40.0, 0.0, -5.0]);
    stream(&mut flight, &far, 0.05, 15.0);
    flight.run(8.0);
    assert_eq!(flight.autopilot.mode(), NavMode::Return);
    assert!(-flight.autopilot.truth().position.z_m > 12.0, "it climbs");
    let back = place([38.0, 0.0, -5.0]);
    stream(&mut flight, &back, 0.05, 25.0);
    assert_eq!(flight.autopilot.mode(), NavMode::Offboard);
    let position = flight.autopilot.truth().position;
    assert!(
        (position.x_m - 38.0).abs() < 0.3 && (position.z_m + 5.0).abs() < 0.3,
        "{position:?}"
    );
}

#[test]
fn only_a_new_mode_command_ends_the_wish_for_offboard() {
    let mut flight = staying(&[]);
    flight.run(3.0);
    assert_eq!(flight.autopilot.mode(), NavMode::Return);
    assert_eq!(flight.set_mode(NavMode::Hold), ACCEPTED);
    let stay = here(&flight);
    stream(&mut flight, &stay, 0.05, 5.0);
    assert_eq!(
        flight.autopilot.mode(),
        NavMode::Hold,
        "the stream does not take over"
    );
    assert_eq!(flight.set_mode(NavMode::Offboard), ACCEPTED);
}

#[test]
fn the_return_climbs_to_30_m_far_from_home_and_stays_low_within_5_m_of_it() {
    for (north, expected) in [(40.0, 29.0..31.0), (4.0, 3.5..5.5)] {
        let mut flight = staying(&[]);
        stream(&mut flight, &place([north, 0.0, -4.0]), 0.05, 15.0);
        let mut highest = 0.0f64;
        watch(&mut flight, 45.0, false, |f| {
            highest = highest.max(-f.autopilot.truth().position.z_m);
        });
        assert!(expected.contains(&highest), "{north} m from home: {highest}");
    }
    let mut flight = staying(&[]);
    stream(&mut flight, &place([40.0, 0.0, -4.0]), 0.05, 15.0);
    flight.run(1.5);
    let said = "RTL: start return at 518 m (30 m above destination)";
    assert!(flight.texts.iter().any(|t| t == said), "{:?}", flight.texts);
}

#[test]
fn it_rests_five_to_seven_seconds_after_the_loss_without_a_stop_of_its_own() {
    let mut flight = on_ground(&[("COM_OBL_RC_ACT", 5.0)]);
    lift(&mut flight);
    support::current::enter_offboard(&mut flight);
    cruise_north(&mut flight, 8.0, Speech::Everything, false);
    let from_s = flight.now_s();
    assert!(flight.run_until(15.0, |f| support::speed(f) < 0.1));
    let rest_s = flight.now_s() - from_s;
    assert!((5.0..=7.0).contains(&rest_s), "{rest_s}");
}
