//! A depth image that is ready to be published, before its points are written into shared memory.
//!
//! | a block of pixels has | its point |
//! |---|---|
//! | a depth whose range along the ray is within `range_max_m` | a hit at the nearest of its depths; below `range_min_m`, too: readers know what that means |
//! | only depths beyond that, in half of its pixels at least | clear: nothing up to `range_max_m`, along the ray of the nearest |
//! | only depths beyond that, in fewer pixels | unknown |
//! | no depth | unknown |
//!
//! A point lies on the ray of the very pixel that was measured, not in the middle of its block.

use crate::config::{DepthCameraSpec, SIZE_MAX_PX};
use jink_shared_types::ranges::{CloudPoint, PointCloud, RayKind};
use jink_shared_types::{Reserved, Timestamp};
use nalgebra::{Matrix3, Vector3};

/// A depth image without its flying pixels.
#[derive(Clone, Copy, Debug)]
pub struct CloudView<'a> {
    /// The camera.
    pub spec: &'a DepthCameraSpec,
    /// When it was taken.
    pub capture: Timestamp,
    /// Depths row by row (units of `depth_scale_m`), 0 = unknown. Pixels that are missing are unknown.
    pub depths: &'a [u16],
}

impl CloudView<'_> {
    /// Writes the cloud where its readers will find it. Every field that counts is written.
    pub fn write(&self, cloud: &mut PointCloud) {
        let spec = self.spec;
        let [min_m, max_m] = spec.range_m;
        cloud.origin = spec.position;
        cloud.first_point = self.capture;
        cloud.range_min_m = min_m as f32;
        cloud.range_max_m = max_m as f32;
        cloud.range_sigma_m = (spec.sigma_per_m * max_m * max_m) as f32;
        cloud.reserved = Reserved::ZERO;
        let rotation = spec.mounting.rotation().unwrap_or_default();
        let rays = Rays {
            spec,
            body_r_sensor: rotation.to_rotation_matrix().into_inner().cast(),
            origin_m: spec.position.vector().cast(),
            scale_m: spec.depth_scale_m as f32,
            max_m: max_m as f32,
        };
        let bins = Bins::of(spec);
        let mut columns = Columns::default();
        let mut len = 0;
        for bin_row in 0..bins.rows {
            columns.read(self.depths, &bins, bin_row);
            for bin_column in 0..bins.columns {
                if let Some(point) = cloud.points.get_mut(len) {
                    *point = rays.point(&columns.block(self.depths, &bins, bin_row, bin_column));
                    len += 1;
                }
            }
        }
        cloud.len = len as u32;
    }
}

/// How the image is divided into blocks: all of one size, and what is left over on both sides.
struct Bins {
    width_px: usize,
    /// Edge of a block.
    bin_px: usize,
    columns: usize,
    rows: usize,
    /// Column and row at which the first block begins.
    begin: [usize; 2],
}

impl Bins {
    fn of(spec: &DepthCameraSpec) -> Self {
        let bin_px = usize::from(spec.bin_px);
        let [columns, rows] = spec.bins();
        let begin = |size_px: u16, bins: usize| usize::from(size_px).saturating_sub(bins * bin_px) / 2;
        Self {
            width_px: usize::from(spec.size_px[0]),
            bin_px,
            columns,
            rows,
            begin: [begin(spec.size_px[0], columns), begin(spec.size_px[1], rows)],
        }
    }

    /// The pixel at `row` and `column` within the block.
    fn pixel(&self, [bin_column, bin_row]: [usize; 2], column: usize, row: usize) -> usize {
        let row = self.begin[1] + bin_row * self.bin_px + row;
        row * self.width_px + self.begin[0] + bin_column * self.bin_px + column
    }
}

/// One row of blocks, column by column of their pixels: in loops that the compiler turns into several columns at a
/// time.
struct Columns {
    /// Least depth less one; the greatest number where there is none.
    nearest: [u16; SIZE_MAX_PX as usize],
    /// Pixels with a depth.
    measured: [u16; SIZE_MAX_PX as usize],
}

impl Default for Columns {
    fn default() -> Self {
        Self {
            nearest: [u16::MAX; SIZE_MAX_PX as usize],
            measured: [0; SIZE_MAX_PX as usize],
        }
    }
}

impl Columns {
    fn read(&mut self, depths: &[u16], bins: &Bins, bin_row: usize) {
        let used = bins.columns * bins.bin_px;
        self.nearest[..used].fill(u16::MAX);
        self.measured[..used].fill(0);
        for row in 0..bins.bin_px {
            let first = bins.pixel([0, bin_row], 0, row);
            let Some(depths) = depths.get(first..first + used) else {
                continue;
            };
            let columns = self.nearest.iter_mut().zip(&mut self.measured);
            for ((nearest, measured), depth) in columns.zip(depths) {
                *nearest = (*nearest).min(depth.wrapping_sub(1));
                *measured = measured.wrapping_add(u16::from(*depth != 0));
            }
        }
    }

    fn block(&self, depths: &[u16], bins: &Bins, bin_row: usize, bin_column: usize) -> Block {
        let of_block = bin_column * bins.bin_px..(bin_column + 1) * bins.bin_px;
        let nearest = &self.nearest[of_block.clone()];
        let least = nearest.iter().copied().min().unwrap_or(u16::MAX);
        if least == u16::MAX {
            return Block::default();
        }
        let column = nearest.iter().position(|depth| *depth == least).unwrap_or(0);
        let pixel = (0..bins.bin_px)
            .map(|row| bins.pixel([bin_column, bin_row], column, row))
            .find(|pixel| depths.get(*pixel) == Some(&(least + 1)));
        let measured = self.measured[of_block].iter().copied().map(usize::from);
        Block {
            nearest: least + 1,
            pixel: pixel.unwrap_or(0),
            measured: measured.sum(),
        }
    }
}

/// A block of pixels.
#[derive(Clone, Copy, Debug, Default)]
struct Block {
    /// Least depth, 0 = none.
    nearest: u16,
    /// The pixel that has it.
    pixel: usize,
    /// Pixels with a depth.
    measured: usize,
}

/// What turns depths into points, in the precision of points.
struct Rays<'a> {
    spec: &'a DepthCameraSpec,
    body_r_sensor: Matrix3<f32>,
    origin_m: Vector3<f32>,
    scale_m: f32,
    max_m: f32,
}

impl Rays<'_> {
    fn point(&self, block: &Block) -> CloudPoint {
        let unknown = CloudPoint::default();
        if block.nearest == 0 {
            return unknown;
        }
        let [right, down] = self.spec.projection.slopes(block.pixel);
        let ray = Vector3::new(1.0, right, down);
        let length = ray.norm();
        let depth_m = f32::from(block.nearest) * self.scale_m;
        let bin_px = usize::from(self.spec.bin_px);
        let (along_m, kind) = if depth_m * length <= self.max_m {
            (depth_m, RayKind::Hit)
        } else if 2 * block.measured >= bin_px * bin_px {
            (self.max_m / length, RayKind::Clear)
        } else {
            return unknown;
        };
        let end_m = self.origin_m + self.body_r_sensor * (ray * along_m);
        CloudPoint {
            forward_m: end_m.x,
            right_m: end_m.y,
            down_m: end_m.z,
            offset_10us: 0,
            kind: kind.into(),
            reserved: Reserved::ZERO,
        }
    }
}
