//! How a sensor sits on the vehicle: by a name, by three turns, or by a quaternion.
//!
//! Names and codes are those of MAV_SENSOR_ORIENTATION, which PX4 uses for its rangefinders, as far as they say where a
//! sensor looks: around the vehicle upright, around it upside down, up and down. Everything else is turned or given as a
//! quaternion.

use crate::frames::unit_quaternion;
use nalgebra::{Quaternion, UnitQuaternion};
use std::fmt;

/// Yaw, pitch and roll (deg), turned in this order: to the right, nose up, right side down.
pub type TurnsDeg = [f64; 3];

/// An orientation that has a name in the configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orientation {
    /// Code in MAVLink and in PX4's parameters.
    pub code: u8,
    /// Name in the configuration.
    pub name: &'static str,
}

/// MAV_SENSOR_ROTATION_CUSTOM: said by other means.
pub const CUSTOM: u8 = 100;

const fn row(code: u8, name: &'static str) -> Orientation {
    Orientation { code, name }
}

/// Every orientation that has a name.
pub const TABLE: &[Orientation] = &[
    row(0, "forward"),
    row(1, "forward_right"),
    row(2, "right"),
    row(3, "back_right"),
    row(4, "back"),
    row(5, "back_left"),
    row(6, "left"),
    row(7, "forward_left"),
    row(8, "forward_upside_down"),
    row(9, "forward_right_upside_down"),
    row(10, "right_upside_down"),
    row(11, "back_right_upside_down"),
    row(12, "back_upside_down"),
    row(13, "back_left_upside_down"),
    row(14, "left_upside_down"),
    row(15, "forward_left_upside_down"),
    row(24, "up"),
    row(25, "down"),
    row(CUSTOM, "custom"),
];

/// The turns of a MAV_SENSOR_ORIENTATION; `None` for [`CUSTOM`] and for codes that are none.
pub fn turns_deg(code: u8) -> Option<TurnsDeg> {
    Some(match code {
        0..=7 => [45.0 * f64::from(code), 0.0, 0.0],
        8..=15 => [45.0 * f64::from(code - 8), 0.0, 180.0],
        16..=19 => [45.0 * f64::from(code - 16), 0.0, 90.0],
        20..=23 => [45.0 * f64::from(code - 20), 0.0, 270.0],
        24 => [0.0, 90.0, 0.0],
        25 => [0.0, 270.0, 0.0],
        26 => [90.0, 180.0, 0.0],
        27 => [270.0, 180.0, 0.0],
        28 => [0.0, 90.0, 90.0],
        29 => [0.0, 90.0, 180.0],
        30 => [0.0, 90.0, 270.0],
        31 => [0.0, 180.0, 90.0],
        32 => [0.0, 180.0, 270.0],
        33 => [0.0, 270.0, 90.0],
        34 => [0.0, 270.0, 180.0],
        35 => [0.0, 270.0, 270.0],
        36 => [90.0, 180.0, 90.0],
        37 => [270.0, 0.0, 90.0],
        38 => [293.0, 68.0, 90.0],
        39 => [0.0, 315.0, 0.0],
        40 => [0.0, 315.0, 90.0],
        _ => return None,
    })
}

/// The orientation called `name`.
pub fn by_name(name: &str) -> Option<&'static Orientation> {
    TABLE.iter().find(|row| row.name == name)
}

/// The orientation with this code.
pub fn by_code(code: i64) -> Option<&'static Orientation> {
    TABLE.iter().find(|row| i64::from(row.code) == code)
}

/// What a configuration says of a sensor's orientation. One of the three at most.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Written {
    /// By name or code.
    pub orientation: Option<&'static Orientation>,
    /// Turned to the right, then nose up, then right side down (deg).
    pub turns_deg: TurnsDeg,
    /// `body_q_sensor`, w first.
    pub quaternion: Option<[f64; 4]>,
}

/// Why that is no orientation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Contradiction {
    /// It is said twice, or more often.
    Twice,
    /// "custom", and nothing else.
    CustomAlone,
    /// The quaternion is not of unit length.
    NoRotation {
        /// Its length.
        length: f64,
    },
}

impl fmt::Display for Contradiction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Twice => write!(
                f,
                "orientation, yaw_deg with pitch_deg and roll_deg, and quaternion say the same: give one of them"
            ),
            Self::CustomAlone => write!(
                f,
                "orientation = \"custom\" needs a quaternion, or yaw_deg, pitch_deg, roll_deg"
            ),
            Self::NoRotation { length } => {
                write!(f, "quaternion = [w, x, y, z] must have length 1, not {length:.3}")
            }
        }
    }
}
impl std::error::Error for Contradiction {}

