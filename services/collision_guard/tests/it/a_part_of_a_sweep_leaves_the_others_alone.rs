//! A scanning sensor that publishes its sweep in parts: each replaces the same part of the sweep before, and nothing
//! else.

use crate::common::{VehiclePose, fly, ring, time, view};
use jink_collision_guard::ring::{Ring, Visibility};
use jink_shared_types::SampleHeader;
use jink_shared_types::ranges::RangeScan;
use jink_shared_types::ring::sector_of;

const NOW_S: f64 = 10.0;

/// Beams every degree from `from_deg` for `count`, clockwise or not, all saying `range_m`.
fn part(from_deg: f32, count: u32, clockwise: bool, range_m: f32) -> RangeScan {
    let mut scan = RangeScan {
        angle_first_rad: from_deg.to_radians(),
        angle_step_rad: if clockwise {
            1f32.to_radians()
        } else {
            -1f32.to_radians()
        },
        beam_interval_s: 1e-3,
        range_min_m: 0.2,
        range_max_m: 20.0,
        beams: count,
        ..RangeScan::default()
    };
    scan.range_m[..count as usize].fill(range_m);
    scan
}

fn show(ring: &mut Ring, mut scan: RangeScan, at_s: f64) {
    let first = time(at_s - f64::from(scan.beams - 1) * 1e-3);
    scan.first_beam = first;
    ring.scan(0, &scan, &SampleHeader::at(time(at_s))).unwrap();
}

/// Distance in the sector towards `deg`.
fn towards(ring: &Ring, deg: f64, at_s: f64) -> f32 {
    view(ring, at_s).distance_m[sector_of(deg.to_radians())]
}

fn hovering() -> Ring {
    let mut ring = ring();
    fly(
        &mut ring,
        &|_| VehiclePose::at(0.0, 0.0),
        NOW_S - 1.0,
        NOW_S + 1.0,
    );
    ring
}

#[test]
fn what_a_part_does_not_cover_stays_as_it_was() {
    let mut ring = hovering();
    for (index, range_m) in [3.0, 4.0, 5.0, 6.0].into_iter().enumerate() {
        let at_s = NOW_S + 0.04 * index as f64;
        show(
            &mut ring,
            part(-90.0 + 45.0 * index as f32, 45, true, range_m),
            at_s,
        );
    }
    let now_s = NOW_S + 0.13;
    let seen = [-67.5, -22.5, 22.5, 67.5].map(|deg| towards(&ring, deg, now_s).round());
    assert_eq!(seen, [3.0, 4.0, 5.0, 6.0]);
}

#[test]
fn the_next_sweep_replaces_its_own_part_also_on_the_way_back() {
    let mut ring = hovering();
    show(&mut ring, part(0.0, 45, true, 3.0), NOW_S);
    show(&mut ring, part(45.0, 45, true, 4.0), NOW_S + 0.04);
    show(&mut ring, part(89.0, 45, false, f32::INFINITY), NOW_S + 0.08);
    let now_s = NOW_S + 0.09;
    assert_eq!(
        towards(&ring, 67.5, now_s),
        f32::INFINITY,
        "what stood there is gone"
    );
    assert!((towards(&ring, 22.5, now_s) - 3.0).abs() < 0.05);
}

#[test]
fn a_part_that_has_grown_old_is_unknown_and_its_sensor_is_not_lost() {
    let mut ring = hovering();
    show(&mut ring, part(0.0, 45, true, 3.0), NOW_S);
    for step in 1..16 {
        show(
            &mut ring,
            part(45.0, 45, true, 4.0),
            NOW_S + 0.04 * f64::from(step),
        );
    }
    let now_s = NOW_S + 0.61;
    assert!(towards(&ring, 22.5, now_s).is_nan());
    assert!((towards(&ring, 67.5, now_s) - 4.0).abs() < 0.05);
    // Behind the wall that stood there: nobody has seen it.
    let query = ring.query(time(now_s));
    let direction = 22.5f64.to_radians();
    assert_eq!(
        query.visibility([5.0 * direction.cos(), 5.0 * direction.sin()], 0.0, 0.3, false),
        Visibility::Unseen
    );
    // When the sensor falls silent, all its parts are lost.
    let late_s = NOW_S + 1.2;
    let query = ring.query(time(late_s));
    assert_eq!(
        query.visibility([5.0 * direction.cos(), 5.0 * direction.sin()], 0.0, 0.3, false),
        Visibility::Lost
    );
}

#[test]
fn a_whole_turn_is_one_layer_wherever_it_begins() {
    let mut ring = hovering();
    show(&mut ring, part(-180.0, 360, true, 3.0), NOW_S);
    show(&mut ring, part(-91.0, 360, true, f32::INFINITY), NOW_S + 0.05);
    for deg in [-170.0, -80.0, 10.0, 100.0] {
        assert_eq!(towards(&ring, deg, NOW_S + 0.06), f32::INFINITY, "{deg}");
    }
}
