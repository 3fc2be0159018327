//! What can be wrong with the table of a depth camera: one sentence that names the sensor, the key and what is
//! possible.

use jink_runtime::config::sensor_table::{self, Told};
use std::fmt;

/// What is wrong with a table, or that it is not there.
#[derive(Clone, Debug, PartialEq)]
pub enum DepthConfigError {
    /// One that any sensor may have.
    Table(sensor_table::Mistake),
    /// Two ways to say where pixels look.
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
}

impl DepthConfigError {
    /// The key that it is about, and the sentence.
    pub fn told(&self) -> Told {
        match self {
            Self::Table(mistake) => mistake.told(),
            Self::TwoProjections { key, .. } => (Some((*key).to_owned()), self.to_string()),
            Self::Distortion { .. } => (Some("k1".to_owned()), self.to_string()),
        }
    }
}

impl fmt::Display for DepthConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Table(mistake) => write!(f, "{mistake}"),
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
        }
    }
}
impl std::error::Error for DepthConfigError {}

impl From<sensor_table::Mistake> for DepthConfigError {
    fn from(mistake: sensor_table::Mistake) -> Self {
        Self::Table(mistake)
    }
}
