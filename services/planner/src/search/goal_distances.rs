//! Distances to the goal round everything known to be occupied: the estimate with which a search leaves a dead end
//! without filling it first.
//!
//! | in | out |
//! |---|---|
//! | the cells of a speed tier that are not hit, seeds with their remaining distance | per cube of two by two by two cells: the distance (m) to the nearest seed and from there on |
//!
//! A cube is free if any of its cells is, so that no gap closes. What a tier keeps its distance from is thicker than a
//! cube, so that no path leads through it but where two of them touch. A wave front moves through the free cubes, a row of 64 at a time: alternately to
//! the four and to the eight neighbours on the same height, so that its distances are those of an octagon (Rosenfeld
//! and Pfaltz 1968), and later to the heights above and below. A diagonal step needs every cube it touches. The front is
//! slower where a path costs more: in cubes none of whose cells is safe and comfortable.

use crate::configuration_space::ConfigurationSpace;
use jink_shared_types::map::{Cell, SIZE_X, SIZE_Y, SIZE_Z, bit_of};

/// Cubes along each axis of the window.
const CUBES_X: usize = SIZE_X / 2;
const CUBES_Y: usize = SIZE_Y / 2;
const CUBES_Z: usize = SIZE_Z / 2;
const _: () = assert!(CUBES_X == u64::BITS as usize);
/// Rows on each height: one more to each side, as one more height above and below, is never free.
const LEVEL_ROWS: usize = CUBES_Y + 2;
const ROWS: usize = LEVEL_ROWS * (CUBES_Z + 2);
/// Edge of a cube (cells).
pub(super) const CUBE_CELLS: f32 = 2.0;
/// Waves that a step takes, and how many more into a cube that costs more: half as much again.
const STEP_WAVES: usize = 2;
const COSTLY_WAVES: usize = 1;
/// Most steps that one up or down counts as.
const VERTICAL_MAX: usize = 4;
/// Waves that are remembered: more than a step takes.
const REMEMBERED: usize = STEP_WAVES * VERTICAL_MAX + COSTLY_WAVES + 1;
/// Seeds farther away than the nearest one by more than this many waves count as if they were not.
const SEED_WAVES_MAX: f32 = 2_000.0;
/// More waves than a front can take through the window.
const WAVES_MAX: u16 = u16::MAX;

/// A row of cubes of the wave front.
type FrontRow = (usize, u64);

/// The distances, and reusable memory for them.
#[derive(Debug)]
pub(super) struct GoalDistances {
    min_cell: Cell,
    cube_m: f32,
    /// Waves for a step up or down.
    vertical_waves: usize,
    free: Vec<u64>,
    /// Those in which a path costs no more than its length.
    cheap: Vec<u64>,
    reached: Vec<u64>,
    pending: Vec<u64>,
    touched: Vec<usize>,
    fronts: [Vec<FrontRow>; REMEMBERED],
    waves: Vec<u16>,
    /// The remaining distance (m) of every seed, later the wave that it belongs to; its row and its place there.
    seeds: Vec<(f32, usize, u32)>,
    nearest_seed_m: f32,
    /// The first wave that was not made.
    end_wave: u16,
}

impl Default for GoalDistances {
    fn default() -> Self {
        Self {
            min_cell: [0; 3],
            cube_m: 0.0,
            vertical_waves: STEP_WAVES,
            free: vec![0; ROWS],
            cheap: vec![0; ROWS],
            reached: vec![0; ROWS],
            pending: vec![0; ROWS],
            touched: Vec::with_capacity(ROWS),
            fronts: std::array::from_fn(|_| Vec::with_capacity(ROWS)),
            waves: vec![WAVES_MAX; ROWS * CUBES_X],
            seeds: Vec::with_capacity(CUBES_X * CUBES_Y * CUBES_Z / 8),
            nearest_seed_m: 0.0,
            end_wave: 0,
        }
    }
}

