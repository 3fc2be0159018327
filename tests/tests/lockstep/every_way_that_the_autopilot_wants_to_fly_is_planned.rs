//! A place to go to, the end of a mission, Hold at speed, a landing elsewhere, a return, a circle: the autopilot would fly straight
//! there. With jink the way there is planned like a mission's, or it holds and says why.

use jink_emulated_ground_station::{Action, Ending, InFlight, Outcome, PlanItem, When};
use jink_shared_types::Point;
use jink_shared_types::frames::LocalNed;
use jink_shared_types::vehicle::NavMode;
use jink_tests::campaign::{Cell, setup};
use jink_tests::flights::Flights;
use jink_tests::lockstep::{FlightSetup, LockStep};
use jink_tests::pairing::{
    FOLLOWERS, PX4_2021_OFFBOARD, PX4_CURRENT, PX4_DEVIATION, PX4_TRAJECTORY, Pairing,
};

/// What a vehicle overshoots its reference by, a tenth, and gusts (m/s).
const FASTEST_MPS: f64 = 3.4;

fn place(x_m: f64, y_m: f64) -> Point<LocalNed> {
    Point::new(x_m, y_m, -2.5)
}

fn away_m(flight: &LockStep, to: Point<LocalNed>) -> f64 {
    (flight.truth().position.vector() - to.vector()).xy().norm()
}

fn forest(whose: Pairing, seed: u64, actions: Vec<(When, Action)>) -> FlightSetup {
    let mut setup = whose.forest(seed).unwrap();
    setup.plan.in_flight = actions
        .into_iter()
        .map(|(when, action)| InFlight { when, action })
        .collect();
    setup
}

/// The station sends it through the forest, and jink leads it around what stands there.
pub fn go_to_flights() -> Flights {
    let mut flights = Flights::new();
    let to = place(40.0, 4.0);
    let whose = PX4_TRAJECTORY;
    for seed in [1, 2] {
        flights.add(&format!("seed {seed}"), seed == 1, move || {
            let mut flight =
                LockStep::new(forest(whose, seed, vec![(When::North(3.0), Action::GoTo(to))])).unwrap();
            assert!(flight.run_until(60.0, |f| f.truth().position.x_m > 3.0));
            let mut fastest = 0.0f64;
            let arrived = (0..15_000).any(|_| {
                flight.step();
                fastest = fastest.max(flight.truth().velocity.vector().xy().norm());
                away_m(&flight, to) < 1.0
            });
            let truth = flight.truth();
            assert!(arrived, "{whose:?} {seed} {truth:?}");
            assert_eq!(truth.collisions, 0, "{whose:?} {seed} {truth:?}");
            assert!(fastest < FASTEST_MPS, "{whose:?} {seed} {fastest}");
            flight.run(8.0);
            assert!(away_m(&flight, to) < 1.0, "{whose:?} {seed} {:?}", flight.truth());
        });
    }
    flights
}

#[test]
fn a_place_to_go_to() {
    go_to_flights().fly_some();
}

/// The goal lies behind the wall, and the mission counts as finished before it.
#[test]
fn the_last_metres_of_a_mission() {
    let cell = Cell {
        limit_s: 60.0,
        ..Cell::of("gap".parse().unwrap()).unwrap()
    };
    let goal = place(18.0, 0.0);
    let mut setup = PX4_TRAJECTORY.fly(setup(&cell, 1).unwrap()).unwrap();
    setup.autopilot = setup.autopilot.with_parameter("NAV_ACC_RAD", 10.0);
    setup.plan.waypoints = vec![goal];
    setup.plan.ending = Ending::Hold;
    let mut flight = LockStep::new(setup).unwrap();
    while flight.outcome().is_none() {
        flight.step();
    }
    assert_eq!(flight.outcome(), Some(&Outcome::Done));
    let mut fastest = 0.0f64;
    for _ in 0..7_500 {
        flight.step();
        fastest = fastest.max(flight.truth().velocity.vector().xy().norm());
    }
    let truth = flight.truth();
    assert_eq!(truth.collisions, 0, "{truth:?}");
    assert!(fastest < FASTEST_MPS, "{fastest}");
    assert!(away_m(&flight, goal) < 0.5, "{truth:?}");
}

/// A wall with a gap aside of the straight line, and the goal close behind the wall: the place nearest to the goal is before
/// the wall, and the gap is narrow enough that the vehicle has to slow down for it.
pub fn gap_aside_flights() -> Flights {
    let mut flights = Flights::new();
    let gaps = [
        (PX4_CURRENT, 2, 0.0),
        (PX4_CURRENT, 4, 0.0),
        (PX4_CURRENT, 900_031, 0.4),
        (PX4_TRAJECTORY, 4, 0.4),
    ];
    for (whose, seed, aside_m) in gaps {
        let is_first = seed == 2;
        flights.add(&format!("{} seed {seed}", whose.name()), is_first, move || {
            let cell = Cell {
                limit_s: 60.0,
                ..Cell::of("gap".parse().unwrap()).unwrap()
            };
            let goal = place(18.0, aside_m);
            let mut setup = whose.fly(setup(&cell, seed).unwrap()).unwrap();
            setup.autopilot = setup.autopilot.with_parameter("NAV_ACC_RAD", 10.0);
            setup.plan.waypoints = vec![goal];
            setup.plan.ending = Ending::Hold;
            let mut flight = LockStep::new(setup).unwrap();
            let arrived = flight.run_until(60.0, |f| away_m(f, goal) < 0.5);
            let truth = flight.truth();
            assert!(arrived, "{whose:?} {seed} {truth:?}");
            assert_eq!(truth.collisions, 0, "{whose:?} {seed} {truth:?}");
        });
    }
    flights
}

