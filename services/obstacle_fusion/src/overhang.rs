//! The declaration that nothing hangs from above: what it adds to a map, and when it is contradicted.
//!
//! Above a free cell everything counts as free up to the last layer, unless something was seen. A ceiling, a bridge or
//! a tree crown contradicts the declaration as soon as it is seen: occupied cells above cells that were measured to be
//! free. Single ones occur at the rim of every trunk, so a piece of [`SLAB_CELLS`] cells, each with all four of its
//! neighbours, is required.

use crate::cells::SIZE;
use crate::window::{MapWindow, row};
use jink_shared_types::map::{LocalMap, SIZE_Y};

/// Cells of a layer, each between four others that hang as well, that are a piece of ceiling.
const SLAB_CELLS: u32 = 6;
/// Layers below that were measured to be free.
const FREE_BELOW: i32 = 2;

/// One bit per cell of a layer.
type LayerBits = [u128; SIZE_Y];

impl MapWindow {
    /// Declares the cells above free cells of `out` free in the layers `top` to `bottom` (global indices, z counts
    /// downwards); returns their number.
    pub(crate) fn declare_no_overhang(&self, out: &mut LocalMap, [top, bottom]: [i32; 2]) -> u32 {
        let mut declared = 0;
        for y in 0..SIZE_Y {
            let mut open = [0u64; 2];
            for z in self.layers([top, bottom]).rev() {
                let row = row_number(z, y);
                for (half, open) in open.iter_mut().enumerate() {
                    let (known, occupied) = (out.known[row][half], out.occupied[row][half]);
                    let added = *open & !known;
                    out.known[row][half] |= added;
                    out.declared[row][half] |= added;
                    declared += added.count_ones();
                    *open = (*open | known) & !occupied;
                }
            }
        }
        declared
    }

    /// Whether a piece of ceiling was seen in these layers.
    pub(crate) fn has_ceiling(&self, layers: [i32; 2]) -> bool {
        self.layers(layers).any(|z| {
            let hanging: LayerBits = std::array::from_fn(|y| self.hanging(z, y));
            let inner = |y: usize| {
                let here = hanging[y];
                let beside = here.rotate_left(1) & here.rotate_right(1);
                here & beside & hanging[(y + 1) % SIZE_Y] & hanging[(y + SIZE_Y - 1) % SIZE_Y]
            };
            hanging.iter().any(|row| *row != 0)
                && (0..SIZE_Y).map(|y| inner(y).count_ones()).sum::<u32>() >= SLAB_CELLS
        })
    }

    /// The cells of a row that are occupied above measured free ones.
    fn hanging(&self, z: i32, y: usize) -> u128 {
        let last = self.min_cell()[2] + SIZE[2] - 1;
        if z + FREE_BELOW > last {
            return 0;
        }
        let [known, occupied, declared] = [&self.known, &self.occupied, &self.declared];
        let word = |z: i32| 2 * row_number(z, y);
        let occupied_here = row(occupied, word(z));
        if occupied_here == 0 {
            return 0;
        }
        (z + 1..=z + FREE_BELOW).fold(occupied_here, |cells, z| {
            let word = word(z);
            cells & row(known, word) & !row(occupied, word) & !row(declared, word)
        })
    }

    fn layers(&self, [top, bottom]: [i32; 2]) -> std::ops::RangeInclusive<i32> {
        let first = self.min_cell()[2];
        top.max(first)..=bottom.min(first + SIZE[2] - 1)
    }
}

/// Which row of a plane holds the cells of layer `z` at `y` within it.
fn row_number(z: i32, y: usize) -> usize {
    (z & (SIZE[2] - 1)) as usize * SIZE_Y + y
}

#[cfg(test)]
mod tests {
    use crate::frame_bits::{FrameBits, RayBatch};
    use crate::window::MapWindow;
    use jink_shared_types::map::{Cell, LocalMap};

    /// A window around the origin in which `free` and `occupied` were measured.
    fn window(free: impl IntoIterator<Item = Cell>, occupied: impl IntoIterator<Item = Cell>) -> MapWindow {
        let mut window = MapWindow::new();
        let mut frame = FrameBits::new();
        frame.begin(window.min_cell());
        for cell in free {
            frame.mark_free(cell);
        }
        let mut hits = RayBatch::new();
        for cell in occupied {
            let along = |axis: usize| (cell[axis] - window.min_cell()[axis]) as f32 + 0.5;
            hits.push([along(0), along(1), along(2)], 0.0, true);
            frame.enter(None, &mut hits);
        }
        for _ in 0..4 {
            window.apply(&frame);
        }
        window
    }

    /// A block of cells: x, y and z from and to, both included; z counts downwards.
    fn block(x: [i32; 2], y: [i32; 2], z: [i32; 2]) -> impl Iterator<Item = Cell> {
        (x[0]..=x[1])
            .flat_map(move |i| (y[0]..=y[1]).flat_map(move |j| (z[0]..=z[1]).map(move |k| [i, j, k])))
    }

    const LAYERS: [i32; 2] = [-20, 10];

    #[test]
    fn what_is_above_free_cells_is_declared_up_to_what_was_seen() {
        let window = window(block([0, 2], [0, 0], [3, 4]), block([2, 2], [0, 0], [-5, -5]));
        let mut map = LocalMap::boxed();
        let (_, known) = window.write(&mut map, Some(LAYERS));
        map.min_cell = window.min_cell();
        let is_free = |cell: Cell| map.is_free(cell);
        assert!(is_free([0, 0, -20]) && is_free([1, 0, 2]) && is_free([2, 0, -4]));
        assert!(!is_free([0, 0, -21]), "above the last layer");
        assert!(!is_free([2, 0, -6]), "above what was seen");
        assert!(!is_free([3, 0, 0]) && !is_free([0, 1, 0]), "above nothing");
        assert_eq!(known, 7 + 23 + 23 + 7);
    }

    #[test]
    fn a_ceiling_contradicts_it_and_trunks_walls_and_single_cells_do_not() {
        let hall = || block([-9, 9], [-9, 9], [-3, 5]);
        assert!(!window(hall(), []).has_ceiling(LAYERS));
        assert!(
            window(hall(), block([-4, 4], [-2, 2], [-4, -4])).has_ceiling(LAYERS),
            "a piece of ceiling"
        );
        assert!(
            !window(hall(), block([-4, 4], [-2, 2], [-4, -4])).has_ceiling([-3, 10]),
            "in other layers"
        );
        // Nothing but the trunk or wall was measured below it.
        let trunk = || block([2, 4], [2, 4], [-8, 5]);
        let around = hall().filter(|cell| !(2..=4).contains(&cell[0]) || !(2..=4).contains(&cell[1]));
        assert!(!window(around, trunk()).has_ceiling(LAYERS));
        // Its rim is measured now and then.
        let rim = trunk().filter(|cell| cell[0] == 2 && cell[2] < -1);
        assert!(!window(hall(), rim).has_ceiling(LAYERS));
    }
}
