//! Which sensors a vehicle carries, as written in its configuration, and every way in which that can be wrong.
//!
//! ```toml
//! [[sensor]]
//! name = "lidar"
//! kind = "lidar_3d"
//! rate_hz = 10
//! range_max_m = 8
//! ```
//!
//! Everything but name and kind has a default that depends on the kind ([`SensorKind`]).

use super::error::{NAME_CHARACTERS, SensorError};
use super::kind::SensorKind;
use jink_shared_types::orientation;
use nalgebra::UnitQuaternion;
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};

/// One sensor as configured. What is `None` takes the kind's default; what the kind does not know is refused.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SensorSpec {
    /// Name, unique in the rig: 1 to 16 of `a-z`, `0-9`, `_`.
    pub name: String,
    /// Kind.
    pub kind: SensorKind,
    /// Frames per second (Hz), 2 to 200.
    pub rate_hz: Option<f64>,
    /// From the capture of a frame to its publication, at most (ms). The service's affair; nothing is rendered later for it.
    pub delay_ms: Option<f64>,
    /// Added to the rig's seed: distinguishes sensors of one rig beyond their names.
    #[serde(default)]
    pub seed: u64,
    /// Mounting position in the body, forward (m).
    #[serde(default)]
    pub forward_m: f64,
    /// Mounting position in the body, right (m).
    #[serde(default)]
    pub right_m: f64,
    /// Mounting position in the body, down (m).
    #[serde(default)]
    pub down_m: f64,
    /// Mounting, by PX4's name or code ([`jink_shared_types::orientation`]), instead of the three rotations.
    pub orientation: Option<OrientationKey>,
    /// Mounting, as `body_q_sensor` with w first, instead of the three rotations.
    pub quaternion: Option<[f64; 4]>,
    /// Mounting: turned to the right (deg) (first of the three rotations, about down).
    #[serde(default)]
    pub yaw_deg: f64,
    /// Mounting: nose up (deg) (second, about the new right); -90 looks down.
    #[serde(default)]
    pub pitch_deg: f64,
    /// Mounting: right side down (deg) (third, about the new forward).
    #[serde(default)]
    pub roll_deg: f64,
    /// Shortest range (m).
    pub range_min_m: Option<f64>,
    /// Longest range (m).
    pub range_max_m: Option<f64>,
    /// Noise, constant part of one sigma (m).
    pub sigma_m: Option<f64>,
    /// Noise, part proportional to range.
    pub sigma_ratio: Option<f64>,
    /// Noise, part proportional to range squared (1/m).
    pub sigma_per_m: Option<f64>,
    /// Probability that a ray gives no answer ("unknown"), whatever stands there.
    pub dropout: Option<f64>,
    /// Rays per frame (`lidar_3d`).
    pub rays: Option<u32>,
    /// Beams per turn (`lidar_2d`, and `lidar_3d` with `rings`).
    pub beams: Option<u32>,
    /// Rings of a lidar that turns (`lidar_3d`): as many rays one above the other for each of its beams.
    pub rings: Option<u32>,
    /// What a ray without an answer says: unknown, or clear up to the longest range. Without it a sensor of no product
    /// (`products`) is so good that it knows the difference.
    pub no_return: Option<NoReturn>,
    /// Horizontal field of view (deg) (`lidar_3d`, `lidar_2d`, `depth_camera`).
    pub fov_horizontal_deg: Option<f64>,
    /// Vertical field of view (deg) (`depth_camera`).
    pub fov_vertical_deg: Option<f64>,
    /// Lowest ray above the sensor's horizon (deg) (`lidar_3d`).
    pub elevation_min_deg: Option<f64>,
    /// Highest ray above the sensor's horizon (deg) (`lidar_3d`).
    pub elevation_max_deg: Option<f64>,
    /// Pixels per row (`depth_camera`).
    pub width_px: Option<u32>,
    /// Pixels per column (`depth_camera`).
    pub height_px: Option<u32>,
    /// Full opening angle of one beam (deg) (`lidar_3d`, `lidar_2d`, `rangefinder`).
    pub beam_width_deg: Option<f64>,
    /// Probability that a beam misses an object much thinner than itself and reports what stands behind it
    /// (`lidar_3d`, `lidar_2d`).
    pub thin_miss: Option<f64>,
    /// How far a pixel at a depth edge may slide towards its neighbour's depth, 0 to 1 (`depth_camera`).
    pub edge_mixing: Option<f64>,
    /// Which product it is (`products`); of models that are not rendered only their driver takes notice.
    pub model: Option<String>,
    /// How far a scanner that does not turn all around looks to the left (deg).
    pub scan_low_deg: Option<f64>,
    /// The same to the right.
    pub scan_high_deg: Option<f64>,
    /// Declaration of the user, which the map reads; here without effect.
    pub band_up_m: Option<f64>,
    /// As [`Self::band_up_m`].
    pub band_down_m: Option<f64>,
    /// Of the real device, whose driver reads it; here without effect, so that one configuration serves both.
    #[serde(skip_serializing)]
    pub device: Option<IgnoredAny>,
    /// As [`Self::device`].
    #[serde(skip_serializing)]
    pub baud: Option<IgnoredAny>,
    /// Of a depth camera: edge of the square blocks of pixels of which one point each is made (px).
    pub bin_px: Option<u32>,
    /// As [`Self::device`].
    #[serde(skip_serializing)]
    pub border_px: Option<IgnoredAny>,
    /// As [`Self::device`].
    #[serde(skip_serializing)]
    pub depth_scale_m: Option<IgnoredAny>,
    /// As [`Self::device`].
    #[serde(skip_serializing)]
    pub flying_pixel_per_m: Option<IgnoredAny>,
    /// As [`Self::device`]: intrinsics and distortion. The simulated camera has a field of view.
    #[serde(skip_serializing)]
    pub fx_px: Option<IgnoredAny>,
    /// As [`Self::fx_px`].
    #[serde(skip_serializing)]
    pub fy_px: Option<IgnoredAny>,
    /// As [`Self::fx_px`].
    #[serde(skip_serializing)]
    pub cx_px: Option<IgnoredAny>,
    /// As [`Self::fx_px`].
    #[serde(skip_serializing)]
    pub cy_px: Option<IgnoredAny>,
    /// As [`Self::fx_px`].
    #[serde(skip_serializing)]
    pub k1: Option<IgnoredAny>,
    /// As [`Self::fx_px`].
    #[serde(skip_serializing)]
    pub k2: Option<IgnoredAny>,
    /// As [`Self::fx_px`].
    #[serde(skip_serializing)]
    pub p1: Option<IgnoredAny>,
    /// As [`Self::fx_px`].
    #[serde(skip_serializing)]
    pub p2: Option<IgnoredAny>,
    /// As [`Self::fx_px`].
    #[serde(skip_serializing)]
    pub k3: Option<IgnoredAny>,
    /// As [`Self::device`].
    #[serde(skip_serializing)]
    pub metadata: Option<IgnoredAny>,
    /// As [`Self::device`].
    #[serde(skip_serializing)]
    pub replay: Option<IgnoredAny>,
    /// As [`Self::device`].
    #[serde(skip_serializing)]
    pub sensor_address: Option<IgnoredAny>,
    /// As [`Self::device`].
    #[serde(skip_serializing)]
    pub host_address: Option<IgnoredAny>,
    /// As [`Self::device`].
    #[serde(skip_serializing)]
    pub control_port: Option<IgnoredAny>,
    /// As [`Self::device`].
    #[serde(skip_serializing)]
    pub returns: Option<IgnoredAny>,
    /// As [`Self::device`].
    #[serde(skip_serializing)]
    pub blind_deg: Option<IgnoredAny>,
    /// As [`Self::device`]: for what the gateway receives.
    #[serde(skip_serializing)]
    pub id: Option<IgnoredAny>,
    /// As [`Self::id`].
    #[serde(skip_serializing)]
    pub component: Option<IgnoredAny>,
}

