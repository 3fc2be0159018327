//! Wind: a constant part and first-order Gauss-Markov gusts.
//!
//! Each axis of the gust is `x[k+1] = e^(-dt/T) x[k] + s sqrt(1 - e^(-2 dt/T)) n[k]` with white normal `n`: standard
//! deviation `s` and correlation time `T` hold exactly at every step length.

use super::airframe::STEP_S;
use crate::random::Random;
use nalgebra::Vector3;

/// The wind's statistics.
#[derive(Clone, Debug, PartialEq)]
pub struct WindConfig {
    /// Mean wind, local NED, where the air moves to (m/s).
    pub mean_mps: [f64; 3],
    /// Standard deviation of the gusts per axis (m/s).
    pub gust_sigma_mps: f64,
    /// Correlation time of the gusts (s).
    pub gust_time_s: f64,
}

impl Default for WindConfig {
    /// Still air.
    fn default() -> Self {
        Self {
            mean_mps: [0.0; 3],
            gust_sigma_mps: 0.0,
            gust_time_s: 3.0,
        }
    }
}

/// The wind at the vehicle.
#[derive(Clone, Debug)]
pub struct Wind {
    mean: Vector3<f64>,
    gust: Vector3<f64>,
    keep: f64,
    kick_mps: f64,
    random: Random,
}

impl Wind {
    /// Starts without a gust.
    pub fn new(config: &WindConfig, random: Random) -> Self {
        let keep = (-STEP_S / config.gust_time_s).exp();
        Self {
            mean: Vector3::from(config.mean_mps),
            gust: Vector3::zeros(),
            keep,
            kick_mps: config.gust_sigma_mps * (1.0 - keep * keep).sqrt(),
            random,
        }
    }

    /// The wind of the next step, local NED (m/s).
    pub fn step(&mut self) -> Vector3<f64> {
        if self.kick_mps > 0.0 {
            let random = &mut self.random;
            let noise = Vector3::from_fn(|_, _| random.normal());
            self.gust = self.gust * self.keep + noise * self.kick_mps;
        }
        self.mean + self.gust
    }
}

#[cfg(test)]
mod tests {
    use super::{Wind, WindConfig};
    use crate::random::Random;

    #[test]
    fn gusts_have_the_asked_strength_and_correlation() {
        let config = WindConfig {
            mean_mps: [2.0, 0.0, 0.0],
            gust_sigma_mps: 1.5,
            gust_time_s: 2.0,
        };
        let mut wind = Wind::new(&config, Random::new(5, 1));
        let samples: Vec<f64> = (0..1_000_000).map(|_| wind.step().x - 2.0).collect();
        let variance = samples.iter().map(|x| x * x).sum::<f64>() / samples.len() as f64;
        assert!((variance.sqrt() - 1.5).abs() < 0.15, "{}", variance.sqrt());
        // After one correlation time (500 steps of 4 ms) 1/e of the covariance is left.
        let lagged = samples.windows(501).map(|w| w[0] * w[500]).sum::<f64>() / samples.len() as f64;
        assert!(
            (lagged / variance - (-1f64).exp()).abs() < 0.08,
            "{}",
            lagged / variance
        );
    }
}
