//! Worlds in which planners are compared: as close to the published ones as their texts are exact.
//!
//! The forest is that of [`super::generate`], discarded where a disc of 0.35 m has no way through (A. Loquercio et al.,
//! "Learning High-Speed Flight in the Wild", 2021; Y. Ren et al., "Bubble Planner", 2022). Trap and bugtrap follow J.
//! Tordesillas et al., "FASTER", 2021, the maze of H. Yu et al., "FlightBench", 2024, is divided recursively. Nothing of
//! them is a copy: say "matched", and state the metrics of difficulty beside a result.

use super::generate::{MAX_DRAWS, TALL_M, WALL_M, forest};
use super::solids::{Cylinder, Obstacle, YawedBox};
use super::spec::{Benchmark, WorldError};
use super::{Bounds, FLIGHT_HEIGHT_M, Scene, World};
use crate::random::Random;
use jink_shared_types::Point;
use std::f64::consts::FRAC_PI_2;

/// The random stream of a benchmark world, apart from those of the other kinds.
const STREAM: u64 = 20;

/// A world counts as passable if a disc of this radius has a way (m): half a metre wide, and a tenth on every side.
const PASSABLE_M: f64 = 0.35;

/// Walls of a world without a way around reach this far to both sides (m).
const WIDE_M: f64 = 30.0;
const GATE_NORTH_M: f64 = 15.0;
const GATE_OFFSET_M: f64 = 4.0;
const GATE_GOAL_M: f64 = 30.0;
const SLOT_HEIGHT_M: f64 = 1.2;

const TRAP_WIDTH_M: [f64; 2] = [6.0, 10.0];
const TRAP_MOUTH_M: [f64; 2] = [8.0, 12.0];
const TRAP_OFFSET_M: f64 = 2.0;
const TRAP_GOAL_BEHIND_M: f64 = 12.0;
const BUGTRAP_M: f64 = 12.0;

const MAZE_CELLS: usize = 10;
const MAZE_CELL_M: f64 = 2.0;
const MAZE_WALL_M: f64 = 0.2;

const OFFICE_LENGTH_M: f64 = 40.0;
const OFFICE_WIDTH_M: f64 = 20.0;
const OFFICE_ROOM_M: [f64; 2] = [4.0, 6.0];
const OFFICE_DOOR_M: f64 = 0.9;
const OFFICE_WALL_M: f64 = 0.15;
const OFFICE_CEILING_M: f64 = 3.0;
const OFFICE_FLIGHT_HEIGHT_M: f64 = 1.5;
/// No door is nearer than this to the end of its wall (m).
const DOOR_FROM_END_M: f64 = 0.3;

const CORNER_WIDTH_M: f64 = 4.0;
const CORNER_LEG_M: f64 = 20.0;
/// The start lies this far within the corridor (m).
const CORNER_START_M: f64 = 2.0;

const GLADE_LENGTH_M: f64 = 40.0;
const GLADE_WIDTH_M: f64 = 20.0;
const GLADE_DENSITY_PER_M2: f64 = 1.0 / 36.0;
const GLADE_CLEAR_M: f64 = 2.5;

/// What a world is made of before it has a name and a seed.
struct Plan {
    goal: [f64; 2],
    bounds: Bounds,
    flight_height_m: f64,
    obstacles: Vec<Obstacle>,
}

