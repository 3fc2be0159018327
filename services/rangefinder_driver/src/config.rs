//! The `[[sensor]]` table of one rangefinder. docs/rangefinders.md lists the keys.
//!
//! Position, mounting, ranges, beam and rate have the keys that the simulator's sensors have, with the same meaning;
//! keys that only describe a simulated sensor (its noise, its seed) are ignored. Every error is one sentence that names
//! the sensor, the key and what is possible.

use crate::device_protocol::ScanSetup;
use crate::devices::{self, RangefinderModel, Reach};
use jink_shared_types::frames::Mounting;
use jink_shared_types::orientation::{self, Contradiction, Orientation};
use jink_shared_types::suggestion::{DidYouMean, nearest};
use jink_shared_types::{BodyFrd, Point};
use std::collections::BTreeMap;
use std::fmt;
use std::ops::RangeInclusive;
use toml::Value;

/// A `[[sensor]]` table as written.
pub type SensorTable = BTreeMap<String, Value>;

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

/// What is wrong with a table, or that it is not there.
#[derive(Clone, Debug, PartialEq)]
pub enum RangefinderConfigError {
    /// No sensor has this name.
    NoSuchSensor {
        /// The name asked for.
        sensor: String,
        /// The names there are.
        known: Vec<String>,
    },
    /// The sensor is of another kind.
    OtherKind {
        /// Name of the sensor.
        sensor: String,
        /// Its kind.
        kind: String,
    },
    /// A key that rangefinders do not have.
    UnknownKey {
        /// Name of the sensor.
        sensor: String,
        /// The key.
        key: String,
        /// The one that was probably meant.
        nearest: Option<&'static str>,
    },
    /// A key that must be given.
    Missing {
        /// Name of the sensor.
        sensor: String,
        /// The key.
        key: &'static str,
        /// The possible values.
        possible: String,
    },
    /// A value that is not possible for this key.
    NotPossible {
        /// Name of the sensor.
        sensor: String,
        /// The key.
        key: &'static str,
        /// What was given.
        value: String,
        /// The possible values.
        possible: String,
    },
    /// A key that this model does not have.
    NotOfThisModel {
        /// Name of the sensor.
        sensor: String,
        /// The key.
        key: &'static str,
        /// The model.
        model: &'static str,
        /// The models that have it.
        possible: String,
    },
    /// The orientation is none.
    Mounting {
        /// Name of the sensor.
        sensor: String,
        /// Why.
        contradiction: Contradiction,
    },
}

impl fmt::Display for RangefinderConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoSuchSensor { sensor, known } => {
                write!(
                    f,
                    "there is no sensor {sensor:?}; the configuration has {}",
                    known.join(", ")
                )
            }
            Self::OtherKind { sensor, kind } => {
                write!(
                    f,
                    "sensor {sensor:?} is a {kind}; this driver is for the kind {KIND}"
                )
            }
            Self::UnknownKey { sensor, key, nearest } => write!(
                f,
                "sensor {sensor:?}: a {KIND} has no key `{key}`{}",
                DidYouMean(*nearest)
            ),
            Self::Missing {
                sensor,
                key,
                possible,
            } => {
                write!(f, "sensor {sensor:?}: `{key}` is missing; possible: {possible}")
            }
            Self::NotPossible {
                sensor,
                key,
                value,
                possible,
            } => write!(
                f,
                "sensor {sensor:?}: {key} = {value} is not possible; possible: {possible}"
            ),
            Self::NotOfThisModel {
                sensor,
                key,
                model,
                possible,
            } => write!(f, "sensor {sensor:?}: a {model} has no {key}; {possible} has"),
            Self::Mounting {
                sensor,
                contradiction,
            } => write!(f, "sensor {sensor:?}: {contradiction}"),
        }
    }
}
impl std::error::Error for RangefinderConfigError {}

