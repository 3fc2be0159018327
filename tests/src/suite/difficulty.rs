//! How hard a world is, in the metrics of FlightBench (H. Yu et al., 2024): for a vehicle of 0.15 m that sees 4 m.

use jink_shared_types::{LocalNed, Point};
use jink_simulated_world::world::World;
use nalgebra::{Rotation3, Unit, Vector3};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

const RADIUS_M: f64 = 0.15;
const RANGE_M: f64 = 4.0;
/// The way that is judged keeps this far from everything (m).
const WAY_CLEARANCE_M: f64 = 0.35;
/// Corridors of spheres that are laid along the way.
const CORRIDORS: u32 = 8;
/// Where along the way one looks ahead (m).
const LOOK_EVERY_M: f64 = 0.4;
/// Rings about the direction of the way: widest angle (deg) and weight, the outermost first.
const RINGS: [(f64, f64); 4] = [(36.0, 0.05), (30.0, 0.1), (22.5, 0.3), (15.0, 0.55)];
/// Rays per ring.
const RAYS: u32 = 16;

/// How hard a world is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Difficulty {
    /// Traversability obstruction: 1 where every other sphere of the corridor is as large as the sensing range, more in
    /// narrow places.
    pub traversability: f64,
    /// View obstruction: 1 where something stands at the sensing range in every ring ahead, 0 where nothing is in sight.
    pub view: f64,
    /// Angle over length (1/m): how much the shortest way turns.
    pub turning: f64,
    /// Length of the shortest way of a disc of 0.35 m (m).
    pub way_m: f64,
}

impl Difficulty {
    /// Of a world; `None` where that disc has no way at flight height.
    pub fn of(world: &World) -> Option<Self> {
        let way: Vec<Vector3<f64>> = world
            .way(WAY_CLEARANCE_M)?
            .iter()
            .map(|corner| corner.vector())
            .collect();
        let way_m = length_m(&way);
        Some(Self {
            traversability: traversability(world, &way, way_m),
            view: view(world, &way, way_m),
            turning: turning(&way, way_m),
            way_m,
        })
    }
}

fn length_m(way: &[Vector3<f64>]) -> f64 {
    way.windows(2).map(|leg| (leg[1] - leg[0]).norm()).sum()
}

/// The point after `along_m` of the way, and the direction there.
fn at(way: &[Vector3<f64>], along_m: f64) -> Option<(Vector3<f64>, Unit<Vector3<f64>>)> {
    let mut left_m = along_m;
    for leg in way.windows(2) {
        let step = leg[1] - leg[0];
        let length_m = step.norm();
        if left_m <= length_m && length_m > 0.0 {
            return Some((leg[0] + step * (left_m / length_m), Unit::new_normalize(step)));
        }
        left_m -= length_m;
    }
    None
}

/// A corridor of spheres, each as large as its place allows, its successor on its surface: of the smaller half of the radii
/// `RANGE / (2 N) sum 1/r`; the least of corridors that start at different places.
fn traversability(world: &World, way: &[Vector3<f64>], way_m: f64) -> f64 {
    let of_corridor = |number: u32| {
        let mut along_m = f64::from(number) * RANGE_M / f64::from(CORRIDORS);
        let mut radii_m = Vec::new();
        while along_m < way_m
            && let Some((place, _)) = at(way, along_m)
        {
            let room_m = world.clearance_to_obstacles_m(Point::<LocalNed>::from_vector(place)) - RADIUS_M;
            let radius_m = room_m.clamp(0.05, RANGE_M);
            radii_m.push(radius_m);
            along_m += radius_m;
        }
        radii_m.sort_by(f64::total_cmp);
        radii_m.truncate(radii_m.len().div_ceil(2));
        let count = radii_m.len().max(1) as f64;
        RANGE_M / (2.0 * count) * radii_m.iter().map(|radius_m| 1.0 / radius_m).sum::<f64>()
    };
    (0..CORRIDORS).map(of_corridor).fold(f64::INFINITY, f64::min)
}

