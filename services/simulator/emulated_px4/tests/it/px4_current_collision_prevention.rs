//! Collision prevention of current PX4 in Position mode. The figures are those observed on a real one, 72 elements of 5
//! degrees, at most 15 m, CP_DIST 4.

#![allow(deprecated)]

use crate::support;
use crate::support::current::ask_for;
use crate::support::obstacles::{
    FORWARD, KEEP_4_M, RELEASED, cruising, in_position, in_position_with_drag, open_air, push, report, scan,
    wall, wall_with_gap, within,
};
use crate::support::tracking_current::{HEAVY, LIGHT};
use crate::support::{Flight, north_east, speed};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::Link;
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::*;

/// Distances to a wall (m).
struct Approach {
    closest_m: f64,
    bounced_to_m: f64,
    last_m: f64,
}

/// Pushed with a stick for `seconds` towards a wall 40 m ahead.
fn pushed_to_the_wall(drag: f64, stick: [i16; 2], scan_every_s: f64, seconds: f64) -> Approach {
    let mut flight = in_position_with_drag(drag, &[KEEP_4_M]);
    let wall_m = north_east(&flight).0 + 40.0;
    let (mut closest_m, mut bounced_to_m) = (f64::INFINITY, 0.0);
    push(
        &mut flight,
        seconds,
        stick,
        Some((scan_every_s, &wall(wall_m))),
        |f| {
            let left_m = wall_m - north_east(f).0;
            if left_m < closest_m {
                (closest_m, bounced_to_m) = (left_m, left_m);
            }
            bounced_to_m = left_m.max(bounced_to_m);
        },
    );
    assert_eq!(flight.autopilot.mode(), NavMode::Position);
    let last_m = wall_m - north_east(&flight).0;
    println!("closest {closest_m:.2} m, bounced to {bounced_to_m:.2}, last {last_m:.2}");
    Approach {
        closest_m,
        bounced_to_m,
        last_m,
    }
}

#[test]
fn pushed_at_full_stick_towards_a_wall_it_comes_to_rest_near_the_distance_to_keep() {
    let light = pushed_to_the_wall(LIGHT, FORWARD, 0.1, 25.0);
    assert!(within(light.closest_m, 3.95, 0.1), "{}", light.closest_m);
    assert!(within(light.last_m, 4.2, 0.1), "{}", light.last_m);
    let heavy = pushed_to_the_wall(HEAVY, FORWARD, 0.1, 25.0);
    assert!(within(heavy.closest_m, 3.13, 0.1), "{}", heavy.closest_m);
    assert!(within(heavy.bounced_to_m, 5.9, 0.3), "{}", heavy.bounced_to_m);
}

#[test]
fn scans_at_2_hz_stop_it_too() {
    let slow = pushed_to_the_wall(LIGHT, FORWARD, 0.5, 25.0);
    assert!(within(slow.last_m, 4.56, 0.1), "{}", slow.last_m);
}

#[test]
fn half_stick_is_still_closing_in_after_sixteen_seconds() {
    let half = pushed_to_the_wall(LIGHT, [500, 0], 0.1, 16.0);
    assert!(within(half.last_m, 6.25, 0.1), "{}", half.last_m);
    assert_eq!(half.last_m, half.closest_m);
}

#[test]
fn the_range_of_the_sensor_limits_the_speed() {
    let light = speed(&cruising(LIGHT));
    println!("{light:.2} m/s (6.3)");
    assert!(within(light, 6.3, 0.1), "{light}");
}

#[test]
fn switched_off_nothing_changes_and_the_wall_is_flown_through() {
    let fly = |parameters: &[(&str, f64)], scans: bool| {
        let mut flight = in_position(parameters);
        let wall_m = north_east(&flight).0 + 40.0;
        let world = wall(wall_m);
        let scans = scans.then_some((0.1, &world as support::obstacles::World));
        push(&mut flight, 14.0, FORWARD, scans, |_| {});
        assert_eq!(flight.autopilot.mode(), NavMode::Position);
        flight.autopilot.truth().position
    };
    let off = fly(&[("CP_DIST", -1.0)], true);
    assert!(off.x_m > 60.0, "{off:?}");
    assert_eq!(off, fly(&[("CP_DIST", 0.0)], true));
    assert_eq!(off, fly(&[], false));
}

