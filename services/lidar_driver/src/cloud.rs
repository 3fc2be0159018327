//! Rays of one scan become a point cloud in the body frame.
//!
//! | the sensor reports | becomes |
//! |---|---|
//! | a return within `range_max_m` | an obstacle at the point; below `range_min_m`, too: it is there, and nothing is free before it |
//! | a return beyond `range_max_m` | nothing up to there |
//! | no return | nothing known: no point. With `no_return = "clear"` nothing up to `range_max_m` |
//! | a blind sector | nothing known |
//!
//! Of several returns of one pulse `returns` selects those that count. A cloud holds [`CLOUD_POINTS`]: where a scan can
//! have more, of every two neighbouring columns the nearer answer of each row counts.

use crate::config::{CloudSpec, NoReturn, Returns};
use crate::decode::{OVERTAKEN_US, Ray};
use jink_shared_types::ranges::{CLOUD_POINTS, CloudPoint, PointCloud, RayKind};
use jink_shared_types::{Coded, Reserved, SampleHeader, Timestamp};
use nalgebra::{Matrix3, Vector3};

/// Points may come before the first one that was received, when packets overtake each other: by less than this (ns).
const EARLY_NS: u64 = OVERTAKEN_US.unsigned_abs() * 1_000;
/// Unit of the time offset of a point (ns).
const UNIT_NS: u64 = 10_000;
const EARLY_UNITS: u16 = (EARLY_NS / UNIT_NS) as u16;
/// Rows that are kept apart when neighbouring columns are merged.
const ROWS: usize = 256;

/// The last point of a row, while another answer of the same direction may come.
#[derive(Clone, Copy, Debug)]
struct CloudSlot {
    /// Column, or pair of columns.
    column: u32,
    /// Where it lies among the points.
    index: u32,
    /// The range of a hit; infinity of what is free.
    range_m: f32,
}

const NO_SLOT: CloudSlot = CloudSlot {
    column: u32::MAX,
    index: u32::MAX,
    range_m: f32::INFINITY,
};

/// Collects one cloud.
#[derive(Debug)]
pub struct CloudAssembler {
    spec: CloudSpec,
    body_r_sensor: Matrix3<f32>,
    origin_m: Vector3<f32>,
    /// Columns that count as one direction.
    merged_columns: u32,
    points: Vec<CloudPoint>,
    slots: Vec<CloudSlot>,
    /// Time from which offsets count while points are collected.
    base: Timestamp,
    newest: Timestamp,
    overflow: u64,
}

impl CloudAssembler {
    /// For a sensor whose scans have `directions`, each with so many returns; `None`: not known.
    pub fn new(spec: CloudSpec, directions: Option<(usize, u8)>) -> Self {
        // The sensor frame is x forward, y left, z up; the body's is forward, right, down.
        let frd = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
        let rotation = spec
            .mounting
            .rotation()
            .map_or_else(Matrix3::identity, |rotation| {
                *rotation.to_rotation_matrix().matrix()
            });
        let merges = directions.is_some_and(|(directions, returns)| {
            let counted = if spec.returns == Returns::Both {
                usize::from(returns)
            } else {
                1
            };
            directions * counted > CLOUD_POINTS
        });
        Self {
            body_r_sensor: (rotation * frd).cast(),
            origin_m: spec.position.vector().cast(),
            merged_columns: if merges { 2 } else { 1 },
            points: Vec::with_capacity(CLOUD_POINTS),
            slots: vec![NO_SLOT; ROWS],
            base: Timestamp::NEVER,
            newest: Timestamp::NEVER,
            overflow: 0,
            spec,
        }
    }

    /// Whether neighbouring columns are merged, because a scan can have more points than a cloud.
    pub fn merges(&self) -> bool {
        self.merged_columns > 1
    }

    /// Points that a cloud had no room for.
    pub fn overflow(&self) -> u64 {
        self.overflow
    }

    /// A packet of the scan was measured from `first` to `last`.
    pub fn packet(&mut self, first: Timestamp, last: Timestamp) {
        if !self.base.is_set() {
            self.base = Timestamp::from_ns(first.ns.saturating_sub(EARLY_NS).max(1));
        }
        self.newest = self.newest.max(last);
    }

