//! A short way through a known world: whether there is one at all, and how long it is.
//!
//! A* on a square grid at flight height (octile distance, 8 neighbours, integer costs so that ties never depend on
//! rounding), then corners are cut wherever the straight line is clear. The result is an upper bound of the
//! shortest way, usually within a few per cent, because cutting corners does not change on which side an obstacle
//! is passed. Source: P. Hart, N. Nilsson, B. Raphael, "A Formal Basis for the Heuristic Determination of Minimum
//! Cost Paths", 1968.

use super::{Bounds, World};
use jink_shared_types::{LocalNed, Point};
use nalgebra::Vector3;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Side of a cell (m): errs by at most half its diagonal (0.18 m) about what is passable, and takes a few
/// milliseconds.
pub(super) const CELL_M: f64 = 0.25;

/// Cost of a step along an axis and of a diagonal one (10 times the length, rounded).
const STRAIGHT: u32 = 10;
const DIAGONAL: u32 = 14;

/// Steps to the neighbours.
const STEPS: [(i32, i32, u32); 8] = [
    (1, 0, STRAIGHT),
    (-1, 0, STRAIGHT),
    (0, 1, STRAIGHT),
    (0, -1, STRAIGHT),
    (1, 1, DIAGONAL),
    (1, -1, DIAGONAL),
    (-1, 1, DIAGONAL),
    (-1, -1, DIAGONAL),
];

/// What can be entered, at one height.
struct Floor {
    north_from_m: f64,
    east_from_m: f64,
    rows: usize,
    columns: usize,
    blocked: Vec<bool>,
}

impl Floor {
    fn new(world: &World, height_m: f64, clearance_m: f64) -> Self {
        let Bounds {
            north_min_m,
            north_max_m,
            east_min_m,
            east_max_m,
            ..
        } = *world.bounds();
        let mut floor = Self {
            north_from_m: north_min_m,
            east_from_m: east_min_m,
            rows: ((north_max_m - north_min_m) / CELL_M).ceil() as usize,
            columns: ((east_max_m - east_min_m) / CELL_M).ceil() as usize,
            blocked: Vec::new(),
        };
        floor.blocked = vec![false; floor.rows * floor.columns];
        for obstacle in world.obstacles() {
            let [n0, n1, e0, e1] = obstacle.footprint_m();
            let index = |at_m: f64, from_m: f64, cells: usize| {
                (((at_m - from_m) / CELL_M).max(0.0) as usize).min(cells - 1)
            };
            let first = index(e0 - clearance_m, east_min_m, floor.columns);
            let last = index(e1 + clearance_m, east_min_m, floor.columns);
            for row in index(n0 - clearance_m, north_min_m, floor.rows)
                ..=index(n1 + clearance_m, north_min_m, floor.rows)
            {
                for column in first..=last {
                    let centre = floor.centre(row, column, height_m);
                    floor.blocked[row * floor.columns + column] |= obstacle.distance_m(&centre) < clearance_m;
                }
            }
        }
        if world.structures().is_empty() {
            return floor;
        }
        for cell in 0..floor.blocked.len() {
            let centre = floor.centre(cell / floor.columns, cell % floor.columns, height_m);
            let mut structures = world.structures().iter();
            floor.blocked[cell] |= structures.any(|structure| structure.distance_m(&centre) < clearance_m);
        }
        floor
    }

    fn centre(&self, row: usize, column: usize, height_m: f64) -> Vector3<f64> {
        Vector3::new(
            self.north_from_m + (row as f64 + 0.5) * CELL_M,
            self.east_from_m + (column as f64 + 0.5) * CELL_M,
            -height_m,
        )
    }

    /// The cell at a place, if it lies on the floor and may be entered.
    fn open_cell(&self, north_m: f64, east_m: f64) -> Option<usize> {
        let row = ((north_m - self.north_from_m) / CELL_M).floor();
        let column = ((east_m - self.east_from_m) / CELL_M).floor();
        if !(0.0..self.rows as f64).contains(&row) || !(0.0..self.columns as f64).contains(&column) {
            return None;
        }
        let cell = row as usize * self.columns + column as usize;
        (!self.blocked[cell]).then_some(cell)
    }

