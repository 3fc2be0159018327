//! Scans, single beams and rows of level distances: every reading is an arc at one distance.
//!
//! | sample | direction of an arc | distance |
//! |---|---|---|
//! | planar scan | that of its beam with the vehicle's tilt when it was measured | the horizontal part of the range |
//! | single beam | that of its axis in the body, from the heading, as in PX4 | the same, or as if it looked along the body's plane, whichever is shorter |
//! | row of level distances | as given, from the heading or from north | as given |
//!
//! None of them says at which height something is, and a vehicle with nothing but such sensors tilts in order to fly.
//! So tilt shortens their ranges and never discards them: a reading counts whether or not its end lies in the height
//! band. What a tilted beam hits above or below, including the ground, is an obstacle; a tilted beam without a hit
//! counts as free at the vehicle's height. A beam mounted steeper than [`STEEPEST_RAD`] looks up or down, and is not
//! used.
//!
//! A single beam is never taken to see the vehicle itself: it is not mounted like that, and "too near" must count. A
//! scan may: its hits within the vehicle's radius are ignored.

use super::bearing::{SLOTS, SLOTS_PER_SECTOR};
use super::sensor_view::{SensorView, SlotHit};
use super::sweep::BEYOND_ANY_SENSOR_M2;
use jink_shared_types::Timestamp;
use jink_shared_types::pose_history::Pose;
use jink_shared_types::ranges::{RangeScan, RayKind, STEEPEST_RAD, ScanFrame};
use jink_shared_types::ring::{SECTOR_WIDTH_RAD, SECTORS, sector_of};
use nalgebra::{Rotation2, Vector2, Vector3};
use std::f64::consts::TAU;

/// Places on the border of two slots are moved this far into theirs, in slots: 4e-7 rad, more than rounding moves them.
const INSIDE: f64 = 2e-5;
/// Smallest distance (m): at zero there would be no direction.
const LEAST_M: f64 = 2e-3;

