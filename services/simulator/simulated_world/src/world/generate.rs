//! The worlds themselves: what stands where, from a kind and a seed.
//!
//! The forest follows the one that A. Loquercio et al. ("Learning High-Speed Flight in the Wild", 2021) and Y. Ren
//! et al. ("Bubble Planner", 2022) measure in: a homogeneous Poisson process on 60 m by 30 m, a new seed each run.

use super::octomap::Octomap;
use super::solids::{Cylinder, Obstacle, YawedBox};
use super::spec::{MAX_DENSITY_PER_M2, WorldError, WorldKind};
use super::structure::{BUILDING, Placement, Structure};
use super::{Bounds, FLIGHT_HEIGHT_M, Scene, World, benchmark, file};
use crate::random::Random;
use jink_shared_types::{LocalNed, Point};
use std::f64::consts::{FRAC_PI_2, PI};

/// Height of trees and walls (m): well above the flight height, so that going over them is no short cut.
pub(super) const TALL_M: f64 = 6.0;

/// Thickness of a wall (m).
pub(super) const WALL_M: f64 = 0.3;

const FOREST_LENGTH_M: f64 = 60.0;
const FOREST_WIDTH_M: f64 = 30.0;
const TREE_RADIUS_M: [f64; 2] = [0.2, 0.4];

/// No part of a tree stands this near start or goal (m).
const CLEAR_DISC_M: f64 = 2.5;

/// A forest counts as passable if a way keeps this far from every trunk (m): the hull's radius and the margins that
/// a vehicle needs around it at speed.
const PASSABLE_M: f64 = 0.9;

/// Forests drawn before giving up. Of the densest ones offered half are passable, of those up to 1/12 all.
pub(super) const MAX_DRAWS: u32 = 100;

const GAP_WALL_NORTH_M: f64 = 15.0;
const GAP_WALL_LENGTH_M: f64 = 30.0;
const GAP_WIDTH_M: f64 = 2.0;
const GAP_OFFSET_M: f64 = 4.0;

const CORRIDOR_WIDTH_M: f64 = 4.0;
const CORRIDOR_NORTH_M: [f64; 2] = [5.0, 35.0];
/// Boxes stand this far apart on average (m), so that the way from one to the next is wider than the way past one.
const CORRIDOR_PITCH_M: f64 = 5.0;
/// Deepest box (m); leaves 2.2 m.
const CORRIDOR_BOX_DEPTH_M: [f64; 2] = [0.8, 1.8];

/// Where along the corridor of the building a flight begins and ends (m), on either side of a doorway of 0.8 m that is too narrow for the
/// vehicle; how far from its axis, and how high: below the lamps, above the tables.
const BUILDING_ENDS_M: [[[f64; 2]; 2]; 2] = [[[-5.2, -4.6], [8.0, 9.0]], [[13.0, 14.0], [24.6, 25.9]]];
const BUILDING_ASIDE_M: f64 = 0.2;
const BUILDING_FLIGHT_HEIGHT_M: f64 = 1.1;
const BUILDING_HEIGHT_M: f64 = 2.7;
/// What of the file is floor, with the noise of its measurement (m): below the flat ground of the world.
const BUILDING_FLOOR_M: f64 = 0.1;

const TRAP_WIDTH_M: f64 = 8.0;
const TRAP_DEPTH_M: f64 = 6.0;
/// How far the trap's axis may lie beside the straight line (m): the line still ends inside it.
const TRAP_OFFSET_M: f64 = 2.0;

