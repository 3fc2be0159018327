//! Horizontal sticks of current PX4: accelerations against a made-up drag (MPC_POS_MODE 4).
//!
//! | in | out |
//! |---|---|
//! | sticks in the world frame, position, what the controller followed | velocity and acceleration setpoints, or a place to stay at |
//!
//! The stick asks for `2 MPC_ACC_HOR`, and the setpoint's velocity is dragged by `2 MPC_ACC_HOR / MPC_VEL_MANUAL` times
//! itself: full stick ends at MPC_VEL_MANUAL, having accelerated with MPC_ACC_HOR on average. Released, the drag grows
//! within a second to the larger of two and the root of MPC_VEL_MANUAL, and below 1 m/s follows the root of the speed,
//! so that it ends. Collision prevention changes what the stick asks for, before drag and limits. Then come
//! MPC_JERK_MAX and the tilt limit, and the sum of it all is the velocity. A setpoint at rest locks the position.
//!
//! Simplified: MPC_VEL_MAN_SIDE and _BACK are what MPC_VEL_MANUAL is, no estimator limits speeds, no weathervane turns
//! the nose. A collision prevention that answers NaN leaves a NaN here for good, as in PX4: the vehicle stays where it
//! is, and sticks do nothing more until the mode is entered anew.

use super::parameters::{Parameter as P, Parameters};
use jink_simulated_world::vehicle::GRAVITY_MPS2;
use nalgebra::Vector2;

/// How quickly the drag of a released stick grows (s).
const BRAKE_BOOST_S: f64 = 0.8;
/// Smallest boost of the drag of a released stick.
const BRAKE_BOOST_MIN: f64 = 2.0;
/// Squares below this are zero (single precision, as PX4 computes).
const EPSILON: f64 = f32::EPSILON as f64;

/// What a cycle is flown from.
#[derive(Clone, Copy, Debug)]
pub struct StickInput {
    /// World frame, at most 1.
    pub stick: Vector2<f64>,
    /// Where the vehicle is (m).
    pub position: Vector2<f64>,
    /// The velocity that the controller followed in the last cycle (m/s).
    pub followed_mps: Vector2<f64>,
    /// Tilt limit (rad).
    pub tilt_limit_rad: f64,
    /// Duration of the cycle (s).
    pub dt_s: f64,
}

/// The setpoints; world frame.
#[derive(Clone, Debug)]
pub struct StickAcceleration {
    /// The place that is held, if one is (m).
    pub held: Option<Vector2<f64>>,
    /// Velocity (m/s).
    pub velocity: Vector2<f64>,
    /// Acceleration (m/s^2).
    pub acceleration: Vector2<f64>,
    /// The acceleration before the tilt limit: what jerk is counted from.
    slewed: Vector2<f64>,
    brake_boost: f64,
}

impl Default for StickAcceleration {
    fn default() -> Self {
        Self {
            held: None,
            velocity: Vector2::zeros(),
            acceleration: Vector2::zeros(),
            slewed: Vector2::zeros(),
            brake_boost: 1.0,
        }
    }
}

impl StickAcceleration {
    /// Begins anew from a motion; an acceleration that is not given is none.
    pub fn take_over(&mut self, velocity: Vector2<f64>, acceleration: Vector2<f64>) {
        *self = Self {
            velocity,
            ..Self::default()
        };
        if acceleration.iter().all(|a| a.is_finite()) {
            self.slewed = acceleration;
        }
    }

    /// The estimate jumped: what was held is no place any more.
    pub fn position_reset(&mut self) {
        self.held = None;
    }

    /// One cycle. `prevent` gets the wanted acceleration and the velocity and gives the acceleration that is allowed.
    pub fn step(
        &mut self,
        input: &StickInput,
        parameters: &Parameters,
        prevent: impl FnOnce(Vector2<f64>, Vector2<f64>) -> Vector2<f64>,
    ) {
        let full_mps2 = 2.0 * parameters.get(P::MPC_ACC_HOR);
        let wanted = prevent(input.stick * full_mps2, self.velocity);
        let mut drag = self.drag(input, full_mps2, parameters.get(P::MPC_VEL_MANUAL));
        if self.ends_in_rest(&wanted, &drag, input.dt_s) {
            drag = Vector2::zeros();
            self.velocity = Vector2::zeros();
        }
        let slewed = self.limit_jerk(wanted - drag, parameters.get(P::MPC_JERK_MAX) * input.dt_s);
        self.slewed = slewed;
        self.acceleration = limit_tilt(slewed, input.tilt_limit_rad);
        self.velocity += self.acceleration * input.dt_s;
        self.lock(input);
    }

