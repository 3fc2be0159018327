//! Position and velocity control: a reference that was shaped becomes a lean and a thrust.
//!
//! | step | horizontal | vertical |
//! |---|---|---|
//! | the reference moves on by itself, then is bent towards the target | [`shaping`](super::shaping) | the same |
//! | position error to velocity | square root controller, PSC_POSXY_P | PSC_POSZ_P |
//! | velocity error to acceleration | P, I, D on the filtered error | P, slow I |
//! | acceleration to thrust | lean up to ANGLE_MAX, turning before speed | thrust for the vertical part |
//!
//! The scheme is that of ArduPilot's `AC_PosControl`. Where the lean is exhausted the reference waits: it neither moves nor
//! gains speed in the direction in which the vehicle cannot follow.

use super::parameters::{Parameter as P, Parameters};
use super::shaping::{
    ShapeLimits, correcting_velocity, correcting_velocity_1d, limit_length, limit_turning_first,
    shape_acceleration, shape_velocity, shape_velocity_1d, sqrt_controller, sqrt_controller_2d,
};
use jink_emulated_autopilot::attitude::attitude_for;
use jink_simulated_world::vehicle::estimator::Estimate;
use jink_simulated_world::vehicle::{ActuatorCommand, GRAVITY_MPS2, HOVER_THRUST, STEP_S};
use nalgebra::{Vector2, Vector3};

/// Filter of the velocity error and of its derivative (Hz): PSC_VELXY_FLTE and PSC_VELXY_FLTD.
const FILTER_HZ: f64 = 5.0;
/// Largest integral (m/s^2): PSC_VELXY_IMAX.
const INTEGRAL_MAX_MPS2: f64 = 10.0;
/// Gain of the vertical integral (1/s^2). The real one integrates measured acceleration; the emulated motors obey well enough
/// for a slow correction of drag.
const VERTICAL_INTEGRAL: f64 = 1.0;
/// Gain of the vehicle's attitude loop about its vertical axis (1/s), and ArduPilot's (ATC_ANG_YAW_P).
const YAW_GAIN_OF_VEHICLE: f64 = 2.8;
const YAW_GAIN: f64 = 4.5;
/// Thrust of motors that idle on the ground.
const IDLE_THRUST: f64 = 0.1;

/// A place with its motion, local NED.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Position (m).
    pub position: Vector3<f64>,
    /// Velocity (m/s).
    pub velocity: Vector3<f64>,
    /// Acceleration (m/s^2).
    pub acceleration: Vector3<f64>,
}

impl Motion {
    /// At rest at `position`.
    pub fn at(position: Vector3<f64>) -> Self {
        Self {
            position,
            ..Self::default()
        }
    }

    /// Moves on by a step at constant acceleration.
    pub fn extrapolate(&mut self) {
        self.position += self.velocity * STEP_S + self.acceleration * (0.5 * STEP_S * STEP_S);
        self.velocity += self.acceleration * STEP_S;
    }
}

/// Speeds and corrections allowed.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Horizontal speed of position corrections (m/s).
    pub speed_mps: f64,
    /// Climb (m/s).
    pub up_mps: f64,
    /// Descent (m/s).
    pub down_mps: f64,
    /// Horizontal shaping.
    pub horizontal: ShapeLimits,
    /// Vertical shaping.
    pub vertical: ShapeLimits,
}

impl Limits {
    /// Those of automatic flight.
    pub fn automatic(parameters: &Parameters) -> Self {
        Self {
            speed_mps: parameters.hundredth(P::WPNAV_SPEED),
            up_mps: parameters.hundredth(P::WPNAV_SPEED_UP),
            down_mps: parameters.hundredth(P::WPNAV_SPEED_DN),
            horizontal: ShapeLimits {
                acceleration_mps2: parameters.hundredth(P::WPNAV_ACCEL),
                jerk_mps3: parameters.get(P::PSC_JERK_XY),
            },
            vertical: ShapeLimits {
                acceleration_mps2: parameters.hundredth(P::WPNAV_ACCEL_Z),
                jerk_mps3: parameters.get(P::PSC_JERK_Z),
            },
        }
    }
}

