//! Against a velocity that could not be stopped before an obstacle any more.
//!
//! For every bin: from the distance beyond the one to keep, less what delay and age of the data cost, follows the speed
//! from which a stop within acceleration and jerk is possible; what the velocity exceeds it by is braked with the gain
//! of the velocity controller. Only the hardest braking counts, in one direction, and nothing limits it.

use super::angle::bin_direction;
use super::map::{BINS, Map, UNKNOWN_CM};
use super::settings::Settings;
use nalgebra::Vector2;

/// Braking along a direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Braking {
    /// Along the direction (m/s^2), not positive; infinite if no bin could be looked at.
    pub acceleration_mps2: f32,
    /// Direction of the obstacle, world frame; zero if no bin could be looked at.
    pub direction: Vector2<f32>,
}

/// The speed (m/s) from which `final_mps` is reached within `distance_m`: constant deceleration, preceded by its
/// build-up with a margin.
pub fn speed_to_stop_mps(jerk_mps3: f32, acceleration_mps2: f32, distance_m: f32, final_mps: f32) -> f32 {
    let build_up = 4.0 * acceleration_mps2 * acceleration_mps2 / jerk_mps3;
    let way = 2.0 * acceleration_mps2 * distance_m + final_mps * final_mps;
    let speed_mps = 0.5 * ((build_up * build_up + 4.0 * way).sqrt() - build_up);
    speed_mps.max(final_mps)
}

/// The hardest braking that any bin asks for; bins not beyond the smallest minimum of all sensors are not looked at.
pub(super) fn brake(
    map: &Map,
    now_us: u64,
    yaw_rad: f32,
    velocity_mps: Vector2<f32>,
    keep_m: f32,
    settings: &Settings,
) -> Braking {
    let mut hardest = Braking {
        acceleration_mps2: f32::INFINITY,
        direction: Vector2::zeros(),
    };
    for bin in 0..BINS {
        let distance_cm = map.distance_cm[bin];
        if distance_cm <= map.min_cm || distance_cm == UNKNOWN_CM {
            continue;
        }
        let direction = bin_direction(yaw_rad, bin as i32);
        let along_mps = velocity_mps.dot(&direction);
        // Not `max`: a velocity that is no number must stay one.
        let approach_mps = if along_mps < 0.0 { 0.0 } else { along_mps };
        let mut delay_s = settings.delay_s;
        if distance_cm < map.range_cm[bin] {
            delay_s += now_us.wrapping_sub(map.written_us[bin]) as f32 * 1e-6;
        }
        let stop_m = map.distance_m(bin) - keep_m - approach_mps * delay_s;
        let excess_mps = if stop_m >= 0.0 {
            let (jerk_mps3, acceleration_mps2) = (settings.jerk_mps3, settings.acceleration_mps2);
            (approach_mps - speed_to_stop_mps(jerk_mps3, acceleration_mps2, stop_m, 0.0)).max(0.0)
        } else {
            approach_mps
        };
        let acceleration_mps2 = -settings.velocity_gain_per_s * excess_mps;
        if acceleration_mps2 < hardest.acceleration_mps2 {
            hardest = Braking {
                acceleration_mps2,
                direction,
            };
        }
    }
    hardest
}
