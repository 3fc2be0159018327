//! A* over the inflated map: the guide to the goal, through unknown space where necessary, at a cost.
//!
//! 26-connected on the cells of the speed tier; a diagonal step needs every cell it touches. The search ends at the
//! goal, at the window's border (where the straight line to the goal, and the detour of the far map, are the best
//! estimate of the rest), or, if neither can be reached, at the cell nearest to the goal.

use crate::bit_layer::BitLayer;
use crate::configuration_space::ConfigurationSpace;
use crate::detours::DetourMap;
use crate::speed_tiers::TIERS;
use jink_shared_types::map::{CELL_M, Cell, SIZE_X, SIZE_Y, SIZE_Z};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Cost of a metre that is not known to be free. Above 1 so that seen space is preferred; low enough that a short path
/// into the unknown beside a trunk costs less than a long path round it.
const UNKNOWN_FACTOR: f32 = 1.6;
/// Cost of a metre beyond the window, where the path cannot even be estimated.
const BEYOND_FACTOR: f32 = 1.3;
/// Cost of a metre nearer to an obstacle than is comfortable.
const NEAR_FACTOR: f32 = 1.6;
/// Cost of a metre along the previous guide: keeps the choice of side between two equal paths.
const PREFERRED_FACTOR: f32 = 0.85;
/// Weight of the remaining straight distance: above the cheapest cost of a metre, so that the search is drawn to the
/// goal instead of expanding everything known; a path costs at most this over [`PREFERRED_FACTOR`] more than the best.
/// (Weighted A*, Pohl 1970.) In forests 1.3 expands a tenth of the cells of 0.85 for paths 2 % longer.
const HEURISTIC_WEIGHT: f32 = 1.3;
/// Most cells expanded in one search: bounds its time to some 10 ms; what was found by then is used. A dead end of 10 m
/// by 10 m in the search's height band has about as many cells.
const EXPANSIONS_MAX: usize = 24_000;
/// An occupied goal (a waypoint in a tree) is replaced by the nearest free place, searched this many cells around:
/// otherwise the search would expand everything before it ends.
const FREE_GOAL_CELLS: i32 = 20;
/// The end of a path that does not reach its goal stays the same as long as no other place is nearer to the goal by
/// more than this (cells): the map's noise would move it from side to side of a trunk, and the vehicle after it.
const SAME_END_CELLS: f32 = 3.0;

/// The far map is used for a goal in the window if no path was found and its detour is longer than this (m).
const DEAD_END_M: f32 = 2.0;

/// The path out of a narrow place is no longer than this (m): beyond, it would be a path through it.
const ESCAPE_MAX_M: f32 = 4.0;

/// Candidate viewpoints lie this many of the map's cells apart.
const REACHABLE_STEP: [i32; 3] = [3, 3, 2];

const CELLS: usize = SIZE_X * SIZE_Y * SIZE_Z;

/// Where a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PathEnd {
    /// At the goal.
    Goal,
    /// At the border of the window, on the path to a goal beyond.
    Window,
    /// At the reachable cell nearest to the goal.
    NearestPoint,
}

/// A cell that the vehicle can reach, and the path to it.
#[derive(Clone, Copy, Debug)]
pub struct ReachableCell {
    /// The cell.
    pub cell: Cell,
    /// Length of the path to it (m).
    pub path_m: f32,
}

/// A path from cell to cell.
#[derive(Clone, Debug)]
pub struct Path {
    /// The speed tier whose cells they are.
    pub tier: usize,
    /// The cells, the start first.
    pub cells: Vec<Cell>,
}

impl Default for Path {
    fn default() -> Self {
        Self {
            tier: 0,
            cells: Vec::with_capacity(4096),
        }
    }
}

/// The result of a search.
#[derive(Clone, Copy, Debug)]
pub struct SearchResult {
    /// Where it ends.
    pub end: PathEnd,
    /// Estimated cost of the whole path to the goal (m, weighted).
    pub cost_m: f32,
    /// Straight distance from its end to the goal (m).
    pub remaining_m: f32,
    /// The goal is occupied.
    pub goal_is_occupied: bool,
}

