//! The far map: hits beyond the fine window, and the cells that the fine window has left.
//!
//! | in | out |
//! |---|---|
//! | hits beyond the window, some rays as far as they reach, the fine window | [`FarMap`] |
//!
//! Evidence counts per frame as in the fine window, coarser: a hit makes a cell occupied, some frames whose rays pass
//! through it free it again. Inside the fine window, that decides: a far cell is occupied if any fine one in it is, and
//! free if all are.

use crate::cells::{BitPlane, SIZE, STRIDE, bits};
use crate::window::{MapWindow, row};
use jink_shared_types::far_map::{FAR_CELL_M, FAR_X, FAR_Y, FAR_Z, FarMap};
use jink_shared_types::map::{CELL_M, Cell};
use nalgebra::Vector3;

const SIZES: [i32; 3] = [FAR_X as i32, FAR_Y as i32, FAR_Z as i32];
const CELLS: usize = FAR_X * FAR_Y * FAR_Z;
/// Fine cells per cell and axis.
const FINE: i32 = (FAR_CELL_M / CELL_M) as i32;

const _: () = assert!(FINE == 2, "rows of fine cells are taken together in pairs");

/// Evidence: unknown, free, and above that occupied, with growing certainty.
const UNKNOWN: u8 = 0;
const FREE: u8 = 1;
/// A hit adds this: three frames whose rays pass through a cell remove it.
const HIT: u8 = 3;
/// Upper bound: a cell that was hit often is free after this many frames whose rays pass through it.
const EVIDENCE_MAX: u8 = FREE + 6;

/// How far (cells) the vehicle may be off the centre before the window follows.
const HYSTERESIS: i32 = 8;
/// Most rays of a frame that are traced.
const RAYS: usize = 256;
/// Most hits of a frame that are counted: more cells than a sensor of 200,000 points hits beyond the window.
const HITS_MAX: usize = 1 << 16;
/// A ray is traced in steps of this (cells): it misses no more than corners.
const STEP: f32 = 0.5;

/// The window. See the module's text.
pub(crate) struct FarWindow {
    min_cell: Cell,
    evidence: Box<[u8; CELLS]>,
    /// Cells that this frame has marked, and the numbers of those it hit.
    marked: Box<[u64; CELLS / 64]>,
    hits: Vec<u32>,
    passed: Vec<u32>,
    /// Start and end of the traced rays of this frame, in cells from the window's smallest corner.
    rays: Vec<[[f32; 3]; 2]>,
    /// One ray in so many is traced; the number of rays before the next one.
    every: usize,
    next: usize,
}

impl FarWindow {
    /// An unknown window around the local origin.
    pub fn new() -> Self {
        Self {
            min_cell: SIZES.map(|size| -size / 2),
            evidence: jink_shared_types::sample::zeroed_box(),
            marked: jink_shared_types::sample::zeroed_box(),
            hits: Vec::with_capacity(HITS_MAX),
            passed: Vec::with_capacity(HITS_MAX),
            rays: Vec::with_capacity(RAYS),
            every: 1,
            next: 0,
        }
    }

    /// Makes every cell unknown.
    pub fn clear(&mut self) {
        self.evidence.fill(UNKNOWN);
    }

    /// Starts a frame of `rays` rays.
    pub fn begin(&mut self, rays: usize) {
        self.every = rays.div_ceil(RAYS).max(1);
        self.next %= self.every;
        self.rays.clear();
    }

    /// The window's smallest corner in fine cells, from `min_cell` of the fine one.
    pub fn offset(&self, min_cell: Cell) -> [f32; 3] {
        [0, 1, 2].map(|axis| min_cell[axis].wrapping_sub(self.min_cell[axis].wrapping_mul(FINE)) as f32)
    }

    /// There is an obstacle at `point` (fine cells from the window's smallest corner), beyond the fine window.
    #[inline]
    pub fn hit(&mut self, point: [f32; 3]) {
        if let Some(number) = self.number_at(point.map(|along| along / FINE as f32))
            && !self.mark(number)
            && self.hits.len() < HITS_MAX
        {
            self.hits.push(number as u32);
        }
    }

