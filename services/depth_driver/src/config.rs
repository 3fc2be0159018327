//! The `[[sensor]]` table of one depth camera. docs/depth_cameras.md lists the keys.
//!
//! Position, mounting, ranges, field of view, image and rate have the keys that the simulator's depth camera has, with
//! the same meaning; keys that only describe a simulated sensor (its noise, its seed) are passed over.

use crate::config_error::DepthConfigError;
use crate::models::{self, DISPARITY_MAX_PX, DISPARITY_SIGMA_PX, DepthCameraModel};
use crate::projection::{Distortion, Intrinsics, Projection};
use jink_runtime::config::sensor_table::SensorKeys;
pub use jink_runtime::config::sensor_table::SensorTable;
use jink_shared_types::frames::Mounting;
use jink_shared_types::ranges::{CLOUD_POINTS, image_bin_px};
use jink_shared_types::{BodyFrd, Point};

/// The kind of sensor that this driver is for.
pub const KIND: &str = "depth_camera";

const KEYS: &[&str] = &[
    "name",
    "kind",
    "model",
    "device",
    "width_px",
    "height_px",
    "rate_hz",
    "delay_ms",
    "fov_horizontal_deg",
    "fov_vertical_deg",
    "fx_px",
    "fy_px",
    "cx_px",
    "cy_px",
    "k1",
    "k2",
    "p1",
    "p2",
    "k3",
    "depth_scale_m",
    "range_min_m",
    "range_max_m",
    "sigma_per_m",
    "flying_pixel_per_m",
    "bin_px",
    "border_px",
    "forward_m",
    "right_m",
    "down_m",
    "orientation",
    "yaw_deg",
    "pitch_deg",
    "roll_deg",
    "quaternion",
];
/// What the simulator's depth camera has besides.
const SIMULATED: &[&str] = &["seed", "sigma_m", "sigma_ratio", "dropout", "edge_mixing"];

/// Images per second (Hz) by default: each D400 offers it at every size.
const RATE_HZ: f64 = 15.0;
/// Largest edge of an image (px): nothing with Z16 is larger, and 4096 x 4096 depths are 32 MiB.
pub const SIZE_MAX_PX: u16 = 4096;
/// One deviation of a depth over its square (1/m) of a camera about which nothing else is known: that of the simulated
/// one.
const SIGMA_PER_M: f64 = 0.005;
/// Least limit of the flying-pixel filter times the focal length (px/m). The inverse depth of a plane at distance `h`
/// changes by `1 / (f h)` a pixel at most: nine keeps planes from 0.11 m on. At f = 447 px, that of a D435, it comes to
/// 0.02 / m.
const FLYING_PX_PER_M: f64 = 9.0;
/// In deviations: of four depths of one surface the greatest and the least are farther apart once in a thousand times.
const FLYING_SIGMAS: f64 = 5.5;

/// One depth camera, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthCameraSpec {
    /// Its name.
    pub name: String,
    /// Its model.
    pub model: &'static DepthCameraModel,
    /// Path of its V4L2 device.
    pub device: String,
    /// Width and height of the image (px).
    pub size_px: [u16; 2],
    /// Images per second (Hz).
    pub rate_hz: f64,
    /// Where its pixels look.
    pub projection: Projection,
    /// Unit of the depths in the image (m).
    pub depth_scale_m: f64,
    /// Shortest and longest range (m), along the ray.
    pub range_m: [f64; 2],
    /// One standard deviation of a depth over its square (1/m).
    pub sigma_per_m: f64,
    /// Greatest difference of inverse depths within 2 x 2 pixels of one surface (1/m); 0 = flying pixels are kept.
    pub flying_pixel_per_m: f64,
    /// Edge of the blocks of pixels of which one point each is made (px).
    pub bin_px: u16,
    /// Width of the edge of the image that is not used (px).
    pub border_px: u16,
    /// Where it sits: of a RealSense its left imager, from which depths count.
    pub position: Point<BodyFrd>,
    /// How it sits: `body_q_sensor`. Forward is the optical axis, right and down are those of the image.
    pub mounting: Mounting,
}

