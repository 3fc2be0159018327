//! Obstacles and what can be asked of them: a world is built once from a kind and a seed and never changes.
//!
//! | in | out |
//! |---|---|
//! | kind, seed | [`World`]: obstacles, start, goals, flight height, bounds |
//! | a point | distance to the nearest obstacle, height above ground |
//! | a ray | the first surface it meets |
//! | - | the world as JSON |
//!
//! All answers are exact (closed forms over cylinders, boxes, spheres and flat ground at down = 0; cells and triangles of
//! structures), so that a collision is a fact. Rays are sped up by a grid that is walked cell by cell.

mod benchmark;
mod cells;
pub mod file;
mod generate;
mod grid;
mod octomap;
mod solids;
mod spec;
mod stl;
mod structure;
mod way;

#[cfg(test)]
mod tests;

pub use solids::{Contact, Cylinder, Obstacle, Sphere, YawedBox};
pub use spec::{Benchmark, DEFAULT_DENSITY_PER_M2, MAX_DENSITY_PER_M2, WorldError, WorldKind, WorldSpec};
pub use structure::{Placement, Structure};

use crate::random::Random;
use grid::Grid;
use jink_shared_types::{LocalNed, Point};
use nalgebra::Vector3;
use serde::Serialize;
use serde_json::{Value, json};

/// Random stream of sun and colours; those of the kinds of world are smaller.
const LIGHT_PURPOSE: u64 = 100;

/// Suggested flight height above ground (m).
pub const FLIGHT_HEIGHT_M: f64 = 2.5;

/// The box that start, goals and every way between them lie in. Nothing keeps a vehicle inside.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bounds {
    /// Southern edge (m).
    pub north_min_m: f64,
    /// Northern edge (m).
    pub north_max_m: f64,
    /// Western edge (m).
    pub east_min_m: f64,
    /// Eastern edge (m).
    pub east_max_m: f64,
    /// Upper edge above ground (m).
    pub up_max_m: f64,
}

/// What a world is made of; sizes are finite and positive.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Name, as in the JSON.
    pub name: String,
    /// Seed it was made from.
    pub seed: u64,
    /// Suggested goals, in order of flight.
    pub goals: Vec<Point<LocalNed>>,
    /// Bounds.
    pub bounds: Bounds,
    /// Suggested flight height above ground (m).
    pub flight_height_m: f64,
    /// Obstacles.
    pub obstacles: Vec<Obstacle>,
    /// What has no formula.
    pub structures: Vec<Structure>,
}

impl Scene {
    /// Obstacles in the open, which reaches 50 m to all sides; no goal, seed 0.
    pub fn of(name: &str, obstacles: Vec<Obstacle>) -> Self {
        const REACH_M: f64 = 50.0;
        Self {
            name: name.to_owned(),
            seed: 0,
            goals: Vec::new(),
            bounds: Bounds {
                north_min_m: -REACH_M,
                north_max_m: REACH_M,
                east_min_m: -REACH_M,
                east_max_m: REACH_M,
                up_max_m: REACH_M,
            },
            flight_height_m: FLIGHT_HEIGHT_M,
            obstacles,
            structures: Vec::new(),
        }
    }
}

/// What a ray met.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// The ground.
    Ground,
    /// An obstacle: index into [`World::obstacles`].
    Obstacle(usize),
    /// A structure, by its number.
    Structure(usize),
}

/// Where a ray ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the ray (m); 0 if it starts inside an obstacle.
    pub range_m: f64,
    /// Cosine of the angle between ray and surface normal, 0 (grazing) to 1 (head-on).
    pub incidence_cos: f64,
    /// What was met.
    pub what: Target,
}

/// Obstacles on flat ground.
#[derive(Clone, Debug)]
pub struct World {
    scene: Scene,
    grid: Grid,
    top_m: f64,
    discarded: u32,
    sun: Vector3<f64>,
    /// Reflectivity of each obstacle.
    paint: Vec<f64>,
}

