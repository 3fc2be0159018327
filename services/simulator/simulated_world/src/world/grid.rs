//! A uniform grid seen from above that gives which obstacles a ray may meet, in the order it may meet them.
//!
//! Source: J. Amanatides, A. Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics 1987, in two
//! dimensions: the worlds are flat, their obstacles tall, so a third axis would only cost steps.

use super::solids::Obstacle;
use nalgebra::Vector3;

/// Side of a cell (m). Measured in the default forest and in one twice as dense: 2 m takes a tenth more time (more
/// cells to walk), 6 m no less (more obstacles per cell).
const CELL_M: f64 = 4.0;

/// Most cells per axis: a few solids far apart get larger cells instead of a huge table.
const MAX_CELLS: f64 = 256.0;

/// An obstacle is also listed in the cells this near its footprint (m): rounding at a border must not lose a hit.
const MARGIN_M: f64 = 1e-6;

/// One horizontal axis of the grid.
#[derive(Clone, Copy, Debug, Default)]
struct Axis {
    from_m: f64,
    cells: usize,
}

/// An obstacle as a cell lists it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Item {
    north_m: f64,
    east_m: f64,
    reach2_m2: f64,
    /// Index of the obstacle.
    pub obstacle: u32,
}

impl Item {
    fn new(obstacle: u32, solid: &Obstacle) -> Self {
        let [north_m, east_m, reach_m] = solid.circle_m();
        Self {
            north_m,
            east_m,
            reach2_m2: (reach_m + MARGIN_M).powi(2),
            obstacle,
        }
    }

    /// Whether the ray's line, seen from above, passes through the circle around the obstacle. Costs a fraction of
    /// the exact answer, and most of the obstacles near a ray are not on it.
    pub fn may_meet(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> bool {
        let (x, y) = (self.north_m - origin.x, self.east_m - origin.y);
        let miss = x * direction.y - y * direction.x;
        let speed2 = direction.x * direction.x + direction.y * direction.y;
        miss * miss <= self.reach2_m2 * speed2
    }
}

/// Obstacles by cell.
#[derive(Clone, Debug)]
pub(super) struct Grid {
    cell_m: f64,
    /// Cells per metre.
    per_m: f64,
    axes: [Axis; 2],
    /// Cell `c` lists `items[offsets[c]..offsets[c + 1]]`.
    offsets: Vec<u32>,
    items: Vec<Item>,
}

impl Grid {
    /// Sorts `obstacles` into cells.
    pub fn new(obstacles: &[Obstacle]) -> Self {
        let mut extent = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];
        for obstacle in obstacles {
            let footprint = obstacle.footprint_m();
            for (edge, value) in footprint.into_iter().enumerate() {
                extent[edge] = if edge % 2 == 0 {
                    extent[edge].min(value - MARGIN_M)
                } else {
                    extent[edge].max(value + MARGIN_M)
                };
            }
        }
        if obstacles.is_empty() {
            extent = [0.0; 4];
        }
        let longest_m = (extent[1] - extent[0]).max(extent[3] - extent[2]);
        let cell_m = CELL_M.max(longest_m / MAX_CELLS);
        let axis = |from_m: f64, to_m: f64| Axis {
            from_m,
            cells: ((to_m - from_m) / cell_m) as usize + 1,
        };
        let mut grid = Self {
            cell_m,
            per_m: 1.0 / cell_m,
            axes: [axis(extent[0], extent[1]), axis(extent[2], extent[3])],
            offsets: Vec::new(),
            items: Vec::new(),
        };
        grid.fill(obstacles);
        grid
    }