impl GoalDistances {
    /// Takes the cells of `tier` that are not hit, at heights of `z_range`; `height_cost` is the additional cost of a
    /// metre of height.
    pub(super) fn load(
        &mut self,
        space: &ConfigurationSpace,
        tier: usize,
        z_range: (i32, i32),
        height_cost: f32,
    ) {
        self.min_cell = space.min_cell(tier);
        self.cube_m = CUBE_CELLS * space.cell_m(tier) as f32;
        let vertical_waves = (STEP_WAVES as f32 * (1.0 + height_cost)).round() as usize;
        self.vertical_waves = vertical_waves.min(STEP_WAVES * VERTICAL_MAX);
        let (hit, blocked) = (space.hit(tier), space.blocked(tier));
        // The layer for comfort is one of the map's cells.
        let near = space.near().filter(|_| space.per_cell(tier) == 1);
        let [_, min_y, min_z] = self.min_cell;
        let shift = bit_of(self.min_cell);
        self.free.fill(0);
        self.cheap.fill(0);
        for (z, down) in (min_z..).take(SIZE_Z).enumerate() {
            if !(z_range.0..=z_range.1).contains(&down) {
                continue;
            }
            for (y, east) in (min_y..).take(SIZE_Y).enumerate() {
                let cell = [0, east, down];
                let costly = blocked.row_at(cell) | near.map_or(0, |near| near.row_at(cell));
                let [free, cheap] =
                    [hit.row_at(cell), costly | hit.row_at(cell)].map(|row| !row.rotate_right(shift));
                self.free[row_of(y, z)] |= any_of_two(free);
                self.cheap[row_of(y, z)] |= any_of_two(cheap);
            }
        }
        self.seeds.clear();
    }

    /// Adds a seed in the cube of `cell`, from which `remaining_m` are left to the goal; not if it is not free.
    pub(super) fn add_seed(&mut self, cell: Cell, remaining_m: f32) {
        if let Some((row, x)) = self.place_of(cell)
            && self.free[row] >> x & 1 == 1
        {
            self.seeds.push((remaining_m, row, x));
        }
    }

    /// Replaces the seeds by one.
    pub(super) fn restart_at(&mut self, cell: Cell, remaining_m: f32) {
        self.seeds.clear();
        self.add_seed(cell, remaining_m);
    }

    /// Adds the free cubes at the window's border as seeds.
    pub(super) fn add_border(&mut self, mut remaining_m: impl FnMut(Cell) -> f32) {
        let sides = 1 | 1 << (CUBES_X - 1);
        for z in 0..CUBES_Z {
            for y in 0..CUBES_Y {
                let is_border = y == 0 || y == CUBES_Y - 1 || z == 0 || z == CUBES_Z - 1;
                let row = row_of(2 * y, 2 * z);
                for x in bits(self.free[row] & if is_border { u64::MAX } else { sides }) {
                    self.seeds.push((remaining_m(self.cell_at(row, x)), row, x));
                }
            }
        }
    }

    /// Moves the front from the seeds until it reaches `stop`, or, without one, everything that can be reached. Returns
    /// whether it has reached `stop`.
    pub(super) fn propagate(&mut self, stop: Option<Cell>) -> bool {
        let stop = stop.and_then(|cell| self.place_of(cell));
        self.reached.fill(0);
        for front in &mut self.fronts {
            front.clear();
        }
        let nearest_m = self.seeds.iter().fold(f32::INFINITY, |min, seed| min.min(seed.0));
        self.nearest_seed_m = nearest_m;
        for seed in &mut self.seeds {
            seed.0 = ((seed.0 - nearest_m) / self.cube_m * STEP_WAVES as f32)
                .round()
                .min(SEED_WAVES_MAX);
        }
        self.seeds
            .sort_unstable_by_key(|(wave, row, x)| (*wave as u32, *row, *x));
        let (mut next_seed, mut idle) = (0, 0);
        for wave in 0..WAVES_MAX {
            self.advance(usize::from(wave));
            while let Some((when, row, x)) = self.seeds.get(next_seed).copied()
                && when as u16 <= wave
            {
                next_seed += 1;
                self.touch(row, 1 << x);
            }
            let has_moved = self.take_pending(wave);
            self.end_wave = wave + 1;
            if stop.is_some_and(|(row, x)| self.reached[row] >> x & 1 == 1) {
                return true;
            }
            idle = if has_moved { 0 } else { idle + 1 };
            if idle > REMEMBERED && next_seed == self.seeds.len() {
                break;
            }
        }
        false
    }