    /// Whether the next ray is to be traced.
    #[inline]
    pub fn is_next(&mut self) -> bool {
        let is_next = self.next == 0;
        self.next = if is_next { self.every - 1 } else { self.next - 1 };
        is_next
    }

    /// Adds a ray without obstacle between two places (fine cells from the window's smallest corner).
    pub fn look(&mut self, from: [f32; 3], to: [f32; 3]) {
        if self.rays.len() < RAYS {
            let cells = |point: [f32; 3]| point.map(|along| along / FINE as f32);
            self.rays.push([cells(from), cells(to)]);
        }
    }

    /// Counts the frame: a cell that was hit does not count as passed through.
    pub fn apply(&mut self) {
        let rays = std::mem::take(&mut self.rays);
        for [from, to] in &rays {
            let way: [f32; 3] = [0, 1, 2].map(|axis| to[axis] - from[axis]);
            let length = way.iter().map(|along| along * along).sum::<f32>().sqrt();
            if !length.is_finite() || length < STEP {
                continue;
            }
            let steps = (length / STEP).min((4 * FAR_X) as f32) as usize;
            let step = way.map(|along| along * (STEP / length));
            // Not the cell in which it ends.
            for i in 0..steps.saturating_sub((1.0 / STEP) as usize) {
                let at = [0, 1, 2].map(|axis| from[axis] + step[axis] * i as f32);
                let Some(number) = self.number_at(at) else {
                    break;
                };
                if !self.mark(number) && self.passed.len() < HITS_MAX {
                    self.passed.push(number as u32);
                }
            }
        }
        self.rays = rays;
        for number in self.hits.drain(..) {
            let evidence = &mut self.evidence[number as usize];
            *evidence = ((*evidence).max(FREE) + HIT).min(EVIDENCE_MAX);
            self.marked[number as usize >> 6] = 0;
        }
        for number in self.passed.drain(..) {
            let evidence = &mut self.evidence[number as usize];
            *evidence = (*evidence).max(FREE + 1) - 1;
            self.marked[number as usize >> 6] = 0;
        }
    }

    /// Marks a cell; whether it was marked.
    #[inline]
    fn mark(&mut self, number: usize) -> bool {
        let word = &mut self.marked[number >> 6];
        let was = (*word >> (number & 63)) & 1 == 1;
        *word |= 1 << (number & 63);
        was
    }

    /// The number of the cell at `point` (cells from the window's smallest corner), if that is inside.
    #[inline]
    fn number_at(&self, point: [f32; 3]) -> Option<usize> {
        let is_inside = (0..3).all(|axis| (0.0..SIZES[axis] as f32).contains(&point[axis]));
        is_inside.then(|| number([0, 1, 2].map(|axis| point[axis] as i32 + self.min_cell[axis])))
    }

    /// Takes over the cells of `window`.
    pub fn absorb(&mut self, window: &MapWindow) {
        let fine_min = window.min_cell();
        // Cells of which all fine ones lie in the window: the window begins in the middle of one if its index is odd.
        let first = fine_min.map(|least| (least + FINE - 1).div_euclid(FINE));
        let count = [0, 1, 2].map(|axis| (fine_min[axis] + SIZE[axis]).div_euclid(FINE) - first[axis]);
        for z in first[2]..first[2] + count[2] {
            for y in first[1]..first[1] + count[1] {
                if !self.holds([self.min_cell[0], y, z]) {
                    continue;
                }
                let [occupied, any, all] = summary(window, y, z);
                let (occupied, any, all) = (pairs_any(occupied), pairs_any(any), pairs_all(all));
                for bit in bits(any | occupied) {
                    // Bits go by the index modulo 64; the window holds 64 of them at most.
                    let x = first[0] + (bit as i32 - first[0]).rem_euclid(64);
                    if x >= first[0] + count[0] || !self.holds([x, y, z]) {
                        continue;
                    }
                    let evidence = &mut self.evidence[number([x, y, z])];
                    if (occupied >> bit) & 1 == 1 {
                        *evidence = EVIDENCE_MAX;
                    } else if (all >> bit) & 1 == 1 {
                        *evidence = FREE;
                    } else {
                        *evidence = (*evidence).max(FREE);
                    }
                }
            }
        }
    }