/// Builds the world of `kind` and `seed`.
pub(super) fn generate(kind: Benchmark, seed: u64) -> Result<World, WorldError> {
    let mut random = Random::new(seed, STREAM);
    for discarded in 0..MAX_DRAWS {
        let plan = match kind {
            Benchmark::Forest { density_per_m2 } => {
                return forest(density_per_m2, seed, &mut random, PASSABLE_M, MAX_DRAWS);
            }
            Benchmark::Glade => glade(&mut random),
            Benchmark::Trap { depth_m } => trap(depth_m, &mut random),
            Benchmark::Maze => maze(&mut random),
            Benchmark::Bugtrap => bugtrap(&mut random),
            Benchmark::Office => office(&mut random),
            Benchmark::Gap { width_m } => gap(width_m, &mut random),
            Benchmark::Slot => slot(&mut random),
            Benchmark::Corner => corner(&mut random),
        };
        let mut world = World::new(Scene {
            name: kind.name().to_owned(),
            seed,
            goals: vec![Point::new(plan.goal[0], plan.goal[1], -plan.flight_height_m)],
            bounds: plan.bounds,
            flight_height_m: plan.flight_height_m,
            obstacles: plan.obstacles,
            structures: Vec::new(),
        });
        world.discarded = discarded;
        // A slot is passed at another height than that of the flight, and a gap may be narrower than the disc.
        let is_checked = !matches!(kind, Benchmark::Slot | Benchmark::Gap { .. });
        if !is_checked || world.way(PASSABLE_M).is_some() {
            return Ok(world);
        }
    }
    Err(WorldError::Closed {
        kind: kind.name().to_owned(),
        draws: MAX_DRAWS,
    })
}

/// A rectangle from south-west to north-east.
fn bounds([north_min_m, north_max_m]: [f64; 2], [east_min_m, east_max_m]: [f64; 2]) -> Bounds {
    Bounds {
        north_min_m,
        north_max_m,
        east_min_m,
        east_max_m,
        up_max_m: TALL_M,
    }
}

/// A wall from one place to another (north, east in m), along one of the axes.
fn wall([n0, e0]: [f64; 2], [n1, e1]: [f64; 2], thick_m: f64, top_m: f64) -> Obstacle {
    let (north_m, east_m) = (0.5 * (n0 + n1), 0.5 * (e0 + e1));
    let is_north = (n1 - n0).abs() > (e1 - e0).abs();
    let length_m = (n1 - n0).abs().max((e1 - e0).abs());
    let yaw_rad = if is_north { 0.0 } else { FRAC_PI_2 };
    Obstacle::Box(YawedBox::new(north_m, east_m, length_m, thick_m, yaw_rad, top_m))
}

fn trap(depth_m: f64, random: &mut Random) -> Plan {
    let axis_m = random.between(-TRAP_OFFSET_M, TRAP_OFFSET_M);
    let mouth_m = random.between(TRAP_MOUTH_M[0], TRAP_MOUTH_M[1]);
    let width_m = random.between(TRAP_WIDTH_M[0], TRAP_WIDTH_M[1]);
    u(mouth_m, depth_m, axis_m, width_m)
}

/// A trap whose arms turn in at the mouth by a quarter of its width each.
fn bugtrap(random: &mut Random) -> Plan {
    let axis_m = random.between(-TRAP_OFFSET_M, TRAP_OFFSET_M);
    let mouth_m = random.between(TRAP_MOUTH_M[0], TRAP_MOUTH_M[1]);
    let mut plan = u(mouth_m, BUGTRAP_M, axis_m, BUGTRAP_M);
    for side in [-1.0, 1.0] {
        let arm_m = axis_m + side * 0.5 * BUGTRAP_M;
        let tip_m = arm_m - side * 0.25 * BUGTRAP_M;
        plan.obstacles
            .push(wall([mouth_m, arm_m], [mouth_m, tip_m], WALL_M, TALL_M));
    }
    plan
}

/// A U across the way, open towards the start.
fn u(mouth_m: f64, depth_m: f64, axis_m: f64, width_m: f64) -> Plan {
    let (end_m, goal_m) = (mouth_m + depth_m, mouth_m + depth_m + TRAP_GOAL_BEHIND_M);
    let [west_m, east_m] = [axis_m - 0.5 * width_m, axis_m + 0.5 * width_m];
    let thick = |from: [f64; 2], to: [f64; 2]| wall(from, to, WALL_M, TALL_M);
    Plan {
        goal: [goal_m, 0.0],
        bounds: bounds([-5.0, goal_m + 5.0], [-20.0, 20.0]),
        flight_height_m: FLIGHT_HEIGHT_M,
        obstacles: vec![
            thick([mouth_m, west_m], [end_m, west_m]),
            thick([mouth_m, east_m], [end_m, east_m]),
            thick([end_m, west_m - 0.5 * WALL_M], [end_m, east_m + 0.5 * WALL_M]),
        ],
    }
}

