//! A* over the inflated map: the guide to the goal, through unknown space where necessary, at a cost.
//!
//! 26-connected on the cells of the speed tier; a diagonal step needs every cell it touches. The search ends at the
//! goal, at the window's border (where the straight line to the goal, and the detour of the far map, are the best
//! estimate of the rest), or, if neither can be reached, at the cell nearest to the goal.
//!
//! The straight line is a good estimate where little is in the way. A search that has not ended after 1,500 cells is in
//! a dead end, or before one; it is begun again with the distances round what is in the way (`goal_distances`). They
//! also show at once whether goal and border can be reached at all.
//!
//! A passage that has turned out too narrow from nearby twice costs more from then on (`failed_passages`).

mod dijkstra;
mod expansion;
mod failed_passages;
mod free_goal;
mod goal_distances;
mod neighbours;
mod window;

pub use dijkstra::ReachableCell;

use crate::bit_layer::BitLayer;
use crate::configuration_space::ConfigurationSpace;
use crate::detours::DetourMap;
use crate::speed_tiers::TIERS;
use expansion::Expanded;
use failed_passages::FailedPassages;
use free_goal::nearest_free_goal;
use goal_distances::{CUBE_CELLS, GoalDistances, cells_of};
use jink_shared_types::Timestamp;
use jink_shared_types::map::{CELL_M, Cell};
use nalgebra::Vector3;
use neighbours::{NeighbourStep, steps};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use window::{CELLS, index_of};

/// Cost of a metre beyond the window, where the path cannot even be estimated.
const BEYOND_FACTOR: f32 = 1.3;
/// Most cells expanded at a time; what was found by then is used.
const EXPANSIONS_MAX: usize = 24_000;
/// A search with the straight line as estimate that has not ended after this many cells takes the distances round
/// what is in the way instead: they cost about as much as these cells.
const EXPANSIONS_SOON: usize = 1_500;
/// The end of a path that does not reach its goal stays the same as long as no other place is nearer to the goal by
/// more than this (cells): the map's noise would move it from side to side of a trunk, and the vehicle after it.
const SAME_END_CELLS: f32 = 3.0;

/// A passage that turns out too narrow from farther away than this (m) was not tried.
const APPROACHED_M: f64 = 4.0;

/// The far map is used for a goal in the window if no path was found and its detour is longer than this (m).
const DEAD_END_M: f32 = 2.0;
/// How much nearer to a goal that cannot be reached a path must lead for each metre that it is longer (m).
const PATH_WORTH: f32 = 0.1;
/// A path through the window's border to a goal in the window is taken if it is at most this much longer (m) than the
/// far map knows a path to be: out of a dead end it is about as long. Round an obstacle that encloses the goal it is
/// longer by the path to the border and back, and leads nowhere.
const ROUND_MARGIN_M: f32 = 6.0;

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

/// A path from cell to cell.
#[derive(Debug)]
pub struct Path {
    /// The speed tier whose cells they are.
    pub tier: usize,
    /// The cells, the start first.
    pub cells: Vec<Cell>,
}

impl Path {
    /// Becomes a copy of another one, in the memory that it has.
    pub fn copy(&mut self, other: &Self) {
        self.tier = other.tier;
        self.cells.clone_from(&other.cells);
    }
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
    /// Straight distance from its end to the goal, at the window's border with the far map's detour (m).
    pub remaining_m: f32,
    /// How much longer it is than the straight line (m), if that did not lead there soon: something large is in the
    /// way, and how far it reaches is a guess. Else 0.
    pub round_m: f32,
    /// The goal is occupied.
    pub goal_is_occupied: bool,
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
    /// What turned out too narrow on the way to this goal.
    failed: FailedPassages,
    /// For each speed tier the last goal that was not reached, and where the path ended instead.
    ends: [Option<(Cell, Cell)>; TIERS],
    /// For each speed tier the goal of the last search, if it did not end soon: the next will not either.
    long: [Option<Cell>; TIERS],
    /// The path into a dead end, while one out of it is searched for.
    dead_end_path: Path,
    expansions: usize,
    /// The detours beyond the window.
    detours: DetourMap,
    /// The distances round what is in the way.
    distances: Option<GoalDistances>,
}

