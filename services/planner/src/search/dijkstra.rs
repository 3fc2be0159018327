//! Dijkstra's algorithm over the cells that are safe: the path out of a narrow place, and the cells within reach.

use super::neighbours::neighbours_outside;
use super::window::index_of;
use super::{EXPANSIONS_MAX, PathEnd, Search};
use crate::configuration_space::ConfigurationSpace;
use jink_shared_types::map::Cell;

/// The path out of a narrow place is no longer than this (m): beyond, it would be a path through it.
const ESCAPE_MAX_M: f32 = 4.0;

/// Candidate viewpoints lie this many of the map's cells apart.
const REACHABLE_STEP: [i32; 3] = [3, 3, 2];

/// A cell that the vehicle can reach, and the path to it.
#[derive(Clone, Copy, Debug)]
pub struct ReachableCell {
    /// The cell.
    pub cell: Cell,
    /// Length of the path to it (m).
    pub path_m: f32,
}

impl Search {
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
}
