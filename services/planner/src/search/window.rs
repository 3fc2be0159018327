//! Where the cells of the window lie in the memory of a search, and which of them are at its border.

use crate::configuration_space::ConfigurationSpace;
use jink_shared_types::map::{Cell, SIZE_X, SIZE_Y, SIZE_Z};

pub(super) const CELLS: usize = SIZE_X * SIZE_Y * SIZE_Z;

pub(super) fn index_of(cell: Cell) -> usize {
    let x = cell[0] as usize & (SIZE_X - 1);
    let y = cell[1] as usize & (SIZE_Y - 1);
    let z = cell[2] as usize & (SIZE_Z - 1);
    (z * SIZE_Y + y) * SIZE_X + x
}

/// The cell inside the window that starts at `min_cell` and has the memory `index`.
pub(super) fn cell_at(index: usize, min_cell: Cell) -> Cell {
    let local = [index % SIZE_X, index / SIZE_X % SIZE_Y, index / (SIZE_X * SIZE_Y)];
    let size = [SIZE_X, SIZE_Y, SIZE_Z];
    std::array::from_fn(|axis| {
        let offset = local[axis].wrapping_sub(min_cell[axis] as usize) & (size[axis] - 1);
        min_cell[axis] + offset as i32
    })
}

/// Whether `cell` lies in the outermost two cells of what the layers of `tier` hold.
pub(super) fn on_shell(space: &ConfigurationSpace, tier: usize, cell: Cell) -> bool {
    let min = space.min_cell(tier);
    let size = [SIZE_X as i32, SIZE_Y as i32, SIZE_Z as i32];
    (0..3).any(|axis| {
        let offset = cell[axis] - min[axis];
        offset < 2 || offset >= size[axis] - 2
    })
}