/// Recursive division: a chamber is cut across its longer side by a wall with one opening of a cell, then its two parts.
fn maze(random: &mut Random) -> Plan {
    let side_m = MAZE_CELLS as f64 * MAZE_CELL_M;
    // The start is the middle of the first cell.
    let at_m = |line: usize| (line as f64 - 0.5) * MAZE_CELL_M;
    let thin = |from: [f64; 2], to: [f64; 2]| wall(from, to, MAZE_WALL_M, TALL_M);
    let (low_m, high_m) = (at_m(0), at_m(MAZE_CELLS));
    let mut obstacles = vec![
        thin([low_m, low_m], [high_m, low_m]),
        thin([low_m, high_m], [high_m, high_m]),
        thin([low_m, low_m], [low_m, high_m]),
        thin([high_m, low_m], [high_m, high_m]),
    ];
    // First and last line north, first and last line east.
    let mut chambers = vec![[0, MAZE_CELLS, 0, MAZE_CELLS]];
    let mut below = |count: usize| ((random.unit() * count as f64) as usize).min(count - 1);
    while let Some([n0, n1, e0, e1]) = chambers.pop() {
        let (rows, columns) = (n1 - n0, e1 - e0);
        if rows < 2 || columns < 2 {
            continue;
        }
        let across = rows > columns || rows == columns && below(2) == 0;
        let (first, last, from, to) = if across {
            (n0, n1, e0, e1)
        } else {
            (e0, e1, n0, n1)
        };
        let line = first + 1 + below(last - first - 1);
        let open = from + below(to - from);
        for (begin, end) in [(from, open), (open + 1, to)] {
            if begin < end {
                let (fixed_m, begin_m, end_m) = (at_m(line), at_m(begin), at_m(end));
                obstacles.push(if across {
                    thin([fixed_m, begin_m], [fixed_m, end_m])
                } else {
                    thin([begin_m, fixed_m], [end_m, fixed_m])
                });
            }
        }
        if across {
            chambers.extend([[n0, line, e0, e1], [line, n1, e0, e1]]);
        } else {
            chambers.extend([[n0, n1, e0, line], [n0, n1, line, e1]]);
        }
    }
    let goal_m = side_m - MAZE_CELL_M;
    Plan {
        goal: [goal_m, goal_m],
        bounds: bounds([low_m, high_m], [low_m, high_m]),
        flight_height_m: FLIGHT_HEIGHT_M,
        obstacles,
    }
}

/// Lines that cut `length_m` into rooms.
fn room_lines(length_m: f64, random: &mut Random) -> Vec<f64> {
    let mut lines = vec![0.0];
    let mut at_m = 0.0;
    while length_m - at_m >= 2.0 * OFFICE_ROOM_M[0] {
        let most_m = OFFICE_ROOM_M[1].min(length_m - at_m - OFFICE_ROOM_M[0]);
        at_m += random.between(OFFICE_ROOM_M[0], most_m.max(OFFICE_ROOM_M[0]));
        lines.push(at_m);
    }
    lines.push(length_m);
    lines
}

