//! How much longer than the straight line the path to the goal is, by the far map.
//!
//! | in | out |
//! |---|---|
//! | [`FarMap`], the goal, the heights flown at | per cell: the detour (m) that a path from there to the goal takes round known obstacles |
//!
//! The remaining path from every cell is computed by Dijkstra's algorithm over the map's cells at the height of flight,
//! from the goal outwards. Nothing is forbidden: occupied cells have a high cost, so that a wrong map still leaves a
//! path. Unknown cells count as free. The fine search uses the detour, not the path itself: where there is no obstacle
//! the detour is zero, and the search is what it would be without a far map.

mod too_narrow;

use jink_shared_types::far_map::{FAR_CELL_M, FAR_X, FAR_Y, FAR_Z, FarMap, far_row_of};
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::map::{CELL_M, Cell};
use too_narrow::{TOO_NARROW_FACTOR, TooNarrow};

/// Costs are whole numbers: a straight step of one cell, and a diagonal one, 0.2 % longer than the square root of two.
const STRAIGHT: u32 = 12;
const DIAGONAL: u32 = 17;
/// Cost of a step through an occupied cell, relative to a free one: 40 m per cell. A dead end as deep as the fine
/// window reaches is left for a path round it.
const OCCUPIED_FACTOR: u32 = 100;
/// The same for a cell beside an occupied one, where fewer than two cells side by side are free: too narrow for most
/// vehicles.
const NARROW_FACTOR: u32 = 10;
/// For sensors that do not see all around, a detour up to this (2 m) counts as none: the fine search finds the path
/// round a trunk. When every trunk 40 m ahead counted, a camera was led aside at its start, into what it had not seen.
/// With scanners, gaps are passed better when every detour counts.
const FINE_DETOUR: u32 = 5 * STRAIGHT;
/// The window and one more cell to each side, which no path enters: its cells cost nothing already.
const WIDTH: usize = FAR_X + 2;
const CELLS: usize = WIDTH * (FAR_Y + 2);
/// The first cell of the window.
const FIRST: usize = WIDTH + 1;
/// Above every cost, and a step more is no overflow.
const NOT_REACHED: u32 = u32::MAX / 2;
/// Cells that wait to be expanded, by their cost modulo this: more than the longest step costs (Dial 1969).
const BUCKETS: usize = 2048;
/// Room for cells of the same cost: more than wait in a forest.
const BUCKET_CELLS: usize = 256;
const _: () = assert!(BUCKETS > (DIAGONAL * OCCUPIED_FACTOR) as usize);

/// What detours were computed for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct MadeFor {
    map_number: u64,
    epoch: u32,
    goal_cell: [i32; 2],
    layers: [i32; 2],
}

/// The detours to one goal.
#[derive(Debug)]
pub struct DetourMap {
    min_cell: Cell,
    detour_m: Vec<f32>,
    left: Vec<u32>,
    factor: Vec<u32>,
    buckets: Vec<Vec<u32>>,
    /// Where paths begin, with the cost there.
    seeds: Vec<(u32, u32)>,
    made_for: Option<MadeFor>,
    too_narrow: TooNarrow,
}

impl Default for DetourMap {
    fn default() -> Self {
        Self {
            min_cell: [0; 3],
            detour_m: vec![0.0; CELLS],
            left: vec![0; CELLS],
            factor: vec![0; CELLS],
            buckets: (0..BUCKETS).map(|_| Vec::with_capacity(BUCKET_CELLS)).collect(),
            seeds: Vec::with_capacity(2 * (FAR_X + FAR_Y)),
            made_for: None,
            too_narrow: TooNarrow::default(),
        }
    }
}

/// The index along an axis of the far map's cell that holds the coordinate `m` (m).
fn far_index(m: f64) -> i32 {
    (m / FAR_CELL_M).floor() as i32
}

fn goal_cell(goal: &Point<LocalNed>) -> [i32; 2] {
    [goal.x_m, goal.y_m].map(far_index)
}

