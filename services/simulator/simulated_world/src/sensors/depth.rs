//! A depth camera: a pinhole with a global shutter, noise of a stereo pair, holes and mixed pixels at depth edges.
//!
//! Depth is measured along the optical axis (the sensor's forward axis); pixels run row by row from the upper left.
//! What a stereo pair cannot match (surfaces seen at grazing angles, random holes, what is too near) is unknown,
//! never clear.

use super::error::SensorError;
use super::head::{Answer, Head, HeadDefaults};
use super::pose::PoseCursor;
use super::products::product;
use super::spec::SensorSpec;
use crate::world::World;
use jink_shared_types::Timestamp;
use jink_shared_types::ranges::{CLOUD_POINTS, PointCloud, image_bin_px};
use nalgebra::Vector3;

pub(super) const DEFAULT_RATE_HZ: f64 = 15.0;

/// Below this cosine of the angle of incidence (beyond 75 deg) matches begin to fail; at 90 deg all do.
const GRAZING_COS: f64 = 0.26;

/// Two neighbours whose depths differ by more than this share of the nearer one lie on different surfaces.
const EDGE: f64 = 0.1;

/// Time of exposure (ns): what the image turns by in it is smeared.
const EXPOSURE_NS: u64 = 8_000_000;
/// Turned by so much during the exposure no pixel finds its match any more: 16 pixels of a D435's image (rad).
const UNMATCHED_RAD: f64 = 0.036;
/// Nearer to the sun than this (cosine of 10 deg) every other pixel is lost in its glare.
const GLARE_COS: f64 = 0.985;

#[derive(Clone, Debug)]
pub(super) struct DepthCamera {
    head: Head,
    width_px: usize,
    edge_mixing: f64,
    /// Real ones are blurred by motion, and dazzled.
    is_product: bool,
    /// Per pixel: unit direction in the body, and its share along the optical axis.
    directions: Vec<(Vector3<f64>, f64)>,
    /// True depth of each pixel (m): infinity for nothing in range, NaN for no match.
    depths_m: Vec<f64>,
}

impl DepthCamera {
    pub fn new(spec: &SensorSpec, rig_seed: u64) -> Result<Self, SensorError> {
        let head = Head::new(
            spec,
            rig_seed,
            &HeadDefaults {
                range_m: [0.2, 4.0],
                sigma_m: 0.0,
                sigma_ratio: 0.0,
                // Disparity noise 0.1 px, focal length 380 px, baseline 5 cm.
                sigma_per_m: 0.005,
                dropout: 0.01,
            },
        )?;
        let width_px = spec.count("width_px", spec.width_px, 160, CLOUD_POINTS)?;
        let height_px = spec.count("height_px", spec.height_px, 120, CLOUD_POINTS)?;
        let (width_px, height_px) = binned(spec, width_px, height_px)?;
        if width_px * height_px > CLOUD_POINTS {
            return Err(SensorError::TooManyPixels {
                sensor: spec.name.clone(),
                width_px,
                height_px,
            });
        }
        let half_width = (0.5 * spec.fov_horizontal_rad(90.0, [1.0, 170.0])?).tan();
        let vertical_rad = spec.angle_rad("fov_vertical_deg", spec.fov_vertical_deg, 75.0, [1.0, 170.0])?;
        let half_height = (0.5 * vertical_rad).tan();
        // Place of a pixel's centre on the image plane at depth 1.
        let place =
            |index: usize, count: usize, half: f64| ((2 * index + 1) as f64 / count as f64 - 1.0) * half;
        let directions = (0..width_px * height_px)
            .map(|pixel| {
                let right = place(pixel % width_px, width_px, half_width);
                let down = place(pixel / width_px, height_px, half_height);
                let direction = Vector3::new(1.0, right, down).normalize();
                (head.to_body(&direction), direction.x)
            })
            .collect();
        Ok(Self {
            head,
            width_px,
            is_product: product(spec).is_some(),
            edge_mixing: spec.share("edge_mixing", spec.edge_mixing, 0.5)?,
            directions,
            depths_m: vec![f64::NAN; width_px * height_px],
        })
    }

