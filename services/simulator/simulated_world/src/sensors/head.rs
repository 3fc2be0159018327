//! What all kinds of sensor share: where they sit, how far they see, and what a beam reports of what it met.
//!
//! One standard deviation of a range `r` grows as `a + b r + c r^2`: constant for a time-of-flight lidar,
//! proportional for a cheap rangefinder, quadratic for stereo depth (`c = s / (f b)` with disparity noise `s`,
//! focal length `f` and baseline `b`: the error of a triangulated depth).

use super::error::SensorError;
use super::kind::SensorKind;
use super::pose::Pose;
use super::products;
use super::spec::{NoReturn, SensorSpec};
use crate::random::Random;
use crate::world::{Hit, Target, World};
use jink_shared_types::frames::Mounting;
use jink_shared_types::hash;
use jink_shared_types::ranges::{CloudPoint, PointCloud, RayKind};
use jink_shared_types::{BodyFrd, LocalNed, Point, Reserved};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// Reflectivity for which data sheets give their longest ranges.
const LIGHT_SURFACE: f64 = 0.8;
/// Below this cosine of the angle of incidence (beyond 87 deg) pulses begin to be lost; at 90 deg all are.
const GRAZING_COS: f64 = 0.05;
/// Rays nearer to the sun than 2 deg see it, and one in twenty of them takes its light for an answer.
const SUN_COS: f64 = 0.9994;
const SUN_RETURNS: f64 = 0.05;

/// Where the vehicle stands its centre is on the ground, but a real one stands on legs: its sensors are at least this high (m).
/// At height zero nothing of the ground would be seen, and with nothing else in range no frame would have an answer.
const LEGS_M: f64 = 0.15;

/// What differs between the kinds when the spec says nothing.
pub(super) struct HeadDefaults {
    pub range_m: [f64; 2],
    pub sigma_m: f64,
    pub sigma_ratio: f64,
    pub sigma_per_m: f64,
    pub dropout: f64,
}

/// Mounting, range and noise of one sensor.
#[derive(Clone, Debug)]
pub(super) struct Head {
    /// Position in the body (m).
    position: Vector3<f64>,
    body_q_sensor: UnitQuaternion<f64>,
    body_r_sensor: Matrix3<f64>,
    pub range_min_m: f64,
    pub range_max_m: f64,
    /// How far light surfaces answer (m): the longest range or farther.
    answers_m: f64,
    /// It measures with light of its own that comes back: dark and grazing surfaces answer less far, the sun is light, too.
    is_active: bool,
    sigma_m: f64,
    sigma_ratio: f64,
    sigma_per_m: f64,
    dropout: f64,
    /// What a ray without an answer says.
    nothing: Answer,
    pub random: Random,
}

/// Where the sensor looks from at one moment.
pub(super) struct View {
    origin: Point<LocalNed>,
    local_r_body: Matrix3<f64>,
}

/// What one ray says; ranges along the ray (m).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Answer {
    Hit(f64),
    /// Nothing up to the sensor's range.
    Clear,
    Unknown,
}

