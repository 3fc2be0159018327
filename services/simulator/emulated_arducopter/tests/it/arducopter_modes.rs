//! Modes: who may set them, what they do, and how the mission goes on.

#![allow(deprecated)]

use crate::support;
use crate::support::copter::{CopterFlight, PVA, at, level, setpoint, square};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::Link;
use jink_emulated_autopilot::modes::arducopter::Mode;
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::*;

const ACCEPTED: MavResult = MavResult::MAV_RESULT_ACCEPTED;

fn on_mission(parameters: &[(&str, f64)]) -> CopterFlight {
    let mut flight = CopterFlight::with(parameters);
    flight.run(6.0);
    assert_eq!(flight.upload(&square()), MavMissionResult::MAV_MISSION_ACCEPTED);
    flight.set_mode(Mode::Guided);
    assert_eq!(flight.arm(), ACCEPTED);
    assert_eq!(flight.ask(MavCmd::MAV_CMD_MISSION_START, [0.0; 7]), ACCEPTED);
    flight
}

#[test]
fn a_companion_may_set_every_mode_and_the_heartbeat_reports_it_at_once() {
    let mut flight = CopterFlight::airborne(&[]);
    flight.upload(&square());
    for mode in [Mode::Loiter, Mode::Brake, Mode::Auto, Mode::Guided] {
        assert_eq!(flight.set_mode(mode), ACCEPTED);
        let reported: Vec<(Link, u32)> = flight
            .received
            .iter()
            .filter_map(|packet| match &packet.message {
                MavMessage::HEARTBEAT(beat) => {
                    assert_eq!(beat.autopilot, MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA);
                    Some((packet.link, beat.custom_mode))
                }
                _ => None,
            })
            .collect();
        for link in Link::ALL {
            assert!(reported.contains(&(link, mode.custom())), "{mode:?} {reported:?}");
        }
    }
    flight.companion(MavMessage::SET_MODE(SET_MODE_DATA {
        custom_mode: 17,
        target_system: 1,
        base_mode: MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
    }));
    flight.step();
    assert_eq!(flight.copter.flight_mode(), Mode::Brake);
    let unknown = [1.0, 21.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    assert_eq!(
        flight.ask(MavCmd::MAV_CMD_DO_SET_MODE, unknown),
        MavResult::MAV_RESULT_FAILED
    );
}

#[test]
fn guided_is_offboard_and_auto_a_mission_to_those_who_do_not_know_the_make() {
    let mut flight = CopterFlight::airborne(&[]);
    assert_eq!(flight.copter.mode(), NavMode::Offboard);
    flight.set_mode(Mode::Brake);
    assert_eq!(flight.copter.mode(), NavMode::Hold);
}

#[test]
fn loiter_without_sticks_sinks_and_with_centred_sticks_holds() {
    let mut flight = CopterFlight::airborne(&[]);
    flight.set_mode(Mode::Loiter);
    let took_s = flight.run_until(10.0, |f| f.position().z > -1.5).unwrap();
    assert!((took_s - 3.5).abs() < 0.3 * 3.5, "{took_s}");

    let mut flight = CopterFlight::airborne(&[]);
    flight.sticks([1_500; 4]);
    flight.run(0.1);
    flight.set_mode(Mode::Loiter);
    for _ in 0..10 {
        flight.sticks([1_500; 4]);
        flight.run(1.0);
    }
    assert!((flight.position() - at(0.0, 0.0)).norm() < 0.2);
}

#[test]
fn overrides_count_from_the_ground_station_only() {
    let mut flight = CopterFlight::airborne(&[]);
    flight.set_mode(Mode::Loiter);
    flight.companion(MavMessage::RC_CHANNELS_OVERRIDE(RC_CHANNELS_OVERRIDE_DATA {
        chan3_raw: 1_500,
        target_system: 1,
        target_component: 1,
        ..RC_CHANNELS_OVERRIDE_DATA::default()
    }));
    flight.run(3.0);
    assert!(flight.position().z > -4.0, "it sinks all the same");
}

#[test]
fn a_whole_mission_is_flown_without_sticks_and_ends_disarmed() {
    let mut flight = on_mission(&[]);
    let reached = flight.collect(120.0, |packet| match &packet.message {
        MavMessage::MISSION_ITEM_REACHED(item) if packet.link == Link::Companion => Some(item.seq),
        _ => None,
    });
    assert_eq!(reached, [1, 2, 3, 4]);
    assert!(!flight.copter.is_armed());
    assert!(flight.copter.mission().done);
    let p = flight.position();
    assert!((p.x - 60.0).hypot(p.y - 30.0) < 0.5 && p.z == 0.0, "{p}");
}

#[test]
fn auto_goes_on_where_it_was_after_a_while_in_guided() {
    let mut flight = on_mission(&[("WPNAV_SPEED", 450.0)]);
    flight.run_until(40.0, |f| f.position().x > 25.0).unwrap();
    assert_eq!(flight.copter.mission().current, 2);
    // The companion's stream runs before it takes over, and is ignored until then.
    let (x0, t0) = (flight.position().x, flight.now_s());
    let stream = |flight: &mut CopterFlight, seconds: f64| {
        let mut slowest = f64::INFINITY;
        for _ in 0..(seconds * 50.0) as usize {
            let x = x0 + 4.5 * (flight.now_s() - t0);
            flight.companion(setpoint(PVA, at(x, 0.0), level(4.5, 0.0), level(0.0, 0.0)));
            flight.run(0.02);
            slowest = slowest.min(flight.speed());
        }
        (slowest, x0 + 4.5 * (flight.now_s() - t0) - flight.position().x)
    };
    stream(&mut flight, 0.5);
    assert_eq!(flight.copter.flight_mode(), Mode::Auto);
    flight.set_mode(Mode::Guided);
    let (slowest, behind_m) = stream(&mut flight, 3.0);
    assert!(slowest > 4.2 && behind_m.abs() < 0.3, "{slowest} {behind_m}");
    flight.set_mode(Mode::Auto);
    assert_eq!(flight.copter.mission().current, 2);
    flight
        .run_until(60.0, |f| f.copter.mission().current == 3)
        .unwrap();
    assert!(flight.position().x > 55.0);
}

#[test]
fn auto_to_guided_with_nothing_sent_stops_within_8_m_and_holds() {
    let mut flight = on_mission(&[("WPNAV_SPEED", 550.0)]);
    flight.run_until(40.0, |f| f.position().x > 20.0).unwrap();
    assert!((flight.speed() - 5.5).abs() < 0.2);
    flight.set_mode(Mode::Guided);
    let after = support::copter_tracking::watch(&mut flight, 12.0, |_, _| {});
    assert!((after.max - 8.07).abs() < 0.3 * 8.07, "{}", after.max);
    assert!(flight.speed() < 0.05);
}

#[test]
fn the_current_item_can_be_set_by_command_and_by_message() {
    let mut flight = on_mission(&[]);
    flight.run(14.0);
    let jump = [2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let command = MavCmd::MAV_CMD_DO_SET_MISSION_CURRENT;
    assert_eq!(flight.ask(command, jump), ACCEPTED);
    assert_eq!(flight.copter.mission().current, 2);
    let too_far = [9.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    assert_eq!(flight.ask(command, too_far), MavResult::MAV_RESULT_DENIED);
    flight.station(MavMessage::MISSION_SET_CURRENT(MISSION_SET_CURRENT_DATA {
        seq: 3,
        target_system: 1,
        target_component: 1,
    }));
    flight.step();
    assert_eq!(flight.copter.mission().current, 3);
}

#[test]
fn a_change_of_speed_counts_at_once_in_auto() {
    let mut flight = on_mission(&[("WPNAV_SPEED", 300.0)]);
    flight.run_until(40.0, |f| f.position().x > 10.0).unwrap();
    assert!((flight.speed() - 3.0).abs() < 0.1, "{}", flight.speed());
    let faster = [1.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    assert_eq!(flight.ask(MavCmd::MAV_CMD_DO_CHANGE_SPEED, faster), ACCEPTED);
    flight.run(4.0);
    assert!((flight.speed() - 5.0).abs() < 0.2, "{}", flight.speed());
}

#[test]
fn auto_pauses_on_the_way_and_continues() {
    let mut flight = on_mission(&[("WPNAV_SPEED", 450.0)]);
    flight.run_until(40.0, |f| f.position().x > 15.0).unwrap();
    let pause = MavCmd::MAV_CMD_DO_PAUSE_CONTINUE;
    assert_eq!(flight.ask(pause, [0.0; 7]), ACCEPTED);
    flight.run(6.0);
    assert!(flight.speed() < 0.1);
    let go_on = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    assert_eq!(flight.ask(pause, go_on), ACCEPTED);
    flight
        .run_until(40.0, |f| f.copter.mission().current == 3)
        .unwrap();
}

#[test]
fn auto_needs_a_mission_and_on_the_ground_a_take_off_in_it() {
    let mut flight = CopterFlight::with(&[]);
    flight.run(6.0);
    assert_eq!(flight.set_mode(Mode::Auto), MavResult::MAV_RESULT_FAILED);
    let mut items = square();
    items.remove(1);
    flight.upload(&items);
    flight.set_mode(Mode::Guided);
    flight.arm();
    assert_eq!(flight.set_mode(Mode::Auto), MavResult::MAV_RESULT_FAILED);
    assert!(flight.texts.iter().any(|t| t.ends_with("Missing Takeoff Cmd")));
}

#[test]
fn a_return_climbs_comes_home_waits_and_lands() {
    let mut flight = CopterFlight::airborne(&[]);
    flight.companion(setpoint(
        support::copter::POSITION,
        at(20.0, 10.0),
        level(0.0, 0.0),
        level(0.0, 0.0),
    ));
    flight.run(12.0);
    flight.set_mode(Mode::Rtl);
    let mut highest = 0.0f64;
    flight
        .run_until(120.0, |f| {
            highest = highest.max(-f.position().z);
            !f.copter.is_armed()
        })
        .unwrap();
    assert!((highest - 15.0).abs() < 0.3, "{highest}");
    assert!(flight.position().norm() < 0.3);
}
