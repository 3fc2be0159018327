//! How fast PX4 lets itself fly towards a point: the distance of a waypoint is a speed command.
//!
//! * Stopping from `v` within `d`: constant deceleration `a` after a delay of `2 a / j` at full speed (the time jerk
//!   needs from full acceleration to full deceleration): `v_end^2 = v^2 - 2 a (d - 2 v a / j)`, solved for `v`.
//! * A corner of angle `alpha` between two legs: the circle that touches both at distance `r` from the corner has the
//!   radius `r tan(alpha / 2)`; `v^2 = a r tan(alpha / 2)`.

use nalgebra::{Vector2, Vector3};

/// Two points nearer than this are the same waypoint (m).
const SAME_POINT_M: f64 = 0.001;

/// What the rules know of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedLimits {
    /// Cruise speed (m/s).
    pub cruise_mps: f64,
    /// Horizontal acceleration (m/s^2).
    pub acceleration_mps2: f64,
    /// Jerk (m/s^3).
    pub jerk_mps3: f64,
    /// Share of the acceleration used in corners.
    pub corner_share: f64,
    /// Acceptance radius of the waypoint (m).
    pub acceptance_m: f64,
    /// Vertical acceptance radius (m).
    pub vertical_acceptance_m: f64,
}

/// The highest speed from which `end_mps` can be reached within `distance_m` (m/s).
pub fn before_stop_mps(jerk_mps3: f64, acceleration_mps2: f64, distance_m: f64, end_mps: f64) -> f64 {
    let lag = 2.0 * acceleration_mps2 * acceleration_mps2 / jerk_mps3;
    let energy = 2.0 * acceleration_mps2 * distance_m + end_mps * end_mps;
    // Never slower than the speed wanted at the end, although the delay alone would ask for that.
    ((lag * lag + energy).sqrt() - lag).max(end_mps)
}

/// The highest speed through the corner at `corner` between the legs to `from` and to `to` (m/s).
fn in_corner_mps(
    from: &Vector2<f64>,
    corner: &Vector2<f64>,
    to: &Vector2<f64>,
    acceleration_mps2: f64,
    radius_m: f64,
) -> f64 {
    let unit = |v: Vector2<f64>| v.try_normalize(f64::EPSILON).unwrap_or_default();
    let cosine = unit(corner - from).dot(&unit(corner - to)).clamp(-1.0, 1.0);
    let alpha_rad = cosine.acos().min(std::f64::consts::PI - f64::from(f32::EPSILON));
    (acceleration_mps2 * radius_m * (alpha_rad / 2.0).tan()).sqrt()
}

/// The highest horizontal speed at `here` on the way over `target` to `next`, at which the way ends (m/s).
pub fn along_mps(
    here: &Vector3<f64>,
    target: &Vector3<f64>,
    next: &Vector3<f64>,
    limits: &SpeedLimits,
) -> f64 {
    // At the last point the speed is zero; one leg back from there is the speed allowed at the target.
    let at_target = leg_mps(target, next, next, 0.0, limits);
    leg_mps(here, target, next, at_target, limits)
}

fn leg_mps(
    start: &Vector3<f64>,
    target: &Vector3<f64>,
    next: &Vector3<f64>,
    exit_mps: f64,
    limits: &SpeedLimits,
) -> f64 {
    let onward_m = (target - next).xy().norm();
    let goes_on = onward_m > SAME_POINT_M
        && onward_m >= limits.acceptance_m
        && (target.z - start.z).abs() < limits.vertical_acceptance_m
        && (next.z - target.z).abs() < limits.vertical_acceptance_m;
    let mut at_target_mps = 0.0;
    if goes_on {
        let acceleration = limits.corner_share * limits.acceleration_mps2;
        at_target_mps = in_corner_mps(
            &start.xy(),
            &target.xy(),
            &next.xy(),
            acceleration,
            limits.acceptance_m,
        )
        .min(exit_mps)
        .min(limits.cruise_mps);
    }
    let distance_m = (start - target).xy().norm();
    before_stop_mps(
        limits.jerk_mps3,
        limits.acceleration_mps2,
        distance_m,
        at_target_mps,
    )
    .min(limits.cruise_mps)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMITS: SpeedLimits = SpeedLimits {
        cruise_mps: 5.0,
        acceleration_mps2: 3.0,
        jerk_mps3: 4.0,
        corner_share: 0.5,
        acceptance_m: 2.0,
        vertical_acceptance_m: 0.8,
    };

    proptest! {
        #[test]
        fn the_speed_before_a_stop_solves_its_equation(distance in 0.0..100.0f64) {
            let v = before_stop_mps(4.0, 3.0, distance, 0.0);
            let delayed = distance - 2.0 * v * 3.0 / 4.0;
            prop_assert!((v * v - 6.0 * delayed).abs() < 1e-9);
        }

        #[test]
        fn a_moving_end_allows_more_speed(distance in 0.0..100.0f64, end in 0.0..5.0f64) {
            let v = before_stop_mps(4.0, 3.0, distance, end);
            prop_assert!(v >= end && v >= before_stop_mps(4.0, 3.0, distance, 0.0));
        }
    }

    #[test]
    fn a_near_point_is_a_slow_command_and_a_far_one_a_fast_one() {
        let here = Vector3::new(0.0, 0.0, -5.0);
        let speed = |x: f64| {
            let point = Vector3::new(x, 0.0, -5.0);
            along_mps(&here, &point, &point, &LIMITS)
        };
        assert!(speed(0.5) < 0.35);
        assert!(speed(5.0) < 3.0);
        assert_eq!(speed(50.0), 5.0);
    }

    #[test]
    fn a_straight_mission_is_flown_through_and_a_sharp_corner_is_not() {
        let here = Vector3::new(0.0, 0.0, -5.0);
        let target = Vector3::new(3.0, 0.0, -5.0);
        let straight = along_mps(&here, &target, &Vector3::new(40.0, 0.0, -5.0), &LIMITS);
        let right_angle = along_mps(&here, &target, &Vector3::new(3.0, 40.0, -5.0), &LIMITS);
        let back = along_mps(&here, &target, &Vector3::new(-40.0, 0.1, -5.0), &LIMITS);
        assert!(straight > 4.9);
        assert!(back < right_angle && right_angle < straight);
    }
}
