//! A `[[sensor]]` table as a driver reads it: key by key, every mistake answered with one sentence that names the sensor, the key and
//! what is possible.

use jink_shared_types::frames::Mounting;
use jink_shared_types::orientation::{self, Contradiction, Orientation};
use jink_shared_types::suggestion::{DidYouMean, nearest};
use std::collections::BTreeMap;
use std::fmt;
use std::ops::RangeInclusive;
use toml::Value;

/// A `[[sensor]]` table as written.
pub type SensorTable = BTreeMap<String, Value>;

/// A mistake as it is told: the key that it is about, and the sentence.
pub type Told = (Option<String>, String);

/// What is wrong with a table, or that it is not there.
#[derive(Clone, Debug, PartialEq)]
pub enum Mistake {
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
        /// The kinds that the driver is for.
        driven: &'static [&'static str],
    },
    /// The model is of the other kind.
    ModelOfOtherKind {
        /// Name of the sensor.
        sensor: String,
        /// The model.
        model: &'static str,
        /// The kind that it is.
        kind: &'static str,
    },
    /// A key that sensors of this driver do not have.
    UnknownKey {
        /// Name of the sensor.
        sensor: String,
        /// The key.
        key: String,
        /// What has no such key.
        what: &'static str,
        /// The one that was probably meant.
        nearest: Option<&'static str>,
    },
    /// A key that must be given.
    Missing {
        /// Name of the sensor.
        sensor: String,
        /// The key.
        key: &'static str,
        /// What it may say.
        possible: String,
    },
    /// A value that says nothing to this key.
    NotPossible {
        /// Name of the sensor.
        sensor: String,
        /// The key.
        key: &'static str,
        /// What was given.
        value: String,
        /// What it may say.
        possible: String,
    },
    /// A key that this model, or this device, does not have.
    NotOfThisModel {
        /// Name of the sensor.
        sensor: String,
        /// The key.
        key: &'static str,
        /// The model.
        model: &'static str,
        /// What has it, with the verb.
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

impl Mistake {
    /// The sensor and the key that it is about, to find them in the file.
    pub fn place(&self) -> Option<(&str, &str)> {
        match self {
            Self::NoSuchSensor { .. } => None,
            Self::OtherKind { sensor, .. } => Some((sensor, "kind")),
            Self::ModelOfOtherKind { sensor, .. } => Some((sensor, "model")),
            Self::UnknownKey { sensor, key, .. } => Some((sensor, key)),
            Self::Missing { sensor, key, .. }
            | Self::NotPossible { sensor, key, .. }
            | Self::NotOfThisModel { sensor, key, .. } => Some((sensor, key)),
            Self::Mounting { sensor, .. } => Some((sensor, "orientation")),
        }
    }

    /// The key that it is about, and the sentence.
    pub fn told(&self) -> Told {
        (self.place().map(|(_, key)| key.to_owned()), self.to_string())
    }
}

impl fmt::Display for Mistake {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoSuchSensor { sensor, known } => {
                let known = known.join(", ");
                write!(f, "there is no sensor {sensor:?}; the configuration has {known}")
            }
            Self::OtherKind { sensor, kind, driven } => {
                let kinds = if driven.len() == 1 { "kind" } else { "kinds" };
                let driven = driven.join(", ");
                write!(
                    f,
                    "sensor {sensor:?} is a {kind}; this driver is for the {kinds} {driven}"
                )
            }
            Self::ModelOfOtherKind { sensor, model, kind } => {
                write!(f, "sensor {sensor:?}: a {model} is of kind = {kind:?}")
            }
            Self::UnknownKey {
                sensor,
                key,
                what,
                nearest,
            } => {
                let nearest = DidYouMean(*nearest);
                write!(f, "sensor {sensor:?}: a {what} has no key `{key}`{nearest}")
            }
            Self::Missing {
                sensor,
                key,
                possible,
            } => write!(f, "sensor {sensor:?}: `{key}` is missing; possible: {possible}"),
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
            } => write!(f, "sensor {sensor:?}: a {model} has no {key}; {possible}"),
            Self::Mounting {
                sensor,
                contradiction,
            } => write!(f, "sensor {sensor:?}: {contradiction}"),
        }
    }
}
impl std::error::Error for Mistake {}

/// One table, with what its errors need.
#[derive(Clone, Copy, Debug)]
pub struct SensorKeys<'a> {
    /// Name of the sensor.
    pub sensor: &'a str,
    /// Its table.
    pub table: &'a SensorTable,
}

impl<'a> SensorKeys<'a> {
    /// The table of the sensor called `name` among all of a configuration.
    ///
    /// # Errors
    /// [`Mistake::NoSuchSensor`].
    pub fn find(tables: &'a [SensorTable], name: &'a str) -> Result<Self, Mistake> {
        let name_of = |table: &SensorTable| {
            let name = table.get("name").and_then(Value::as_str);
            name.unwrap_or_default().to_owned()
        };
        match tables.iter().find(|table| name_of(table) == name) {
            Some(table) => Ok(Self { sensor: name, table }),
            None => Err(Mistake::NoSuchSensor {
                sensor: name.to_owned(),
                known: tables.iter().map(name_of).collect(),
            }),
        }
    }