impl DetourMap {
    /// There is no far map: no detour is known.
    pub fn reset(&mut self) {
        self.made_for = None;
        self.too_narrow.clear();
    }

    /// The cells that the fine map has shown to be too narrow.
    pub fn too_narrow_mut(&mut self) -> &mut TooNarrow {
        &mut self.too_narrow
    }

    /// Whether detours to `goal` are known, by whatever map of the `epoch`.
    pub fn is_of(&self, epoch: u32, goal: &Point<LocalNed>) -> bool {
        self.made_for
            .is_some_and(|made_for| (made_for.epoch, made_for.goal_cell) == (epoch, goal_cell(goal)))
    }

    /// Computes the detours to `goal` at heights from `goal` to `here`, by `map`, which has the number `map_number`;
    /// nothing if they are up to date. With sensors that do not see all around, short detours count as none.
    pub fn make(
        &mut self,
        map: &FarMap,
        map_number: u64,
        goal: &Point<LocalNed>,
        here: &Point<LocalNed>,
        sees_all_around: bool,
    ) {
        let goal_cell = goal_cell(goal);
        let (top_m, bottom_m) = (goal.z_m.min(here.z_m), goal.z_m.max(here.z_m));
        let layers = [top_m - CELL_M, bottom_m + CELL_M].map(far_index);
        let made_for = Some(MadeFor {
            map_number,
            epoch: map.epoch,
            goal_cell,
            layers,
        });
        if self.made_for == made_for {
            return;
        }
        self.made_for = made_for;
        self.min_cell = map.min_cell;
        self.cost(map, layers);
        self.too_narrow.follow(map);
        self.cost_too_narrow();
        self.expand_dijkstra(goal_cell);
        self.compare(goal_cell, if sees_all_around { 0 } else { FINE_DETOUR });
    }

    /// The detour (m) of a path from `cell` (of the fine map) to the goal; zero where nothing is known of one.
    #[inline]
    pub fn detour_m(&self, cell: Cell) -> f32 {
        let x = cell[0].div_euclid(2).wrapping_sub(self.min_cell[0]);
        let y = cell[1].div_euclid(2).wrapping_sub(self.min_cell[1]);
        let is_inside = (0..FAR_X as i32).contains(&x) && (0..FAR_Y as i32).contains(&y);
        if self.made_for.is_some() && is_inside {
            self.detour_m[FIRST + y as usize * WIDTH + x as usize]
        } else {
            0.0
        }
    }

    fn cost(&mut self, map: &FarMap, layers: [i32; 2]) {
        let [low, high] =
            layers.map(|z| z.clamp(map.min_cell[2], map.min_cell[2].saturating_add(FAR_Z as i32 - 1)));
        for y in 0..FAR_Y {
            let mut occupied = [0u64; FAR_X / 64];
            for z in low..=high {
                let row = &map.occupied[far_row_of([0, map.min_cell[1].wrapping_add(y as i32), z])];
                for (all, one) in occupied.iter_mut().zip(row) {
                    *all |= one;
                }
            }
            let factors = &mut self.factor[FIRST + y * WIDTH..][..FAR_X];
            for (x, factor) in factors.iter_mut().enumerate() {
                let bit = map.min_cell[0].wrapping_add(x as i32) as usize & (FAR_X - 1);
                let is_occupied = occupied[bit >> 6] >> (bit & 63) & 1 == 1;
                *factor = if is_occupied { OCCUPIED_FACTOR } else { 1 };
            }
        }
        // A square of two by two cells has clearance if all of them are free; it counts for its corner.
        for y in 0..FAR_Y - 1 {
            for at in FIRST + y * WIDTH..FIRST + y * WIDTH + FAR_X - 1 {
                let others = [at + 1, at + WIDTH, at + WIDTH + 1];
                let beside_occupied = others.iter().any(|at| self.factor[*at] == OCCUPIED_FACTOR);
                if self.factor[at] == 1 && beside_occupied {
                    self.factor[at] = NARROW_FACTOR;
                }
            }
        }
    }

