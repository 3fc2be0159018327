//! What PX4 does when its companion's stream stops, starts late, or says nothing. Every rule was observed on a real PX4.

#![allow(deprecated)]

use crate::support::{
    Answer, Flight, cruising, demand_avoidance, no_waypoint, north_east, reply, speed, waypoint,
};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::{Link, script};
use jink_emulated_px4::{Firmware, HoldCause, Px4Config, Variant};
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::*;

const UNSET: [f32; 3] = [f32::NAN; 3];
const NO_YAW: [f32; 2] = [f32::NAN; 2];

#[test]
fn no_valid_point_leads_to_hold_after_half_a_second_to_a_second() {
    for variant in [Variant::A, Variant::B] {
        let mut flight = Flight::new(Px4Config {
            firmware: Firmware::Trajectory(variant),
            ..Px4Config::default()
        });
        flight.start_mission(&[[300.0, 0.0, -5.0]]);
        flight.run(2.0);
        flight.answer = Answer::Silent;
        let from_s = flight.now_s();
        while flight.autopilot.mode() == NavMode::Mission {
            flight.companion(196, no_waypoint());
            flight.run(0.02);
        }
        assert!((0.5..=1.0).contains(&(flight.now_s() - from_s)));
        assert_eq!(flight.autopilot.holds()[0].cause, HoldCause::NoValidPoint);
    }
}

#[test]
fn loiter_obeys_a_live_stream_and_comes_back_when_it_stops() {
    let mut flight = cruising();
    flight.set_mode(NavMode::Hold);
    flight.run(8.0);
    let place = north_east(&flight);
    reply(&mut flight, 6.0, |_| {
        waypoint([place.0 as f32, place.1 as f32 + 6.0, -5.0], UNSET, NO_YAW)
    });
    assert!(north_east(&flight).1 > place.1 + 4.5);
    flight.run(8.0);
    let back = north_east(&flight);
    assert!(
        (back.0 - place.0).hypot(back.1 - place.1) < 0.7,
        "{place:?} {back:?}"
    );
    assert_eq!(flight.autopilot.hold_count(), 0);
}

#[test]
fn a_stopped_stream_is_hold_after_0_54_s_an_overshoot_of_metres_and_the_way_back() {
    let mut flight = cruising();
    flight.answer = Answer::Echo;
    flight.companion(196, script::message_interval(332, 20_000.0));
    flight.run(8.0);
    assert!(speed(&flight) > 4.6);
    flight.answer = Answer::Silent;
    flight.inbox.clear();
    let (last_reply_s, last_reply_north) = (flight.now_s(), north_east(&flight).0);
    // As seen in the stream itself.
    let seen = flight.run_until(2.0, |f| f.desired.as_ref().is_some_and(|d| d.1.command[0] == 17));
    assert!(seen);
    let delay_s = flight.now_s() - last_reply_s;
    assert!((0.51..=0.56).contains(&delay_s), "{delay_s}");
    assert!(
        flight.texts.iter().all(|t| !t.contains("Avoidance")),
        "no text reaches the link"
    );
    let hold = flight.autopilot.holds()[0];
    assert_eq!(
        (hold.cause, hold.from),
        (HoldCause::StreamStopped, NavMode::Mission)
    );
    let place = flight
        .desired
        .as_ref()
        .map(|d| f64::from(d.1.pos_x[0]))
        .expect("the place it holds");
    let (mut furthest, mut furthest_s) = (0.0, 0.0);
    flight.run_until(10.0, |f| {
        if north_east(f).0 > furthest {
            (furthest, furthest_s) = (north_east(f).0, f.now_s());
        }
        false
    });
    // Observed at 4.67 m/s: 9.0 m past the last reply, 6.5 m past the place, furthest 2.7 s after the last reply.
    assert!(
        (7.5..10.5).contains(&(furthest - last_reply_north)),
        "{}",
        furthest - last_reply_north
    );
    assert!((5.0..8.0).contains(&(furthest - place)), "{}", furthest - place);
    assert!(
        (2.2..3.2).contains(&(furthest_s - last_reply_s)),
        "{}",
        furthest_s - last_reply_s
    );
    flight.run(8.0);
    assert!((north_east(&flight).0 - place).abs() < 0.5, "it flew back");
}

#[test]
fn gaps_of_0_4_s_hold_the_mode_and_gaps_of_0_6_s_lose_it() {
    for (gap_s, kept) in [(0.4, true), (0.6, false)] {
        let mut flight = cruising();
        flight.answer = Answer::Stream(gap_s);
        flight.run(5.0);
        assert_eq!(flight.autopilot.mode() == NavMode::Mission, kept, "{gap_s}");
    }
}

