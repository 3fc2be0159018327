//! The far map: a coarse window around the fine one ([`crate::map`]), for guidance.
//!
//! It reaches four times as far and remembers what the fine window has left behind, so that a path is chosen by the
//! obstacles 50 m ahead, and a dead end is left for good. No motion is certified by it: a cell is occupied if anything
//! in it is, and one that is not may still hold something that no ray has met.
//!
//! Cells have global indices: cell `i` of an axis covers `[i * FAR_CELL_M, (i + 1) * FAR_CELL_M)` of the local NED
//! frame, two cells of the fine map. As there, a cell lives at its global index modulo the size, one bit per cell, x
//! fastest.

use crate::map::{CELL_M, Cell};

/// Edge of a cell (m).
pub const FAR_CELL_M: f64 = 2.0 * CELL_M;
/// Cells along north.
pub const FAR_X: usize = 256;
/// Cells along east.
pub const FAR_Y: usize = 256;
/// Cells along down: as high as the fine window.
pub const FAR_Z: usize = 32;
/// Rows (of `FAR_X` cells) in a plane.
pub const FAR_ROWS: usize = FAR_Y * FAR_Z;

/// One bit per cell of the window: `rows[far_row_of(cell)]`, bit `x modulo 64` of word `x / 64 modulo 4`.
pub type FarPlane = [[u64; FAR_X / 64]; FAR_ROWS];

/// Row of `cell` within a plane.
pub fn far_row_of(cell: Cell) -> usize {
    (cell[2] as usize & (FAR_Z - 1)) * FAR_Y + (cell[1] as usize & (FAR_Y - 1))
}

/// Whether the bit of `cell` is set in `plane`; the caller ensures that the cell is inside the window.
pub fn test(plane: &FarPlane, cell: Cell) -> bool {
    let bit = cell[0] as usize & (FAR_X - 1);
    (plane[far_row_of(cell)][bit >> 6] >> (bit & 63)) & 1 == 1
}

/// Sets the bit of `cell` in `plane`.
pub fn set(plane: &mut FarPlane, cell: Cell) {
    let bit = cell[0] as usize & (FAR_X - 1);
    plane[far_row_of(cell)][bit >> 6] |= 1 << (bit & 63);
}

crate::sample! {
    /// The window. Written in place: never copy one.
    pub struct FarMap: 524312 {
        /// Smallest global cell index inside the window, per axis, in cells of this map.
        pub min_cell: Cell,
        /// [`crate::map::LocalMap::epoch`] of the fine map that it surrounds.
        pub epoch: u32,
        /// Edge of a cell (m): [`FAR_CELL_M`] of the build that filled it.
        pub cell_m: f64,
        /// Cells in which something was seen.
        pub occupied: FarPlane,
        /// Cells that anything is known of.
        pub known: FarPlane,
    }
    means { FAR_CELL_M: f64, FAR_X: usize, FAR_Y: usize, FAR_Z: usize }
    plausible if Self::is_consistent
}

/// Short: without the cells.
impl std::fmt::Debug for FarMap {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "FarMap(from {:?})", self.min_cell)
    }
}

impl FarMap {
    /// Whether its cells are as large as this build takes them to be. The cells themselves are not looked at: every bit
    /// pattern is a map.
    pub fn is_consistent(&self) -> bool {
        self.cell_m == FAR_CELL_M
    }

    /// Whether `cell` lies inside the window.
    pub fn contains(&self, cell: Cell) -> bool {
        let size = [FAR_X as i32, FAR_Y as i32, FAR_Z as i32];
        (0..3).all(|axis| {
            let offset = i64::from(cell[axis]) - i64::from(self.min_cell[axis]);
            (0..i64::from(size[axis])).contains(&offset)
        })
    }

    /// Whether something was seen in `cell`; outside the window nothing was.
    pub fn is_occupied(&self, cell: Cell) -> bool {
        self.contains(cell) && test(&self.occupied, cell)
    }

    /// An empty map on the heap, for tests and for simulations within one process.
    pub fn boxed() -> Box<Self> {
        let mut map: Box<Self> = crate::sample::zeroed_box();
        map.cell_m = FAR_CELL_M;
        map
    }
}
