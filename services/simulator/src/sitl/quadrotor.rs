//! A quadrotor as the motors see it: four commands go in, its true motion comes out.
//!
//! | in | out |
//! |---|---|
//! | four motor commands 0 to 1, wind | [`VehicleTruth`], specific force and body rates for the instruments |
//!
//! Theory: rigid body with four fixed rotors. The thrust of a rotor is `Tmax ((1 - e) c + e c^2)` of its command `c`, behind a
//! first-order lag; its drag torque is proportional to its thrust. The airframe's drag is linear and quadratic in the airspeed,
//! the rotors' share in the plane of the rotors (R. Mahony, V. Kumar, P. Corke, "Multirotor Aerial Vehicles", 2012, section
//! V). The ground holds the vehicle level and at rest until thrust exceeds weight. Semi-implicit Euler.

use jink_shared_types::frames::{AngularRate, Attitude};
use jink_shared_types::{Acceleration, Point, Velocity};
use jink_simulated_world::random::Random;
use jink_simulated_world::vehicle::wind::{Wind, WindConfig};
use jink_simulated_world::vehicle::{GRAVITY_MPS2, STEP_S, VehicleTruth};
use nalgebra::{UnitQuaternion, Vector3};

/// Longest step of the integration (s): a quarter of the truth's.
const SUBSTEP_S: f64 = STEP_S / 4.0;
/// Keeps the gusts apart from other random streams of the same seed.
const WIND_STREAM: u64 = 0x7769_6e64;

/// A rotor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rotor {
    /// Forward and right of the centre of gravity (m).
    pub place_m: [f64; 2],
    /// Torque about the body's z axis for each newton of thrust (N m/N): positive turns the nose to the right.
    pub torque_m: f64,
}

/// What the quadrotor is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct QuadrotorConfig {
    /// Mass (kg).
    pub mass_kg: f64,
    /// Principal moments of inertia, forward right down (kg m^2).
    pub inertia_kgm2: [f64; 3],
    /// The rotors, in the autopilot's order.
    pub rotors: [Rotor; 4],
    /// Thrust of one rotor at full command (N).
    pub thrust_max_n: f64,
    /// Share of the square in the thrust curve, 0 to 1.
    pub thrust_expo: f64,
    /// Lag of a rotor that spins up (s).
    pub rise_s: f64,
    /// Lag of a rotor that slows down (s).
    pub fall_s: f64,
    /// Linear drag, in the plane of the rotors and along their axis (N/(m/s)).
    pub drag_linear: [f64; 2],
    /// Quadratic drag (N/(m/s)^2).
    pub drag_quadratic: f64,
    /// Damping of rotations (N m/(rad/s)).
    pub damping: f64,
    /// Wind.
    pub wind: WindConfig,
    /// Seed of the gusts.
    pub seed: u64,
}

/// The rotors of the iris in PX4's airframe 10016: front right, rear left, front left, rear right; ArduCopter's frame X has
/// the same order and senses.
const PLACES_M: [[f64; 2]; 4] = [
    [0.1515, 0.245],
    [-0.1515, -0.1875],
    [0.1515, -0.245],
    [-0.1515, 0.1875],
];
const SENSES: [f64; 4] = [1.0, 1.0, -1.0, -1.0];

fn rotors(places_m: [[f64; 2]; 4], torque_m: f64) -> [Rotor; 4] {
    std::array::from_fn(|i| Rotor {
        place_m: places_m[i],
        torque_m: SENSES[i] * torque_m,
    })
}

impl QuadrotorConfig {
    /// The iris that PX4's airframe 10016 is tuned for: hovers at half thrust, thrust in proportion to the command.
    pub fn iris() -> Self {
        Self {
            mass_kg: 1.5,
            inertia_kgm2: [0.029, 0.029, 0.055],
            rotors: rotors(PLACES_M, 0.05),
            thrust_max_n: 1.5 * GRAVITY_MPS2 / 4.0 / 0.5,
            thrust_expo: 0.0,
            rise_s: 0.0125,
            fall_s: 0.025,
            drag_linear: [0.25, 0.10],
            drag_quadratic: 0.02,
            damping: 0.01,
            wind: WindConfig::default(),
            seed: 0,
        }
    }

