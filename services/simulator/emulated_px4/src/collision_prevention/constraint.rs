//! Less acceleration towards the closest obstacle, and along it as far as it is free there.
//!
//! Looked at is the single closest bin: its direction splits the setpoint into a part towards it and a part along it,
//! and each is scaled by the distance in its own direction. What points away from it is not scaled at all, whatever is
//! there.

use super::angle::body_angle_deg;
use super::map::{BIN_DEG, BINS, Map, UNKNOWN_CM};
use super::settings::Settings;
use nalgebra::Vector2;

/// A part along the obstacle shorter than this has no direction.
const NO_LENGTH: f32 = f32::EPSILON;

/// Share of the acceleration that is left at a distance: none at `keep_m`, all of it further off by the way from
/// MPC_VEL_MANUAL to rest at MPC_XY_P. Nearer than `keep_m` it is the missing distance in metres, negative.
pub fn authority(distance_m: f32, keep_m: f32, settings: &Settings) -> f32 {
    let beyond_m = distance_m - keep_m;
    if beyond_m <= 0.0 {
        return beyond_m;
    }
    let full_m = keep_m.max(settings.manual_speed_mps / settings.position_gain_per_s);
    (beyond_m / full_m).powi(2).min(1.0)
}

/// Whether a bin may be flown into: something is known of it, or nothing ever was and that is allowed.
pub(super) fn is_feasible(map: &Map, bin: i32, settings: &Settings) -> bool {
    let Some(bin) = usize::try_from(bin).ok().filter(|bin| *bin < BINS) else {
        return false;
    };
    map.distance_cm[bin] != UNKNOWN_CM || (settings.go_without_data && !map.seen[bin])
}

/// What is left of the unit vector `wanted`, with the closest obstacle at `closest` (m, direction).
pub(super) fn constrain(
    map: &Map,
    yaw_rad: f32,
    wanted: Vector2<f32>,
    closest: (f32, Vector2<f32>),
    keep_m: f32,
    settings: &Settings,
) -> Vector2<f32> {
    let (closest_m, towards) = closest;
    let approach = wanted.dot(&towards);
    if approach <= 0.0 {
        return wanted;
    }
    let normal = towards * approach;
    let along = wanted - normal;
    let along_m = if along.norm() < NO_LENGTH {
        0.0
    } else {
        let bin = (body_angle_deg(along, yaw_rad) / BIN_DEG).round() as usize % BINS;
        map.distance_m(bin)
    };
    along * authority(along_m, keep_m, settings) + normal * authority(closest_m, keep_m, settings)
}