/// One step of the 26 neighbours.
#[derive(Clone, Copy, Debug)]
struct NeighbourStep {
    by: Cell,
    /// In cells.
    length: f64,
    /// Bits of the 27-neighbourhood (`(dz + 1) * 9 + (dy + 1) * 3 + dx + 1`) that must be free.
    needs: u32,
}

/// Reusable memory of a search.
#[derive(Debug)]
pub struct Search {
    steps: Vec<NeighbourStep>,
    cost_m: Vec<f32>,
    came_from_step: Vec<u8>,
    visit: Vec<u32>,
    round: u32,
    open: BinaryHeap<Reverse<u64>>,
    path: Path,
    /// Edge of the cells that are searched (m).
    cell_m: f64,
    /// Of the map's cells.
    preferred: BitLayer,
    /// For each speed tier the last goal that was not reached, and where the path ended instead.
    ends: [Option<(Cell, Cell)>; TIERS],
    expansions: usize,
    /// The detours beyond the window.
    detours: DetourMap,
}

impl Default for Search {
    fn default() -> Self {
        Self {
            steps: steps(),
            cost_m: vec![0.0; CELLS],
            came_from_step: vec![0; CELLS],
            visit: vec![0; CELLS],
            round: 0,
            open: BinaryHeap::with_capacity(8 * EXPANSIONS_MAX),
            path: Path::default(),
            cell_m: CELL_M,
            preferred: BitLayer::default(),
            ends: [None; TIERS],
            expansions: 0,
            detours: DetourMap::default(),
        }
    }
}

fn steps() -> Vec<NeighbourStep> {
    let bit = |dx: i32, dy: i32, dz: i32| 1u32 << ((dz + 1) * 9 + (dy + 1) * 3 + dx + 1);
    let mut steps = Vec::with_capacity(26);
    for dz in -1..=1 {
        for dy in -1..=1 {
            for dx in -1..=1i32 {
                if (dx, dy, dz) == (0, 0, 0) {
                    continue;
                }
                let mut needs = 0;
                for x in [0, dx] {
                    for y in [0, dy] {
                        for z in [0, dz] {
                            needs |= bit(x, y, z);
                        }
                    }
                }
                let cells = f64::from(dx * dx + dy * dy + dz * dz).sqrt();
                steps.push(NeighbourStep {
                    by: [dx, dy, dz],
                    length: cells,
                    needs: needs & !bit(0, 0, 0),
                });
            }
        }
    }
    steps
}

fn index_of(cell: Cell) -> usize {
    let x = cell[0] as usize & (SIZE_X - 1);
    let y = cell[1] as usize & (SIZE_Y - 1);
    let z = cell[2] as usize & (SIZE_Z - 1);
    (z * SIZE_Y + y) * SIZE_X + x
}

/// The cell inside the window that starts at `min_cell` and has the memory `index`.
fn cell_at(index: usize, min_cell: Cell) -> Cell {
    let local = [index % SIZE_X, index / SIZE_X % SIZE_Y, index / (SIZE_X * SIZE_Y)];
    let size = [SIZE_X, SIZE_Y, SIZE_Z];
    std::array::from_fn(|axis| {
        let offset = local[axis].wrapping_sub(min_cell[axis] as usize) & (size[axis] - 1);
        min_cell[axis] + offset as i32
    })
}

/// The parameters of a search.
#[derive(Clone, Copy, Debug)]
pub struct SearchQuery {
    /// The speed tier whose radius and cells are used.
    pub tier: usize,
    /// Where the path begins.
    pub start: Cell,
    /// Where it should end; may lie outside the window.
    pub goal: Cell,
    /// Lowest and highest z index allowed (z points down).
    pub z_range: (i32, i32),
    /// Additional cost of a metre of height.
    pub height_cost: f32,
}

impl Search {
    /// The last path found.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Exchanges the path with `other`: keeps a good one while others are searched for.
    pub fn swap_path(&mut self, other: &mut Path) {
        std::mem::swap(&mut self.path, other);
    }

    /// Forgets the preference for earlier paths.
    pub fn reset(&mut self) {
        self.preferred.clear();
        self.ends = [None; TIERS];
    }