/// What a ray without an answer says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum NoReturn {
    /// Nothing.
    Unknown,
    /// Nothing stands up to the longest range: the user answers for it.
    Clear,
}

/// An orientation as written.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(untagged, expecting = "an orientation is a name or a code")]
pub enum OrientationKey {
    /// Its code.
    Code(i64),
    /// Its name.
    Name(String),
}

impl SensorSpec {
    /// A sensor with all its kind's defaults, at the body's origin, looking forward.
    pub fn new(name: &str, kind: SensorKind) -> Self {
        Self {
            name: name.to_owned(),
            kind,
            rate_hz: None,
            delay_ms: None,
            seed: 0,
            forward_m: 0.0,
            right_m: 0.0,
            down_m: 0.0,
            yaw_deg: 0.0,
            pitch_deg: 0.0,
            roll_deg: 0.0,
            range_min_m: None,
            range_max_m: None,
            sigma_m: None,
            sigma_ratio: None,
            sigma_per_m: None,
            dropout: None,
            rays: None,
            beams: None,
            fov_horizontal_deg: None,
            fov_vertical_deg: None,
            elevation_min_deg: None,
            elevation_max_deg: None,
            width_px: None,
            height_px: None,
            beam_width_deg: None,
            thin_miss: None,
            edge_mixing: None,
            orientation: None,
            quaternion: None,
            rings: None,
            no_return: None,
            model: None,
            scan_low_deg: None,
            scan_high_deg: None,
            band_up_m: None,
            band_down_m: None,
            device: None,
            baud: None,
            bin_px: None,
            border_px: None,
            depth_scale_m: None,
            flying_pixel_per_m: None,
            fx_px: None,
            fy_px: None,
            cx_px: None,
            cy_px: None,
            k1: None,
            k2: None,
            p1: None,
            p2: None,
            k3: None,
            metadata: None,
            replay: None,
            sensor_address: None,
            host_address: None,
            control_port: None,
            returns: None,
            blind_deg: None,
            id: None,
            component: None,
        }
    }

