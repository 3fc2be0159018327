//! A range image: how far a sensor has seen in each direction around a place.

use jink_shared_types::sample::zeroed_box;
use nalgebra::Vector3;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Directions around, and from straight down to straight up: bins of 3 degrees. Coarser ones hide a trunk that stands
/// beside its place.
const COLUMNS: usize = 120;
const ROWS: usize = 60;
const BINS: usize = COLUMNS * ROWS;
const STEP_RAD: f64 = TAU / COLUMNS as f64;
/// A bin and its neighbours have a result if so many rays have gone there.
const RAYS_MIN: u32 = 3;
/// A distance differs if it does by more than this (m), and this share of it: noise, errors of poses, edges.
const SLACK_M: f32 = 0.3;
const SLACK_RATIO: f32 = 0.05;

/// Whether something at a distance agrees with a range image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RangeAgreement {
    /// Rays pass through there.
    SeenThrough,
    /// Rays end about there.
    Agrees,
    /// It was hidden, or no ray has gone there.
    Unknown,
}

/// Shortest and longest distance in each direction (m), and how many rays.
pub(super) struct RangeImage {
    near_m: Box<[f32; BINS]>,
    far_m: Box<[f32; BINS]>,
    rays: Box<[u8; BINS]>,
    /// Directions count around only, distances horizontally.
    is_planar: bool,
}

impl RangeImage {
    pub fn new() -> Self {
        Self {
            near_m: zeroed_box(),
            far_m: zeroed_box(),
            rays: zeroed_box(),
            is_planar: false,
        }
    }

    pub fn clear(&mut self, is_planar: bool) {
        self.rays.fill(0);
        self.is_planar = is_planar;
    }

    /// Row, column and distance of what is `offset_m` (local) away.
    fn bin(&self, offset_m: &Vector3<f64>) -> (usize, usize, f32) {
        let level_m = offset_m.xy().norm();
        let column = ((offset_m.y.atan2(offset_m.x) + PI) / STEP_RAD) as usize % COLUMNS;
        if self.is_planar {
            return (ROWS / 2, column, level_m as f32);
        }
        let up_rad = (-offset_m.z).atan2(level_m);
        let row = (((up_rad + FRAC_PI_2) / STEP_RAD) as usize).min(ROWS - 1);
        (row, column, offset_m.norm() as f32)
    }

    /// Adds a ray that goes as far as `offset_m`.
    pub fn add(&mut self, offset_m: &Vector3<f64>) {
        let (row, column, distance_m) = self.bin(offset_m);
        let bin = row * COLUMNS + column;
        if self.rays[bin] == 0 {
            (self.near_m[bin], self.far_m[bin]) = (distance_m, distance_m);
        } else {
            self.near_m[bin] = self.near_m[bin].min(distance_m);
            self.far_m[bin] = self.far_m[bin].max(distance_m);
        }
        self.rays[bin] = self.rays[bin].saturating_add(1);
    }

    /// Compares something at `offset_m` with the rays.
    pub fn judge(&self, offset_m: &Vector3<f64>) -> RangeAgreement {
        let (row, column, distance_m) = self.bin(offset_m);
        // In bins without rays, a continued wall comes nearer.
        if self.rays[row * COLUMNS + column] == 0 {
            return RangeAgreement::Unknown;
        }
        let (mut near_m, mut far_m, mut rays) = (f32::INFINITY, 0.0f32, 0u32);
        for row in row.saturating_sub(1)..=(row + 1).min(ROWS - 1) {
            for turn in [COLUMNS - 1, 0, 1] {
                let bin = row * COLUMNS + (column + turn) % COLUMNS;
                if self.rays[bin] > 0 {
                    near_m = near_m.min(self.near_m[bin]);
                    far_m = far_m.max(self.far_m[bin]);
                    rays += u32::from(self.rays[bin]);
                }
            }
        }
        let slack_m = SLACK_M + SLACK_RATIO * distance_m;
        if rays < RAYS_MIN || distance_m > far_m + slack_m {
            RangeAgreement::Unknown
        } else if distance_m < near_m - slack_m {
            RangeAgreement::SeenThrough
        } else {
            RangeAgreement::Agrees
        }
    }
}
