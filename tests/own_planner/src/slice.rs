//! What stands at the height of the flight, seen from above.

use jink_shared_types::map::{CELL_M, LocalMap, SIZE_Y, bit_of, cell_of, row_of};
use jink_shared_types::{LocalNed, Point};

/// Cells above and below that count, and cells that are kept away from what stands (0.2 m each).
const HEIGHT: i32 = 4;
const DISTANCE: u32 = 4;

/// One bit for each column of the map that is too near to something.
pub struct Slice<'a> {
    rows: [u128; SIZE_Y],
    map: &'a LocalMap,
}

impl<'a> Slice<'a> {
    pub fn of(map: &'a LocalMap, z_m: f64) -> Self {
        let [x, y, middle] = cell_of(Point::new(
            f64::from(map.min_cell[0]) * CELL_M,
            f64::from(map.min_cell[1]) * CELL_M,
            z_m,
        ));
        let mut standing = [0; SIZE_Y];
        for z in middle - HEIGHT..=middle + HEIGHT {
            for (row, cell) in (0..SIZE_Y as i32).map(|row| [x, y + row, z]).enumerate() {
                if map.contains(cell) {
                    let [low, high] = map.occupied[row_of(cell)];
                    standing[row] |= u128::from(low) | u128::from(high) << 64;
                }
            }
        }
        let wide = standing
            .map(|row| (0..=DISTANCE).fold(0, |all, n| all | row.rotate_left(n) | row.rotate_right(n)));
        let rows = std::array::from_fn(|row| {
            let near = row.saturating_sub(DISTANCE as usize)..=(row + DISTANCE as usize).min(SIZE_Y - 1);
            wide[near].iter().fold(0, |all, row| all | row)
        });
        Self { rows, map }
    }

    /// Whether nothing stands on the part of `way` that is still ahead of `here` on the way to `goal`.
    pub fn is_clear(&self, way: &[Point<LocalNed>], here: Point<LocalNed>, goal: Point<LocalNed>) -> bool {
        let to_goal = goal.vector() - here.vector();
        way.windows(2).all(|leg| {
            let (start, leg) = (leg[0].vector(), leg[1].vector() - leg[0].vector());
            let steps = (leg.norm() / CELL_M).ceil().max(1.0) as u32;
            (0..=steps).all(|step| {
                let place = start + leg * (f64::from(step) / f64::from(steps));
                (place - here.vector()).dot(&to_goal) < 0.0
                    || self.is_free(Point::new(place.x, place.y, place.z))
            })
        })
    }

    /// What lies beyond the map is free until it is seen.
    fn is_free(&self, place: Point<LocalNed>) -> bool {
        let cell = cell_of(place);
        let [_, y, _] = self.map.min_cell;
        let row = usize::try_from(cell[1] - y)
            .ok()
            .and_then(|row| self.rows.get(row));
        !self.map.contains([cell[0], cell[1], self.map.min_cell[2]])
            || row.is_none_or(|row| row >> bit_of(cell) & 1 == 0)
    }
}