    /// Makes the last path found, one cell to each side, the preferred path of the next searches.
    pub fn prefer_path(&mut self, space: &ConfigurationSpace) {
        self.preferred.clear();
        for cell in &self.path.cells {
            let cell = space.map_cell(self.path.tier, *cell);
            for dx in -1..=1 {
                for dy in -1..=1 {
                    self.preferred.set([cell[0] + dx, cell[1] + dy, cell[2]]);
                }
            }
        }
    }

    /// The detours beyond the window.
    pub fn detours_mut(&mut self) -> &mut DetourMap {
        &mut self.detours
    }

    /// How much longer than the straight line the path from `cell` is by the far map (m).
    pub fn detour_m(&self, cell: Cell) -> f32 {
        self.detours.detour_m(cell)
    }

    /// Searches; `None` if the start itself is too near to an obstacle or outside the window.
    pub fn run(&mut self, space: &ConfigurationSpace, query: &SearchQuery) -> Option<SearchResult> {
        let tier = query.tier;
        if !space.holds(tier, query.start) || space.is_hit(tier, query.start) {
            return None;
        }
        let is_beyond = !space.holds(tier, query.goal);
        let found = self.run_guided(space, query, is_beyond);
        // Within the window the fine map knows best, unless all that it knows is a dead end.
        let is_dead_end = !is_beyond && found.end == PathEnd::NearestPoint && !found.goal_is_occupied;
        if is_dead_end && self.detours.detour_m(space.map_cell(tier, query.start)) > DEAD_END_M {
            return Some(self.run_guided(space, query, true));
        }
        Some(found)
    }

    /// Searches from a free start; with `use_detours`, the far map estimates the path beyond the window.
    fn run_guided(
        &mut self,
        space: &ConfigurationSpace,
        query: &SearchQuery,
        use_detours: bool,
    ) -> SearchResult {
        let before = self.ends[query.tier]
            .filter(|(goal, _)| *goal == query.goal)
            .map(|(_, end)| end);
        let goal = nearest_free_goal(space, query, before);
        let is_occupied = goal != query.goal;
        self.begin(space, query.tier, query.start);
        let mut nearest = (f32::INFINITY, query.start);
        while let Some((cell, index)) = self.close_next(space) {
            let remaining_m = self.remaining_m(space, cell, goal, use_detours);
            if remaining_m < nearest.0 {
                nearest = (remaining_m, cell);
            }
            if cell == goal && is_occupied {
                return self.finish_short(space, query, cell, true);
            }
            if cell == goal {
                self.ends[query.tier] = None;
                return self.finish(space, cell, PathEnd::Goal, 0.0, 0.0);
            }
            if on_shell(space, query.tier, cell) && cell != query.start {
                return self.finish(space, cell, PathEnd::Window, remaining_m, BEYOND_FACTOR);
            }
            self.expansions += 1;
            if self.expansions >= EXPANSIONS_MAX {
                break;
            }
            self.expand(space, query, &goal, use_detours, cell, index);
        }
        let end = before
            .filter(|cell| space.holds(query.tier, *cell) && self.visit[index_of(*cell)] == self.round + 1)
            .filter(|cell| {
                self.remaining_m(space, *cell, goal, use_detours)
                    <= nearest.0 + SAME_END_CELLS * self.cell_m as f32
            })
            .unwrap_or(nearest.1);
        self.finish_short(space, query, end, is_occupied)
    }

    /// The estimated rest from `cell` to `goal` (m): the straight line, and, with `use_detours`, the far map's detour.
    #[inline]
    fn remaining_m(&self, space: &ConfigurationSpace, cell: Cell, goal: Cell, use_detours: bool) -> f32 {
        let detour_m = if use_detours {
            self.detours.detour_m(space.map_cell(self.path.tier, cell))
        } else {
            0.0
        };
        self.straight_m(cell, goal) + detour_m
    }

    /// Straight distance between the centres of two cells (m).
    #[inline]
    fn straight_m(&self, a: Cell, b: Cell) -> f32 {
        let square: f64 = (0..3)
            .map(|axis| (f64::from(a[axis]) - f64::from(b[axis])).powi(2))
            .sum();
        (square.sqrt() * self.cell_m) as f32
    }