#[test]
fn a_resumed_stream_stays_in_loiter_until_somebody_sets_the_mission_again() {
    let mut flight = cruising();
    flight.run(3.0);
    flight.answer = Answer::Silent;
    flight.run(1.0);
    assert_eq!(flight.autopilot.mode(), NavMode::Hold);
    flight.answer = Answer::Stream(0.05);
    flight.run(6.0);
    assert_eq!(flight.autopilot.mode(), NavMode::Hold);
    assert_eq!(flight.set_mode(NavMode::Mission), MavResult::MAV_RESULT_ACCEPTED);
    flight.run(5.0);
    assert_eq!(flight.autopilot.mode(), NavMode::Mission);
    assert_eq!(flight.autopilot.hold_count(), 1);
}

#[test]
fn another_system_id_than_1_never_takes_its_own_demand_for_hold() {
    let mut flight = Flight::new(Px4Config {
        system_id: 2,
        parameters: vec![("COM_OBS_AVOID".to_owned(), 0.0)],
        ..Px4Config::default()
    });
    flight.heartbeat = None;
    flight.answer = Answer::Silent;
    flight.run(2.0);
    let command = |f: &mut Flight, command, param1, param2, param3| {
        let message = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            param1,
            param2,
            param3,
            command,
            target_system: 2,
            target_component: 1,
            ..COMMAND_LONG_DATA::default()
        });
        f.from(Link::GroundStation, 255, 190, message);
        f.run(0.1);
    };
    command(&mut flight, MavCmd::MAV_CMD_DO_SET_MODE, 1.0, 4.0, 3.0);
    command(&mut flight, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0, 0.0);
    command(&mut flight, MavCmd::MAV_CMD_DO_SET_MODE, 1.0, 4.0, 2.0);
    demand_avoidance(&mut flight, 2);
    flight.run(3.0);
    assert_eq!(flight.autopilot.mode(), NavMode::Takeoff);
    assert_eq!(flight.autopilot.hold_count(), 0);
}

#[test]
fn without_any_reply_a_take_off_turns_hold_at_once_and_still_climbs() {
    let mut flight = Flight::with(&[]);
    flight.answer = Answer::Silent;
    flight.begin_take_off();
    flight.run(0.1);
    assert_eq!(flight.autopilot.mode(), NavMode::Hold);
    flight.run(15.0);
    let height = -flight.autopilot.truth().position.z_m;
    assert!((2.3..2.7).contains(&height), "{height}");
}

/// In the air in Position mode under sticks, where nothing is asked and an echo has nothing to answer.
fn in_position_mode() -> Flight {
    let mut flight = cruising();
    flight.set_mode(NavMode::Hold);
    flight.run(4.0);
    stick(&mut flight);
    assert_eq!(flight.set_mode(NavMode::Position), MavResult::MAV_RESULT_ACCEPTED);
    let before = flight.questions;
    for _ in 0..20 {
        stick(&mut flight);
        flight.run(0.1);
    }
    assert!(
        flight.questions <= before + 1,
        "nothing is asked in Position mode"
    );
    assert_eq!(flight.autopilot.mode(), NavMode::Position);
    flight
}

fn stick(flight: &mut Flight) {
    let centred = MANUAL_CONTROL_DATA {
        z: 500,
        target: 1,
        ..MANUAL_CONTROL_DATA::default()
    };
    flight.from(Link::GroundStation, 255, 190, MavMessage::MANUAL_CONTROL(centred));
}

#[test]
fn mode_entry_trap_an_echo_is_too_late_a_free_stream_is_not() {
    let mut flight = in_position_mode();
    flight.answer = Answer::Echo;
    for _ in 0..10 {
        stick(&mut flight);
        flight.run(0.1);
    }
    flight.set_mode(NavMode::Mission);
    flight.run(0.1);
    assert_eq!(flight.autopilot.mode(), NavMode::Hold, "bounced at once");
    flight.run(1.0);
    flight.set_mode(NavMode::Mission);
    flight.run(2.0);
    assert_eq!(flight.autopilot.mode(), NavMode::Mission, "second try from Hold");

    let mut flight = in_position_mode();
    flight.answer = Answer::Stream(0.1);
    stick(&mut flight);
    flight.set_mode(NavMode::Mission);
    flight.run(2.0);
    assert_eq!(
        flight.autopilot.mode(),
        NavMode::Mission,
        "a free stream goes in at once"
    );
}

#[test]
fn variant_b_waits_in_the_mode_before_the_first_reply() {
    let mut flight = Flight::new(Px4Config {
        firmware: Firmware::Trajectory(Variant::B),
        ..Px4Config::default()
    });
    flight.answer = Answer::Silent;
    flight.begin_take_off();
    flight.run(4.0);
    assert_eq!(flight.autopilot.mode(), NavMode::Takeoff);
    assert!(flight.autopilot.truth().on_ground);
    flight.answer = Answer::Stream(0.1);
    flight.run(8.0);
    assert!(-flight.autopilot.truth().position.z_m > 1.0);
    assert_eq!(flight.autopilot.hold_count(), 0);
}
