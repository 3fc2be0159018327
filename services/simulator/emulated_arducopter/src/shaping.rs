//! How ArduCopter bends a jumping target into a motion: limited jerk, a correction of limited acceleration, and what is
//! fed forward on top of it.
//!
//! * [`sqrt_controller`]: proportional near the goal, and the square root of a constant deceleration further away;
//! * a position error becomes a velocity through it, with half the acceleration and the gain `jerk / (2 acceleration)`;
//! * a velocity error becomes an acceleration through it, with the gain `jerk / acceleration`, limited to the acceleration;
//! * **the fed forward acceleration is added after that limit**, and only the change of the sum is limited, by the jerk.
//!
//! This is the scheme of ArduPilot's `AP_Math/control.cpp`. The last point is why a stop with 4 m/s^2 is followed although
//! WPNAV_ACCEL is 2.5, and why an error made on the way is corrected slowly.

use nalgebra::Vector2;

/// What a correction may use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapeLimits {
    /// Acceleration of the correction (m/s^2).
    pub acceleration_mps2: f64,
    /// Change of the whole acceleration (m/s^3).
    pub jerk_mps3: f64,
}

impl ShapeLimits {
    /// Gain from position error to velocity (1/s).
    fn position_gain(&self) -> f64 {
        0.5 * self.jerk_mps3 / self.acceleration_mps2
    }

    /// Gain from velocity error to acceleration (1/s).
    fn velocity_gain(&self) -> f64 {
        self.jerk_mps3 / self.acceleration_mps2
    }
}

/// The rate at which `error` is corrected: `gain * error`, but never more than a change of rate by `limit` can still stop,
/// nor more than the error within `dt_s`.
pub fn sqrt_controller(error: f64, gain: f64, limit: f64, dt_s: f64) -> f64 {
    let linear = limit / (gain * gain);
    let size = error.abs();
    let rate = if size > linear {
        (2.0 * limit * (size - linear / 2.0)).sqrt()
    } else {
        size * gain
    };
    rate.min(size / dt_s).copysign(error)
}

/// The same along a vector.
pub fn sqrt_controller_2d(error: Vector2<f64>, gain: f64, limit: f64, dt_s: f64) -> Vector2<f64> {
    let size = error.norm();
    if size <= 0.0 {
        return Vector2::zeros();
    }
    error * (sqrt_controller(size, gain, limit, dt_s) / size)
}

/// `v`, shortened to `limit`.
pub fn limit_length(v: Vector2<f64>, limit: f64) -> Vector2<f64> {
    let size = v.norm();
    if size > limit { v * (limit / size) } else { v }
}

/// `acceleration` limited to `limit`, what turns the velocity before what changes its size. Returns whether it was too
/// long.
pub fn limit_turning_first(
    velocity: Vector2<f64>,
    acceleration: Vector2<f64>,
    limit: f64,
) -> (Vector2<f64>, bool) {
    if acceleration.norm() <= limit {
        return (acceleration, false);
    }
    let Some(forward) = velocity.try_normalize(1e-9) else {
        return (limit_length(acceleration, limit), true);
    };
    let along = forward.dot(&acceleration);
    let turning = acceleration - forward * along;
    if turning.norm() >= limit {
        return (limit_length(turning, limit), true);
    }
    let left = (limit * limit - turning.norm_squared()).max(0.0).sqrt();
    (turning + forward * along.clamp(-left, left), true)
}

/// A correction within `limit`: while it speeds the vehicle up, turning comes first; while it slows it down, both shrink alike.
fn limit_correction(velocity: Vector2<f64>, correction: Vector2<f64>, limit: f64) -> Vector2<f64> {
    if velocity.dot(&correction) > 0.0 {
        limit_turning_first(velocity, correction, limit).0
    } else {
        limit_length(correction, limit)
    }
}

/// The velocity that corrects a horizontal position error, at most `speed_mps`.
pub fn correcting_velocity(
    error: Vector2<f64>,
    speed_mps: f64,
    limits: &ShapeLimits,
    dt_s: f64,
) -> Vector2<f64> {
    let half = 0.5 * limits.acceleration_mps2;
    limit_length(
        sqrt_controller_2d(error, limits.position_gain(), half, dt_s),
        speed_mps,
    )
}

/// The acceleration after one more step from `acceleration`, on the way from `velocity` to `target`.
pub fn shape_velocity(
    target: Vector2<f64>,
    fed_forward: Vector2<f64>,
    velocity: Vector2<f64>,
    acceleration: Vector2<f64>,
    limits: &ShapeLimits,
    dt_s: f64,
) -> Vector2<f64> {
    let error = target - velocity;
    let wanted = sqrt_controller_2d(error, limits.velocity_gain(), limits.jerk_mps3, dt_s);
    let correction = limit_correction(velocity, wanted, limits.acceleration_mps2);
    shape_acceleration(correction + fed_forward, acceleration, limits, dt_s)
}