/// Builds the world of `kind` and `seed`.
pub(super) fn generate(kind: WorldKind, seed: u64) -> Result<World, WorldError> {
    let mut random = Random::new(seed, purpose(&kind));
    let (goal_north_m, half_width_m, obstacles) = match &kind {
        WorldKind::Forest { density_per_m2 } => {
            return forest(*density_per_m2, seed, &mut random, PASSABLE_M, MAX_DRAWS);
        }
        WorldKind::Building => return building(seed, &mut random),
        WorldKind::File(file) => return file::read(file, seed),
        WorldKind::Benchmark(kind) => return benchmark::generate(*kind, seed),
        WorldKind::Gap => (30.0, 0.5 * GAP_WALL_LENGTH_M, gap(&mut random)),
        WorldKind::Corridor => (40.0, 5.0, corridor(&mut random)),
        WorldKind::UTrap => (30.0, 15.0, u_trap(&mut random)),
        WorldKind::Empty => (30.0, 15.0, Vec::new()),
    };
    Ok(World::new(Scene {
        name: kind.name().to_owned(),
        seed,
        goals: vec![at_flight_height(goal_north_m)],
        bounds: bounds(goal_north_m, half_width_m),
        flight_height_m: FLIGHT_HEIGHT_M,
        obstacles,
        structures: Vec::new(),
    }))
}

/// Along one half of the corridor, one way or the other, from and to places that the seed draws.
fn building(seed: u64, random: &mut Random) -> Result<World, WorldError> {
    let aside_m = |random: &mut Random| random.between(-BUILDING_ASIDE_M, BUILDING_ASIDE_M);
    let [from, to] = BUILDING_ENDS_M[usize::from(random.unit() < 0.5)];
    let ends = [from, to].map(|[low_m, high_m]| [random.between(low_m, high_m), aside_m(random)]);
    let is_back = random.unit() < 0.5;
    let ([x, y], [to_x, to_y], yaw_rad) = match is_back {
        false => (ends[0], ends[1], 0.0),
        true => (ends[1], ends[0], PI),
    };
    let (sin, cos) = yaw_rad.sin_cos();
    // x of the file points along the way, y to its left.
    let local = |x: f64, y: f64| [x * cos + y * sin, x * sin - y * cos];
    let [start_north_m, start_east_m] = local(x, y);
    let [north_m, east_m] = local(to_x - x, to_y - y);
    let place = Placement {
        north_m: -start_north_m,
        east_m: -start_east_m,
        up_m: -BUILDING_FLOOR_M,
        yaw_rad,
    };
    Ok(World::new(Scene {
        name: WorldKind::Building.name().to_owned(),
        seed,
        goals: vec![Point::new(north_m, east_m, -BUILDING_FLIGHT_HEIGHT_M)],
        bounds: Bounds {
            up_max_m: BUILDING_HEIGHT_M,
            ..bounds(north_m, 8.0)
        },
        flight_height_m: BUILDING_FLIGHT_HEIGHT_M,
        obstacles: Vec::new(),
        structures: vec![Structure::cells(Octomap::parse("building", BUILDING)?, place)],
    }))
}

/// Keeps the random streams of the kinds apart.
fn purpose(kind: &WorldKind) -> u64 {
    match kind {
        WorldKind::Forest { .. } => 1,
        WorldKind::Gap => 2,
        WorldKind::Corridor => 3,
        WorldKind::UTrap => 4,
        WorldKind::Empty => 5,
        WorldKind::Building => 6,
        WorldKind::File(_) => 7,
        WorldKind::Benchmark(_) => 8,
    }
}

fn at_flight_height(north_m: f64) -> Point<LocalNed> {
    Point::new(north_m, 0.0, -FLIGHT_HEIGHT_M)
}

/// From behind the start to behind the goal.
fn bounds(goal_north_m: f64, half_width_m: f64) -> Bounds {
    Bounds {
        north_min_m: -CLEAR_DISC_M,
        north_max_m: goal_north_m + CLEAR_DISC_M,
        east_min_m: -half_width_m,
        east_max_m: half_width_m,
        up_max_m: TALL_M,
    }
}

/// A forest that a disc of radius `passable_m` (m) can pass: of those that are drawn the first one.
pub(super) fn forest(
    density_per_m2: f64,
    seed: u64,
    random: &mut Random,
    passable_m: f64,
    max_draws: u32,
) -> Result<World, WorldError> {
    let offered = density_per_m2 > 0.0 && density_per_m2 <= MAX_DENSITY_PER_M2;
    if !offered {
        return Err(WorldError::DensityOutOfRange { density_per_m2 });
    }
    for discarded in 0..max_draws {
        let mut world = draw_forest(density_per_m2, seed, random);
        if world.way(passable_m).is_some() {
            world.discarded = discarded;
            return Ok(world);
        }
    }
    Err(WorldError::NoWayThrough {
        density_per_m2,
        draws: max_draws,
    })
}

