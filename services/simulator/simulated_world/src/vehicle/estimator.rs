//! What the autopilot believes about its motion: the truth with noise, delay and jumps, all configurable.
//!
//! The default is nearly ideal, as the simulator was on which the reference figures were measured. A jump emulates a
//! position reset of an EKF: from one step to the next the estimate is elsewhere, and a counter says so.

use super::{STEP_S, VehicleTruth};
use crate::random::Random;
use jink_shared_types::frames::{AngularRate, Attitude};
use jink_shared_types::{BodyFrd, LocalNed, Point, Velocity};
use nalgebra::Vector3;

/// Keeps the noise apart from other random streams of the same seed.
const NOISE_STREAM: u64 = 0x65_6b66;
const DRIFT_STREAM: u64 = 0x64_7266;

/// Longest delay that can be configured (s).
pub const LATENCY_MAX_S: f64 = 0.2;

/// How well the estimator works.
#[derive(Clone, Debug, PartialEq)]
pub struct EstimatorConfig {
    /// White noise of each position axis, standard deviation (m).
    pub position_sigma_m: f64,
    /// White noise of each velocity axis, standard deviation (m/s).
    pub velocity_sigma_mps: f64,
    /// Delay of position and velocity (s), at most [`LATENCY_MAX_S`].
    pub latency_s: f64,
    /// How far the estimated position drifts per way flown (1), level, in a direction that the seed draws.
    pub drift_ratio: f64,
    /// A drift of this length (m) is taken back at once, as when a place is recognised: a reset; infinity for never.
    pub corrected_at_m: f64,
    /// Seed of the noise.
    pub seed: u64,
}

impl Default for EstimatorConfig {
    fn default() -> Self {
        Self {
            position_sigma_m: 0.002,
            velocity_sigma_mps: 0.005,
            latency_s: 0.0,
            drift_ratio: 0.0,
            corrected_at_m: f64::INFINITY,
            seed: 0,
        }
    }
}

/// The estimate of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Position.
    pub position: Point<LocalNed>,
    /// Velocity.
    pub velocity: Velocity<LocalNed>,
    /// `local_q_body`.
    pub attitude: Attitude,
    /// Body rates.
    pub rates: AngularRate<BodyFrd>,
    /// Position resets so far.
    pub resets: u32,
}

/// The estimator.
#[derive(Clone, Debug)]
pub struct Estimator {
    config: EstimatorConfig,
    random: Random,
    history: Vec<(Vector3<f64>, Vector3<f64>)>,
    newest: usize,
    offset: Vector3<f64>,
    drift: Vector3<f64>,
    /// Direction of the drift (unit, level).
    adrift: Vector3<f64>,
    resets: u32,
}

impl Estimator {
    /// Knows the vehicle at rest at `truth` for as long as its delay.
    pub fn new(config: &EstimatorConfig, truth: &VehicleTruth) -> Self {
        let steps = (config.latency_s.clamp(0.0, LATENCY_MAX_S) / STEP_S).round() as usize;
        let (sin, cos) = Random::new(config.seed, DRIFT_STREAM)
            .between(0.0, std::f64::consts::TAU)
            .sin_cos();
        Self {
            random: Random::new(config.seed, NOISE_STREAM),
            drift: Vector3::zeros(),
            adrift: Vector3::new(cos, sin, 0.0),
            history: vec![(truth.position.vector(), truth.velocity.vector()); steps + 1],
            newest: 0,
            offset: Vector3::zeros(),
            resets: 0,
            config: config.clone(),
        }
    }

    /// Moves the estimated position by `by` (m, local NED) and counts a reset.
    pub fn jump(&mut self, by: Vector3<f64>) {
        self.offset += by;
        self.resets += 1;
    }

    /// The estimate after one more step.
    pub fn step(&mut self, truth: &VehicleTruth) -> Estimate {
        let before = self.history[self.newest].0;
        self.drift += self.adrift * (self.config.drift_ratio * (truth.position.vector() - before).norm());
        if self.drift.norm() > self.config.corrected_at_m {
            self.drift = Vector3::zeros();
            self.resets += 1;
        }
        self.newest = (self.newest + 1) % self.history.len();
        self.history[self.newest] = (truth.position.vector(), truth.velocity.vector());
        let (position, velocity) = self.history[(self.newest + 1) % self.history.len()];
        let random = &mut self.random;
        let position_noise = Vector3::from_fn(|_, _| random.normal()) * self.config.position_sigma_m;
        let velocity_noise = Vector3::from_fn(|_, _| random.normal()) * self.config.velocity_sigma_mps;
        Estimate {
            position: Point::from_vector(position + self.offset + self.drift + position_noise),
            velocity: Velocity::from_vector(velocity + velocity_noise),
            attitude: truth.attitude,
            rates: truth.rates,
            resets: self.resets,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicle::{Vehicle, VehicleConfig};

    fn truth_at(north_m: f64) -> VehicleTruth {
        let mut truth = *Vehicle::new(&VehicleConfig::default()).truth();
        truth.position.x_m = north_m;
        truth
    }

    #[test]
    fn a_delayed_estimate_is_the_truth_of_that_time_ago() {
        let config = EstimatorConfig {
            position_sigma_m: 0.0,
            velocity_sigma_mps: 0.0,
            latency_s: 0.02,
            ..EstimatorConfig::default()
        };
        let mut estimator = Estimator::new(&config, &truth_at(0.0));
        for step in 1..100 {
            let estimate = estimator.step(&truth_at(f64::from(step)));
            assert_eq!(estimate.position.x_m, f64::from((step - 5).max(0)));
        }
    }

    #[test]
    fn a_jump_moves_the_estimate_once_and_is_counted() {
        let config = EstimatorConfig {
            position_sigma_m: 0.0,
            ..EstimatorConfig::default()
        };
        let mut estimator = Estimator::new(&config, &truth_at(0.0));
        estimator.jump(Vector3::new(0.0, 2.0, 0.0));
        let first = estimator.step(&truth_at(1.0));
        let second = estimator.step(&truth_at(1.0));
        assert_eq!((first.position.y_m, first.resets), (2.0, 1));
        assert_eq!((second.position.y_m, second.resets), (2.0, 1));
    }

    #[test]
    fn a_drift_grows_with_the_way_and_is_taken_back_at_once() {
        let config = EstimatorConfig {
            position_sigma_m: 0.0,
            drift_ratio: 0.01,
            corrected_at_m: 0.305,
            ..EstimatorConfig::default()
        };
        let mut estimator = Estimator::new(&config, &truth_at(0.0));
        for step in 1..=100 {
            let way_m = f64::from(step);
            let estimate = estimator.step(&truth_at(way_m));
            let off_m = (estimate.position.vector() - Vector3::new(way_m, 0.0, 0.0)).norm();
            let since_m = way_m - 31.0 * f64::from(estimate.resets);
            assert!((off_m - 0.01 * since_m).abs() < 1e-9, "{off_m} after {way_m} m");
            assert_eq!(estimate.resets, step / 31);
        }
    }
}
