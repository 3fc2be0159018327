//! Headings along a curve: towards where it goes, no faster than the vehicle turns.

use jink_shared_types::bezier::{End, QUINTIC, quintic_between};
use jink_shared_types::frames::wrap_pi;
use jink_shared_types::motion::MotionState;
use nalgebra::Vector3;

/// Below this horizontal speed the direction of a curve is not followed (m/s).
const SPEED_MIN_MPS: f64 = 0.4;
/// A quintic between two headings at rest peaks at 1.875 times its mean rate.
const PEAK_OVER_MEAN: f64 = 1.875;

/// The heading so far; pieces are added one after the other.
#[derive(Clone, Copy, Debug)]
pub struct HeadingProfile {
    yaw_rad: f64,
    rate_radps: f64,
    wanted_rad: f64,
    rate_max_radps: f64,
}

impl HeadingProfile {
    /// Starts at the heading of `start`; `wanted_rad` is kept throughout if finite, otherwise the curve's direction is
    /// followed; never faster than `rate_max_radps`.
    pub fn new(start: &MotionState, wanted_rad: f64, rate_max_radps: f64) -> Self {
        Self {
            yaw_rad: start.yaw_rad,
            rate_radps: start.yaw_rate_radps,
            wanted_rad,
            rate_max_radps,
        }
    }

    /// The heading's control points (rad) over the next piece, whose position has the control points `points`.
    pub fn piece(&mut self, points: &[Vector3<f64>; QUINTIC], duration_s: f64) -> [f64; QUINTIC] {
        let goal_rad = if self.wanted_rad.is_finite() {
            self.wanted_rad
        } else {
            self.direction(points, duration_s)
        };
        let [least_radps, most_radps] = self.mean_rates();
        let turn_rad = wrap_pi(goal_rad - self.yaw_rad)
            .max(least_radps * duration_s)
            .min(most_radps * duration_s);
        let start = along(self.yaw_rad, self.rate_radps);
        self.yaw_rad += turn_rad;
        // Every piece ends without turning: the next direction is not known yet, and rates stay within the limit.
        self.rate_radps = 0.0;
        quintic_between(&start, &along(self.yaw_rad, 0.0), duration_s).map(|point| point.x)
    }

    /// The mean rates (rad/s) of a piece whose heading never turns faster than allowed, smallest first.
    ///
    /// With the rate `r` at its start and the mean rate `r / 2 + q` the rate over a piece is `r g(u) + 30 q u^2 (1 -
    /// u)^2` with
    /// `g(u) = 1 - 3 u^2 + 2 u^3`, which falls from 1 to 0: with `q = 0` the rate only runs out. It stays above `-R` if
    /// `q >= -(R + r g) / (30 u^2 (1 - u)^2)` throughout and below `R` if `q <= (R - r + r (1 - g)) / (30 u^2 (1 - u)^2)`. The
    /// denominator is at most 1.875, and over it `g` and `1 - g` are nowhere below a tenth: hence the bounds below, the
    /// same mirrored for a negative `r`. A rate that is too fast already is not exceeded.
    fn mean_rates(&self) -> [f64; 2] {
        let (rate, limit) = (self.rate_radps.abs(), self.rate_max_radps);
        let against = -limit / PEAK_OVER_MEAN - 0.1 * rate;
        let along = (limit - rate).max(0.0) / PEAK_OVER_MEAN + 0.1 * rate;
        let [least, most] = [against, along].map(|q| 0.5 * rate + q);
        if self.rate_radps < 0.0 {
            [-most, -least]
        } else {
            [least, most]
        }
    }

    /// The direction in which the piece leaves, or mostly goes if it ends at rest.
    fn direction(&self, points: &[Vector3<f64>; QUINTIC], duration_s: f64) -> f64 {
        let leaving = (points[QUINTIC - 1] - points[QUINTIC - 2]) * (5.0 / duration_s);
        let mean = (points[QUINTIC - 1] - points[0]) / duration_s;
        for direction in [leaving, mean] {
            if direction.xy().norm() > SPEED_MIN_MPS {
                return direction.y.atan2(direction.x);
            }
        }
        self.yaw_rad
    }
}