    /// The same airframe with the motors that ArduCopter's default gains and parameters expect: MOT_THST_EXPO 0.65, hover at
    /// MOT_THST_HOVER 0.39, and the same angular acceleration for each unit of roll, pitch and yaw as ArduPilot's own model.
    pub fn copter() -> Self {
        const HOVER: f64 = 0.39;
        const EXPO: f64 = 0.65;
        // A symmetric X: ArduCopter's mixer knows no other.
        let arm_m = 0.18;
        let places = SENSES.map(|_| [arm_m; 2]);
        let signs = [[1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]];
        let places = std::array::from_fn(|i| [places[i][0] * signs[i][0], places[i][1] * signs[i][1]]);
        Self {
            rotors: rotors(places, 0.028),
            thrust_max_n: 1.5 * GRAVITY_MPS2 / 4.0 / ((1.0 - EXPO) * HOVER + EXPO * HOVER * HOVER),
            thrust_expo: EXPO,
            ..Self::iris()
        }
    }
}

/// The quadrotor.
#[derive(Clone, Debug)]
pub struct Quadrotor {
    config: QuadrotorConfig,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    rotation: UnitQuaternion<f64>,
    rates: Vector3<f64>,
    thrusts_n: [f64; 4],
    specific_force: Vector3<f64>,
    acceleration: Vector3<f64>,
    on_ground: bool,
    wind: Wind,
    wind_now: Vector3<f64>,
    until_wind_s: f64,
}

impl Quadrotor {
    /// Stands at the origin, nose to the north, motors off.
    pub fn new(config: &QuadrotorConfig) -> Self {
        Self {
            wind: Wind::new(&config.wind, Random::new(config.seed, WIND_STREAM)),
            wind_now: Vector3::zeros(),
            until_wind_s: 0.0,
            config: config.clone(),
            position: Vector3::zeros(),
            velocity: Vector3::zeros(),
            rotation: UnitQuaternion::identity(),
            rates: Vector3::zeros(),
            thrusts_n: [0.0; 4],
            specific_force: Vector3::new(0.0, 0.0, -GRAVITY_MPS2),
            acceleration: Vector3::zeros(),
            on_ground: true,
        }
    }

    /// Moves on by `span_s` with the motor commands (0 to 1; what is not finite counts as off).
    pub fn step(&mut self, span_s: f64, commands: &[f64; 4]) {
        let substeps = (span_s / SUBSTEP_S).ceil().max(1.0);
        let h_s = span_s / substeps;
        for _ in 0..substeps as u32 {
            self.blow(h_s);
            self.substep(h_s, commands);
        }
    }

    /// The motion now.
    pub fn truth(&self) -> VehicleTruth {
        VehicleTruth {
            position: Point::from_vector(self.position),
            velocity: Velocity::from_vector(self.velocity),
            acceleration: Acceleration::from_vector(self.acceleration),
            attitude: Attitude::from_rotation(self.rotation),
            rates: AngularRate::from_vector(self.rates),
            wind: Velocity::from_vector(self.wind_now),
            on_ground: self.on_ground,
        }
    }

    /// What an accelerometer feels, forward right down (m/s^2).
    pub fn specific_force(&self) -> Vector3<f64> {
        self.specific_force
    }

    /// The wind model has steps of its own length.
    fn blow(&mut self, h_s: f64) {
        self.until_wind_s -= h_s;
        if self.until_wind_s < 0.0 {
            self.until_wind_s += STEP_S;
            self.wind_now = self.wind.step();
        }
    }

