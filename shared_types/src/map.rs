//! The local map: a sliding, tri-state voxel window around the vehicle, as bit planes.
//!
//! Cells have global integer indices: cell `i` of an axis covers `[i * CELL_M, (i + 1) * CELL_M)` of the local NED
//! frame. The window holds `SIZE` consecutive indices per axis; a cell lives at its global index modulo the size, so
//! that sliding moves no data (after ROG-Map, arXiv 2302.14819, section III). A plane has one bit per cell, x
//! fastest: one row of 128 cells is one `u128`, and dilation by one cell along x is a rotation.
//!
//! Three states, never two: `occupied`, known free (`known` and not `occupied`), unknown. Unknown is not free. A cell of which nothing
//! was measured may still count as known because the user declares it ([`declared_as`]): those cells are `declared`, too.

use crate::coded::Flag;
use crate::faults::{FaultBits, SensorFault, fault_of};
use crate::frames::{LocalNed, Point};
use crate::reserved::{Added, Reserved};
use crate::view::FieldOfView;

/// Edge of a cell (m). Half a vehicle radius resolves gaps of vehicle size; half of it again costs eight times the work.
/// For comparisons of resolutions a build may have another: `JINK_CELL_MM`, in whole millimetres from 50 to 500, set while it is
/// compiled. The window keeps its number of cells, so its size changes with them. Processes of builds that differ refuse
/// to meet.
pub const CELL_M: f64 = match option_env!("JINK_CELL_MM") {
    None => 0.2,
    Some(text) => match u32::from_str_radix(text, 10) {
        Ok(millimetres @ 50..=500) => millimetres as f64 / 1e3,
        _ => panic!("JINK_CELL_MM: not a whole number from 50 to 500"),
    },
};
/// Cells along north.
pub const SIZE_X: usize = 128;
/// Cells along east.
pub const SIZE_Y: usize = 128;
/// Cells along down.
pub const SIZE_Z: usize = 64;
/// Rows (of `SIZE_X` cells) in a plane.
pub const ROWS: usize = SIZE_Y * SIZE_Z;
/// Cells in the window.
pub const CELLS: usize = SIZE_X * ROWS;

/// A cell's global index along north, east, down.
pub type Cell = [i32; 3];

/// One bit per cell of the window: `rows[row_of(cell)]`, bit [`bit_of`]. Low 64 cells first.
pub type Plane = [[u64; 2]; ROWS];

/// The cell that holds `point`.
pub fn cell_of(point: Point<LocalNed>) -> Cell {
    [
        (point.x_m / CELL_M).floor() as i32,
        (point.y_m / CELL_M).floor() as i32,
        (point.z_m / CELL_M).floor() as i32,
    ]
}

/// The centre of `cell`.
pub fn center_of(cell: Cell) -> Point<LocalNed> {
    Point::new(
        (f64::from(cell[0]) + 0.5) * CELL_M,
        (f64::from(cell[1]) + 0.5) * CELL_M,
        (f64::from(cell[2]) + 0.5) * CELL_M,
    )
}

/// Row of `cell` within a plane.
pub fn row_of(cell: Cell) -> usize {
    let y = cell[1] as usize & (SIZE_Y - 1);
    let z = cell[2] as usize & (SIZE_Z - 1);
    z * SIZE_Y + y
}

/// Bit of `cell` within its row.
pub fn bit_of(cell: Cell) -> u32 {
    (cell[0] as usize & (SIZE_X - 1)) as u32
}

/// Whether the bit of `cell` is set in `plane`; the caller ensures that the cell is inside the window.
pub fn test(plane: &Plane, cell: Cell) -> bool {
    let bit = bit_of(cell);
    (plane[row_of(cell)][(bit >> 6) as usize] >> (bit & 63)) & 1 == 1
}

/// Sets the bit of `cell` in `plane`.
pub fn set(plane: &mut Plane, cell: Cell) {
    let bit = bit_of(cell);
    plane[row_of(cell)][(bit >> 6) as usize] |= 1 << (bit & 63);
}

/// Clears the bit of `cell` in `plane`.
pub fn clear(plane: &mut Plane, cell: Cell) {
    let bit = bit_of(cell);
    plane[row_of(cell)][(bit >> 6) as usize] &= !(1 << (bit & 63));
}

/// What a user can declare of space that no sensor measures. Every map lists the declarations in force, every plan
/// those it uses.
pub mod declared_as {
    /// What is near the vehicle when it is armed, and above it while it takes off, is free (`OA_DCL_START`).
    pub const START: u8 = 1;
    /// What a planar sensor says of its plane holds for a band above and below it (`band_up_m`, `band_down_m` of the sensor).
    pub const BAND: u8 = 2;
    /// Nothing hangs from above between two heights (`OA_DCL_HANG_LO`, `OA_DCL_HANG_HI`).
    pub const NO_OVERHANG: u8 = 4;
    /// A ray without an answer met nothing (`no_return` of the sensor).
    pub const NO_RETURN: u8 = 8;

