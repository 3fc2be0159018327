//! Single beams, and rows of level distances: every one an arc at one distance.
//!
//! A beam is a cone. Where it is level, and some way above and below, it sees what the vehicle could hit, so its reading counts whether
//! or not the end of its axis lies in the height band; a vehicle with nothing but such sensors tilts in order to fly. The reading
//! is an obstacle at the distance to which it reaches horizontally, in all sectors that the opening angle touches, as PX4 takes it. A beam that is
//! mounted steeper than [`STEEPEST_RAD`] looks up or down, and tells nothing.
//!
//! Unlike the rays of a scan, a beam is never taken to see the vehicle itself: nobody mounts it so, and "too near" must count.

use super::bearing::{SLOTS, SLOTS_PER_SECTOR};
use super::poses::Pose;
use super::scan::meaning;
use super::sweep::BEYOND_ANY_SENSOR_M2;
use super::view::{Hit, View};
use jink_shared_types::Timestamp;
use jink_shared_types::ranges::{RangeScan, RayKind, ScanFrame};
use jink_shared_types::ring::{SECTOR_WIDTH_RAD, SECTORS, sector_of};
use nalgebra::{Vector2, Vector3};
use std::f64::consts::TAU;

/// Greatest angle between the axis of a beam and the body's horizontal plane (rad): 60 degrees, beyond which it looks up or down rather
/// than around, however the vehicle tilts.
const STEEPEST_RAD: f64 = std::f64::consts::FRAC_PI_3;
/// Places on the border of two slots are put this far into theirs, in slots: 4e-7 rad, more than rounding moves them.
const INSIDE: f64 = 2e-5;
/// Nothing is nearer than this (m): at zero there would be no direction.
const LEAST_M: f64 = 2e-3;

/// An arc around the sensor, in the level frame of the vehicle.
struct Arc {
    /// Where the sensor is (m): forward, right.
    centre_m: Vector2<f64>,
    /// From here clockwise ... (rad)
    from_rad: f64,
    /// ... so far (rad), at most all around.
    width_rad: f64,
    distance_m: f64,
    /// Nothing beyond this counts as known (m).
    reach_m: f64,
    kind: RayKind,
    seen: Timestamp,
}

/// Whether `scan` is of this kind.
pub fn is_beam(scan: &RangeScan) -> bool {
    scan.beams == 1 || scan.frame.get() != ScanFrame::Body
}

/// Writes all beams of `scan`, taken at `pose`, into `view`. `first` is when the first was measured.
pub fn collect(scan: &RangeScan, pose: &Pose, first: Timestamp, view: &mut View) {
    for (beam, range_m) in scan.ranges().iter().enumerate() {
        let (range_m, kind) = meaning(*range_m, scan.range_max_m);
        if kind == RayKind::Unknown {
            continue;
        }
        let toward_rad = f64::from(scan.angle_first_rad) + beam as f64 * f64::from(scan.angle_step_rad);
        let Some(level) = level(scan, pose, toward_rad) else {
            continue;
        };
        let width_rad = f64::from(scan.beam_width_rad).clamp(0.0, TAU);
        let seen = first.plus_seconds(beam as f64 * f64::from(scan.beam_interval_s));
        paint(
            view,
            &Arc {
                centre_m: level.centre_m,
                from_rad: level.bearing_rad - 0.5 * width_rad,
                width_rad,
                distance_m: (range_m * level.share).max(LEAST_M),
                reach_m: f64::from(scan.range_max_m),
                kind,
                seen,
            },
        );
    }
}

/// A beam's axis in the level frame.
struct Level {
    centre_m: Vector2<f64>,
    bearing_rad: f64,
    /// Which part of the range is horizontal.
    share: f64,
}

fn level(scan: &RangeScan, pose: &Pose, toward_rad: f64) -> Option<Level> {
    let yaw_rad = pose.yaw_rad();
    let bearing_rad = match scan.frame.get() {
        ScanFrame::Level => toward_rad,
        ScanFrame::North => toward_rad - yaw_rad,
        ScanFrame::Body => return body(scan, pose, toward_rad),
    };
    Some(Level {
        centre_m: Vector2::zeros(),
        bearing_rad,
        share: 1.0,
    })
}