    fn drag(&mut self, input: &StickInput, full_mps2: f64, full_mps: f64) -> Vector2<f64> {
        let released = input.stick.norm_squared() < EPSILON;
        let boost = if released {
            full_mps.sqrt().max(BRAKE_BOOST_MIN)
        } else {
            1.0
        };
        self.brake_boost += (boost - self.brake_boost) * input.dt_s / (BRAKE_BOOST_S + input.dt_s);
        let speed = self.velocity.norm();
        let rooted = if speed > EPSILON && speed < 1.0 {
            self.velocity * (speed.sqrt() / speed)
        } else {
            self.velocity
        };
        let braking = (self.brake_boost - 1.0).clamp(0.0, 1.0);
        let dragged = rooted * braking + self.velocity * (1.0 - braking);
        dragged * (full_mps2 / full_mps * self.brake_boost)
    }

    /// Drag must not turn the velocity round: without a wish, or with one that changes its sign, what is slower than
    /// that stops.
    fn ends_in_rest(&self, wanted: &Vector2<f64>, drag: &Vector2<f64>, dt_s: f64) -> bool {
        let sign = |x: f64| i8::from(x > 0.0) - i8::from(x < 0.0);
        let turns = |axis: usize| sign(self.acceleration[axis]) != sign(wanted[axis]);
        let aimless = wanted.norm_squared() < EPSILON || turns(0) || turns(1);
        aimless && self.velocity.norm_squared() < drag.norm_squared() * dt_s * dt_s
    }

    /// Each axis by its share of the change, so that both arrive together.
    fn limit_jerk(&self, wanted: Vector2<f64>, step_mps2: f64) -> Vector2<f64> {
        let change = wanted - self.acceleration;
        let norm = change.norm();
        let share = if norm > EPSILON && norm.is_finite() {
            change.abs() / norm
        } else {
            Vector2::zeros()
        };
        self.slewed.zip_zip_map(&wanted, &share, |from, to, share| {
            from + (to - from).clamp(-share * step_mps2, share * step_mps2)
        })
    }

    fn lock(&mut self, input: &StickInput) {
        let moving = self.velocity.norm_squared() > EPSILON;
        if !moving && self.held.is_none() {
            self.held = Some(input.position);
        } else if moving && self.held.is_some() {
            self.held = None;
            // What the position loop asked for goes on.
            if input.followed_mps.iter().all(|v| v.is_finite()) {
                self.velocity = input.followed_mps;
            }
        }
    }
}

fn limit_tilt(acceleration: Vector2<f64>, limit_rad: f64) -> Vector2<f64> {
    let (length, limit) = (acceleration.norm(), limit_rad.tan() * GRAVITY_MPS2);
    if length > limit {
        acceleration * (limit / length)
    } else {
        acceleration
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn fly(sticks: &mut StickAcceleration, stick: [f64; 2], seconds: f64) {
        let parameters = Parameters::default();
        for _ in 0..(seconds / 0.008) as usize {
            let input = StickInput {
                stick: stick.into(),
                position: Vector2::new(7.0, 7.0),
                followed_mps: sticks.velocity,
                tilt_limit_rad: 0.7,
                dt_s: 0.008,
            };
            sticks.step(&input, &parameters, |wanted, _| wanted);
        }
    }

    proptest! {
        #[test]
        fn a_stick_ends_in_its_share_of_the_full_speed_within_jerk_and_released_in_rest(angle in 0.0..6.2f64, share in 0.1..1.0f64) {
            let mut sticks = StickAcceleration::default();
            let stick = [share * angle.cos(), share * angle.sin()];
            let mut before = sticks.acceleration;
            for _ in 0..1_500 {
                fly(&mut sticks, stick, 0.008);
                prop_assert!((sticks.acceleration - before).norm() <= 8.0 * 0.008 + 1e-9);
                before = sticks.acceleration;
            }
            prop_assert!((sticks.velocity - Vector2::from(stick) * 10.0).norm() < 0.05, "{}", sticks.velocity);
            prop_assert!(sticks.held.is_none());
            fly(&mut sticks, [0.0, 0.0], 6.0);
            prop_assert!(sticks.velocity.norm() < 1e-6, "{}", sticks.velocity);
            prop_assert_eq!(sticks.held, Some(Vector2::new(7.0, 7.0)));
        }
    }

    #[test]
    fn what_is_no_number_stays_and_the_place_is_held() {
        let mut sticks = StickAcceleration::default();
        fly(&mut sticks, [1.0, 0.0], 2.0);
        let input = StickInput {
            stick: Vector2::new(1.0, 0.0),
            position: Vector2::new(3.0, 0.0),
            followed_mps: sticks.velocity,
            tilt_limit_rad: 0.7,
            dt_s: 0.008,
        };
        sticks.step(&input, &Parameters::default(), |_, _| Vector2::repeat(f64::NAN));
        fly(&mut sticks, [1.0, 0.0], 2.0);
        assert!(sticks.velocity.x.is_nan());
        assert_eq!(sticks.held, Some(Vector2::new(3.0, 0.0)));
    }
}
