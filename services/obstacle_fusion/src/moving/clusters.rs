//! Groups of hits: columns of cells that touch, or have one cell between them. Who moves on the ground stands upright,
//! and lidars leave gaps between their rings, so height does not separate.

use crate::cells::SIZE;
use jink_shared_types::map::{CELL_M, Cell};
use nalgebra::Vector3;

/// Columns farther apart than this on an axis are not neighbours (cells).
const REACH: i32 = 2;
/// Fewer hit cells are no group: a drop of rain, the edge of a leaf.
const CELLS_MIN: u32 = 3;
/// A larger one is none that moves, but a wall in a map that has shifted (m).
const RADIUS_MAX_M: f64 = 2.5;
/// Most columns of a frame: twenty people at arm's length.
const COLUMNS_MAX: usize = 4096;

/// The hit cells above each other.
#[derive(Clone, Copy, Default)]
struct Column {
    cells: u32,
    low: i32,
    high: i32,
}

/// A group of hits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Group {
    /// Middle of its columns, half way between its lowest and highest cell (local, m).
    pub centre_m: Vector3<f64>,
    /// Horizontal distance of its farthest cell from there (m).
    pub radius_m: f64,
    /// Half of its height (m).
    pub half_height_m: f64,
}

/// The hits of a frame.
pub(crate) struct Clusters {
    columns: Vec<Column>,
    touched: Vec<usize>,
    member: Vec<usize>,
    groups: Vec<Group>,
}

impl Clusters {
    pub fn new() -> Self {
        Self {
            columns: vec![Column::default(); (SIZE[0] * SIZE[1]) as usize],
            touched: Vec::with_capacity(COLUMNS_MAX),
            member: Vec::with_capacity(COLUMNS_MAX),
            groups: Vec::with_capacity(COLUMNS_MAX),
        }
    }

    /// Begins another frame.
    pub fn clear(&mut self) {
        for column in self.touched.drain(..) {
            self.columns[column] = Column::default();
        }
    }

    /// Adds the hit cell at `offset` from the window's smallest.
    pub fn add(&mut self, offset: [i32; 3]) {
        let number = (offset[0] + offset[1] * SIZE[0]) as usize;
        let column = &mut self.columns[number];
        if column.cells == 0 {
            if self.touched.len() == COLUMNS_MAX {
                return;
            }
            self.touched.push(number);
            (column.low, column.high) = (offset[2], offset[2]);
        }
        column.cells += 1;
        column.low = column.low.min(offset[2]);
        column.high = column.high.max(offset[2]);
    }

    /// The groups in a window that begins at `min_cell`.
    pub fn groups(&mut self, min_cell: Cell) -> &[Group] {
        self.groups.clear();
        for index in 0..self.touched.len() {
            let first = self.touched[index];
            if self.columns[first].cells > 0 {
                self.collect(first, min_cell);
            }
        }
        &self.groups
    }

    /// Takes the group of column `first` out of the columns.
    fn collect(&mut self, first: usize, min_cell: Cell) {
        self.member.clear();
        self.member.push(first);
        let mut all = std::mem::take(&mut self.columns[first]);
        let mut next = 0;
        while let Some(&number) = self.member.get(next) {
            next += 1;
            let [x, y] = place(number);
            for beside_y in (y - REACH).max(0)..=(y + REACH).min(SIZE[1] - 1) {
                for beside_x in (x - REACH).max(0)..=(x + REACH).min(SIZE[0] - 1) {
                    let beside = (beside_x + beside_y * SIZE[0]) as usize;
                    let column = std::mem::take(&mut self.columns[beside]);
                    if column.cells > 0 {
                        all.cells += column.cells;
                        all.low = all.low.min(column.low);
                        all.high = all.high.max(column.high);
                        self.member.push(beside);
                    }
                }
            }
        }
        if all.cells < CELLS_MIN {
            return;
        }
        let middle = |index: i32, axis: usize| (f64::from(min_cell[axis] + index) + 0.5) * CELL_M;
        let at = |number: &usize| {
            let [x, y] = place(*number);
            Vector3::new(middle(x, 0), middle(y, 1), 0.0)
        };
        let sum: Vector3<f64> = self.member.iter().map(at).sum();
        let mut centre_m = sum / self.member.len() as f64;
        let away_m = |number: &usize| (at(number) - centre_m).norm();
        let half_cell_m = CELL_M / std::f64::consts::SQRT_2;
        let radius_m = self.member.iter().map(away_m).fold(0.0, f64::max) + half_cell_m;
        centre_m.z = 0.5 * (middle(all.low, 2) + middle(all.high, 2));
        if radius_m <= RADIUS_MAX_M {
            self.groups.push(Group {
                centre_m,
                radius_m,
                half_height_m: 0.5 * f64::from(all.high - all.low + 1) * CELL_M,
            });
        }
    }
}

/// The offset of a column's number.
fn place(number: usize) -> [i32; 2] {
    let number = number as i32;
    [number % SIZE[0], number / SIZE[0]]
}

#[cfg(test)]
mod tests {
    use super::Clusters;

    #[test]
    fn two_people_are_two_groups_and_a_drop_is_none() {
        let mut clusters = Clusters::new();
        for z in 20..30 {
            for y in 10..13 {
                clusters.add([40, y, z]);
                // The rings of a lidar leave gaps.
                if z % 3 == 0 {
                    clusters.add([44, y + 10, z]);
                }
            }
        }
        clusters.add([80, 80, 30]);
        let min_cell = [-64, -64, -32];
        let groups = clusters.groups(min_cell);
        assert_eq!(groups.len(), 2, "{groups:?}");
        let first = groups[0];
        assert!((first.centre_m.x - -4.7).abs() < 1e-9 && (first.centre_m.y - -10.5).abs() < 1e-9);
        assert!((first.centre_m.z - -1.4).abs() < 1e-9 && (first.half_height_m - 1.0).abs() < 1e-9);
        assert!((0.3..0.4).contains(&first.radius_m));
        clusters.clear();
        assert!(clusters.groups(min_cell).is_empty());
    }
}