    fn holds(&self, cell: Cell) -> bool {
        (0..3).all(|axis| (cell[axis].wrapping_sub(self.min_cell[axis]) as u32) < SIZES[axis] as u32)
    }

    /// Slides so that `vehicle` (fine cell) is in the middle of every axis on which it is off by more than
    /// [`HYSTERESIS`].
    pub fn follow(&mut self, vehicle: Cell) {
        for axis in 0..3 {
            let target = vehicle[axis].div_euclid(FINE) - SIZES[axis] / 2;
            let shift = target.wrapping_sub(self.min_cell[axis]);
            if shift.abs() <= HYSTERESIS {
                continue;
            }
            self.min_cell[axis] = target;
            let entering = shift.abs().min(SIZES[axis]);
            let first = if shift > 0 {
                target + SIZES[axis] - entering
            } else {
                target
            };
            for index in first..first + entering {
                self.clear_layer(axis, index);
            }
        }
    }

    fn clear_layer(&mut self, axis: usize, index: i32) {
        let local = (index & (SIZES[axis] - 1)) as usize;
        match axis {
            0 => {
                let rows = self.evidence.chunks_exact_mut(FAR_X);
                rows.for_each(|row| row[local] = UNKNOWN);
            }
            1 => {
                let layers = self.evidence.chunks_exact_mut(FAR_X * FAR_Y);
                layers.for_each(|layer| layer[local * FAR_X..][..FAR_X].fill(UNKNOWN));
            }
            _ => self.evidence[local * FAR_X * FAR_Y..][..FAR_X * FAR_Y].fill(UNKNOWN),
        }
    }

    /// Gives every cell the coordinates that it has after the local frame has moved by `jump_m`, to whole cells.
    pub fn shift(&mut self, jump_m: &Vector3<f64>) {
        let cells = [0, 1, 2].map(|axis| (jump_m[axis] / FAR_CELL_M).round() as i32);
        for (least, by) in self.min_cell.iter_mut().zip(cells) {
            *least = least.wrapping_add(by);
        }
        let [x, y, z] = [0, 1, 2].map(|axis| cells[axis].rem_euclid(SIZES[axis]) as usize);
        for row in self.evidence.chunks_exact_mut(FAR_X) {
            row.rotate_right(x);
        }
        for layer in self.evidence.chunks_exact_mut(FAR_X * FAR_Y) {
            layer.rotate_right(y * FAR_X);
        }
        self.evidence.rotate_right(z * FAR_X * FAR_Y);
    }

    /// Writes every field of the map but its epoch.
    pub fn write(&self, out: &mut FarMap) {
        out.min_cell = self.min_cell;
        out.cell_m = FAR_CELL_M;
        let words = self.evidence.chunks_exact(64);
        let planes = out
            .occupied
            .as_flattened_mut()
            .iter_mut()
            .zip(out.known.as_flattened_mut());
        for (evidence, (occupied, known)) in words.zip(planes) {
            (*occupied, *known) = (0, 0);
            for (bit, evidence) in evidence.iter().enumerate() {
                *occupied |= u64::from(*evidence > FREE) << bit;
                *known |= u64::from(*evidence > UNKNOWN) << bit;
            }
        }
    }
}

/// Number of a cell in the window's memory.
fn number(cell: Cell) -> usize {
    let [x, y, z] = [0, 1, 2].map(|axis| (cell[axis] & (SIZES[axis] - 1)) as usize);
    (z * FAR_Y + y) * FAR_X + x
}