impl Written {
    /// `body_q_sensor`: takes sensor components to body components. Nothing said: looking forward.
    ///
    /// # Errors
    /// [`Contradiction`] if it is said twice, or is none.
    pub fn body_q_sensor(&self) -> Result<UnitQuaternion<f64>, Contradiction> {
        let named = self
            .orientation
            .and_then(|orientation| turns_deg(orientation.code));
        let is_turned = self.turns_deg.iter().any(|turn| *turn != 0.0);
        let said = [named.is_some(), is_turned, self.quaternion.is_some()];
        match said.into_iter().filter(|said| *said).count() {
            0 if self.orientation.is_some() => Err(Contradiction::CustomAlone),
            0 | 1 => match self.quaternion {
                Some(quaternion) => unit(quaternion),
                None => Ok(turned(named.unwrap_or(self.turns_deg))),
            },
            _ => Err(Contradiction::Twice),
        }
    }
}

/// As a rotation.
pub fn turned([yaw_deg, pitch_deg, roll_deg]: TurnsDeg) -> UnitQuaternion<f64> {
    UnitQuaternion::from_euler_angles(
        roll_deg.to_radians(),
        pitch_deg.to_radians(),
        yaw_deg.to_radians(),
    )
}

fn unit(quaternion: [f64; 4]) -> Result<UnitQuaternion<f64>, Contradiction> {
    unit_quaternion(quaternion).ok_or_else(|| Contradiction::NoRotation {
        length: Quaternion::from(quaternion).norm(),
    })
}

#[cfg(test)]
mod tests {
    use super::{Contradiction, TABLE, Written, by_code, by_name};
    use nalgebra::{UnitQuaternion, Vector3};

    fn looks_along(name: &str) -> [f64; 3] {
        let written = Written {
            orientation: by_name(name),
            ..Written::default()
        };
        let along = written.body_q_sensor().unwrap() * Vector3::x();
        [along.x.round(), along.y.round(), along.z.round()]
    }

    #[test]
    fn names_look_where_they_say() {
        assert_eq!(looks_along("forward"), [1.0, 0.0, 0.0]);
        assert_eq!(looks_along("right"), [0.0, 1.0, 0.0]);
        assert_eq!(looks_along("back"), [-1.0, 0.0, 0.0]);
        assert_eq!(looks_along("left"), [0.0, -1.0, 0.0]);
        assert_eq!(looks_along("up"), [0.0, 0.0, -1.0]);
        assert_eq!(looks_along("down"), [0.0, 0.0, 1.0]);
        assert_eq!(looks_along("left_upside_down"), [0.0, -1.0, 0.0]);
    }

    #[test]
    fn upside_down_exchanges_left_and_right_of_a_scan() {
        let written = Written {
            orientation: by_code(8),
            ..Written::default()
        };
        let right_in_the_scan = written.body_q_sensor().unwrap() * Vector3::y();
        assert!((right_in_the_scan + Vector3::y()).norm() < 1e-12);
    }

    #[test]
    fn codes_and_names_are_unique() {
        for (index, row) in TABLE.iter().enumerate() {
            assert_eq!(by_code(row.code.into()), Some(row));
            assert_eq!(by_name(row.name), Some(row));
            assert!(TABLE[..index].iter().all(|other| other.code < row.code));
        }
    }

    #[test]
    fn one_way_of_saying_it_is_enough_and_two_are_too_many() {
        let turned = Written {
            turns_deg: [30.0, -10.0, 5.0],
            ..Written::default()
        };
        let q = turned.body_q_sensor().unwrap();
        let again = Written {
            orientation: by_code(100),
            quaternion: Some([q.w, q.i, q.j, q.k]),
            ..Written::default()
        };
        assert!(again.body_q_sensor().unwrap().angle_to(&q) < 1e-12);
        let nothing = Written::default();
        assert_eq!(nothing.body_q_sensor(), Ok(UnitQuaternion::identity()));
        let twice = Written {
            orientation: by_name("left"),
            ..turned
        };
        assert_eq!(twice.body_q_sensor(), Err(Contradiction::Twice));
        let custom = Written {
            orientation: by_code(100),
            ..nothing
        };
        assert_eq!(custom.body_q_sensor(), Err(Contradiction::CustomAlone));
        let long = Written {
            quaternion: Some([1.0, 1.0, 0.0, 0.0]),
            ..nothing
        };
        assert!(matches!(
            long.body_q_sensor(),
            Err(Contradiction::NoRotation { .. })
        ));
    }
}