/// `weight * RANGE / nearest` of every ring in which something is in range, on average along the way.
fn view(world: &World, way: &[Vector3<f64>], way_m: f64) -> f64 {
    let looks = (way_m / LOOK_EVERY_M) as u32;
    let look = |number: u32| {
        let Some((place, ahead)) = at(way, LOOK_EVERY_M * f64::from(number)) else {
            return 0.0;
        };
        let seen = RINGS.iter().enumerate().map(|(ring, (outer_deg, weight))| {
            let inner_deg = RINGS.get(ring + 1).map_or(0.0, |(inner_deg, _)| *inner_deg);
            let angle_rad = (0.5 * (outer_deg + inner_deg)).to_radians();
            let nearest_m = (0..RAYS)
                .filter_map(|ray| {
                    range_m(
                        world,
                        place,
                        ahead,
                        angle_rad,
                        TAU * f64::from(ray) / f64::from(RAYS),
                    )
                })
                .fold(f64::INFINITY, f64::min);
            weight * RANGE_M / nearest_m.max(RADIUS_M)
        });
        seen.sum()
    };
    (0..looks).map(look).sum::<f64>() / f64::from(looks.max(1))
}

/// The range (m) along a ray that is turned from `ahead` by `angle_rad`, to the side that `around_rad` says; the ground is
/// no obstacle.
fn range_m(
    world: &World,
    place: Vector3<f64>,
    ahead: Unit<Vector3<f64>>,
    angle_rad: f64,
    around_rad: f64,
) -> Option<f64> {
    let side = Unit::try_new(ahead.cross(&Vector3::z()), 1e-6)?;
    let tilted = Rotation3::from_axis_angle(&side, angle_rad) * ahead.into_inner();
    let ray = Rotation3::from_axis_angle(&ahead, around_rad) * tilted;
    let hit = world.cast(Point::from_vector(place), &ray, RANGE_M)?;
    (hit.what != jink_simulated_world::world::Target::Ground).then_some(hit.range_m)
}

/// `sum (exp(2 theta / pi) - 1) / length` over the corners.
fn turning(way: &[Vector3<f64>], way_m: f64) -> f64 {
    let corners = way.windows(3).map(|corner| {
        let angle_rad = (corner[1] - corner[0]).angle(&(corner[2] - corner[1]));
        (2.0 * angle_rad / PI).exp() - 1.0
    });
    corners.sum::<f64>() / way_m.max(1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;
    use jink_simulated_world::world::{Benchmark, WorldKind};

    fn mean(kind: Benchmark) -> Difficulty {
        let each = (0..8).filter_map(|seed| {
            let world = World::generate(WorldKind::Benchmark(kind), seed).unwrap();
            Difficulty::of(&world)
        });
        let all: Vec<_> = each.collect();
        let mean = |of: fn(&Difficulty) -> f64| all.iter().map(of).sum::<f64>() / all.len() as f64;
        Difficulty {
            traversability: mean(|d| d.traversability),
            view: mean(|d| d.view),
            turning: mean(|d| d.turning),
            way_m: mean(|d| d.way_m),
        }
    }

    #[test]
    fn denser_is_harder_and_a_maze_is_hardest() {
        let of_forest = |density_per_m2| mean(Benchmark::Forest { density_per_m2 });
        let [sparse, dense] = [1.0 / 49.0, 1.0 / 12.0].map(of_forest);
        let maze = mean(Benchmark::Maze);
        println!(
            "1/49 {sparse:?}\n1/25 {:?}\n1/12 {dense:?}\nmaze {maze:?}",
            of_forest(1.0 / 25.0)
        );
        for metric in [
            |d: &Difficulty| d.traversability,
            |d: &Difficulty| d.view,
            |d: &Difficulty| d.turning,
        ] {
            assert!(metric(&sparse) < metric(&dense) && metric(&dense) < metric(&maze));
        }
    }
}
