//! Large parts of the page as bytes, little-endian.
//!
//! | part | after one byte of code and three zeros |
//! |---|---|
//! | cells ([`Part::Map`], [`Part::Border`], [`Part::Far`]) | edge of a cell (m, f32), smallest cell along north, east, down (i32), how many (u32), then three bytes each: how far from the smallest one |
//! | points ([`Part::Cloud`]) | their origin north, east, down (m, f32), how many (u32), then three i16 each: centimetres from the origin |
//! | way ([`Part::Trail`]) | how many (u32), then north, east, down each (m, f32) |

use crate::board::Part;
use jink_shared_types::far_map::{FAR_X, FAR_Y, FAR_Z, FarMap, FarPlane, far_row_of};
use jink_shared_types::map::{Cell, LocalMap, Plane, SIZE_X, SIZE_Y, SIZE_Z, row_of};
use jink_shared_types::ranges::{PointCloud, RayKind};
use nalgebra::{UnitQuaternion, Vector3};

/// Cells that a part has at most: more are drawn by no phone. Beyond, every second, third, ... is left out.
const CELLS_MAX: usize = 60_000;
/// Points of a cloud that are shown at most.
const POINTS_MAX: usize = 9_000;
/// Centimetres in a metre.
const CM: f64 = 100.0;

const _: () = assert!(SIZE_X == 128 && SIZE_Y <= 256 && SIZE_Z <= 256);
const _: () = assert!(FAR_X == 256 && FAR_Y <= 256 && FAR_Z <= 256);

/// The rows of a plane of the local map as they lie in the window: bit `i` is the cell `i` north of the smallest one.
struct Rows<'a> {
    plane: &'a Plane,
    min: Cell,
}

impl Rows<'_> {
    fn row(&self, y: usize, z: usize) -> u128 {
        let cell = [
            self.min[0],
            self.min[1].wrapping_add(y as i32),
            self.min[2].wrapping_add(z as i32),
        ];
        let [low, high] = self.plane[row_of(cell)];
        let row = u128::from(low) | u128::from(high) << 64;
        row.rotate_right(self.min[0] as u32 & (SIZE_X as u32 - 1))
    }
}

/// The occupied cells of the local map.
pub fn map(map: &LocalMap) -> Vec<u8> {
    let rows = Rows {
        plane: &map.occupied,
        min: map.min_cell,
    };
    cells(Part::Map, map.cell_m, map.min_cell, |each| {
        for z in 0..SIZE_Z {
            for y in 0..SIZE_Y {
                bits(rows.row(y, z), |x| each([x, y as u8, z as u8]));
            }
        }
    })
}

/// The free cells beside which nothing is known. What is outside of the window counts for neither.
pub fn border(map: &LocalMap) -> Vec<u8> {
    let min = map.min_cell;
    let (known, occupied) = (
        Rows {
            plane: &map.known,
            min,
        },
        Rows {
            plane: &map.occupied,
            min,
        },
    );
    let unknown = |y: usize, z: usize| !known.row(y, z);
    cells(Part::Border, map.cell_m, min, |each| {
        for z in 0..SIZE_Z {
            for y in 0..SIZE_Y {
                let free = known.row(y, z) & !occupied.row(y, z);
                if free == 0 {
                    continue;
                }
                let here = unknown(y, z);
                let mut beside = here << 1 | here >> 1;
                for (y, z) in [
                    (y.wrapping_sub(1), z),
                    (y + 1, z),
                    (y, z.wrapping_sub(1)),
                    (y, z + 1),
                ] {
                    if y < SIZE_Y && z < SIZE_Z {
                        beside |= unknown(y, z);
                    }
                }
                bits(free & beside, |x| each([x, y as u8, z as u8]));
            }
        }
    })
}

/// The occupied cells of the far map.
pub fn far(map: &FarMap) -> Vec<u8> {
    let plane: &FarPlane = &map.occupied;
    let [min_x, min_y, min_z] = map.min_cell;
    cells(Part::Far, map.cell_m, map.min_cell, |each| {
        for z in 0..FAR_Z {
            for y in 0..FAR_Y {
                let cell = [min_x, min_y.wrapping_add(y as i32), min_z.wrapping_add(z as i32)];
                let row = &plane[far_row_of(cell)];
                for (word, sixty_four) in row.iter().enumerate() {
                    bits(u128::from(*sixty_four), |bit| {
                        let from_min = (word as i32 * 64 + i32::from(bit)).wrapping_sub(min_x);
                        let x = from_min.rem_euclid(FAR_X as i32);
                        each([x as u8, y as u8, z as u8]);
                    });
                }
            }
        }
    })
}

/// Hands the number of every bit that is set to `each`.
fn bits(mut row: u128, mut each: impl FnMut(u8)) {
    while row != 0 {
        each(row.trailing_zeros() as u8);
        row &= row - 1;
    }
}

/// The part with the cells that `visit` finds, thinned evenly where there are too many.
fn cells(part: Part, cell_m: f64, min: Cell, visit: impl Fn(&mut dyn FnMut([u8; 3]))) -> Vec<u8> {
    let mut all = 0usize;
    visit(&mut |_| all += 1);
    let step = all.div_ceil(CELLS_MAX).max(1);
    let count = all.div_ceil(step);
    let mut bytes = begin(part, 24 + 3 * count);
    bytes.extend_from_slice(&(cell_m as f32).to_le_bytes());
    for axis in min {
        bytes.extend_from_slice(&axis.to_le_bytes());
    }
    bytes.extend_from_slice(&(count as u32).to_le_bytes());
    let mut number = 0usize;
    visit(&mut |cell| {
        if number.is_multiple_of(step) {
            bytes.extend_from_slice(&cell);
        }
        number += 1;
    });
    bytes
}