/// The controller.
#[derive(Clone, Debug)]
pub struct PositionControl {
    /// What is allowed.
    pub limits: Limits,
    desired: Motion,
    position_error: Vector2<f64>,
    velocity_error: Vector2<f64>,
    derivative: Vector2<f64>,
    integral: Vector2<f64>,
    integral_down: f64,
    /// Horizontal acceleration handed to the attitude loop.
    acceleration: Vector2<f64>,
    /// Direction in which there is no more lean; zero where there is.
    exhausted: Vector2<f64>,
}

impl PositionControl {
    /// At rest where the estimate is.
    pub fn new(parameters: &Parameters, estimate: &Estimate) -> Self {
        Self {
            limits: Limits::automatic(parameters),
            desired: Motion::at(estimate.position.vector()),
            position_error: Vector2::zeros(),
            velocity_error: Vector2::zeros(),
            derivative: Vector2::zeros(),
            integral: Vector2::zeros(),
            integral_down: 0.0,
            acceleration: Vector2::zeros(),
            exhausted: Vector2::zeros(),
        }
    }

    /// Starts anew from where the vehicle is and how it moves; the lean it has becomes the integral.
    pub fn start(&mut self, estimate: &Estimate, limits: Limits) {
        self.limits = limits;
        self.desired = Motion {
            position: estimate.position.vector(),
            velocity: estimate.velocity.vector(),
            acceleration: Vector3::zeros(),
        };
        self.integral = self.acceleration;
        self.position_error = Vector2::zeros();
        self.velocity_error = Vector2::zeros();
        self.derivative = Vector2::zeros();
        self.exhausted = Vector2::zeros();
    }

    /// On the ground: nothing is remembered.
    pub fn relax(&mut self, estimate: &Estimate) {
        self.acceleration = Vector2::zeros();
        self.integral_down = 0.0;
        self.start(estimate, self.limits);
        self.desired.velocity = Vector3::zeros();
    }

    /// The reference jumps with the estimate, so that a reset of the estimator does not move the vehicle.
    pub fn follow_reset(&mut self, estimate: &Estimate) {
        let at = estimate.position.vector().xy() + self.position_error;
        (self.desired.position.x, self.desired.position.y) = (at.x, at.y);
    }

    /// The reference.
    pub fn desired(&self) -> &Motion {
        &self.desired
    }

    /// Sets the reference's horizontal part.
    pub fn set_horizontal(
        &mut self,
        position: Vector2<f64>,
        velocity: Vector2<f64>,
        acceleration: Vector2<f64>,
    ) {
        (self.desired.position.x, self.desired.position.y) = (position.x, position.y);
        (self.desired.velocity.x, self.desired.velocity.y) = (velocity.x, velocity.y);
        self.set_acceleration(acceleration);
    }

    fn set_acceleration(&mut self, acceleration: Vector2<f64>) {
        (self.desired.acceleration.x, self.desired.acceleration.y) = (acceleration.x, acceleration.y);
    }

    /// Bends the horizontal reference towards a moving target.
    pub fn follow(&mut self, target: &Motion) {
        self.advance_horizontal();
        let error = (target.position - self.desired.position).xy();
        let limits = &self.limits;
        let correcting = correcting_velocity(error, limits.speed_mps, &limits.horizontal, STEP_S);
        self.bend(correcting + target.velocity.xy(), target.acceleration.xy());
    }

    /// Bends the horizontal reference towards a velocity.
    pub fn follow_velocity(&mut self, velocity: Vector2<f64>, acceleration: Vector2<f64>) {
        self.advance_horizontal();
        self.bend(velocity, acceleration);
    }

    /// Bends the horizontal reference towards an acceleration.
    pub fn follow_acceleration(&mut self, acceleration: Vector2<f64>) {
        self.advance_horizontal();
        let now = self.desired.acceleration.xy();
        self.set_acceleration(shape_acceleration(
            acceleration,
            now,
            &self.limits.horizontal,
            STEP_S,
        ));
    }

    /// Flies straight to a place, horizontally and vertically in step.
    pub fn follow_place(&mut self, place: Vector3<f64>) {
        let limits = self.limits;
        self.advance_horizontal();
        let way = place - self.desired.position;
        let speed_mps = straight_speed_mps(way, &limits);
        let direction = way.try_normalize(1e-9).unwrap_or_else(Vector3::zeros);
        let level_mps = speed_mps * direction.xy().norm();
        let correcting = correcting_velocity(way.xy(), level_mps, &limits.horizontal, STEP_S);
        self.bend(correcting, Vector2::zeros());

        self.advance_vertical();
        let vertical_mps = speed_mps * direction.z.abs();
        let error = place.z - self.desired.position.z;
        let correcting = correcting_velocity_1d(error, -vertical_mps, vertical_mps, &limits.vertical, STEP_S);
        self.bend_vertical(correcting, 0.0);
    }

