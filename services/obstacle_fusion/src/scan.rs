//! Planar scans and single beams: every range belongs to a cone, not to a line.
//!
//! A beam of half angle `a` that answers `r` means that the nearest obstacle in the cone is `r` away, somewhere on the
//! spherical cap of radius `r`. The whole cap is marked as hit, wherever it is wider than a cell. Only the centre ray
//! is cleared, because it is not known how weakly the edge of the cone answers, and only to the plane through the cap's
//! rim, `r cos a` (the hit range less the cap's sag): the obstacle may be anywhere on the cap. For the beam of a lidar
//! the cap is one cell and the sag zero, and the result is that of a cloud's ray.

use crate::rays::RayTracer;
use jink_shared_types::map::CELL_M;
use jink_shared_types::ranges::{RangeScan, ScanFrame};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Longest scan (s): offsets count 65536 steps of 10 us.
const MAX_DURATION_S: f64 = 0.65;

/// A cap is sampled at this distance (m): half a cell leaves out no more than cells that the cap cuts at a corner.
const CAP_STEP_M: f64 = 0.5 * CELL_M;

/// No cell of the window is further than this (m) from a sensor inside it: its diagonal.
const WINDOW_DIAGONAL_M: f64 = 39.0;

/// Where one beam points: columns are the beam, its neighbour direction in the scan's plane, the plane's normal.
type BeamFrame = Matrix3<f64>;

/// Whether a plausible `scan` can be entered into a map: its beams are cones, and its duration can be represented.
pub(crate) fn is_mappable(scan: &RangeScan) -> bool {
    let beams = f64::from(scan.beams);
    let half_rad = half_angle_rad(scan);
    half_rad <= 0.5 * FRAC_PI_2
        // All cones together are at most the full sphere. A cone of half angle a has 2 pi (1 - cos a) steradians.
        && beams * TAU * (1.0 - half_rad.cos()) <= 4.0 * PI
        && f64::from(scan.beam_interval_s) * beams <= MAX_DURATION_S
        // A row of level distances has no height: it is for the sector ring.
        && scan.frame.get() == ScanFrame::Body
}

fn half_angle_rad(scan: &RangeScan) -> f64 {
    0.5 * f64::from(scan.beam_width_rad)
}

impl RayTracer<'_> {
    /// Enters every beam of `scan`, whose description is plausible and whose mounting is `body_q_sensor`.
    pub fn scan(&mut self, scan: &RangeScan, body_q_sensor: &UnitQuaternion<f64>) {
        self.sweep.begin(scan.first_beam);
        let body_r_sensor = body_q_sensor.to_rotation_matrix().into_inner();
        let half_rad = half_angle_rad(scan);
        let beams = scan.ranges().len();
        let first_beam = self.first_ray(beams);
        for beam in (first_beam..beams).chain(0..first_beam) {
            let range_m = scan.range_m[beam];
            if range_m.is_nan() {
                continue;
            }
            if range_m < 0.0 {
                self.counters.rays_malformed += 1;
                continue;
            }
            let offset_10us = (beam as f64 * f64::from(scan.beam_interval_s) * 1e5).round() as u16;
            let angle_rad = f64::from(scan.angle_first_rad) + beam as f64 * f64::from(scan.angle_step_rad);
            let (sin, cos) = angle_rad.sin_cos();
            let sensor_r_beam = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
            let body_r_beam = body_r_sensor * sensor_r_beam;
            if range_m == f32::INFINITY {
                self.beam_clear(offset_10us, &body_r_beam);
            } else {
                self.beam_hit(offset_10us, &body_r_beam, range_m, half_rad);
            }
        }
    }

    fn beam_clear(&mut self, offset_10us: u16, body_r_beam: &BeamFrame) {
        if self.set_time(offset_10us) {
            self.has_information = true;
            self.clear_beam(body_r_beam, self.limits.reach_m);
        }
    }

    fn beam_hit(&mut self, offset_10us: u16, body_r_beam: &BeamFrame, range_m: f32, half_rad: f64) {
        let center_body_m = self.limits.origin_body_m + body_r_beam.column(0) * f64::from(range_m);
        let center_body_m = single(&center_body_m);
        if self.limits.is_self(center_body_m) {
            self.counters.self_hits += 1;
            return;
        }
        if !self.set_time(offset_10us) {
            return;
        }
        self.enter(center_body_m, range_m, true, 0.0);
        if self.limits.is_beyond(range_m) {
            self.counters.rays_malformed += 1;
            return;
        }
        self.has_information = true;
        for_each_on_cap(f64::from(range_m), half_rad, |on_cap| {
            let body_m = single(&(self.limits.origin_body_m + body_r_beam * on_cap));
            if !self.limits.is_self(body_m) {
                self.enter(body_m, range_m, true, 0.0);
            }
        });
        if !self.limits.is_below(range_m) {
            self.clear_beam(body_r_beam, f64::from(range_m) * half_rad.cos());
        }
    }

    /// Clears the first `clear_m` of the centre ray.
    fn clear_beam(&mut self, body_r_beam: &BeamFrame, clear_m: f64) {
        let end_body_m = self.limits.origin_body_m + body_r_beam.column(0) * clear_m;
        let clear_m = clear_m as f32;
        self.enter(single(&end_body_m), clear_m, false, clear_m);
    }
}