/// One forest, passable or not.
fn draw_forest(density_per_m2: f64, seed: u64, random: &mut Random) -> World {
    let trees = random.poisson(density_per_m2 * FOREST_LENGTH_M * FOREST_WIDTH_M);
    let mut obstacles = Vec::with_capacity(trees as usize);
    for _ in 0..trees {
        let tree = Cylinder {
            north_m: random.between(0.0, FOREST_LENGTH_M),
            east_m: random.between(-0.5 * FOREST_WIDTH_M, 0.5 * FOREST_WIDTH_M),
            radius_m: random.between(TREE_RADIUS_M[0], TREE_RADIUS_M[1]),
            top_m: TALL_M,
        };
        let keep_away_m = CLEAR_DISC_M + tree.radius_m;
        let intrudes = [0.0, FOREST_LENGTH_M]
            .iter()
            .any(|end_m| (tree.north_m - end_m).hypot(tree.east_m) < keep_away_m);
        if !intrudes {
            obstacles.push(Obstacle::Cylinder(tree));
        }
    }
    World::new(Scene {
        flight_height_m: FLIGHT_HEIGHT_M,
        structures: Vec::new(),
        name: "forest".to_owned(),
        seed,
        goals: vec![at_flight_height(FOREST_LENGTH_M)],
        bounds: bounds(FOREST_LENGTH_M, 0.5 * FOREST_WIDTH_M),
        obstacles,
    })
}

/// A wall of `length_m` along `yaw_rad` (0 north, pi/2 east).
fn wall(north_m: f64, east_m: f64, length_m: f64, yaw_rad: f64) -> Obstacle {
    Obstacle::Box(YawedBox::new(north_m, east_m, length_m, WALL_M, yaw_rad, TALL_M))
}

fn gap(random: &mut Random) -> Vec<Obstacle> {
    let offset_m = random.between(-GAP_OFFSET_M, GAP_OFFSET_M);
    let half_m = 0.5 * GAP_WALL_LENGTH_M;
    [
        (-half_m, offset_m - 0.5 * GAP_WIDTH_M),
        (offset_m + 0.5 * GAP_WIDTH_M, half_m),
    ]
    .into_iter()
    .map(|(west_m, east_m)| {
        wall(
            GAP_WALL_NORTH_M,
            0.5 * (west_m + east_m),
            east_m - west_m,
            FRAC_PI_2,
        )
    })
    .collect()
}

fn corridor(random: &mut Random) -> Vec<Obstacle> {
    let [from_m, to_m] = CORRIDOR_NORTH_M;
    let half_m = 0.5 * CORRIDOR_WIDTH_M;
    let mut obstacles: Vec<_> = [-1.0, 1.0]
        .iter()
        .map(|side| {
            wall(
                0.5 * (from_m + to_m),
                side * (half_m + 0.5 * WALL_M),
                to_m - from_m,
                0.0,
            )
        })
        .collect();
    let mut side = if random.unit() < 0.5 { -1.0 } else { 1.0 };
    let boxes = ((to_m - from_m) / CORRIDOR_PITCH_M) as u32 - 1;
    for index in 1..=boxes {
        let north_m = from_m + CORRIDOR_PITCH_M * f64::from(index) + random.between(-0.4, 0.4);
        let length_m = random.between(0.6, 1.2);
        let depth_m = random.between(CORRIDOR_BOX_DEPTH_M[0], CORRIDOR_BOX_DEPTH_M[1]);
        let east_m = side * (half_m - 0.5 * depth_m);
        obstacles.push(Obstacle::Box(YawedBox::new(
            north_m, east_m, length_m, depth_m, 0.0, TALL_M,
        )));
        side = -side;
    }
    obstacles
}

