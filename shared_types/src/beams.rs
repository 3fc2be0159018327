//! What rangefinders and companions report to an autopilot, as scans: the fields of MAVLink's DISTANCE_SENSOR and
//! OBSTACLE_DISTANCE, and what is made of them.
//!
//! | reported | taken as |
//! |---|---|
//! | a range between minimum and maximum | an obstacle |
//! | a range below the minimum, zero included | an obstacle there: too near is not nothing |
//! | a range at the maximum or beyond; -1 with quality 0 | nothing up to the maximum |
//! | a range that is none, or negative | nothing known |
//! | an orientation that is known | its direction, whatever the roll; straight up and down: no beam to the sides |
//! | an orientation that is unknown | refused: nobody knows where it looks |
//! | a row whose increment does not divide the circle | every element where it says, none twice |
//!
//! The sectors that a row's element and its neighbour share an edge of are not both touched by it: elements that fit the sectors
//! fill one each.

use crate::coded::Coded;
use crate::frames::{Mounting, unit_quaternion};
use crate::orientation::{CUSTOM, turned, turns_deg};
use crate::ranges::{MAX_RANGE_M, RangeScan, ScanFrame};
use nalgebra::UnitQuaternion;
use std::f64::consts::TAU;
use std::fmt;

/// Elements of a row.
pub const ROW: usize = 72;
/// A row's element is narrower than its increment by twice this (rad), so that rounding does not make it touch the sector next to
/// its own: 0.0003 degrees.
const SHY_RAD: f64 = 5e-6;
/// "Nothing known" in a row (cm).
const UNKNOWN_CM: u16 = u16::MAX;

/// Why something was not taken as a scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BeamRefused {
    /// The orientation is none that is known, or its quaternion is none.
    Orientation {
        /// Its code.
        code: u8,
    },
    /// It looks straight up or down.
    Vertical,
    /// The opening angle is no number.
    Opening {
        /// What it says (rad).
        angle_rad: f32,
    },
    /// The maximum range is no positive number, or one of the ranges is more than [`MAX_RANGE_M`].
    Reach {
        /// What it says (m).
        range_max_m: f32,
    },
    /// A row's increment is no angle above 0 and up to 360 degrees, or its offset is no number.
    Increment {
        /// Increment (deg).
        increment_deg: f32,
        /// Offset (deg).
        offset_deg: f32,
    },
}

impl fmt::Display for BeamRefused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            BeamRefused::Orientation { code } => write!(f, "orientation {code} is not known"),
            BeamRefused::Vertical => write!(f, "it looks straight up or down"),
            BeamRefused::Opening { angle_rad } => write!(f, "an opening angle of {angle_rad} rad"),
            BeamRefused::Reach { range_max_m } => write!(f, "a reach of {range_max_m} m"),
            BeamRefused::Increment {
                increment_deg,
                offset_deg,
            } => write!(f, "an increment of {increment_deg} deg from {offset_deg} deg"),
        }
    }
}
impl std::error::Error for BeamRefused {}

/// One reading of a rangefinder, as DISTANCE_SENSOR reports it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeamReading {
    /// Shortest range it measures (m).
    pub range_min_m: f32,
    /// Longest range it measures (m).
    pub range_max_m: f32,
    /// What it measured (m).
    pub range_m: f32,
    /// Signal quality: -1 not known, 0 none, 1 to 100 %.
    pub quality: i8,
    /// MAV_SENSOR_ORIENTATION.
    pub orientation: u8,
    /// Horizontal opening angle (rad).
    pub opening_rad: f32,
    /// For the orientation "custom": sensor to body, w x y z.
    pub quaternion: [f32; 4],
}