    fn fill(&mut self, obstacles: &[Obstacle]) {
        let mut lists = vec![Vec::new(); self.axes[0].cells * self.axes[1].cells];
        for (index, obstacle) in (0..).zip(obstacles) {
            let item = Item::new(index, obstacle);
            let [n0, n1, e0, e1] = obstacle.footprint_m();
            for row in self.cell(0, n0 - MARGIN_M)..=self.cell(0, n1 + MARGIN_M) {
                for column in self.cell(1, e0 - MARGIN_M)..=self.cell(1, e1 + MARGIN_M) {
                    lists[row * self.axes[1].cells + column].push(item);
                }
            }
        }
        self.offsets.push(0);
        for list in lists {
            self.items.extend(list);
            self.offsets.push(self.items.len() as u32);
        }
    }

    /// The cell of coordinate `at_m` along `axis`, the outermost one for what lies outside.
    fn cell(&self, axis: usize, at_m: f64) -> usize {
        let Axis { from_m, cells } = self.axes[axis];
        let cell = ((at_m - from_m) * self.per_m) as i32;
        cell.clamp(0, cells as i32 - 1) as usize
    }

    /// Walks the cells between `from_m` and `to_m` along the ray. `visit` receives a cell's obstacles and the range
    /// at which the ray leaves the cell, and says whether to go on.
    pub fn walk(
        &self,
        origin: &Vector3<f64>,
        direction: &Vector3<f64>,
        from_m: f64,
        to_m: f64,
        mut visit: impl FnMut(&[Item], f64) -> bool,
    ) {
        let inverse = [1.0 / direction.x, 1.0 / direction.y];
        let Some(enter_m) = self.entry_m(origin, direction, inverse, from_m, to_m) else {
            return;
        };
        let (mut index, mut jump, mut left) = (0, [0_isize; 2], [0_usize; 2]);
        let (mut next, mut stride) = ([f64::INFINITY; 2], [f64::INFINITY; 2]);
        for axis in 0..2 {
            let cells = self.axes[axis].cells;
            let cell = self.cell(axis, origin[axis] + direction[axis] * enter_m);
            let row = if axis == 0 { self.axes[1].cells } else { 1 };
            index += cell * row;
            if direction[axis] != 0.0 {
                let forward = direction[axis] > 0.0;
                let border_m = self.axes[axis].from_m + (cell + usize::from(forward)) as f64 * self.cell_m;
                next[axis] = (border_m - origin[axis]) * inverse[axis];
                stride[axis] = self.cell_m * inverse[axis].abs();
                jump[axis] = if forward { row as isize } else { -(row as isize) };
                left[axis] = if forward { cells - 1 - cell } else { cell };
            }
        }
        loop {
            let axis = usize::from(next[1] < next[0]);
            let exit_m = next[axis];
            let (first, last) = (self.offsets[index] as usize, self.offsets[index + 1] as usize);
            if !visit(&self.items[first..last], exit_m) || exit_m > to_m || left[axis] == 0 {
                return;
            }
            index = index.wrapping_add_signed(jump[axis]);
            left[axis] -= 1;
            next[axis] += stride[axis];
        }
    }

    /// Range at which the ray is first on the grid, from `from_m` on; `None` if it is not up to `to_m`.
    fn entry_m(
        &self,
        origin: &Vector3<f64>,
        direction: &Vector3<f64>,
        inverse: [f64; 2],
        from_m: f64,
        to_m: f64,
    ) -> Option<f64> {
        let (mut enter_m, mut leave_m) = (from_m, to_m);
        for axis in 0..2 {
            let low_m = self.axes[axis].from_m - origin[axis];
            let high_m = low_m + self.axes[axis].cells as f64 * self.cell_m;
            let start_m = direction[axis] * from_m;
            if low_m <= start_m && start_m <= high_m {
                // Starts between these borders: where it leaves them the walk ends by itself.
                continue;
            }
            if direction[axis] == 0.0 {
                return None;
            }
            let (a, b) = (low_m * inverse[axis], high_m * inverse[axis]);
            enter_m = enter_m.max(a.min(b));
            leave_m = leave_m.min(a.max(b));
        }
        (enter_m <= leave_m).then_some(enter_m)
    }
}