impl DepthCameraSpec {
    /// The depth camera called `name` among all sensors of a configuration.
    ///
    /// # Errors
    /// The first mistake found.
    pub fn find(tables: &[SensorTable], name: &str) -> Result<Self, DepthConfigError> {
        Self::read(&SensorKeys::find(tables, name)?)
    }

    fn read(keys: &SensorKeys<'_>) -> Result<Self, DepthConfigError> {
        keys.check_names(&[KIND], KIND, KEYS, SIMULATED)?;
        // First what does not hang on the model: a wrong one hides nothing else then.
        let offset = |key| keys.number(key, 0.0, -5.0..=5.0);
        let position = Point::new(offset("forward_m")?, offset("right_m")?, offset("down_m")?);
        let mounting = keys.mounting()?;
        let device = device(keys)?;
        let rate_hz = keys.number("rate_hz", RATE_HZ, 2.0..=200.0)?;
        let model = model(keys)?;
        let size_px = [
            keys.count("width_px", model.size_px[0], 16..=SIZE_MAX_PX)?,
            keys.count("height_px", model.size_px[1], 16..=SIZE_MAX_PX)?,
        ];
        let border_px = keys.count("border_px", 0, 0..=size_px[0].min(size_px[1]) / 2 - 4)?;
        let intrinsics = intrinsics(keys, model, size_px)?;
        let projection = Projection::new(size_px, border_px, &intrinsics, &distortion(keys)?);
        let stereo_px_m = model.baseline_m.map(|baseline_m| intrinsics.fx_px * baseline_m);
        let sigma_per_m = keys.number(
            "sigma_per_m",
            stereo_px_m.map_or(SIGMA_PER_M, |stereo| DISPARITY_SIGMA_PX / stereo),
            0.0..=1.0,
        )?;
        let flying_per_m = (FLYING_PX_PER_M / intrinsics.fx_px).max(FLYING_SIGMAS * sigma_per_m);
        Ok(Self {
            name: keys.sensor.to_owned(),
            model,
            device,
            size_px,
            rate_hz,
            projection: projection.map_err(|pixel| DepthConfigError::Distortion {
                sensor: keys.sensor.to_owned(),
                pixel,
            })?,
            depth_scale_m: keys.number("depth_scale_m", 0.001, 1e-6..=0.1)?,
            range_m: ranges(keys, model, stereo_px_m.map(|stereo| stereo / DISPARITY_MAX_PX))?,
            sigma_per_m,
            flying_pixel_per_m: keys.number("flying_pixel_per_m", flying_per_m, 0.0..=10.0)?,
            bin_px: bin_px(keys, size_px, border_px)?,
            border_px,
            position,
            mounting,
        })
    }

    /// Points of one cloud.
    pub fn points(&self) -> usize {
        let [columns, rows] = self.bins();
        columns * rows
    }

    /// Columns and rows of points.
    pub fn bins(&self) -> [usize; 2] {
        self.size_px
            .map(|size_px| used_px(size_px, self.border_px) / usize::from(self.bin_px))
    }
}

/// What a border on both sides leaves of an edge (px).
fn used_px(size_px: u16, border_px: u16) -> usize {
    usize::from(size_px).saturating_sub(2 * usize::from(border_px))
}