    /// Ends a path short of its goal; the next one ends at the same place.
    fn finish_short(
        &mut self,
        space: &ConfigurationSpace,
        query: &SearchQuery,
        end: Cell,
        goal_is_occupied: bool,
    ) -> SearchResult {
        self.ends[query.tier] = Some((query.goal, end));
        let remaining_m = self.straight_m(end, query.goal);
        SearchResult {
            goal_is_occupied,
            ..self.finish(space, end, PathEnd::NearestPoint, remaining_m, 1.0)
        }
    }

    /// The shortest path from `start`, where `tier` has not enough clearance, to a cell where it has; `false` if there
    /// is none near.
    pub fn escape_path(&mut self, space: &ConfigurationSpace, tier: usize, start: Cell) -> bool {
        let anywhere = (i32::MIN, i32::MAX);
        let out = self.expand_dijkstra(space, tier, start, ESCAPE_MAX_M, anywhere, |cell, _| {
            cell != start && space.has_clearance(tier, cell)
        });
        if let Some(cell) = out {
            self.finish(space, cell, PathEnd::NearestPoint, 0.0, 0.0);
        }
        out.is_some()
    }

    /// Puts into `places` what can be reached from `start` in `tier` by paths of `reach_m` at most, nearest first:
    /// every third cell of each row and every second row, and `start` itself.
    pub fn reachable_cells(
        &mut self,
        space: &ConfigurationSpace,
        tier: usize,
        start: Cell,
        reach_m: f32,
        z_range: (i32, i32),
        places: &mut Vec<ReachableCell>,
    ) {
        places.clear();
        let step = REACHABLE_STEP.map(|cells| cells * space.per_cell(tier));
        self.expand_dijkstra(space, tier, start, reach_m, z_range, |cell, path_m| {
            let [x, y, z] = std::array::from_fn(|axis| (cell[axis] - start[axis]).rem_euclid(step[axis]));
            if x + y + z == 0 && places.len() < places.capacity() {
                places.push(ReachableCell { cell, path_m });
            }
            false
        });
    }

    /// Makes the path to `cell`, one of the places of the last [`Search::reachable_cells`], the path.
    pub fn path_to(&mut self, space: &ConfigurationSpace, cell: Cell) {
        self.path.cells.clear();
        self.finish(space, cell, PathEnd::NearestPoint, 0.0, 0.0);
    }

    /// Expands the cells that can be reached from `start` in `tier`, nearest first, until `is_end` or until the path is
    /// longer than `max_m`; returns where it ended.
    fn expand_dijkstra(
        &mut self,
        space: &ConfigurationSpace,
        tier: usize,
        start: Cell,
        max_m: f32,
        z_range: (i32, i32),
        mut is_end: impl FnMut(Cell, f32) -> bool,
    ) -> Option<Cell> {
        if !space.is_safe(tier, start) {
            return None;
        }
        self.begin(space, tier, start);
        while let Some((cell, index)) = self.close_next(space) {
            let path_m = self.cost_m[index];
            if is_end(cell, path_m) {
                return Some(cell);
            }
            self.expansions += 1;
            if path_m > max_m || self.expansions >= EXPANSIONS_MAX {
                return None;
            }
            let safe = neighbours_outside(space.blocked(tier), cell);
            for number in 0..self.steps.len() {
                let step = self.steps[number];
                let next: Cell = std::array::from_fn(|axis| cell[axis] + step.by[axis]);
                let is_within = (z_range.0..=z_range.1).contains(&next[2]);
                if !is_within || safe & step.needs != step.needs || !space.is_safe(tier, next) {
                    continue;
                }
                let next_index = index_of(next);
                let cost_m = path_m + (step.length * self.cell_m) as f32;
                let is_known = self.visit[next_index] == self.round && self.cost_m[next_index] <= cost_m;
                if !is_known && self.visit[next_index] != self.round + 1 {
                    self.visit[next_index] = self.round;
                    self.cost_m[next_index] = cost_m;
                    self.came_from_step[next_index] = number as u8;
                    self.push(cost_m, next);
                }
            }
        }
        None
    }

    /// Opens `start` alone, a cell of `tier`.
    fn begin(&mut self, space: &ConfigurationSpace, tier: usize, start: Cell) {
        // Two marks per round: open and closed. On overflow the memory is cleared once in 2^31 rounds.
        self.round = match self.round.checked_add(2) {
            Some(round) if round < u32::MAX - 1 => round,
            _ => {
                self.visit.fill(0);
                2
            }
        };
        self.open.clear();
        self.path.tier = tier;
        self.cell_m = space.cell_m(tier);
        self.path.cells.clear();
        self.expansions = 0;
        let first = index_of(start);
        self.cost_m[first] = 0.0;
        self.came_from_step[first] = u8::MAX;
        self.visit[first] = self.round;
        self.push(0.0, start);
    }

