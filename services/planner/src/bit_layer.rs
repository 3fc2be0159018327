//! Bit layers over the local map's window and their dilation by a structuring element.
//!
//! A layer holds one `u128` per row of cells. Addressing is modular like the map's, so that shifting along an axis is a
//! rotation; what wraps over the window's seam is harmless because the outermost shell of cells always counts as
//! unknown (see [`BitLayer::load_unsafe`]).
//!
//! Dilation is exact on the safe side: a cell is set if *any* point in it is nearer than the radius to *any* point of a
//! set cell, so that a vehicle anywhere in an unset cell has at least the radius of clearance. What that loses to the
//! size of cells is half as much in a layer of half cells, which covers the middle of the window
//! ([`BitLayer::load_halves`]).

use jink_shared_types::map::{CELL_M, Cell, LocalMap, Plane, ROWS, SIZE_X, SIZE_Y, SIZE_Z, bit_of, row_of};

/// One bit per cell of the window.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BitLayer {
    rows: Vec<u128>,
}

impl Default for BitLayer {
    fn default() -> Self {
        Self { rows: vec![0; ROWS] }
    }
}

/// The row of a plane as one number.
fn row(plane: &Plane, index: usize) -> u128 {
    u128::from(plane[index][0]) | u128::from(plane[index][1]) << 64
}

impl BitLayer {
    /// Adds the cells of another.
    pub fn add(&mut self, other: &Self) {
        for (row, more) in self.rows.iter_mut().zip(&other.rows) {
            *row |= more;
        }
    }

    /// Whether the bit of `cell` is set; the caller ensures that the cell is inside the window.
    pub fn test(&self, cell: Cell) -> bool {
        self.rows[row_of(cell)] >> bit_of(cell) & 1 == 1
    }

    /// Sets the bit of `cell`.
    pub fn set(&mut self, cell: Cell) {
        self.rows[row_of(cell)] |= 1 << bit_of(cell);
    }

    /// Unsets the bit of `cell`.
    pub fn unset(&mut self, cell: Cell) {
        self.rows[row_of(cell)] &= !(1 << bit_of(cell));
    }

    /// Sets the bits of `row` in the row of cells with the `y` and `z` of `cell`.
    pub fn add_row(&mut self, cell: Cell, row: u128) {
        self.rows[row_of(cell)] |= row;
    }

    /// Unsets all bits.
    pub fn clear(&mut self) {
        self.rows.fill(0);
    }

    /// The row of cells with the `y` and `z` of `cell`.
    pub fn row_at(&self, cell: Cell) -> u128 {
        self.rows[row_of(cell)]
    }

    /// Becomes the occupied cells of `map`.
    pub fn load_occupied(&mut self, map: &LocalMap) {
        for (index, out) in self.rows.iter_mut().enumerate() {
            *out = row(&map.occupied, index);
        }
    }

    /// Becomes the declared cells of `map`.
    pub fn load_declared(&mut self, map: &LocalMap) {
        for (index, out) in self.rows.iter_mut().enumerate() {
            *out = row(&map.declared, index);
        }
    }

    /// Removes the cells of another.
    pub fn remove(&mut self, other: &Self) {
        for (row, less) in self.rows.iter_mut().zip(&other.rows) {
            *row &= !less;
        }
    }

    /// Copies another layer.
    pub fn copy(&mut self, other: &Self) {
        self.rows.copy_from_slice(&other.rows);
    }

    /// Becomes everything that is not known to be free: occupied, unknown, and the window's outermost shell, beyond
    /// which nothing is known.
    pub fn load_unsafe(&mut self, map: &LocalMap) {
        for (index, out) in self.rows.iter_mut().enumerate() {
            *out = row(&map.occupied, index) | !row(&map.known, index);
        }
        self.close_shell(map.min_cell);
    }