    /// Takes a ray that was measured at `time`.
    pub fn ray(&mut self, time: Timestamp, ray: &Ray) {
        let counts = match self.spec.returns {
            Returns::Strongest => ray.echo.count == 1 || ray.echo.index == self.spec.strongest,
            // A missing second return adds nothing to the first one.
            Returns::Nearest | Returns::Both => ray.is_return() || ray.echo.index == 0,
        };
        if !counts {
            return;
        }
        let Some((point, kind, range_m)) = self.point(ray) else {
            return;
        };
        let body = self.body_r_sensor * point + self.origin_m;
        let offset = time.ns_since(self.base) / UNIT_NS;
        let point = CloudPoint {
            forward_m: body.x,
            right_m: body.y,
            down_m: body.z,
            offset_10us: u16::try_from(offset).unwrap_or(u16::MAX),
            kind: Coded::new(kind),
            reserved: Reserved::ZERO,
        };
        self.place(ray, point, range_m);
    }

    /// Whether nothing was measured. A scan in which nothing answered was, and has no points.
    pub fn is_empty(&self) -> bool {
        !self.base.is_set()
    }

    /// When the newest of the directions was measured.
    pub fn capture(&self) -> Timestamp {
        self.newest
    }

    /// The header of the cloud at hand.
    pub fn header(&self) -> SampleHeader {
        SampleHeader {
            capture: self.newest,
            ..SampleHeader::default()
        }
    }

    /// Writes the cloud where its readers will find it. Every field that counts is written.
    pub fn write(&self, cloud: &mut PointCloud) {
        let earliest = self
            .points
            .iter()
            .map(|point| point.offset_10us)
            .min()
            .unwrap_or(EARLY_UNITS);
        cloud.origin = self.spec.position;
        cloud.first_point = Timestamp::from_ns(self.base.ns + u64::from(earliest) * UNIT_NS);
        cloud.range_min_m = self.spec.range_min_m;
        cloud.range_max_m = self.spec.range_max_m;
        cloud.range_sigma_m = self.spec.sigma_m;
        cloud.reserved = Reserved::ZERO;
        cloud.len = self.points.len() as u32;
        for (to, from) in cloud.points.iter_mut().zip(&self.points) {
            *to = CloudPoint {
                offset_10us: from.offset_10us - earliest,
                ..*from
            };
        }
    }

    /// Begins the next cloud.
    pub fn clear(&mut self) {
        self.points.clear();
        self.slots.fill(NO_SLOT);
        self.base = Timestamp::NEVER;
        self.newest = Timestamp::NEVER;
    }

    /// The end of the ray (m, sensor frame), its meaning, and the range by which returns are compared.
    fn point(&self, ray: &Ray) -> Option<(Vector3<f32>, RayKind, f32)> {
        let max_m = self.spec.range_max_m;
        if self.spec.is_blind(ray.direction) {
            return None;
        }
        let end = Vector3::from(ray.at(ray.range_m));
        if ray.is_return() && end.norm() <= max_m {
            return Some((end, RayKind::Hit, ray.range_m));
        }
        if !ray.is_return() && self.spec.no_return == NoReturn::Unknown {
            return None;
        }
        // Less the way from the sensor's origin to the beam's: no point lies beyond the longest range.
        let clear_m = max_m - Vector3::from(ray.base_m).norm();
        Some((Vector3::from(ray.at(clear_m)), RayKind::Clear, f32::INFINITY))
    }

    /// Puts a point among the others, or in the place of a farther one of the same direction: what is free never stands
    /// beside an obstacle of the same direction.
    fn place(&mut self, ray: &Ray, point: CloudPoint, range_m: f32) {
        let column = ray.column / self.merged_columns;
        let merges = self.merges();
        let shares = merges || ray.echo.count > 1;
        if let Some(slot) = self.slots.get_mut(usize::from(ray.row)).filter(|_| shares) {
            if slot.column == column {
                let replaces = merges || self.spec.returns == Returns::Nearest || slot.range_m.is_infinite();
                if let Some(place) = self.points.get_mut(slot.index as usize).filter(|_| replaces) {
                    if range_m < slot.range_m {
                        *place = point;
                        slot.range_m = range_m;
                    }
                    return;
                }
                if range_m.is_infinite() {
                    return;
                }
            } else {
                *slot = CloudSlot {
                    column,
                    index: self.points.len() as u32,
                    range_m,
                };
            }
        }
        if self.points.len() < CLOUD_POINTS {
            self.points.push(point);
        } else {
            self.overflow += 1;
        }
    }
}