fn single(point: &Vector3<f64>) -> [f32; 3] {
    [point.x as f32, point.y as f32, point.z as f32]
}

/// Calls `mark` for points of the cap of radius `range_m` and half angle `half_rad` about the first axis, on rings
/// [`CAP_STEP_M`] apart. The pole is left to the caller; so is a cap that is narrower than a cell or out of reach.
fn for_each_on_cap(range_m: f64, half_rad: f64, mut mark: impl FnMut(Vector3<f64>)) {
    let rim_m = range_m * half_rad;
    if rim_m <= 0.5 * CELL_M || range_m > WINDOW_DIAGONAL_M {
        return;
    }
    let rings = (rim_m / CAP_STEP_M).ceil();
    for ring in 1..=rings as u32 {
        let (sin, cos) = (half_rad * f64::from(ring) / rings).sin_cos();
        let radius_m = range_m * sin;
        let marks = (TAU * radius_m / CAP_STEP_M).ceil();
        for i in 0..marks as u32 {
            let (sin_around, cos_around) = (TAU * f64::from(i) / marks).sin_cos();
            mark(Vector3::new(
                range_m * cos,
                radius_m * cos_around,
                radius_m * sin_around,
            ));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{for_each_on_cap, is_mappable};
    use jink_shared_types::layout::Layout;
    use jink_shared_types::map::CELL_M;
    use jink_shared_types::ranges::RangeScan;
    use jink_shared_types::ranges::ScanFrame;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn marks_lie_on_the_cap_and_leave_no_hole(
            range_m in 0.5..12.0f64,
            half_rad in 0.02..0.7f64,
            along in 0.0..1.0f64,
            around_rad in 0.0..6.3f64,
        ) {
            prop_assume!(range_m * half_rad > 0.5 * CELL_M);
            let (sin, cos) = (along * half_rad).sin_cos();
            let (sin_around, cos_around) = around_rad.sin_cos();
            let any = Vector3::new(cos, sin * cos_around, sin * sin_around) * range_m;
            let mut nearest_m = (any - Vector3::new(range_m, 0.0, 0.0)).norm();
            for_each_on_cap(range_m, half_rad, |mark| {
                assert!((mark.norm() - range_m).abs() < 1e-9);
                assert!(mark.x >= range_m * half_rad.cos() - 1e-9);
                nearest_m = nearest_m.min((any - mark).norm());
            });
            prop_assert!(nearest_m <= 0.5 * CELL_M, "{}", nearest_m);
        }
    }

    #[test]
    fn only_what_can_be_mapped_is_entered() {
        let good = RangeScan {
            beams: 360,
            angle_step_rad: 0.01745,
            beam_width_rad: 0.01745,
            beam_interval_s: 2e-4,
            range_max_m: 12.0,
            ..RangeScan::default()
        };
        assert!(good.is_plausible() && is_mappable(&good));
        let others: [fn(&mut RangeScan); 3] = [
            |scan| scan.beam_interval_s = 2e-3,
            |scan| scan.beam_width_rad = 1.5,
            |scan| scan.frame = ScanFrame::Level.into(),
        ];
        for (i, change) in others.iter().enumerate() {
            let mut scan = good;
            change(&mut scan);
            assert!(scan.is_plausible() && !is_mappable(&scan), "{i}");
        }
    }
}
