//! Which cells of the far map the fine map has shown to be too narrow.
//!
//! | in | out |
//! |---|---|
//! | what the fine map shows around the vehicle, while there is no progress | cells of the far map's window that no speed tier passes |
//!
//! A gap that looks wide enough in cells of 0.4 m would draw the vehicle back as soon as it has left the fine window. The
//! newest look at a cell decides. All is forgotten with another goal or another epoch of the map, and a cell when it
//! leaves the window.

use super::far_index;
use jink_shared_types::far_map::{FAR_CELL_M, FAR_X, FAR_Y, FarMap};
use jink_shared_types::frames::{LocalNed, Point};

/// Cost of a step through such a cell, relative to a free one: 12 m per cell.
pub const TOO_NARROW_FACTOR: u32 = 30;
/// Words of 64 cells per row.
const ROW_WORDS: usize = FAR_X / 64;

/// The cells that are too narrow.
#[derive(Debug)]
pub struct TooNarrow {
    /// One bit per cell, by the index modulo the size of the window.
    bits: Vec<u64>,
    /// The smallest cell of the window for which they are kept.
    min_cell: [i32; 2],
    epoch: u32,
}

impl Default for TooNarrow {
    fn default() -> Self {
        Self {
            bits: vec![0; ROW_WORDS * FAR_Y],
            min_cell: [0; 2],
            epoch: 0,
        }
    }
}

impl TooNarrow {
    /// Forgets all cells.
    pub fn clear(&mut self) {
        self.bits.fill(0);
    }

    /// Takes from the fine map which cells of `map` are too narrow, up to `reach_m` to each side of `here`:
    /// `is_too_narrow` gets the middle of each (local, north and east, m).
    pub fn learn(
        &mut self,
        map: &FarMap,
        here: &Point<LocalNed>,
        reach_m: f64,
        is_too_narrow: impl Fn(f64, f64) -> bool,
    ) {
        self.follow(map);
        let [low, high] = [-reach_m, reach_m].map(|off_m| [here.x_m, here.y_m].map(|m| far_index(m + off_m)));
        let middle_m = |index: i32| (f64::from(index) + 0.5) * FAR_CELL_M;
        for y in low[1]..=high[1] {
            for x in low[0]..=high[0] {
                let (word, bit) = word_and_bit([x, y]);
                let is_set = u64::from(is_too_narrow(middle_m(x), middle_m(y)));
                self.bits[word] = self.bits[word] & !(1 << bit) | is_set << bit;
            }
        }
    }

    /// Forgets the cells that have left the window of `map`, because their bits belong to other cells now, and all if it
    /// is of another epoch.
    pub fn follow(&mut self, map: &FarMap) {
        let min_cell = [map.min_cell[0], map.min_cell[1]];
        let before = std::mem::replace(&mut self.min_cell, min_cell);
        if std::mem::replace(&mut self.epoch, map.epoch) != map.epoch {
            self.clear();
            return;
        }
        for x in entered(min_cell[0], before[0], FAR_X) {
            let (word, bit) = word_and_bit([x, 0]);
            let rows = self.bits.chunks_exact_mut(ROW_WORDS);
            rows.for_each(|row| row[word] &= !(1 << bit));
        }
        for y in entered(min_cell[1], before[1], FAR_Y) {
            let (word, _) = word_and_bit([0, y]);
            self.bits[word..][..ROW_WORDS].fill(0);
        }
    }

    /// The cells, as x and y from the smallest cell of the window.
    pub fn offsets(&self) -> impl Iterator<Item = [usize; 2]> {
        let set = self.bits.iter().enumerate().filter(|(_, word)| **word != 0);
        set.flat_map(move |(word, bits)| {
            let (x, y) = (word % ROW_WORDS * 64, word / ROW_WORDS);
            let is_set = move |bit: &usize| bits >> bit & 1 == 1;
            let offset = move |bit| self.offset([x + bit, y]);
            (0..64).filter(is_set).map(offset)
        })
    }

    fn offset(&self, [x, y]: [usize; 2]) -> [usize; 2] {
        let modulo = |index: usize, min: i32, size: usize| index.wrapping_sub(min as usize) & (size - 1);
        [
            modulo(x, self.min_cell[0], FAR_X),
            modulo(y, self.min_cell[1], FAR_Y),
        ]
    }
}

/// Word and bit of a cell.
fn word_and_bit([x, y]: [i32; 2]) -> (usize, usize) {
    let [x, y] = [x as usize & (FAR_X - 1), y as usize & (FAR_Y - 1)];
    (y * ROW_WORDS + (x >> 6), x & 63)
}

/// The indices along an axis that a window of `size` cells has from `min` on, and had not from `before` on.
fn entered(min: i32, before: i32, size: usize) -> impl Iterator<Item = i32> {
    let moved = min.wrapping_sub(before);
    let count = moved.unsigned_abs().min(size as u32) as i32;
    let first = if moved > 0 {
        min.wrapping_add(size as i32 - count)
    } else {
        min
    };
    (0..count).map(move |step| first.wrapping_add(step))
}

#[cfg(test)]
mod tests {
    use super::{FAR_CELL_M, FAR_X, FarMap, Point, TooNarrow};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn a_cell_keeps_its_place_and_is_forgotten_when_it_leaves_the_window(
            by in prop::array::uniform2(-300..300i32), cell in prop::array::uniform2(-25..25i32)
        ) {
            let mut map = FarMap::boxed();
            map.min_cell = [-(FAR_X as i32) / 2, -(FAR_X as i32) / 2, -16];
            let mut narrow = TooNarrow::default();
            let middle = cell.map(|index| (f64::from(index) + 0.5) * FAR_CELL_M);
            let is_it = |x: f64, y: f64| (x - middle[0]).abs() < 0.1 && (y - middle[1]).abs() < 0.1;
            narrow.learn(&map, &Point::new(0.0, 0.0, -2.5), 11.0, is_it);
            for (min, by) in map.min_cell.iter_mut().zip(by) {
                *min += by;
            }
            narrow.follow(&map);
            let offset = [0, 1].map(|axis| cell[axis] - map.min_cell[axis]);
            let is_inside = offset.iter().all(|offset| (0..FAR_X as i32).contains(offset));
            let kept: Vec<[i32; 2]> = narrow.offsets().map(|cell| cell.map(|index| index as i32)).collect();
            prop_assert_eq!(kept, if is_inside { vec![offset] } else { Vec::new() });
        }
    }

    #[test]
    fn nothing_is_kept_of_another_epoch() {
        let mut map = FarMap::boxed();
        let mut narrow = TooNarrow::default();
        narrow.learn(&map, &Point::new(10.0, 10.0, -2.5), 2.0, |_, _| true);
        assert!(narrow.offsets().count() > 0);
        map.epoch += 1;
        narrow.follow(&map);
        assert_eq!(narrow.offsets().count(), 0);
    }
}