fn u_trap(random: &mut Random) -> Vec<Obstacle> {
    let axis_m = random.between(-TRAP_OFFSET_M, TRAP_OFFSET_M);
    let mouth_m = random.between(10.0, 14.0);
    let outer_m = TRAP_WIDTH_M + 2.0 * WALL_M;
    let arm = |side: f64| {
        let east_m = axis_m + side * 0.5 * (TRAP_WIDTH_M + WALL_M);
        wall(mouth_m + 0.5 * TRAP_DEPTH_M, east_m, TRAP_DEPTH_M, 0.0)
    };
    vec![
        arm(-1.0),
        arm(1.0),
        wall(mouth_m + TRAP_DEPTH_M + 0.5 * WALL_M, axis_m, outer_m, FRAC_PI_2),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::VecDeque;

    /// Breadth-first search on a finer grid, straight from the distance field.
    fn is_passable(world: &World, clearance_m: f64, cell_m: f64) -> bool {
        let bounds = world.bounds();
        let rows = ((bounds.north_max_m - bounds.north_min_m) / cell_m) as i64;
        let columns = ((bounds.east_max_m - bounds.east_min_m) / cell_m) as i64;
        let cell = |p: &Point<LocalNed>| {
            (
                ((p.x_m - bounds.north_min_m) / cell_m) as i64,
                ((p.y_m - bounds.east_min_m) / cell_m) as i64,
            )
        };
        let mut seen = vec![false; (rows * columns) as usize];
        let (start, goal) = (cell(&world.start()), cell(&world.goals()[0]));
        let mut queue = VecDeque::from([start]);
        while let Some((row, column)) = queue.pop_front() {
            if (row, column) == goal {
                return true;
            }
            for (r, c) in [
                (row + 1, column),
                (row - 1, column),
                (row, column + 1),
                (row, column - 1),
            ] {
                if r < 0 || c < 0 || r >= rows || c >= columns || seen[(r * columns + c) as usize] {
                    continue;
                }
                seen[(r * columns + c) as usize] = true;
                let at = Point::new(
                    bounds.north_min_m + (r as f64 + 0.5) * cell_m,
                    bounds.east_min_m + (c as f64 + 0.5) * cell_m,
                    -FLIGHT_HEIGHT_M,
                );
                if world.clearance_to_obstacles_m(at) >= clearance_m {
                    queue.push_back((r, c));
                }
            }
        }
        false
    }

    #[test]
    fn discarded_forests_are_really_blocked() {
        // Any way with half a cell's diagonal more clearance would have shown up on the grid; half a step of the
        // finer grid makes its centres stand for all that lies between them.
        let fine_m = 0.125;
        let unseen_m = super::super::way::CELL_M * std::f64::consts::FRAC_1_SQRT_2 + 0.5 * fine_m;
        let mut blocked = 0;
        for seed in 0..16 {
            let world = draw_forest(MAX_DENSITY_PER_M2, seed, &mut Random::new(seed, 77));
            if world.way(PASSABLE_M).is_none() {
                blocked += 1;
                assert!(!is_passable(&world, PASSABLE_M + unseen_m, fine_m), "seed {seed}");
            } else {
                assert!(is_passable(&world, PASSABLE_M - unseen_m, fine_m), "seed {seed}");
            }
        }
        assert!(blocked > 2 && blocked < 14, "{blocked} of 16 blocked");
    }

    #[test]
    fn discards_are_counted_and_redrawn_from_the_same_stream() {
        let density_per_m2 = MAX_DENSITY_PER_M2;
        let mut discarded = 0;
        for seed in 0..8 {
            let world = generate(WorldKind::Forest { density_per_m2 }, seed).unwrap();
            discarded += world.discarded_maps();
            let mut random = Random::new(seed, 1);
            if world.discarded_maps() > 0 {
                let error = forest(density_per_m2, seed, &mut random.clone(), PASSABLE_M, 1).unwrap_err();
                assert_eq!(
                    error,
                    WorldError::NoWayThrough {
                        density_per_m2,
                        draws: 1
                    }
                );
            }
            for _ in 0..world.discarded_maps() {
                assert!(
                    draw_forest(density_per_m2, seed, &mut random)
                        .way(PASSABLE_M)
                        .is_none()
                );
            }
            let kept = draw_forest(density_per_m2, seed, &mut random);
            assert_eq!(kept.obstacles(), world.obstacles());
        }
        assert!(discarded > 0);
    }
}