    /// Bends the vertical reference towards a moving target.
    pub fn follow_height(&mut self, target: &Motion) {
        self.advance_vertical();
        let error = target.position.z - self.desired.position.z;
        let limits = &self.limits;
        let correcting =
            correcting_velocity_1d(error, -limits.up_mps, limits.down_mps, &limits.vertical, STEP_S);
        self.bend_vertical(correcting + target.velocity.z, target.acceleration.z);
    }

    /// Bends the vertical reference towards a velocity (down, m/s).
    pub fn follow_sink(&mut self, velocity_mps: f64, acceleration_mps2: f64) {
        self.advance_vertical();
        self.bend_vertical(velocity_mps, acceleration_mps2);
    }

    /// Bends the vertical reference towards an acceleration (down, m/s^2).
    pub fn follow_sink_acceleration(&mut self, acceleration_mps2: f64) {
        self.advance_vertical();
        let step = self.limits.vertical.jerk_mps3 * STEP_S;
        let a = &mut self.desired.acceleration.z;
        *a += (acceleration_mps2 - *a).clamp(-step, step);
    }

    fn bend(&mut self, velocity: Vector2<f64>, fed_forward: Vector2<f64>) {
        let (v, a) = (self.desired.velocity.xy(), self.desired.acceleration.xy());
        let limits = &self.limits.horizontal;
        self.set_acceleration(shape_velocity(velocity, fed_forward, v, a, limits, STEP_S));
    }

    fn bend_vertical(&mut self, velocity: f64, fed_forward: f64) {
        let (v, a) = (self.desired.velocity.z, self.desired.acceleration.z);
        let limits = &self.limits.vertical;
        self.desired.acceleration.z = shape_velocity_1d(velocity, fed_forward, v, a, limits, STEP_S);
    }

    fn advance_horizontal(&mut self) {
        let desired = &mut self.desired;
        let (v, a) = (desired.velocity.xy(), desired.acceleration.xy());
        let mut way = v * STEP_S + a * (0.5 * STEP_S * STEP_S);
        let mut gain = a * STEP_S;
        let away = |step: &Vector2<f64>, error: &Vector2<f64>| {
            step.dot(&self.exhausted) > 0.0 && error.dot(&self.exhausted) > 0.0
        };
        if away(&way, &self.position_error) {
            way = Vector2::zeros();
        }
        if away(&gain, &self.velocity_error) {
            gain = Vector2::zeros();
        }
        desired.position.x += way.x;
        desired.position.y += way.y;
        desired.velocity.x += gain.x;
        desired.velocity.y += gain.y;
    }

    fn advance_vertical(&mut self) {
        let desired = &mut self.desired;
        let (v, a) = (desired.velocity.z, desired.acceleration.z);
        desired.position.z += v * STEP_S + a * (0.5 * STEP_S * STEP_S);
        desired.velocity.z += a * STEP_S;
    }

    /// The command that follows the reference with the heading `yaw_rad` turning at `yaw_rate_radps`.
    pub fn command(
        &mut self,
        estimate: &Estimate,
        yaw: (f64, f64),
        parameters: &Parameters,
    ) -> ActuatorCommand {
        let position = estimate.position.vector();
        let velocity = estimate.velocity.vector();
        let level = self.level_acceleration(position.xy(), velocity.xy(), parameters);
        let down = self.down_acceleration(position.z, velocity.z, parameters);
        // Lean as if the vertical part were weight alone, then enough thrust for what it is.
        let direction = Vector3::new(-level.x, -level.y, GRAVITY_MPS2).normalize();
        let vertical = HOVER_THRUST * (1.0 - down / GRAVITY_MPS2).max(0.0);
        let thrust = (vertical / direction.z).min(1.0);
        let (yaw_rad, yaw_rate_radps) = yaw;
        let error_rad = jink_shared_types::frames::wrap_pi(yaw_rad - estimate.attitude.yaw_rad());
        ActuatorCommand {
            attitude: attitude_for(&(-direction), yaw_rad),
            yaw_rate_radps: yaw_rate_radps + (YAW_GAIN - YAW_GAIN_OF_VEHICLE) * error_rad,
            thrust,
        }
    }

