//! The `[[sensor]]` table of one rangefinder. docs/rangefinders.md lists the keys.
//!
//! Position, mounting, ranges, beam and rate have the keys that the simulator's sensors have, with the same meaning;
//! keys that only describe a simulated sensor (its noise, its seed) are ignored. Every error is one sentence that names
//! the sensor, the key and what is possible.

use crate::device_protocol::ScanSetup;
use crate::devices::{self, RangefinderModel, Reach};
use jink_runtime::config::sensor_table::SensorKeys;
pub use jink_runtime::config::sensor_table::{Mistake, SensorTable};
use jink_shared_types::frames::Mounting;
use jink_shared_types::{BodyFrd, Point};

/// The kind of sensor that this driver is for.
pub const KIND: &str = "rangefinder";

const KEYS: &[&str] = &[
    "name",
    "kind",
    "model",
    "device",
    "baud",
    "forward_m",
    "right_m",
    "down_m",
    "orientation",
    "yaw_deg",
    "pitch_deg",
    "roll_deg",
    "quaternion",
    "beam_width_deg",
    "range_min_m",
    "range_max_m",
    "sigma_m",
    "rate_hz",
    "delay_ms",
    "scan_low_deg",
    "scan_high_deg",
    // Declarations for the map.
    "band_up_m",
    "band_down_m",
];
/// What the simulator's rangefinder has besides.
const SIMULATED: &[&str] = &["seed", "sigma_ratio", "sigma_per_m", "dropout", "beams"];

/// Scans per second (Hz) by default: those of the topic.
const RATE_HZ: f64 = 20.0;
/// How far an SF45/B turns (deg).
const SCAN_LIMIT_DEG: f64 = 160.0;
/// Least turn to either side (deg).
const SCAN_LEAST_DEG: f64 = 10.0;

/// One rangefinder, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct RangefinderSpec {
    /// Its name.
    pub name: String,
    /// Its model.
    pub model: &'static RangefinderModel,
    /// Path of its serial port.
    pub device: String,
    /// Speed of the port (bit/s).
    pub baud: u32,
    /// Where it sits.
    pub position: Point<BodyFrd>,
    /// How it sits: `body_q_sensor`.
    pub mounting: Mounting,
    /// Full opening angle of its beam (rad).
    pub beam_width_rad: f64,
    /// Its ranges.
    pub reach: Reach,
    /// One standard deviation of a range (m).
    pub sigma_m: f64,
    /// Scans per second (Hz); of a scanning device the least number of parts per second.
    pub rate_hz: f64,
    /// What a scanning device is set up for.
    pub scan: ScanSetup,
}

impl RangefinderSpec {
    /// The rangefinder called `name` among all sensors of a configuration.
    ///
    /// # Errors
    /// The first mistake found.
    pub fn find(tables: &[SensorTable], name: &str) -> Result<Self, Mistake> {
        Self::read(&SensorKeys::find(tables, name)?)
    }

    fn read(keys: &SensorKeys<'_>) -> Result<Self, Mistake> {
        keys.check_names(&[KIND], KIND, KEYS, SIMULATED)?;
        // First what does not hang on the model: a wrong one hides nothing else then.
        let offset = |key| keys.number(key, 0.0, -10.0..=10.0);
        let position = Point::new(offset("forward_m")?, offset("right_m")?, offset("down_m")?);
        let mounting = keys.mounting()?;
        let device = device(keys)?;
        let rate_hz = keys.number("rate_hz", RATE_HZ, 8.0..=200.0)?;
        let model = model(keys)?;
        check_model(keys, model)?;
        let [min_m, max_m] = ranges(keys, model)?;
        let baud = keys.number("baud", f64::from(model.baud), 9_600.0..=921_600.0)? as u32;
        let default_deg = model.beam_width_deg;
        Ok(Self {
            name: keys.sensor.to_owned(),
            model,
            device,
            baud,
            position,
            mounting,
            beam_width_rad: keys
                .number("beam_width_deg", default_deg, 0.0..=90.0)?
                .to_radians(),
            reach: Reach {
                min_m: min_m as f32,
                max_m: max_m as f32,
                device_max_m: model.range_max_m as f32,
            },
            sigma_m: keys.number("sigma_m", model.sigma_m, 0.0..=10.0)?,
            rate_hz,
            scan: ScanSetup {
                baud,
                rate_hz: model.rate_hz,
                low_deg: keys.number("scan_low_deg", -SCAN_LIMIT_DEG, -SCAN_LIMIT_DEG..=-SCAN_LEAST_DEG)?
                    as f32,
                high_deg: keys.number("scan_high_deg", SCAN_LIMIT_DEG, SCAN_LEAST_DEG..=SCAN_LIMIT_DEG)?
                    as f32,
            },
        })
    }
}

fn model(keys: &SensorKeys<'_>) -> Result<&'static RangefinderModel, Mistake> {
    let possible = || names(|_| true);
    let value = keys.given("model", possible)?;
    let model = value.as_str().and_then(devices::find);
    model.ok_or_else(|| keys.not_possible("model", value, possible()))
}

/// The names of the models that `are` meant.
fn names(are: fn(&RangefinderModel) -> bool) -> String {
    let models = devices::TABLE.iter().filter(|model| are(model));
    models.map(|model| model.name).collect::<Vec<_>>().join(", ")
}

fn check_model(keys: &SensorKeys<'_>, model: &'static RangefinderModel) -> Result<(), Mistake> {
    let scanning = ["scan_low_deg", "scan_high_deg"];
    let given = scanning.into_iter().find(|key| keys.has(key));
    match given.filter(|_| !model.scans) {
        None => Ok(()),
        Some(key) => Err(Mistake::NotOfThisModel {
            sensor: keys.sensor.to_owned(),
            key,
            model: model.name,
            possible: format!("{} has", names(|model| model.scans)),
        }),
    }
}

fn device(keys: &SensorKeys<'_>) -> Result<String, Mistake> {
    let possible = || "the path of a serial port, e.g. \"/dev/ttyUSB0\"".to_owned();
    let value = keys.given("device", possible)?;
    match value.as_str() {
        Some(path) if path.starts_with('/') => Ok(path.to_owned()),
        _ => Err(keys.not_possible("device", value, possible())),
    }
}

/// A range that is looked at lies within the device's.
fn ranges(keys: &SensorKeys<'_>, model: &RangefinderModel) -> Result<[f64; 2], Mistake> {
    let min_m = keys.number("range_min_m", model.range_min_m, model.range_min_m..=10.0)?;
    let max_m = keys.number("range_max_m", model.range_max_m, 0.1..=model.range_max_m)?;
    if min_m < max_m {
        return Ok([min_m, max_m]);
    }
    let possible = format!("more than range_min_m = {min_m}, up to {}", model.range_max_m);
    Err(keys.not_possible("range_max_m", max_m, possible))
}

#[cfg(test)]
mod tests;