/// Rows of rooms one behind the other; every wall between two rooms has a door, or one in four none.
fn office(random: &mut Random) -> Plan {
    let rows = room_lines(OFFICE_LENGTH_M, random);
    let start_m = 0.5 * rows[1];
    let west_m = -0.5 * OFFICE_WIDTH_M;
    let thin = |from: [f64; 2], to: [f64; 2]| wall(from, to, OFFICE_WALL_M, OFFICE_CEILING_M);
    let (south_m, north_m) = (-start_m, OFFICE_LENGTH_M - start_m);
    let mut obstacles = vec![
        thin([south_m, west_m], [north_m, west_m]),
        thin([south_m, -west_m], [north_m, -west_m]),
        thin([south_m, west_m], [south_m, -west_m]),
        thin([north_m, west_m], [north_m, -west_m]),
    ];
    let mut with_door = |from_m: f64, to_m: f64, random: &mut Random, place: &dyn Fn(f64) -> [f64; 2]| {
        if random.unit() < 0.25 {
            obstacles.push(thin(place(from_m), place(to_m)));
            return;
        }
        let door_m = random.between(from_m + DOOR_FROM_END_M, to_m - DOOR_FROM_END_M - OFFICE_DOOR_M);
        obstacles.push(thin(place(from_m), place(door_m)));
        obstacles.push(thin(place(door_m + OFFICE_DOOR_M), place(to_m)));
    };
    let mut goal_east_m = 0.0;
    for (row, pair) in rows.windows(2).enumerate() {
        let [low_m, high_m] = [pair[0] - start_m, pair[1] - start_m];
        let columns: Vec<f64> = room_lines(OFFICE_WIDTH_M, random)
            .iter()
            .map(|at_m| at_m + west_m)
            .collect();
        for east_m in &columns[1..columns.len() - 1] {
            // Not through the start.
            let east_m = if row == 0 && east_m.abs() < 1.0 {
                1.0_f64.copysign(*east_m)
            } else {
                *east_m
            };
            with_door(low_m, high_m, random, &|at_m| [at_m, east_m]);
        }
        if row + 2 < rows.len() {
            for room in columns.windows(2) {
                with_door(room[0], room[1], random, &|at_m| [high_m, at_m]);
            }
        } else {
            let room = (random.unit() * (columns.len() - 1) as f64) as usize;
            goal_east_m = 0.5 * (columns[room] + columns[room + 1]);
        }
    }
    let last = rows.len() - 1;
    let ceiling = YawedBox::new(
        0.5 * (south_m + north_m),
        0.0,
        OFFICE_LENGTH_M,
        OFFICE_WIDTH_M,
        0.0,
        OFFICE_CEILING_M + WALL_M,
    );
    obstacles.push(Obstacle::Box(ceiling.raised(OFFICE_CEILING_M)));
    Plan {
        goal: [0.5 * (rows[last - 1] + rows[last]) - start_m, goal_east_m],
        bounds: Bounds {
            up_max_m: OFFICE_CEILING_M,
            ..bounds([south_m, north_m], [west_m, -west_m])
        },
        flight_height_m: OFFICE_FLIGHT_HEIGHT_M,
        obstacles,
    }
}

fn gap(width_m: f64, random: &mut Random) -> Plan {
    let offset_m = random.between(-GATE_OFFSET_M, GATE_OFFSET_M);
    let [west_m, east_m] = [offset_m - 0.5 * width_m, offset_m + 0.5 * width_m];
    Plan {
        obstacles: vec![
            wall(
                [GATE_NORTH_M, -WIDE_M],
                [GATE_NORTH_M, west_m],
                WALL_M,
                2.0 * TALL_M,
            ),
            wall(
                [GATE_NORTH_M, east_m],
                [GATE_NORTH_M, WIDE_M],
                WALL_M,
                2.0 * TALL_M,
            ),
        ],
        ..gate()
    }
}

fn slot(random: &mut Random) -> Plan {
    let middle_m = random.between(1.8, 3.5);
    let across = |top_m: f64| YawedBox::new(GATE_NORTH_M, 0.0, 2.0 * WIDE_M, WALL_M, FRAC_PI_2, top_m);
    Plan {
        obstacles: vec![
            Obstacle::Box(across(middle_m - 0.5 * SLOT_HEIGHT_M)),
            Obstacle::Box(across(2.0 * TALL_M).raised(middle_m + 0.5 * SLOT_HEIGHT_M)),
        ],
        ..gate()
    }
}

/// From the start to a goal straight behind a wall.
fn gate() -> Plan {
    Plan {
        goal: [GATE_GOAL_M, 0.0],
        bounds: bounds([-5.0, GATE_GOAL_M + 5.0], [-WIDE_M, WIDE_M]),
        flight_height_m: FLIGHT_HEIGHT_M,
        obstacles: Vec::new(),
    }
}

