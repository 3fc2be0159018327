//! A rigid multicopter: attitude and thrust setpoints go in, its true motion comes out.
//!
//! | in | out |
//! |---|---|
//! | [`ActuatorCommand`] every 4 ms | [`VehicleTruth`] |
//! | [`WindConfig`] | gusts of the [`wind`] model |
//! | truth | what the [`estimator`] makes of it |
//!
//! Theory: point mass with gravity, thrust along the body's z axis, and drag against the air,
//! `a = g + R (0, 0, -T/m) - (c1 + c2 |v - w|) (v - w) / m`; attitude follows its setpoint through the loop of [`attitude`]; thrust follows
//! its setpoint with a first-order lag. Semi-implicit Euler at [`STEP_S`]: at 250 Hz its error over a flight lies far
//! below that of the model.

mod airframe;
pub mod attitude;
pub mod estimator;
pub mod wind;

pub use airframe::{ActuatorCommand, GRAVITY_MPS2, HOVER_THRUST, Response, STEP_S, STEP_US};

use crate::random::Random;
use attitude::AttitudeLoop;
use jink_shared_types::frames::{AngularRate, Attitude, wrap_pi};
use jink_shared_types::{Acceleration, BodyFrd, LocalNed, Point, Velocity};
use nalgebra::Vector3;
use wind::{Wind, WindConfig};

/// Keeps the gusts apart from other random streams of the same seed.
const WIND_STREAM: u64 = 0x7769_6e64;

/// What a vehicle is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct VehicleConfig {
    /// Where it stands at the start (its centre; the ground is there).
    pub start: Point<LocalNed>,
    /// Heading at the start (rad).
    pub heading_rad: f64,
    /// Mass (kg).
    pub mass_kg: f64,
    /// Drag proportional to the airspeed (N/(m/s)).
    pub drag_linear: f64,
    /// Drag proportional to the airspeed's square (N/(m/s)^2).
    pub drag_quadratic: f64,
    /// How quickly it follows what the autopilot asks.
    pub response: Response,
    /// Wind.
    pub wind: WindConfig,
    /// Seed of the gusts.
    pub seed: u64,
}

impl Default for VehicleConfig {
    /// An iris-like quadrotor of 1.5 kg at the local origin, heading north, in still air. The drag is the one with which
    /// the tracking and stopping errors measured on PX4 come out (test `px4_tracking`): without it the vehicle lags
    /// too little and overshoots too little, and a purely linear one cannot fit 2, 4.5 and 8 m/s together.
    fn default() -> Self {
        Self {
            start: Point::ZERO,
            heading_rad: 0.0,
            mass_kg: 1.5,
            drag_linear: 0.06,
            drag_quadratic: 0.04,
            response: Response::default(),
            wind: WindConfig::default(),
            seed: 0,
        }
    }
}

impl VehicleConfig {
    /// The quadrotor of PX4's built-in simulator: 1 kg, drag in proportion to airspeed. `drag_linear` is its SIH_KDV
    /// (N/(m/s)): 1 by default, which is huge, 0.1 for a light realistic one.
    ///
    /// Its motors follow within 0.05 s (SIH_T_TAU), its tilt more slowly than the gain alone says (1/6.5 s): with 0.27 s the
    /// errors measured on it come out for both drags (test `px4_current_tracking`), with the gain's own the errors across are a
    /// third to a half too small.
    pub fn built_in(drag_linear: f64) -> Self {
        Self {
            mass_kg: 1.0,
            drag_linear,
            drag_quadratic: 0.0,
            response: Response {
                thrust_rise_s: 0.05,
                thrust_fall_s: 0.05,
                tilt_s: 0.27,
                rates_s: 0.04,
            },
            ..Self::default()
        }
    }
}

/// Where the vehicle really is and how it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleTruth {
    /// Position.
    pub position: Point<LocalNed>,
    /// Velocity.
    pub velocity: Velocity<LocalNed>,
    /// Coordinate acceleration (zero at rest).
    pub acceleration: Acceleration<LocalNed>,
    /// `local_q_body`.
    pub attitude: Attitude,
    /// Body rates.
    pub rates: AngularRate<BodyFrd>,
    /// Wind at the vehicle.
    pub wind: Velocity<LocalNed>,
    /// It stands on the ground.
    pub on_ground: bool,
}

/// The vehicle.
#[derive(Clone, Debug)]
pub struct Vehicle {
    mass_kg: f64,
    drag_linear: f64,
    drag_quadratic: f64,
    response: Response,
    ground_down_m: f64,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    thrust: f64,
    attitude: AttitudeLoop,
    wind: Wind,
    truth: VehicleTruth,
}

impl Vehicle {
    /// A vehicle at rest on the ground.
    pub fn new(config: &VehicleConfig) -> Self {
        let attitude = AttitudeLoop::new(wrap_pi(config.heading_rad), &config.response);
        Self {
            mass_kg: config.mass_kg,
            drag_linear: config.drag_linear,
            drag_quadratic: config.drag_quadratic,
            response: config.response,
            ground_down_m: config.start.z_m,
            position: config.start.vector(),
            velocity: Vector3::zeros(),
            thrust: 0.0,
            wind: Wind::new(&config.wind, Random::new(config.seed, WIND_STREAM)),
            truth: VehicleTruth {
                position: config.start,
                velocity: Velocity::ZERO,
                acceleration: Acceleration::ZERO,
                attitude: Attitude::from_rotation(attitude.rotation()),
                rates: AngularRate::ZERO,
                wind: Velocity::ZERO,
                on_ground: true,
            },
            attitude,
        }
    }

