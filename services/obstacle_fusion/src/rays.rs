//! What one ray reports, for every sensor.
//!
//! | ray | cells |
//! |---|---|
//! | a hit inside the vehicle's radius | nothing: the sensor sees its own vehicle (counted) |
//! | a hit below the shortest range | hit at that range; nothing is cleared, the obstacle may be nearer |
//! | a hit within the sensor's range | hit; cleared up to the hit, at most to the carve range |
//! | a hit beyond the sensor's range | hit at its range; nothing is cleared (counted as malformed) |
//! | nothing there | cleared up to the point, at most to the carve range |
//! | nothing there, beyond the sensor's range or below its shortest | nothing (counted as malformed) |

use crate::far_window::FarWindow;
use crate::frame_bits::{FrameBits, GridOrigin, RayBatch};
use crate::poses::{Pose, SweepPoses};
use crate::{FusionConfig, RejectedCounts};
use jink_shared_types::frames::{BodyFrd, Point};
use jink_shared_types::map::CELL_M;
use jink_shared_types::pose_history::PoseHistory;
use nalgebra::Vector3;

/// A range may exceed the sensor's longest by this factor: noise on a hit, rounding of a "nothing there" point.
const RANGE_SLACK: f32 = 1.01;

/// log2 of the units of 10 us that share one pose: 80 us, off by 40 us at most. At 10 rad/s that moves a point 12 m
/// away by 5 mm, and at 20 m/s every point by 0.8 mm.
const MOMENT_SHIFT: u32 = 3;

/// A sensor's geometry and ranges for one frame, checked once.
pub(crate) struct SensorLimits {
    /// Position of the sensor in the body frame (m).
    pub origin_body_m: Vector3<f64>,
    /// Rays are carved up to here (m): the carve range, or the sensor's longest range if that is shorter.
    pub reach_m: f64,
    /// The sensor's shortest range (m).
    pub range_min_m: f64,
    /// The same two in single precision, and the longest range with what it may be exceeded by.
    origin: [f32; 3],
    range_min: f32,
    range_max: f32,
    vehicle_radius_m: f32,
}

impl SensorLimits {
    /// From a plausible frame's header; nothing if it measures nothing between its shortest and its longest range.
    pub fn of(origin: Point<BodyFrd>, min_m: f32, max_m: f32, config: &FusionConfig) -> Option<Self> {
        let origin_body_m = origin.vector();
        let (range_min_m, range_max_m) = (f64::from(min_m), f64::from(max_m));
        (range_min_m < range_max_m).then(|| Self {
            origin_body_m,
            reach_m: config.carve_range_m.min(range_max_m),
            range_min_m,
            origin: [0, 1, 2].map(|axis| origin_body_m[axis] as f32),
            range_min: min_m,
            range_max: max_m * RANGE_SLACK,
            vehicle_radius_m: config.vehicle_radius_m as f32,
        })
    }

    /// Distance (m) of `body_m` from the sensor.
    #[inline]
    pub fn range_m(&self, body_m: [f32; 3]) -> f32 {
        let ([x, y, z], [from_x, from_y, from_z]) = (body_m, self.origin);
        norm_squared([x - from_x, y - from_y, z - from_z]).sqrt()
    }

    /// Whether `range_m` is more than the sensor can measure.
    #[inline]
    pub fn is_beyond(&self, range_m: f32) -> bool {
        range_m.is_nan() | (range_m > self.range_max)
    }

    /// Whether `range_m` is less than the sensor can measure.
    #[inline]
    pub fn is_below(&self, range_m: f32) -> bool {
        range_m < self.range_min
    }

    /// Whether a hit at `body_m` is a part of the vehicle.
    #[inline]
    pub fn is_self(&self, body_m: [f32; 3]) -> bool {
        norm_squared(body_m) < self.vehicle_radius_m * self.vehicle_radius_m
    }
}

#[inline]
fn norm_squared([x, y, z]: [f32; 3]) -> f32 {
    x * x + y * y + z * z
}

