//! Sectors are level, turn with the vehicle, and hold the smallest distance; obstacles stay where they are.

use crate::common;
use crate::common::{Lidar, VehiclePose, World, beam, fly, points, random, ring, time, view};
use jink_shared_types::SampleHeader;
use jink_shared_types::params::ParamSet;
use jink_shared_types::ranges::RayKind::{Clear, Hit, Unknown};
use jink_shared_types::ring::{SECTOR_WIDTH_RAD, SECTORS, sector_bearing_rad, sector_of};
use proptest::prelude::*;
use std::f64::consts::PI;

const NOW_S: f64 = 10.0;

fn at_rest(place: VehiclePose) -> jink_collision_guard::ring::Ring {
    let mut ring = ring();
    fly(&mut ring, &|_| place, NOW_S - 0.2, NOW_S);
    ring
}

#[test]
fn the_nearest_hit_of_a_sector_counts_and_the_seam_is_round() {
    let mut ring = at_rest(VehiclePose::at(0.0, 0.0));
    let (cloud, header) = points(
        &[
            ([5.0, 0.2, 0.0], Hit),
            ([4.0, -0.1, 0.1], Hit),
            ([0.0, -3.0, 0.0], Hit),
        ],
        20.0,
        NOW_S,
    );
    ring.cloud(0, &cloud, &header).unwrap();
    let seen = view(&ring, NOW_S);
    assert!(
        (seen.distance_m[0] - 4.0).abs() < 0.01,
        "both sides of straight ahead are sector 0"
    );
    assert!((seen.distance_m[54] - 3.0).abs() < 1e-4);
    assert!(seen.distance_m[71].is_nan() && seen.distance_m[1].is_nan());
    assert_eq!(seen.range_max_m[1], 0.0);
    assert_eq!(seen.seen[54], time(NOW_S));
    assert_eq!(seen.range_min_m, 0.2);
}

#[test]
fn a_clear_ray_makes_its_sector_free_as_far_as_the_sensor_reaches() {
    let mut ring = at_rest(VehiclePose::at(0.0, 0.0));
    let (cloud, header) = points(
        &[([0.0, 15.0, 0.0], Clear), ([-4.0, 0.0, 0.0], Unknown)],
        15.0,
        NOW_S,
    );
    ring.cloud(0, &cloud, &header).unwrap();
    let seen = view(&ring, NOW_S);
    assert_eq!(seen.distance_m[18], f32::INFINITY);
    assert!((seen.range_max_m[18] - 15.0).abs() < 1e-3);
    assert!(seen.distance_m[36].is_nan(), "an unknown ray reports nothing");
}

#[test]
fn a_ray_that_leaves_the_height_band_says_nothing_about_what_is_beyond() {
    let mut ring = at_rest(VehiclePose::at(0.0, 0.0));
    // The band is half a metre: this ray leaves it at a third of its length.
    let (cloud, header) = points(
        &[
            ([12.0, 0.0, 1.5], Hit),
            ([0.0, 12.0, -1.5], Clear),
            ([-6.0, 0.0, 0.45], Hit),
        ],
        20.0,
        NOW_S,
    );
    ring.cloud(0, &cloud, &header).unwrap();
    let seen = view(&ring, NOW_S);
    assert_eq!(
        seen.distance_m[0],
        f32::INFINITY,
        "a hit below the band is no obstacle"
    );
    assert!((seen.range_max_m[0] - 4.0).abs() < 1e-3);
    assert!((seen.range_max_m[18] - 4.0).abs() < 1e-3);
    assert!((seen.distance_m[36] - 6.0).abs() < 1e-3);
}

#[test]
fn a_hit_on_the_vehicle_itself_is_neither_obstacle_nor_knowledge() {
    let mut ring = at_rest(VehiclePose::at(0.0, 0.0));
    let (cloud, header) = points(&[([0.2, 0.0, 0.1], Hit), ([0.0, 0.31, 0.0], Hit)], 20.0, NOW_S);
    ring.cloud(0, &cloud, &header).unwrap();
    let seen = view(&ring, NOW_S);
    assert!(seen.distance_m[0].is_nan());
    assert!((seen.distance_m[18] - 0.31).abs() < 1e-4);
}