#[test]
fn a_gap_aside_of_a_goal_behind_a_wall() {
    gap_aside_flights().fly_some();
}

/// It stops in space known to be free, and comes back to the place that PX4 holds.
pub fn hold_at_speed() -> Flights {
    Flights::of_one("hold_at_speed", || {
        let actions = vec![(When::North(10.0), Action::Mode(NavMode::Hold))];
        let mut flight = LockStep::new(forest(PX4_TRAJECTORY, 1, actions)).unwrap();
        assert!(flight.run_until(60.0, |f| f.truth().mode.get() == NavMode::Hold
            && f.truth().position.x_m > 9.0));
        assert!(flight.truth().velocity.vector().norm() > 2.0);
        let begun_m = flight.truth().position.x_m;
        let mut furthest_m = 0.0f64;
        for _ in 0..6_000 {
            flight.step();
            furthest_m = furthest_m.max(flight.truth().position.x_m);
        }
        let truth = flight.truth();
        assert!(furthest_m - begun_m < 12.0, "{furthest_m} {truth:?}");
        assert!(truth.position.x_m - begun_m < 4.0, "{furthest_m} {truth:?}");
        assert!(truth.velocity.vector().norm() < 0.2, "{truth:?}");
        assert_eq!(truth.collisions, 0, "{truth:?}");
    })
}

/// An ordinary plan ends with a landing at another place than its last waypoint.
pub fn landing_flights() -> Flights {
    let mut flights = Flights::new();
    let down = Point::new(40.0, 2.0, 0.0);
    for whose in [PX4_TRAJECTORY, PX4_DEVIATION].into_iter().chain(FOLLOWERS) {
        flights.add(whose.name(), whose == PX4_CURRENT, move || {
            let mut setup = whose.forest(3).unwrap();
            setup.plan.waypoints = vec![place(4.0, 0.0)];
            setup.plan.tail = vec![PlanItem::landing(down)];
            setup.plan.ending = Ending::Mission;
            let mut flight = LockStep::new(setup).unwrap();
            let mut fastest = 0.0f64;
            while flight.outcome().is_none() {
                flight.step();
                fastest = fastest.max(flight.truth().velocity.vector().xy().norm());
            }
            let truth = flight.truth();
            assert_eq!(truth.collisions, 0, "{whose:?} {truth:?}");
            assert_eq!(flight.outcome(), Some(&Outcome::Done), "{whose:?} {truth:?}");
            assert!(away_m(&flight, down) < 2.5, "{whose:?} {truth:?}");
            // In its own mission mode an autopilot flies as fast as it likes until it is taken over.
            assert!(fastest < FASTEST_MPS + 1.0, "{whose:?} {fastest}");
        });
    }
    flights
}

#[test]
fn a_landing_elsewhere() {
    landing_flights().fly_some();
}

/// Nobody looks for obstacles on a circle that PX4 flies by itself: it holds instead, after a stop out of 4 m/s around whatever stands
/// in its way. Chosen once more it is flown.
pub fn circle_flights() -> Flights {
    let mut flights = Flights::new();
    let centre = place(22.0, 0.0);
    for whose in [PX4_TRAJECTORY, PX4_CURRENT, PX4_2021_OFFBOARD] {
        flights.add(whose.name(), whose == PX4_CURRENT, move || {
            let orbit = |when| (when, Action::Orbit(centre));
            let actions = vec![orbit(When::North(8.0)), orbit(When::After(9.0))];
            let mut flight = LockStep::new(forest(whose, 1, actions)).unwrap();
            let is = |mode| move |f: &LockStep| f.truth().mode.get() == mode;
            assert!(flight.run_until(60.0, is(NavMode::Orbit)), "{whose:?}");
            assert!(
                flight.run_until(2.0, is(NavMode::Hold)),
                "{whose:?} {:?}",
                flight.truth()
            );
            let held = flight.truth().position;
            flight.run(5.0);
            let truth = flight.truth();
            assert_eq!(truth.mode.get(), NavMode::Hold, "{whose:?} {truth:?}");
            assert!(away_m(&flight, held) < 12.0, "{whose:?} {truth:?}");
            assert_eq!(truth.collisions, 0, "{whose:?} {truth:?}");
            assert!(flight.run_until(6.0, is(NavMode::Orbit)), "{whose:?}");
            flight.run(3.0);
            assert_eq!(flight.truth().mode.get(), NavMode::Orbit, "{whose:?}");
        });
    }
    flights
}

#[test]
fn a_circle() {
    circle_flights().fly_some();
}

/// Up, home, and down: home is behind trees.
pub fn a_return() -> Flights {
    Flights::of_one("a_return", || {
        let mut setup = forest(
            PX4_TRAJECTORY,
            1,
            vec![(When::North(25.0), Action::Mode(NavMode::Return))],
        );
        setup.autopilot = setup
            .autopilot
            .with_parameter("RTL_RETURN_ALT", 3.0)
            .with_parameter("RTL_DESCEND_ALT", 3.0);
        let mut flight = LockStep::new(setup).unwrap();
        assert!(flight.run_until(60.0, |f| f.truth().mode.get() == NavMode::Return));
        assert!(
            flight.run_until(90.0, |f| !f.truth().armed.is_set()),
            "{:?}",
            flight.truth()
        );
        let truth = flight.truth();
        assert_eq!(truth.collisions, 0, "{truth:?}");
        assert!(away_m(&flight, place(0.0, 0.0)) < 2.0, "{truth:?}");
    })
}