fn body(scan: &RangeScan, pose: &Pose, toward_rad: f64) -> Option<Level> {
    let (sin, cos) = toward_rad.sin_cos();
    let axis = scan.mounting.rotation() * Vector3::new(cos, sin, 0.0);
    let flat = axis.xy().norm();
    // False for NaN, too.
    let looks_around = flat >= STEEPEST_RAD.cos();
    if !looks_around {
        return None;
    }
    let bearing_rad = axis.y.atan2(axis.x);
    // The vehicle's tilt shortens the beam's own axis, and the direction in the body that it stands for: the shorter counts.
    let forward = Vector3::new(axis.x / flat, axis.y / flat, 0.0);
    let share_of = |axis: &Vector3<f64>| (pose.attitude * axis).xy().norm();
    let sensor = pose.attitude * scan.origin.vector();
    let (sin, cos) = pose.yaw_rad().sin_cos();
    Some(Level {
        centre_m: Vector2::new(sensor.x * cos + sensor.y * sin, sensor.y * cos - sensor.x * sin),
        bearing_rad,
        share: share_of(&axis).min(share_of(&forward)),
    })
}

/// Writes `arc` into `view`: one place in every slot that it touches.
fn paint(view: &mut View, arc: &Arc) {
    let slots = |bearing_rad: f64| bearing_rad / SECTOR_WIDTH_RAD * SLOTS_PER_SECTOR as f64;
    let (from, to) = (slots(arc.from_rad), slots(arc.from_rad + arc.width_rad));
    let first = from.floor();
    let count = (to.floor() - first) as usize;
    for step in 0..=count.min(SLOTS) {
        let slot = first + step as f64;
        let place = (slot + 0.5).max(from).min(to);
        let place = place.clamp(slot + INSIDE, slot + 1.0 - INSIDE);
        let bearing_rad = place / SLOTS_PER_SECTOR as f64 * SECTOR_WIDTH_RAD;
        let (sin, cos) = bearing_rad.sin_cos();
        mark(view, arc, arc.centre_m + arc.distance_m * Vector2::new(cos, sin));
    }
}

fn mark(view: &mut View, arc: &Arc, place_m: Vector2<f64>) {
    let bearing_rad = place_m.y.atan2(place_m.x);
    let distance_m2 = place_m.norm_squared() as f32;
    // False for NaN, too: broken coordinates say nothing.
    let is_a_place = distance_m2 < BEYOND_ANY_SENSOR_M2;
    if !is_a_place {
        return;
    }
    let sector = &mut view.sectors[sector_of(bearing_rad)];
    let known_m2 = distance_m2.min((arc.reach_m * arc.reach_m) as f32);
    if known_m2 > sector.known_m2 {
        sector.known_m2 = known_m2;
        sector.seen = arc.seen;
    }
    if arc.kind != RayKind::Hit {
        return;
    }
    if distance_m2 < sector.near_m2 {
        sector.near_m2 = distance_m2;
        sector.seen = arc.seen;
    }
    let hit = &mut view.hits[slot_of(bearing_rad)];
    let [forward_m, right_m] = hit.level_m;
    if distance_m2 < forward_m * forward_m + right_m * right_m {
        *hit = Hit {
            level_m: [place_m.x as f32, place_m.y as f32],
            seen: arc.seen,
        };
    }
}

/// The slot that holds a bearing: those of a sector lie around its centre.
fn slot_of(bearing_rad: f64) -> usize {
    const EACH: f64 = SLOTS_PER_SECTOR as f64;
    let sectors = bearing_rad / SECTOR_WIDTH_RAD + 0.5;
    ((sectors * EACH).floor().rem_euclid(SLOTS as f64) as usize).min(SECTORS * SLOTS_PER_SECTOR - 1)
}
