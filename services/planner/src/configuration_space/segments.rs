//! The cells that a straight segment passes, and whether it is safe.

use super::ConfigurationSpace;
use super::cells::cell_holding;
use jink_shared_types::map::{CELL_M, Cell};
use nalgebra::Vector3;

impl ConfigurationSpace {
    /// The share of the segment from `a` to `b` at which the first cell of `tier` that `is_wanted` is entered; `None`
    /// if there is none.
    pub fn first_in(
        &self,
        tier: usize,
        a: &Vector3<f64>,
        b: &Vector3<f64>,
        is_wanted: impl Fn(&Self, Cell) -> bool,
    ) -> Option<f64> {
        let scale = f64::from(self.per_cell(tier));
        self.first_cell(&(a * scale), &(b * scale), is_wanted)
    }

    /// The same for the cells of the map.
    pub fn first_cell(
        &self,
        a: &Vector3<f64>,
        b: &Vector3<f64>,
        is_wanted: impl Fn(&Self, Cell) -> bool,
    ) -> Option<f64> {
        let mut walk = CellWalk::new(a, b);
        loop {
            if is_wanted(self, walk.cell) {
                return Some(walk.entered_t);
            }
            if !walk.advance() {
                return None;
            }
        }
    }

    /// Whether the straight segment from `a` to `b` is safe in `tier`.
    pub fn segment_is_safe(&self, tier: usize, a: &Vector3<f64>, b: &Vector3<f64>) -> bool {
        let is_unsafe = |space: &Self, cell: Cell| !space.is_safe(tier, cell);
        self.first_in(tier, a, b, is_unsafe).is_none()
    }
}

/// Visits every cell a segment passes, in order (Amanatides and Woo 1987).
#[derive(Debug)]
struct CellWalk {
    cell: Cell,
    /// Share of the segment at which the cell was entered.
    entered_t: f64,
    step: [i32; 3],
    next_t: [f64; 3],
    delta_t: [f64; 3],
}

impl CellWalk {
    fn new(a: &Vector3<f64>, b: &Vector3<f64>) -> Self {
        let cell = cell_holding(a);
        let way = b - a;
        let mut walk = Self {
            cell,
            entered_t: 0.0,
            step: [0; 3],
            next_t: [f64::INFINITY; 3],
            delta_t: [f64::INFINITY; 3],
        };
        for axis in 0..3 {
            if way[axis].abs() > 1e-12 {
                let forward = way[axis] > 0.0;
                walk.step[axis] = if forward { 1 } else { -1 };
                let border_m = (f64::from(cell[axis]) + f64::from(u8::from(forward))) * CELL_M;
                walk.next_t[axis] = (border_m - a[axis]) / way[axis];
                walk.delta_t[axis] = CELL_M / way[axis].abs();
            }
        }
        walk
    }

    /// Moves to the next cell; `false` at the end of the segment.
    fn advance(&mut self) -> bool {
        let axis = (0..3).fold(0, |best, axis| {
            if self.next_t[axis] < self.next_t[best] {
                axis
            } else {
                best
            }
        });
        if self.next_t[axis] > 1.0 {
            return false;
        }
        self.entered_t = self.next_t[axis].max(self.entered_t);
        self.cell[axis] += self.step[axis];
        self.next_t[axis] += self.delta_t[axis];
        true
    }
}

#[cfg(test)]
mod tests {
    use super::CellWalk;
    use jink_shared_types::frames::Point;
    use jink_shared_types::map::{CELL_M, cell_of};
    use nalgebra::Vector3;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_walk_visits_the_cell_of_every_point(
            a in proptest::array::uniform3(-5.0..5.0f64), b in proptest::array::uniform3(-5.0..5.0f64),
        ) {
            let (a, b) = (Vector3::from(a), Vector3::from(b));
            let mut walk = CellWalk::new(&a, &b);
            let mut visited = vec![walk.cell];
            while walk.advance() {
                visited.push(walk.cell);
            }
            for i in 0..=100 {
                let point = a + (b - a) * (f64::from(i) / 100.0);
                let cell = cell_of(Point::from_vector(point));
                let near_border = (0..3).any(|k| {
                    let f = (point[k] / CELL_M).rem_euclid(1.0);
                    !(1e-6..=1.0 - 1e-6).contains(&f)
                });
                prop_assert!(near_border || visited.contains(&cell));
            }
        }
    }
}