    /// Puts what `wave` may reach from the waves before it into the pending rows.
    fn advance(&mut self, wave: usize) {
        for (more_waves, is_cheap) in [(0, true), (COSTLY_WAVES, false)] {
            if let Some(from) = wave.checked_sub(STEP_WAVES + more_waves) {
                self.advance_level(from, is_cheap);
            }
            if let Some(from) = wave.checked_sub(self.vertical_waves + more_waves) {
                self.advance_vertically(from, is_cheap);
            }
        }
    }

    /// The free cubes of a row that cost no more than their length, or those that do.
    #[inline]
    fn entered(&self, row: usize, is_cheap: bool) -> u64 {
        self.free[row]
            & if is_cheap {
                self.cheap[row]
            } else {
                !self.cheap[row]
            }
    }

    fn advance_level(&mut self, from: usize, is_cheap: bool) {
        let is_to_eight = from / STEP_WAVES % 2 == 1;
        let front = std::mem::take(&mut self.fronts[from % REMEMBERED]);
        for (row, bits) in front.iter().copied() {
            let free = self.free[row];
            self.touch(row, (bits << 1 | bits >> 1) & self.entered(row, is_cheap));
            for beside in [row - 1, row + 1] {
                let straight = bits & self.free[beside];
                let diagonal = if is_to_eight {
                    (straight << 1 | straight >> 1) & free
                } else {
                    0
                };
                self.touch(beside, (straight | diagonal) & self.entered(beside, is_cheap));
            }
        }
        self.fronts[from % REMEMBERED] = front;
    }

    fn advance_vertically(&mut self, from: usize, is_cheap: bool) {
        let front = std::mem::take(&mut self.fronts[from % REMEMBERED]);
        for (row, bits) in front.iter().copied() {
            for beside in [row - LEVEL_ROWS, row + LEVEL_ROWS] {
                self.touch(beside, bits & self.entered(beside, is_cheap));
            }
        }
        self.fronts[from % REMEMBERED] = front;
    }

    /// Adds `bits` to a pending row.
    #[inline]
    fn touch(&mut self, row: usize, bits: u64) {
        if bits != 0 {
            if self.pending[row] == 0 {
                self.touched.push(row);
            }
            self.pending[row] |= bits;
        }
    }

    /// Makes what is pending and new the front of `wave`; returns whether there is anything.
    fn take_pending(&mut self, wave: u16) -> bool {
        let front = &mut self.fronts[usize::from(wave) % REMEMBERED];
        front.clear();
        for row in self.touched.drain(..) {
            let new = std::mem::take(&mut self.pending[row]) & !self.reached[row];
            if new == 0 {
                continue;
            }
            self.reached[row] |= new;
            front.push((row, new));
            let waves = &mut self.waves[row * CUBES_X..(row + 1) * CUBES_X];
            for x in bits(new) {
                waves[x as usize] = wave;
            }
        }
        !front.is_empty()
    }

    /// The distance (m) that is left from the cube of `cell`; where the front has not been, the distance that it had
    /// come to.
    #[inline]
    pub(super) fn remaining_m(&self, cell: Cell) -> f32 {
        let wave = match self.place_of(cell) {
            Some((row, x)) if self.reached[row] >> x & 1 == 1 => self.waves[row * CUBES_X + x as usize],
            _ => self.end_wave,
        };
        self.nearest_seed_m + f32::from(wave) * self.cube_m / STEP_WAVES as f32
    }

    /// Whether the front has been in the cube of `cell`.
    pub(super) fn is_reached(&self, cell: Cell) -> bool {
        self.place_of(cell)
            .is_some_and(|(row, x)| self.reached[row] >> x & 1 == 1)
    }

    /// The first cell of every cube where the front has been.
    pub(super) fn reached_cubes(&self) -> impl Iterator<Item = Cell> {
        let rows = self.reached.iter().enumerate();
        rows.flat_map(move |(row, reached)| bits(*reached).map(move |x| self.cell_at(row, x)))
    }

