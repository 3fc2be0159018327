//! How fast a velocity setpoint may change: a stick that is moved at once must not make the vehicle tilt at once.
//!
//! | change | rate |
//! |---|---|
//! | to more speed | MPC_ACC_HOR, with which PX4 on average accelerates a vehicle whose stick is pushed |
//! | to less speed | twice that, which is all that PX4's sticks demand |
//! | because of an obstacle | any: the limits are applied afterwards |
//!
//! A step of the setpoint makes the autopilot tilt as far as it can, and a sensor that is fixed to the body then sees
//! the ground or the sky. A vehicle with a planar lidar slowed down and sped up again in turns, because tilt had
//! blinded its sensor.

use jink_shared_types::Timestamp;
use nalgebra::Vector2;

/// A setpoint older than this (s) is no longer flown; the autopilot has discarded it, too.
const LIFETIME_S: f64 = 0.5;

/// The last setpoint.
#[derive(Clone, Copy, Debug, Default)]
pub struct RateLimiter {
    last: Option<(Timestamp, Vector2<f64>)>,
}

impl RateLimiter {
    /// The setpoint at `now` is `velocity`.
    pub fn new(now: Timestamp, velocity: Vector2<f64>) -> Self {
        Self {
            last: Some((now, velocity)),
        }
    }

    /// From which velocity and for how long the setpoint may move; without a last setpoint, from the vehicle's own
    /// velocity.
    pub fn at(&self, now: Timestamp, velocity: &Vector2<f64>) -> RateLimitStep {
        match self.last {
            Some((then, from)) if (0.0..LIFETIME_S).contains(&now.seconds_since(then)) => RateLimitStep {
                from,
                seconds: now.seconds_since(then),
            },
            _ => RateLimitStep {
                from: *velocity,
                seconds: 0.0,
            },
        }
    }
}

/// One step of the setpoint.
#[derive(Clone, Copy, Debug)]
pub struct RateLimitStep {
    from: Vector2<f64>,
    seconds: f64,
}

impl RateLimitStep {
    /// As far toward `target` as the rates allow.
    pub fn toward(&self, target: &Vector2<f64>, acceleration_mps2: f64) -> Vector2<f64> {
        let change = target - self.from;
        let rate_mps2 = if change.dot(&self.from) < 0.0 {
            2.0 * acceleration_mps2
        } else {
            acceleration_mps2
        };
        self.from + change.cap_magnitude(rate_mps2 * self.seconds)
    }
}

#[cfg(test)]
mod tests {
    use super::RateLimiter;
    use jink_shared_types::Timestamp;
    use nalgebra::Vector2;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn it_arrives_and_never_faster_than_allowed(
            x in -10.0..10.0f64, y in -10.0..10.0f64, from_x in -10.0..10.0f64, from_y in -10.0..10.0f64,
        ) {
            let target = Vector2::new(x, y);
            let mut at = Vector2::new(from_x, from_y);
            let mut rate_limiter = RateLimiter::new(Timestamp::from_seconds(1.0), at);
            for k in 1..=500 {
                let now = Timestamp::from_seconds(1.0 + 0.02 * f64::from(k));
                let next = rate_limiter.at(now, &Vector2::zeros()).toward(&target, 3.0);
                prop_assert!((next - at).norm() <= 0.12 + 1e-6);
                at = next;
                rate_limiter = RateLimiter::new(now, at);
            }
            prop_assert!((at - target).norm() < 1e-6);
        }
    }

    #[test]
    fn after_a_pause_it_begins_where_the_vehicle_is() {
        let rate_limiter = RateLimiter::new(Timestamp::from_seconds(1.0), Vector2::new(5.0, 0.0));
        let flown = Vector2::new(0.0, 2.0);
        let step = rate_limiter.at(Timestamp::from_seconds(2.0), &flown);
        assert_eq!(step.toward(&Vector2::new(9.0, 9.0), 3.0), flown);
    }
}