/// When and from where a scan was taken.
#[derive(Clone, Copy, Debug)]
pub struct ScanSpan<'a> {
    /// Its first beam.
    pub first: (Timestamp, &'a Pose),
    /// Its last one: the place of the view.
    pub last: (Timestamp, &'a Pose),
    /// Hits of a scan within this radius are the vehicle itself (m).
    pub vehicle_radius_m: f64,
}

/// An arc around a place, in the level frame of the view.
struct RangeArc {
    /// Its centre (m): forward, right.
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

/// Writes all beams of `scan` into `view`.
pub fn collect(scan: &RangeScan, span: &ScanSpan<'_>, view: &mut SensorView) {
    let (first, from) = span.first;
    let (last, to) = span.last;
    let duration_s = last.seconds_since(first);
    let width_rad = f64::from(scan.beam_width_rad).clamp(0.0, TAU);
    // A NaN width is no width.
    let width_rad = if width_rad > 0.0 { width_rad } else { 0.0 };
    let level = Rotation2::new(-to.yaw_rad());
    for (beam, range_m) in scan.ranges().iter().enumerate() {
        let (range_m, kind) = interpret(*range_m, scan.range_max_m);
        if kind == RayKind::Unknown {
            continue;
        }
        let after_s = beam as f64 * f64::from(scan.beam_interval_s);
        let share = if duration_s > 0.0 {
            (after_s / duration_s).clamp(0.0, 1.0)
        } else {
            1.0
        };
        let pose = from.toward(to, share);
        let toward_rad = f64::from(scan.angle_first_rad) + beam as f64 * f64::from(scan.angle_step_rad);
        let Some(axis) = axis(scan, &pose, toward_rad) else {
            continue;
        };
        let is_self = scan.beams > 1 && kind == RayKind::Hit && axis.end_m(range_m) < span.vehicle_radius_m;
        if is_self && scan.frame.get() == ScanFrame::Body {
            continue;
        }
        let bearing_rad = axis.bearing_rad - to.yaw_rad();
        write_arc(
            view,
            &RangeArc {
                centre_m: level * (axis.sensor_m.xy() + pose.position_m.xy() - to.position_m.xy()),
                from_rad: bearing_rad - 0.5 * width_rad,
                width_rad,
                distance_m: (range_m * axis.share).max(LEAST_M),
                reach_m: f64::from(scan.range_max_m),
                kind,
                seen: first.plus_seconds(share * duration_s),
            },
        );
    }
}

/// What a range means, and how far it is (m).
fn interpret(range_m: f32, range_max_m: f32) -> (f64, RayKind) {
    if range_m.is_nan() || range_m < 0.0 {
        (0.0, RayKind::Unknown)
    } else if range_m > range_max_m {
        (f64::from(range_max_m), RayKind::Clear)
    } else {
        (f64::from(range_m), RayKind::Hit)
    }
}

/// Where a beam points.
struct BeamAxis {
    /// The sensor from the vehicle's centre, along local NED (m).
    sensor_m: Vector3<f64>,
    /// The beam, along local NED.
    along: Vector3<f64>,
    /// Direction (rad), clockwise from north.
    bearing_rad: f64,
    /// The horizontal share of the range.
    share: f64,
}

impl BeamAxis {
    /// Distance of the beam's end from the vehicle's centre (m).
    fn end_m(&self, range_m: f64) -> f64 {
        (self.sensor_m + self.along * range_m).norm()
    }
}

fn axis(scan: &RangeScan, pose: &Pose, toward_rad: f64) -> Option<BeamAxis> {
    let level = |bearing_rad: f64| BeamAxis {
        sensor_m: Vector3::zeros(),
        along: Vector3::new(bearing_rad.cos(), bearing_rad.sin(), 0.0),
        bearing_rad,
        share: 1.0,
    };
    match scan.frame.get() {
        ScanFrame::Level => Some(level(toward_rad + pose.yaw_rad())),
        ScanFrame::North => Some(level(toward_rad)),
        ScanFrame::Body => body_axis(scan, pose, toward_rad),
    }
}

fn body_axis(scan: &RangeScan, pose: &Pose, toward_rad: f64) -> Option<BeamAxis> {
    let (sin, cos) = toward_rad.sin_cos();
    let in_body = scan.mounting.rotation()? * Vector3::new(cos, sin, 0.0);
    let flat = in_body.xy().norm();
    // False for NaN, too.
    let looks_around = flat >= STEEPEST_RAD.cos();
    if !looks_around {
        return None;
    }
    let along = pose.local_q_body * in_body;
    let share = along.xy().norm();
    let sensor_m = pose.local_q_body * scan.origin.vector();
    if scan.beams > 1 {
        return Some(BeamAxis {
            sensor_m,
            along,
            bearing_rad: along.y.atan2(along.x),
            share,
        });
    }
    let in_plane = Vector3::new(in_body.x / flat, in_body.y / flat, 0.0);
    Some(BeamAxis {
        sensor_m,
        along,
        bearing_rad: pose.yaw_rad() + in_body.y.atan2(in_body.x),
        share: share.min((pose.local_q_body * in_plane).xy().norm()),
    })
}

/// Writes `arc` into `view`: one place in every slot that it touches.
fn write_arc(view: &mut SensorView, arc: &RangeArc) {
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

fn mark(view: &mut SensorView, arc: &RangeArc, place_m: Vector2<f64>) {
    let bearing_rad = place_m.y.atan2(place_m.x);
    let distance_m2 = place_m.norm_squared() as f32;
    // False for NaN, too: damaged coordinates are ignored.
    let is_a_place = distance_m2 < BEYOND_ANY_SENSOR_M2;
    if !is_a_place {
        return;
    }
    let sector = &mut view.sectors[sector_of(bearing_rad)];
    let known_m2 = distance_m2.min((arc.reach_m * arc.reach_m) as f32);
    if known_m2 > sector.known_m2 {
        sector.known_m2 = known_m2;
        sector.under_m2 = sector.under_m2.max(known_m2);
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
        *hit = SlotHit {
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
