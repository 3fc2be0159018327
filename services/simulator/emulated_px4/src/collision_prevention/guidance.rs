//! Guidance: a little to the side of where the stick points, if it is freer there. It helps through gaps.
//!
//! A candidate's cost is its turn away from the stick less its distance and the mean distance of it and its neighbours;
//! the lowest cost wins, the most counter-clockwise of equals. Bins are centred on multiples of five degrees, but the
//! stick's bin is the one it would have if they began there: five degrees of asymmetry, as in PX4.

use super::angle::{bin_direction, body_angle_deg, wrap_bin};
use super::map::{BIN_DEG, BINS, UNKNOWN_CM};
use super::settings::Settings;
use nalgebra::Vector2;

/// What a bin away from the stick costs, per metre of CP_DIST (cm).
const TURN_COST_CM: f32 = 50.0;
/// No candidate costs as much (cm).
const WORST_COST_CM: f32 = 9999.0;

/// Where to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guidance {
    /// Bin of the stick; 72 for a direction a hair to the left of the nose.
    pub original_bin: i32,
    /// Bin of the direction that is taken, 0 to 72.
    pub bin: i32,
    /// That direction, world frame.
    pub direction: Vector2<f32>,
}

/// The direction for a wanted acceleration, world frame.
pub fn guide(
    distance_cm: &[u16; BINS],
    setpoint_mps2: Vector2<f32>,
    yaw_rad: f32,
    settings: &Settings,
) -> Guidance {
    let direction = setpoint_mps2 / setpoint_mps2.norm();
    let original_bin = (body_angle_deg(setpoint_mps2, yaw_rad) / BIN_DEG).floor() as i32;
    // Negative: no candidate. Beyond a whole turn the same bins come again, only costlier.
    let reach = (settings.guide_deg / BIN_DEG).floor().clamp(-1.0, BINS as f32) as i32;
    let (mut bin, mut best_cm) = (original_bin, WORST_COST_CM);
    for candidate in original_bin - reach..=original_bin + reach {
        let ahead_cm = distance_cm[wrap_bin(candidate)];
        let turn_cm = TURN_COST_CM * settings.distance_m * (candidate - original_bin).unsigned_abs() as f32;
        let cost_cm = turn_cm - mean_cm(distance_cm, candidate, settings) - f32::from(ahead_cm);
        if cost_cm < best_cm && ahead_cm != UNKNOWN_CM {
            best_cm = cost_cm;
            bin = wrap_bin(candidate) as i32;
        }
    }
    Guidance {
        original_bin,
        bin,
        direction: if bin == original_bin {
            direction
        } else {
            bin_direction(yaw_rad, bin)
        },
    }
}

/// The mean of a bin and its neighbours (cm); what is unknown counts as CP_DIST.
fn mean_cm(distance_cm: &[u16; BINS], bin: i32, settings: &Settings) -> f32 {
    let known_cm = |bin: i32| match distance_cm[wrap_bin(bin)] {
        UNKNOWN_CM => 100.0 * settings.distance_m,
        cm => f32::from(cm),
    };
    (known_cm(bin - 1) + known_cm(bin) + known_cm(bin + 1)) / 3.0
}
