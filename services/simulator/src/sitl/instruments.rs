//! Accelerometer, gyroscope, magnetometer, barometer and GPS of the simulated vehicle, with the errors an estimator has to live
//! with.
//!
//! | in | out |
//! |---|---|
//! | truth and specific force every 4 ms | [`Reading`] |
//!
//! White noise on every sample; the position of the GPS drifts as a first-order Gauss-Markov process and is late by a fixed time.
//! The magnetic field is that of the home position (World Magnetic Model 2020: declination 2.9 deg, inclination 63.3 deg, 0.482
//! gauss), without the vehicle's own. Air pressure is that of the standard atmosphere (ICAO, troposphere).

use super::launch::{HOME_HEIGHT_M, HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG};
use jink_shared_types::geo::{GlobalPoint, Projection};
use jink_simulated_world::random::Random;
use jink_simulated_world::vehicle::{STEP_S, VehicleTruth};
use nalgebra::{Vector2, Vector3};
use std::collections::VecDeque;

/// Standard deviations of single samples: small enough that PX4 and ArduCopter arm with the checks they have by default.
pub(super) const ACCELEROMETER_SIGMA_MPS2: f64 = 0.03;
pub(super) const GYROSCOPE_SIGMA_RADPS: f64 = 0.002;
const MAGNETOMETER_SIGMA_GAUSS: f64 = 0.002;
const BAROMETER_SIGMA_M: f64 = 0.08;
/// GPS velocity, horizontal and vertical (m/s).
const GPS_VELOCITY_SIGMA_MPS: [f64; 2] = [0.02, 0.03];
/// GPS position: standard deviation of its drift, horizontal and vertical (m), and its correlation time (s). It is small, since
/// estimator, map and goals all move with it, while the judge goes by the truth.
const GPS_DRIFT_SIGMA_M: [f64; 2] = [0.10, 0.15];
const GPS_DRIFT_S: f64 = 60.0;
/// Steps between two samples of magnetometer (62.5 Hz), barometer (50 Hz) and GPS (10 Hz).
const MAGNETOMETER_STEPS: u64 = 4;
const BAROMETER_STEPS: u64 = 5;
const GPS_STEPS: u64 = 25;
/// The field at home: declination and inclination (rad), strength (gauss).
const DECLINATION_RAD: f64 = 2.9 * std::f64::consts::PI / 180.0;
const INCLINATION_RAD: f64 = 63.3 * std::f64::consts::PI / 180.0;
const FIELD_GAUSS: f64 = 0.482;
/// Standard atmosphere: pressure at sea level (hPa), share lost per metre, exponent, temperature (deg C) and its gradient.
const SEA_LEVEL_HPA: f64 = 1_013.25;
const LAPSE_PER_M: f64 = 2.255_77e-5;
const PRESSURE_EXPONENT: f64 = 5.255_88;
const SEA_LEVEL_DEGC: f64 = 15.0;
const LAPSE_DEGC_PER_M: f64 = 0.0065;
/// Keeps the noise apart from other random streams of the same seed.
const NOISE_STREAM: u64 = 0x696e_7374;

/// What the instruments say after one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Specific force, forward right down (m/s^2).
    pub accelerometer: Vector3<f64>,
    /// Body rates, forward right down (rad/s).
    pub gyroscope: Vector3<f64>,
    /// Magnetic field, forward right down (gauss).
    pub magnetometer: Option<Vector3<f64>>,
    /// Barometer.
    pub barometer: Option<Pressure>,
    /// GPS.
    pub gps: Option<Fix>,
}

/// A sample of the barometer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pressure {
    /// Static pressure (hPa).
    pub pressure_hpa: f64,
    /// Height above the sea that belongs to it (m).
    pub height_m: f64,
    /// Temperature (deg C).
    pub temperature_degc: f64,
}

/// A sample of the GPS.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    /// Place.
    pub place: GlobalPoint,
    /// Height above the sea (m).
    pub height_m: f64,
    /// Velocity, local NED (m/s).
    pub velocity: Vector3<f64>,
}

/// The instruments.
#[derive(Clone, Debug)]
pub struct Instruments {
    random: Random,
    steps: u64,
    drift_m: Vector3<f64>,
    /// Position and velocity, oldest first: what the GPS still has to say.
    late: VecDeque<(Vector3<f64>, Vector3<f64>)>,
    late_steps: usize,
    home: Projection,
}

impl Instruments {
    /// With the noise of `seed` and a GPS that is `gps_delay_s` late.
    pub fn new(seed: u64, gps_delay_s: f64) -> Self {
        Self {
            random: Random::new(seed, NOISE_STREAM),
            steps: 0,
            drift_m: Vector3::zeros(),
            late: VecDeque::new(),
            late_steps: (gps_delay_s / STEP_S).round() as usize,
            home: Projection::new(GlobalPoint {
                latitude_deg: HOME_LATITUDE_DEG,
                longitude_deg: HOME_LONGITUDE_DEG,
            }),
        }
    }