impl BeamReading {
    /// Writes it into `scan`, a single beam.
    ///
    /// # Errors
    /// [`BeamRefused`]; `scan` stays as it was.
    pub fn write(&self, scan: &mut RangeScan) -> Result<(), BeamRefused> {
        let mounting = self.mounting()?;
        if !self.opening_rad.is_finite() {
            return Err(BeamRefused::Opening {
                angle_rad: self.opening_rad,
            });
        }
        let max_is_reach = self.range_max_m > 0.0 && f64::from(self.range_max_m) <= MAX_RANGE_M;
        if !max_is_reach || f64::from(self.range_min_m) > MAX_RANGE_M {
            return Err(BeamRefused::Reach {
                range_max_m: self.range_max_m,
            });
        }
        *scan = RangeScan {
            mounting: Mounting::from_rotation(mounting),
            beam_width_rad: self.opening_rad.clamp(0.0, TAU as f32),
            range_min_m: self.range_min_m.max(0.0),
            range_max_m: self.range_max_m,
            beams: 1,
            ..RangeScan::default()
        };
        scan.range_m[0] = self.meaning_m();
        Ok(())
    }

    /// What the range says, as scans say it.
    fn meaning_m(&self) -> f32 {
        let is_nothing = self.range_m == -1.0 && self.quality == 0;
        if is_nothing || self.range_m >= self.range_max_m {
            f32::INFINITY
        } else if self.range_m >= 0.0 {
            self.range_m
        } else {
            f32::NAN
        }
    }

    fn mounting(&self) -> Result<UnitQuaternion<f64>, BeamRefused> {
        let unknown = BeamRefused::Orientation {
            code: self.orientation,
        };
        if self.orientation == CUSTOM {
            return unit_quaternion(self.quaternion.map(f64::from)).ok_or(unknown);
        }
        let turns_deg = turns_deg(self.orientation).ok_or(unknown)?;
        // Up or down, however it is turned besides.
        if turns_deg[1].to_radians().cos().abs() < 1e-6 {
            return Err(BeamRefused::Vertical);
        }
        Ok(turned(turns_deg))
    }
}

/// A row of distances around the vehicle, as OBSTACLE_DISTANCE reports it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObstacleDistance {
    /// What its angles count from: the heading, or north.
    pub frame: ScanFrame,
    /// Angle between elements (deg), clockwise.
    pub increment_deg: f32,
    /// Direction of the centre of element 0 (deg).
    pub offset_deg: f32,
    /// Shortest distance that is measured (cm).
    pub min_cm: u16,
    /// Longest distance that is measured (cm).
    pub max_cm: u16,
    /// Distances (cm): 65535 = not known, above the maximum = nothing up to there.
    pub distances_cm: [u16; ROW],
}

impl ObstacleDistance {
    /// Writes it into `scan`.
    ///
    /// # Errors
    /// [`BeamRefused`]; `scan` stays as it was.
    pub fn write(&self, scan: &mut RangeScan) -> Result<(), BeamRefused> {
        let increment_deg = f64::from(self.increment_deg);
        let is_angle = increment_deg > 0.0 && increment_deg <= 360.0;
        if !is_angle || !self.offset_deg.is_finite() {
            return Err(BeamRefused::Increment {
                increment_deg: self.increment_deg,
                offset_deg: self.offset_deg,
            });
        }
        if self.max_cm == 0 {
            return Err(BeamRefused::Reach { range_max_m: 0.0 });
        }
        // One turn and no more. A little over a whole number of elements is rounding.
        let beams = ((360.0 / increment_deg + 1e-4).floor() as usize).clamp(1, ROW);
        let increment_rad = increment_deg.to_radians();
        // "Nothing" is reported as one more than the maximum. PX4 counts with that number, and so do we.
        let is_clear = |cm: &u16| *cm > self.max_cm && *cm != UNKNOWN_CM;
        let reach_cm = if self.distances_cm[..beams].iter().any(is_clear) {
            self.max_cm.saturating_add(1)
        } else {
            self.max_cm
        };
        *scan = RangeScan {
            frame: Coded::new(self.frame),
            angle_first_rad: f64::from(self.offset_deg % 360.0).to_radians() as f32,
            angle_step_rad: increment_rad as f32,
            beam_width_rad: (increment_rad - 2.0 * SHY_RAD).max(0.0) as f32,
            range_min_m: metres(self.min_cm),
            range_max_m: metres(reach_cm),
            beams: beams as u32,
            ..RangeScan::default()
        };
        for (range_m, distance_cm) in scan.range_m.iter_mut().zip(&self.distances_cm[..beams]) {
            *range_m = match *distance_cm {
                UNKNOWN_CM => f32::NAN,
                cm if cm > self.max_cm => f32::INFINITY,
                cm => metres(cm),
            };
        }
        Ok(())
    }
}

