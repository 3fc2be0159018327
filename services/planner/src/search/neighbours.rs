//! The steps from a cell to its 26 neighbours, and which of those cells are free.

use crate::bit_layer::BitLayer;
use jink_shared_types::map::Cell;

/// One step of the 26 neighbours.
#[derive(Clone, Copy, Debug)]
pub(super) struct NeighbourStep {
    pub(super) by: Cell,
    /// In cells.
    pub(super) length: f64,
    /// Bits of the 27-neighbourhood (`(dz + 1) * 9 + (dy + 1) * 3 + dx + 1`) that must be free.
    pub(super) needs: u32,
}

pub(super) fn steps() -> Vec<NeighbourStep> {
    let bit = |dx: i32, dy: i32, dz: i32| 1u32 << ((dz + 1) * 9 + (dy + 1) * 3 + dx + 1);
    let mut steps = Vec::with_capacity(26);
    for dz in -1..=1 {
        for dy in -1..=1 {
            for dx in -1..=1i32 {
                if (dx, dy, dz) == (0, 0, 0) {
                    continue;
                }
                let mut needs = 0;
                for x in [0, dx] {
                    for y in [0, dy] {
                        for z in [0, dz] {
                            needs |= bit(x, y, z);
                        }
                    }
                }
                let cells = f64::from(dx * dx + dy * dy + dz * dz).sqrt();
                steps.push(NeighbourStep {
                    by: [dx, dy, dz],
                    length: cells,
                    needs: needs & !bit(0, 0, 0),
                });
            }
        }
    }
    steps
}

/// The 27 cells around `cell` that are not in `layer`, as bits.
pub(super) fn neighbours_outside(bit_layer: &BitLayer, cell: Cell) -> u32 {
    let shift = jink_shared_types::map::bit_of(cell);
    let mut free = 0;
    let mut place = 0;
    for dz in -1..=1 {
        for dy in -1..=1 {
            let row = bit_layer.row_at([cell[0], cell[1] + dy, cell[2] + dz]);
            // Bits x-1, x, x+1, rotated to the bottom.
            let three = row.rotate_right(shift).rotate_left(1) as u32 & 0b111;
            free |= (!three & 0b111) << place;
            place += 3;
        }
    }
    free
}
