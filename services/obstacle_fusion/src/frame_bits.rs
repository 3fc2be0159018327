//! The cells that one cloud or scan reports, before it counts as evidence.
//!
//! | in | out |
//! |---|---|
//! | hit points and rays in grid coordinates | two bit planes: cells with a hit, cells that rays pass through |
//!
//! Grid coordinates are local coordinates in cells, from the window's smallest corner: inside the window they run from
//! 0 to its size, and a cell is the whole part.
//!
//! A ray is carved from its end back to the sensor, cell by cell, with the traversal of Amanatides and Woo ("A fast
//! voxel traversal algorithm for ray tracing", 1987). Three things keep the work nearly independent of the number of
//! points: one ray per end cell, an early exit where earlier rays have been, and a bounded length. All three only ever
//! leave out free cells; those stay what they were until a later frame.
//!
//! The end cell itself is passed through only if the ray is known to continue behind it.
//!
//! Where the user declares that a planar sensor stands for a band above and below its plane, the cells of its rays are
//! copied to the band ([`FrameBits::spread`]), and kept apart: measurements take precedence.

use crate::cells::{BitPlane, SIZE, STRIDE, WORDS, number, offset_in, plane};
use crate::far_window::FarWindow;
use jink_shared_types::map::{CELL_M, Cell};
use nalgebra::Vector3;

/// A ray is no longer carved after this many cells in a row that are free already: towards the sensor rays only get
/// denser. One or two such cells are crossings with other rays; after three hardly any new cell follows.
const FREE_CELLS_TO_STOP: u32 = 3;

/// A ray's parameter runs from 0 to this number, as an integer: additions and comparisons of integers have the lowest
/// latency. 2^40 steps over at most 18 m place a crossing to within 2e-11 m.
const PARAMETER_ONE: f64 = (1u64 << 40) as f64;

/// Parameter of a crossing that does not exist: far above every other, and far from overflow when steps are added.
const NEVER: i64 = 1 << 60;

/// Most rays that are processed together.
const RAYS: usize = 64;
/// Rays that one instruction processes.
const LANES: usize = 4;

/// A ray's origin is at least this many cells away from the window's faces. The vehicle is well inside the window,
/// so that only an implausible origin is not; one cell absorbs the rounding of the last crossing.
const BORDER: f64 = 2.0;

/// The bits of one frame, by offset from the window's smallest cell.
pub(crate) struct FrameBits {
    min_cell: Cell,
    /// Cells in which a ray ended.
    pub hit: Box<BitPlane>,
    /// Cells through which a ray passed; a cell may be in both.
    pub free: Box<BitPlane>,
    /// The same two for the declared band of a planar sensor, without the cells of its rays themselves.
    pub band_hit: Box<BitPlane>,
    pub band_free: Box<BitPlane>,
    has_band: bool,
    /// Cells to which a ray has been carved already.
    ended: Box<BitPlane>,
}

/// Where rays start: a place well inside the window, in grid coordinates.
#[derive(Clone, Copy)]
pub(crate) struct GridOrigin {
    point: Vector3<f64>,
    single: [f32; 3],
}

impl GridOrigin {
    /// `point` (grid) as the origin of rays; nothing if it is not well inside the window.
    pub fn at(point: Vector3<f64>) -> Option<Self> {
        let well_inside = |axis: usize| (BORDER..f64::from(SIZE[axis]) - BORDER).contains(&point[axis]);
        let single = [0, 1, 2].map(|axis| point[axis] as f32);
        (0..3).all(well_inside).then_some(Self { point, single })
    }
}

/// Rays that start at one place, in grid coordinates: their ends, and how much of each is passed through. They are
/// processed together, axis by axis, so that one instruction processes four of them. In single precision a coordinate
/// of the window is good to 1e-5 cells.
pub(crate) struct RayBatch {
    len: usize,
    end: [[f32; RAYS]; 3],
    share: [f32; RAYS],
    is_hit: [bool; RAYS],
}

impl RayBatch {
    pub fn new() -> Self {
        Self {
            len: 0,
            end: [[0.0; RAYS]; 3],
            share: [0.0; RAYS],
            is_hit: [false; RAYS],
        }
    }

    pub fn is_full(&self) -> bool {
        self.len == RAYS
    }

    /// Adds a ray that ends at `end`: there is an obstacle if `is_hit`, and nothing along its first `share` (0..1, zero
    /// for unknown); a `share` below one means that the ray continues behind it.
    #[inline]
    pub fn push(&mut self, end: [f32; 3], share: f32, is_hit: bool) {
        let i = self.len & (RAYS - 1);
        for (ends, end) in self.end.iter_mut().zip(end) {
            ends[i] = end;
        }
        self.share[i] = share;
        self.is_hit[i] = is_hit;
        self.len = i + 1;
    }