    /// Closes the most promising open cell, and returns it with its index.
    fn close_next(&mut self, space: &ConfigurationSpace) -> Option<(Cell, usize)> {
        loop {
            let Reverse(key) = self.open.pop()?;
            let index = (key & u64::from(u32::MAX)) as usize;
            if self.visit[index] != self.round + 1 {
                self.visit[index] = self.round + 1;
                return Some((cell_at(index, space.min_cell(self.path.tier)), index));
            }
        }
    }

    /// Opens `cell`; the estimated cost of a path through it is `estimate_m`.
    fn push(&mut self, estimate_m: f32, cell: Cell) {
        // Positive floats sort like their bits; the index breaks ties the same way every time.
        let key = u64::from(estimate_m.to_bits()) << 32 | index_of(cell) as u64;
        self.open.push(Reverse(key));
    }

    fn expand(
        &mut self,
        space: &ConfigurationSpace,
        query: &SearchQuery,
        goal: &Cell,
        use_detours: bool,
        cell: Cell,
        index: usize,
    ) {
        let free = neighbours_outside(space.hit(query.tier), cell);
        let safe = neighbours_outside(space.blocked(query.tier), cell);
        let here_m = self.cost_m[index];
        for number in 0..self.steps.len() {
            let step = self.steps[number];
            if free & step.needs != step.needs {
                continue;
            }
            let next: Cell = std::array::from_fn(|axis| cell[axis] + step.by[axis]);
            if next[2] < query.z_range.0 || next[2] > query.z_range.1 || !space.holds(query.tier, next) {
                continue;
            }
            let next_index = index_of(next);
            if self.visit[next_index] == self.round + 1 {
                continue;
            }
            let cost_m =
                here_m + self.step_cost_m(space, query, next, &step, safe & step.needs == step.needs);
            if self.visit[next_index] != self.round || cost_m < self.cost_m[next_index] {
                self.visit[next_index] = self.round;
                self.cost_m[next_index] = cost_m;
                self.came_from_step[next_index] = number as u8;
                let remaining_m = self.remaining_m(space, next, *goal, use_detours);
                self.push(cost_m + HEURISTIC_WEIGHT * remaining_m, next);
            }
        }
    }

    /// Cost of a step to `next`; `is_safe` if it touches no unsafe cell.
    fn step_cost_m(
        &self,
        space: &ConfigurationSpace,
        query: &SearchQuery,
        next: Cell,
        step: &NeighbourStep,
        is_safe: bool,
    ) -> f32 {
        let mut factor = 1.0;
        let map_cell = space.map_cell(query.tier, next);
        if space.is_near(map_cell) {
            factor *= NEAR_FACTOR;
        } else if !is_safe {
            factor *= UNKNOWN_FACTOR;
        }
        if self.preferred.test(map_cell) {
            factor *= PREFERRED_FACTOR;
        }
        (step.length * self.cell_m) as f32 * factor
            + query.height_cost * self.cell_m as f32 * step.by[2].abs() as f32
    }

    fn finish(
        &mut self,
        space: &ConfigurationSpace,
        end: Cell,
        kind: PathEnd,
        remaining_m: f32,
        factor: f32,
    ) -> SearchResult {
        let cost_m = self.cost_m[index_of(end)] + factor * remaining_m;
        let mut cell = end;
        loop {
            self.path.cells.push(cell);
            let Some(step) = self.steps.get(self.came_from_step[index_of(cell)] as usize) else {
                break;
            };
            cell = std::array::from_fn(|axis| cell[axis] - step.by[axis]);
            if !space.holds(self.path.tier, cell) {
                break;
            }
        }
        self.path.cells.reverse();
        SearchResult {
            end: kind,
            cost_m,
            remaining_m,
            goal_is_occupied: false,
        }
    }
}

