//! Groups of hits: columns of cells that touch, or have one cell between them. Who moves on the ground stands upright,
//! and lidars leave gaps between their rings, so height does not separate.

use crate::cells::SIZE;
use jink_shared_types::map::{CELL_M, Cell};
use nalgebra::Vector3;

/// Columns farther apart than this on an axis are not neighbours (cells).
const REACH: i32 = 2;
/// Fewer hits in open space are no group: a drop of rain, the edge of a leaf.
const CELLS_MIN: u32 = 3;
/// A group continues in columns beside it that are not open, if those have so many hits: the ground, with noise, is two
/// cells thick.
const CONTINUED_MIN: u32 = 3;
/// A group that is larger than this (m) with them, an arm's length, has a wall beside it, and ends where the
/// open space does.
const CONTINUED_MAX_M: f64 = 0.8;
/// A larger one is none that moves, but a wall in a map that has shifted (m).
const RADIUS_MAX_M: f64 = 2.5;
/// Most columns of a frame: twenty people at arm's length.
const COLUMNS_MAX: usize = 4096;
/// A group with more columns than the square around a circle of [`CONTINUED_MAX_M`] is larger than that.
const CONTINUED_COLUMNS_MAX: usize = {
    let across = (2.0 * CONTINUED_MAX_M / CELL_M) as usize;
    across * across
};

/// The hit cells above each other.
#[derive(Clone, Copy, Default)]
struct Column {
    /// How many of them are in open space.
    open: u32,
    /// How many there are.
    cells: u32,
    low: i32,
    high: i32,
}

impl Column {
    fn add(&mut self, other: &Self) {
        if self.cells == 0 {
            *self = *other;
            return;
        }
        self.open += other.open;
        self.cells += other.cells;
        self.low = self.low.min(other.low);
        self.high = self.high.max(other.high);
    }
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

    /// Adds the hit cell at `offset` from the window's smallest; whether it `is_open`.
    pub fn add(&mut self, offset: [i32; 3], is_open: bool) {
        let number = (offset[0] + offset[1] * SIZE[0]) as usize;
        let column = &mut self.columns[number];
        if column.cells == 0 {
            if self.touched.len() == COLUMNS_MAX {
                return;
            }
            self.touched.push(number);
        }
        column.add(&Column {
            open: u32::from(is_open),
            cells: 1,
            low: offset[2],
            high: offset[2],
        });
    }

    /// The groups in a window that begins at `min_cell`.
    pub fn groups(&mut self, min_cell: Cell) -> &[Group] {
        self.groups.clear();
        for index in 0..self.touched.len() {
            let first = self.touched[index];
            if self.columns[first].open == 0 {
                continue;
            }
            let open = self.collect(first);
            if open.open < CELLS_MIN {
                continue;
            }
            let within = self.member.len();
            let whole = self.continue_beside(open);
            let group = self
                .group(&whole, min_cell, self.member.len())
                .filter(|whole| whole.radius_m <= CONTINUED_MAX_M)
                .or_else(|| self.group(&open, min_cell, within));
            self.groups
                .extend(group.filter(|group| group.radius_m <= RADIUS_MAX_M));
        }
        &self.groups
    }

    /// Takes the columns of the group of column `first` that are open out of the columns; their sum.
    fn collect(&mut self, first: usize) -> Column {
        self.member.clear();
        self.member.push(first);
        let mut all = std::mem::take(&mut self.columns[first]);
        let mut next = 0;
        while let Some(&number) = self.member.get(next) {
            next += 1;
            for beside in beside(number, REACH) {
                if self.columns[beside].open > 0 {
                    all.add(&std::mem::take(&mut self.columns[beside]));
                    self.member.push(beside);
                }
            }
        }
        all
    }

