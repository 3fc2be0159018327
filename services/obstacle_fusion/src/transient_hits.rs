//! Transient hits near the vehicle: hits of a lidar that it does not repeat.
//!
//! | in | out |
//! |---|---|
//! | the cells that a lidar's frame hit, from frame to frame | hits that are withdrawn: their cells are what they were before |
//!
//! A drop of rain, an insect, dust and the sun make a lidar answer where nothing is. Where rays pass behind, the map
//! clears such a cell within a second. Toward the open sky there are no answers, so no ray passes, and one such point
//! close beside the hovering vehicle would hold it there forever. But a real obstacle so near is hit again: at
//! [`NEAR_M`] a cell fills 4 degrees, in which every lidar that covers an area measures many times in
//! [`UNCONFIRMED_S`]. Only time counts in which the cell lies where the sensor looks: between directions that it has
//! answered from, if only by this hit. Filters that drop points without neighbours before they count (R. Rusu and S.
//! Cousins, "3D is here: Point Cloud Library", 2011, statistical outlier removal; N. Charron et al., "De-noising of
//! lidar point clouds corrupted by snowfall", 2018) drop wires with them: here a hit counts at once, and what was
//! unknown before it is so again.

use crate::cells::{SIZE, bits, number, offset_in};
use crate::frame_bits::FrameBits;
use crate::poses::Pose;
use crate::window::{MapWindow, row};
use jink_shared_types::Timestamp;
use jink_shared_types::frames::Point;
use jink_shared_types::map::{CELL_M, Cell, cell_of, center_of};
use jink_shared_types::view::{COLUMNS, FieldOfView, ROWS, bin_of};
use nalgebra::Vector3;

/// Hits farther from the vehicle than this on any axis (m) are not tracked: sensors measure less often in a cell there.
const NEAR_M: f64 = 3.0;
/// A hit at [`NEAR_M`] that is not repeated within this time (s), in view, is withdrawn.
const UNCONFIRMED_S: f64 = 2.0;
/// Nearer ones sooner, in proportion to the distance (the rays that meet a cell grow with its square), but not in less
/// (s).
const UNCONFIRMED_MIN_S: f64 = 0.3;
/// A cell that was hit in so many frames, never so long apart, is a real obstacle.
const FRAMES: u8 = 4;
/// Most time between two frames that counts (s): a silent sensor has not measured.
const FRAME_S: f64 = 0.25;
/// Most hits that are tracked at a time.
const HITS_MAX: usize = 256;

/// A cell that was hit, and is not confirmed yet.
#[derive(Clone, Copy, Debug)]
struct TransientHit {
    cell: Cell,
    sensor: usize,
    /// Whether the cell was known to be free before.
    was_free: bool,
    /// Time in view since then (s).
    unconfirmed_s: f64,
    frames: u8,
}

/// A lidar at the time of a frame.
pub(crate) struct LidarView<'a> {
    /// Its number.
    pub sensor: usize,
    /// Its position (body, m).
    pub origin_m: Vector3<f64>,
    /// Its shortest range (m).
    pub near_m: f64,
    /// The directions that it has ever answered from.
    pub answered: &'a FieldOfView,
    /// Where the vehicle is.
    pub pose: Pose,
    /// The time of the frame.
    pub capture: Timestamp,
}

impl LidarView<'_> {
    fn place_m(&self) -> Vector3<f64> {
        self.pose.position_m + self.pose.rotation * self.origin_m
    }

    /// From the sensor to `cell` (body, m).
    fn direction(&self, cell: Cell) -> Vector3<f64> {
        self.pose.rotation.transpose() * (center_of(cell).vector() - self.place_m())
    }

    /// Whether an obstacle in `cell` would be hit by a lidar with the directions `answered`.
    fn sees(&self, cell: Cell, answered: &FieldOfView, window: &MapWindow) -> bool {
        let from = self.place_m();
        let way = center_of(cell).vector() - from;
        way.norm() > self.near_m + CELL_M
            && is_between(answered, bin_of(&self.direction(cell)))
            && is_open(window, &from, cell)
    }
}

/// The tracked hits.
#[derive(Debug)]
pub(crate) struct TransientHits {
    hits: Vec<TransientHit>,
    /// The last frame of each sensor, and the directions that it has answered from.
    sensors: Vec<(Timestamp, FieldOfView)>,
}

impl TransientHits {
    /// For so many sensors.
    pub fn new(sensors: usize) -> Self {
        Self {
            hits: Vec::with_capacity(HITS_MAX),
            sensors: vec![(Timestamp::NEVER, FieldOfView::default()); sensors],
        }
    }