    /// Sets the outermost cells of the window that begins at `min_cell`.
    pub fn close_shell(&mut self, min_cell: Cell) {
        let first_x = bit_of(min_cell);
        let last_x = (first_x + SIZE_X as u32 - 1) % SIZE_X as u32;
        let shell_x = 1u128 << first_x | 1u128 << last_x;
        let first_y = min_cell[1] as usize & (SIZE_Y - 1);
        let last_y = (first_y + SIZE_Y - 1) & (SIZE_Y - 1);
        let first_z = min_cell[2] as usize & (SIZE_Z - 1);
        let last_z = (first_z + SIZE_Z - 1) & (SIZE_Z - 1);
        for (index, out) in self.rows.iter_mut().enumerate() {
            let (y, z) = (index % SIZE_Y, index / SIZE_Y);
            *out = if y == first_y || y == last_y || z == first_z || z == last_z {
                u128::MAX
            } else {
                *out | shell_x
            };
        }
    }

    /// Becomes the half cells of another layer's cells, from half cell `min_half` (even, at the first of a cell) on.
    pub fn load_halves(&mut self, cells: &Self, min_half: Cell) {
        for z in (min_half[2]..).take(SIZE_Z) {
            for y in (min_half[1]..).take(SIZE_Y) {
                let from = cells.rows[row_of([0, y >> 1, z >> 1])];
                let first = bit_of([min_half[0] >> 1, 0, 0]);
                let wide = twice_each(from.rotate_right(first) as u64);
                self.rows[row_of([0, y, z])] = wide.rotate_left(bit_of([min_half[0], 0, 0]));
            }
        }
    }
}

/// Every bit twice, in the same order.
fn twice_each(bits: u64) -> u128 {
    // Moves the halves of ever smaller groups apart (H. Warren, "Hacker's Delight", 7-2, shuffling bits).
    let mut wide = u128::from(bits);
    for (shift, mask) in [
        (32, 0x0000_0000_ffff_ffff_0000_0000_ffff_ffff_u128),
        (16, 0x0000_ffff_0000_ffff_0000_ffff_0000_ffff),
        (8, 0x00ff_00ff_00ff_00ff_00ff_00ff_00ff_00ff),
        (4, 0x0f0f_0f0f_0f0f_0f0f_0f0f_0f0f_0f0f_0f0f),
        (2, 0x3333_3333_3333_3333_3333_3333_3333_3333),
        (1, 0x5555_5555_5555_5555_5555_5555_5555_5555),
    ] {
        wide = (wide | wide << shift) & mask;
    }
    wide | wide << 1
}

/// Distance along an axis between two cells that are `offset` apart (m): of their nearest points.
pub fn gap_m(offset: i32) -> f64 {
    gap_cells(offset) * CELL_M
}

/// The same in cells.
fn gap_cells(offset: i32) -> f64 {
    f64::from((offset.abs() - 1).max(0))
}

/// Rows that are dilated together: what the vector registers hold.
const BLOCK: usize = 16;
/// Words of a row.
const WORDS: usize = SIZE_X / 64;

/// A structuring element, a sphere or a sphere and a cylinder, as the half widths of its rows, for bit-parallel dilation.
/// It is the same to both sides along every axis.
#[derive(Clone, Debug)]
pub struct StructuringElement {
    /// Per height (index): the half widths of the rows at that height, by their offset to the side (index), never wider
    /// the farther out.
    discs: Vec<Vec<usize>>,
}

/// Memory that a dilation works in.
#[derive(Clone, Debug, Default)]
pub struct DilationScratch {
    /// Per half width: a slice, dilated by that along x, first the low words of all rows and then the high ones, each with
    /// the rows that a disc reaches beyond both ends.
    widened: Vec<u64>,
}

impl StructuringElement {
    /// A sphere of `radius_m`; every cell counts whose nearest point is nearer than that.
    pub fn new(radius_m: f64) -> Self {
        Self::of_cells(radius_m, CELL_M)
    }

    /// The same for a layer with cells of `cell_m`.
    pub fn of_cells(radius_m: f64, cell_m: f64) -> Self {
        Self::within(radius_m, cell_m, |level_m2, height_m| {
            level_m2 + height_m * height_m < radius_m * radius_m
        })
    }

