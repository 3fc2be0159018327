//! A small analytic world and a lidar in it, for tests and the benchmark.
//!
//! Every surface is given by a signed distance, positive outside, so that "how deep inside an obstacle" and "how far
//! from any surface" are exact, and a ray ends where the distance is zero.
#![allow(dead_code, reason = "each test uses a part of it")]

use jink_shared_types::frames::{AngularRate, Attitude, Point, Velocity};
use jink_shared_types::map::{Cell, LocalMap, SIZE_X, SIZE_Y, SIZE_Z, row_of, test};
use jink_shared_types::ranges::{CloudPoint, PointCloud, RayKind};
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{Flag, Reserved, SampleHeader, Timestamp};
use nalgebra::{UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::SplitMix64;

/// One obstacle, local NED.
#[derive(Clone, Copy, Debug)]
pub enum WorldShape {
    /// An upright post without ends: centre north and east, radius (m).
    Post {
        north_m: f64,
        east_m: f64,
        radius_m: f64,
    },
    /// A sphere: centre, radius (m).
    Sphere { center_m: Vector3<f64>, radius_m: f64 },
    /// An axis-parallel box: centre, half edges (m).
    Block {
        center_m: Vector3<f64>,
        half_m: Vector3<f64>,
    },
    /// Everything below this down coordinate (m).
    Ground { down_m: f64 },
}

impl WorldShape {
    /// Distance from the surface (m), negative inside. For a block's outside a lower bound is enough, and this is exact.
    pub fn distance_m(&self, p: &Vector3<f64>) -> f64 {
        match *self {
            WorldShape::Post {
                north_m,
                east_m,
                radius_m,
            } => (p.x - north_m).hypot(p.y - east_m) - radius_m,
            WorldShape::Sphere { center_m, radius_m } => (p - center_m).norm() - radius_m,
            WorldShape::Block { center_m, half_m } => {
                let outside = (p - center_m).abs() - half_m;
                outside.map(|c| c.max(0.0)).norm() + outside.max().min(0.0)
            }
            WorldShape::Ground { down_m } => down_m - p.z,
        }
    }

    /// Where the ray from `from` (outside) along unit vector `along` enters, if it does (m).
    fn entry_m(&self, from: &Vector3<f64>, along: &Vector3<f64>) -> Option<f64> {
        match *self {
            WorldShape::Post {
                north_m,
                east_m,
                radius_m,
            } => {
                let (offset_x, offset_y) = (from.x - north_m, from.y - east_m);
                let a = along.x * along.x + along.y * along.y;
                let b = offset_x * along.x + offset_y * along.y;
                let c = offset_x * offset_x + offset_y * offset_y - radius_m * radius_m;
                first_root(a, b, c)
            }
            WorldShape::Sphere { center_m, radius_m } => {
                let offset = from - center_m;
                first_root(
                    1.0,
                    offset.dot(along),
                    offset.norm_squared() - radius_m * radius_m,
                )
            }
            WorldShape::Block { center_m, half_m } => {
                let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
                for axis in 0..3 {
                    let offset = from[axis] - center_m[axis];
                    let near = (-offset - half_m[axis].copysign(along[axis])) / along[axis];
                    let far = (-offset + half_m[axis].copysign(along[axis])) / along[axis];
                    enter = enter.max(near);
                    leave = leave.min(far);
                }
                (enter < leave).then_some(enter)
            }
            WorldShape::Ground { down_m } => (along.z > 0.0).then(|| (down_m - from.z) / along.z),
        }
    }
}

fn first_root(a: f64, b: f64, c: f64) -> Option<f64> {
    let discriminant = b * b - a * c;
    (discriminant >= 0.0 && a > 0.0)
        .then(|| (-b - discriminant.sqrt()) / a)
        .filter(|root| *root > 0.0)
}

/// Distance from the nearest surface (m), negative inside an obstacle.
pub fn distance_m(world: &[WorldShape], point_m: &Vector3<f64>) -> f64 {
    world
        .iter()
        .map(|shape| shape.distance_m(point_m))
        .fold(f64::INFINITY, f64::min)
}

/// Range of the first surface from `from` along the unit vector `along` (m); infinity if there is none.
pub fn cast_m(world: &[WorldShape], from: &Vector3<f64>, along: &Vector3<f64>) -> f64 {
    world
        .iter()
        .filter_map(|shape| shape.entry_m(from, along))
        .fold(f64::INFINITY, f64::min)
}

/// Where and how the vehicle is at one moment.
#[derive(Clone, Copy, Debug)]
pub struct VehicleMotion {
    /// Position in local NED (m).
    pub position_m: Vector3<f64>,
    /// Velocity in local NED (m/s).
    pub velocity_mps: Vector3<f64>,
    /// `local_q_body`.
    pub attitude: UnitQuaternion<f64>,
    /// Body rates (rad/s).
    pub rates_radps: Vector3<f64>,
}

impl VehicleMotion {
    /// At rest at `position_m`, level, heading north.
    pub fn still(position_m: Vector3<f64>) -> Self {
        Self {
            position_m,
            velocity_mps: Vector3::zeros(),
            attitude: UnitQuaternion::identity(),
            rates_radps: Vector3::zeros(),
        }
    }

    /// As the gateway would report it.
    pub fn state(&self) -> VehicleState {
        VehicleState {
            position: Point::from_vector(self.position_m),
            velocity: Velocity::from_vector(self.velocity_mps),
            attitude: Attitude::from_rotation(self.attitude),
            rates: AngularRate::from_vector(self.rates_radps),
            position_valid: Flag::YES,
            autopilot_alive: Flag::YES,
            ..VehicleState::default()
        }
    }
}

/// A header captured at `t_s`.
pub fn header(t_s: f64) -> SampleHeader {
    SampleHeader::at(at(t_s))
}

/// The moment `t_s` seconds into the test; tests do not start when the clock did.
pub fn at(t_s: f64) -> Timestamp {
    Timestamp::from_seconds(1_000.0 + t_s)
}

/// A lidar without noise.
#[derive(Clone, Copy, Debug)]
pub struct Lidar {
    /// Position in the body (m).
    pub origin_body_m: Vector3<f64>,
    /// Longest range (m).
    pub range_max_m: f64,
    /// Lowest and highest elevation (rad), positive up.
    pub elevation_rad: (f64, f64),
    /// Rays of a sweep.
    pub rays: usize,
    /// Rings that the rays lie on; 0: everywhere.
    pub rings: usize,
    /// Duration of a sweep (s).
    pub sweep_s: f64,
}

impl Default for Lidar {
    fn default() -> Self {
        Self {
            origin_body_m: Vector3::new(0.05, 0.0, -0.1),
            range_max_m: 40.0,
            elevation_rad: (-0.9, 0.9),
            rays: 20_000,
            rings: 0,
            sweep_s: 0.0,
        }
    }
}

impl Lidar {
    /// Direction of ray `ray` in the body. The azimuth turns 20 times a sweep; without rings, elevations fill by the golden ratio, and
    /// `sweep` shifts them, so that no two sweeps see the same (as rosette lidars do).
    fn along_body(&self, ray: usize, sweep: usize) -> Vector3<f64> {
        const GOLDEN: f64 = 0.618_033_988_749_894_9;
        let (turns, shift) = if self.rings > 0 { (1.0, 0.0) } else { (20.0, 0.013) };
        let azimuth = (ray as f64 / self.rays as f64 * turns + sweep as f64 * shift) * std::f64::consts::TAU;
        let fill = match self.rings {
            0 => (ray as f64 * GOLDEN + sweep as f64 * 0.287).fract(),
            rings => ((ray % rings) as f64 + 0.5) / rings as f64,
        };
        let (low, high) = self.elevation_rad;
        let elevation = low + (high - low) * fill;
        let (sin, cos) = elevation.sin_cos();
        Vector3::new(cos * azimuth.cos(), cos * azimuth.sin(), -sin)
    }

    /// Sweep number `sweep`, ending at `end_s`, of a vehicle that moves as `motion` says (time in seconds).
    pub fn sweep(
        &self,
        world: &[WorldShape],
        motion: impl Fn(f64) -> VehicleMotion,
        end_s: f64,
        sweep: usize,
        cloud: &mut PointCloud,
    ) {
        let start_s = end_s - self.sweep_s;
        cloud.origin = Point::from_vector(self.origin_body_m);
        cloud.first_point = at(start_s);
        cloud.range_min_m = 0.1;
        cloud.range_max_m = self.range_max_m as f32;
        cloud.len = 0;
        for ray in 0..self.rays {
            let offset_10us = (ray as f64 / self.rays as f64 * self.sweep_s * 1e5) as u16;
            let pose = motion(start_s + f64::from(offset_10us) * 1e-5);
            let along_body = self.along_body(ray, sweep);
            let origin_m = pose.position_m + pose.attitude * self.origin_body_m;
            let range_m = cast_m(world, &origin_m, &(pose.attitude * along_body));
            let hit = range_m <= self.range_max_m;
            let end = self.origin_body_m + along_body * range_m.min(self.range_max_m);
            let kind = if hit { RayKind::Hit } else { RayKind::Clear };
            assert!(cloud.push(CloudPoint {
                forward_m: end.x as f32,
                right_m: end.y as f32,
                down_m: end.z as f32,
                offset_10us,
                kind: kind.into(),
                reserved: Reserved::ZERO,
            }));
        }
    }
}

/// Every cell of the window of `map`.
pub fn cells(map: &LocalMap) -> impl Iterator<Item = Cell> + '_ {
    let [x, y, z] = map.min_cell;
    (z..z + SIZE_Z as i32).flat_map(move |z| {
        (y..y + SIZE_Y as i32).flat_map(move |y| (x..x + SIZE_X as i32).map(move |x| [x, y, z]))
    })
}

