//! The vehicle's own volume: space that is free because the vehicle is in it, and space around it that the user
//! declares free.

use crate::frame_bits::FrameBits;
use crate::window::MapWindow;
use jink_shared_types::Point;
use jink_shared_types::map::{CELL_M, Cell, cell_of, center_of};
use nalgebra::Vector3;

/// Marks the cells of the sphere of `radius_m` around `center_m` (local) as free in `frame`: those with their centre in
/// the sphere. Of these, cells that reach out of the sphere and are occupied keep their state: the obstacle may be in
/// the part outside, in a sensor's blind zone, and hovering beside it must not clear it.
pub(crate) fn mark_body(frame: &mut FrameBits, window: &MapWindow, center_m: Vector3<f64>, radius_m: f64) {
    let corner = |offset_m: f64| cell_of(Point::from_vector(center_m.add_scalar(offset_m)));
    let (low, high) = (corner(-radius_m), corner(radius_m));
    for z in low[2]..=high[2] {
        for y in low[1]..=high[1] {
            for x in low[0]..=high[0] {
                let cell = [x, y, z];
                let whole = farthest_m(cell, center_m) <= radius_m;
                let mostly = (center_of(cell).vector() - center_m).norm() <= radius_m;
                if whole || (mostly && !window.is_occupied(cell)) {
                    frame.mark_free(cell);
                }
            }
        }
    }
}

/// Declares the cells of the sphere of `radius_m` around `center_m` (local) free if they are unknown.
pub(crate) fn declare_sphere(window: &mut MapWindow, center_m: Vector3<f64>, radius_m: f64) {
    let corner = |offset_m: f64| cell_of(Point::from_vector(center_m.add_scalar(offset_m)));
    let (low, high) = (corner(-radius_m), corner(radius_m));
    for z in low[2]..=high[2] {
        for y in low[1]..=high[1] {
            for x in low[0]..=high[0] {
                if (center_of([x, y, z]).vector() - center_m).norm() <= radius_m {
                    window.declare_free([x, y, z]);
                }
            }
        }
    }
}

/// Distance from `point_m` to the corner of `cell` farthest from it.
fn farthest_m(cell: Cell, point_m: Vector3<f64>) -> f64 {
    let offset = (center_of(cell).vector() - point_m).abs();
    offset.add_scalar(0.5 * CELL_M).norm()
}