/// What a search is drawn to.
#[derive(Clone, Copy, Debug)]
struct Aim {
    /// Where the path is to end.
    end: Cell,
    /// The goal, or the free cell in its place; another than `end` if it cannot be reached.
    goal: Cell,
    goal_is_occupied: bool,
    /// The far map estimates the path beyond the window.
    use_detours: bool,
    /// The distances round what is in the way estimate the path, not the straight line.
    use_distances: bool,
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
            failed: FailedPassages::default(),
            ends: [None; TIERS],
            long: [None; TIERS],
            dead_end_path: Path::default(),
            expansions: 0,
            detours: DetourMap::default(),
            distances: Some(GoalDistances::default()),
        }
    }
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

    /// Makes `path`, which was found before, the last path found.
    pub fn set_path(&mut self, path: &Path) {
        self.path.copy(path);
    }

    /// Exchanges the path with `other`: keeps a good one while others are searched for.
    pub fn swap_path(&mut self, other: &mut Path) {
        std::mem::swap(&mut self.path, other);
    }

    /// Forgets the preference for earlier paths, and which passages failed.
    pub fn reset(&mut self) {
        self.preferred.clear();
        self.failed.clear();
        self.ends = [None; TIERS];
        self.long = [None; TIERS];
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

    /// Forgets which passages failed: there is another goal.
    pub fn forget_failed_passages(&mut self) {
        self.failed.clear();
        self.detours.too_narrow_mut().clear();
    }

    /// Records where `path`, which the vehicle at `position` (local, m) was to follow, leads through a passage near it
    /// that has turned out too narrow. The tier of `path` has to be prepared, without what moves.
    pub fn record_failed_passage(
        &mut self,
        space: &ConfigurationSpace,
        path: &Path,
        position: &Vector3<f64>,
        now: Timestamp,
    ) {
        let tier = path.tier;
        let near = path.cells.iter().find(|cell| {
            space.holds(tier, **cell)
                && space.is_hit(tier, **cell)
                && (space.center_of(tier, **cell) - position).norm() < APPROACHED_M
        });
        if let Some(cell) = near {
            self.failed.record(tier, space.map_cell(tier, *cell), now);
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
        let detour_m = self.detours.detour_m(space.map_cell(tier, query.start));
        if !is_dead_end || detour_m <= DEAD_END_M {
            return Some(found);
        }
        let ends = self.ends[tier];
        std::mem::swap(&mut self.path, &mut self.dead_end_path);
        let round = self.run_guided(space, query, true);
        let known_m = self.straight_m(query.start, query.goal) + detour_m;
        let is_out = round.end != PathEnd::NearestPoint
            && self.path_m() + round.remaining_m <= known_m + ROUND_MARGIN_M;
        if is_out {
            return Some(round);
        }
        std::mem::swap(&mut self.path, &mut self.dead_end_path);
        self.ends[tier] = ends;
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
        let mut aim = Aim {
            end: goal,
            goal,
            goal_is_occupied: goal != query.goal,
            use_detours,
            use_distances: false,
        };
        let soon = if self.long[query.tier] == Some(query.goal) {
            EXPANSIONS_SOON / 4
        } else {
            EXPANSIONS_SOON
        };
        let mut expanded = self.expand_to(space, query, &aim, soon);
        let is_long = matches!(expanded, Expanded::Unfinished(_));
        self.long[query.tier] = is_long.then_some(query.goal);
        if is_long {
            aim = self.aim_round_obstacles(space, query, aim, before);
            expanded = self.expand_to(space, query, &aim, EXPANSIONS_MAX);
        }
        let found = match expanded {
            Expanded::End if aim.end == query.goal => {
                self.ends[query.tier] = None;
                self.finish(space, aim.end, PathEnd::Goal, 0.0, 0.0)
            }
            Expanded::End => self.finish_short(space, query, aim.end, aim.goal_is_occupied),
            Expanded::Border(cell) => {
                let remaining_m = self.remaining_m(space, cell, goal, use_detours);
                self.finish(space, cell, PathEnd::Window, remaining_m, BEYOND_FACTOR)
            }
            Expanded::Enclosed(nearest) | Expanded::Unfinished(nearest) => {
                let end = before
                    .filter(|cell| {
                        space.holds(query.tier, *cell) && self.visit[index_of(*cell)] == self.round + 1
                    })
                    .filter(|cell| {
                        self.remaining_m(space, *cell, goal, use_detours) <= self.same_end_m(nearest.0)
                    })
                    .unwrap_or(nearest.1);
                self.finish_short(space, query, end, aim.goal_is_occupied)
            }
        };
        let round_m = if is_long {
            (self.path_m() + found.remaining_m - self.straight_m(query.start, query.goal)).max(0.0)
        } else {
            0.0
        };
        SearchResult { round_m, ..found }
    }

    /// Makes the distances for `aim`. If neither its goal nor, with the far map, the window's border can be reached, the
    /// nearest place to the goal becomes the aim, or `before` if that is about as near.
    fn aim_round_obstacles(
        &mut self,
        space: &ConfigurationSpace,
        query: &SearchQuery,
        aim: Aim,
        before: Option<Cell>,
    ) -> Aim {
        let mut distances = self.distances.take().unwrap_or_default();
        distances.load(space, query.tier, query.z_range, query.height_cost);
        distances.add_seed(aim.end, 0.0);
        let remaining_m = |cell: Cell| self.remaining_m(space, cell, aim.goal, aim.use_detours);
        // Without the far map a path beyond the border is a guess, taken only if it is found soon.
        if aim.use_detours {
            distances.add_border(remaining_m);
        }
        let mut end = aim.end;
        if !distances.propagate(Some(query.start)) {
            distances.restart_at(query.start, 0.0);
            distances.propagate(None);
            let is_open = |cell: &Cell| {
                space.holds(query.tier, *cell)
                    && !space.is_hit(query.tier, *cell)
                    && (query.z_range.0..=query.z_range.1).contains(&cell[2])
            };
            let mut nearest = (f32::INFINITY, query.start);
            for cube in distances.reached_cubes() {
                // The detour is the same in the whole cube, or nearly.
                let path_m = PATH_WORTH * distances.remaining_m(cube);
                if remaining_m(cube) + path_m > nearest.0 + 2.0 * CUBE_CELLS * self.cell_m as f32 {
                    continue;
                }
                for cell in cells_of(cube) {
                    let away_m = remaining_m(cell) + path_m;
                    if away_m < nearest.0 && is_open(&cell) {
                        nearest = (away_m, cell);
                    }
                }
            }
            let is_as_near = |cell: &Cell| remaining_m(*cell) <= self.same_end_m(nearest.0);
            end = before
                .filter(|cell| distances.is_reached(*cell) && is_open(cell) && is_as_near(cell))
                .unwrap_or(nearest.1);
            distances.restart_at(end, 0.0);
            distances.propagate(Some(query.start));
        }
        self.distances = Some(distances);
        Aim {
            end,
            use_distances: true,
            ..aim
        }
    }

    /// How far from the goal the last end of a path may be, to stay its end, if the nearest place is `nearest_m` away
    /// (m).
    fn same_end_m(&self, nearest_m: f32) -> f32 {
        nearest_m + SAME_END_CELLS * self.cell_m as f32
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

    /// Length of the last path found (m).
    fn path_m(&self) -> f32 {
        let steps = self.path.cells.windows(2);
        steps.map(|step| self.straight_m(step[0], step[1])).sum()
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
}

#[cfg(test)]
mod tests;
