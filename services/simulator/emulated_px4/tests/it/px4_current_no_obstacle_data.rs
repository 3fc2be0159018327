//! Collision prevention of current PX4 that knows nothing, or nothing any more: no motion, and Hold after five seconds.
//! The figures are those observed on a real one.

#![allow(deprecated)]

use crate::support;
use crate::support::obstacles::{
    FORWARD, KEEP_4_M, RELEASED, cruising, enter_position, in_position, open_air, push, report, scan, within,
};
use crate::support::tracking_current::LIGHT;
use crate::support::{Flight, north_east, speed};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::Link;
use jink_emulated_autopilot::modes::px4::custom_mode;
use jink_emulated_px4::{HoldCause, Px4Config};
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::*;

#[test]
fn without_data_it_does_not_move_and_holds_after_five_seconds() {
    let mut flight = in_position(&[KEEP_4_M]);
    let (start, from_s) = (north_east(&flight), flight.now_s());
    let mut held_s = None;
    push(&mut flight, 8.0, FORWARD, None, |f| {
        if f.autopilot.mode() == NavMode::Hold {
            held_s = held_s.or(Some(f.now_s() - from_s));
        }
    });
    let end = north_east(&flight);
    assert!((end.0 - start.0).hypot(end.1 - start.1) < 0.2);
    println!("Hold after {held_s:?} (5.2)");
    assert!(held_s.is_some_and(|s| (5.0..=5.3).contains(&s)), "{held_s:?}");
    assert_eq!(flight.autopilot.intended_mode(), NavMode::Hold);
    assert_eq!(flight.autopilot.holds()[0].cause, HoldCause::NoObstacleData);
    assert!(
        flight.texts.iter().all(|text| !text.contains("obstacle")),
        "nobody is notified"
    );
    push(&mut flight, 3.0, RELEASED, Some((0.1, &open_air)), |_| {});
    assert_eq!(
        flight.autopilot.mode(),
        NavMode::Hold,
        "it does not come back by itself"
    );
    enter_position(&mut flight);
    push(&mut flight, 8.0, RELEASED, Some((0.1, &open_air)), |_| {});
    assert_eq!(flight.autopilot.mode(), NavMode::Position);
}

#[test]
fn nothing_but_unknown_distances_keep_it_in_place_and_in_position_mode() {
    let mut flight = in_position(&[KEEP_4_M]);
    let start = north_east(&flight);
    for _ in 0..90 {
        let mut unknown = scan(&flight, &open_air, MavFrame::MAV_FRAME_BODY_FRD);
        unknown.distances = [u16::MAX; 72];
        report(&mut flight, unknown);
        push(&mut flight, 0.1, FORWARD, None, |_| {});
    }
    let end = north_east(&flight);
    assert!((end.0 - start.0).hypot(end.1 - start.1) < 0.2);
    assert_eq!(flight.autopilot.mode(), NavMode::Position);
}

/// From cruise, after the last scan: way until rest (m), time of rest and of Hold (s).
fn after_the_last_scan(stick: [i16; 2], drag: f64) -> (f64, f64, f64) {
    let mut flight = cruising(drag);
    // The last one came 0.1 s before.
    let (start, from_s) = (north_east(&flight).0, flight.now_s() - 0.1);
    let (mut rest_s, mut rest_m, mut held_s) = (f64::NAN, f64::NAN, f64::NAN);
    push(&mut flight, 12.0, stick, None, |f| {
        if rest_s.is_nan() && speed(f) < 0.1 {
            rest_s = f.now_s() - from_s;
            rest_m = north_east(f).0 - start;
        }
        if held_s.is_nan() && f.autopilot.mode() == NavMode::Hold {
            held_s = f.now_s() - from_s;
        }
    });
    println!("way {rest_m:.1} m, rest {rest_s:.1} s, Hold {held_s:.2} s");
    (rest_m, rest_s, held_s)
}

#[test]
fn after_the_last_scan_it_drifts_as_far_as_the_sensor_sees_and_holds() {
    let (way_m, _, held_s) = after_the_last_scan(FORWARD, LIGHT);
    assert!(within(way_m, 15.0, 0.3), "{way_m}");
    assert!((5.5..=5.7).contains(&held_s), "{held_s}");
    let (way_m, rest_s, _) = after_the_last_scan(RELEASED, LIGHT);
    assert!(within(way_m, 8.0, 0.3), "{way_m}");
    assert!(within(rest_s, 2.5, 0.3), "{rest_s}");
}

