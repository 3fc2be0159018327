//! Indices and distances of cells: those of the map, and the half cells of the lowest speed tier.

use crate::bit_layer::gap_m;
use crate::speed_tiers::LAST_TIER;
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::map::{CELL_M, Cell, SIZE_X, SIZE_Y, SIZE_Z, cell_of};
use nalgebra::Vector3;

/// How many cells of `tier` fit along an edge of a map cell.
pub(super) fn per_cell(tier: usize) -> i32 {
    if tier == LAST_TIER { 2 } else { 1 }
}

/// Edge of a cell of `tier` (m).
pub(super) fn cell_m(tier: usize) -> f64 {
    CELL_M / f64::from(per_cell(tier))
}

/// Whether `cell` is one of a layer that begins at `min_cell`.
pub(super) fn is_within(min_cell: Cell, cell: Cell) -> bool {
    let inside = |axis: usize, size: usize| {
        let offset = cell[axis].wrapping_sub(min_cell[axis]);
        (0..size as i32).contains(&offset)
    };
    inside(0, SIZE_X) && inside(1, SIZE_Y) && inside(2, SIZE_Z)
}

/// The map's cell of `place` (local, m).
pub(super) fn cell_holding(place: &Vector3<f64>) -> Cell {
    cell_of(Point::<LocalNed>::from_vector(*place))
}

/// The cells whose nearest points are nearer than `radius_m` to those of `cell`, with that distance (m).
pub(super) fn cells_within(cell: Cell, radius_m: f64) -> impl Iterator<Item = (Cell, f64)> {
    let reach = (radius_m / CELL_M).ceil() as i32 + 1;
    let offsets = (-reach..=reach).flat_map(move |dz| {
        (-reach..=reach).flat_map(move |dy| (-reach..=reach).map(move |dx| [dx, dy, dz]))
    });
    offsets.filter_map(move |offset: Cell| {
        let away_m = Vector3::from(offset.map(gap_m)).norm();
        let there = std::array::from_fn(|axis| cell[axis] + offset[axis]);
        (away_m < radius_m).then_some((there, away_m))
    })
}

/// Square of the distance between the centres of two cells (cells squared).
pub(crate) fn distance_squared_cells(a: Cell, b: Cell) -> i64 {
    (0..3)
        .map(|axis| (i64::from(a[axis]) - i64::from(b[axis])).pow(2))
        .sum()
}