#[test]
fn what_stands_level_is_seen_level_however_the_vehicle_tilts() {
    let world = World(vec![[6.0, 0.0, 0.3], [0.0, 5.0, 0.3]]);
    for (roll, pitch, yaw) in [
        (0.0, 0.0, 0.0),
        (0.3, -0.25, 0.0),
        (-0.2, 0.2, 1.0),
        (0.1, 0.3, -2.5),
    ] {
        let place = VehiclePose::at(0.0, 0.0).turned(roll, pitch, yaw);
        let ring = common::looking(&world, place, NOW_S);
        let seen = view(&ring, NOW_S);
        let north = seen.distance_m[sector_of(-yaw)];
        let east = seen.distance_m[sector_of(PI / 2.0 - yaw)];
        assert!((north - 5.7).abs() < 0.03, "{north} with {roll} {pitch} {yaw}");
        assert!((east - 4.7).abs() < 0.03, "{east} with {roll} {pitch} {yaw}");
        let clear = seen.range_max_m[sector_of(PI - yaw)];
        assert!(clear > 4.0, "{clear}: some row stays inside the band");
    }
}

#[test]
fn obstacles_stay_where_they_are_while_the_vehicle_moves_and_turns() {
    let mut ring = at_rest(VehiclePose::at(0.0, 0.0));
    let (cloud, header) = points(&[([6.0, 0.0, 0.0], Hit), ([0.0, 8.0, 0.0], Clear)], 8.0, NOW_S);
    ring.cloud(0, &cloud, &header).unwrap();
    // In the next 0.2 s it moves 1 m north and 1 m east and turns by 90 degrees.
    let place = |t: f64| {
        let share = ((t - NOW_S) / 0.2).clamp(0.0, 1.0);
        VehiclePose::at(share, share).turned(0.0, 0.0, share * PI / 2.0)
    };
    fly(&mut ring, &place, NOW_S + 0.02, NOW_S + 0.2);
    let seen = view(&ring, NOW_S + 0.2);
    let bearing = (-1.0_f64).atan2(5.0) - PI / 2.0;
    let distance = seen.distance_m[sector_of(bearing)];
    assert!((f64::from(distance) - 26.0_f64.sqrt()).abs() < 1e-3, "{distance}");
    assert_eq!(seen.distance_m.iter().filter(|d| d.is_finite()).count(), 1);
    assert_eq!(
        seen.seen[sector_of(bearing)],
        time(NOW_S),
        "as old as its measurement"
    );
}

#[test]
fn rays_of_a_long_sweep_are_placed_where_the_vehicle_was_then() {
    let world = World(vec![[6.0, 0.5, 0.2], [-5.0, -2.0, 0.2], [1.0, 6.0, 0.2]]);
    let place = |t: f64| VehiclePose {
        velocity: nalgebra::Vector3::new(4.0, -2.0, 0.0),
        rates: nalgebra::Vector3::new(0.0, 0.0, 1.0),
        ..VehiclePose::at(4.0 * (t - NOW_S), -2.0 * (t - NOW_S)).turned(0.1, -0.1, t - NOW_S)
    };
    let mut ring = ring();
    fly(&mut ring, &place, NOW_S - 0.3, NOW_S + 0.1);
    let (cloud, header) = Lidar::default().sweep(&world, &place, NOW_S, &mut random(1));
    ring.cloud(0, &cloud, &header).unwrap();
    let query = ring.query(time(NOW_S + 0.1));
    let mut found = 0;
    for [x, y] in query.obstacles() {
        let error = world.clearance_m(x, y).abs();
        assert!(error < 0.03, "({x}, {y}) is {error} from any surface");
        found += 1;
    }
    assert!(found >= 3, "{found}");
}