    fn cost_too_narrow(&mut self) {
        for [x, y] in self.too_narrow.offsets() {
            let factor = &mut self.factor[FIRST + y * WIDTH + x];
            *factor = (*factor).max(TOO_NARROW_FACTOR);
        }
    }

    /// Computes the cost of the remaining path from every cell.
    fn expand_dijkstra(&mut self, goal: [i32; 2]) {
        self.left.fill(0);
        for y in 0..FAR_Y {
            self.left[FIRST + y * WIDTH..][..FAR_X].fill(NOT_REACHED);
        }
        self.seeds.clear();
        let [x, y] = [0, 1].map(|axis| goal[axis].wrapping_sub(self.min_cell[axis]));
        if (0..FAR_X as i32).contains(&x) && (0..FAR_Y as i32).contains(&y) {
            self.seeds
                .push((0, (FIRST + y as usize * WIDTH + x as usize) as u32));
        } else {
            // Beyond the border nothing is known.
            for (at, x, y) in cells().filter(|(_, x, y)| is_on_border(*x, *y)) {
                self.seeds.push((open_cost(self.min_cell, x, y, goal), at as u32));
            }
        }
        self.seeds.sort_unstable();
        let (mut next_seed, mut waiting) = (0, 0);
        let mut cost = self.seeds.first().map_or(0, |seed| seed.0);
        while waiting > 0 || next_seed < self.seeds.len() {
            while let Some((_, at)) = self.seeds.get(next_seed).filter(|seed| seed.0 == cost) {
                waiting += usize::from(self.reach(*at as usize, cost));
                next_seed += 1;
            }
            // A step costs something, so none leads back into this bucket.
            let mut bucket = std::mem::take(&mut self.buckets[cost as usize % BUCKETS]);
            waiting -= bucket.len();
            for at in bucket.drain(..) {
                let at = at as usize;
                if self.left[at] != cost {
                    continue;
                }
                for (to, length) in neighbours(at) {
                    waiting += usize::from(self.reach(to, cost + length * self.factor[to]));
                }
            }
            self.buckets[cost as usize % BUCKETS] = bucket;
            cost += 1;
        }
    }

    /// Lowers the cost of a cell to `cost`; returns whether it was higher, and the cell is to be expanded.
    #[inline]
    fn reach(&mut self, at: usize, cost: u32) -> bool {
        let is_lower = cost < self.left[at];
        if is_lower {
            self.left[at] = cost;
            self.buckets[cost as usize % BUCKETS].push(at as u32);
        }
        is_lower
    }

    /// Computes the detours, of which the cost `ignored` is subtracted.
    fn compare(&mut self, goal: [i32; 2], ignored: u32) {
        // No path leads from outside the window.
        for y in 0..FAR_Y + 2 {
            self.left[y * WIDTH] = NOT_REACHED;
            self.left[y * WIDTH + WIDTH - 1] = NOT_REACHED;
        }
        self.left[..WIDTH].fill(NOT_REACHED);
        self.left[CELLS - WIDTH..].fill(NOT_REACHED);
        for y in 0..FAR_Y {
            let row = |y: usize| &self.left[y * WIDTH..(y + 1) * WIDTH];
            let (before, here, after) = (row(y), row(y + 1), row(y + 2));
            let detours = &mut self.detour_m[FIRST + y * WIDTH..][..FAR_X];
            for (x, detour_m) in detours.iter_mut().enumerate() {
                // The fine map knows better whether the cell itself is occupied.
                let straight = before[x + 1].min(after[x + 1]).min(here[x]).min(here[x + 2]);
                let diagonal = before[x].min(before[x + 2]).min(after[x]).min(after[x + 2]);
                let left = here[x + 1].min(straight + STRAIGHT).min(diagonal + DIAGONAL);
                let open = open_cost(self.min_cell, x, y, goal);
                let detour = left.saturating_sub(open + ignored);
                *detour_m = detour as f32 * (FAR_CELL_M as f32 / STRAIGHT as f32);
            }
        }
    }
}