    /// The same within an upright cylinder of `cylinder_m` and `half_height_m` around it.
    pub fn in_cylinder(radius_m: f64, cylinder_m: f64, half_height_m: f64) -> Self {
        Self::within(radius_m.max(cylinder_m), CELL_M, |level_m2, height_m| {
            level_m2 + height_m * height_m < radius_m * radius_m
                || level_m2 < cylinder_m * cylinder_m && height_m < half_height_m
        })
    }

    /// An element no larger than `reach_m` that holds every cell for which `is_inside(horizontal distance squared,
    /// height)`.
    fn within(reach_m: f64, cell_m: f64, is_inside: impl Fn(f64, f64) -> bool) -> Self {
        let gap_m = |offset: i32| gap_cells(offset) * cell_m;
        let reach = (reach_m / cell_m).ceil() as i32 + 1;
        let half_width = |dy: i32, dz: i32| {
            let is_reached = |dx: &i32| is_inside(gap_m(*dx).powi(2) + gap_m(dy).powi(2), gap_m(dz));
            (0..=reach).rev().find(is_reached).map(|width| width as usize)
        };
        let disc = |dz: i32| -> Vec<usize> { (0..=reach).map_while(|dy| half_width(dy, dz)).collect() };
        Self {
            discs: (0..=reach)
                .map(disc)
                .take_while(|disc| !disc.is_empty())
                .collect(),
        }
    }

    /// Writes into `out` all cells that the element around a cell of `source` reaches; `scratch` is overwritten.
    pub fn dilate(&self, source: &BitLayer, scratch: &mut DilationScratch, out: &mut BitLayer) {
        out.rows.fill(0);
        let Some(widest) = self.discs.first() else {
            return;
        };
        let (reach, width) = (widest.len() - 1, widest[0]);
        let mut dilated = [[0; SIZE_Y]; WORDS];
        for (z, slice) in source.rows.chunks_exact(SIZE_Y).enumerate() {
            if slice.iter().all(|row| *row == 0) {
                continue;
            }
            // What is nowhere known fills whatever it reaches: the ground under the vehicle is half of the window.
            let is_full = slice.iter().all(|row| *row == u128::MAX);
            let widened = (!is_full).then(|| scratch.widen(slice, width, reach));
            for (dz, disc) in self.discs.iter().enumerate() {
                match &widened {
                    Some(widened) => widened.dilate(disc, &mut dilated),
                    None => dilated = [[u64::MAX; SIZE_Y]; WORDS],
                }
                let [low, high] = &dilated;
                let sides = [z + dz, z + SIZE_Z - dz % SIZE_Z];
                for side in &sides[..if dz == 0 { 1 } else { 2 }] {
                    let out = &mut out.rows[side % SIZE_Z * SIZE_Y..][..SIZE_Y];
                    for (out, (low, high)) in out.iter_mut().zip(low.iter().zip(high)) {
                        *out |= u128::from(*low) | u128::from(*high) << 64;
                    }
                }
            }
        }
    }
}