    fn substep(&mut self, h_s: f64, commands: &[f64; 4]) {
        let (lift_n, torque) = self.spin(h_s, commands);
        let force = Vector3::new(0.0, 0.0, -lift_n) + self.drag();
        self.specific_force = force / self.config.mass_kg;
        let free = self.rotation * self.specific_force + Vector3::new(0.0, 0.0, GRAVITY_MPS2);
        let touching = self.position.z >= 0.0 && self.velocity.z >= 0.0;
        self.on_ground = touching && free.z >= 0.0;
        if self.on_ground {
            self.stand();
            return;
        }
        self.acceleration = free;
        self.velocity += free * h_s;
        self.position += self.velocity * h_s;
        self.position.z = self.position.z.min(0.0);
        let inertia = Vector3::from(self.config.inertia_kgm2);
        let spin = self.rates.cross(&inertia.component_mul(&self.rates));
        let turning = torque - spin - self.rates * self.config.damping;
        self.rates += turning.component_div(&inertia) * h_s;
        self.rotation *= UnitQuaternion::from_scaled_axis(self.rates * h_s);
        self.rotation.renormalize_fast();
    }

    /// Lets the rotors follow their commands; answers lift (N) and torque (N m, forward right down).
    fn spin(&mut self, h_s: f64, commands: &[f64; 4]) -> (f64, Vector3<f64>) {
        let config = &self.config;
        let (mut lift_n, mut torque) = (0.0, Vector3::zeros());
        for ((thrust_n, command), rotor) in self.thrusts_n.iter_mut().zip(commands).zip(&config.rotors) {
            let command = if command.is_finite() {
                command.clamp(0.0, 1.0)
            } else {
                0.0
            };
            let share = (1.0 - config.thrust_expo) * command + config.thrust_expo * command * command;
            let wanted_n = share * config.thrust_max_n;
            let lag_s = if wanted_n > *thrust_n {
                config.rise_s
            } else {
                config.fall_s
            };
            *thrust_n += (wanted_n - *thrust_n) * (1.0 - (-h_s / lag_s).exp());
            let [forward_m, right_m] = rotor.place_m;
            lift_n += *thrust_n;
            torque += Vector3::new(-right_m, forward_m, rotor.torque_m) * *thrust_n;
        }
        (lift_n, torque)
    }

    /// Drag in the body frame (N).
    fn drag(&self) -> Vector3<f64> {
        let airspeed = self.rotation.inverse() * (self.velocity - self.wind_now);
        let [plane, axis] = self.config.drag_linear;
        let quadratic = self.config.drag_quadratic * airspeed.norm();
        -airspeed.component_mul(&Vector3::new(
            plane + quadratic,
            plane + quadratic,
            axis + quadratic,
        ))
    }

    /// What the ground does: level, at rest, weight carried.
    fn stand(&mut self) {
        let (_, _, yaw_rad) = self.rotation.euler_angles();
        self.rotation = UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad);
        self.velocity = Vector3::zeros();
        self.rates = Vector3::zeros();
        self.acceleration = Vector3::zeros();
        self.specific_force = Vector3::new(0.0, 0.0, -GRAVITY_MPS2);
    }
}

#[cfg(test)]
mod tests {
    use super::{Quadrotor, QuadrotorConfig};
    use jink_simulated_world::vehicle::wind::WindConfig;
    use jink_simulated_world::vehicle::{GRAVITY_MPS2, STEP_S};
    use nalgebra::Vector3;
    use proptest::prelude::*;