    /// How the sensor is mounted: `body_q_sensor`.
    pub(super) fn body_q_sensor(&self) -> Result<UnitQuaternion<f64>, SensorError> {
        let unknown = || SensorError::UnknownOrientation {
            sensor: self.name.clone(),
        };
        let orientation = match &self.orientation {
            None => None,
            Some(OrientationKey::Code(code)) => Some(orientation::by_code(*code).ok_or_else(unknown)?),
            Some(OrientationKey::Name(name)) => Some(orientation::by_name(name).ok_or_else(unknown)?),
        };
        for (option, turn_deg) in [
            ("roll_deg", self.roll_deg),
            ("pitch_deg", self.pitch_deg),
            ("yaw_deg", self.yaw_deg),
        ] {
            self.number(option, Some(turn_deg), 0.0, [-360.0, 360.0])?;
        }
        let written = orientation::Written {
            orientation,
            turns_deg: [self.yaw_deg, self.pitch_deg, self.roll_deg],
            quaternion: self.quaternion,
        };
        written
            .body_q_sensor()
            .map_err(|contradiction| SensorError::Mounting {
                sensor: self.name.clone(),
                contradiction,
            })
    }

    /// What the forest vehicle carries: a 3-D lidar "lidar" at 10 Hz and a rangefinder "ground" looking down at 20
    /// Hz.
    pub fn default_rig() -> Vec<Self> {
        let mut ground = Self::new("ground", SensorKind::Rangefinder);
        ground.pitch_deg = -90.0;
        vec![Self::new("lidar", SensorKind::Lidar3d), ground]
    }

    /// Whether the name can be one and every option given means something to the kind.
    pub(super) fn check(&self) -> Result<(), SensorError> {
        self.check_name()?;
        self.check_kind()
    }

    fn check_name(&self) -> Result<(), SensorError> {
        let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
        if self.name.is_empty() || self.name.len() > NAME_CHARACTERS || !self.name.chars().all(allowed) {
            return Err(SensorError::BadName {
                name: self.name.clone(),
            });
        }
        Ok(())
    }