impl DilationScratch {
    /// With room for these elements.
    pub fn for_elements<'a>(elements: impl IntoIterator<Item = &'a StructuringElement>) -> Self {
        let widest = elements.into_iter().filter_map(|element| element.discs.first());
        let room = widest.map(|disc| Self::words(disc[0], disc.len() - 1)).max();
        Self {
            widened: Vec::with_capacity(room.unwrap_or(0)),
        }
    }

    /// How many words half widths up to `width` take, for discs of `reach` rows to each side.
    fn words(width: usize, reach: usize) -> usize {
        (width + 1) * WORDS * (SIZE_Y + 2 * reach)
    }

    /// The rows of `slice` dilated along x by every half width up to `width`, for discs of `reach` rows to each side.
    fn widen(&mut self, slice: &[u128], width: usize, reach: usize) -> Widened<'_> {
        let rows = SIZE_Y + 2 * reach;
        self.widened.resize(Self::words(width, reach), 0);
        let (low, high) = self.widened[..WORDS * rows].split_at_mut(rows);
        let mut set_rows = 0;
        for y in 0..rows {
            // The window's opposite faces are neighbours; see the module.
            let row = slice[(y + SIZE_Y - reach % SIZE_Y) % SIZE_Y];
            [low[y], high[y]] = [row as u64, (row >> 64) as u64];
        }
        for (y, row) in slice.iter().enumerate() {
            set_rows |= u128::from(*row != 0) << y;
        }
        for level in 0..width {
            let (narrow, wide) =
                self.widened[level * WORDS * rows..][..2 * WORDS * rows].split_at_mut(WORDS * rows);
            let (low, high) = narrow.split_at(rows);
            let (wide_low, wide_high) = wide.split_at_mut(rows);
            for ((low, high), (wide_low, wide_high)) in
                low.iter().zip(high).zip(wide_low.iter_mut().zip(wide_high))
            {
                *wide_low = low | low << 1 | high >> 63 | low >> 1 | high << 63;
                *wide_high = high | high << 1 | low >> 63 | high >> 1 | low << 63;
            }
        }
        Widened {
            words: &self.widened,
            rows,
            reach,
            set_rows,
        }
    }
}

/// A slice, dilated along x by every half width.
struct Widened<'a> {
    words: &'a [u64],
    /// Rows with those beyond both ends.
    rows: usize,
    /// Rows beyond one end.
    reach: usize,
    /// A bit for each row of the slice that is not empty.
    set_rows: u128,
}

impl Widened<'_> {
    /// Writes the slice dilated by `disc` into `out`: the low words of all rows, then the high ones.
    fn dilate(&self, disc: &[usize], out: &mut [[u64; SIZE_Y]; WORDS]) {
        let reached = (BLOCK + 2 * (disc.len() - 1)).min(SIZE_Y) as u32;
        let mask = u128::MAX >> (SIZE_Y as u32 - reached);
        for y in (0..SIZE_Y).step_by(BLOCK) {
            let first = (y + SIZE_Y - (disc.len() - 1) % SIZE_Y) % SIZE_Y;
            let is_empty = self.set_rows.rotate_right(first as u32) & mask == 0;
            for (word, out) in out.iter_mut().enumerate() {
                let block = if is_empty {
                    [0; BLOCK]
                } else {
                    self.block(disc, word, y)
                };
                out[y..y + BLOCK].copy_from_slice(&block);
            }
        }
    }

    /// One word of the rows from `y` on of the slice dilated by `disc`.
    #[inline]
    fn block(&self, disc: &[usize], word: usize, y: usize) -> [u64; BLOCK] {
        let rows = |width: usize, row: usize| -> &[u64; BLOCK] {
            let at = (width * WORDS + word) * self.rows + row;
            self.words[at..].first_chunk().unwrap_or(&[0; BLOCK])
        };
        let here = self.reach + y;
        let mut block = *rows(disc[0], here);
        if block.iter().all(|word| *word == u64::MAX) {
            return block;
        }
        for (dy, width) in disc.iter().enumerate().skip(1) {
            let (before, after) = (rows(*width, here - dy), rows(*width, here + dy));
            for (word, (before, after)) in block.iter_mut().zip(before.iter().zip(after)) {
                *word |= before | after;
            }
        }
        block
    }
}

#[cfg(test)]
mod tests {
    use super::{BitLayer, DilationScratch, StructuringElement};
    use jink_shared_types::map::{CELL_M, Cell, LocalMap, set};
    use proptest::prelude::*;