    /// The row, and the place in it, of the cube of a cell; `None` outside of the window.
    #[inline]
    fn place_of(&self, cell: Cell) -> Option<(usize, u32)> {
        let [x, y, z]: [i32; 3] = std::array::from_fn(|axis| cell[axis].wrapping_sub(self.min_cell[axis]));
        let is_inside = (0..SIZE_X as i32).contains(&x)
            && (0..SIZE_Y as i32).contains(&y)
            && (0..SIZE_Z as i32).contains(&z);
        is_inside.then(|| (row_of(y as usize, z as usize), x as u32 / 2))
    }

    /// The first cell of a cube.
    fn cell_at(&self, row: usize, x: u32) -> Cell {
        [
            self.min_cell[0] + 2 * x as i32,
            self.min_cell[1] + 2 * (row % LEVEL_ROWS) as i32 - 2,
            self.min_cell[2] + 2 * (row / LEVEL_ROWS) as i32 - 2,
        ]
    }
}

/// The cells of the cube that begins with one.
pub(super) fn cells_of([x, y, z]: Cell) -> impl Iterator<Item = Cell> {
    (0..8).map(move |at| [x + (at & 1), y + (at >> 1 & 1), z + (at >> 2)])
}

/// The row of cubes of the cells at `y` and `z`, counted from the window's first one.
fn row_of(y: usize, z: usize) -> usize {
    (z / 2 + 1) * LEVEL_ROWS + y / 2 + 1
}

/// One bit for every two: whether any of them is set.
fn any_of_two(bits: u128) -> u64 {
    // Moves ever larger groups together (H. Warren, "Hacker's Delight", 7-2, unshuffling bits).
    let mut any = (bits | bits >> 1) & 0x5555_5555_5555_5555_5555_5555_5555_5555;
    for (shift, mask) in [
        (1, 0x3333_3333_3333_3333_3333_3333_3333_3333_u128),
        (2, 0x0f0f_0f0f_0f0f_0f0f_0f0f_0f0f_0f0f_0f0f),
        (4, 0x00ff_00ff_00ff_00ff_00ff_00ff_00ff_00ff),
        (8, 0x0000_ffff_0000_ffff_0000_ffff_0000_ffff),
        (16, 0x0000_0000_ffff_ffff_0000_0000_ffff_ffff),
        (32, 0x0000_0000_0000_0000_ffff_ffff_ffff_ffff),
    ] {
        any = (any | any >> shift) & mask;
    }
    any as u64
}

/// The places of the bits that are set.
#[inline]
fn bits(mut row: u64) -> impl Iterator<Item = u32> {
    std::iter::from_fn(move || {
        (row != 0).then(|| {
            let x = row.trailing_zeros();
            row &= row - 1;
            x
        })
    })
}

#[cfg(test)]
mod tests {
    use super::{GoalDistances, cells_of};
    use crate::configuration_space::ConfigurationSpace;
    use crate::configuration_space::tests::{known_map, space_of};
    use crate::search::neighbours::{neighbours_outside, steps};
    use crate::speed_tiers::LAST_TIER;
    use jink_shared_types::map::Cell;
    use proptest::prelude::*;
    use std::collections::{BTreeMap, BTreeSet};

    const HEIGHTS: (i32, i32) = (-2, 2);