impl Head {
    pub fn new(spec: &SensorSpec, rig_seed: u64, defaults: &HeadDefaults) -> Result<Self, SensorError> {
        let [near_m, far_m] = defaults.range_m;
        let range_min_m = spec.number("range_min_m", spec.range_min_m, near_m, [0.0, 10.0])?;
        let range_max_m = spec.number("range_max_m", spec.range_max_m, far_m, [0.1, 200.0])?;
        spec.ordered(["range_min_m", "range_max_m"], range_min_m, range_max_m)?;
        let offset = |option, given_m| spec.number(option, Some(given_m), 0.0, [-10.0, 10.0]);
        let body_q_sensor = spec.body_q_sensor()?;
        let product = products::product(spec);
        Ok(Self {
            position: Vector3::new(
                offset("forward_m", spec.forward_m)?,
                offset("right_m", spec.right_m)?,
                offset("down_m", spec.down_m)?,
            ),
            body_q_sensor,
            body_r_sensor: body_q_sensor.to_rotation_matrix().into_inner(),
            range_min_m,
            range_max_m,
            answers_m: product.map_or(range_max_m, |product| product.answers_m.max(range_max_m)),
            is_active: product.is_some_and(|product| product.kind != SensorKind::DepthCamera),
            sigma_m: spec.number("sigma_m", spec.sigma_m, defaults.sigma_m, [0.0, 10.0])?,
            sigma_ratio: spec.share("sigma_ratio", spec.sigma_ratio, defaults.sigma_ratio)?,
            sigma_per_m: spec.share("sigma_per_m", spec.sigma_per_m, defaults.sigma_per_m)?,
            dropout: spec.share("dropout", spec.dropout, defaults.dropout)?,
            nothing: match (spec.no_return, product) {
                (Some(NoReturn::Unknown), _) | (None, Some(_)) => Answer::Unknown,
                (Some(NoReturn::Clear), _) | (None, None) => Answer::Clear,
            },
            random: Random::new(rig_seed.wrapping_add(spec.seed), name_hash(&spec.name)),
        })
    }

    /// Position in the body.
    pub fn origin(&self) -> Point<BodyFrd> {
        Point::from_vector(self.position)
    }

    /// `body_q_sensor`.
    pub fn mounting(&self) -> Mounting {
        Mounting::from_rotation(self.body_q_sensor)
    }

    /// The view of the sensor while the vehicle is at `pose`.
    pub fn view(&self, pose: &Pose) -> View {
        let local_r_body = pose.attitude.to_rotation_matrix().into_inner();
        let mut origin = Point::from_vector(pose.position.vector() + local_r_body * self.position);
        origin.z_m = origin.z_m.min(-LEGS_M);
        View { origin, local_r_body }
    }

    /// A direction of the sensor in body components.
    pub fn to_body(&self, direction: &Vector3<f64>) -> Vector3<f64> {
        self.body_r_sensor * direction
    }

    /// What answers first along the unit vector `direction` (body); may be farther than the longest range.
    pub fn cast(&self, world: &World, view: &View, direction: &Vector3<f64>) -> Option<Hit> {
        world.cast(view.origin, &(view.local_r_body * direction), self.answers_m)
    }

    /// As [`Self::cast`] with a beam of finite width: it misses an object thinner than itself the more often the
    /// thinner the object is, `miss` times for a vanishing one, and then meets what stands behind.
    pub fn cast_beam(
        &mut self,
        world: &World,
        view: &View,
        direction: &Vector3<f64>,
        beam: &Beam,
    ) -> Option<Hit> {
        let hit = self.cast(world, view, direction)?;
        let Target::Obstacle(index) = hit.what else {
            return Some(hit);
        };
        let thickness_m = world.obstacles().get(index).map_or(0.0, |o| o.thickness_m());
        let covered = thickness_m / (beam.width_rad * hit.range_m);
        if covered < 1.0 && self.happens(beam.thin_miss * (1.0 - covered)) {
            let direction = view.local_r_body * direction;
            return world.cast_ignoring(view.origin, &direction, self.answers_m, Some(index));
        }
        Some(hit)
    }

    /// One standard deviation at `range_m` (m).
    pub fn sigma_at_m(&self, range_m: f64) -> f64 {
        self.sigma_m + range_m * (self.sigma_ratio + range_m * self.sigma_per_m)
    }

    /// `range_m` as measured (m), within 0 and the sensor's range.
    pub fn measured_m(&mut self, range_m: f64) -> f64 {
        (range_m + self.sigma_at_m(range_m) * self.random.normal()).clamp(0.0, self.range_max_m)
    }

    /// True with `probability`.
    pub fn happens(&mut self, probability: f64) -> bool {
        probability > 0.0 && self.random.unit() < probability
    }