    fn nearest_m(a: Cell, b: Cell, cell_m: f64) -> f64 {
        (0..3)
            .map(|axis| (f64::from((a[axis] - b[axis]).abs() - 1).max(0.0) * cell_m).powi(2))
            .sum::<f64>()
            .sqrt()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(12))]
        #[test]
        fn dilation_sets_exactly_the_cells_within_the_radius(
            cells in proptest::collection::vec((-50..50i32, -50..50i32, -20..20i32), 1..6),
            full_slices in proptest::collection::vec(-20..20i32, 0..2),
            radius in 0.1..1.1f64,
            cell_m in prop_oneof![Just(CELL_M), Just(0.5 * CELL_M)],
        ) {
            let mut source = BitLayer::default();
            for (x, y, z) in &cells {
                source.set([*x, *y, *z]);
            }
            for z in &full_slices {
                (-64..64).for_each(|x| (-64..64).for_each(|y| source.set([x, y, *z])));
            }
            let (mut scratch, mut out) = (DilationScratch::default(), BitLayer::default());
            StructuringElement::of_cells(radius, cell_m).dilate(&source, &mut scratch, &mut out);
            for x in -60..60 {
                for y in -60..60 {
                    for z in -28..28 {
                        let away_m = |(cx, cy, cz): &(i32, i32, i32)| nearest_m([x, y, z], [*cx, *cy, *cz], cell_m);
                        let above_m = |slice: &i32| nearest_m([0, 0, z], [0, 0, *slice], cell_m);
                        let near = cells.iter().any(|cell| away_m(cell) < radius)
                            || full_slices.iter().any(|slice| above_m(slice) < radius);
                        prop_assert_eq!(out.test([x, y, z]), near, "{} {} {}", x, y, z);
                    }
                }
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(12))]
        #[test]
        fn half_cells_are_what_their_cells_are(
            min in (-500..500i32, -500..500i32, -500..500i32),
            set_cells in proptest::collection::vec((0..64i32, 0..64i32, 0..32i32), 1..40),
        ) {
            let min = [min.0, min.1, min.2];
            let mut cells = BitLayer::default();
            for (x, y, z) in &set_cells {
                cells.set([min[0] + x, min[1] + y, min[2] + z]);
            }
            let mut halves = BitLayer::default();
            let min_half = min.map(|cell| 2 * cell);
            halves.load_halves(&cells, min_half);
            for x in (min_half[0]..).take(128) {
                for y in (min_half[1]..).take(128) {
                    for z in (min_half[2]..).take(64) {
                        let cell = [x, y, z].map(|half| half >> 1);
                        prop_assert_eq!(halves.test([x, y, z]), cells.test(cell));
                    }
                }
            }
        }
    }

    #[test]
    fn a_cylinder_reaches_farther_to_the_sides_and_no_higher() {
        let mut source = BitLayer::default();
        source.set([0, 0, 0]);
        let (mut scratch, mut out) = (DilationScratch::default(), BitLayer::default());
        StructuringElement::in_cylinder(0.5, 2.0, 0.5).dilate(&source, &mut scratch, &mut out);
        for x in -15..=15 {
            for y in -15..=15 {
                for z in -15..=15 {
                    let level_m = nearest_m([x, y, 0], [0; 3], CELL_M);
                    let height_m = nearest_m([0, 0, z], [0; 3], CELL_M);
                    let inside = level_m < 2.0 && height_m < 0.5 || level_m.hypot(height_m) < 0.5;
                    assert_eq!(out.test([x, y, z]), inside, "{x} {y} {z}");
                }
            }
        }
    }

    #[test]
    fn what_is_not_known_free_is_unsafe_and_so_is_the_windows_shell() {
        let mut map = LocalMap::boxed();
        map.min_cell = [-64, -64, -32];
        for x in -64..64 {
            set(&mut map.known, [x, 0, 0]);
        }
        set(&mut map.occupied, [5, 0, 0]);
        let mut bit_layer = BitLayer::default();
        bit_layer.load_unsafe(&map);
        assert!(!bit_layer.test([4, 0, 0]), "known and free");
        assert!(bit_layer.test([5, 0, 0]), "occupied");
        assert!(bit_layer.test([4, 1, 0]), "unknown");
        assert!(bit_layer.test([-64, 0, 0]) && bit_layer.test([63, 0, 0]), "shell");
    }
}