/// Of the four rows of fine cells of row `y` of layer `z`, by the index along x: any occupied, any known, all free.
fn summary(window: &MapWindow, y: i32, z: i32) -> [u128; 3] {
    let (mut occupied, mut any, mut all) = (0, 0, u128::MAX);
    for fine_z in [FINE * z, FINE * z + 1] {
        for fine_y in [FINE * y, FINE * y + 1] {
            let of = |plane: &BitPlane| {
                let (y, z) = (
                    i64::from(fine_y & (SIZE[1] - 1)),
                    i64::from(fine_z & (SIZE[2] - 1)),
                );
                row(plane, (y * STRIDE[1] + z * STRIDE[2]) as usize >> 6)
            };
            let (known, hit) = (of(&window.known), of(&window.occupied));
            occupied |= hit;
            any |= known;
            all &= known & !hit;
        }
    }
    [occupied, any, all]
}

/// Bit `i` is set if bit `2 i` or `2 i + 1` of `row` is.
fn pairs_any(row: u128) -> u64 {
    even_bits(row | row >> 1)
}

/// Bit `i` is set if bits `2 i` and `2 i + 1` of `row` are.
fn pairs_all(row: u128) -> u64 {
    even_bits(row & row >> 1)
}

/// The bits with even numbers, side by side (H. Warren, "Hacker's Delight", section 7-4).
fn even_bits(row: u128) -> u64 {
    let half = |word: u64| {
        let mut word = word & 0x5555_5555_5555_5555;
        for (shift, mask) in [
            (1, 0x3333_3333_3333_3333),
            (2, 0x0f0f_0f0f_0f0f_0f0f),
            (4, 0x00ff_00ff_00ff_00ff),
            (8, 0x0000_ffff_0000_ffff),
            (16, 0x0000_0000_ffff_ffff),
        ] {
            word = (word | word >> shift) & mask;
        }
        word
    };
    half(row as u64) | half((row >> 64) as u64) << 32
}

#[cfg(test)]
mod tests {
    use super::{FINE, FarWindow, HYSTERESIS, SIZES, even_bits};
    use crate::frame_bits::{FrameBits, RayBatch};
    use crate::window::MapWindow;
    use jink_shared_types::far_map::{FAR_CELL_M, FarMap, test};
    use jink_shared_types::map::Cell;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    fn written(far: &FarWindow) -> Box<FarMap> {
        let mut map = FarMap::boxed();
        far.write(&mut map);
        map
    }

    /// One frame: hits in the middles of `hits`, rays along `rays`, all in cells of the map.
    fn frame(far: &mut FarWindow, hits: &[Cell], rays: &[[Cell; 2]]) {
        let fine = |cell: &Cell, min_cell: &Cell| {
            [0, 1, 2].map(|axis| FINE as f32 * ((cell[axis] - min_cell[axis]) as f32 + 0.5))
        };
        let min_cell = far.min_cell;
        far.begin(rays.len());
        for hit in hits {
            far.hit(fine(hit, &min_cell));
        }
        for [from, to] in rays {
            far.look(fine(from, &min_cell), fine(to, &min_cell));
        }
        far.apply();
    }