    /// Too near to be measured: that something is there is lost, so nothing may be called clear.
    pub fn is_too_near(&self, hit: Option<&Hit>) -> bool {
        hit.is_some_and(|hit| hit.range_m < self.range_min_m)
    }

    /// What a ray says of what it met, but for its noise: what is too dark, or looked at along its surface, answers as if nothing were
    /// there.
    pub fn answer(&mut self, world: &World, hit: Option<&Hit>) -> Answer {
        match hit {
            None => self.nothing,
            Some(hit) if self.is_active && self.is_lost(world, hit) => self.nothing,
            Some(hit) if hit.range_m > self.range_max_m => Answer::Clear,
            Some(hit) => Answer::Hit(hit.range_m),
        }
    }

    /// Whether too little light comes back: it grows with the reflectivity and falls with the square of the range, and beyond a grazing
    /// angle it goes elsewhere.
    fn is_lost(&mut self, world: &World, hit: &Hit) -> bool {
        let reach_m = self.answers_m * (world.reflectivity(hit.what) / LIGHT_SURFACE).sqrt();
        hit.range_m > reach_m || self.happens(1.0 - hit.incidence_cos / GRAZING_COS)
    }

    /// What the sun makes of a ray along `direction` (body) that met nothing: now and then a return from somewhere.
    pub fn dazzled(&mut self, world: &World, view: &View, direction: &Vector3<f64>) -> Option<f64> {
        let is_near = self.is_active && self.sun_cos(world, view, direction) > SUN_COS;
        (is_near && self.happens(SUN_RETURNS))
            .then(|| self.random.between(self.range_min_m, self.range_max_m))
    }

    /// The cosine of the angle between `direction` (body) and the sun.
    pub fn sun_cos(&self, world: &World, view: &View, direction: &Vector3<f64>) -> f64 {
        (view.local_r_body * direction).dot(&world.sun())
    }

    /// Whether a ray gives no answer.
    pub fn drops_out(&mut self) -> bool {
        self.happens(self.dropout)
    }

    /// Writes a cloud's fixed part and empties it.
    pub fn begin_cloud(&self, cloud: &mut PointCloud) {
        cloud.origin = self.origin();
        cloud.range_min_m = self.range_min_m as f32;
        cloud.range_max_m = self.range_max_m as f32;
        cloud.range_sigma_m = self.sigma_at_m(self.range_max_m) as f32;
        cloud.len = 0;
        cloud.reserved = Reserved::ZERO;
    }

    /// The end of one ray along `direction` (body).
    pub fn point(&self, direction: &Vector3<f64>, answer: Answer, offset_10us: u16) -> CloudPoint {
        let (end, kind) = match answer {
            Answer::Hit(range_m) => (self.position + direction * range_m, RayKind::Hit),
            Answer::Clear => (self.position + direction * self.range_max_m, RayKind::Clear),
            Answer::Unknown => (Vector3::zeros(), RayKind::Unknown),
        };
        CloudPoint {
            forward_m: end.x as f32,
            right_m: end.y as f32,
            down_m: end.z as f32,
            offset_10us,
            kind: kind.into(),
            reserved: Reserved::ZERO,
        }
    }
}

/// A beam's cross-section.
#[derive(Clone, Copy, Debug)]
pub(super) struct Beam {
    /// Full opening angle (rad).
    pub width_rad: f64,
    /// Probability of missing an object of no thickness.
    thin_miss: f64,
}

impl Beam {
    pub fn new(spec: &SensorSpec) -> Result<Self, SensorError> {
        // 5 cm at 10 m, as small time-of-flight lidars have.
        Ok(Self {
            width_rad: spec.angle_rad("beam_width_deg", spec.beam_width_deg, 0.3, [0.0, 90.0])?,
            thin_miss: spec.share("thin_miss", spec.thin_miss, 0.5)?,
        })
    }
}

/// A sensor's noise depends on its name, so that adding another sensor changes nothing for it.
fn name_hash(name: &str) -> u64 {
    hash::bytes(hash::START, name.as_bytes())
}