/// The known cells of `map`: those that say anything.
pub fn known(map: &LocalMap) -> impl Iterator<Item = Cell> + '_ {
    let [x, y, z] = map.min_cell;
    let rows = (z..z + SIZE_Z as i32).flat_map(move |z| (y..y + SIZE_Y as i32).map(move |y| (y, z)));
    rows.filter(|(y, z)| map.known[row_of([0, *y, *z])] != [0, 0])
        .flat_map(move |(y, z)| (x..x + SIZE_X as i32).map(move |x| [x, y, z]))
        .filter(|cell| test(&map.known, *cell))
}

/// Posts on a square of `edge_m` around the origin, one per 25 m2, none within 1.5 m of the north axis, on level ground
/// at down 0.
pub fn forest(edge_m: f64, seed: u64) -> Vec<WorldShape> {
    let mut random = SplitMix64::seed_from_u64(seed);
    let mut world = vec![WorldShape::Ground { down_m: 0.0 }];
    for _ in 0..(edge_m * edge_m / 25.0) as usize {
        let north_m = random.random_range(-0.5 * edge_m..0.5 * edge_m);
        let east_m = random.random_range(-0.5 * edge_m..0.5 * edge_m);
        let radius_m = random.random_range(0.1..0.4);
        if east_m.abs() > 1.5 + radius_m {
            world.push(WorldShape::Post {
                north_m,
                east_m,
                radius_m,
            });
        }
    }
    world
}
