//! The hits of a sensor over some time, thinned out evenly.

use jink_shared_types::ranges::{PointCloud, RayKind};
use nalgebra::Point3;
use std::collections::BTreeMap;

/// Edge of the cubes in which points are thinned out (m).
const CUBE_M: f64 = 0.15;
/// Points kept in a cube. A depth camera's noise at three metres is that of centimetres: ten of its points leave half a degree.
const PER_CUBE: usize = 80;
/// Points kept of a sensor at most.
const KEPT: usize = 800_000;
/// What is farther away (m) is sparse, and bent by errors of angle.
const FAR_M: f64 = 40.0;

/// Points in the body frame, as the configured mounting has them.
#[derive(Clone, Debug, Default)]
pub struct Points {
    cubes: BTreeMap<[i32; 3], Vec<Point3<f64>>>,
    len: usize,
    origin: Point3<f64>,
}

impl Points {
    /// Adds the hits of `cloud` that are farther than `own_m` from the vehicle's centre; numbers that are none are left out.
    pub fn add(&mut self, cloud: &PointCloud, own_m: f64) {
        let origin = Point3::from(cloud.origin.vector());
        if !origin.iter().all(|part| part.is_finite()) {
            return;
        }
        self.origin = origin;
        for point in cloud.points() {
            if point.kind.get() == RayKind::Hit {
                let parts = [point.forward_m, point.right_m, point.down_m];
                self.push(Point3::from(parts.map(f64::from)), own_m);
            }
        }
    }

    fn push(&mut self, point: Point3<f64>, own_m: f64) {
        let distance_m = (point - self.origin).norm();
        // False for NaN and for the infinite.
        let is_usable = distance_m <= FAR_M && point.coords.norm() > own_m;
        if !is_usable || self.len >= KEPT {
            return;
        }
        let cube = self.cubes.entry(cube_of(&point, CUBE_M)).or_default();
        if cube.len() < PER_CUBE {
            cube.push(point);
            self.len += 1;
        }
    }

    /// Where the sensor sits, as configured (body, m).
    pub fn origin(&self) -> Point3<f64> {
        self.origin
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &Point3<f64>> {
        self.cubes.values().flatten()
    }
}

/// The cube with edge `edge_m` that holds `point`.
pub(super) fn cube_of(point: &Point3<f64>, edge_m: f64) -> [i32; 3] {
    [point.x, point.y, point.z].map(|part| (part / edge_m).floor() as i32)
}
