//! One `[[sensor]]` table as written, read key by key.

use crate::config_error::DepthConfigError;
use jink_shared_types::frames::Mounting;
use jink_shared_types::orientation::{self, Orientation};
use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use toml::Value;

/// A `[[sensor]]` table as written.
pub type SensorTable = BTreeMap<String, Value>;

/// One table, with what its errors need.
pub(crate) struct Keys<'a> {
    pub sensor: &'a str,
    pub table: &'a SensorTable,
}

impl Keys<'_> {
    /// Whether `key` is given.
    pub fn has(&self, key: &str) -> bool {
        self.table.contains_key(key)
    }

    /// The text given for `key`, which must be there.
    pub fn text(&self, key: &'static str, possible: impl Fn() -> String) -> Result<&str, DepthConfigError> {
        let value = self.table.get(key).ok_or_else(|| self.missing(key, possible()))?;
        value
            .as_str()
            .ok_or_else(|| self.not_possible(key, &value.to_string(), possible()))
    }

    /// The number given for `key` or its default, if it lies within `limits`.
    pub fn number(
        &self,
        key: &'static str,
        default: f64,
        limits: RangeInclusive<f64>,
    ) -> Result<f64, DepthConfigError> {
        let Some(value) = self.table.get(key) else {
            return Ok(default);
        };
        number_of(value)
            .filter(|number| limits.contains(number))
            .ok_or_else(|| {
                let possible = format!("{} to {}", limits.start(), limits.end());
                self.not_possible(key, &value.to_string(), possible)
            })
    }

    /// As [`Self::number`], and it must be given.
    pub fn needed(&self, key: &'static str, limits: RangeInclusive<f64>) -> Result<f64, DepthConfigError> {
        if self.has(key) {
            return self.number(key, 0.0, limits);
        }
        Err(self.missing(key, format!("{} to {}", limits.start(), limits.end())))
    }

    /// As [`Self::number`] for whole numbers.
    pub fn count(
        &self,
        key: &'static str,
        default: u16,
        limits: RangeInclusive<u16>,
    ) -> Result<u16, DepthConfigError> {
        let Some(value) = self.table.get(key) else {
            return Ok(default);
        };
        value
            .as_integer()
            .and_then(|whole| u16::try_from(whole).ok())
            .filter(|count| limits.contains(count))
            .ok_or_else(|| {
                let possible = format!("a whole number from {} to {}", limits.start(), limits.end());
                self.not_possible(key, &value.to_string(), possible)
            })
    }

    /// How it sits: by orientation, turns or quaternion.
    pub fn mounting(&self) -> Result<Mounting, DepthConfigError> {
        let turn = |key| self.number(key, 0.0, -360.0..=360.0);
        let written = orientation::Written {
            orientation: self.orientation()?,
            turns_deg: [turn("yaw_deg")?, turn("pitch_deg")?, turn("roll_deg")?],
            quaternion: self.quaternion()?,
        };
        written
            .body_q_sensor()
            .map(Mounting::from_rotation)
            .map_err(|contradiction| DepthConfigError::Mounting {
                sensor: self.sensor.to_owned(),
                contradiction,
            })
    }

    fn orientation(&self) -> Result<Option<&'static Orientation>, DepthConfigError> {
        let Some(value) = self.table.get("orientation") else {
            return Ok(None);
        };
        let found = match value {
            Value::String(name) => orientation::by_name(name),
            Value::Integer(code) => orientation::by_code(*code),
            _ => None,
        };
        found.map(Some).ok_or_else(|| {
            let rows = orientation::TABLE.iter();
            let possible = rows.map(|row| format!("{} ({})", row.name, row.code));
            let possible = possible.collect::<Vec<_>>().join(", ");
            self.not_possible("orientation", &value.to_string(), possible)
        })
    }

    fn quaternion(&self) -> Result<Option<[f64; 4]>, DepthConfigError> {
        let Some(value) = self.table.get("quaternion") else {
            return Ok(None);
        };
        let numbers: Option<Vec<f64>> = value
            .as_array()
            .and_then(|list| list.iter().map(number_of).collect());
        numbers
            .and_then(|numbers| <[f64; 4]>::try_from(numbers).ok())
            .map(Some)
            .ok_or_else(|| {
                let possible = "[w, x, y, z], four numbers".to_owned();
                self.not_possible("quaternion", &value.to_string(), possible)
            })
    }

    pub fn missing(&self, key: &'static str, possible: String) -> DepthConfigError {
        DepthConfigError::Missing {
            sensor: self.sensor.to_owned(),
            key,
            possible,
        }
    }

    pub fn not_possible(&self, key: &'static str, value: &str, possible: String) -> DepthConfigError {
        DepthConfigError::NotPossible {
            sensor: self.sensor.to_owned(),
            key,
            value: value.to_owned(),
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
