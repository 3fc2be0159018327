//! Who walks across the way of a mission, or comes to meet it, is let pass, and the mission goes on.

use jink_shared_types::Point;
use jink_simulated_world::world::{Cylinder, Obstacle, Scene, World};
use jink_tests::campaign::{Cell, setup};
use jink_tests::flights::Flights;
use jink_tests::lockstep::LockStep;
use jink_tests::pairing::{COPTER, PX4_CURRENT, PX4_TRAJECTORY, Pairing};

/// A person walks one step further (s).
const STEP_S: f64 = 0.02;
/// Radius of a person, and of what stands as high as the vehicle flies (m).
const PERSON_M: f64 = 0.3;
const TALL_M: f64 = 6.0;
/// How far ahead the mission leads (m).
const AHEAD_M: f64 = 30.0;

/// Where a person is after so many seconds (north, east, m).
type Walk = fn(f64) -> [f64; 2];

/// Flies ahead through an empty world in which a person walks as `walk` says from the moment on when the vehicle has flown 5 m.
fn meets(whose: Pairing, walk: Walk) {
    let cell = Cell::of("empty".parse().unwrap()).unwrap();
    let mut setup = whose.fly(setup(&cell, 1).unwrap()).unwrap();
    setup.plan.waypoints = vec![Point::new(AHEAD_M, 0.0, -2.5)];
    let bounds = *setup.world.bounds();
    let world = |walked_s: f64| {
        let [north_m, east_m] = walk(walked_s);
        let person = Obstacle::Cylinder(Cylinder {
            north_m,
            east_m,
            radius_m: PERSON_M,
            top_m: TALL_M,
        });
        World::new(Scene {
            seed: 1,
            bounds,
            ..Scene::of("person", vec![person])
        })
    };
    let mut flight = LockStep::new(setup).unwrap();
    flight.move_world(world(0.0));
    assert!(flight.run_until(60.0, |f| f.truth().position.x_m > 5.0));
    let mut walked_s = 0.0;
    while flight.outcome().is_none() && walked_s < 90.0 {
        walked_s += STEP_S;
        flight.move_world(world(walked_s));
        flight.run(STEP_S);
    }
    let truth = flight.truth();
    assert_eq!(truth.collisions, 0, "{whose:?}: {truth:?}");
    let away_m = (truth.position.x_m - AHEAD_M).hypot(truth.position.y_m);
    assert!(away_m < 2.0, "{whose:?}: {away_m} m from the goal: {truth:?}");
}

pub fn walk_flights() -> Flights {
    let mut flights = Flights::new();
    let walks: [(&str, Walk); 2] = [
        ("across", |walked_s| [14.0, 1.4 * walked_s - 4.5]),
        ("head-on", |walked_s| [26.0 - 1.2 * walked_s, 0.1]),
    ];
    for whose in [PX4_TRAJECTORY, PX4_CURRENT, COPTER] {
        for (name, walk) in walks {
            flights.add(
                &format!("{} {name}", whose.name()),
                whose == PX4_CURRENT,
                move || meets(whose, walk),
            );
        }
    }
    flights
}

#[test]
fn and_the_mission_goes_on() {
    walk_flights().fly_some();
}