fn model(keys: &SensorKeys<'_>) -> Result<&'static DepthCameraModel, DepthConfigError> {
    let name = keys.text("model", models::names)?;
    models::find(name).ok_or_else(|| {
        keys.not_possible("model", format!("{name:?}"), models::names())
            .into()
    })
}

fn device(keys: &SensorKeys<'_>) -> Result<String, DepthConfigError> {
    let possible = || "the path of a V4L2 device, e.g. \"/dev/video0\" or one of /dev/v4l/by-id".to_owned();
    match keys.text("device", possible)? {
        path if path.starts_with('/') => Ok(path.to_owned()),
        other => Err(keys
            .not_possible("device", format!("{other:?}"), possible())
            .into()),
    }
}

/// Intrinsics as given, or of the field of view given, or of the model's for images of 16:9.
fn intrinsics(
    keys: &SensorKeys<'_>,
    model: &DepthCameraModel,
    size_px: [u16; 2],
) -> Result<Intrinsics, DepthConfigError> {
    let first = |among: &[&'static str]| among.iter().copied().find(|key| keys.has(key));
    let in_pixels = first(&["fx_px", "fy_px", "cx_px", "cy_px"]);
    let as_angle = first(&["fov_horizontal_deg", "fov_vertical_deg"]);
    match (in_pixels, as_angle) {
        (Some(key), Some(other)) => Err(DepthConfigError::TwoProjections {
            sensor: keys.sensor.to_owned(),
            key,
            other,
        }),
        (Some(_), None) => {
            let [width, height] = size_px.map(f64::from);
            Ok(Intrinsics {
                fx_px: keys.needed("fx_px", 0.1 * width..=20.0 * width)?,
                fy_px: keys.needed("fy_px", 0.1 * height..=20.0 * height)?,
                cx_px: keys.needed("cx_px", 0.0..=width - 1.0)?,
                cy_px: keys.needed("cy_px", 0.0..=height - 1.0)?,
            })
        }
        (None, Some(_)) => {
            let fov_deg = [
                keys.needed("fov_horizontal_deg", 1.0..=170.0)?,
                keys.needed("fov_vertical_deg", 1.0..=170.0)?,
            ];
            Ok(Intrinsics::of_fov(size_px, fov_deg))
        }
        (None, None) => match model.fov_deg.filter(|_| is_16_to_9(size_px)) {
            Some(fov_deg) => Ok(Intrinsics::of_fov(size_px, fov_deg)),
            None => Err(keys
                .missing(
                "fx_px",
                format!(
                    "fx_px, fy_px, cx_px, cy_px of the camera's calibration, or fov_horizontal_deg and fov_vertical_deg (a {} has \
                     none of its own at {} x {})",
                    model.name, size_px[0], size_px[1]
                ),
            ).into()),
        },
    }
}

/// Whether an image has the proportions for which the models' field of view is known; 848 x 480 counts.
fn is_16_to_9([width_px, height_px]: [u16; 2]) -> bool {
    (f64::from(width_px) / f64::from(height_px) * 9.0 / 16.0 - 1.0).abs() < 0.01
}

fn distortion(keys: &SensorKeys<'_>) -> Result<Distortion, DepthConfigError> {
    let number = |key| keys.number(key, 0.0, -100.0..=100.0);
    Ok(Distortion {
        k1: number("k1")?,
        k2: number("k2")?,
        p1: number("p1")?,
        p2: number("p2")?,
        k3: number("k3")?,
    })
}

fn ranges(
    keys: &SensorKeys<'_>,
    model: &DepthCameraModel,
    nearest_m: Option<f64>,
) -> Result<[f64; 2], DepthConfigError> {
    let min_m = keys.number("range_min_m", nearest_m.unwrap_or(0.2), 0.01..=10.0)?;
    let max_m = keys.number("range_max_m", model.range_max_m, 0.1..=60.0)?;
    if min_m < max_m {
        return Ok([min_m, max_m]);
    }
    let possible = format!("more than range_min_m = {min_m}, up to 60");
    Err(keys.not_possible("range_max_m", max_m, possible).into())
}

fn bin_px(keys: &SensorKeys<'_>, size_px: [u16; 2], border_px: u16) -> Result<u16, DepthConfigError> {
    let used = size_px.map(|size_px| used_px(size_px, border_px));
    let used_u16 = used.map(|used| u16::try_from(used).unwrap_or(u16::MAX));
    let most = used_u16[0].min(used_u16[1]);
    let bin_px = keys.count("bin_px", image_bin_px(used_u16[0], used_u16[1]), 1..=most)?;
    let points = used
        .iter()
        .map(|used| used / usize::from(bin_px))
        .product::<usize>();
    if points <= CLOUD_POINTS {
        return Ok(bin_px);
    }
    let possible = format!("larger, so that at most {CLOUD_POINTS} points remain of the {points}");
    Err(keys.not_possible("bin_px", bin_px, possible).into())
}

#[cfg(test)]
mod tests;
