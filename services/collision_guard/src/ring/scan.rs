//! From the beams of a planar scan to rays. Single beams, and rows of distances, are in `beam.rs`.

use super::sweep::{Collector, Sweep};
use jink_shared_types::ranges::{RangeScan, RayKind};
use jink_shared_types::ring::SECTOR_WIDTH_RAD;
use nalgebra::{UnitQuaternion, Vector3};

/// Rays within a beam lie at most this far apart (rad): half a sector, so that no sector under the beam is missed.
const RAY_STEP_RAD: f64 = SECTOR_WIDTH_RAD / 2.0;
/// A beam narrower than this (rad) is one ray: at 50 m it is 5 cm wide.
const PENCIL_RAD: f64 = 1e-3;
/// Most rays of one beam: all around, and a bound on the work that a broken beam width can cause.
const RAYS_PER_BEAM: usize = 145;

/// Adds every beam of `scan`: its two edges, and rays between them where it is wide.
pub fn collect(scan: &RangeScan, sweep: &Sweep, collector: &mut Collector) {
    let body_q_sensor = scan.mounting.rotation();
    let sensor = scan.origin.vector();
    let width_rad = f64::from(scan.beam_width_rad).clamp(0.0, std::f64::consts::TAU);
    let rays = rays_of(width_rad);
    let per_beam = if sweep.duration_s() > 0.0 {
        f64::from(scan.beam_interval_s) / sweep.duration_s()
    } else {
        0.0
    };
    for (beam, range_m) in scan.ranges().iter().enumerate() {
        let (range_m, kind) = meaning(*range_m, scan.range_max_m);
        if kind == RayKind::Unknown {
            continue;
        }
        let centre_rad = f64::from(scan.angle_first_rad) + beam as f64 * f64::from(scan.angle_step_rad);
        let share = (beam as f64 * per_beam).clamp(0.0, 1.0) as f32;
        for ray in 0..rays {
            let aside_rad = if rays == 1 {
                0.0
            } else {
                width_rad * (ray as f64 / (rays - 1) as f64 - 0.5)
            };
            let end = end_of(&body_q_sensor, &sensor, centre_rad + aside_rad, range_m);
            collector.push(sweep, end, share, kind);
        }
    }
}

fn rays_of(width_rad: f64) -> usize {
    // A NaN width is not above anything: one ray.
    if width_rad > PENCIL_RAD {
        ((width_rad / RAY_STEP_RAD).ceil() as usize + 1).min(RAYS_PER_BEAM)
    } else {
        1
    }
}

/// What a range says, and where its ray ends (m). A range below the sensor's shortest is an obstacle at that range.
pub(super) fn meaning(range_m: f32, range_max_m: f32) -> (f64, RayKind) {
    if range_m.is_nan() || range_m < 0.0 {
        (0.0, RayKind::Unknown)
    } else if range_m > range_max_m {
        (f64::from(range_max_m), RayKind::Clear)
    } else {
        (f64::from(range_m), RayKind::Hit)
    }
}

fn end_of(
    body_q_sensor: &UnitQuaternion<f64>,
    sensor: &Vector3<f64>,
    angle_rad: f64,
    range_m: f64,
) -> [f32; 3] {
    let (sin, cos) = angle_rad.sin_cos();
    let end = sensor + body_q_sensor * Vector3::new(cos * range_m, sin * range_m, 0.0);
    [end.x as f32, end.y as f32, end.z as f32]
}