impl World {
    /// The world of a scene. The start is always the local origin, on the ground.
    pub fn new(scene: Scene) -> Self {
        let mut light = Random::new(scene.seed, LIGHT_PURPOSE);
        let azimuth_rad = light.between(0.0, std::f64::consts::TAU);
        let (sin, cos) = light.between(15.0, 60.0_f64).to_radians().sin_cos();
        let mut paint = || match light.unit() {
            dark if dark < 0.1 => 0.05,
            _ => light.between(0.15, 0.8),
        };
        Self {
            sun: Vector3::new(cos * azimuth_rad.cos(), cos * azimuth_rad.sin(), -sin),
            paint: scene.obstacles.iter().map(|_| paint()).collect(),
            grid: Grid::new(&scene.obstacles),
            top_m: scene.obstacles.iter().fold(0.0, |top, o| o.top_m().max(top)),
            scene,
            discarded: 0,
        }
    }

    /// The world of `kind` and `seed`; the same two give the same world to the bit.
    ///
    /// # Errors
    /// [`WorldError::DensityOutOfRange`], [`WorldError::NoWayThrough`] for a forest too dense to be passable, or [`WorldError::File`].
    pub fn generate(kind: WorldKind, seed: u64) -> Result<Self, WorldError> {
        generate::generate(kind, seed)
    }

    /// The world a user asked for.
    ///
    /// # Errors
    /// As [`World::generate`], and [`WorldError::DensityWithoutTrees`].
    pub fn from_spec(spec: &WorldSpec) -> Result<Self, WorldError> {
        Self::generate(spec.resolved_kind()?, spec.seed)
    }

    /// Name of its kind.
    pub fn name(&self) -> &str {
        &self.scene.name
    }

    /// The seed it was made from.
    pub fn seed(&self) -> u64 {
        self.scene.seed
    }

    /// Where the vehicle stands at first: the local origin.
    pub fn start(&self) -> Point<LocalNed> {
        Point::ZERO
    }

    /// Suggested goals in order of flight, at flight height.
    pub fn goals(&self) -> &[Point<LocalNed>] {
        &self.scene.goals
    }

    /// Suggested flight height above ground (m).
    pub fn flight_height_m(&self) -> f64 {
        self.scene.flight_height_m
    }

    /// The box the flight belongs in.
    pub fn bounds(&self) -> &Bounds {
        &self.scene.bounds
    }

    /// All obstacles with a formula; the ground is none of them.
    pub fn obstacles(&self) -> &[Obstacle] {
        &self.scene.obstacles
    }

    /// What stands there and has no formula.
    pub fn structures(&self) -> &[Structure] {
        &self.scene.structures
    }

    /// Forests drawn before this one that had no way through.
    pub fn discarded_maps(&self) -> u32 {
        self.discarded
    }

    /// Signed distance from `point` to the nearest obstacle's surface (m): negative inside, infinity without
    /// obstacles. The ground does not count.
    pub fn clearance_to_obstacles_m(&self, point: Point<LocalNed>) -> f64 {
        let point = point.vector();
        let solids = self.scene.obstacles.iter().map(|o| o.distance_m(&point));
        let structures = self.scene.structures.iter().map(|s| s.distance_m(&point));
        solids.chain(structures).fold(f64::INFINITY, f64::min)
    }

    /// Height of `point` above ground (m), negative below.
    pub fn height_above_ground_m(&self, point: Point<LocalNed>) -> f64 {
        -point.z_m
    }

    /// Direction of the sun (local NED, unit), which its seed draws: 15 to 60 degrees high.
    pub fn sun(&self) -> Vector3<f64> {
        self.sun
    }

    /// Share of the light that a surface throws back, as sensors count it: one solid in ten is as dark as tyres, the others lie between
    /// earth and fresh paint.
    pub fn reflectivity(&self, what: Target) -> f64 {
        match what {
            Target::Ground => 0.2,
            Target::Structure(_) => 0.5,
            Target::Obstacle(index) => self.paint.get(index).copied().unwrap_or(1.0),
        }
    }