    /// Its kind, if it is one of `driven` and has no other keys than `keys` and `simulated`, those of the simulator's sensor. Of `keys`
    /// comes the suggestion for another one; `what` is what does not have it.
    ///
    /// # Errors
    /// [`Mistake::OtherKind`], [`Mistake::UnknownKey`].
    pub fn check_names(
        &self,
        driven: &'static [&'static str],
        what: &'static str,
        keys: &[&'static str],
        simulated: &[&str],
    ) -> Result<&'static str, Mistake> {
        let kind = self.table.get("kind").and_then(Value::as_str).unwrap_or_default();
        let Some(kind) = driven.iter().find(|known| **known == kind) else {
            return Err(Mistake::OtherKind {
                sensor: self.sensor.to_owned(),
                kind: kind.to_owned(),
                driven,
            });
        };
        let known = |key: &str| keys.contains(&key) || simulated.contains(&key);
        match self.table.keys().find(|key| !known(key)) {
            None => Ok(kind),
            Some(key) => Err(Mistake::UnknownKey {
                sensor: self.sensor.to_owned(),
                key: key.clone(),
                what,
                nearest: nearest(key, keys.iter().copied()),
            }),
        }
    }

    /// Whether `key` is given.
    pub fn has(&self, key: &str) -> bool {
        self.table.contains_key(key)
    }

    /// What is given for `key`, which must be there.
    ///
    /// # Errors
    /// [`Mistake::Missing`].
    pub fn given(&self, key: &'static str, possible: impl Fn() -> String) -> Result<&'a Value, Mistake> {
        self.table.get(key).ok_or_else(|| self.missing(key, possible()))
    }

    /// The text given for `key`, which must be there.
    ///
    /// # Errors
    /// [`Mistake::Missing`], [`Mistake::NotPossible`].
    pub fn text(&self, key: &'static str, possible: impl Fn() -> String) -> Result<&'a str, Mistake> {
        let value = self.given(key, &possible)?;
        value
            .as_str()
            .ok_or_else(|| self.not_possible(key, value, possible()))
    }

    /// The number given for `key` or its default, if it lies within `limits`.
    ///
    /// # Errors
    /// [`Mistake::NotPossible`].
    pub fn number(
        &self,
        key: &'static str,
        default: f64,
        limits: RangeInclusive<f64>,
    ) -> Result<f64, Mistake> {
        let Some(value) = self.table.get(key) else {
            return Ok(default);
        };
        number_of(value)
            .filter(|number| limits.contains(number))
            .ok_or_else(|| self.not_possible(key, value, format!("{} to {}", limits.start(), limits.end())))
    }

    /// As [`Self::number`], and it must be given.
    ///
    /// # Errors
    /// [`Mistake::Missing`], [`Mistake::NotPossible`].
    pub fn needed(&self, key: &'static str, limits: RangeInclusive<f64>) -> Result<f64, Mistake> {
        self.given(key, || format!("{} to {}", limits.start(), limits.end()))?;
        self.number(key, 0.0, limits)
    }

    /// As [`Self::number`] for whole numbers.
    ///
    /// # Errors
    /// [`Mistake::NotPossible`].
    pub fn count(
        &self,
        key: &'static str,
        default: u16,
        limits: RangeInclusive<u16>,
    ) -> Result<u16, Mistake> {
        let Some(value) = self.table.get(key) else {
            return Ok(default);
        };
        value
            .as_integer()
            .and_then(|whole| u16::try_from(whole).ok())
            .filter(|count| limits.contains(count))
            .ok_or_else(|| {
                let possible = format!("a whole number from {} to {}", limits.start(), limits.end());
                self.not_possible(key, value, possible)
            })
    }

    /// How it sits, by orientation, turns or quaternion: `body_q_sensor`.
    ///
    /// # Errors
    /// [`Mistake::NotPossible`], [`Mistake::Mounting`].
    pub fn mounting(&self) -> Result<Mounting, Mistake> {
        let turn = |key| self.number(key, 0.0, -360.0..=360.0);
        let written = orientation::Written {
            orientation: self.orientation()?,
            turns_deg: [turn("yaw_deg")?, turn("pitch_deg")?, turn("roll_deg")?],
            quaternion: self.quaternion()?,
        };
        written
            .body_q_sensor()
            .map(Mounting::from_rotation)
            .map_err(|contradiction| Mistake::Mounting {
                sensor: self.sensor.to_owned(),
                contradiction,
            })
    }

    fn orientation(&self) -> Result<Option<&'static Orientation>, Mistake> {
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
            self.not_possible("orientation", value, possible.collect::<Vec<_>>().join(", "))
        })
    }

    fn quaternion(&self) -> Result<Option<[f64; 4]>, Mistake> {
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

    /// [`Mistake::Missing`] of this sensor.
    pub fn missing(&self, key: &'static str, possible: String) -> Mistake {
        Mistake::Missing {
            sensor: self.sensor.to_owned(),
            key,
            possible,
        }
    }

    /// [`Mistake::NotPossible`] of this sensor.
    pub fn not_possible(&self, key: &'static str, value: impl fmt::Display, possible: String) -> Mistake {
        Mistake::NotPossible {
            sensor: self.sensor.to_owned(),
            key,
            value: value.to_string(),
            possible,
        }
    }
}

/// A number, whole or not.
pub fn number_of(value: &Value) -> Option<f64> {
    value
        .as_float()
        .or_else(|| value.as_integer().map(|whole| whole as f64))
}
