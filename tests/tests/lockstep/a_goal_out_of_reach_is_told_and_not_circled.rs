//! A goal to which no way leads: the vehicle looks for one and says so all the time, with whatever it sees; then the goal counts as out
//! of reach, and the vehicle comes to rest, with the reason.

use jink_emulated_ground_station::Ending;
use jink_shared_types::Point;
use jink_shared_types::events::{Event, GOAL_BLOCKED, ITEM_BLOCKED, NO_PATH, WAY_SEARCHED};
use jink_simulated_world::random::Random;
use jink_simulated_world::world::{Benchmark, Cylinder, Obstacle, Scene, World, WorldKind, YawedBox};
use jink_tests::campaign::{Cell, sensor_set, setup};
use jink_tests::flights::Flights;
use jink_tests::lockstep::LockStep;
use jink_tests::pairing::{COPTER, PX4_CURRENT, PX4_TRAJECTORY};

const SENSORS: [&str; 4] = ["sphere", "mid360", "vlp16", "d435"];
/// Worlds of each kind.
const SEEDS: u64 = 1;
/// Height and thickness of walls (m); nothing may be flown that high.
const TALL_M: f64 = 14.0;
const THICK_M: f64 = 0.4;
const HEIGHT_MAX_M: f64 = 10.0;
/// Edge of the room around the goal of a maze (m), whose cells measure 2 m.
const MAZE_ROOM_M: f64 = 6.0;
/// Longest search for a way that is flown here, from the start of the mission (s).
const TOLD_WITHIN_S: f64 = 400.0;
/// Time to come to rest (s): in a maze it flew back for 27 s to where it had been nearest to the goal.
const RESTS_WITHIN_S: f64 = 40.0;
/// At rest it moves less than this (m) in as long as that (s).
const REST_M: f64 = 1.0;
const REST_S: f64 = 10.0;

/// What keeps the vehicle from its goal.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    /// Four walls around the goal, or around the start.
    Room,
    /// A maze whose last corner has no door.
    Maze,
    /// A box or a thick trunk that holds the goal.
    Hull,
    /// A wall on all sides of where the vehicle starts, with the goal right behind it.
    Yard,
}

const KINDS: [Kind; 4] = [Kind::Room, Kind::Maze, Kind::Hull, Kind::Yard];

/// Four walls; `size_m` is what lies between them along `yaw_rad` and across.
fn room(north_m: f64, east_m: f64, size_m: [f64; 2], yaw_rad: f64) -> [Obstacle; 4] {
    let (sin, cos) = yaw_rad.sin_cos();
    let [length_m, width_m] = size_m;
    let wall = |along_m: f64, across_m: f64, length_m: f64, yaw_rad: f64| {
        let north_m = north_m + along_m * cos - across_m * sin;
        let east_m = east_m + along_m * sin + across_m * cos;
        Obstacle::Box(YawedBox::new(north_m, east_m, length_m, THICK_M, yaw_rad, TALL_M))
    };
    let quarter_rad = std::f64::consts::FRAC_PI_2;
    let (ahead_m, aside_m) = (0.5 * (length_m + THICK_M), 0.5 * (width_m + THICK_M));
    [
        wall(ahead_m, 0.0, width_m + 2.0 * THICK_M, yaw_rad + quarter_rad),
        wall(-ahead_m, 0.0, width_m + 2.0 * THICK_M, yaw_rad + quarter_rad),
        wall(0.0, aside_m, length_m, yaw_rad),
        wall(0.0, -aside_m, length_m, yaw_rad),
    ]
}

