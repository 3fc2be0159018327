//! The laws of planar scans: the reading of a 2-D lidar in a direction is in the sectors of that direction, in no
//! other, however the vehicle is turned, tilted and moving, and as long as it counts.

use crate::common::{VehiclePose, fly, ring, time, view};
use jink_collision_guard::ring::Ring;
use jink_shared_types::SampleHeader;
use jink_shared_types::frames::{Attitude, Mounting, wrap_pi};
use jink_shared_types::ranges::RangeScan;
use jink_shared_types::ring::{SECTOR_WIDTH_RAD, SECTORS, sector_bearing_rad, sector_of, sectors_of_arc};
use nalgebra::{UnitQuaternion, Vector2, Vector3};
use proptest::prelude::*;
use std::f64::consts::{FRAC_PI_6, PI};

const NOW_S: f64 = 10.0;
/// A thin beam, as lidars have (rad).
const THIN_RAD: f64 = 0.006;

/// Beams of `width_rad` side by side, the first one towards `first_rad`, on a sensor that is turned by `mounting_rad`.
fn scan(first_rad: f64, width_rad: f64, mounting_rad: f64, range_m: &[f32]) -> RangeScan {
    let mut scan = RangeScan {
        mounting: Mounting::from_rotation(UnitQuaternion::from_euler_angles(0.0, 0.0, mounting_rad)),
        angle_first_rad: first_rad as f32,
        angle_step_rad: width_rad as f32,
        beam_width_rad: width_rad as f32,
        range_min_m: 0.1,
        range_max_m: 12.0,
        beams: range_m.len() as u32,
        ..RangeScan::default()
    };
    scan.range_m[..range_m.len()].copy_from_slice(range_m);
    scan
}

/// A whole turn of 72 beams that fit the sectors, all saying `range_m`.
fn turn(range_m: f32) -> RangeScan {
    RangeScan {
        beam_width_rad: (SECTOR_WIDTH_RAD - 1e-4) as f32,
        ..scan(0.0, SECTOR_WIDTH_RAD, 0.0, &[range_m; SECTORS])
    }
}

fn at_rest(yaw_rad: f64) -> Ring {
    let mut ring = ring();
    let place = VehiclePose::at(0.0, 0.0).turned(0.0, 0.0, yaw_rad);
    fly(&mut ring, &|_| place, NOW_S - 0.2, NOW_S + 1.0);
    ring
}

fn show(ring: &mut Ring, sensor: usize, scan: &RangeScan, at_s: f64) {
    ring.scan(sensor, scan, &SampleHeader::at(time(at_s))).unwrap();
}

