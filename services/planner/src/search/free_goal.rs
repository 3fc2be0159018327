//! The free cell that replaces an occupied goal.

use super::{SAME_END_CELLS, SearchQuery};
use crate::configuration_space::{ConfigurationSpace, distance_squared_cells};
use jink_shared_types::map::Cell;

/// An occupied goal (a waypoint in a tree) is replaced by the nearest free place, searched this many cells around:
/// otherwise the search would expand everything before it ends.
const FREE_GOAL_CELLS: i32 = 20;

/// The goal, or, if it is occupied, a free cell nearest to it: `before` while it is about as near as any other, else
/// the one nearest to the start. The goal again if there is none near.
pub(super) fn nearest_free_goal(
    space: &ConfigurationSpace,
    query: &SearchQuery,
    before: Option<Cell>,
) -> Cell {
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
    let same = i64::from(within(f64::from(SAME_END_CELLS)));
    if let Some(before) = before.filter(|cell| distance_squared_cells(*cell, goal) <= same && is_open(*cell))
    {
        return before;
    }
    let limit = within(1.0);
    let mut best = (i64::MAX, goal);
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