impl RangefinderSpec {
    /// The rangefinder called `name` among all sensors of a configuration.
    ///
    /// # Errors
    /// The first mistake found.
    pub fn find(tables: &[SensorTable], name: &str) -> Result<Self, RangefinderConfigError> {
        let name_of = |table: &SensorTable| {
            table
                .get("name")
                .and_then(Value::as_str)
                .unwrap_or_default()
                .to_owned()
        };
        match tables.iter().find(|table| name_of(table) == name) {
            Some(table) => Self::read(name, table),
            None => Err(RangefinderConfigError::NoSuchSensor {
                sensor: name.to_owned(),
                known: tables.iter().map(name_of).collect(),
            }),
        }
    }

    fn read(name: &str, table: &SensorTable) -> Result<Self, RangefinderConfigError> {
        let keys = Keys { sensor: name, table };
        keys.check_names()?;
        let model = keys.model()?;
        keys.check_model(model)?;
        let [min_m, max_m] = keys.ranges(model)?;
        let baud = keys.number("baud", f64::from(model.baud), 9_600.0..=921_600.0)? as u32;
        let offset = |key| keys.number(key, 0.0, -10.0..=10.0);
        let default_deg = model.beam_width_deg;
        Ok(Self {
            name: name.to_owned(),
            model,
            device: keys.device()?,
            baud,
            position: Point::new(offset("forward_m")?, offset("right_m")?, offset("down_m")?),
            mounting: keys.mounting()?,
            beam_width_rad: keys
                .number("beam_width_deg", default_deg, 0.0..=90.0)?
                .to_radians(),
            reach: Reach {
                min_m: min_m as f32,
                max_m: max_m as f32,
                device_max_m: model.range_max_m as f32,
            },
            sigma_m: keys.number("sigma_m", model.sigma_m, 0.0..=10.0)?,
            rate_hz: keys.number("rate_hz", RATE_HZ, 8.0..=200.0)?,
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

/// One table, with what its errors need.
struct Keys<'a> {
    sensor: &'a str,
    table: &'a SensorTable,
}

impl Keys<'_> {
    fn check_names(&self) -> Result<(), RangefinderConfigError> {
        let kind = self.table.get("kind").and_then(Value::as_str).unwrap_or_default();
        if kind != KIND {
            return Err(RangefinderConfigError::OtherKind {
                sensor: self.sensor.to_owned(),
                kind: kind.to_owned(),
            });
        }
        let known = |key: &str| KEYS.contains(&key) || SIMULATED.contains(&key);
        match self.table.keys().find(|key| !known(key)) {
            None => Ok(()),
            Some(key) => Err(RangefinderConfigError::UnknownKey {
                sensor: self.sensor.to_owned(),
                key: key.clone(),
                nearest: nearest(key, KEYS.iter().copied()),
            }),
        }
    }

    fn model(&self) -> Result<&'static RangefinderModel, RangefinderConfigError> {
        let possible = || {
            devices::TABLE
                .iter()
                .map(|model| model.name)
                .collect::<Vec<_>>()
                .join(", ")
        };
        let value = self
            .table
            .get("model")
            .ok_or_else(|| self.missing("model", possible()))?;
        let model = value.as_str().and_then(devices::find);
        model.ok_or_else(|| self.not_possible("model", value, possible()))
    }

    fn check_model(&self, model: &'static RangefinderModel) -> Result<(), RangefinderConfigError> {
        let scanning = ["scan_low_deg", "scan_high_deg"];
        let given = scanning.into_iter().find(|key| self.table.contains_key(*key));
        match given.filter(|_| !model.scans) {
            None => Ok(()),
            Some(key) => Err(RangefinderConfigError::NotOfThisModel {
                sensor: self.sensor.to_owned(),
                key,
                model: model.name,
                possible: devices::TABLE
                    .iter()
                    .filter(|model| model.scans)
                    .map(|model| model.name)
                    .collect::<Vec<_>>()
                    .join(", "),
            }),
        }
    }

    fn device(&self) -> Result<String, RangefinderConfigError> {
        let possible = || "the path of a serial port, e.g. \"/dev/ttyUSB0\"".to_owned();
        let value = self
            .table
            .get("device")
            .ok_or_else(|| self.missing("device", possible()))?;
        match value.as_str() {
            Some(path) if path.starts_with('/') => Ok(path.to_owned()),
            _ => Err(self.not_possible("device", value, possible())),
        }
    }

    /// The configured range lies within the device's.
    fn ranges(&self, model: &RangefinderModel) -> Result<[f64; 2], RangefinderConfigError> {
        let min_m = self.number("range_min_m", model.range_min_m, model.range_min_m..=10.0)?;
        let max_m = self.number("range_max_m", model.range_max_m, 0.1..=model.range_max_m)?;
        if min_m < max_m {
            return Ok([min_m, max_m]);
        }
        Err(RangefinderConfigError::NotPossible {
            sensor: self.sensor.to_owned(),
            key: "range_max_m",
            value: max_m.to_string(),
            possible: format!("more than range_min_m = {min_m}, up to {}", model.range_max_m),
        })
    }

    fn mounting(&self) -> Result<Mounting, RangefinderConfigError> {
        let turn = |key| self.number(key, 0.0, -360.0..=360.0);
        let written = orientation::Written {
            orientation: self.orientation()?,
            turns_deg: [turn("yaw_deg")?, turn("pitch_deg")?, turn("roll_deg")?],
            quaternion: self.quaternion()?,
        };
        written
            .body_q_sensor()
            .map(Mounting::from_rotation)
            .map_err(|contradiction| RangefinderConfigError::Mounting {
                sensor: self.sensor.to_owned(),
                contradiction,
            })
    }

    fn orientation(&self) -> Result<Option<&'static Orientation>, RangefinderConfigError> {
        let Some(value) = self.table.get("orientation") else {
            return Ok(None);
        };
        let found = match value {
            Value::String(name) => orientation::by_name(name),
            Value::Integer(code) => orientation::by_code(*code),
            _ => None,
        };
        found.map(Some).ok_or_else(|| {
            let possible = orientation::TABLE
                .iter()
                .map(|row| format!("{} ({})", row.name, row.code));
            self.not_possible("orientation", value, possible.collect::<Vec<_>>().join(", "))
        })
    }