/// North along a corridor, then east along another; the box stands at the inner wall, where the turn is cut.
fn corner(random: &mut Random) -> Plan {
    let half_m = 0.5 * CORNER_WIDTH_M;
    // Inner corner: of the eastern wall of the first corridor and the southern one of the second.
    let (inner_north_m, inner_east_m) = (CORNER_LEG_M - half_m, half_m);
    let (outer_north_m, outer_east_m) = (CORNER_LEG_M + half_m, -half_m);
    let goal_east_m = CORNER_LEG_M;
    let end_m = goal_east_m + CORNER_START_M;
    let edge_m = random.between(0.8, 1.4);
    let behind_m = random.between(0.3, 1.5);
    let hidden = YawedBox::new(
        inner_north_m + 0.5 * (edge_m + WALL_M),
        inner_east_m + behind_m + 0.5 * edge_m,
        edge_m,
        edge_m,
        0.0,
        TALL_M,
    );
    let thick = |from: [f64; 2], to: [f64; 2]| wall(from, to, WALL_M, TALL_M);
    Plan {
        goal: [CORNER_LEG_M, goal_east_m],
        bounds: bounds([-CORNER_START_M, outer_north_m], [outer_east_m, end_m]),
        flight_height_m: FLIGHT_HEIGHT_M,
        obstacles: vec![
            thick([-CORNER_START_M, outer_east_m], [outer_north_m, outer_east_m]),
            thick([-CORNER_START_M, inner_east_m], [inner_north_m, inner_east_m]),
            thick([inner_north_m, inner_east_m], [inner_north_m, end_m]),
            thick([outer_north_m, outer_east_m], [outer_north_m, end_m]),
            thick([-CORNER_START_M, outer_east_m], [-CORNER_START_M, inner_east_m]),
            thick([inner_north_m, end_m], [outer_north_m, end_m]),
            Obstacle::Box(hidden),
        ],
    }
}

