//! Rays through a block of cells, as many as a lidar has: walked cell by cell near what is occupied, in leaps elsewhere.
//!
//! Sources: J. Amanatides, A. Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics 1987; leaps over empty space by
//! the distance to what is occupied: D. Cohen, Z. Sheffer, "Proximity clouds", The Visual Computer 11 (1994).

use super::solids::Contact;

/// A direction component below this crosses no border within any range.
const PARALLEL: f64 = 1e-12;

/// Longest leap (cells): passes over the block that measure distances.
const LEAP_MAX: u8 = 8;

/// Which cells of a block are occupied.
#[derive(Clone, Debug)]
pub(super) struct CellBlock {
    cell_m: f64,
    /// Lowest cell.
    low: [i32; 3],
    size: [usize; 3],
    /// Of each cell how many steps, diagonal ones included, the nearest occupied cell is away, at most [`LEAP_MAX`].
    steps: Vec<u8>,
}

impl CellBlock {
    /// Of the cells by index; cell `i` reaches from `i * cell_m` to `(i + 1) * cell_m`.
    pub fn new(cell_m: f64, occupied: &[[i32; 3]]) -> Self {
        let extreme = |axis: usize, pick: fn(i32, i32) -> i32| {
            let first = occupied.first().map_or(0, |cell| cell[axis]);
            occupied.iter().map(|cell| cell[axis]).fold(first, pick)
        };
        let low = std::array::from_fn(|axis| extreme(axis, i32::min));
        let size: [usize; 3] = std::array::from_fn(|axis| (extreme(axis, i32::max) - low[axis] + 1) as usize);
        let mut block = Self {
            cell_m,
            low,
            size,
            steps: vec![LEAP_MAX; size.iter().product()],
        };
        for cell in occupied {
            let index = block.index(std::array::from_fn(|axis| (cell[axis] - low[axis]) as usize));
            block.steps[index] = 0;
        }
        block.measure();
        block
    }

    /// Spreads the distances from the occupied cells: what is within `n` steps is a cube, which grows along one axis after the other.
    fn measure(&mut self) {
        let [x, y, z] = self.size;
        let mut within = self.steps.iter().map(|steps| *steps == 0).collect::<Vec<bool>>();
        for distance in 1..LEAP_MAX {
            for (stride, size) in [(1, x), (x, y), (x * y, z)] {
                let before = within.clone();
                for (index, is_within) in within.iter_mut().enumerate() {
                    let along = index / stride % size;
                    *is_within |=
                        (along > 0 && before[index - stride]) || (along + 1 < size && before[index + stride]);
                }
            }
            let cells = self.steps.iter_mut().zip(&within);
            cells
                .filter(|(steps, is_within)| **is_within && **steps == LEAP_MAX)
                .for_each(|(steps, _)| *steps = distance);
        }
    }

    fn index(&self, cell: [usize; 3]) -> usize {
        (cell[2] * self.size[1] + cell[1]) * self.size[0] + cell[0]
    }

