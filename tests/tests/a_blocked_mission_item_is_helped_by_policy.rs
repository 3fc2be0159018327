//! A waypoint inside a house: the vehicle comes to rest before it, and the policy decides what becomes of the mission.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use jink_mavlink_gateway::ProfileName;
use jink_shared_types::events::ITEM_BLOCKED;
use jink_shared_types::frames::Point;
use jink_shared_types::vehicle::NavMode;
use jink_simulator::ground_station::Outcome;
use jink_simulator::world::{Obstacle, Scene, World, YawedBox};
use jink_tests::campaign::{Cell, setup};
use jink_tests::lockstep::LockStep;

/// The first waypoint lies in the middle of a house, the goal behind it.
fn flight(profile: ProfileName, policy: f64) -> LockStep {
    let cell = Cell {
        kind: "forest".parse().unwrap(),
        density_per_m2: None,
        speed_mps: 3.0,
        limit_s: 240.0,
    };
    let mut setup = setup(&cell, 1).unwrap();
    let house = YawedBox::new(20.0, 1.0, 9.0, 8.0, 0.3, 12.0);
    setup.world = World::new(Scene {
        name: "house",
        seed: 1,
        goals: setup.world.goals().to_vec(),
        bounds: *setup.world.bounds(),
        obstacles: vec![Obstacle::Box(house)],
    });
    let inside = Point::new(20.0, 1.0, -setup.world.flight_height_m());
    setup.plan.waypoints.insert(0, inside);
    setup.plan.resume = false;
    setup.profile = profile;
    if profile == ProfileName::Px4Offboard {
        setup.autopilot = setup.autopilot.with_parameter("COM_OBS_AVOID", 0.0);
    }
    setup.params.set("OA_BLOCKED", policy).unwrap();
    setup.params.set("OA_BLOCKED_T", 5.0).unwrap();
    LockStep::new(setup).unwrap()
}

fn skips(profile: ProfileName) {
    let mut flight = flight(profile, 1.0);
    while flight.outcome().is_none() {
        flight.step();
    }
    assert_eq!(flight.outcome(), Some(&Outcome::Done));
    assert_eq!((flight.truth().collisions, flight.count(&ITEM_BLOCKED)), (0, 1));
}

#[test]
fn skipped_where_the_autopilot_flies_the_mission() {
    skips(ProfileName::Px4Trajectory);
}

#[test]
fn skipped_where_jink_flies_it() {
    skips(ProfileName::Px4Offboard);
}

#[test]
fn stopped_and_the_autopilot_holds() {
    let mut flight = flight(ProfileName::Px4Offboard, 2.0);
    while flight.count(&ITEM_BLOCKED) == 0 {
        flight.step();
        assert!(flight.truth().time_s < 120.0, "nobody has noticed");
    }
    for _ in 0..500 {
        flight.step();
    }
    assert_eq!(flight.truth().mode.get(), NavMode::Hold);
    assert_eq!(flight.truth().collisions, 0);
}

#[test]
fn told_once_and_waited_for() {
    let mut flight = flight(ProfileName::Px4Trajectory, 0.0);
    while flight.truth().time_s < 60.0 {
        flight.step();
    }
    assert_eq!(flight.count(&ITEM_BLOCKED), 1);
    assert_eq!(flight.truth().mode.get(), NavMode::Mission);
    assert_eq!(flight.truth().collisions, 0);
}