    /// One image, taken at `time`.
    pub fn render(
        &mut self,
        world: &World,
        poses: &mut PoseCursor<'_>,
        time: Timestamp,
        cloud: &mut PointCloud,
    ) {
        self.head.begin_cloud(cloud);
        cloud.first_point = time;
        self.measure(world, poses, time);
        for (pixel, (direction, axial)) in self.directions.iter().enumerate() {
            let depth_m = self.depths_m[pixel];
            let answer = if depth_m.is_nan() {
                Answer::Unknown
            } else if depth_m.is_infinite() {
                Answer::Clear
            } else {
                let seen_m = mixed_m(
                    &self.depths_m,
                    self.width_px,
                    pixel,
                    self.edge_mixing,
                    &mut self.head,
                );
                let measured_m = seen_m + self.head.sigma_at_m(seen_m) * self.head.random.normal();
                Answer::Hit((measured_m / axial).clamp(0.0, self.head.range_max_m))
            };
            cloud.push(self.head.point(direction, answer, 0));
        }
    }

    /// Fills `depths_m` with what an ideal sensor with these blind spots would see.
    fn measure(&mut self, world: &World, poses: &mut PoseCursor<'_>, time: Timestamp) {
        let pose = poses.at(time);
        let before = poses.at(Timestamp::from_ns(time.ns.saturating_sub(EXPOSURE_NS)));
        let smeared_rad = pose.attitude.angle_to(&before.attitude);
        let smeared = (smeared_rad / UNMATCHED_RAD).min(1.0);
        let view = self.head.view(&pose);
        for ((direction, axial), depth_m) in self.directions.iter().zip(&mut self.depths_m) {
            let hit = self.head.cast(world, &view, direction);
            let grazing = hit.map_or(0.0, |hit| 1.0 - hit.incidence_cos / GRAZING_COS);
            let glare = self.head.sun_cos(world, &view, direction) > GLARE_COS;
            let fails = self.head.is_too_near(hit.as_ref())
                || self.head.happens(grazing)
                || self.head.drops_out()
                || self.is_product && (self.head.happens(smeared) || glare && self.head.happens(0.5));
            *depth_m = match self.head.answer(world, hit.as_ref()) {
                _ if fails => f64::NAN,
                Answer::Hit(range_m) => range_m * axial,
                Answer::Clear => f64::INFINITY,
                Answer::Unknown => f64::NAN,
            };
        }
    }
}

/// The nearest number of pixels that an image may have in a row or column.
fn of_u16(count_px: usize) -> u16 {
    u16::try_from(count_px).unwrap_or(u16::MAX)
}

/// The image as its driver hands it on: a real camera's pixels in blocks, as many as `bin_px` says, or its driver takes without it.
fn binned(spec: &SensorSpec, width_px: usize, height_px: usize) -> Result<(usize, usize), SensorError> {
    let default_px = match spec.device {
        Some(_) => image_bin_px(of_u16(width_px), of_u16(height_px)),
        None => 1,
    };
    let bin_px = spec.count("bin_px", spec.bin_px, default_px.into(), width_px.min(height_px))?;
    Ok((width_px / bin_px, height_px / bin_px))
}

/// The depth of `pixel`, drawn towards its right or lower neighbour if that lies on another surface: the pixel's
/// footprint covers both (m).
fn mixed_m(depths_m: &[f64], width_px: usize, pixel: usize, mixing: f64, head: &mut Head) -> f64 {
    let own_m = depths_m[pixel];
    let right = (!(pixel + 1).is_multiple_of(width_px)).then_some(pixel + 1);
    for neighbour in [right, Some(pixel + width_px)].into_iter().flatten() {
        let Some(other_m) = depths_m.get(neighbour).copied().filter(|depth| depth.is_finite()) else {
            continue;
        };
        if (other_m - own_m).abs() > EDGE * own_m.min(other_m) {
            return own_m + mixing * head.random.unit() * (other_m - own_m);
        }
    }
    own_m
}