/// The cost of the path from a cell of the window that begins at `min_cell` to `goal` without obstacles, in steps to
/// eight sides.
fn open_cost(min_cell: Cell, x: usize, y: usize, goal: [i32; 2]) -> u32 {
    let along =
        |axis: usize, offset: usize| goal[axis].abs_diff(min_cell[axis].saturating_add(offset as i32));
    let (x, y) = (along(0, x), along(1, y));
    let (short, long) = (x.min(y).min(1 << 20), x.max(y).min(1 << 20));
    short * DIAGONAL + (long - short) * STRAIGHT
}

/// The cells of the window: their place in memory, x and y.
fn cells() -> impl Iterator<Item = (usize, usize, usize)> {
    (0..FAR_Y).flat_map(|y| (0..FAR_X).map(move |x| (FIRST + y * WIDTH + x, x, y)))
}

fn is_on_border(x: usize, y: usize) -> bool {
    x == 0 || y == 0 || x == FAR_X - 1 || y == FAR_Y - 1
}

/// The eight neighbours of a cell of the window, and the cost of a step to each through what is free.
#[inline]
fn neighbours(at: usize) -> [(usize, u32); 8] {
    [
        (at - 1, STRAIGHT),
        (at + 1, STRAIGHT),
        (at - WIDTH, STRAIGHT),
        (at + WIDTH, STRAIGHT),
        (at - WIDTH - 1, DIAGONAL),
        (at - WIDTH + 1, DIAGONAL),
        (at + WIDTH - 1, DIAGONAL),
        (at + WIDTH + 1, DIAGONAL),
    ]
}

#[cfg(test)]
mod tests {
    use super::{DetourMap, cells};
    use jink_shared_types::far_map::{FAR_CELL_M, FAR_X, FarMap, set};
    use jink_shared_types::frames::Point;
    use jink_shared_types::map::cell_of;
    use proptest::prelude::*;

    /// A map around the origin in which all cells at the height of flight are occupied whose centre `is_occupied` (m).
    fn map(is_occupied: impl Fn(f64, f64) -> bool) -> Box<FarMap> {
        let mut map = FarMap::boxed();
        map.min_cell = [-(FAR_X as i32) / 2, -(FAR_X as i32) / 2, -16];
        for (_, x, y) in cells() {
            let cell = [0, 1].map(|axis| map.min_cell[axis] + [x, y][axis] as i32);
            let [x_m, y_m] = cell.map(|cell| (f64::from(cell) + 0.5) * FAR_CELL_M);
            if is_occupied(x_m, y_m) {
                set(&mut map.occupied, [cell[0], cell[1], -7]);
            }
        }
        map
    }

    fn far(map: &FarMap, goal: [f64; 2]) -> DetourMap {
        let mut far = DetourMap::default();
        let at = |[x, y]: [f64; 2]| Point::new(x, y, -2.5);
        far.make(map, 1, &at(goal), &at([0.0; 2]), true);
        far
    }

    fn detour_m(far: &DetourMap, x_m: f64, y_m: f64) -> f32 {
        far.detour_m(cell_of(Point::new(x_m, y_m, -2.5)))
    }

    #[test]
    fn where_nothing_stands_nothing_is_a_detour() {
        for goal in [[30.0, 5.0], [300.0, -80.0]] {
            let far = far(&map(|_, _| false), goal);
            assert!(far.detour_m.iter().all(|detour_m| *detour_m == 0.0));
        }
    }