#[test]
fn where_two_sensors_overlap_the_smaller_distance_counts() {
    let mut ring = at_rest(VehiclePose::at(0.0, 0.0));
    for (sensor, range) in [(0, 7.0), (1, 4.0), (2, 9.0)] {
        let (cloud, header) = points(&[([range, 0.0, 0.0], Hit)], 20.0, NOW_S);
        ring.cloud(sensor, &cloud, &header).unwrap();
    }
    let (cloud, header) = points(&[([20.0, 0.0, 0.0], Clear)], 20.0, NOW_S);
    ring.cloud(3, &cloud, &header).unwrap();
    assert!(
        (view(&ring, NOW_S).distance_m[0] - 4.0).abs() < 1e-3,
        "clear elsewhere does not hide it"
    );
}

#[test]
fn a_dead_sensor_leaves_its_sectors_unknown_not_free() {
    let mut ring = at_rest(VehiclePose::at(0.0, 0.0));
    let (clear, header) = points(&[([20.0, 0.0, 0.0], Clear)], 20.0, NOW_S);
    ring.cloud(0, &clear, &header).unwrap();
    fly(
        &mut ring,
        &|_| VehiclePose::at(0.0, 0.0),
        NOW_S + 0.02,
        NOW_S + 0.3,
    );
    let (right, header) = points(&[([0.0, 6.0, 0.0], Hit)], 20.0, NOW_S + 0.2);
    ring.cloud(1, &right, &header).unwrap();
    let before = view(&ring, NOW_S + 0.24);
    assert_eq!(before.distance_m[0], f32::INFINITY);
    let after = view(&ring, NOW_S + 0.26);
    assert!(
        after.distance_m[0].is_nan() && after.range_max_m[0] == 0.0,
        "older than its topic's deadline"
    );
    assert!((after.distance_m[18] - 6.0).abs() < 1e-3, "the other one goes on");
    assert!(ring.is_fresh(time(NOW_S + 0.26)));
    assert!(!ring.is_fresh(time(NOW_S + 0.46)));
}

#[test]
fn what_was_free_counts_for_a_while_where_a_living_sensor_sees_nothing_now() {
    let here = VehiclePose::at(0.0, 0.0);
    let mut ring = at_rest(here);
    let look_at = |ring: &mut jink_collision_guard::ring::Ring, ends: &[([f64; 3], _)], at_s: f64| {
        fly(ring, &|_| here, at_s - 0.2, at_s);
        let (cloud, header) = points(ends, 20.0, at_s);
        ring.cloud(0, &cloud, &header).unwrap();
    };
    look_at(
        &mut ring,
        &[([12.0, 0.0, 0.0], Clear), ([0.0, 12.0, 0.0], Hit)],
        NOW_S,
    );
    // Its nose lifted, it sees the sky ahead, and nothing level.
    let ahead = |ring: &_, at_s| view(ring, at_s).range_max_m[0];
    let up = ([6.0, 0.0, -6.0], Hit);
    for i in 1..=8 {
        look_at(&mut ring, &[up], NOW_S + f64::from(i));
        let seen = view(&ring, NOW_S + f64::from(i));
        assert_eq!(seen.distance_m[0], f32::INFINITY);
        assert!((seen.range_max_m[0] - 12.0).abs() < 0.01, "{i}");
        assert!(
            seen.distance_m[18] == f32::INFINITY && (seen.range_max_m[18] - 12.0).abs() < 0.01,
            "an obstacle is not remembered, but nothing behind it is known either"
        );
    }
    assert_eq!(ahead(&ring, NOW_S + 8.3), 0.0, "its sensor is silent");
    look_at(&mut ring, &[up, ([3.0, 0.0, 0.0], Hit)], NOW_S + 9.0);
    let seen = view(&ring, NOW_S + 9.0);
    assert!(
        (seen.distance_m[0] - 3.0).abs() < 0.01,
        "an obstacle counts at once"
    );
    look_at(&mut ring, &[up], NOW_S + 10.5);
    assert!(ahead(&ring, NOW_S + 10.5) < 1.0, "that is too long ago");
}

#[test]
fn without_a_pose_nothing_is_known() {
    let mut ring = ring();
    let (cloud, header) = points(&[([4.0, 0.0, 0.0], Hit)], 20.0, NOW_S);
    assert!(ring.cloud(0, &cloud, &header).is_err());
    assert!(view(&ring, NOW_S).distance_m.iter().all(|d| d.is_nan()));
}