    fn quaternion(&self) -> Result<Option<[f64; 4]>, RangefinderConfigError> {
        let Some(value) = self.table.get("quaternion") else {
            return Ok(None);
        };
        let numbers: Option<Vec<f64>> = value
            .as_array()
            .and_then(|list| list.iter().map(number_of).collect());
        numbers
            .and_then(|numbers| <[f64; 4]>::try_from(numbers).ok())
            .map(Some)
            .ok_or_else(|| self.not_possible("quaternion", value, "[w, x, y, z], four numbers".to_owned()))
    }

    /// The number given for `key` or its default, if it lies within `limits`.
    fn number(
        &self,
        key: &'static str,
        default: f64,
        limits: RangeInclusive<f64>,
    ) -> Result<f64, RangefinderConfigError> {
        let Some(value) = self.table.get(key) else {
            return Ok(default);
        };
        number_of(value)
            .filter(|number| limits.contains(number))
            .ok_or_else(|| self.not_possible(key, value, format!("{} to {}", limits.start(), limits.end())))
    }

    fn missing(&self, key: &'static str, possible: String) -> RangefinderConfigError {
        RangefinderConfigError::Missing {
            sensor: self.sensor.to_owned(),
            key,
            possible,
        }
    }

    fn not_possible(&self, key: &'static str, value: &Value, possible: String) -> RangefinderConfigError {
        RangefinderConfigError::NotPossible {
            sensor: self.sensor.to_owned(),
            key,
            value: value.to_string(),
            possible,
        }
    }
}

/// A number, whole or not.
fn number_of(value: &Value) -> Option<f64> {
    value
        .as_float()
        .or_else(|| value.as_integer().map(|whole| whole as f64))
}

#[cfg(test)]
mod tests;