fn glade(random: &mut Random) -> Plan {
    let trees = random.poisson(GLADE_DENSITY_PER_M2 * GLADE_LENGTH_M * GLADE_WIDTH_M);
    let half_m = 0.5 * GLADE_WIDTH_M;
    let mut obstacles = Vec::new();
    for _ in 0..trees {
        let tree = Cylinder {
            north_m: random.between(0.0, GLADE_LENGTH_M),
            east_m: random.between(-half_m, half_m),
            radius_m: random.between(0.2, 0.4),
            top_m: TALL_M,
        };
        let away_m = |north_m: f64| (tree.north_m - north_m).hypot(tree.east_m) - tree.radius_m;
        if away_m(0.0).min(away_m(GLADE_LENGTH_M)) > GLADE_CLEAR_M {
            obstacles.push(Obstacle::Cylinder(tree));
        }
    }
    Plan {
        goal: [GLADE_LENGTH_M, 0.0],
        bounds: bounds([-5.0, GLADE_LENGTH_M + 5.0], [-half_m, half_m]),
        flight_height_m: FLIGHT_HEIGHT_M,
        obstacles,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::WorldKind;

    const ALL: [Benchmark; 10] = [
        Benchmark::Forest {
            density_per_m2: 1.0 / 12.0,
        },
        Benchmark::Trap { depth_m: 4.0 },
        Benchmark::Trap { depth_m: 20.0 },
        Benchmark::Maze,
        Benchmark::Bugtrap,
        Benchmark::Office,
        Benchmark::Gap { width_m: 0.8 },
        Benchmark::Slot,
        Benchmark::Corner,
        Benchmark::Glade,
    ];

    fn world(kind: Benchmark, seed: u64) -> World {
        World::generate(WorldKind::Benchmark(kind), seed).unwrap()
    }

    #[test]
    fn start_and_goal_are_free_the_same_seed_gives_the_same_world_and_another_another() {
        for kind in ALL {
            for seed in 0..30 {
                let one = world(kind, seed);
                assert_eq!(one.obstacles(), world(kind, seed).obstacles());
                assert_ne!(one.obstacles(), world(kind, seed + 100).obstacles());
                let above_start = Point::new(0.0, 0.0, -one.flight_height_m());
                for place in [above_start, one.goals()[0]] {
                    let clearance_m = one.clearance_to_obstacles_m(place);
                    assert!(
                        clearance_m > 0.7,
                        "{} {seed}: {clearance_m} at {place:?}",
                        kind.name()
                    );
                }
            }
        }
    }

    #[test]
    fn every_world_with_a_way_at_flight_height_has_one_for_the_disc() {
        for kind in ALL {
            let is_checked = !matches!(kind, Benchmark::Slot | Benchmark::Gap { .. });
            for seed in (0..20).filter(|_| is_checked) {
                let way = world(kind, seed).way(PASSABLE_M);
                assert!(way.is_some(), "{} {seed}", kind.name());
            }
        }
    }

    /// The length of the shortest way at flight height.
    fn way_m(world: &World) -> f64 {
        let way = world.way(PASSABLE_M).unwrap();
        way.windows(2)
            .map(|pair| (pair[1].vector() - pair[0].vector()).norm())
            .sum()
    }

    #[test]
    fn traps_hold_and_mazes_wind() {
        for seed in 0..10 {
            let deep = world(Benchmark::Trap { depth_m: 12.0 }, seed);
            let straight_m = deep.goals()[0].x_m;
            let middle = deep.cast(Point::new(0.0, 0.0, -2.5), &nalgebra::Vector3::x(), 100.0);
            assert!(middle.unwrap().range_m > 19.0, "the straight line ends in it");
            assert!(way_m(&deep) > straight_m + 0.5);
            let maze = world(Benchmark::Maze, seed);
            assert!(way_m(&maze) > 1.1 * maze.goals()[0].vector().xy().norm());
        }
    }

    #[test]
    fn a_gap_is_as_wide_as_it_says_and_there_is_no_other_way() {
        for seed in 0..10 {
            let gap = world(Benchmark::Gap { width_m: 0.8 }, seed);
            let (mut open_m, step_m) = (0.0, 0.01);
            let mut east_m = -WIDE_M + 0.5 * step_m;
            while east_m < WIDE_M {
                let from = Point::new(10.0, east_m, -2.5);
                if gap.cast(from, &nalgebra::Vector3::x(), 10.0).is_none() {
                    open_m += step_m;
                }
                east_m += step_m;
            }
            assert!((open_m - 0.8_f64).abs() < 0.03, "{open_m}");
            assert_eq!(gap.way(0.45), None, "closed to a larger disc");
        }
    }

    #[test]
    fn a_slot_is_open_at_one_height_only() {
        for seed in 0..10 {
            let slot = world(Benchmark::Slot, seed);
            let is_open = |up_m: f64| {
                let from = Point::new(10.0, 0.0, -up_m);
                slot.cast(from, &nalgebra::Vector3::x(), 10.0).is_none()
            };
            let open: Vec<f64> = (0..600)
                .map(|step| 0.01 + 0.01 * f64::from(step))
                .filter(|up_m| is_open(*up_m))
                .collect();
            let height_m = open.last().unwrap() - open[0];
            assert!((height_m - SLOT_HEIGHT_M).abs() < 0.03, "{height_m}");
        }
    }

    #[test]
    fn what_stands_behind_the_corner_is_not_seen_from_the_start() {
        for seed in 0..20 {
            let corner = world(Benchmark::Corner, seed);
            let [n0, n1, e0, e1] = corner.obstacles().last().unwrap().footprint_m();
            let start = Point::new(0.0, 0.0, -2.5);
            let middle: Point<jink_shared_types::LocalNed> =
                Point::new(0.5 * (n0 + n1), 0.5 * (e0 + e1), -2.5);
            let way = middle.vector() - start.vector();
            let hit = corner.cast(start, &way.normalize(), 100.0).unwrap();
            assert!(hit.range_m < way.norm() - 1.0, "a wall is before it");
        }
    }
}