/// Traces the rays of one frame.
pub(crate) struct RayTracer<'a> {
    pub limits: SensorLimits,
    pub frame: &'a mut FrameBits,
    pub far: &'a mut FarWindow,
    /// The fine window's smallest corner, in fine cells from the far map's.
    pub far_offset: [f32; 3],
    pub counters: &'a mut RejectedCounts,
    /// Whether any ray has reported something of the surroundings.
    pub has_information: bool,
    pub sweep: &'a mut SweepPoses,
    pub history: &'a PoseHistory,
    /// Number of this frame.
    pub number: u64,
    /// Rays of one firing share their time, depth images have only one: the last time slot, the sensor's pose in it,
    /// and its rays that are not entered yet.
    pub time_slot: Option<u16>,
    pub place: Option<SensorPose>,
    pub rays: RayBatch,
}

/// The sensor's pose when a ray was measured.
pub(crate) struct SensorPose {
    /// Takes body coordinates (m) to grid coordinates (cells): columns, and the body's origin.
    grid_r_body: [[f32; 3]; 3],
    body: [f32; 3],
    /// The sensor, as origin of rays; nothing if it is not well inside the window.
    pub origin: Option<GridOrigin>,
}

impl SensorPose {
    fn new(pose: &Pose, limits: &SensorLimits, frame: &FrameBits) -> Self {
        let rotation = pose.rotation * (1.0 / CELL_M);
        let body = frame.grid(&pose.position_m);
        Self {
            grid_r_body: [0, 1, 2].map(|column| [0, 1, 2].map(|row| rotation[(row, column)] as f32)),
            body: [0, 1, 2].map(|axis| body[axis] as f32),
            origin: GridOrigin::at(rotation * limits.origin_body_m + body),
        }
    }

    /// Grid coordinates of the point with body coordinates `body_m`.
    #[inline]
    fn grid(&self, [forward_m, right_m, down_m]: [f32; 3]) -> [f32; 3] {
        let [forward, right, down] = &self.grid_r_body;
        let along = |axis: usize| {
            (forward[axis] * forward_m + right[axis] * right_m) + (down[axis] * down_m + self.body[axis])
        };
        [along(0), along(1), along(2)]
    }
}

impl RayTracer<'_> {
    /// With which of `rays` rays this frame begins. The cells that are left out of a frame (see [`crate::frame_bits`])
    /// depend on the order of its rays: for a sensor with the same directions in every frame, on a hovering vehicle,
    /// the same tenth of all free cells would be left out forever. With another beginning every time they are found
    /// within a few frames. Multiples of the golden ratio never repeat a place (Knuth, "The Art of Computer
    /// Programming", vol. 3, section 6.4).
    pub fn first_ray(&self, rays: usize) -> usize {
        const GOLDEN_RATIO: u64 = 0x9e37_79b9_7f4a_7c15;
        let fraction = self.number.wrapping_mul(GOLDEN_RATIO);
        ((u128::from(fraction) * rays as u128) >> 64) as usize
    }

    /// Sets [`RayTracer::place`] to the time `offset_10us` after the frame's first ray; `false`, and counted, if the
    /// pose is not known.
    #[inline]
    pub fn set_time(&mut self, offset_10us: u16) -> bool {
        let time_slot = offset_10us >> MOMENT_SHIFT;
        if self.time_slot != Some(time_slot) {
            self.flush();
            self.time_slot = Some(time_slot);
            let middle = time_slot << MOMENT_SHIFT | 1 << (MOMENT_SHIFT - 1);
            let pose = self.sweep.at(middle, self.history);
            self.place = pose.map(|pose| SensorPose::new(&pose, &self.limits, self.frame));
        }
        self.counters.rays_without_pose += u64::from(self.place.is_none());
        self.place.is_some()
    }

    /// Adds a ray, measured at the time that was set, that ends at `body_m`, `range_m` away from the sensor: there is
    /// an obstacle if `is_hit`, and nothing before it along the first `clear_m`.
    #[inline]
    pub fn enter(&mut self, body_m: [f32; 3], range_m: f32, is_hit: bool, clear_m: f32) {
        let Some(place) = &self.place else {
            return;
        };
        let clear_m = clear_m.min(self.limits.reach_m as f32);
        let share = if clear_m < range_m { clear_m / range_m } else { 1.0 };
        let share = if clear_m > 0.0 { share } else { 0.0 };
        self.rays.push(place.grid(body_m), share, is_hit);
        if self.rays.is_full() {
            self.flush();
        }
    }

    /// Enters the rays that are collected into the frame.
    pub fn flush(&mut self) {
        let origin = self.place.as_ref().and_then(|place| place.origin.as_ref());
        self.rays.report(origin, self.far, self.far_offset);
        self.frame.enter(origin, &mut self.rays);
    }
}
