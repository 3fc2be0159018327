//! What sensors and companions say, in PX4's own terms.

use super::map::{BINS, UNKNOWN_CM};

/// Rangefinders that can be distinguished.
pub const INSTANCES: usize = 10;

/// Frames of [`ObstacleDistance`], by MAVLink's numbers.
pub mod frame {
    /// MAV_FRAME_GLOBAL: aligned to north.
    pub const GLOBAL: u8 = 0;
    /// MAV_FRAME_LOCAL_NED: aligned to north.
    pub const LOCAL_NED: u8 = 1;
    /// MAV_FRAME_BODY_FRD: aligned to the nose.
    pub const BODY_FRD: u8 = 12;
}

/// One reading of a rangefinder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistanceSensor {
    /// Boot time of the reading (us).
    pub time_us: u64,
    /// Range (m).
    pub min_m: f32,
    /// Range (m).
    pub max_m: f32,
    /// The reading (m).
    pub distance_m: f32,
    /// -1 unknown, 0 invalid, up to 100.
    pub quality: i8,
    /// MAV_SENSOR_ORIENTATION: 0 to 7 by eighths of a turn to the right, 24 up, 25 down, 100 by `body_q_sensor`. Any
    /// other counts as 0.
    pub orientation: u8,
    /// Horizontal field of view (rad).
    pub field_of_view_rad: f32,
    /// Orientation 100: w, x, y, z. Only its heading is used.
    pub body_q_sensor: [f32; 4],
}

/// Distances all around.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObstacleDistance {
    /// Boot time of arrival (us).
    pub time_us: u64,
    /// One of [`frame`]; others are refused.
    pub frame: u8,
    /// From one element to the next, clockwise (deg).
    pub increment_deg: f32,
    /// Centre of element 0, clockwise from the frame's front (deg).
    pub offset_deg: f32,
    /// Range of the sensor (cm).
    pub min_cm: u16,
    /// Range of the sensor (cm); more than that is "nothing there".
    pub max_cm: u16,
    /// Distances (cm); [`UNKNOWN_CM`] = unknown.
    pub distances_cm: [u16; BINS],
}

impl Default for ObstacleDistance {
    /// Seventy-two unknown elements about the nose, from a sensor that sees 0.2 to 15 m.
    fn default() -> Self {
        Self {
            time_us: 0,
            frame: frame::BODY_FRD,
            increment_deg: 5.0,
            offset_deg: 0.0,
            min_cm: 20,
            max_cm: 1_500,
            distances_cm: [UNKNOWN_CM; BINS],
        }
    }
}
