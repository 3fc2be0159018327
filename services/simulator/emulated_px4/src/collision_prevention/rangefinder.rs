//! A rangefinder's reading into the bins that its field of view touches.

use super::angle::{degrees, direction, heading_rad, wrap_bin};
use super::map::{BIN_DEG, Map, TIMEOUT_US, whole_cm};
use super::message::DistanceSensor;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use std::f32::consts::{PI, TAU};

/// MAV_SENSOR_ROTATION_PITCH_90.
const ORIENTATION_UP: u8 = 24;
/// MAV_SENSOR_ROTATION_PITCH_270.
const ORIENTATION_DOWN: u8 = 25;
/// MAV_SENSOR_ROTATION_CUSTOM.
const ORIENTATION_CUSTOM: u8 = 100;
/// Length below which PX4 calls a number zero (single precision).
const EPSILON: f32 = f32::EPSILON;

/// Where a reading lies on the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// The sensor's heading about the nose (rad).
    pub yaw_rad: f32,
    /// The same in 0 to 360 (deg).
    pub yaw_deg: f32,
    /// Share of the reading that is horizontal.
    pub scale: f32,
    /// First and last bin, not brought into 0 to 71; `None` if the field of view is no number.
    pub bins: Option<(i32, i32)>,
}

/// Where a reading lies on the map of a vehicle in this attitude (`world_q_body`).
pub fn project(reading: &DistanceSensor, attitude: [f32; 4]) -> Projection {
    let yaw_rad = sensor_yaw_rad(reading);
    let positive_rad = if (0.0..TAU).contains(&yaw_rad) {
        yaw_rad
    } else {
        yaw_rad - TAU * (yaw_rad / TAU).floor()
    };
    let yaw_deg = degrees(positive_rad);
    let half_deg = reading
        .field_of_view_rad
        .is_finite()
        .then(|| degrees(reading.field_of_view_rad.clamp(0.0, TAU) / 2.0));
    let bin_at = |deg: f32| (deg / BIN_DEG).round() as i32;
    Projection {
        yaw_rad,
        yaw_deg,
        scale: horizontal_share(attitude, yaw_rad),
        bins: half_deg.map(|half_deg| (bin_at(yaw_deg - half_deg), bin_at(yaw_deg + half_deg))),
    }
}

/// An orientation that is not known looks ahead.
fn sensor_yaw_rad(reading: &DistanceSensor) -> f32 {
    match reading.orientation {
        eighths @ 0..=4 => f32::from(eighths) * PI / 4.0,
        eighths @ 5..=7 => (f32::from(eighths) - 8.0) * PI / 4.0,
        ORIENTATION_CUSTOM => heading_rad(reading.body_q_sensor),
        _ => 0.0,
    }
}

/// How much of a ray in the body's horizontal plane is horizontal in the world.
fn horizontal_share([w, x, y, z]: [f32; 4], yaw_rad: f32) -> f32 {
    let ray = direction(yaw_rad);
    let rotation = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
    let world = rotation * Vector3::new(ray.x, ray.y, 0.0);
    world.xy().norm().clamp(EPSILON, 1.0)
}

/// Takes a reading.
pub(super) fn ingest(map: &mut Map, now_us: u64, reading: &DistanceSensor, attitude: [f32; 4]) {
    let vertical = matches!(reading.orientation, ORIENTATION_UP | ORIENTATION_DOWN);
    if vertical || now_us.wrapping_sub(reading.time_us) >= TIMEOUT_US {
        return;
    }
    let cut_cm = |m: f32| (100.0 * m) as i32 as u16;
    map.receive(reading.time_us, cut_cm(reading.min_m), cut_cm(reading.max_m));
    let Some(mut distance_m) = usable_m(reading) else {
        return;
    };
    let projection = project(reading, attitude);
    let Some((first, last)) = projection.bins else {
        return;
    };
    if distance_m < reading.max_m {
        distance_m *= projection.scale;
    }
    let (distance_cm, range_cm) = (whole_cm(100.0 * distance_m), whole_cm(100.0 * reading.max_m));
    for bin in first..=last {
        map.offer(wrap_bin(bin), reading.max_m, distance_m, distance_cm, range_cm);
    }
}

/// The reading, at most the range; `None` if it is too close to be believed. What is no number is "nothing there".
fn usable_m(reading: &DistanceSensor) -> Option<f32> {
    let nothing_there = (reading.distance_m + 1.0).abs() < EPSILON && reading.quality == 0;
    let distance_m = if reading.distance_m < reading.max_m && !nothing_there {
        reading.distance_m
    } else {
        reading.max_m
    };
    (distance_m > reading.min_m).then_some(distance_m)
}