fn begin(part: Part, room: usize) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(room);
    bytes.extend_from_slice(&[part as u8, 0, 0, 0]);
    bytes
}

/// Where the vehicle was: position (local, m) and attitude.
pub type Pose = (Vector3<f64>, UnitQuaternion<f64>);

/// Points of clouds around the vehicle.
#[derive(Debug, Default)]
pub struct Points {
    origin: Vector3<f64>,
    offsets: Vec<u8>,
    count: u32,
}

impl Points {
    /// None yet, around a vehicle at `origin`.
    pub fn around(origin: Vector3<f64>) -> Self {
        Self {
            origin,
            ..Self::default()
        }
    }

    /// Adds the hits of a cloud, evenly thinned; `pose_at` is the pose so long after its first point (s).
    pub fn add(&mut self, cloud: &PointCloud, clouds: usize, pose_at: impl Fn(f64) -> Option<Pose>) {
        let points = cloud.points();
        let step = (points.len() * clouds.max(1)).div_ceil(POINTS_MAX).max(1);
        for point in points.iter().step_by(step) {
            if point.kind != RayKind::Hit {
                continue;
            }
            let Some((position, attitude)) = pose_at(f64::from(point.offset_10us) * 1e-5) else {
                continue;
            };
            let body = Vector3::new(point.forward_m, point.right_m, point.down_m).map(f64::from);
            let offset = position + attitude * body - self.origin;
            if !offset.iter().all(|axis| axis.abs() < 300.0) {
                continue;
            }
            for axis in offset.iter() {
                self.offsets
                    .extend_from_slice(&((axis * CM) as i16).to_le_bytes());
            }
            self.count += 1;
        }
    }

    /// As a part.
    pub fn bytes(&self) -> Vec<u8> {
        let mut bytes = begin(Part::Cloud, 20 + self.offsets.len());
        for axis in self.origin.iter() {
            bytes.extend_from_slice(&(*axis as f32).to_le_bytes());
        }
        bytes.extend_from_slice(&self.count.to_le_bytes());
        bytes.extend_from_slice(&self.offsets);
        bytes
    }
}

/// The way flown.
pub fn trail(points: &[[f32; 3]]) -> Vec<u8> {
    let mut bytes = begin(Part::Trail, 8 + 12 * points.len());
    bytes.extend_from_slice(&(points.len() as u32).to_le_bytes());
    for axis in points.iter().flatten() {
        bytes.extend_from_slice(&axis.to_le_bytes());
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::{CELLS_MAX, border, far, map};
    use jink_shared_types::far_map::{self, FarMap};
    use jink_shared_types::map::{Cell, LocalMap, set};

    /// The cells of a part.
    fn cells(bytes: &[u8]) -> Vec<Cell> {
        let number = |at: usize| i32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let min = [number(8), number(12), number(16)];
        let listed: Vec<Cell> = bytes[24..]
            .chunks(3)
            .map(|cell| [0, 1, 2].map(|axis| min[axis] + i32::from(cell[axis])))
            .collect();
        assert_eq!(number(20) as usize, listed.len());
        listed
    }

    #[test]
    fn cells_come_out_where_they_are_wherever_the_window_is() {
        for min_cell in [[0, 0, 0], [-64, -64, -32], [37, -201, 11], [-1, 127, -63]] {
            let mut local = LocalMap::boxed();
            local.min_cell = min_cell;
            let wanted = [[0, 0, 0], [127, 127, 63], [5, 70, 9]];
            let wanted = wanted.map(|cell| [0, 1, 2].map(|axis| min_cell[axis] + cell[axis]));
            for cell in wanted {
                set(&mut local.occupied, cell);
            }
            let mut found = cells(&map(&local));
            let mut expected = wanted.to_vec();
            found.sort_unstable();
            expected.sort_unstable();
            assert_eq!(found, expected);

            let mut window = FarMap::boxed();
            window.min_cell = min_cell;
            let cell = [min_cell[0] + 255, min_cell[1] + 3, min_cell[2] + 31];
            far_map::set(&mut window.occupied, cell);
            assert_eq!(cells(&far(&window)), [cell]);
        }
    }

    #[test]
    fn the_border_is_the_skin_of_what_is_free() {
        let mut local = LocalMap::boxed();
        local.min_cell = [-64, -64, -32];
        for x in -2..=2 {
            for y in -2..=2 {
                for z in -2..=2 {
                    set(&mut local.known, [x, y, z]);
                }
            }
        }
        set(&mut local.occupied, [2, 2, 2]);
        // 5 x 5 x 5 without the inner 3 x 3 x 3, and without a corner that is occupied.
        let found = cells(&border(&local));
        assert_eq!(found.len(), 125 - 27 - 1);
        assert!(!found.contains(&[0, 0, 0]) && !found.contains(&[2, 2, 2]));
    }

    #[test]
    fn too_many_cells_are_thinned() {
        let mut local = LocalMap::boxed();
        local
            .occupied
            .iter_mut()
            .take(2000)
            .for_each(|row| *row = [u64::MAX; 2]);
        let found = cells(&map(&local));
        assert!(
            found.len() <= CELLS_MAX && found.len() > CELLS_MAX / 2,
            "{}",
            found.len()
        );
    }
}