/// The goal, or, if it is occupied, a free cell nearest to it: `before` while it is about as near as any other, else
/// the one nearest to the start. The goal again if there is none near.
fn nearest_free_goal(space: &ConfigurationSpace, query: &SearchQuery, before: Option<Cell>) -> Cell {
    let goal = query.goal;
    let is_open = |cell: Cell| {
        (query.z_range.0..=query.z_range.1).contains(&cell[2])
            && space.holds(query.tier, cell)
            && !space.is_hit(query.tier, cell)
    };
    if !space.holds(query.tier, goal) || is_open(goal) {
        return goal;
    }
    let mut nearest = i32::MAX;
    visit_cubes(goal, |cell, square| {
        if square < nearest && is_open(cell) {
            nearest = square;
        }
        nearest
    });
    if nearest == i32::MAX {
        return goal;
    }
    let within = |more_cells: f64| (f64::from(nearest).sqrt() + more_cells).powi(2) as i32;
    let same = within(f64::from(SAME_END_CELLS));
    if let Some(before) = before.filter(|cell| distance_squared_cells(*cell, goal) <= same && is_open(*cell))
    {
        return before;
    }
    let limit = within(1.0);
    let mut best = (i32::MAX, goal);
    visit_cubes(goal, |cell, square| {
        let away = distance_squared_cells(cell, query.start);
        if square <= limit && away < best.0 && is_open(cell) {
            best = (away, cell);
        }
        limit
    });
    best.1
}

/// Visits the cells around `centre` cube by cube outwards, with the square of their distance; a cell of a later cube is
/// at least as far away as its half side, so it ends where that exceeds the result of `visit`.
fn visit_cubes(centre: Cell, mut visit: impl FnMut(Cell, i32) -> i32) {
    let mut limit = i32::MAX;
    for half in 1..=FREE_GOAL_CELLS {
        if half * half > limit {
            return;
        }
        for dz in -half..=half {
            for dy in -half..=half {
                let on_side = dz.abs() == half || dy.abs() == half;
                let step = if on_side { 1 } else { 2 * half };
                for dx in (-half..=half).step_by(step as usize) {
                    let cell = [centre[0] + dx, centre[1] + dy, centre[2] + dz];
                    limit = visit(cell, dx * dx + dy * dy + dz * dz);
                }
            }
        }
    }
}

fn distance_squared_cells(a: Cell, b: Cell) -> i32 {
    (0..3).map(|axis| (a[axis] - b[axis]).pow(2)).sum()
}

/// Whether `cell` lies in the outermost two cells of what the layers of `tier` hold.
fn on_shell(space: &ConfigurationSpace, tier: usize, cell: Cell) -> bool {
    let min = space.min_cell(tier);
    let size = [SIZE_X as i32, SIZE_Y as i32, SIZE_Z as i32];
    (0..3).any(|axis| {
        let offset = cell[axis] - min[axis];
        offset < 2 || offset >= size[axis] - 2
    })
}

/// The 27 cells around `cell` that are not in `layer`, as bits.
fn neighbours_outside(bit_layer: &BitLayer, cell: Cell) -> u32 {
    let shift = jink_shared_types::map::bit_of(cell);
    let mut free = 0;
    let mut place = 0;
    for dz in -1..=1 {
        for dy in -1..=1 {
            let row = bit_layer.row_at([cell[0], cell[1] + dy, cell[2] + dz]);
            // Bits x-1, x, x+1, rotated to the bottom.
            let three = row.rotate_right(shift).rotate_left(1) as u32 & 0b111;
            free |= (!three & 0b111) << place;
            place += 3;
        }
    }
    free
}

#[cfg(test)]
mod tests {
    use super::{PathEnd, Search, SearchQuery, cell_at, index_of};
    use crate::configuration_space::tests::{known_map, space_of};
    use proptest::prelude::*;

    fn query(tier: usize, goal: [i32; 3]) -> SearchQuery {
        SearchQuery {
            tier,
            start: [0, 0, 0],
            goal,
            z_range: (-20, 20),
            height_cost: 0.5,
        }
    }

    proptest! {
        #[test]
        fn memory_and_cells_map_onto_each_other(
            min in proptest::array::uniform3(-1000..1000i32), offset in (0..128i32, 0..128i32, 0..64i32),
        ) {
            let cell = [min[0] + offset.0, min[1] + offset.1, min[2] + offset.2];
            prop_assert_eq!(cell_at(index_of(cell), min), cell);
        }
    }