    /// A short way at flight height from the start through all goals, as corners, that keeps about `clearance_m`
    /// from every obstacle (exactly so at the centres of grid cells of 0.25 m) and stays in the bounds; `None` if
    /// there is none.
    ///
    /// Its length bounds the shortest such way from above, usually within a few per cent. For scoring, not for
    /// flight.
    pub fn way(&self, clearance_m: f64) -> Option<Vec<Point<LocalNed>>> {
        way::way(self, clearance_m)
    }

    /// The first surface within `max_range_m` along the unit vector `direction` (local NED).
    ///
    /// A ray that starts inside an obstacle, or goes down from below the ground, ends at range 0.
    pub fn cast(&self, origin: Point<LocalNed>, direction: &Vector3<f64>, max_range_m: f64) -> Option<Hit> {
        self.cast_ignoring(origin, direction, max_range_m, None)
    }

    /// As [`World::cast`], as if the obstacle of index `ignored` were not there.
    pub fn cast_ignoring(
        &self,
        origin: Point<LocalNed>,
        direction: &Vector3<f64>,
        max_range_m: f64,
        ignored: Option<usize>,
    ) -> Option<Hit> {
        let origin = origin.vector();
        let (up, climb) = (-origin.z, -direction.z);
        let ground = (climb < 0.0)
            .then(|| Hit {
                range_m: (up / -climb).max(0.0),
                incidence_cos: -climb,
                what: Target::Ground,
            })
            .filter(|hit| hit.range_m <= max_range_m);

        let mut nearest = ground;
        let mut limit_m = ground.map_or(max_range_m, |hit| hit.range_m);
        for (index, structure) in self.scene.structures.iter().enumerate() {
            if let Some(contact) = structure.meets(&origin, direction, limit_m) {
                limit_m = contact.range_m;
                nearest = Some(Hit {
                    range_m: contact.range_m,
                    incidence_cos: contact.incidence_cos,
                    what: Target::Structure(index),
                });
            }
        }
        // Nothing stands above the highest top: that part of the ray needs no walking.
        let (from_m, to_m) = match (up > self.top_m, climb) {
            (true, 0.0..) => return nearest,
            (true, _) => ((self.top_m - up) / climb, limit_m),
            (false, _) if climb > 0.0 => (0.0, limit_m.min((self.top_m - up) / climb)),
            (false, _) => (0.0, limit_m),
        };
        self.grid.walk(&origin, direction, from_m, to_m, |items, exit_m| {
            for item in items {
                let index = item.obstacle as usize;
                if !item.may_meet(&origin, direction) || Some(index) == ignored {
                    continue;
                }
                if let Some(contact) = self.scene.obstacles[index].meets(&origin, direction)
                    && contact.range_m <= limit_m
                {
                    limit_m = contact.range_m;
                    nearest = Some(Hit {
                        range_m: contact.range_m,
                        incidence_cos: contact.incidence_cos,
                        what: Target::Obstacle(index),
                    });
                }
            }
            limit_m > exit_m
        });
        nearest
    }

    /// The world for drawing: name, seed, start, goals, bounds and all solids, heights up.
    pub fn json(&self) -> Value {
        let place = |p: &Point<LocalNed>| json!({"north_m": p.x_m, "east_m": p.y_m, "up_m": 0.0 - p.z_m});
        let (mut cylinders, mut boxes, mut spheres) = (Vec::new(), Vec::new(), Vec::new());
        for obstacle in &self.scene.obstacles {
            match obstacle {
                Obstacle::Cylinder(solid) => cylinders.push(solid),
                Obstacle::Box(solid) => boxes.push(solid),
                Obstacle::Sphere(solid) => spheres.push(solid),
            }
        }
        let outlines = self.scene.structures.iter();
        let outlines: Vec<YawedBox> = outlines
            .flat_map(|structure| structure.outline(self.scene.flight_height_m))
            .collect();
        boxes.extend(&outlines);
        json!({
            "world": self.scene.name,
            "seed": self.scene.seed,
            "start": place(&self.start()),
            "goals": self.scene.goals.iter().map(place).collect::<Vec<_>>(),
            "bounds": self.scene.bounds,
            "cylinders": cylinders,
            "boxes": boxes,
            "spheres": spheres,
        })
    }
}
