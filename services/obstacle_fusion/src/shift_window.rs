//! Moves the window's cells to other coordinates, after a reset of the estimator.
//!
//! Cells are stored at their global index modulo the size, so a move by whole cells rotates every plane about its axes.
//! The rest of the move makes each old cell reach into a neighbour: a new cell is occupied if any old one that reaches
//! into it is, and known only if all of them are. Nothing is allocated.

use crate::cells::{BitPlane, SIZE, STRIDE};
use crate::rebase::FrameShift;
use crate::window::MapWindow;

/// Words of a row and of a layer.
const ROW_WORDS: usize = STRIDE[1] as usize / 64;
const LAYER_WORDS: usize = STRIDE[2] as usize / 64;

impl MapWindow {
    /// Gives every cell the coordinates that it has after `by`.
    pub fn shift(&mut self, by: &FrameShift) {
        let [x, y, z] = [0, 1, 2].map(|axis| by.cells[axis].rem_euclid(SIZE[axis]) as usize);
        for axis in 0..3 {
            self.min_cell[axis] = self.min_cell[axis].wrapping_add(by.cells[axis]);
        }
        for row in self.evidence.chunks_exact_mut(STRIDE[1] as usize) {
            row.rotate_right(x);
        }
        for layer in self.evidence.chunks_exact_mut(STRIDE[2] as usize) {
            layer.rotate_right(y * STRIDE[1] as usize);
        }
        self.evidence.rotate_right(z * STRIDE[2] as usize);
        for plane in [
            &mut self.occupied,
            &mut self.known,
            &mut self.declared,
            &mut self.settled,
        ] {
            turn(plane, [x, y, z]);
        }
        for axis in 0..3 {
            if by.into[axis] != 0 {
                self.spread(axis, by.into[axis]);
            }
        }
    }

    /// Merges every cell into its neighbour on side `into` (-1, 1) of `axis`.
    fn spread(&mut self, axis: usize, into: i32) {
        let others = match axis {
            0 => [1, 2],
            1 => [0, 2],
            _ => [0, 1],
        };
        let min_cell = self.min_cell;
        for b in 0..SIZE[others[1]] {
            for a in 0..SIZE[others[0]] {
                // From the side that is reached into, so that the merged cell is still the old one.
                for step in 0..SIZE[axis] {
                    let along = if into > 0 { SIZE[axis] - 1 - step } else { step };
                    let number = |along: i32| {
                        let mut cell = min_cell;
                        cell[axis] = cell[axis].wrapping_add(along);
                        cell[others[0]] = cell[others[0]].wrapping_add(a);
                        cell[others[1]] = cell[others[1]].wrapping_add(b);
                        crate::cells::number([0, 1, 2].map(|axis| cell[axis] & (SIZE[axis] - 1)))
                    };
                    let from = along - into;
                    let from = (0..SIZE[axis]).contains(&from).then(|| number(from));
                    self.merge_cell(number(along), from);
                }
            }
        }
    }
}

/// Rotates `plane` by so many cells along each axis.
fn turn(plane: &mut BitPlane, [x, y, z]: [usize; 3]) {
    for row in plane.chunks_exact_mut(ROW_WORDS) {
        let cells = (u128::from(row[0]) | u128::from(row[1]) << 64).rotate_left(x as u32);
        (row[0], row[1]) = (cells as u64, (cells >> 64) as u64);
    }
    for layer in plane.chunks_exact_mut(LAYER_WORDS) {
        layer.rotate_right(y * ROW_WORDS);
    }
    plane.rotate_right(z * LAYER_WORDS);
}

#[cfg(test)]
mod tests {
    use crate::cells::{SIZE, number, offset_in};
    use crate::frame_bits::FrameBits;
    use crate::rebase::FrameShift;
    use crate::window::MapWindow;
    use jink_shared_types::map::{Cell, LocalMap};
    use proptest::prelude::*;

    fn written(window: &MapWindow) -> Box<LocalMap> {
        let mut map = LocalMap::boxed();
        map.min_cell = window.min_cell();
        (map.occupied_cells, map.known_cells) = window.write(&mut map, None);
        map
    }

    fn state(map: &LocalMap, cell: Cell) -> (bool, bool) {
        (map.is_occupied(cell), map.is_occupied(cell) || map.is_free(cell))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(12))]

        #[test]
        fn a_moved_window_is_occupied_where_any_cell_reaches_and_free_where_all_were_free(
            cells in prop::array::uniform3(-300..300i32),
            into in prop::array::uniform3(-1..2i32),
            corner in prop::array::uniform3(0..50i32),
            hits in prop::collection::vec(prop::array::uniform3(0..12i32), 1..8),
            frames in 1..4usize,
        ) {
            let mut window = MapWindow::new();
            let min_cell = window.min_cell();
            let place = |o: [i32; 3]| [0, 1, 2].map(|axis| min_cell[axis] + corner[axis] + o[axis]);
            let mut frame = FrameBits::new();
            for _ in 0..frames {
                frame.begin(min_cell);
                for z in 0..12 {
                    for y in 0..12 {
                        for x in 0..12 {
                            frame.mark_free(place([x, y, z]));
                        }
                    }
                }
                for hit in &hits {
                    let number = number(offset_in(min_cell, place(*hit)).unwrap());
                    frame.hit[number >> 6] |= 1 << (number & 63);
                }
                window.apply(&frame);
            }
            let before = written(&window);
            window.shift(&FrameShift { cells, into });
            let after = written(&window);
            prop_assert_eq!(after.min_cell, [0, 1, 2].map(|axis| min_cell[axis] + cells[axis]));
            prop_assert!(after.occupied_cells > 0);
            for z in -2..15 {
                for y in -2..15 {
                    for x in -2..15 {
                        let old = place([x, y, z]);
                        let new = [0, 1, 2].map(|axis| old[axis] + cells[axis]);
                        if !after.contains(new) {
                            continue;
                        }
                        let (mut occupied, mut known) = (false, true);
                        for corner in 0..8 {
                            let from = [0, 1, 2].map(|axis| if corner >> axis & 1 == 1 { old[axis] - into[axis] } else { old[axis] });
                            let (is_occupied, is_known) = state(&before, from);
                            occupied |= is_occupied;
                            known &= is_known;
                        }
                        prop_assert_eq!(state(&after, new), (occupied, occupied || known), "{:?}", new);
                    }
                }
            }
            // The map continues as evidence: rays through a cell clear it, and no fewer than before.
            for cell in 0..SIZE[0] {
                let cell = [window.min_cell()[0] + cell, window.min_cell()[1], window.min_cell()[2]];
                prop_assert_eq!(window.is_occupied(cell), after.is_occupied(cell));
            }
        }
    }
}