    #[test]
    fn a_gap_that_the_fine_map_has_shown_to_be_too_narrow_is_gone_round() {
        // A wall with a gap of three cells before the goal, and an end 12 m aside.
        let wall = |x: f64, y: f64| (19.8..20.6).contains(&x) && y > -12.0 && !(-0.6..0.6).contains(&y);
        let (map, goal, here) = (
            map(wall),
            Point::new(40.0, 0.0, -2.5),
            Point::new(14.0, 0.0, -2.5),
        );
        let mut far = DetourMap::default();
        let mut number = 0;
        let mut at_the_gap = |far: &mut DetourMap| {
            number += 1;
            far.make(&map, number, &goal, &here, true);
            detour_m(far, 18.0, 0.0)
        };
        let before = at_the_gap(&mut far);
        assert!(before < 4.0, "{before}");
        let in_the_gap = |x: f64, y: f64| (19.4..21.0).contains(&x) && y.abs() < 0.6;
        far.too_narrow_mut().learn(&map, &here, 11.0, in_the_gap);
        let learned = at_the_gap(&mut far);
        assert!(learned > before + 4.0, "{learned}");
        // Seen from elsewhere it is remembered, near it the newest look decides, and another goal begins anew.
        far.too_narrow_mut()
            .learn(&map, &Point::new(14.0, 30.0, -2.5), 11.0, |_, _| false);
        assert_eq!(at_the_gap(&mut far), learned);
        far.too_narrow_mut().learn(&map, &here, 11.0, |_, _| false);
        assert_eq!(at_the_gap(&mut far), before);
        far.too_narrow_mut().learn(&map, &here, 11.0, in_the_gap);
        far.too_narrow_mut().clear();
        assert_eq!(at_the_gap(&mut far), before);
    }

    #[test]
    fn a_wall_is_a_detour_by_the_length_of_the_path_round_it() {
        let far = far(&map(|x, y| (19.8..20.6).contains(&x) && y > -9.0), [40.0, 0.0]);
        // In steps to eight sides the detour is at most 20 cells of 0.4 m to the side longer than the straight line.
        let at_it = detour_m(&far, 18.0, 0.0);
        assert!((4.0..14.0).contains(&at_it), "{at_it}");
        assert!(detour_m(&far, 18.0, 8.0) > at_it + 4.0);
        assert_eq!(detour_m(&far, 25.0, 0.0), 0.0, "behind it");
    }

    #[test]
    fn a_dead_end_costs_what_it_takes_to_leave_it() {
        let is_trap = |x: f64, y: f64| {
            let back = (19.8..20.6).contains(&x) && y.abs() < 4.6;
            let sides = (8.0..20.6).contains(&x) && (4.0..4.6).contains(&y.abs());
            back || sides
        };
        let far = far(&map(is_trap), [40.0, 0.0]);
        let (inside, before) = (detour_m(&far, 18.0, 0.0), detour_m(&far, 0.0, 0.0));
        assert!(inside > 12.0 && before < 0.25 * inside, "{inside} {before}");
    }

    #[test]
    fn what_stands_at_another_height_is_not_in_the_way() {
        let map = map(|x, _| (19.8..20.6).contains(&x));
        let mut far = DetourMap::default();
        far.make(
            &map,
            1,
            &Point::new(40.0, 0.0, -5.5),
            &Point::new(0.0, 0.0, -5.0),
            true,
        );
        assert_eq!(detour_m(&far, 18.0, 0.0), 0.0);
    }

    #[test]
    fn without_a_map_there_is_no_detour() {
        let mut far = far(&map(|x, _| (19.8..20.6).contains(&x)), [40.0, 0.0]);
        assert!(detour_m(&far, 18.0, 0.0) > 10.0);
        far.reset();
        assert_eq!(detour_m(&far, 18.0, 0.0), 0.0);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]

        #[test]
        fn more_obstacles_never_make_a_path_shorter(
            walls in prop::collection::vec((-40.0..40.0f64, -40.0..40.0f64, 0.5..8.0f64), 1..12),
            goal in (-80.0..80.0f64, -80.0..80.0f64),
        ) {
            let inside = |walls: &[(f64, f64, f64)], x: f64, y: f64| {
                walls.iter().any(|(wall_x, wall_y, half)| (x - wall_x).abs() < *half && (y - wall_y).abs() < *half)
            };
            let fewer = far(&map(|x, y| inside(&walls[1..], x, y)), [goal.0, goal.1]);
            let all = far(&map(|x, y| inside(&walls, x, y)), [goal.0, goal.1]);
            prop_assert!(fewer.left.iter().zip(&all.left).all(|(fewer, all)| fewer <= all));
            prop_assert!(all.detour_m.iter().all(|detour_m| detour_m.is_finite() && *detour_m >= 0.0));
        }
    }
}