fn metres(cm: u16) -> f32 {
    f32::from(cm) * 0.01
}

#[cfg(test)]
mod tests {
    use super::{BeamReading, BeamRefused, ObstacleDistance, ROW};
    use crate::ranges::{RangeScan, ScanFrame};
    use nalgebra::Vector3;

    fn reading() -> BeamReading {
        BeamReading {
            range_min_m: 0.2,
            range_max_m: 8.0,
            range_m: 3.0,
            quality: -1,
            orientation: 2,
            opening_rad: 0.1,
            quaternion: [1.0, 0.0, 0.0, 0.0],
        }
    }

    fn written(reading: BeamReading) -> Result<RangeScan, BeamRefused> {
        let mut scan = RangeScan::default();
        reading.write(&mut scan).map(|()| scan)
    }

    #[test]
    fn a_range_is_an_obstacle_nothing_or_not_known() {
        let means = |range_m: f32, quality: i8| {
            written(BeamReading {
                range_m,
                quality,
                ..reading()
            })
            .unwrap()
            .range_m[0]
        };
        assert_eq!(means(3.0, -1), 3.0);
        assert_eq!(means(0.1, -1), 0.1, "too near is an obstacle");
        assert_eq!(means(0.0, -1), 0.0);
        assert_eq!(means(8.0, -1), f32::INFINITY);
        assert_eq!(means(-1.0, 0), f32::INFINITY);
        assert!(means(-1.0, -1).is_nan());
        assert!(means(f32::NAN, 100).is_nan());
    }

    #[test]
    fn orientations_look_where_they_say() {
        let axis = |orientation: u8| {
            let scan = written(BeamReading {
                orientation,
                ..reading()
            });
            scan.map(|scan| scan.mounting.rotation().unwrap() * Vector3::x())
        };
        assert!((axis(2).unwrap() - Vector3::y()).norm() < 1e-9);
        assert!((axis(4).unwrap() + Vector3::x()).norm() < 1e-9);
        assert!(
            (axis(8).unwrap() - Vector3::x()).norm() < 1e-9,
            "roll turns about the beam"
        );
        assert_eq!(axis(24), Err(BeamRefused::Vertical));
        assert_eq!(axis(25), Err(BeamRefused::Vertical));
        assert_eq!(axis(99), Err(BeamRefused::Orientation { code: 99 }));
    }

    #[test]
    fn a_row_is_one_turn_and_each_distance_means_what_it_says() {
        let mut row = ObstacleDistance {
            frame: ScanFrame::Level,
            increment_deg: 7.0,
            offset_deg: 725.0,
            min_cm: 20,
            max_cm: 1000,
            distances_cm: [300; ROW],
        };
        row.distances_cm[1] = 1001;
        row.distances_cm[2] = 65535;
        let mut scan = RangeScan::default();
        row.write(&mut scan).unwrap();
        assert_eq!(scan.beams, 51, "51 times 7 degrees fit");
        assert_eq!(scan.range_m[0], 3.0);
        assert_eq!(scan.range_m[1], f32::INFINITY);
        assert!(scan.range_m[2].is_nan());
        assert!((scan.angle_first_rad.to_degrees() - 5.0).abs() < 1e-4);
        for increment_deg in [0.0, -5.0, f32::NAN, 400.0] {
            let bad = ObstacleDistance { increment_deg, ..row };
            assert!(bad.write(&mut scan).is_err());
        }
    }
}