    fn cells() -> impl Strategy<Value = Vec<Cell>> {
        prop::collection::vec(
            (-100..100i32, -100..100i32, -12..12i32).prop_map(|(x, y, z)| [x, y, z]),
            0..60,
        )
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn even_bits_are_the_bits_with_even_numbers(row in any::<u128>()) {
            let slow = (0..64).fold(0u64, |word, bit| word | (((row >> (2 * bit)) & 1) as u64) << bit);
            prop_assert_eq!(even_bits(row), slow);
        }

        #[test]
        fn a_window_that_slid_knows_what_one_that_was_there_knows(
            hits in cells(), by in (-70..70i32, -70..70i32, -14..14i32)
        ) {
            let vehicle = [by.0 * FINE, by.1 * FINE, by.2 * FINE];
            let mut slid = FarWindow::new();
            let first = slid.min_cell;
            frame(&mut slid, &hits, &[]);
            slid.follow(vehicle);
            let mut there = FarWindow::new();
            there.follow(vehicle);
            let of_old = |cell: &Cell| (0..3).all(|axis| (first[axis]..first[axis] + SIZES[axis]).contains(&cell[axis]));
            let known_before: Vec<Cell> = hits.iter().copied().filter(of_old).collect();
            frame(&mut there, &known_before, &[]);
            prop_assert_eq!(slid.min_cell, there.min_cell);
            prop_assert_eq!(slid.evidence.as_slice(), there.evidence.as_slice());
            let off = |axis: usize| (vehicle[axis].div_euclid(FINE) - SIZES[axis] / 2 - slid.min_cell[axis]).abs();
            prop_assert!((0..3).all(|axis| off(axis) <= HYSTERESIS));
        }

        #[test]
        fn a_frame_that_was_moved_is_one_that_was_made_there(
            hits in cells(), by in (-40..40i32, -40..40i32, -9..9i32)
        ) {
            let by = [by.0, by.1, by.2];
            let mut moved = FarWindow::new();
            frame(&mut moved, &hits, &[]);
            moved.shift(&Vector3::from(by.map(|cells| f64::from(cells) * FAR_CELL_M)));
            let mut there = FarWindow::new();
            there.min_cell = [0, 1, 2].map(|axis| there.min_cell[axis] + by[axis]);
            let moved_hits: Vec<Cell> = hits.iter().map(|hit| [0, 1, 2].map(|axis| hit[axis] + by[axis])).collect();
            frame(&mut there, &moved_hits, &[]);
            prop_assert_eq!(moved.min_cell, there.min_cell);
            prop_assert_eq!(moved.evidence.as_slice(), there.evidence.as_slice());
        }

        #[test]
        fn no_look_frees_what_is_hit_in_the_same_frame(hits in cells(), ends in cells()) {
            let rays: Vec<[Cell; 2]> = ends.iter().map(|end| [[0; 3], *end]).collect();
            let mut far = FarWindow::new();
            for _ in 0..8 {
                frame(&mut far, &hits, &rays);
            }
            let map = written(&far);
            prop_assert!(hits.iter().all(|hit| map.is_occupied(*hit)));
        }
    }

    #[test]
    fn what_is_gone_is_forgotten_after_some_frames_that_look_through_its_place() {
        let mut far = FarWindow::new();
        frame(&mut far, &[[50, 3, 0]], &[]);
        assert!(written(&far).is_occupied([50, 3, 0]));
        let through = [[0, 3, 0], [80, 3, 0]];
        frame(&mut far, &[], &[through]);
        assert!(written(&far).is_occupied([50, 3, 0]), "after one frame");
        for _ in 0..2 {
            frame(&mut far, &[], &[through]);
        }
        let map = written(&far);
        assert!(!map.is_occupied([50, 3, 0]) && test(&map.known, [50, 3, 0]));
        assert!(!test(&map.known, [90, 3, 0]), "behind the end");
    }

    #[test]
    fn what_the_fine_window_leaves_behind_is_remembered_as_it_was_last() {
        let (mut far, mut window, mut seen) = (FarWindow::new(), MapWindow::new(), FrameBits::new());
        // Two hits of the far map, of which the fine window knows better.
        frame(&mut far, &[[20, 0, 0], [20, 1, 0]], &[]);
        let mut hit = RayBatch::new();
        for _ in 0..3 {
            seen.begin(window.min_cell());
            for cell in (0..2).flat_map(|z| (2..4).flat_map(move |y| (40..42).map(move |x| [x, y, z]))) {
                seen.mark_free(cell);
            }
            let along = |axis: usize| ([41, 1, 0][axis] - window.min_cell()[axis]) as f32 + 0.5;
            hit.push([along(0), along(1), along(2)], 0.0, true);
            seen.enter(None, &mut hit);
            window.apply(&seen);
        }
        far.absorb(&window);
        window.follow([-300, 0, 0]);
        far.follow([-60, 0, 0]);
        far.absorb(&window);
        let map = written(&far);
        assert!(map.is_occupied([20, 0, 0]), "one of eight fine cells is");
        assert!(!map.is_occupied([20, 1, 0]) && test(&map.known, [20, 1, 0]));
        assert!(!test(&map.known, [21, 0, 0]));
    }
}