    fn neighbour(&self, cell: usize, step: (i32, i32, u32)) -> Option<usize> {
        let row = (cell / self.columns).checked_add_signed(step.0 as isize)?;
        let column = (cell % self.columns).checked_add_signed(step.1 as isize)?;
        let next = row * self.columns + column;
        (row < self.rows && column < self.columns && !self.blocked[next]).then_some(next)
    }

    /// Octile distance between two cells: never more than the cost of getting there.
    fn least_cost(&self, from: usize, to: usize) -> u32 {
        let rows = (from / self.columns).abs_diff(to / self.columns);
        let columns = (from % self.columns).abs_diff(to % self.columns);
        let (short, long) = (rows.min(columns) as u32, rows.max(columns) as u32);
        DIAGONAL * short + STRAIGHT * (long - short)
    }

    /// The cheapest chain of open cells from `start` to `goal`, both included.
    fn search(&self, start: usize, goal: usize) -> Option<Vec<usize>> {
        let mut cost = vec![u32::MAX; self.blocked.len()];
        let mut parent = vec![start; self.blocked.len()];
        let mut open = BinaryHeap::from([Reverse((self.least_cost(start, goal), start))]);
        cost[start] = 0;
        while let Some(Reverse((estimate, cell))) = open.pop() {
            if cell == goal {
                let mut chain = vec![goal];
                let mut at = goal;
                while at != start {
                    at = parent[at];
                    chain.push(at);
                }
                chain.reverse();
                return Some(chain);
            }
            if estimate > cost[cell] + self.least_cost(cell, goal) {
                continue;
            }
            for step in STEPS {
                let Some(next) = self.neighbour(cell, step) else {
                    continue;
                };
                let through = cost[cell] + step.2;
                if through < cost[next] {
                    cost[next] = through;
                    parent[next] = cell;
                    open.push(Reverse((through + self.least_cost(next, goal), next)));
                }
            }
        }
        None
    }

    /// Whether every cell under the straight line is open, looked up every quarter of a cell.
    fn is_clear(&self, from: &Vector3<f64>, to: &Vector3<f64>) -> bool {
        let way = to - from;
        let samples = (way.norm() / (0.25 * CELL_M)).ceil().max(1.0) as u32;
        (0..=samples).all(|i| {
            let at = from + way * (f64::from(i) / f64::from(samples));
            self.open_cell(at.x, at.y).is_some()
        })
    }

    /// Leaves out every corner that a straight line can cut.
    fn pulled_tight(&self, corners: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut tight: Vec<Vector3<f64>> = corners.first().copied().into_iter().collect();
        let mut at = 0;
        while at + 1 < corners.len() {
            let reach = (at + 2..corners.len())
                .rev()
                .find(|&far| self.is_clear(&corners[at], &corners[far]))
                .unwrap_or(at + 1);
            tight.push(corners[reach]);
            at = reach;
        }
        tight
    }
}

/// A short way at flight height from the start through all goals of `world` that stays in its bounds, and whose
/// grid cells' centres keep `clearance_m` from every obstacle. `None` if the grid has no such way.
pub(super) fn way(world: &World, clearance_m: f64) -> Option<Vec<Point<LocalNed>>> {
    let height_m = world.flight_height_m();
    let floor = Floor::new(world, height_m, clearance_m);
    let start = world.start();
    let mut from = Vector3::new(start.x_m, start.y_m, -height_m);
    let mut points = vec![from];
    for goal in world.goals() {
        let to = goal.vector();
        let chain = floor.search(floor.open_cell(from.x, from.y)?, floor.open_cell(to.x, to.y)?)?;
        let mut corners: Vec<_> = chain
            .iter()
            .map(|cell| floor.centre(cell / floor.columns, cell % floor.columns, height_m))
            .collect();
        // The ends are the places asked for, not the centres of their cells.
        corners.insert(0, from);
        corners.push(to);
        points.extend(floor.pulled_tight(&corners).into_iter().skip(1));
        from = to;
    }
    Some(points.into_iter().map(Point::from_vector).collect())
}