    /// Bit, and what it is called.
    pub const NAMES: [(u8, &str); 4] = [
        (START, "start bubble"),
        (BAND, "planar band"),
        (NO_OVERHANG, "no overhang"),
        (NO_RETURN, "no return is clear"),
    ];
}

crate::sample! {
    /// The window. Written in place: never copy one.
    pub struct LocalMap: 393872 {
        /// Smallest global cell index inside the window, per axis.
        pub min_cell: Cell,
        /// How many sensors contributed within their deadline.
        pub live_sensors: u16,
        /// Whether any range data are fresh enough to commit a new motion.
        pub ranges_fresh: Flag,
        /// How many sensors sent frames within their deadline, whether these had information or not.
        pub sending_sensors: Added<u8>,
        /// Explicit padding, zero.
        pub reserved: Reserved<4>,
        /// Counts how often the map was cleared (estimator reset, restart).
        pub epoch: u32,
        /// Occupied cells among them.
        pub occupied_cells: u32,
        /// Known cells.
        pub known_cells: u32,
        /// Edge of a cell (m): [`CELL_M`] of the build that filled it.
        pub cell_m: f64,
        /// Declarations of the user that are in force, bits of [`declared_as`].
        pub declarations: u8,
        /// The gravest fault of each sensor.
        pub faults: Added<FaultBits>,
        /// Room for later fields, zero.
        pub reserved2: Reserved<1>,
        /// What the sensors can see.
        pub view: FieldOfView,
        /// Cells seen occupied.
        pub occupied: Plane,
        /// Cells seen at all (free or occupied), and cells that are declared.
        pub known: Plane,
        /// Cells that are known only because the user declares it.
        pub declared: Plane,
    }
    means { CELL_M: f64, SIZE_X: usize, SIZE_Y: usize, SIZE_Z: usize }
    plausible if Self::is_consistent
}

/// Short: without cells and points.
impl std::fmt::Debug for LocalMap {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "LocalMap(from {:?}, {} occupied, {} known)",
            self.min_cell, self.occupied_cells, self.known_cells
        )
    }
}

impl LocalMap {
    /// Whether its cells are as large as this build takes them to be, and not more are counted than there are. The
    /// cells themselves are not looked at: every bit pattern is a map.
    pub fn is_consistent(&self) -> bool {
        let counts_fit = self.occupied_cells as usize <= CELLS && self.known_cells as usize <= CELLS;
        self.cell_m == CELL_M && counts_fit
    }

    /// Whether `cell` lies inside the window.
    pub fn contains(&self, cell: Cell) -> bool {
        let size = [SIZE_X as i32, SIZE_Y as i32, SIZE_Z as i32];
        (0..3).all(|axis| {
            let offset = i64::from(cell[axis]) - i64::from(self.min_cell[axis]);
            (0..i64::from(size[axis])).contains(&offset)
        })
    }

    /// Whether `cell` was seen occupied; cells outside the window were not.
    pub fn is_occupied(&self, cell: Cell) -> bool {
        self.contains(cell) && test(&self.occupied, cell)
    }

    /// Whether `cell` is known to be free; cells outside the window are not.
    pub fn is_free(&self, cell: Cell) -> bool {
        self.contains(cell) && test(&self.known, cell) && !test(&self.occupied, cell)
    }

    /// The fault of the sensor with this number, in the order of the configuration, if one is known.
    pub fn fault_of(&self, sensor: usize) -> Option<SensorFault> {
        fault_of(self.faults.get()?, sensor)
    }

    /// An all-unknown map on the heap, for tests and for simulations within one process.
    pub fn boxed() -> Box<Self> {
        let mut map: Box<Self> = crate::sample::zeroed_box();
        map.cell_m = CELL_M;
        map
    }
}

#[cfg(test)]
mod tests {
    use super::{Cell, LocalMap, cell_of, center_of, set};
    use crate::frames::Point;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_cell_holds_its_centre(x in -5_000..5_000i32, y in -5_000..5_000i32, z in -5_000..5_000i32) {
            prop_assert_eq!(cell_of(center_of([x, y, z])), [x, y, z]);
        }

        #[test]
        fn a_point_lies_within_half_a_cell_of_the_centre(x in -1e3..1e3f64, y in -1e3..1e3f64, z in -1e3..1e3f64) {
            let point = Point::new(x, y, z);
            let offset = point.vector() - center_of(cell_of(point)).vector();
            prop_assert!(offset.amax() <= 0.5 * super::CELL_M + 1e-9);
        }
    }

    #[test]
    fn nothing_is_known_outside_the_window() {
        let mut map = LocalMap::boxed();
        map.min_cell = [-64, -64, -32];
        let inside: Cell = [3, -7, 1];
        set(&mut map.known, inside);
        assert!(map.is_free(inside));
        assert!(
            !map.is_free([3 + 128, -7, 1]),
            "the alias of a known cell is outside"
        );
        assert!(!map.is_free([4, -7, 1]), "unknown is not free");
        set(&mut map.occupied, inside);
        assert!(!map.is_free(inside) && map.is_occupied(inside));
    }
}