    fn level_acceleration(
        &mut self,
        position: Vector2<f64>,
        velocity: Vector2<f64>,
        parameters: &Parameters,
    ) -> Vector2<f64> {
        self.position_error = self.desired.position.xy() - position;
        let gain = parameters.get(P::PSC_POSXY_P);
        let limit = self.limits.horizontal.acceleration_mps2;
        let wanted =
            sqrt_controller_2d(self.position_error, gain, limit, STEP_S) + self.desired.velocity.xy();

        let share = filter_share();
        let before = self.velocity_error;
        self.velocity_error += (wanted - velocity - before) * share;
        self.derivative += ((self.velocity_error - before) / STEP_S - self.derivative) * share;
        self.integrate(parameters.get(P::PSC_VELXY_I));

        let feedback = self.velocity_error * parameters.get(P::PSC_VELXY_P)
            + self.integral
            + self.derivative * parameters.get(P::PSC_VELXY_D);
        let asked = feedback + self.desired.acceleration.xy();
        let lean_rad = parameters.hundredth(P::ANGLE_MAX).to_radians();
        let most = GRAVITY_MPS2 * lean_rad.tan();
        let (given, too_long) = limit_turning_first(self.desired.velocity.xy(), asked, most);
        self.exhausted = if too_long { asked } else { Vector2::zeros() };
        self.acceleration = given;
        given
    }

    /// Where there is no more lean, the integral may turn but not grow.
    fn integrate(&mut self, gain: f64) {
        let before = self.integral.norm();
        let change = self.velocity_error * (gain * STEP_S);
        let stuck = change.dot(&self.exhausted) > 0.0 && self.integral.dot(&self.exhausted) > 0.0;
        let most = if stuck { before } else { INTEGRAL_MAX_MPS2 };
        self.integral = limit_length(self.integral + change, most);
    }

    fn down_acceleration(&mut self, position: f64, velocity: f64, parameters: &Parameters) -> f64 {
        let limit = self.limits.vertical.acceleration_mps2;
        let gain = parameters.get(P::PSC_POSZ_P);
        let error = self.desired.position.z - position;
        let wanted = sqrt_controller(error, gain, limit, STEP_S) + self.desired.velocity.z;
        let error = wanted - velocity;
        self.integral_down = (self.integral_down + error * (VERTICAL_INTEGRAL * STEP_S)).clamp(-3.0, 3.0);
        error * parameters.get(P::PSC_VELZ_P) + self.integral_down + self.desired.acceleration.z
    }
}

/// Motors idling, level.
pub fn idle(estimate: &Estimate) -> ActuatorCommand {
    ActuatorCommand {
        attitude: attitude_for(&(-Vector3::z()), estimate.attitude.yaw_rad()),
        yaw_rate_radps: 0.0,
        thrust: IDLE_THRUST,
    }
}

/// The highest speed along `way` that no axis forbids (m/s).
pub fn straight_speed_mps(way: Vector3<f64>, limits: &Limits) -> f64 {
    let Some(direction) = way.try_normalize(1e-9) else {
        return 0.0;
    };
    let level = direction.xy().norm();
    let vertical_mps = if direction.z < 0.0 {
        limits.up_mps
    } else {
        limits.down_mps
    };
    let within = |limit: f64, part: f64| if part > 1e-9 { limit / part } else { f64::INFINITY };
    within(limits.speed_mps, level).min(within(vertical_mps, direction.z.abs()))
}

fn filter_share() -> f64 {
    let b = std::f64::consts::TAU * FILTER_HZ * STEP_S;
    b / (1.0 + b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slanted_way_is_as_fast_as_its_slowest_axis_allows() {
        let limits = Limits::automatic(&Parameters::default());
        assert!((straight_speed_mps(Vector3::new(3.0, 0.0, 0.0), &limits) - 10.0).abs() < 1e-9);
        assert!((straight_speed_mps(Vector3::new(0.0, 0.0, -3.0), &limits) - 2.5).abs() < 1e-9);
        let slanted = straight_speed_mps(Vector3::new(3.0, 0.0, 4.0), &limits);
        assert!((slanted * 0.8 - 1.5).abs() < 1e-9);
        assert_eq!(straight_speed_mps(Vector3::zeros(), &limits), 0.0);
    }
}