    /// The command at which it hovers.
    fn hover(config: &QuadrotorConfig) -> f64 {
        let share = config.mass_kg * GRAVITY_MPS2 / 4.0 / config.thrust_max_n;
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            let at = (1.0 - config.thrust_expo) * middle + config.thrust_expo * middle * middle;
            if at < share { low = middle } else { high = middle }
        }
        low
    }

    fn risen(config: &QuadrotorConfig) -> Quadrotor {
        let mut quadrotor = Quadrotor::new(config);
        let command = hover(config) + 0.1;
        for _ in 0..250 {
            quadrotor.step(STEP_S, &[command; 4]);
        }
        quadrotor
    }

    #[test]
    fn it_hovers_where_the_autopilots_defaults_say() {
        assert!((hover(&QuadrotorConfig::iris()) - 0.5).abs() < 1e-9);
        assert!((hover(&QuadrotorConfig::copter()) - 0.39).abs() < 1e-9);
    }

    #[test]
    fn it_stands_until_thrust_exceeds_weight() {
        for config in [QuadrotorConfig::iris(), QuadrotorConfig::copter()] {
            let mut quadrotor = Quadrotor::new(&config);
            for _ in 0..500 {
                quadrotor.step(STEP_S, &[hover(&config) - 0.02; 4]);
            }
            assert!(quadrotor.truth().on_ground);
            assert_eq!(quadrotor.specific_force(), Vector3::new(0.0, 0.0, -GRAVITY_MPS2));
            assert!(!risen(&config).truth().on_ground);
        }
    }

    #[test]
    fn more_thrust_on_one_side_turns_it_to_the_other() {
        let config = QuadrotorConfig::copter();
        // Front right, rear left, front left, rear right.
        for (extra, axis) in [
            ([0.0, 0.02, 0.02, 0.0], Vector3::x()),
            ([0.02, 0.0, 0.02, 0.0], Vector3::y()),
            ([0.02, 0.02, 0.0, 0.0], Vector3::z()),
        ] {
            let mut quadrotor = risen(&config);
            let commands = std::array::from_fn(|i| hover(&config) + extra[i]);
            for _ in 0..10 {
                quadrotor.step(STEP_S, &commands);
            }
            let rates = quadrotor.truth().rates.vector();
            assert!(
                rates.dot(&axis) > 0.9 * rates.norm() && rates.norm() > 0.003,
                "{rates}"
            );
        }
    }

    #[test]
    fn a_fall_ends_on_the_ground_at_rest() {
        let mut quadrotor = risen(&QuadrotorConfig::iris());
        for _ in 0..2_500 {
            quadrotor.step(STEP_S, &[0.0; 4]);
        }
        let truth = quadrotor.truth();
        assert!(truth.on_ground && truth.velocity.vector() == Vector3::zeros());
        assert_eq!(truth.position.z_m, 0.0);
    }

    #[test]
    fn the_air_carries_it_along() {
        let mut config = QuadrotorConfig::iris();
        config.wind = WindConfig {
            mean_mps: [3.0, -1.0, 0.0],
            ..WindConfig::default()
        };
        let mut quadrotor = risen(&config);
        for _ in 0..15_000 {
            quadrotor.step(STEP_S, &[0.5; 4]);
        }
        let velocity = quadrotor.truth().velocity;
        assert!((velocity.x_mps - 3.0).abs() < 0.01 && (velocity.y_mps + 1.0).abs() < 0.01);
    }

    proptest! {
        #[test]
        fn the_motion_does_not_depend_on_how_the_time_is_cut(
            commands in prop::array::uniform4(0.45..0.6f64),
        ) {
            let config = QuadrotorConfig::iris();
            let (mut coarse, mut fine) = (risen(&config), risen(&config));
            for _ in 0..25 {
                coarse.step(STEP_S, &commands);
                for _ in 0..4 {
                    fine.step(STEP_S / 4.0, &commands);
                }
            }
            let apart = coarse.truth().position.vector() - fine.truth().position.vector();
            prop_assert!(apart.norm() < 1e-9, "{}", apart);
        }

        #[test]
        fn no_command_makes_anything_that_is_not_finite(commands in prop::array::uniform4(prop::num::f64::ANY)) {
            let mut quadrotor = Quadrotor::new(&QuadrotorConfig::copter());
            for _ in 0..250 {
                quadrotor.step(STEP_S, &commands);
            }
            let truth = quadrotor.truth();
            prop_assert!(truth.position.vector().iter().all(|x| x.is_finite()));
            prop_assert!(quadrotor.specific_force().iter().all(|x| x.is_finite()));
        }
    }
}
