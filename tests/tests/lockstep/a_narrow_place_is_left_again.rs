//! A vehicle that rests nearer to something than its slowest planned motion needs (a gust, a hard braking, something that came)
//! creeps away from there, and comes no nearer on the way.

use jink_emulated_ground_station::{Action, Ending, InFlight, When};
use jink_shared_types::Point;
use jink_shared_types::vehicle::NavMode;
use jink_simulated_world::world::{Obstacle, Scene, World, YawedBox};
use jink_tests::campaign::{Cell, setup};
use jink_tests::flights::Flights;
use jink_tests::lockstep::LockStep;
use jink_tests::pairing::{COPTER, PX4_CURRENT, PX4_TRAJECTORY, Pairing};

/// Length of the walls on both sides (m).
const WALL_M: f64 = 3.0;
/// The vehicle holds for so long before it is sent on (s).
const HOLD_S: f64 = 25.0;
/// The walls are there after so long (s).
const WALLS_S: f64 = 15.0;
/// It may stray by this while it creeps, and sway while it holds (m).
const STRAY_M: f64 = 0.1;

/// What came of it.
#[derive(Debug)]
struct Left {
    /// Least distance from the walls (m).
    least_m: f64,
    /// How far it has come (m).
    way_m: f64,
}

/// Flies ahead, holds, and finds walls `left_m` and `right_m` beside it; then it is sent on.
fn walled_in(whose: Pairing, left_m: f64, right_m: f64) -> Left {
    let cell = Cell::of("empty".parse().unwrap()).unwrap();
    let mut setup = whose.fly(setup(&cell, 1).unwrap()).unwrap();
    setup.plan.waypoints = vec![Point::new(30.0, 0.0, -2.5)];
    setup.plan.ending = Ending::Hold;
    let actions = [
        (When::North(5.0), Action::Mode(NavMode::Hold)),
        (When::After(HOLD_S), Action::Mode(NavMode::Mission)),
    ];
    setup.plan.in_flight = actions.map(|(when, action)| InFlight { when, action }).to_vec();
    let bounds = *setup.world.bounds();
    let mut flight = LockStep::new(setup).unwrap();
    assert!(flight.run_until(60.0, |f| f.truth().position.x_m > 5.0));
    flight.run(WALLS_S);
    let here = flight.truth().position;
    let wall = |east_m: f64| Obstacle::Box(YawedBox::new(here.x_m, here.y_m + east_m, WALL_M, 0.4, 0.0, 6.0));
    let walls = World::new(Scene {
        seed: 1,
        bounds,
        ..Scene::of("walls", vec![wall(-left_m - 0.2), wall(right_m + 0.2)])
    });
    flight.move_world(walls.clone());
    let mut least_m = f64::INFINITY;
    let end = flight.now().plus_seconds(45.0);
    while flight.now() < end {
        flight.step();
        least_m = least_m.min(walls.clearance_to_obstacles_m(flight.truth().position));
    }
    let way = flight.truth().position.vector() - here.vector();
    assert_eq!(flight.truth().collisions, 0, "{whose:?} {left_m} {right_m}");
    Left {
        least_m,
        way_m: way.xy().norm(),
    }
}

/// At 0.6 m it depends on where the cells of the map, 0.2 m wide, lie to the wall whether there is room for a certainty.
pub fn wall_flights() -> Flights {
    let mut flights = Flights::new();
    for whose in [PX4_TRAJECTORY, PX4_CURRENT, COPTER] {
        for (left_m, right_m) in [(0.7, 1.3), (0.65, 1.35), (0.75, 0.75)] {
            flights.add(
                &format!("{} {left_m} {right_m}", whose.name()),
                (whose, left_m) == (PX4_TRAJECTORY, 0.75),
                move || {
                    let left = walled_in(whose, left_m, right_m);
                    let what = format!("{whose:?} {left_m} {right_m}: {left:?}");
                    assert!(left.way_m > 5.0, "{what}");
                    assert!(left.least_m > f64::min(left_m, right_m) - STRAY_M, "{what}");
                },
            );
        }
    }
    flights
}

#[test]
fn between_walls() {
    wall_flights().fly_some();
}

/// Nearer than its own radius, as the map counts it, it only goes away from what is there: between walls it stays where it is.
pub fn at_arms_length_it_rests() -> Flights {
    Flights::of_one("at_arms_length_it_rests", || {
        let rests = walled_in(PX4_CURRENT, 0.45, 0.45);
        assert!(rests.way_m < 0.2 && rests.least_m > 0.35, "{rests:?}");
    })
}