#[test]
fn short_gaps_between_scans_are_not_felt_and_long_ones_slow_it_down() {
    // The next scan comes this much late.
    let slowest = |gap_s: f64| {
        let mut flight = cruising(LIGHT);
        let mut slowest_mps = f64::INFINITY;
        push(&mut flight, gap_s, FORWARD, None, |_| {});
        push(&mut flight, 1.0, FORWARD, Some((0.1, &open_air)), |f| {
            slowest_mps = slowest_mps.min(speed(f));
        });
        push(&mut flight, 10.0, FORWARD, Some((0.1, &open_air)), |_| {});
        assert_eq!(flight.autopilot.mode(), NavMode::Position, "{gap_s}");
        assert!(within(speed(&flight), 6.3, 0.1), "{gap_s}: it speeds up again");
        slowest_mps
    };
    for (gap_s, observed_mps) in [
        (0.3, 6.4),
        (0.45, 6.4),
        (0.6, 6.33),
        (0.8, 4.98),
        (1.5, 3.47),
        (3.0, 1.44),
        (4.7, 0.61),
    ] {
        let mps = slowest(gap_s);
        println!("gap {gap_s} s: {mps:.2} m/s ({observed_mps})");
        assert!(within(mps, observed_mps, 0.3), "{gap_s} s: {mps}");
    }
}

#[test]
fn nothing_but_a_bin_below_the_minimum_freezes_the_sticks_until_the_mode_is_entered_anew() {
    let mut flight = in_position(&[KEEP_4_M]);
    let mut near = scan(&flight, &open_air, MavFrame::MAV_FRAME_BODY_FRD);
    near.distances = [u16::MAX; 72];
    near.distances[36] = 15;
    report(&mut flight, near);
    push(&mut flight, 0.1, FORWARD, None, |_| {});
    let frozen = north_east(&flight);
    push(&mut flight, 8.0, FORWARD, Some((0.1, &open_air)), |_| {});
    let after = north_east(&flight);
    assert!(
        (after.0 - frozen.0).hypot(after.1 - frozen.1) < 0.5,
        "{frozen:?} {after:?}"
    );
    assert_eq!(flight.autopilot.mode(), NavMode::Position);
    assert_eq!(flight.set_mode(NavMode::Hold), MavResult::MAV_RESULT_ACCEPTED);
    push(&mut flight, 1.0, RELEASED, Some((0.1, &open_air)), |_| {});
    enter_position(&mut flight);
    push(&mut flight, 5.0, FORWARD, Some((0.1, &open_air)), |_| {});
    assert!(north_east(&flight).0 - after.0 > 5.0);
}

#[test]
fn the_command_for_hold_reaches_system_1_only() {
    for (system_id, expected) in [(1, NavMode::Hold), (2, NavMode::Position)] {
        let mut config = Px4Config::current(LIGHT);
        config.system_id = system_id;
        config.parameters.push((KEEP_4_M.0.to_owned(), KEEP_4_M.1));
        let mut flight = Flight::new(config);
        flight.run(2.0);
        // To everybody; on the ground any mode may be wished for.
        let position = MavMessage::SET_MODE(SET_MODE_DATA {
            custom_mode: custom_mode(NavMode::Position),
            target_system: 0,
            ..SET_MODE_DATA::default()
        });
        flight.from(Link::GroundStation, 255, 190, position);
        flight.step();
        assert_eq!(flight.autopilot.mode(), NavMode::Position);
        flight.run(7.0);
        assert_eq!(flight.autopilot.mode(), expected, "system {system_id}");
    }
}

#[test]
fn sent_to_hold_for_want_of_data_it_does_not_go_back_to_offboard_either() {
    let mut flight = support::current::staying(&[KEEP_4_M]);
    push(&mut flight, 3.0, RELEASED, None, |_| {});
    assert_eq!(flight.autopilot.mode(), NavMode::Position, "setpoints are lost");
    assert_eq!(flight.autopilot.intended_mode(), NavMode::Offboard);
    push(&mut flight, 5.0, RELEASED, None, |_| {});
    assert_eq!(flight.autopilot.mode(), NavMode::Hold);
    let place = support::current::here(&flight);
    for _ in 0..40 {
        support::current::send(&mut flight, &place);
        push(&mut flight, 0.05, RELEASED, None, |_| {});
    }
    assert_eq!(flight.autopilot.mode(), NavMode::Hold);
}
