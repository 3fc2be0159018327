//! Obstacles that move, as the map's producer tracks them: where they are, how fast, how large.

use crate::frames::{LocalNed, Point, Velocity};
use crate::reserved::Reserved;
use nalgebra::Vector3;

/// Most obstacles in a sample.
pub const MOVING_OBSTACLES: usize = 32;
/// No coordinate is larger than this (m), as in [`crate::proposal`].
const COORDINATE_MAX_M: f64 = 1e6;
/// Nothing that is tracked is faster on an axis than this (m/s).
const SPEED_MAX_MPS: f64 = 100.0;
/// Nothing that is tracked is larger than this (m).
const SIZE_MAX_M: f64 = 50.0;

crate::sample! {
    /// An obstacle that moves: an upright cylinder that holds what was seen of it.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct MovingObstacle: 88 {
        /// Its centre at the capture time of the sample.
        pub position: Point<LocalNed>,
        /// Its velocity.
        pub velocity: Velocity<LocalNed>,
        /// Radius of the cylinder (m).
        pub radius_m: f64,
        /// Half of its height (m).
        pub half_height_m: f64,
        /// Uncertainty of the position on each axis (m, one standard deviation).
        pub position_sd_m: f64,
        /// Uncertainty of the velocity on each axis (m/s, one standard deviation).
        pub velocity_sd_mps: f64,
        /// Number of the track: the same from sample to sample, from 1.
        pub id: u32,
        /// Frames in which it was seen.
        pub frames: u32,
    }
}

crate::sample! {
    /// The obstacles that move, as of the header's capture time.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct MovingObstacles: 2832 {
        /// Obstacles in use.
        pub len: u32,
        /// [`crate::map::LocalMap::epoch`] of the map with the same local frame.
        pub epoch: u32,
        /// Room for later fields, zero.
        pub reserved: Reserved<8>,
        /// The obstacles, the nearest to the vehicle first.
        pub obstacles: [MovingObstacle; MOVING_OBSTACLES],
    }
    plausible if Self::is_consistent
}

impl Default for MovingObstacles {
    fn default() -> Self {
        Self {
            len: 0,
            epoch: 0,
            reserved: Reserved::ZERO,
            obstacles: [MovingObstacle::default(); MOVING_OBSTACLES],
        }
    }
}

impl MovingObstacle {
    /// Where its centre is after `seconds`, if it goes on as it does (local, m).
    pub fn after(&self, seconds: f64) -> Vector3<f64> {
        self.position.vector() + self.velocity.vector() * seconds
    }

    /// Uncertainty of that place on each axis (m, one standard deviation).
    pub fn sd_after_m(&self, seconds: f64) -> f64 {
        self.position_sd_m.hypot(self.velocity_sd_mps * seconds)
    }

    fn is_consistent(&self) -> bool {
        let within = |values: Vector3<f64>, max: f64| values.iter().all(|value| value.abs() <= max);
        let sizes = [
            self.radius_m,
            self.half_height_m,
            self.position_sd_m,
            self.velocity_sd_mps,
        ];
        within(self.position.vector(), COORDINATE_MAX_M)
            && within(self.velocity.vector(), SPEED_MAX_MPS)
            && sizes.iter().all(|size| (0.0..=SIZE_MAX_M).contains(size))
    }
}

impl MovingObstacles {
    /// The obstacles in use.
    pub fn obstacles(&self) -> &[MovingObstacle] {
        &self.obstacles[..(self.len as usize).min(MOVING_OBSTACLES)]
    }

    /// Whether its count fits and all numbers are plausible.
    pub fn is_consistent(&self) -> bool {
        self.len as usize <= MOVING_OBSTACLES && self.obstacles().iter().all(MovingObstacle::is_consistent)
    }

    /// Adds `obstacle`, if there is room.
    pub fn push(&mut self, obstacle: MovingObstacle) {
        if let Some(place) = self.obstacles.get_mut(self.len as usize) {
            *place = obstacle;
            self.len += 1;
        }
    }
}
