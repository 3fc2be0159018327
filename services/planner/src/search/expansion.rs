//! The expansion of cells from the start until the end or the window's border is closed (weighted A*).

use super::neighbours::{NeighbourStep, neighbours_outside};
use super::window::{cell_at, index_of, on_shell};
use super::{Aim, PathEnd, Search, SearchQuery, SearchResult};
use crate::configuration_space::ConfigurationSpace;
use jink_shared_types::map::Cell;
use std::cmp::Reverse;

/// Cost of a metre that is not known to be free. Above 1 so that seen space is preferred; low enough that a short path
/// into the unknown beside a trunk costs less than a long path round it.
const UNKNOWN_FACTOR: f32 = 1.6;
/// Cost of a metre nearer to an obstacle than is comfortable.
const NEAR_FACTOR: f32 = 1.6;
/// Cost of a metre along the previous guide: keeps the choice of side between two equal paths.
const PREFERRED_FACTOR: f32 = 0.85;
/// Weight of the estimated rest: above the cheapest cost of a metre, so that the search is drawn to the goal instead of
/// expanding everything known. With the straight distance a path costs at most this over [`PREFERRED_FACTOR`] more than
/// the best (weighted A*, Pohl 1970). In forests 1.3 expands a tenth of the cells of 0.85 for paths 2 % longer.
const HEURISTIC_WEIGHT: f32 = 1.3;

/// How the expansion of cells ended.
#[derive(Clone, Copy, Debug)]
pub(super) enum Expanded {
    /// The end was closed.
    End,
    /// This cell beside the window's border was closed.
    Border(Cell),
    /// No cell is left; the nearest one to the goal, and how far it is (m).
    Enclosed((f32, Cell)),
    /// As many cells as allowed were expanded; the same.
    Unfinished((f32, Cell)),
}

impl Search {
    /// Expands cells from the start until the end or the window's border is closed.
    pub(super) fn expand_to(
        &mut self,
        space: &ConfigurationSpace,
        query: &SearchQuery,
        aim: &Aim,
        expansions_max: usize,
    ) -> Expanded {
        self.begin(space, query.tier, query.start);
        let mut nearest = (f32::INFINITY, query.start);
        while let Some((cell, index)) = self.close_next(space) {
            let remaining_m = self.remaining_m(space, cell, aim.goal, aim.use_detours);
            if remaining_m < nearest.0 {
                nearest = (remaining_m, cell);
            }
            if cell == aim.end {
                return Expanded::End;
            }
            if on_shell(space, query.tier, cell) && cell != query.start {
                return Expanded::Border(cell);
            }
            self.expansions += 1;
            if self.expansions >= expansions_max {
                return Expanded::Unfinished(nearest);
            }
            self.expand(space, query, aim, cell, index);
        }
        Expanded::Enclosed(nearest)
    }

    /// The estimated rest of a path from `cell` (m).
    #[inline]
    fn estimate_m(&self, space: &ConfigurationSpace, cell: Cell, aim: &Aim) -> f32 {
        match &self.distances {
            Some(distances) if aim.use_distances => {
                distances.remaining_m(cell).max(self.straight_m(cell, aim.end))
            }
            _ => self.remaining_m(space, cell, aim.goal, aim.use_detours),
        }
    }

    /// Opens `start` alone, a cell of `tier`.
    pub(super) fn begin(&mut self, space: &ConfigurationSpace, tier: usize, start: Cell) {
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
    pub(super) fn close_next(&mut self, space: &ConfigurationSpace) -> Option<(Cell, usize)> {
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
    pub(super) fn push(&mut self, estimate_m: f32, cell: Cell) {
        // Positive floats sort like their bits; the index breaks ties the same way every time.
        let key = u64::from(estimate_m.to_bits()) << 32 | index_of(cell) as u64;
        self.open.push(Reverse(key));
    }

    fn expand(
        &mut self,
        space: &ConfigurationSpace,
        query: &SearchQuery,
        aim: &Aim,
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
                let estimate_m = self.estimate_m(space, next, aim);
                self.push(cost_m + HEURISTIC_WEIGHT * estimate_m, next);
            }
        }
    }

    /// Cost of a step to `next`; `is_safe` if it touches no unsafe cell.
    pub(super) fn step_cost_m(
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
        factor += self.failed.cost_per_metre(query.tier, map_cell);
        (step.length * self.cell_m) as f32 * factor
            + query.height_cost * self.cell_m as f32 * step.by[2].abs() as f32
    }

    pub(super) fn finish(
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
            round_m: 0.0,
            goal_is_occupied: false,
        }
    }
}
