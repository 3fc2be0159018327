//! What one ray says, whatever sensor it comes from.
//!
//! | the ray says | cells |
//! |---|---|
//! | a hit inside the vehicle's radius | nothing: the sensor sees its own vehicle (counted) |
//! | a hit below the shortest range | hit at that range; nothing is cleared, the obstacle may be nearer |
//! | a hit within the sensor's range | hit; looked through up to the hit, at most to the carve range |
//! | a hit beyond the sensor's range | hit, as far as it goes; nothing is cleared (counted as malformed) |
//! | nothing there | looked through up to the point, at most to the carve range |
//! | nothing there, beyond the sensor's range or below its shortest | nothing (counted as malformed) |

use crate::frame::{Frame, Origin};
use crate::poses::{Pose, PoseHistory, SweepPoses};
use crate::{Counters, FusionConfig};
use jink_shared_types::frames::{BodyFrd, Point};
use jink_shared_types::map::CELL_M;
use nalgebra::{Matrix3, Vector3};

/// A range may exceed the sensor's longest by this factor: noise on a hit, rounding of a "nothing there" point.
const RANGE_SLACK: f64 = 1.01;

/// What is known of a sensor during one frame, checked once.
pub(crate) struct Limits {
    /// Position of the sensor in the body frame (m).
    pub origin_body_m: Vector3<f64>,
    /// Rays are carved up to here (m): the carve range, or the sensor's longest range if that is shorter.
    pub reach_m: f64,
    /// The sensor's shortest range (m).
    pub range_min_m: f64,
    range_max_m: f64,
    vehicle_radius_m: f64,
}

impl Limits {
    /// From a plausible frame's header; nothing if it measures nothing between its shortest and its longest range.
    pub fn of(origin: Point<BodyFrd>, min_m: f32, max_m: f32, config: &FusionConfig) -> Option<Self> {
        let origin_body_m = origin.vector();
        let (range_min_m, range_max_m) = (f64::from(min_m), f64::from(max_m));
        (range_min_m < range_max_m).then(|| Self {
            origin_body_m,
            reach_m: config.carve_range_m.min(range_max_m),
            range_min_m,
            range_max_m,
            vehicle_radius_m: config.vehicle_radius_m,
        })
    }

    /// Whether `range_m` is more than the sensor can measure.
    #[inline]
    pub fn is_beyond(&self, range_m: f64) -> bool {
        range_m.is_nan() || range_m > self.range_max_m * RANGE_SLACK
    }

    /// Whether `range_m` is less than the sensor can measure.
    #[inline]
    pub fn is_below(&self, range_m: f64) -> bool {
        range_m < self.range_min_m
    }

    /// Whether a hit at `body_m` is a part of the vehicle.
    #[inline]
    pub fn is_self(&self, body_m: &Vector3<f64>) -> bool {
        body_m.norm_squared() < self.vehicle_radius_m * self.vehicle_radius_m
    }
}

/// The bench on which one frame is worked.
pub(crate) struct Tracer<'a> {
    pub limits: Limits,
    pub frame: &'a mut Frame,
    pub counters: &'a mut Counters,
    /// Whether any ray has said something about the surroundings.
    pub informed: bool,
    pub sweep: &'a mut SweepPoses,
    pub history: &'a PoseHistory,
    /// Number of this frame.
    pub number: u64,
    /// Rays of one firing share their moment, depth images have only one: the last asked for, and its answer.
    pub offset_10us: Option<u16>,
    pub place: Option<Place>,
}

/// Where the sensor was when a ray was measured.
pub(crate) struct Place {
    /// Takes body coordinates (m) to grid coordinates (cells).
    grid_r_body: Matrix3<f64>,
    body: Vector3<f64>,
    /// The sensor, as origin of rays; nothing if it is out of the window's middle.
    pub origin: Option<Origin>,
}

impl Place {
    fn new(pose: &Pose, limits: &Limits, frame: &Frame) -> Self {
        let mut place = Self {
            grid_r_body: pose.rotation / CELL_M,
            body: frame.grid(&pose.position_m),
            origin: None,
        };
        place.origin = Origin::at(place.grid(&limits.origin_body_m));
        place
    }

    /// Grid coordinates of the point with body coordinates `body_m`.
    #[inline]
    pub fn grid(&self, body_m: &Vector3<f64>) -> Vector3<f64> {
        self.grid_r_body * body_m + self.body
    }
}

impl Tracer<'_> {
    /// With which of `rays` rays this frame begins. What is left out of a frame (see [`crate::frame`]) depends on the
    /// order of its rays: a sensor that repeats itself on a hovering vehicle would leave out the same tenth of all
    /// free cells for ever. Beginning elsewhere every time finds them within a few frames. Steps of the golden ratio
    /// never come back to the same place (Knuth, "The Art of Computer Programming", vol. 3, section 6.4).
    pub fn first_ray(&self, rays: usize) -> usize {
        const GOLDEN_RATIO: u64 = 0x9e37_79b9_7f4a_7c15;
        let fraction = self.number.wrapping_mul(GOLDEN_RATIO);
        ((u128::from(fraction) * rays as u128) >> 64) as usize
    }

    /// Turns [`Tracer::place`] to the moment `offset_10us` after the frame's first ray; `false`, and counted, if the
    /// pose is not known.
    #[inline]
    pub fn turn_to(&mut self, offset_10us: u16) -> bool {
        if self.offset_10us != Some(offset_10us) {
            self.offset_10us = Some(offset_10us);
            let pose = self.sweep.at(offset_10us, self.history);
            self.place = pose.map(|pose| Place::new(&pose, &self.limits, self.frame));
        }
        self.counters.rays_without_pose += u64::from(self.place.is_none());
        self.place.is_some()
    }

    /// The ray, measured at the moment turned to, that ends at `body_m`, `range_m` away from the sensor: there is an
    /// obstacle if `is_hit`, and nothing before it along the first `clear_m`.
    #[inline]
    pub fn enter(&mut self, body_m: &Vector3<f64>, range_m: f64, is_hit: bool, clear_m: f64) {
        let Some(place) = &self.place else {
            return;
        };
        let end = place.grid(body_m);
        self.frame.mark_hit(&end, is_hit);
        if let Some(origin) = &place.origin
            && clear_m > 0.0
        {
            let share = clear_m.min(self.limits.reach_m) / range_m;
            self.frame.carve(origin, &end, share.min(1.0));
        }
    }
}