    #[test]
    fn an_open_field_is_crossed_straight() {
        let space = space_of(&known_map(|_| false));
        let mut search = Search::default();
        let found = search.run(&space, &query(0, [40, 0, 0])).unwrap();
        assert_eq!(found.end, PathEnd::Goal);
        assert_eq!(search.path().cells.len(), 41);
        assert!(
            search
                .path()
                .cells
                .iter()
                .all(|cell| cell[1] == 0 && cell[2] == 0)
        );
    }

    #[test]
    fn a_path_keeps_clear_of_every_obstacle_and_no_step_cuts_a_corner() {
        let map = known_map(|p| (p.x - 4.0).hypot(p.y) < 0.5 || (p.x - 6.0).hypot(p.y - 2.0) < 0.5);
        let space = space_of(&map);
        let mut search = Search::default();
        let found = search.run(&space, &query(0, [50, 3, 0])).unwrap();
        assert_eq!(found.end, PathEnd::Goal);
        for pair in search.path().cells.windows(2) {
            for x in [pair[0][0], pair[1][0]] {
                for y in [pair[0][1], pair[1][1]] {
                    for z in [pair[0][2], pair[1][2]] {
                        assert!(!space.is_hit(0, [x, y, z]));
                    }
                }
            }
        }
    }

    #[test]
    fn a_goal_beyond_the_window_is_approached_through_its_border() {
        let space = space_of(&known_map(|_| false));
        let mut search = Search::default();
        let found = search.run(&space, &query(0, [400, 0, 0])).unwrap();
        assert_eq!(found.end, PathEnd::Window);
        assert!(search.path().cells.last().unwrap()[0] >= 60);
    }

    #[test]
    fn a_walled_in_goal_is_approached_as_near_as_possible() {
        let wall = known_map(|p| (p.x - 6.0).abs() < 0.3);
        let space = space_of(&wall);
        let mut search = Search::default();
        let found = search.run(&space, &query(2, [45, 0, 0])).unwrap();
        assert_eq!(found.end, PathEnd::NearestPoint);
        let end = search.path().cells.last().unwrap();
        assert!((20..28).contains(&end[0]), "{end:?}");
    }

    #[test]
    fn a_goal_inside_an_obstacle_is_approached_without_flooding_the_map() {
        let space = space_of(&known_map(|p| (p.x - 8.1).hypot(p.y - 0.1) < 0.5));
        let mut search = Search::default();
        for tier in 0..3 {
            let found = search.run(&space, &query(tier, [40, 0, 0])).unwrap();
            assert_eq!(found.end, PathEnd::NearestPoint);
            // In a straight line up to the trunk: a path that is cheap only after expanding everything would not be
            // straight.
            let end = search.path().cells.last().unwrap();
            let reach = (0..40).filter(|x| space.is_hit(tier, [*x, 0, 0])).count() as i32;
            let off = f64::from((end[0] - 40).pow(2) + (end[1]).pow(2) + end[2].pow(2)).sqrt();
            assert!(off <= f64::from(reach) + 2.0, "{end:?}, {reach}");
            assert!(search.expansions < 2_000, "{}", search.expansions);
        }
    }

    #[test]
    fn where_a_path_ends_short_of_its_goal_stays_the_same_while_the_map_wobbles() {
        let mut search = Search::default();
        let mut first = None;
        for noise in 0..8 {
            let angle = f64::from(noise) * 0.8;
            let (x, y) = (8.1 + 0.1 * angle.cos(), 0.1 + 0.1 * angle.sin());
            let space = space_of(&known_map(|p| (p.x - x).hypot(p.y - y) < 0.5));
            let found = search.run(&space, &query(1, [40, 0, 0])).unwrap();
            assert!(found.goal_is_occupied);
            let end = *search.path().cells.last().unwrap();
            assert_eq!(end, *first.get_or_insert(end));
        }
    }

    #[test]
    fn a_start_inside_an_obstacle_has_no_path() {
        let space = space_of(&known_map(|p| p.norm() < 0.5));
        assert!(Search::default().run(&space, &query(0, [40, 0, 0])).is_none());
    }
}