    /// The motion now.
    pub fn truth(&self) -> &VehicleTruth {
        &self.truth
    }

    /// Moves on by [`STEP_S`]; `None` = motors off.
    pub fn step(&mut self, command: Option<&ActuatorCommand>) {
        let wanted = command.map_or(0.0, |c| c.thrust.clamp(0.0, 1.0));
        let lag_s = if wanted > self.thrust {
            self.response.thrust_rise_s
        } else {
            self.response.thrust_fall_s
        };
        self.thrust += (wanted - self.thrust) * (1.0 - (-STEP_S / lag_s).exp());
        let wind = self.wind.step();

        if let (Some(command), false) = (command, self.truth.on_ground) {
            self.attitude.step(command);
        }
        let lift_mps2 = self.thrust / HOVER_THRUST * GRAVITY_MPS2;
        let airspeed = self.velocity - wind;
        let drag = airspeed * ((self.drag_linear + self.drag_quadratic * airspeed.norm()) / self.mass_kg);
        let free = Vector3::new(0.0, 0.0, GRAVITY_MPS2)
            + self.attitude.rotation() * Vector3::new(0.0, 0.0, -lift_mps2)
            - drag;
        let acceleration = self.touch_ground(free);
        self.velocity += acceleration * STEP_S;
        self.position += self.velocity * STEP_S;
        self.position.z = self.position.z.min(self.ground_down_m);
        self.publish(acceleration, wind);
    }

    /// The acceleration with the ground's reaction: on the ground nothing moves until thrust exceeds weight.
    fn touch_ground(&mut self, free: Vector3<f64>) -> Vector3<f64> {
        let touching = self.position.z >= self.ground_down_m && self.velocity.z >= 0.0;
        if touching && free.z >= 0.0 {
            self.velocity = Vector3::zeros();
            self.attitude.level();
            self.truth.on_ground = true;
            return Vector3::zeros();
        }
        self.truth.on_ground = false;
        free
    }

    fn publish(&mut self, acceleration: Vector3<f64>, wind: Vector3<f64>) {
        self.truth.position = Point::from_vector(self.position);
        self.truth.velocity = Velocity::from_vector(self.velocity);
        self.truth.acceleration = Acceleration::from_vector(acceleration);
        self.truth.attitude = Attitude::from_rotation(self.attitude.rotation());
        self.truth.rates = AngularRate::from_vector(self.attitude.rates());
        self.truth.wind = Velocity::from_vector(wind);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;

    fn command(tilt_rad: f64, thrust: f64) -> ActuatorCommand {
        ActuatorCommand {
            attitude: UnitQuaternion::from_euler_angles(0.0, -tilt_rad, 0.0),
            yaw_rate_radps: 0.0,
            thrust,
        }
    }

    #[test]
    fn it_stands_until_thrust_exceeds_weight() {
        let mut vehicle = Vehicle::new(&VehicleConfig::default());
        for _ in 0..500 {
            vehicle.step(Some(&command(0.2, 0.49)));
        }
        assert!(vehicle.truth().on_ground);
        assert_eq!(vehicle.truth().position, Point::ZERO);
        for _ in 0..250 {
            vehicle.step(Some(&command(0.0, 0.6)));
        }
        assert!(!vehicle.truth().on_ground);
        // A fifth more than weight for a second, less the motors' lag and drag.
        assert!((vehicle.truth().velocity.z_mps + 0.2 * GRAVITY_MPS2).abs() < 0.15);
    }

    #[test]
    fn a_fall_ends_on_the_ground_at_rest() {
        let mut vehicle = Vehicle::new(&VehicleConfig::default());
        for _ in 0..500 {
            vehicle.step(Some(&command(0.0, 0.7)));
        }
        for _ in 0..5_000 {
            vehicle.step(None);
        }
        let truth = vehicle.truth();
        assert!(truth.on_ground);
        assert_eq!(truth.position.z_m, 0.0);
        assert_eq!(truth.velocity, Velocity::ZERO);
    }

    #[test]
    fn the_air_carries_a_hovering_vehicle_along() {
        let config = VehicleConfig {
            wind: WindConfig {
                mean_mps: [3.0, -1.0, 0.0],
                ..WindConfig::default()
            },
            ..VehicleConfig::default()
        };
        let mut vehicle = Vehicle::new(&config);
        for _ in 0..100 {
            vehicle.step(Some(&command(0.0, 0.7)));
        }
        for _ in 0..60_000 {
            vehicle.step(Some(&command(0.0, HOVER_THRUST)));
        }
        assert!((vehicle.truth().velocity.x_mps - 3.0).abs() < 0.01);
        assert!((vehicle.truth().velocity.y_mps + 1.0).abs() < 0.01);
    }
}