#[test]
fn a_moved_origin_drops_everything_seen_before() {
    let mut ring = at_rest(VehiclePose::at(0.0, 0.0));
    let (cloud, header) = points(&[([4.0, 0.0, 0.0], Hit)], 20.0, NOW_S);
    ring.cloud(0, &cloud, &header).unwrap();
    let mut state = VehiclePose::at(50.0, 0.0).state();
    state.estimator_resets = 1;
    ring.vehicle(&state, &SampleHeader::at(time(NOW_S + 0.02)))
        .unwrap();
    assert!(view(&ring, NOW_S + 0.02).distance_m.iter().all(|d| d.is_nan()));
    assert!(ring.is_fresh(time(NOW_S + 0.02)), "the sensor itself is well");
}

#[test]
fn a_range_below_the_sensor_s_shortest_is_an_obstacle_there() {
    let mut ring = at_rest(VehiclePose::at(0.0, 0.0));
    let mut scan = beam(0.5, 0.0, 0.0);
    scan.range_min_m = 0.8;
    ring.scan(0, &scan, &SampleHeader::at(time(NOW_S))).unwrap();
    assert!((view(&ring, NOW_S).distance_m[0] - 0.5).abs() < 1e-4);
}

#[test]
fn a_beam_that_sees_nothing_is_free_and_a_beam_that_knows_nothing_is_not() {
    let mut ring = at_rest(VehiclePose::at(0.0, 0.0));
    let header = SampleHeader::at(time(NOW_S));
    ring.scan(0, &beam(f32::INFINITY, 0.0, 0.0), &header).unwrap();
    ring.scan(1, &beam(f32::NAN, 0.0, PI), &header).unwrap();
    let seen = view(&ring, NOW_S);
    assert_eq!(seen.distance_m[0], f32::INFINITY);
    assert!((seen.range_max_m[0] - 10.0).abs() < 1e-4);
    assert!(seen.distance_m[36].is_nan());
}