    /// The lengths of the shortest paths (cells) from `start`, by the steps of a search.
    fn path_lengths(space: &ConfigurationSpace, tier: usize, start: Cell) -> BTreeMap<Cell, f64> {
        let is_inner = |cell: Cell| space.holds(tier, cell) && (HEIGHTS.0..=HEIGHTS.1).contains(&cell[2]);
        let mut lengths = BTreeMap::from([(start, 0.0)]);
        // Lengths in thousandths order the cells that are open.
        let mut open = BTreeSet::from([(0u64, start)]);
        while let Some((_, cell)) = open.pop_first() {
            let here = lengths[&cell];
            let free = neighbours_outside(space.hit(tier), cell);
            for step in steps().iter().filter(|step| free & step.needs == step.needs) {
                let next: Cell = std::array::from_fn(|axis| cell[axis] + step.by[axis]);
                let length = here + step.length;
                if is_inner(next) && lengths.get(&next).is_none_or(|old| length < old - 1e-9) {
                    lengths.insert(next, length);
                    open.insert(((length * 1e3) as u64, next));
                }
            }
        }
        lengths
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(8))]

        #[test]
        fn what_a_search_reaches_is_reached_and_no_farther_than_its_path_costs(
            trees in prop::collection::vec((-12.0..12.0f64, -12.0..12.0f64, 0.2..2.5f64), 0..25),
            tier in prop_oneof![Just(0), Just(LAST_TIER)],
        ) {
            let is_tree = |x: f64, y: f64| trees.iter().any(|(at_x, at_y, half)| {
                ((x - at_x).hypot(y - at_y) - half).abs() < 0.15
            });
            let space = space_of(&known_map(|p| is_tree(p.x, p.y)));
            let start = [0; 3];
            let mut distances = GoalDistances::default();
            distances.load(&space, tier, HEIGHTS, 0.0);
            prop_assume!(!space.is_hit(tier, start));
            distances.add_seed(start, 3.0);
            distances.propagate(None);
            let lengths = path_lengths(&space, tier, start);
            let free = |cell: &Cell| space.holds(tier, *cell) && !space.is_hit(tier, *cell);
            let inside = |cell: &Cell| (HEIGHTS.0..=HEIGHTS.1).contains(&cell[2]);
            let reached: BTreeSet<Cell> = distances.reached_cubes().flat_map(cells_of).filter(|cell| free(cell) && inside(cell)).collect();
            prop_assert!(lengths.keys().all(|cell| reached.contains(cell)));
            let cell_m = space.cell_m(tier);
            for (cell, length) in &lengths {
                let cells = f64::from(distances.remaining_m(*cell) - 3.0) / cell_m;
                // Steps that change height and place at once are two here; octagons are flatter than circles; narrow space
                // counts half as much again. Where two trees leave a corner between cells free, a cube leads through it: the
                // estimate is then shorter than any path.
                let straight = f64::from(cell[0]).hypot(f64::from(cell[1]));
                prop_assert!((0.75 * straight - 8.0..=1.5 * length + 8.0).contains(&cells), "{cell:?}: {cells} {length}");
            }
        }
    }

    #[test]
    fn the_border_counts_with_what_is_left_beyond_it() {
        let space = space_of(&known_map(|p| (p.x - 4.0).abs() < 0.2 && p.y < 8.0));
        let goal_x = 400;
        let mut distances = GoalDistances::default();
        distances.load(&space, 0, HEIGHTS, 0.5);
        distances.add_border(|cell| (goal_x - cell[0]) as f32 * 0.2);
        assert!(distances.propagate(Some([0; 3])));
        let here_m = distances.remaining_m([0; 3]);
        // Round the wall's end some 8 m aside.
        assert!((86.0..92.0).contains(&here_m), "{here_m}");
        let beyond_m = distances.remaining_m([40, 0, 0]);
        // Beside the border it is slower: what lies beyond is not known.
        assert!((71.9..73.0).contains(&beyond_m), "{beyond_m}");
        assert!(!distances.is_reached([-60, 0, 0]), "the front ends at the start");
    }

    #[test]
    fn from_an_enclosed_place_no_border_is_reached() {
        let space = space_of(&known_map(|p| (p.x.hypot(p.y) - 5.0).abs() < 0.3));
        let mut distances = GoalDistances::default();
        distances.load(&space, 0, HEIGHTS, 0.5);
        distances.add_border(|_| 10.0);
        assert!(!distances.propagate(Some([0; 3])));
        distances.restart_at([0; 3], 0.0);
        distances.propagate(None);
        let far = distances
            .reached_cubes()
            .flat_map(cells_of)
            .map(|cell| cell[0].pow(2) + cell[1].pow(2))
            .max();
        assert!(far.is_some_and(|square| (200..625).contains(&square)), "{far:?}");
    }
}