    /// Adds to `far` the parts of the rays beyond the fine window, whose smallest corner lies at `offset` (fine cells
    /// from that of `far`).
    pub fn report(&self, origin: Option<&GridOrigin>, far: &mut FarWindow, offset: [f32; 3]) {
        for i in 0..self.len.min(RAYS) {
            let along = |axis: usize| self.end[axis][i] + offset[axis];
            let end = [along(0), along(1), along(2)];
            if self.is_hit[i] & !self.ends_inside(i) {
                far.hit(end);
            }
            if far.is_next()
                && self.share[i] > 0.0
                && let Some(origin) = origin
            {
                let share = self.share[i].min(self.leaves_after(origin, i));
                let from = |axis: usize| {
                    let from = origin.single[axis] + offset[axis];
                    from + (end[axis] - from) * share
                };
                if share < 1.0 {
                    far.look([from(0), from(1), from(2)], end);
                }
            }
        }
    }

    /// The share of ray number `i` after which it leaves the window.
    fn leaves_after(&self, origin: &GridOrigin, i: usize) -> f32 {
        let leaves = |axis: usize| {
            let (from, size) = (origin.single[axis], SIZE[axis] as f32);
            let way = self.end[axis][i] - from;
            (-from / way).max((size - from) / way)
        };
        leaves(0).min(leaves(1)).min(leaves(2))
    }

    /// Cuts the first `count` rays to what lies inside the window and is passed through.
    fn cut(&mut self, origin: &GridOrigin, count: usize) {
        let share = &mut self.share[..count];
        for ((ends, from), size) in self.end.iter_mut().zip(origin.single).zip(SIZE) {
            let size = size as f32;
            for (end, share) in ends[..count].iter_mut().zip(share.iter_mut()) {
                *end -= from;
                let per_cell = 1.0 / *end;
                // The origin lies inside: the ray leaves by the later of two faces, a ray parallel to the faces never.
                let (low, high) = (-from * per_cell, (size - from) * per_cell);
                let leaves = if low > high { low } else { high };
                *share = if leaves < *share { leaves } else { *share };
            }
        }
        for (ends, from) in self.end.iter_mut().zip(origin.single) {
            for (end, share) in ends[..count].iter_mut().zip(share.iter()) {
                *end = from + *end * share;
            }
        }
    }

    /// The cells of the first `count` ends within the window, moved inside if they are not.
    #[inline]
    fn cells(&self, count: usize) -> [i32; RAYS] {
        let mut numbers = [0i32; RAYS];
        for ((ends, size), stride) in self.end.iter().zip(SIZE).zip(STRIDE) {
            let (last, shift) = (size as f32 - 0.5, stride.trailing_zeros());
            for (end, number) in ends[..count].iter().zip(&mut numbers) {
                // Not a number becomes zero.
                let end = if *end > 0.0 { *end } else { 0.0 };
                let end = if end < last { end } else { last };
                *number |= (end as i32) << shift;
            }
        }
        numbers
    }

    /// Whether ray number `i` ends inside the window.
    #[inline]
    fn ends_inside(&self, i: usize) -> bool {
        let inside = |axis: usize| (self.end[axis][i] >= 0.0) & (self.end[axis][i] < SIZE[axis] as f32);
        inside(0) & inside(1) & inside(2)
    }
}

impl FrameBits {
    pub fn new() -> Self {
        Self {
            min_cell: [0; 3],
            hit: plane(),
            free: plane(),
            band_hit: plane(),
            band_free: plane(),
            has_band: false,
            ended: plane(),
        }
    }

    /// Starts an empty frame for the window at `min_cell`.
    pub fn begin(&mut self, min_cell: Cell) {
        self.min_cell = min_cell;
        self.hit.fill(0);
        self.free.fill(0);
        self.ended.fill(0);
        if std::mem::take(&mut self.has_band) {
            self.band_hit.fill(0);
            self.band_free.fill(0);
        }
    }

