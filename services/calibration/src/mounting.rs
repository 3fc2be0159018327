//! Where a sensor is mounted, as its table says it.

use jink_shared_types::orientation::{self, Written};
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion};
use serde::Deserialize;

/// Up to this pitch (deg) three turns say an orientation well; nearer to straight up or down a quaternion does.
const TURNS_DEG: f64 = 80.0;

/// The keys of a `[[sensor]]` table that say where it is mounted.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct MountingTable {
    /// The sensor's name.
    pub name: String,
    /// Forward (m).
    pub forward_m: f64,
    /// Right (m).
    pub right_m: f64,
    /// Down (m).
    pub down_m: f64,
    /// Turned to the right (deg).
    pub yaw_deg: f64,
    /// Then nose up (deg).
    pub pitch_deg: f64,
    /// Then right side down (deg).
    pub roll_deg: f64,
    /// By name or code.
    pub orientation: Option<OrientationKey>,
    /// `body_q_sensor`, w first.
    pub quaternion: Option<[f64; 4]>,
}

/// An orientation as written.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub enum OrientationKey {
    /// Its code.
    Code(i64),
    /// Its name.
    Name(String),
}

impl MountingTable {
    /// The mounting that it says.
    ///
    /// # Errors
    /// One sentence, naming the sensor.
    pub fn mounting(&self) -> Result<Mounting, String> {
        let named = match &self.orientation {
            None => None,
            Some(OrientationKey::Code(code)) => Some((orientation::by_code(*code), code.to_string())),
            Some(OrientationKey::Name(name)) => Some((orientation::by_name(name), format!("{name:?}"))),
        };
        let orientation = match named {
            Some((None, written)) => {
                return Err(format!(
                    "sensor {:?}: there is no orientation {written}",
                    self.name
                ));
            }
            Some((found, _)) => found,
            None => None,
        };
        let written = Written {
            orientation,
            turns_deg: [self.yaw_deg, self.pitch_deg, self.roll_deg],
            quaternion: self.quaternion,
        };
        let rotation = written
            .body_q_sensor()
            .map_err(|error| format!("sensor {:?}: {error}", self.name))?;
        let place = Translation3::new(self.forward_m, self.right_m, self.down_m);
        Ok(Mounting {
            body_t_sensor: Isometry3::from_parts(place, rotation),
        })
    }
}

/// Where a sensor is mounted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mounting {
    /// Takes sensor coordinates (forward, right, down; m) to body coordinates.
    pub body_t_sensor: Isometry3<f64>,
}

impl Mounting {
    /// Where it sits (body, m).
    pub fn origin(&self) -> Point3<f64> {
        Point3::from(self.body_t_sensor.translation.vector)
    }

    /// The mounting after `body_t_configured` has moved it.
    pub fn corrected(&self, body_t_configured: &Isometry3<f64>) -> Self {
        Self {
            body_t_sensor: body_t_configured * self.body_t_sensor,
        }
    }

    /// Turned about its own place by `turn` (body), and `down_m` lower.
    pub fn turned(&self, turn: &UnitQuaternion<f64>, down_m: f64) -> Self {
        let mut place = self.body_t_sensor.translation;
        place.vector.z += down_m;
        Self {
            body_t_sensor: Isometry3::from_parts(place, turn * self.body_t_sensor.rotation),
        }
    }

    /// Angle (deg) and distance (m) to another one.
    pub fn apart(&self, other: &Self) -> (f64, f64) {
        let angle_rad = self
            .body_t_sensor
            .rotation
            .angle_to(&other.body_t_sensor.rotation);
        (angle_rad.to_degrees(), (self.origin() - other.origin()).norm())
    }

    /// The keys of its table, a line each.
    pub fn keys(&self) -> String {
        let place = self.body_t_sensor.translation.vector;
        let mut keys: Vec<(&str, String)> =
            [("forward_m", place.x), ("right_m", place.y), ("down_m", place.z)]
                .map(|(key, value)| (key, number(value, 3)))
                .to_vec();
        let (roll_rad, pitch_rad, yaw_rad) = self.body_t_sensor.rotation.euler_angles();
        if pitch_rad.to_degrees().abs() <= TURNS_DEG {
            let turns = [
                ("yaw_deg", yaw_rad),
                ("pitch_deg", pitch_rad),
                ("roll_deg", roll_rad),
            ];
            keys.extend(turns.map(|(key, turn_rad)| (key, number(turn_rad.to_degrees(), 2))));
        } else {
            let Quaternion { coords } = self.body_t_sensor.rotation.into_inner();
            let parts = [coords.w, coords.x, coords.y, coords.z].map(|part| number(part, 6));
            keys.push(("quaternion", format!("[{}]", parts.join(", "))));
        }
        keys.into_iter()
            .map(|(key, value)| format!("{key} = {value}\n"))
            .collect()
    }
}

/// With so many decimals, and no negative zero.
fn number(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let is_zero = text
        .trim_start_matches('-')
        .chars()
        .all(|c| matches!(c, '0' | '.'));
    if is_zero {
        text.trim_start_matches('-').to_owned()
    } else {
        text
    }
}