    /// What they say after one more step, which ended in `truth`.
    pub fn step(&mut self, truth: &VehicleTruth, specific_force: Vector3<f64>) -> Reading {
        self.steps += 1;
        let gps = self.locate(truth);
        Reading {
            accelerometer: specific_force + self.noise([ACCELEROMETER_SIGMA_MPS2; 2]),
            gyroscope: truth.rates.vector() + self.noise([GYROSCOPE_SIGMA_RADPS; 2]),
            magnetometer: truth
                .attitude
                .rotation()
                .filter(|_| self.is_due(MAGNETOMETER_STEPS))
                .map(|local_q_body| {
                    local_q_body.inverse() * field() + self.noise([MAGNETOMETER_SIGMA_GAUSS; 2])
                }),
            barometer: self.is_due(BAROMETER_STEPS).then(|| {
                pressure(HOME_HEIGHT_M - truth.position.z_m + self.random.normal() * BAROMETER_SIGMA_M)
            }),
            gps,
        }
    }

    fn is_due(&self, every: u64) -> bool {
        self.steps.is_multiple_of(every)
    }

    /// White noise with the standard deviations horizontal and vertical.
    fn noise(&mut self, [plane, axis]: [f64; 2]) -> Vector3<f64> {
        let random = &mut self.random;
        Vector3::from_fn(|_, _| random.normal()).component_mul(&Vector3::new(plane, plane, axis))
    }

    fn locate(&mut self, truth: &VehicleTruth) -> Option<Fix> {
        self.late
            .push_back((truth.position.vector(), truth.velocity.vector()));
        while self.late.len() > self.late_steps + 1 {
            self.late.pop_front();
        }
        if !self.is_due(GPS_STEPS) {
            return None;
        }
        let keep = (-(GPS_STEPS as f64) * STEP_S / GPS_DRIFT_S).exp();
        self.drift_m = self.drift_m * keep + self.noise(GPS_DRIFT_SIGMA_M) * (1.0 - keep * keep).sqrt();
        let (position, velocity) = *self.late.front()?;
        let position = position + self.drift_m;
        Some(Fix {
            place: self.home.to_global(Vector2::new(position.x, position.y)),
            height_m: HOME_HEIGHT_M - position.z,
            velocity: velocity + self.noise(GPS_VELOCITY_SIGMA_MPS),
        })
    }
}

fn field() -> Vector3<f64> {
    let plane = FIELD_GAUSS * INCLINATION_RAD.cos();
    Vector3::new(
        plane * DECLINATION_RAD.cos(),
        plane * DECLINATION_RAD.sin(),
        FIELD_GAUSS * INCLINATION_RAD.sin(),
    )
}

fn pressure(height_m: f64) -> Pressure {
    Pressure {
        pressure_hpa: SEA_LEVEL_HPA * (1.0 - LAPSE_PER_M * height_m).powf(PRESSURE_EXPONENT),
        height_m,
        temperature_degc: SEA_LEVEL_DEGC - LAPSE_DEGC_PER_M * height_m,
    }
}

#[cfg(test)]
mod tests {
    use super::{HOME_HEIGHT_M, Instruments, Reading};
    use jink_shared_types::Velocity;
    use jink_simulated_world::vehicle::{GRAVITY_MPS2, Vehicle, VehicleConfig, VehicleTruth};
    use nalgebra::Vector3;

    fn standing() -> VehicleTruth {
        *Vehicle::new(&VehicleConfig::default()).truth()
    }

    fn readings(delay_s: f64, truth: impl Fn(u64) -> VehicleTruth) -> Vec<Reading> {
        let mut instruments = Instruments::new(3, delay_s);
        let force = Vector3::new(0.0, 0.0, -GRAVITY_MPS2);
        (1..=5_000)
            .map(|step| instruments.step(&truth(step), force))
            .collect()
    }

    #[test]
    fn at_rest_the_means_are_the_truth() {
        let readings = readings(0.1, |_| standing());
        let count = readings.len() as f64;
        let force: Vector3<f64> = readings.iter().map(|r| r.accelerometer).sum::<Vector3<f64>>() / count;
        assert!((force - Vector3::new(0.0, 0.0, -GRAVITY_MPS2)).norm() < 2e-3);
        let pressures: Vec<_> = readings.iter().filter_map(|r| r.barometer).collect();
        assert_eq!(pressures.len(), 1_000);
        let height_m: f64 = pressures.iter().map(|p| p.height_m).sum::<f64>() / 1_000.0;
        assert!((height_m - HOME_HEIGHT_M).abs() < 0.02);
        assert!((pressures[0].pressure_hpa - 956.0).abs() < 1.0);
        assert_eq!(
            readings.iter().filter(|r| r.magnetometer.is_some()).count(),
            1_250
        );
        let fixes: Vec<_> = readings.iter().filter_map(|r| r.gps).collect();
        assert_eq!(fixes.len(), 200);
        for fix in fixes {
            assert!((fix.height_m - HOME_HEIGHT_M).abs() < 1.0);
        }
    }

    #[test]
    fn the_gps_says_what_was_true_so_long_ago() {
        let moving = |step: u64| {
            let mut truth = standing();
            truth.velocity = Velocity::from_vector(Vector3::new(step as f64, 0.0, 0.0));
            truth
        };
        for (step, reading) in (1..).zip(readings(0.1, moving)) {
            if let Some(fix) = reading.gps {
                let expected = (f64::from(step) - 25.0).max(1.0);
                assert!(
                    (fix.velocity.x - expected).abs() < 0.2,
                    "{step}: {}",
                    fix.velocity.x
                );
            }
        }
    }

    #[test]
    fn a_seed_gives_one_flight() {
        assert_eq!(readings(0.1, |_| standing()), readings(0.1, |_| standing()));
    }
}