#[test]
fn every_sector_of_a_full_turn_is_known_nearly_as_far_as_the_sensor_reaches() {
    // Large enough for the cloud to be sampled: what is left must not miss a level row anywhere.
    let lidar = Lidar {
        rows: 64,
        columns: 1_500,
        range_max_m: 20.0,
        ..Lidar::default()
    };
    let mut ring = at_rest(VehiclePose::at(0.0, 0.0));
    let (cloud, header) = lidar.sweep(
        &World::default(),
        &|_| VehiclePose::at(0.0, 0.0),
        NOW_S,
        &mut random(1),
    );
    ring.cloud(0, &cloud, &header).unwrap();
    let seen = view(&ring, NOW_S);
    for sector in 0..SECTORS {
        assert!(
            seen.range_max_m[sector] > 19.0,
            "sector {sector}: {}",
            seen.range_max_m[sector]
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn turning_the_vehicle_turns_the_sectors(
        turns in 0..72usize, bearing in 0..72usize, range in 1.0..15.0f64,
    ) {
        let yaw = sector_bearing_rad(turns);
        let (east, north) = sector_bearing_rad(bearing).sin_cos();
        let mut ring = at_rest(VehiclePose::at(0.0, 0.0).turned(0.0, 0.0, yaw));
        // The same place in the world, as the turned vehicle sees it.
        let (right, forward) = (sector_bearing_rad(bearing) - yaw).sin_cos();
        let (cloud, header) = points(&[([forward * range, right * range, 0.0], Hit)], 20.0, NOW_S);
        ring.cloud(0, &cloud, &header).unwrap();
        let seen = view(&ring, NOW_S);
        let sector = (bearing + SECTORS - turns) % SECTORS;
        prop_assert!((f64::from(seen.distance_m[sector]) - range).abs() < 1e-3);
        let place = ring.query(time(NOW_S)).obstacles().next().unwrap();
        prop_assert!((place[0] - north * range).hypot(place[1] - east * range) < 1e-4);
    }

    #[test]
    fn a_wide_beam_fills_every_sector_it_overlaps_and_no_other(
        toward in -PI..PI, width in 0.01..1.2f64, range in 1.0..9.0f64,
    ) {
        let mut ring = at_rest(VehiclePose::at(0.0, 0.0));
        ring.scan(0, &beam(range as f32, width, toward), &SampleHeader::at(time(NOW_S))).unwrap();
        let seen = view(&ring, NOW_S);
        for sector in 0..SECTORS {
            let off = jink_shared_types::frames::wrap_pi(sector_bearing_rad(sector) - toward).abs();
            let overlap = 0.5 * width + 0.5 * SECTOR_WIDTH_RAD - off;
            if overlap > 1e-3 {
                prop_assert!((f64::from(seen.distance_m[sector]) - range).abs() < 1e-3, "sector {} misses", sector);
            } else if overlap < -1e-3 {
                prop_assert!(seen.distance_m[sector].is_nan(), "sector {} is too much", sector);
            }
        }
    }

    #[test]
    fn no_obstacle_in_the_band_is_ever_farther_in_the_ring_than_it_is(
        places in proptest::collection::vec((0.5..15.0f64, -PI..PI, -0.45..0.45f64), 1..40),
        roll in -0.3..0.3f64, pitch in -0.3..0.3f64, yaw in -PI..PI,
    ) {
        let place = VehiclePose::at(3.0, -2.0).turned(roll, pitch, yaw);
        let mut ring = at_rest(place);
        let ends: Vec<_> = places
            .iter()
            .map(|(range, bearing, down)| {
                let (east, north) = bearing.sin_cos();
                let body = place.attitude.inverse() * nalgebra::Vector3::new(north * range, east * range, *down);
                ([body.x, body.y, body.z], Hit)
            })
            .collect();
        let (cloud, header) = points(&ends, 20.0, NOW_S);
        ring.cloud(0, &cloud, &header).unwrap();
        let seen = view(&ring, NOW_S);
        for (range, bearing, _) in &places {
            let to_border = (((bearing - yaw) / SECTOR_WIDTH_RAD).rem_euclid(1.0) - 0.5).abs();
            if to_border > 1e-3 {
                let reported = f64::from(seen.distance_m[sector_of(bearing - yaw)]);
                prop_assert!(reported <= range + 1e-3, "{} reported for {}", reported, range);
            }
        }
    }
}

#[test]
fn inside_a_fence_no_direction_is_reported_clear_however_the_vehicle_moves_after_the_sweep() {
    let fence: Vec<_> = (0..72)
        .map(|i| {
            let (y, x) = sector_bearing_rad(i).sin_cos();
            [6.0 * x, 6.0 * y, 0.5]
        })
        .collect();
    let mut ring = common::looking(&World(fence), VehiclePose::at(0.0, 0.0), NOW_S);
    let place = |t: f64| {
        let share = (t - NOW_S) / 0.2;
        VehiclePose::at(0.7 * share, -0.4 * share).turned(0.0, 0.0, 0.8 * share)
    };
    for i in 1..=10 {
        let t = NOW_S + 0.02 * f64::from(i);
        fly(&mut ring, &place, t, t);
        let seen = view(&ring, t);
        for (sector, distance) in seen.distance_m.iter().enumerate() {
            assert!(
                (4.0..7.0).contains(distance),
                "sector {sector}: {distance} at {t}"
            );
        }
    }
}

#[test]
fn the_band_is_the_parameter_s() {
    let mut params = ParamSet::default();
    params.set("GD_BAND", 2.0).unwrap();
    let mut ring = jink_collision_guard::ring::Ring::from_params(&params);
    fly(&mut ring, &|_| VehiclePose::at(0.0, 0.0), NOW_S - 0.2, NOW_S);
    let (cloud, header) = points(&[([5.0, 0.0, 1.5], Hit)], 20.0, NOW_S);
    ring.cloud(0, &cloud, &header).unwrap();
    let seen = view(&ring, NOW_S);
    assert!((seen.distance_m[0] - 5.0).abs() < 1e-3);
    assert_eq!(seen.band_half_m, 2.0);
}