#[test]
fn full_stick_without_obstacles_flies_at_the_manual_speed_and_released_ones_hold_the_place() {
    let mut flight = in_position(&[("MPC_VEL_MANUAL", 6.0)]);
    push(&mut flight, 15.0, FORWARD, None, |_| {});
    let cruise_mps = speed(&flight);
    assert!(within(cruise_mps, 6.0, 0.05), "{cruise_mps}");
    push(&mut flight, 8.0, RELEASED, None, |_| {});
    let held = north_east(&flight);
    push(&mut flight, 10.0, RELEASED, None, |_| {});
    let after = north_east(&flight);
    assert!((after.0 - held.0).hypot(after.1 - held.1) < 0.1);
}

#[test]
fn a_stick_aslant_slides_along_the_wall() {
    for (stick, least_mps) in [([1_000, 1_000], 4.0), ([500, 500], 1.0)] {
        let mut flight = in_position(&[KEEP_4_M]);
        let wall_m = north_east(&flight).0 + 12.0;
        let world = wall(wall_m);
        push(&mut flight, 12.0, FORWARD, Some((0.1, &world)), |_| {});
        let start = north_east(&flight);
        let mut closest_m = f64::INFINITY;
        push(&mut flight, 5.0, stick, Some((0.1, &world)), |f| {
            closest_m = closest_m.min(wall_m - north_east(f).0);
        });
        let end = north_east(&flight);
        println!(
            "{stick:?}: {:.2} m/s at last (2.7 to 3.5), {:.2} -> {:.2} m from the wall (4.2 -> 5.5)",
            speed(&flight),
            wall_m - start.0,
            wall_m - end.0
        );
        assert!(
            (end.1 - start.1) / 5.0 > least_mps * 0.5 && speed(&flight) > least_mps,
            "{end:?}"
        );
        assert!(closest_m > 3.5, "{closest_m}");
        assert!(wall_m - end.0 > wall_m - start.0, "it drifts away from it");
    }
}

#[test]
fn guidance_leads_through_a_gap_that_the_stick_only_just_misses() {
    let fly = |guide_deg: f64| {
        let mut flight = in_position(&[("CP_DIST", 1.0), ("CP_GUIDE_ANG", guide_deg)]);
        let start = north_east(&flight);
        let (wall_m, gap_m) = (start.0 + 12.0, [start.1 + 0.5, start.1 + 6.5]);
        push(
            &mut flight,
            25.0,
            FORWARD,
            Some((0.1, &wall_with_gap(wall_m, gap_m))),
            |_| {},
        );
        let end = north_east(&flight);
        println!(
            "guide {guide_deg}: {:.1} m past the wall, {:.1} m east",
            end.0 - wall_m,
            end.1 - start.1
        );
        (end.0 - wall_m, end.1 - start.1)
    };
    let (past_m, east_m) = fly(30.0);
    assert!(past_m > 2.0 && east_m > 0.5, "{past_m} {east_m}");
    let (past_m, east_m) = fly(0.0);
    assert!(past_m < 0.0 && east_m.abs() < 0.5, "{past_m} {east_m}");
}

#[test]
fn body_and_north_frames_are_both_right_whatever_the_heading() {
    let rest = |frame: MavFrame| {
        let mut flight = in_position(&[KEEP_4_M]);
        while flight.autopilot.truth().attitude.yaw_rad() < 104f64.to_radians() {
            let turn = MANUAL_CONTROL_DATA {
                r: 500,
                z: 500,
                target: 1,
                ..MANUAL_CONTROL_DATA::default()
            };
            flight.from(Link::GroundStation, 255, 190, MavMessage::MANUAL_CONTROL(turn));
            let seen = scan(&flight, &open_air, frame);
            report(&mut flight, seen);
            flight.run(0.02);
        }
        let start = north_east(&flight);
        // A wall across the nose's direction east, 20 m away.
        let east_wall_m = start.1 + 20.0;
        let world = move |from: nalgebra::Vector2<f64>, angle_rad: f64| {
            let way_m = (east_wall_m - from.y) / angle_rad.sin();
            if way_m > 0.0 { way_m } else { f64::INFINITY }
        };
        for _ in 0..200 {
            let seen = scan(&flight, &world, frame);
            report(&mut flight, seen);
            push(&mut flight, 0.1, FORWARD, None, |_| {});
        }
        east_wall_m - north_east(&flight).1
    };
    let body_m = rest(MavFrame::MAV_FRAME_BODY_FRD);
    let north_m = rest(MavFrame::MAV_FRAME_LOCAL_NED);
    let global_m = rest(MavFrame::MAV_FRAME_GLOBAL);
    println!("{body_m:.2} (4.68) {north_m:.2} (4.65) {global_m:.2}");
    for m in [body_m, north_m, global_m] {
        assert!(within(m, 4.66, 0.3), "{m}");
    }
}

