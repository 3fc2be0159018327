//! The kinds of sensor.

use serde::{Deserialize, Serialize};

/// The kinds of sensor.
///
/// | kind | field of view | rays | range | noise (one sigma) | rate |
/// |---|---|---|---|---|---|
/// | `lidar_3d` | 360 x -45..60 deg | 20,000 | 0.1..12 m | 2 cm | 10 Hz |
/// | `depth_camera` | 90 x 75 deg | 160 x 120 | 0.2..4 m | 0.005 z^2 | 15 Hz |
/// | `lidar_2d` | 360 deg | 360 | 0.1..12 m | 1 cm | 10 Hz |
/// | `rangefinder` | cone of 27 deg | nearest of 9 | 0.1..8 m | 2 cm + 1 % | 20 Hz |
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub enum SensorKind {
    /// A lidar whose pattern does not repeat; renders a point cloud over its whole period.
    #[serde(rename = "lidar_3d")]
    Lidar3d,
    /// A pinhole depth camera with global shutter; renders a point cloud at once.
    #[serde(rename = "depth_camera")]
    DepthCamera,
    /// A rotating planar lidar; renders a range scan over its whole period.
    #[serde(rename = "lidar_2d")]
    Lidar2d,
    /// One wide beam; renders a range scan with one beam.
    #[serde(rename = "rangefinder")]
    Rangefinder,
    /// Nothing that is rendered: the gateway receives it.
    #[serde(rename = "autopilot_rangefinder")]
    AutopilotRangefinder,
    /// As [`Self::AutopilotRangefinder`].
    #[serde(rename = "obstacle_row")]
    ObstacleRow,
}

impl SensorKind {
    /// The name in configuration files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lidar3d => "lidar_3d",
            Self::DepthCamera => "depth_camera",
            Self::Lidar2d => "lidar_2d",
            Self::Rangefinder => "rangefinder",
            Self::AutopilotRangefinder => "autopilot_rangefinder",
            Self::ObstacleRow => "obstacle_row",
        }
    }

    /// Whether it is the simulator that makes its data.
    pub const fn is_rendered(self) -> bool {
        !matches!(self, Self::AutopilotRangefinder | Self::ObstacleRow)
    }
}