    /// Copies the cells of the rays `up` cells upwards and `down` cells downwards: obstacles and free cells of the
    /// plane count for the whole band.
    pub fn spread(&mut self, up: usize, down: usize) {
        self.has_band = up + down > 0;
        let slice = STRIDE[2] as usize >> 6;
        for (from, to) in [(&self.hit, &mut self.band_hit), (&self.free, &mut self.band_free)] {
            for (z, rows) in from.chunks_exact(slice).enumerate() {
                if rows.iter().all(|word| *word == 0) {
                    continue;
                }
                // z counts downwards.
                for other in z.saturating_sub(up)..=(z + down).min(SIZE[2] as usize - 1) {
                    for (to, from) in to[other * slice..][..slice].iter_mut().zip(rows) {
                        *to |= from;
                    }
                }
            }
        }
        for index in 0..WORDS {
            let measured = self.hit[index] | self.free[index];
            self.band_hit[index] &= !measured;
            self.band_free[index] &= !(measured | self.band_hit[index]);
        }
    }

    /// Grid coordinates of `point_m` (local).
    pub fn grid(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        point_m / CELL_M - Vector3::from(self.min_cell).cast::<f64>()
    }

    /// Marks `cell` as free; nothing if it is outside the window.
    pub fn mark_free(&mut self, cell: Cell) {
        if let Some(offset) = offset_in(self.min_cell, cell) {
            set(&mut self.free, number(offset), true);
        }
    }

    /// Enters `rays` and clears them: hits inside the window, and, if their origin is known, the cells that they pass
    /// through.
    pub fn enter(&mut self, origin: Option<&GridOrigin>, rays: &mut RayBatch) {
        let count = std::mem::take(&mut rays.len).min(RAYS);
        // Up to a multiple of the lanes, old rays are processed again and not used: the loops have no remainder.
        let padded = count.next_multiple_of(LANES).min(RAYS);
        let numbers = rays.cells(padded);
        for (i, number) in numbers.into_iter().enumerate().take(count) {
            // The bit is written in any case: a branch on whether a ray hit anything would be mispredicted.
            set(
                &mut self.hit,
                number as usize,
                rays.is_hit[i] & rays.ends_inside(i),
            );
        }
        let Some(origin) = origin else {
            return;
        };
        rays.cut(origin, padded);
        let numbers = rays.cells(padded);
        let (mut new, mut new_count) = ([0u8; RAYS], 0);
        for (i, number) in numbers.into_iter().enumerate().take(count) {
            let (number, share) = (number as usize, rays.share[i]);
            // A NaN end is ignored.
            let looks = (share > 0.0) & !rays.end.iter().fold(0.0, |sum, end| sum + end[i]).is_nan();
            set(&mut self.free, number, looks & (share < 1.0));
            let is_new = looks & !set(&mut self.ended, number, looks);
            new[new_count & (RAYS - 1)] = i as u8;
            new_count += usize::from(is_new);
        }
        for i in &new[..new_count] {
            let i = usize::from(*i);
            let end = Vector3::from([0, 1, 2].map(|axis| f64::from(rays.end[axis][i])));
            let number = numbers[i];
            let cell = [
                number & (SIZE[0] - 1),
                (number / STRIDE[1] as i32) & (SIZE[1] - 1),
                number / STRIDE[2] as i32,
            ];
            RayTraversal::back(&origin.point, &end, cell).carve(&mut self.free, number as usize);
        }
    }
}

/// Sets the bit of cell number `number` if `value`; whether it was set before.
#[inline]
fn set(bits: &mut BitPlane, number: usize, value: bool) -> bool {
    let word = &mut bits[(number >> 6) & (WORDS - 1)];
    let was_set = (*word >> (number & 63)) & 1 == 1;
    *word |= u64::from(value) << (number & 63);
    was_set
}

/// The traversal of a ray inside the window, from its end back to its origin.
struct RayTraversal {
    /// Cells from the end, which does not count, to the origin's, which does.
    steps: u32,
    /// Per axis: parameter of the next crossing into a neighbour, and from one crossing to the next.
    next: [i64; 3],
    delta: [i64; 3],
    /// Per axis: what a crossing adds to the number of the cell.
    stride: [i64; 3],
}

impl RayTraversal {
    /// From `end` in `cell` to `origin`, all in grid coordinates.
    #[inline]
    fn back(origin: &Vector3<f64>, end: &Vector3<f64>, cell: [i32; 3]) -> Self {
        let mut path = Self {
            steps: 0,
            next: [NEVER; 3],
            delta: [0; 3],
            stride: [0; 3],
        };
        for axis in 0..3 {
            let crossings = origin[axis] as i32 - cell[axis];
            let face = f64::from(cell[axis] + i32::from(crossings > 0));
            let parameter_per_cell = PARAMETER_ONE / (origin[axis] - end[axis]).abs();
            let first = (face - end[axis]).abs() * parameter_per_cell;
            path.steps += crossings.unsigned_abs();
            path.stride[axis] = STRIDE[axis] * i64::from(crossings.signum());
            if crossings != 0 {
                path.next[axis] = (first as i64).min(NEVER >> 1);
                path.delta[axis] = (parameter_per_cell as i64).min(NEVER >> 1);
            }
        }
        path
    }