    /// Where the ray from `origin` along the unit vector `direction` first meets an occupied cell within `range_m`.
    pub fn meets(&self, origin: [f64; 3], direction: [f64; 3], range_m: f64) -> Option<Contact> {
        let (mut enter_m, mut facing, mut leave_m) = (0.0, 1.0, range_m);
        // In cells, from the block's corner.
        let start: [f64; 3] =
            std::array::from_fn(|axis| origin[axis] / self.cell_m - f64::from(self.low[axis]));
        for axis in 0..3 {
            let size = self.size[axis] as f64;
            if direction[axis].abs() < PARALLEL {
                if !(0.0..size).contains(&start[axis]) {
                    return None;
                }
                continue;
            }
            let range = |border: f64| (border - start[axis]) * self.cell_m / direction[axis];
            let (one, other) = (range(0.0), range(size));
            if one.min(other) > enter_m {
                (enter_m, facing) = (one.min(other), direction[axis].abs());
            }
            leave_m = leave_m.min(one.max(other));
        }
        if enter_m > leave_m {
            return None;
        }
        let mut cell = [0_usize; 3];
        let mut next_m = [f64::INFINITY; 3];
        let mut stride_m = [f64::INFINITY; 3];
        for axis in 0..3 {
            let at = start[axis] + direction[axis] * enter_m / self.cell_m;
            cell[axis] = (at.max(0.0) as usize).min(self.size[axis] - 1);
            if direction[axis].abs() >= PARALLEL {
                let border = cell[axis] as f64 + if direction[axis] > 0.0 { 1.0 } else { 0.0 };
                next_m[axis] = (border - start[axis]) * self.cell_m / direction[axis];
                stride_m[axis] = self.cell_m / direction[axis].abs();
            }
        }
        loop {
            let steps = self.steps[self.index(cell)];
            if steps == 0 {
                return Some(Contact {
                    range_m: enter_m,
                    incidence_cos: facing,
                });
            }
            // The next border of the cube of empty cells around this one.
            let leap = usize::from(steps) - 1;
            let mut last = 0;
            let mut border_m = f64::INFINITY;
            for axis in 0..3 {
                let at_m = next_m[axis] + leap as f64 * stride_m[axis];
                if at_m < border_m {
                    (last, border_m) = (axis, at_m);
                }
            }
            enter_m = border_m;
            if enter_m > leave_m {
                return None;
            }
            facing = direction[last].abs();
            for axis in 0..3 {
                let crossed = match axis {
                    _ if axis == last => leap + 1,
                    _ if next_m[axis] < border_m => {
                        (((border_m - next_m[axis]) / stride_m[axis]).ceil() as usize).min(leap)
                    }
                    _ => 0,
                };
                let moved = match direction[axis] > 0.0 {
                    true => cell[axis] + crossed,
                    false => cell[axis].wrapping_sub(crossed),
                };
                if moved >= self.size[axis] {
                    return None;
                }
                cell[axis] = moved;
                if crossed > 0 {
                    next_m[axis] += crossed as f64 * stride_m[axis];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::CellBlock;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_ray_ends_at_the_first_occupied_cell_and_nowhere_else(
            cells in proptest::collection::vec([-4..4i32, -3..5i32, -2..6i32], 1..20),
            origin in [-3.0..3.0f64, -3.0..3.0f64, -3.0..3.0f64],
            azimuth in -3.1..3.1f64, sine in -1.0..1.0f64, is_level in any::<bool>(),
        ) {
            const CELL_M: f64 = 0.5;
            let sine = if is_level { 0.0 } else { sine };
            let level = (1.0 - sine * sine).sqrt();
            let direction = [level * azimuth.cos(), level * azimuth.sin(), sine];
            let block = CellBlock::new(CELL_M, &cells);
            let hit = block.meets(origin, direction, 8.0);
            // The slow way: along the ray in small steps.
            let inside = |range_m: f64| {
                let at: [f64; 3] = std::array::from_fn(|axis| origin[axis] + range_m * direction[axis]);
                cells.contains(&at.map(|number| (number / CELL_M).floor() as i32))
            };
            const STEP_M: f64 = 0.001;
            let slow = (0..8_000).map(|step| f64::from(step) * STEP_M).find(|range_m| inside(*range_m));
            match (hit, slow) {
                (Some(hit), Some(slow)) => prop_assert!(hit.range_m <= slow + 1e-9, "{} {slow}", hit.range_m),
                // Through less than a step of a corner.
                (Some(hit), None) => prop_assert!(inside(hit.range_m + 1e-9) || !inside(hit.range_m + STEP_M)),
                (None, Some(slow)) => prop_assert!(false, "missed at {slow}"),
                (None, None) => {}
            }
            if let Some(hit) = hit {
                prop_assert!(hit.range_m == 0.0 || !inside(hit.range_m - 1e-6));
                prop_assert!((0.0..=1.0).contains(&hit.incidence_cos));
            }
        }
    }

    #[test]
    fn a_ray_from_outside_enters_and_one_beyond_its_range_does_not() {
        let block = CellBlock::new(0.5, &[[10, 0, 0]]);
        let x = [1.0, 0.0, 0.0];
        let hit = block.meets([0.0, 0.2, 0.2], x, 10.0).unwrap();
        assert_eq!((hit.range_m, hit.incidence_cos), (5.0, 1.0));
        assert!(block.meets([0.0, 0.2, 0.2], x, 4.9).is_none());
        assert!(block.meets([0.0, 0.7, 0.2], x, 10.0).is_none());
        assert!(block.meets([9.0, 0.2, 0.2], x, 10.0).is_none());
    }
}
