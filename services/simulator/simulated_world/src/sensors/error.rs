//! What can be wrong with a list of sensors, and with a request to render one.

use super::kind::SensorKind;
use jink_runtime::config::sensor_table::Told;
use jink_shared_types::orientation::{self, Contradiction};
use jink_shared_types::ranges::CLOUD_POINTS;
use std::fmt;

/// Longest name: it becomes part of a topic's name.
pub(super) const NAME_CHARACTERS: usize = 16;

/// Why a list of sensors is refused.
#[derive(Clone, Debug, PartialEq)]
pub enum SensorError {
    /// The name is empty, too long or has other characters than `a-z`, `0-9`, `_`.
    BadName {
        /// The name given.
        name: String,
    },
    /// Two sensors have one name.
    NameTwice {
        /// The name.
        name: String,
    },
    /// A number outside its limits, or none at all.
    OutOfRange {
        /// Name of the sensor.
        sensor: String,
        /// The option, with its unit.
        option: &'static str,
        /// Value given.
        value: f64,
        /// Least allowed.
        least: f64,
        /// Most allowed.
        most: f64,
    },
    /// A lower limit that is not below its upper limit.
    WrongOrder {
        /// Name of the sensor.
        sensor: String,
        /// Option of the lower limit.
        low: &'static str,
        /// Option of the upper limit.
        high: &'static str,
    },
    /// An option that this kind of sensor does not have.
    NotOfThisKind {
        /// Name of the sensor.
        sensor: String,
        /// The option.
        option: &'static str,
        /// Its kind.
        kind: SensorKind,
    },
    /// An orientation that has no name, or a code that is none of PX4's.
    UnknownOrientation {
        /// Name of the sensor.
        sensor: String,
    },
    /// The orientation is said twice, or is none.
    Mounting {
        /// Name of the sensor.
        sensor: String,
        /// Why.
        contradiction: Contradiction,
    },
    /// A sensor whose data come over MAVLink.
    NotRendered {
        /// Name of the sensor.
        sensor: String,
        /// Its kind.
        kind: SensorKind,
    },
    /// More pixels than a point cloud holds.
    TooManyPixels {
        /// Name of the sensor.
        sensor: String,
        /// Pixels per row.
        width_px: usize,
        /// Pixels per column.
        height_px: usize,
    },
}

impl SensorError {
    /// The key that it is about, and the sentence.
    pub fn told(&self) -> Told {
        let key = match self {
            Self::OutOfRange { option, .. } | Self::NotOfThisKind { option, .. } => option.to_string(),
            Self::WrongOrder { low, .. } => low.to_string(),
            Self::UnknownOrientation { .. } | Self::Mounting { .. } => "orientation".to_owned(),
            Self::NotRendered { .. } => "kind".to_owned(),
            Self::BadName { .. } | Self::NameTwice { .. } | Self::TooManyPixels { .. } => "name".to_owned(),
        };
        (Some(key), self.to_string())
    }
}

impl fmt::Display for SensorError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BadName { name } => write!(
                f,
                "\"{name}\" is no name for a sensor: 1 to {NAME_CHARACTERS} of a-z, 0-9 and _"
            ),
            Self::NameTwice { name } => write!(f, "two sensors are called \"{name}\""),
            Self::OutOfRange {
                sensor,
                option,
                value,
                least,
                most,
            } => write!(
                f,
                "sensor \"{sensor}\": {option} = {value} is not within {least} to {most}"
            ),
            Self::WrongOrder { sensor, low, high } => {
                write!(f, "sensor \"{sensor}\": {low} must be less than {high}")
            }
            Self::NotOfThisKind { sensor, option, kind } => {
                write!(f, "sensor \"{sensor}\": a {} has no {option}", kind.name())
            }
            Self::UnknownOrientation { sensor } => {
                let known = orientation::TABLE.iter();
                let known: Vec<String> = known.map(|row| format!("{} ({})", row.name, row.code)).collect();
                write!(
                    f,
                    "sensor \"{sensor}\": orientation is one of {}",
                    known.join(", ")
                )
            }
            Self::Mounting {
                sensor,
                contradiction,
            } => write!(f, "sensor \"{sensor}\": {contradiction}"),
            Self::NotRendered { sensor, kind } => write!(
                f,
                "sensor \"{sensor}\": what an {} says comes over MAVLink and is not rendered",
                kind.name()
            ),
            Self::TooManyPixels {
                sensor,
                width_px,
                height_px,
            } => write!(
                f,
                "sensor \"{sensor}\": {width_px} x {height_px} pixels are more than the {CLOUD_POINTS} points of a cloud"
            ),
        }
    }
}

impl std::error::Error for SensorError {}

/// Why a frame is not rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RenderError {
    /// The rig has no sensor of this index.
    NoSuchSensor {
        /// Index asked for.
        sensor: usize,
        /// Sensors in the rig.
        sensors: usize,
    },
    /// The sensor renders the other kind of sample.
    OtherOutput {
        /// Index asked for.
        sensor: usize,
        /// Its kind.
        kind: SensorKind,
    },
    /// No pose has been recorded yet.
    NoPose,
}

impl fmt::Display for RenderError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoSuchSensor { sensor, sensors } => {
                write!(f, "sensor {sensor} of {sensors} does not exist")
            }
            Self::OtherOutput { sensor, kind } => {
                write!(
                    f,
                    "sensor {sensor} is a {} and renders the other kind of sample",
                    kind.name()
                )
            }
            Self::NoPose => write!(f, "no pose of the vehicle has been recorded"),
        }
    }
}

impl std::error::Error for RenderError {}