/// One step from `acceleration` towards `target`, limited by the jerk.
pub fn shape_acceleration(
    target: Vector2<f64>,
    acceleration: Vector2<f64>,
    limits: &ShapeLimits,
    dt_s: f64,
) -> Vector2<f64> {
    acceleration + limit_length(target - acceleration, limits.jerk_mps3 * dt_s)
}

/// [`correcting_velocity`] on the vertical axis, between `lowest` and `highest` (m/s).
pub fn correcting_velocity_1d(error: f64, lowest: f64, highest: f64, limits: &ShapeLimits, dt_s: f64) -> f64 {
    let half = 0.5 * limits.acceleration_mps2;
    sqrt_controller(error, limits.position_gain(), half, dt_s).clamp(lowest, highest)
}

/// [`shape_velocity`] on one axis.
pub fn shape_velocity_1d(
    target: f64,
    fed_forward: f64,
    velocity: f64,
    acceleration: f64,
    limits: &ShapeLimits,
    dt_s: f64,
) -> f64 {
    let wanted = sqrt_controller(target - velocity, limits.velocity_gain(), limits.jerk_mps3, dt_s);
    let correction = wanted.clamp(-limits.acceleration_mps2, limits.acceleration_mps2);
    let step = limits.jerk_mps3 * dt_s;
    acceleration + (correction + fed_forward - acceleration).clamp(-step, step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMITS: ShapeLimits = ShapeLimits {
        acceleration_mps2: 2.5,
        jerk_mps3: 5.0,
    };
    const DT_S: f64 = 0.004;

    proptest! {
        #[test]
        fn a_velocity_is_reached_within_jerk_and_acceleration(x in -8.0..8.0f64, y in -8.0..8.0f64, vx in -8.0..8.0f64) {
            let target = Vector2::new(x, y);
            let mut velocity = Vector2::new(vx, 0.0);
            let mut acceleration = Vector2::zeros();
            for _ in 0..5_000 {
                let next = shape_velocity(target, Vector2::zeros(), velocity, acceleration, &LIMITS, DT_S);
                prop_assert!((next - acceleration).norm() <= LIMITS.jerk_mps3 * DT_S + 1e-9);
                prop_assert!(next.norm() <= LIMITS.acceleration_mps2 + 1e-9);
                acceleration = next;
                velocity += acceleration * DT_S;
            }
            prop_assert!((velocity - target).norm() < 0.02);
        }

        #[test]
        fn what_is_fed_forward_is_followed_beyond_the_limit_of_the_correction(a in 2.6..6.0f64) {
            let mut acceleration = Vector2::zeros();
            let mut velocity = Vector2::zeros();
            for step in 0..1_000 {
                let target = Vector2::new(a, 0.0) * (f64::from(step) * DT_S);
                acceleration = shape_velocity(target, Vector2::new(a, 0.0), velocity, acceleration, &LIMITS, DT_S);
                velocity += acceleration * DT_S;
            }
            prop_assert!((acceleration.x - a).abs() < 0.3, "{}", acceleration.x);
        }

        #[test]
        fn the_limit_keeps_what_turns(vx in -5.0..5.0f64, vy in -5.0..5.0f64, ax in -9.0..9.0f64, ay in -9.0..9.0f64) {
            let (v, a) = (Vector2::new(vx, vy), Vector2::new(ax, ay));
            let (limited, was_longer) = limit_turning_first(v, a, 3.0);
            prop_assert!(limited.norm() <= 3.0 + 1e-9);
            prop_assert_eq!(was_longer, a.norm() > 3.0);
            if let Some(forward) = v.try_normalize(1e-3) {
                let turning = |a: Vector2<f64>| (a - forward * forward.dot(&a)).norm();
                prop_assert!((turning(limited) - turning(a).min(3.0)).abs() < 1e-9);
            }
        }

        #[test]
        fn a_correction_never_passes_its_goal_in_one_step(error in -30.0..30.0f64, gain in 0.2..5.0f64, limit in 0.5..9.0f64) {
            let rate = sqrt_controller(error, gain, limit, DT_S);
            prop_assert!(rate.abs() * DT_S <= error.abs() + 1e-12);
            prop_assert!(rate * error >= 0.0 && rate.abs() <= gain * error.abs() + 1e-12);
        }
    }

    #[test]
    fn a_position_alone_is_chased_at_4_5_m_s_from_8_7_m_behind() {
        let error = Vector2::new(8.73, 0.0);
        assert!((correcting_velocity(error, 10.0, &LIMITS, DT_S).x - 4.5).abs() < 0.01);
    }
}