#[test]
fn an_unsupported_frame_is_reported_at_every_message_and_moves_nothing() {
    let mut flight = in_position(&[KEEP_4_M]);
    let start = north_east(&flight);
    let reported = |f: &Flight| {
        let texts = f.texts.iter();
        texts
            .filter(|t| *t == "Obstacle message received in unsupported frame 4")
            .count()
    };
    for _ in 0..10 {
        let mut seen = scan(&flight, &open_air, MavFrame::MAV_FRAME_BODY_FRD);
        seen.frame = MavFrame::MAV_FRAME_LOCAL_ENU;
        report(&mut flight, seen);
        push(&mut flight, 0.1, FORWARD, None, |_| {});
    }
    assert_eq!(reported(&flight), 10);
    assert!((north_east(&flight).0 - start.0).abs() < 0.2);
}

#[test]
fn the_fused_map_comes_back_at_10_hz_in_position_mode_only() {
    let received = |flight: &mut Flight, link: Link| {
        let mut maps = Vec::new();
        push(flight, 4.0, RELEASED, Some((0.1, &wall(30.0))), |f| {
            maps.extend(f.received.iter().filter_map(|p| match &p.message {
                MavMessage::OBSTACLE_DISTANCE(m) if p.link == link && p.header.component_id == 1 => {
                    Some(m.clone())
                }
                _ => None,
            }));
        });
        maps
    };
    let mut flight = in_position(&[KEEP_4_M]);
    let maps = received(&mut flight, Link::Companion);
    assert!((38..=41).contains(&maps.len()), "{}", maps.len());
    let last = maps.last().unwrap();
    assert_eq!(last.frame, MavFrame::MAV_FRAME_BODY_FRD);
    assert_eq!(
        (last.increment, last.increment_f, last.angle_offset),
        (0, 5.0, 0.0)
    );
    assert_eq!((last.min_distance, last.max_distance), (20, 1_500));
    assert_eq!(last.distances, [1_501; 72]);
    let maps = received(&mut flight, Link::GroundStation);
    assert!((3..=5).contains(&maps.len()), "{}", maps.len());
    assert_eq!(flight.set_mode(NavMode::Hold), MavResult::MAV_RESULT_ACCEPTED);
    flight.run(0.2);
    assert!(received(&mut flight, Link::Companion).is_empty());
    assert!(received(&mut in_position(&[]), Link::Companion).is_empty());
    assert_eq!(ask_for(&mut flight, 330, 0.05), MavResult::MAV_RESULT_ACCEPTED);
}

#[test]
fn a_rangefinder_that_looks_ahead_stops_it_and_one_that_looks_down_does_not_count() {
    let fly = |orientation: MavSensorOrientation| {
        let mut flight = in_position(&[KEEP_4_M]);
        let start = north_east(&flight);
        let wall_m = start.0 + 14.0;
        for _ in 0..200 {
            let ahead_m = wall_m - north_east(&flight).0;
            let reading = DISTANCE_SENSOR_DATA {
                min_distance: 20,
                max_distance: 1_500,
                current_distance: (ahead_m * 100.0).clamp(0.0, 1_500.0) as u16,
                horizontal_fov: 0.5,
                orientation,
                ..DISTANCE_SENSOR_DATA::default()
            };
            flight.companion(196, MavMessage::DISTANCE_SENSOR(reading));
            push(&mut flight, 0.1, FORWARD, None, |_| {});
        }
        (wall_m - north_east(&flight).0, north_east(&flight).0 - start.0)
    };
    let (left_m, _) = fly(MavSensorOrientation::MAV_SENSOR_ROTATION_NONE);
    println!("{left_m:.2} m left");
    assert!(within(left_m, 4.2, 0.15), "{left_m}");
    let (_, moved_m) = fly(MavSensorOrientation::MAV_SENSOR_ROTATION_PITCH_270);
    assert!(moved_m.abs() < 0.2, "{moved_m}");
}

#[test]
fn in_offboard_it_does_nothing_whatever_is_near() {
    let mut flight = support::current::staying(&[KEEP_4_M]);
    let start = north_east(&flight).0;
    let mut place = support::current::here(&flight);
    place.x += 8.0;
    for _ in 0..200 {
        let seen = scan(&flight, &wall(start + 3.0), MavFrame::MAV_FRAME_BODY_FRD);
        report(&mut flight, seen);
        support::current::stream(&mut flight, &place, 0.05, 0.05);
    }
    assert!(within(north_east(&flight).0 - start, 8.0, 0.1));
}