    /// The map was cleared or moved: cells have other numbers now.
    pub fn clear(&mut self) {
        self.hits.clear();
    }

    /// Updates the hits with the `frame` of a lidar that is not applied to `window` yet; hits are withdrawn from that.
    pub fn look(&mut self, looking: &LidarView<'_>, frame: &FrameBits, window: &mut MapWindow) {
        let (sensor, capture) = (looking.sensor, looking.capture);
        let Some((last, answered)) = self.sensors.get_mut(sensor) else {
            return;
        };
        answered.join(looking.answered);
        let before = std::mem::replace(last, capture);
        let passed_s = if before.is_set() {
            capture.seconds_since(before).clamp(0.0, FRAME_S)
        } else {
            0.0
        };
        let min_cell = window.min_cell();
        self.hits.retain_mut(|hit| {
            let Some(offset) = offset_in(min_cell, hit.cell) else {
                return false;
            };
            let number = number(offset);
            let is_hit = frame.hit[number >> 6] >> (number & 63) & 1 == 1;
            if is_hit {
                hit.frames += 1;
                hit.unconfirmed_s = 0.0;
                return hit.frames < FRAMES;
            }
            if !window.is_occupied(hit.cell) {
                // Rays have passed through it.
                return false;
            }
            if hit.sensor == sensor && looking.sees(hit.cell, answered, window) {
                hit.unconfirmed_s += passed_s;
            }
            let away_m = looking.direction(hit.cell).norm();
            let is_unconfirmed = hit.unconfirmed_s
                >= (UNCONFIRMED_S * away_m / NEAR_M).clamp(UNCONFIRMED_MIN_S, UNCONFIRMED_S);
            if is_unconfirmed {
                window.withdraw(hit.cell, hit.was_free);
            }
            !is_unconfirmed
        });
        let before = self.hits.len();
        add(&mut self.hits, looking, frame, window);
        for hit in &self.hits[before..] {
            answered.add(&looking.direction(hit.cell));
        }
    }
}

/// Adds the cells near the vehicle that were hit for the first time.
fn add(to: &mut Vec<TransientHit>, looking: &LidarView<'_>, frame: &FrameBits, window: &MapWindow) {
    let min_cell = window.min_cell();
    let corner = |m: f64| cell_of(Point::from_vector(looking.pose.position_m.add_scalar(m)));
    let (low, high) = (corner(-NEAR_M), corner(NEAR_M));
    let within = |cell: i32, axis: usize| (cell - min_cell[axis]).clamp(0, SIZE[axis] - 1);
    let [from_x, to_x] = [within(low[0], 0), within(high[0], 0)];
    let near_x = (u128::MAX >> (127 - (to_x - from_x))) << from_x;
    for z in within(low[2], 2)..=within(high[2], 2) {
        for y in within(low[1], 1)..=within(high[1], 1) {
            let hits = row(&frame.hit, number([0, y, z]) >> 6) & near_x;
            for (word, first) in [(hits as u64, 0), ((hits >> 64) as u64, 64)] {
                for bit in bits(word) {
                    let cell = [min_cell[0] + first + bit as i32, min_cell[1] + y, min_cell[2] + z];
                    if to.len() < HITS_MAX && !window.is_occupied(cell) {
                        to.push(TransientHit {
                            cell,
                            sensor: looking.sensor,
                            was_free: window.is_free(cell),
                            unconfirmed_s: 0.0,
                            frames: 1,
                        });
                    }
                }
            }
        }
    }
}

/// Whether a direction lies between two, one above the other, that were answered from: no lidar leaves out a part
/// between.
fn is_between(answered: &FieldOfView, (row, column): (usize, usize)) -> bool {
    let is_seen =
        |row| (column + COLUMNS - 1..=column + COLUMNS + 1).any(|beside| answered.is_seen(row, beside));
    (0..=row).any(is_seen) && (row..ROWS).any(is_seen)
}

/// Whether there is no occupied cell between `from` (local, m) and `cell`.
fn is_open(window: &MapWindow, from: &Vector3<f64>, cell: Cell) -> bool {
    let way = center_of(cell).vector() - from;
    let steps = (way.norm() / (0.5 * CELL_M)).ceil().max(1.0) as u32;
    (0..steps).all(|step| {
        let place = from + way * (f64::from(step) / f64::from(steps));
        let between = cell_of(Point::from_vector(place));
        between == cell || !window.is_occupied(between)
    })
}