/// A world of that kind, and the goal in it that cannot be reached.
fn closed(kind: Kind, seed: u64) -> World {
    let mut random = Random::new(
        seed,
        KINDS.iter().position(|other| *other == kind).unwrap() as u64,
    );
    let mut between = |low: f64, high: f64| random.between(low, high);
    let (mut north_m, mut east_m) = (between(25.0, 32.0), between(-4.0, 4.0));
    let yaw_rad = between(0.0, std::f64::consts::TAU);
    let mut obstacles = Vec::new();
    match kind {
        Kind::Room => {
            // The goal is well inside: an autopilot takes what is near for reached.
            obstacles.extend(room(
                north_m,
                east_m,
                [between(8.0, 16.0), between(8.0, 16.0)],
                yaw_rad,
            ));
        }
        Kind::Maze => {
            let maze = World::generate(WorldKind::Benchmark(Benchmark::Maze), seed).unwrap();
            obstacles.extend_from_slice(maze.obstacles());
            let goal = maze.goals()[0];
            (north_m, east_m) = (goal.x_m, goal.y_m);
            obstacles.extend(room(north_m, east_m, [MAZE_ROOM_M; 2], 0.0));
        }
        Kind::Hull if seed.is_multiple_of(2) => obstacles.push(Obstacle::Cylinder(Cylinder {
            north_m,
            east_m,
            radius_m: between(3.0, 4.5),
            top_m: TALL_M,
        })),
        Kind::Hull => {
            let (length_m, width_m) = (between(7.0, 12.0), between(7.0, 12.0));
            obstacles.push(Obstacle::Box(YawedBox::new(
                north_m, east_m, length_m, width_m, yaw_rad, TALL_M,
            )));
        }
        Kind::Yard => {
            let size_m = [between(16.0, 40.0), between(16.0, 30.0)];
            obstacles.extend(room(0.0, 0.0, size_m, 0.2 * (yaw_rad - 3.0)));
            north_m = 0.5 * size_m[0] + between(6.0, 12.0);
        }
    }
    let goal = Point::new(north_m, east_m, -2.5);
    World::new(Scene {
        seed,
        goals: vec![goal],
        ..Scene::of("closed", obstacles)
    })
}

fn is_told(kind: Kind, seed: u64, sensors: &str) {
    let mut cell = Cell::of("empty".parse().unwrap()).unwrap();
    cell.sensors = sensor_set(sensors).unwrap();
    cell.radius_m = Some(0.25);
    let pairings = [PX4_TRAJECTORY, PX4_CURRENT, COPTER];
    let mut setup = pairings[seed as usize % pairings.len()]
        .fly(setup(&cell, seed).unwrap())
        .unwrap();
    setup.world = closed(kind, seed);
    setup.plan.waypoints = setup.world.goals().to_vec();
    setup.plan.ending = Ending::Hold;
    setup.plan.resume = false;
    setup.plan.mission_limit_s = f64::INFINITY;
    setup.params.set("OA_ALT_MAX", HEIGHT_MAX_M).unwrap();
    let mut flight = LockStep::new(setup).unwrap();
    let what = format!("{kind:?} {seed} {sensors}");
    assert!(
        flight.run_until(60.0, |f| f.truth().cruise_s > 0.0),
        "{what}: no mission"
    );
    let begun_s = flight.truth().time_s;
    let is_told = flight.run_until(TOLD_WITHIN_S, |f| f.count(&ITEM_BLOCKED) > 0);
    let way_m = flight.truth().cruise_m;
    let first_s = |events: &[&Event]| {
        let mut said = flight.events.iter();
        said.find(|(_, said)| events.iter().any(|event| event.id == said.id))
            .map_or(f64::NAN, |(time_s, _)| time_s - begun_s)
    };
    let reasons = flight
        .events
        .iter()
        .filter(|(_, said)| said.id == GOAL_BLOCKED.id);
    let reason = reasons.map(|(_, said)| said.name.as_str().to_owned()).next_back();
    let reason = reason.unwrap_or_default();
    println!(
        "{what}: first text after {:.0} s, out of reach after {:.0} s and {way_m:.0} m: {}; {} times looking for a way",
        first_s(&[&WAY_SEARCHED, &NO_PATH, &ITEM_BLOCKED]),
        first_s(&[&ITEM_BLOCKED]),
        reason,
        flight.count(&WAY_SEARCHED),
    );
    assert!(is_told, "{what}: {way_m} m, and not told");
    assert_eq!(flight.truth().collisions, 0, "{what}");
    let mut moved_m = || {
        let before = flight.truth().position.vector();
        flight.run(REST_S);
        (flight.truth().position.vector() - before).norm()
    };
    let rests = (0..(RESTS_WITHIN_S / REST_S) as usize).any(|_| moved_m() < REST_M);
    assert!(rests, "{what}: it does not come to rest");
    let moved_m = moved_m();
    assert!(moved_m < REST_M, "{what}: it does not hold, {moved_m} m");
    assert_eq!(flight.truth().collisions, 0, "{what}");
}

pub fn closed_flights() -> Flights {
    let mut flights = Flights::new();
    for kind in KINDS {
        for seed in 1..=SEEDS {
            for sensors in SENSORS {
                let in_every_run = (kind, seed, sensors) == (Kind::Room, 1, "sphere");
                flights.add(&format!("{kind:?} {seed} {sensors}"), in_every_run, move || {
                    is_told(kind, seed, sensors);
                });
            }
        }
    }
    flights
}

#[test]
fn whatever_encloses_it() {
    closed_flights().fly_some();
}