    /// Adds the columns that touch the group, directly or through others, and are not open: somebody who steps out of what
    /// has not been seen is there as a whole. The columns stay where they are.
    fn continue_beside(&mut self, mut all: Column) -> Column {
        let mut next = 0;
        while let Some(&number) = self.member.get(next) {
            next += 1;
            for beside in beside(number, 1) {
                let column = self.columns[beside];
                let continues = column.open == 0 && column.cells >= CONTINUED_MIN;
                if continues && !self.member.contains(&beside) && self.member.len() < CONTINUED_COLUMNS_MAX {
                    all.add(&column);
                    self.member.push(beside);
                }
            }
        }
        all
    }

    /// The group of the first `len` members, whose sum is `all`.
    fn group(&self, all: &Column, min_cell: Cell, len: usize) -> Option<Group> {
        let members = self.member.get(..len)?;
        let middle = |index: i32, axis: usize| (f64::from(min_cell[axis] + index) + 0.5) * CELL_M;
        let at = |number: &usize| {
            let [x, y] = place(*number);
            Vector3::new(middle(x, 0), middle(y, 1), 0.0)
        };
        let sum: Vector3<f64> = members.iter().map(at).sum();
        let mut centre_m = sum / members.len() as f64;
        let away_m = |number: &usize| (at(number) - centre_m).norm();
        let half_cell_m = CELL_M / std::f64::consts::SQRT_2;
        let radius_m = members.iter().map(away_m).fold(0.0, f64::max) + half_cell_m;
        centre_m.z = 0.5 * (middle(all.low, 2) + middle(all.high, 2));
        Some(Group {
            centre_m,
            radius_m,
            half_height_m: 0.5 * f64::from(all.high - all.low + 1) * CELL_M,
        })
    }
}

/// The columns around `number`, itself included, up to `reach` away on an axis.
fn beside(number: usize, reach: i32) -> impl Iterator<Item = usize> {
    let [x, y] = place(number);
    let around = move |at: i32, size: i32| (at - reach).max(0)..=(at + reach).min(size - 1);
    around(y, SIZE[1]).flat_map(move |y| around(x, SIZE[0]).map(move |x| (x + y * SIZE[0]) as usize))
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
                clusters.add([40, y, z], true);
                // The rings of a lidar leave gaps.
                if z % 3 == 0 {
                    clusters.add([44, y + 10, z], true);
                }
            }
        }
        clusters.add([80, 80, 30], true);
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

    /// A body 3 columns wide of which the first `open` are in open space, and `beside` more columns beside it.
    fn body(open: i32, beside: i32) -> Clusters {
        let mut clusters = Clusters::new();
        for z in 20..30 {
            for x in 40..43 + beside {
                (10..13).for_each(|y| clusters.add([x, y, z], x < 40 + open));
            }
        }
        clusters
    }

    #[test]
    fn who_steps_out_of_what_is_not_open_is_there_as_a_whole() {
        let min_cell = [-64, -64, -32];
        let whole = body(3, 0).groups(min_cell).to_vec();
        assert_eq!(whole.len(), 1);
        for open in 1..3 {
            let mut partly = body(open, 0);
            let [group] = partly.groups(min_cell) else {
                panic!("{open} columns in the open");
            };
            assert!((group.centre_m - whole[0].centre_m).norm() < 1e-9, "{group:?}");
            assert!((group.radius_m - whole[0].radius_m).abs() < 1e-9, "{group:?}");
        }
        assert!(body(0, 0).groups(min_cell).is_empty(), "nothing is in the open");
    }

    #[test]
    fn a_group_ends_at_a_wall_and_at_the_ground() {
        let min_cell = [-64, -64, -32];
        let alone = body(3, 0).groups(min_cell).to_vec();
        assert_eq!(body(3, 10).groups(min_cell), alone);
        let mut standing = body(3, 0);
        for x in 30..50 {
            (5..18).for_each(|y| standing.add([x, y, 30], false));
        }
        let group = standing.groups(min_cell)[0];
        assert_eq!(group.radius_m, alone[0].radius_m);
        assert_eq!(group.centre_m.xy(), alone[0].centre_m.xy());
    }
}
