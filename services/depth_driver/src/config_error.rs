//! What can be wrong with the table of a depth camera: one sentence that names the sensor, the key and what is
//! possible.

use crate::config::KIND;
use jink_shared_types::orientation::Contradiction;
use jink_shared_types::suggestion::DidYouMean;
use std::fmt;

/// What is wrong with a table, or that it is not there.
#[derive(Clone, Debug, PartialEq)]
pub enum DepthConfigError {
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
    /// A key that depth cameras do not have.
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
    /// Two ways to give the directions of pixels.
    TwoProjections {
        /// Name of the sensor.
        sensor: String,
        /// The one key.
        key: &'static str,
        /// The other key.
        other: &'static str,
    },
    /// The distortion has no inverse somewhere in the image.
    Distortion {
        /// Name of the sensor.
        sensor: String,
        /// Column and row of the first pixel without a direction.
        pixel: [u16; 2],
    },
    /// The orientation is none.
    Mounting {
        /// Name of the sensor.
        sensor: String,
        /// Why.
        contradiction: Contradiction,
    },
}

impl fmt::Display for DepthConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoSuchSensor { sensor, known } => write!(
                f,
                "there is no sensor {sensor:?}; the configuration has {}",
                known.join(", ")
            ),
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
            Self::TwoProjections { sensor, key, other } => {
                write!(
                    f,
                    "sensor {sensor:?}: {key} and {other} say the same: give one of them"
                )
            }
            Self::Distortion {
                sensor,
                pixel: [column, row],
            } => write!(
                f,
                "sensor {sensor:?}: with this distortion (k1, k2, p1, p2, k3) the pixel in column {column}, row {row} looks nowhere; \
                 correct it, or leave the edges out with border_px"
            ),
            Self::Mounting {
                sensor,
                contradiction,
            } => write!(f, "sensor {sensor:?}: {contradiction}"),
        }
    }
}
impl std::error::Error for DepthConfigError {}