    /// Marks every cell of the traversal as free, end cell excluded, until several in a row were free already.
    fn carve(&self, free: &mut BitPlane, end_number: usize) {
        let [mut next_x, mut next_y, mut next_z] = self.next;
        let [delta_x, delta_y, delta_z] = self.delta;
        let [stride_x, stride_y, stride_z] = self.stride;
        let mut cell = end_number as i64;
        let mut free_in_a_row = 0;
        for _ in 0..self.steps {
            // Which face comes first is as good as random: selected by masks made of signs, because a branch would be
            // mispredicted at every other step. Nothing can overflow: parameters stay below 2 * NEVER.
            let x_before_y = next_x.wrapping_sub(next_y) >> 63;
            let x_before_z = next_x.wrapping_sub(next_z) >> 63;
            let y_before_z = next_y.wrapping_sub(next_z) >> 63;
            let along_x = x_before_y & x_before_z;
            let along_y = !x_before_y & y_before_z;
            let along_z = !(along_x | along_y);
            next_x = next_x.wrapping_add(delta_x & along_x);
            next_y = next_y.wrapping_add(delta_y & along_y);
            next_z = next_z.wrapping_add(delta_z & along_z);
            cell = cell.wrapping_add(stride_x & along_x | stride_y & along_y | stride_z & along_z);
            let was_free = set(free, cell as usize, true);
            free_in_a_row = (free_in_a_row + 1) * u32::from(was_free);
            if free_in_a_row == FREE_CELLS_TO_STOP {
                return;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{FrameBits, GridOrigin, RayBatch, set};
    use crate::cells::{SIZE, number};
    use nalgebra::Vector3;
    use proptest::prelude::*;

    /// Error of single precision for a place in the window (cells): 0.02 mm.
    const ROUNDING_CELLS: f64 = 1e-4;

    /// How long the segment from `a` to `b` is inside `cell` enlarged by `margin` on every side, all in cells.
    fn length_inside(a: &Vector3<f64>, b: &Vector3<f64>, cell: [i32; 3], margin: f64) -> f64 {
        let (mut enter, mut leave) = (0.0f64, 1.0f64);
        for axis in 0..3 {
            let (low, high) = (f64::from(cell[axis]) - margin, f64::from(cell[axis] + 1) + margin);
            let along = b[axis] - a[axis];
            let (first, second) = ((low - a[axis]) / along, (high - a[axis]) / along);
            enter = enter.max(first.min(second));
            leave = leave.min(first.max(second));
        }
        (leave - enter).max(0.0) * (b - a).norm()
    }

    fn cell_inside(point: &Vector3<f64>) -> [i32; 3] {
        [0, 1, 2].map(|axis| (point[axis] as i32).clamp(0, SIZE[axis] - 1))
    }

    fn carve(frame: &mut FrameBits, origin: &GridOrigin, end: &Vector3<f64>, share: f64) {
        let mut rays = RayBatch::new();
        rays.push([end.x as f32, end.y as f32, end.z as f32], share as f32, false);
        frame.enter(Some(origin), &mut rays);
    }

    fn is_free(frame: &FrameBits, cell: [i32; 3]) -> bool {
        let number = number(cell);
        frame.free[number >> 6] >> (number & 63) & 1 == 1
    }

    fn near_middle() -> impl Strategy<Value = Vector3<f64>> {
        (50.0..70.0f64, 50.0..70.0f64, 25.0..40.0f64).prop_map(|(x, y, z)| Vector3::new(x, y, z))
    }

    fn anywhere() -> impl Strategy<Value = Vector3<f64>> {
        (-90.0..220.0f64, -90.0..220.0f64, -90.0..150.0f64).prop_map(|(x, y, z)| Vector3::new(x, y, z))
    }

    proptest! {
        #[test]
        fn a_ray_frees_exactly_the_cells_it_crosses(from in near_middle(), to in anywhere(), share in 0.1..1.0f64) {
            let mut frame = FrameBits::new();
            let origin = GridOrigin::at(from).unwrap();
            carve(&mut frame, &origin, &to, share);
            let end = from + (to - from) * share;
            let low = from.inf(&end).map(|c| c.floor() as i32 - 1);
            let high = from.sup(&end).map(|c| c.floor() as i32 + 1);
            let mut crossed = 0;
            for z in low.z.max(0)..=high.z.min(SIZE[2] - 1) {
                for y in low.y.max(0)..=high.y.min(SIZE[1] - 1) {
                    for x in low.x.max(0)..=high.x.min(SIZE[0] - 1) {
                        let cell = [x, y, z];
                        if is_free(&frame, cell) {
                            crossed += 1;
                            prop_assert!(length_inside(&from, &end, cell, ROUNDING_CELLS) > 0.0, "{cell:?} is beside the ray");
                        } else {
                            prop_assert!(length_inside(&from, &end, cell, -ROUNDING_CELLS) == 0.0, "{cell:?} left out");
                        }
                    }
                }
            }
            let freed: u32 = frame.free.iter().map(|word| word.count_ones()).sum();
            prop_assert_eq!(freed, crossed, "cells far from the ray");
        }

        #[test]
        fn the_end_cell_stays_closed_unless_the_ray_goes_on(from in near_middle(), to in near_middle()) {
            let end = cell_inside(&to);
            prop_assume!(cell_inside(&from) != end);
            let origin = GridOrigin::at(from).unwrap();
            let mut frame = FrameBits::new();
            carve(&mut frame, &origin, &to, 1.0);
            prop_assert!(!is_free(&frame, end));
            let far = from + (to - from) * 2.0;
            frame.begin([0; 3]);
            carve(&mut frame, &origin, &far, 0.5);
            prop_assert!(is_free(&frame, cell_inside(&(from + (far - from) * 0.5))));
        }

        #[test]
        fn rays_together_free_no_more_than_each_alone(
            from in near_middle(),
            ends in prop::collection::vec(anywhere(), 1..40),
        ) {
            let origin = GridOrigin::at(from).unwrap();
            let (mut together, mut alone) = (FrameBits::new(), FrameBits::new());
            let mut union = vec![0u64; alone.free.len()];
            for end in &ends {
                carve(&mut together, &origin, end, 0.9);
                alone.begin([0; 3]);
                carve(&mut alone, &origin, end, 0.9);
                union.iter_mut().zip(alone.free.iter()).for_each(|(all, one)| *all |= one);
            }
            prop_assert!(together.free.iter().zip(&union).all(|(some, all)| some & !all == 0));
        }
    }

    #[test]
    fn a_ray_along_an_axis_or_a_face_is_as_good_as_any() {
        for (axis, sign) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0)] {
            let from = Vector3::new(64.0, 64.0, 32.0);
            let mut to = from;
            to[axis] += 10.0 * sign;
            let mut frame = FrameBits::new();
            carve(&mut frame, &GridOrigin::at(from).unwrap(), &to, 1.0);
            let freed: u32 = frame.free.iter().map(|word| word.count_ones()).sum();
            assert!((9..=10).contains(&freed), "{freed} along axis {axis}");
        }
    }

    #[test]
    fn an_origin_near_or_beyond_a_face_is_none() {
        assert!(GridOrigin::at(Vector3::new(64.0, 64.0, 1.9)).is_none());
        assert!(GridOrigin::at(Vector3::new(64.0, 126.1, 32.0)).is_none());
        assert!(GridOrigin::at(Vector3::new(f64::NAN, 64.0, 32.0)).is_none());
        assert!(GridOrigin::at(Vector3::new(64.0, 64.0, 2.1)).is_some());
    }

    #[test]
    fn a_hit_outside_the_window_marks_nothing() {
        let mut frame = FrameBits::new();
        let mut rays = RayBatch::new();
        for wild in [-0.1, 64.1, f32::NAN, 1e30, f32::INFINITY, f32::NEG_INFINITY] {
            rays.push([5.0, 5.0, wild], 0.0, true);
        }
        frame.enter(None, &mut rays);
        assert!(frame.hit.iter().all(|word| *word == 0));
        rays.push([5.9, 6.0, 7.5], 0.0, true);
        frame.enter(None, &mut rays);
        assert!(
            set(&mut frame.hit, number([5, 6, 7]), false),
            "the cell is the whole part"
        );
    }

    #[test]
    fn wild_ends_free_nothing_but_what_lies_in_the_window() {
        let origin = GridOrigin::at(Vector3::new(64.5, 64.5, 32.5)).unwrap();
        for wild in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30] {
            let mut frame = FrameBits::new();
            let mut rays = RayBatch::new();
            rays.push([70.0, wild, 32.5], 1.0, true);
            frame.enter(Some(&origin), &mut rays);
            let freed: u32 = frame.free.iter().map(|word| word.count_ones()).sum();
            assert!(
                freed <= 70 && (wild.abs() < 1e31) == (freed > 0),
                "{wild}: {freed}"
            );
        }
    }
}
