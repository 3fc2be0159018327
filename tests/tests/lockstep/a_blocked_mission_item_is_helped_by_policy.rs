//! A waypoint inside a house: the vehicle comes to rest before it, and the policy decides what becomes of the mission.

use jink_emulated_ground_station::Outcome;
use jink_shared_types::events::ITEM_BLOCKED;
use jink_shared_types::frames::Point;
use jink_shared_types::vehicle::NavMode;
use jink_simulated_world::world::{Obstacle, Scene, World, YawedBox};
use jink_tests::flights::Flights;
use jink_tests::lockstep::LockStep;
use jink_tests::pairing::{COPTER, PX4_CURRENT, PX4_TRAJECTORY, Pairing};

/// The first waypoint lies in the middle of a house, the goal behind it.
fn flight(whose: Pairing, policy: f64) -> LockStep {
    let mut setup = whose.forest(1).unwrap();
    setup.plan.mission_limit_s = 240.0;
    let house = YawedBox::new(20.0, 1.0, 9.0, 8.0, 0.3, 12.0);
    setup.world = World::new(Scene {
        seed: 1,
        goals: setup.world.goals().to_vec(),
        bounds: *setup.world.bounds(),
        ..Scene::of("house", vec![Obstacle::Box(house)])
    });
    let inside = Point::new(20.0, 1.0, -setup.world.flight_height_m());
    setup.plan.waypoints.insert(0, inside);
    setup.plan.resume = false;
    setup.params.set("OA_BLOCKED", policy).unwrap();
    setup.params.set("OA_BLOCKED_T", 5.0).unwrap();
    LockStep::new(setup).unwrap()
}

fn skips(whose: Pairing) {
    let mut flight = flight(whose, 1.0);
    while flight.outcome().is_none() {
        flight.step();
    }
    assert_eq!(flight.outcome(), Some(&Outcome::Done));
    assert_eq!((flight.truth().collisions, flight.count(&ITEM_BLOCKED)), (0, 1));
}

#[test]
fn skipped_where_the_autopilot_flies_the_mission() {
    skips(PX4_TRAJECTORY);
}

pub fn skip_flights() -> Flights {
    let mut flights = Flights::new();
    for whose in [PX4_CURRENT, COPTER] {
        flights.add(whose.name(), false, move || {
            skips(whose);
        });
    }
    flights
}

pub fn stop_flights() -> Flights {
    let mut flights = Flights::new();
    for whose in [PX4_CURRENT, COPTER] {
        flights.add(whose.name(), whose == PX4_CURRENT, move || {
            let mut flight = flight(whose, 2.0);
            while flight.count(&ITEM_BLOCKED) == 0 {
                flight.step();
                assert!(flight.truth().time_s < 120.0, "{whose:?}: nobody has noticed");
            }
            for _ in 0..500 {
                flight.step();
            }
            assert_eq!(flight.truth().mode.get(), NavMode::Hold, "{whose:?}");
            assert_eq!(flight.truth().collisions, 0, "{whose:?}");
        });
    }
    flights
}

#[test]
fn stopped_and_the_autopilot_holds() {
    stop_flights().fly_some();
}

pub fn reported_once_and_waited_for() -> Flights {
    Flights::of_one("reported_once_and_waited_for", || {
        let mut flight = flight(PX4_TRAJECTORY, 0.0);
        while flight.truth().time_s < 60.0 {
            flight.step();
        }
        assert_eq!(flight.count(&ITEM_BLOCKED), 1);
        assert_eq!(flight.truth().mode.get(), NavMode::Mission);
        assert_eq!(flight.truth().collisions, 0);
    })
}