    /// Refuses options that mean nothing to the kind: they would be silently without effect.
    fn check_kind(&self) -> Result<(), SensorError> {
        use SensorKind::{DepthCamera, Lidar2d, Lidar3d, Rangefinder};
        let table: [(&'static str, bool, &[SensorKind]); 13] = [
            ("rays", self.rays.is_some(), &[Lidar3d]),
            ("beams", self.beams.is_some(), &[Lidar2d, Lidar3d]),
            ("rings", self.rings.is_some(), &[Lidar3d]),
            (
                "fov_horizontal_deg",
                self.fov_horizontal_deg.is_some(),
                &[Lidar3d, Lidar2d, DepthCamera],
            ),
            (
                "fov_vertical_deg",
                self.fov_vertical_deg.is_some(),
                &[DepthCamera],
            ),
            ("elevation_min_deg", self.elevation_min_deg.is_some(), &[Lidar3d]),
            ("elevation_max_deg", self.elevation_max_deg.is_some(), &[Lidar3d]),
            ("width_px", self.width_px.is_some(), &[DepthCamera]),
            ("height_px", self.height_px.is_some(), &[DepthCamera]),
            ("bin_px", self.bin_px.is_some(), &[DepthCamera]),
            (
                "beam_width_deg",
                self.beam_width_deg.is_some(),
                &[Lidar3d, Lidar2d, Rangefinder],
            ),
            ("thin_miss", self.thin_miss.is_some(), &[Lidar3d, Lidar2d]),
            ("edge_mixing", self.edge_mixing.is_some(), &[DepthCamera]),
        ];
        for (option, given, kinds) in table {
            if given && !kinds.contains(&self.kind) {
                return Err(SensorError::NotOfThisKind {
                    sensor: self.name.clone(),
                    option,
                    kind: self.kind,
                });
            }
        }
        Ok(())
    }

    /// The number given for `option` or its default, if it lies within `limits`.
    pub(super) fn number(
        &self,
        option: &'static str,
        given: Option<f64>,
        default: f64,
        limits: [f64; 2],
    ) -> Result<f64, SensorError> {
        let value = given.unwrap_or(default);
        let [least, most] = limits;
        if (least..=most).contains(&value) {
            Ok(value)
        } else {
            Err(SensorError::OutOfRange {
                sensor: self.name.clone(),
                option,
                value,
                least,
                most,
            })
        }
    }

    /// As [`Self::number`] for degrees, in radians.
    pub(super) fn angle_rad(
        &self,
        option: &'static str,
        given: Option<f64>,
        default_deg: f64,
        limits_deg: [f64; 2],
    ) -> Result<f64, SensorError> {
        self.number(option, given, default_deg, limits_deg)
            .map(f64::to_radians)
    }

    /// The horizontal field of view (rad), which three kinds have.
    pub(super) fn fov_horizontal_rad(
        &self,
        default_deg: f64,
        limits_deg: [f64; 2],
    ) -> Result<f64, SensorError> {
        self.angle_rad(
            "fov_horizontal_deg",
            self.fov_horizontal_deg,
            default_deg,
            limits_deg,
        )
    }

    /// As [`Self::number`] for a count of at least 1.
    pub(super) fn count(
        &self,
        option: &'static str,
        given: Option<u32>,
        default: u32,
        most: usize,
    ) -> Result<usize, SensorError> {
        let value = f64::from(given.unwrap_or(default));
        self.number(option, Some(value), value, [1.0, most as f64])
            .map(|count| count as usize)
    }

    /// As [`Self::number`] for a share or probability.
    pub(super) fn share(
        &self,
        option: &'static str,
        given: Option<f64>,
        default: f64,
    ) -> Result<f64, SensorError> {
        self.number(option, given, default, [0.0, 1.0])
    }

    /// Refuses a lower limit that is not below its upper limit.
    pub(super) fn ordered(&self, options: [&'static str; 2], low: f64, high: f64) -> Result<(), SensorError> {
        if low < high {
            return Ok(());
        }
        Err(SensorError::WrongOrder {
            sensor: self.name.clone(),
            low: options[0],
            high: options[1],
        })
    }
}