/// Whether a bearing is so near to the border of two sectors that rounding decides, or a thin beam fills both.
fn is_on_border(bearing_rad: f64) -> bool {
    let place = (bearing_rad / SECTOR_WIDTH_RAD).rem_euclid(1.0) - 0.5;
    place.abs() * SECTOR_WIDTH_RAD < 0.5 * THIN_RAD + 1e-3
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// The obstacle is an upright line: a tilted beam meets it above or below the vehicle, and reports how far away it
    /// stands. Of a vehicle that has moved by `moved_m`, directions beside the beam may be reported shorter by what the
    /// rim of its sector, five degrees wide, is nearer from there: at most 0.15 of `moved_m`.
    #[test]
    fn an_obstacle_is_where_it_was_seen_whatever_the_vehicle_does(
        yaw_rad in -PI..PI, tilt_rad in 0.0..FRAC_PI_6, lean_rad in -PI..PI, mounting_rad in -PI..PI,
        bearing_rad in -PI..PI, distance_m in 1.5..9.0f64,
        speed_mps in 0.0..4.0f64, course_rad in -PI..PI, turn_radps in -1.0..1.0f64, later_s in 0.0..0.14f64,
    ) {
        let (east, north) = course_rad.sin_cos();
        let lean = UnitQuaternion::from_scaled_axis(
            Vector3::new(lean_rad.cos(), lean_rad.sin(), 0.0) * tilt_rad);
        let place = |t: f64| {
            let passed_s = t - NOW_S;
            let turned = UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad + turn_radps * passed_s);
            VehiclePose {
                velocity: Vector3::new(north, east, 0.0) * speed_mps,
                attitude: lean * turned,
                ..VehiclePose::at(north * speed_mps * passed_s, east * speed_mps * passed_s)
            }
        };
        let mut ring = ring();
        fly(&mut ring, &place, NOW_S - 0.2, NOW_S + 0.2);
        // The beam of the tilted plane that stands over the bearing: it leaves the horizon by so much.
        let attitude = place(NOW_S).attitude;
        let normal = attitude * Vector3::z();
        let over = Vector3::new(bearing_rad.cos(), bearing_rad.sin(), 0.0);
        let along = over - Vector3::z() * (over.dot(&normal) / normal.z);
        let in_body = attitude.inverse() * along;
        let first_rad = in_body.y.atan2(in_body.x) - mounting_rad;
        let range_m = (distance_m * along.norm()) as f32;
        prop_assume!(range_m < 12.0);
        show(&mut ring, 0, &scan(first_rad, THIN_RAD, mounting_rad, &[range_m, f32::NAN]), NOW_S);

        let now_s = NOW_S + later_s;
        let seen = view(&ring, now_s);
        let here = place(now_s);
        let moved_m = here.position.xy().norm();
        let from_here = |bearing_rad: f64| {
            let to = Vector2::new(bearing_rad.cos(), bearing_rad.sin()) * distance_m - here.position.xy();
            (wrap_pi(to.y.atan2(to.x) - Attitude::from_rotation(here.attitude).yaw_rad()), to.norm())
        };
        let (now_rad, now_m) = from_here(bearing_rad);
        if !is_on_border(now_rad) {
            let reported_m = f64::from(seen.distance_m[sector_of(now_rad)]);
            // The beam is that wide: anywhere in it may be what it met.
            let aside_m = 0.5 * THIN_RAD * moved_m;
            prop_assert!(reported_m <= now_m + 1e-3 + aside_m, "{} m seen for {}", reported_m, now_m);
            prop_assert!(reported_m >= now_m - 1e-3 - 0.15 * moved_m, "{} m seen for {}", reported_m, now_m);
        }
        // The rim of the sector that the vehicle had there when it looked.
        let heading_rad = Attitude::from_rotation(attitude).yaw_rad();
        let middle_rad = heading_rad + sector_bearing_rad(sector_of(bearing_rad - heading_rad));
        let [left, right] = [-0.5, 0.5].map(|side| from_here(middle_rad + side * SECTOR_WIDTH_RAD).0);
        for sector in 0..SECTORS {
            let is_finite = seen.distance_m[sector].is_finite();
            let off_rad = wrap_pi(sector_bearing_rad(sector) - now_rad).abs();
            // From the side a rim is seen turned; the borders of the beam's own sector may have been touched, too.
            let reach_rad = wrap_pi(left - now_rad).abs().max(wrap_pi(right - now_rad).abs()) + 0.02;
            let may_show = off_rad <= reach_rad.max(0.5 * SECTOR_WIDTH_RAD + 0.5 * THIN_RAD + 1e-3)
                || is_on_border(bearing_rad - heading_rad);
            prop_assert!(!is_finite || may_show, "sector {} reports {}", sector, seen.distance_m[sector]);
        }
    }

    #[test]
    fn beams_fill_every_sector_that_they_touch_round_the_seam_and_no_other(
        yaw_rad in -PI..PI, mounting_rad in -PI..PI, first_rad in -7.0..7.0f64,
        count in 2..40usize, width_rad in 0.005..0.1f64, range_m in 1.0..11.0f32,
    ) {
        let mut ring = at_rest(yaw_rad);
        show(&mut ring, 0, &scan(first_rad, width_rad, mounting_rad, &vec![range_m; count]), NOW_S);
        let seen = view(&ring, NOW_S);
        let from_rad = first_rad + mounting_rad - 0.5 * width_rad;
        let whole_rad = count as f64 * width_rad;
        let surely: Vec<usize> = sectors_of_arc(from_rad + 1e-3, (whole_rad - 2e-3).max(0.0)).collect();
        let perhaps: Vec<usize> = sectors_of_arc(from_rad - 1e-3, whole_rad + 2e-3).collect();
        for sector in 0..SECTORS {
            let reported_m = seen.distance_m[sector];
            prop_assert!(!surely.contains(&sector) || (reported_m - range_m).abs() < 1e-3, "sector {}: {}", sector, reported_m);
            prop_assert!(perhaps.contains(&sector) || reported_m.is_nan(), "sector {} is too much: {}", sector, reported_m);
        }
    }

    #[test]
    fn nothing_there_clears_its_own_sectors_and_unknown_clears_none(
        first in 0..SECTORS, count in 2..60usize, range_m in 1.0..11.0f32, is_other: bool,
    ) {
        for (answer_m, is_empty) in [(f32::INFINITY, true), (f32::NAN, false)] {
            let mut ring = at_rest(0.0);
            show(&mut ring, 0, &turn(range_m), NOW_S);
            let mut part = scan(sector_bearing_rad(first), SECTOR_WIDTH_RAD, 0.0, &vec![answer_m; count]);
            part.beam_width_rad -= 1e-4;
            // For the same sensor it is newer data, for another one it is no contradiction.
            show(&mut ring, usize::from(is_other), &part, NOW_S + 0.05);
            let seen = view(&ring, NOW_S + 0.05);
            for sector in 0..SECTORS {
                let is_own = (sector + SECTORS - first) % SECTORS < count;
                let is_cleared = is_own && is_empty && !is_other;
                let reported_m = seen.distance_m[sector];
                prop_assert!(if is_cleared { reported_m == f32::INFINITY } else { (reported_m - range_m).abs() < 1e-3 },
                    "sector {}: {}", sector, reported_m);
            }
        }
    }

    #[test]
    fn a_beam_that_knows_nothing_leaves_its_sectors_unknown(
        yaw_rad in -PI..PI, unknown in proptest::collection::vec(any::<bool>(), SECTORS), range_m in 1.0..11.0f32,
    ) {
        let mut ring = at_rest(yaw_rad);
        let mut scan = turn(range_m);
        for (range_m, unknown) in scan.range_m.iter_mut().zip(&unknown) {
            if *unknown {
                *range_m = f32::NAN;
            }
        }
        show(&mut ring, 0, &scan, NOW_S);
        let seen = view(&ring, NOW_S);
        for (sector, unknown) in unknown.iter().enumerate() {
            prop_assert_eq!(seen.distance_m[sector].is_nan(), *unknown);
            prop_assert_eq!(seen.range_max_m[sector] == 0.0, *unknown);
        }
    }

    /// A vehicle never returns exactly: 3 cm off, it sees past the border of what is known into the next sector at
    /// most.
    #[test]
    fn what_nobody_looked_at_stays_unknown_when_the_vehicle_has_moved_a_little(
        first in 0..SECTORS, count in 2..50usize, range_m in 1.0..11.0f32,
        moved_m in 0.0..0.03f64, course_rad in -PI..PI, yaw_rad in -PI..PI,
    ) {
        let (east, north) = course_rad.sin_cos();
        let place = |t: f64| {
            let moved_m = if t > NOW_S + 0.01 { moved_m } else { 0.0 };
            VehiclePose::at(north * moved_m, east * moved_m).turned(0.0, 0.0, yaw_rad)
        };
        let mut ring = ring();
        fly(&mut ring, &place, NOW_S - 0.2, NOW_S + 0.1);
        let mut part = scan(sector_bearing_rad(first), SECTOR_WIDTH_RAD, 0.0, &vec![range_m; count]);
        part.beam_width_rad -= 1e-4;
        show(&mut ring, 0, &part, NOW_S);
        let seen = view(&ring, NOW_S + 0.1);
        for sector in 0..SECTORS {
            let past = (sector + SECTORS - first) % SECTORS;
            let is_beside = past == count || past == SECTORS - 1;
            if past > count && !is_beside {
                prop_assert!(seen.distance_m[sector].is_nan(), "sector {}: {}", sector, seen.distance_m[sector]);
                prop_assert!(seen.range_max_m[sector] == 0.0);
            }
            prop_assert!(seen.distance_m[sector].is_nan() || seen.seen[sector] == time(NOW_S), "known since never");
        }
    }

    #[test]
    fn of_two_sensors_the_nearer_counts_and_each_grows_old_by_itself(
        one_m in 1.0..11.0f32, other_m in 1.0..11.0f32, apart_s in 0.01..0.4f64,
        other_first in 0..SECTORS, other_count in 2..60usize,
    ) {
        let mut ring = at_rest(0.0);
        show(&mut ring, 0, &turn(one_m), NOW_S);
        let other_s = NOW_S + apart_s;
        let mut part = scan(sector_bearing_rad(other_first), SECTOR_WIDTH_RAD, 0.0, &vec![other_m; other_count]);
        part.beam_width_rad -= 1e-4;
        show(&mut ring, 1, &part, other_s);
        let is_seen_by_both = |sector: usize| (sector + SECTORS - other_first) % SECTORS < other_count;
        let both = view(&ring, other_s);
        // Half a second after the first sensor's last word, and after the second one's.
        let alone = view(&ring, NOW_S + 0.501);
        let none = view(&ring, other_s + 0.501);
        for sector in 0..SECTORS {
            let nearest_m = if is_seen_by_both(sector) { one_m.min(other_m) } else { one_m };
            prop_assert!((both.distance_m[sector] - nearest_m).abs() < 1e-3);
            let is_left = is_seen_by_both(sector);
            prop_assert_eq!(alone.distance_m[sector].is_nan(), !is_left);
            prop_assert!(!is_left || (alone.distance_m[sector] - other_m).abs() < 1e-3);
            prop_assert!(none.distance_m[sector].is_nan());
        }
    }
}

#[test]
fn a_beam_across_the_seam_fills_both_sides_of_it() {
    for (bearing_rad, sides) in [
        (-0.5 * SECTOR_WIDTH_RAD, [71, 0]),
        (PI + 0.5 * SECTOR_WIDTH_RAD, [36, 37]),
    ] {
        for turns in [-2.0, -1.0, 0.0, 1.0] {
            let mut ring = at_rest(0.3);
            let beam = scan(bearing_rad + turns * 2.0 * PI, 0.02, 0.0, &[4.0, f32::NAN]);
            show(&mut ring, 0, &beam, NOW_S);
            let seen = view(&ring, NOW_S);
            for sector in 0..SECTORS {
                assert_eq!(
                    seen.distance_m[sector].is_finite(),
                    sides.contains(&sector),
                    "sector {sector}"
                );
            }
        }
    }
}