/// The control points (rad) and the duration (s) of a turn on the spot from the heading of `start` to `wanted_rad`, by
/// the shorter way and never faster than `rate_max_radps`.
pub fn turn(start: &MotionState, wanted_rad: f64, rate_max_radps: f64) -> ([f64; QUINTIC], f64) {
    /// A turn that takes no time would divide by it (s).
    const SHORTEST_S: f64 = 0.3;
    let turn_rad = wrap_pi(wanted_rad - start.yaw_rad);
    let duration_s = (PEAK_OVER_MEAN * turn_rad.abs() / rate_max_radps).max(SHORTEST_S);
    let end = along(start.yaw_rad + turn_rad, 0.0);
    let points = quintic_between(&along(start.yaw_rad, 0.0), &end, duration_s);
    (points.map(|point| point.x), duration_s)
}

fn along(yaw_rad: f64, rate_radps: f64) -> End {
    End {
        position: Vector3::new(yaw_rad, 0.0, 0.0),
        velocity: Vector3::new(rate_radps, 0.0, 0.0),
        acceleration: Vector3::zeros(),
    }
}

#[cfg(test)]
mod tests {
    use super::HeadingProfile;
    use crate::HEADING_HALVINGS;
    use jink_shared_types::bezier::{derivative_scalar, evaluate_scalar, hull_keeps};
    use jink_shared_types::motion::{MotionLimits, MotionState};
    use nalgebra::Vector3;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    proptest! {
        #[test]
        fn the_heading_never_turns_faster_than_allowed_nor_than_it_does_already(
            yaw in -PI..PI, rate in -1.5..1.5f64, direction in -PI..PI, duration in 0.3..4.0f64, rate_max in 0.2..2.0f64,
        ) {
            let start = MotionState { yaw_rad: yaw, yaw_rate_radps: rate, ..MotionState::default() };
            let direction = Vector3::new(direction.cos(), direction.sin(), 0.0);
            let points = std::array::from_fn(|i| direction * (i as f64 * duration * 0.4));
            let mut heading = HeadingProfile::new(&start, f64::NAN, rate_max);
            let yaw_rad = heading.piece(&points, duration);
            let rates: [f64; 5] = derivative_scalar(&yaw_rad, duration);
            prop_assert!((rates[0] - rate).abs() < 1e-9 && rates[4].abs() < 1e-9);
            for i in 0..=100 {
                let reached = evaluate_scalar(&rates, f64::from(i) / 100.0).abs();
                prop_assert!(reached <= rate_max.max(rate.abs()) + 1e-9, "{reached} rad/s");
            }
            // By the certificate's measure: no heading costs a curve its certificate.
            let allowed = MotionLimits::allowed(rate_max.max(rate.abs()));
            let hull = rates.map(|rate| Vector3::new(rate, 0.0, 0.0));
            prop_assert!(hull_keeps(&hull, HEADING_HALVINGS, &|rate: &Vector3<f64>| rate.x.abs() <= allowed));
        }
    }

    proptest! {
        #[test]
        fn a_turn_on_the_spot_ends_where_it_should_and_is_never_too_fast(
            yaw in -PI..PI, wanted in -10.0..10.0f64, rate_max in 0.1..2.0f64,
        ) {
            let start = MotionState { yaw_rad: yaw, ..MotionState::default() };
            let (points, duration) = super::turn(&start, wanted, rate_max);
            let rates: [f64; 5] = derivative_scalar(&points, duration);
            for i in 0..=100 {
                prop_assert!(evaluate_scalar(&rates, f64::from(i) / 100.0).abs() <= rate_max + 1e-9);
            }
            prop_assert!((points[5] - yaw).abs() <= PI + 1e-9, "the shorter way");
            prop_assert!(((points[5] - wanted) / 2.0).sin().abs() < 1e-9);
        }
    }

    #[test]
    fn a_slow_curve_keeps_the_heading() {
        let start = MotionState {
            yaw_rad: 0.7,
            ..MotionState::default()
        };
        let points = std::array::from_fn(|i| Vector3::new(0.0, i as f64 * 0.01, 0.0));
        let yaw_rad = HeadingProfile::new(&start, f64::NAN, 1.0).piece(&points, 1.0);
        assert!(yaw_rad.iter().all(|yaw| (yaw - 0.7).abs() < 1e-12));
    }
}
