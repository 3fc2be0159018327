//! A ground station changes the mission while it is flown: another one of the same length, of another length, none at all, or
//! another item of it. What is flown is what the station wants last, wherever jink or the autopilot flies it.

use jink_emulated_ground_station::{Action, InFlight, Make, Outcome, When};
use jink_shared_types::Point;
use jink_shared_types::frames::LocalNed;
use jink_shared_types::truth::SimTruth;
use jink_shared_types::vehicle::NavMode;
use jink_tests::flights::Flights;
use jink_tests::lockstep::LockStep;
use jink_tests::pairing::{
    COPTER, FOLLOWERS, PX4_2021_OFFBOARD, PX4_CURRENT, PX4_DEVIATION, PX4_TRAJECTORY, Pairing,
};
use mavlink::dialect::{COMMAND_LONG_DATA, MavCmd, MavMessage};

const ALL: [Pairing; 5] = [
    PX4_CURRENT,
    PX4_2021_OFFBOARD,
    COPTER,
    PX4_TRAJECTORY,
    PX4_DEVIATION,
];

/// North of the start where the station acts (m): at full speed, before the first turn.
const ACTS_AT_M: f64 = 8.0;

fn place(x_m: f64, y_m: f64) -> Point<LocalNed> {
    Point::new(x_m, y_m, -2.5)
}

fn flight(whose: Pairing, waypoints: Vec<Point<LocalNed>>, action: Action) -> LockStep {
    let mut setup = whose.forest(1).unwrap();
    setup.plan.waypoints = waypoints;
    setup.plan.in_flight = vec![InFlight {
        when: When::North(ACTS_AT_M),
        action,
    }];
    LockStep::new(setup).unwrap()
}

/// The mission ends at this place, and the vehicle lands there. A PX4 that is deviated flies back to its own track before it lands,
/// which waits where the vehicle left it (docs/connect_px4_deviation.md): there the place is where the mission has ended.
fn lands_at(
    flight: &mut LockStep,
    whose: Pairing,
    place: Point<LocalNed>,
    mut at_each_step: impl FnMut(&SimTruth),
) {
    let mut ended = None;
    while flight.outcome().is_none() {
        flight.step();
        at_each_step(flight.truth());
        if flight.truth().mission_done.is_set() {
            ended.get_or_insert(flight.truth().position);
        }
    }
    let truth = flight.truth();
    assert_eq!(flight.outcome(), Some(&Outcome::Done), "{whose:?} {truth:?}");
    assert_eq!(truth.collisions, 0, "{whose:?} {truth:?}");
    let judged = if whose == PX4_DEVIATION {
        ended.expect("a mission that ends")
    } else {
        truth.position
    };
    let away_m = (judged.vector().xy() - place.vector().xy()).norm();
    assert!(away_m < 2.5, "{whose:?} {away_m} m from there: {truth:?}");
}

pub fn same_length_flights() -> Flights {
    let mut flights = Flights::new();
    for whose in ALL {
        flights.add(whose.name(), false, move || {
            let other = Action::Upload {
                waypoints: vec![place(20.0, 12.0)],
                tail: Vec::new(),
            };
            let mut flight = flight(whose, vec![place(60.0, 0.0)], other);
            lands_at(&mut flight, whose, place(20.0, 12.0), |_| {});
        });
    }
    flights
}

pub fn other_length_flights() -> Flights {
    let mut flights = Flights::new();
    for whose in ALL {
        flights.add(whose.name(), whose == COPTER, move || {
            let other = Action::Upload {
                waypoints: vec![place(20.0, 12.0), place(8.0, 16.0)],
                tail: Vec::new(),
            };
            let mut flight = flight(whose, vec![place(60.0, 0.0)], other);
            lands_at(&mut flight, whose, place(8.0, 16.0), |_| {});
        });
    }
    flights
}

#[test]
fn another_mission_of_another_length() {
    other_length_flights().fly_some();
}

/// Without a mission there is nothing to fly: the place is held.
pub fn no_mission_any_more() -> Flights {
    Flights::of_one("no_mission_any_more", || {
        for whose in [COPTER, PX4_CURRENT] {
            let mut flight = flight(whose, vec![place(60.0, 0.0)], Action::ClearMission);
            assert!(flight.run_until(60.0, |f| f.truth().position.x_m > ACTS_AT_M));
            assert_eq!(
                flight.truth().mode.get(),
                NavMode::Offboard,
                "AUTO keeps its mission"
            );
            flight.run(10.0);
            let place = flight.truth().position.vector();
            for _ in 0..1_250 {
                flight.step();
                let away_m = (flight.truth().position.vector() - place).norm();
                assert!(away_m < 0.5, "{whose:?} {:?}", flight.truth());
            }
            // PX4 reports it once a second, and the vehicle stops as gently as it flies.
            assert!(place.x < ACTS_AT_M + 16.0, "{whose:?} {place}");
            assert_eq!(flight.truth().collisions, 0, "{whose:?}");
        }
    })
}

/// The item that is left out lies aside: it is not flown past.
pub fn item_flights() -> Flights {
    let mut flights = Flights::new();
    let aside = place(22.0, 10.0);
    for whose in ALL {
        flights.add(whose.name(), whose == COPTER, move || {
            // Home and the take-off come before the waypoints.
            let before = if whose.make == Make::ArduCopter { 2 } else { 0 };
            let mut flight = flight(
                whose,
                vec![place(16.0, 0.0), aside, place(30.0, -4.0)],
                Action::SetCurrent { item: before + 2 },
            );
            let mut nearest_m = f64::INFINITY;
            lands_at(&mut flight, whose, place(30.0, -4.0), |truth| {
                let away = truth.position.vector() - aside.vector();
                nearest_m = nearest_m.min(away.norm());
            });
            assert!(nearest_m > 6.0, "{whose:?} {nearest_m}");
        });
    }
    flights
}

#[test]
fn another_item_by_message() {
    item_flights().fly_some();
}

/// Current PX4 takes the command and does not show the item; only those who show it can be followed.
#[test]
fn another_item_by_command() {
    let aside = place(22.0, 10.0);
    let mut setup = COPTER.forest(1).unwrap();
    setup.plan.waypoints = vec![place(16.0, 0.0), aside, place(30.0, -4.0)];
    let mut flight = LockStep::new(setup).unwrap();
    assert!(flight.run_until(60.0, |f| f.truth().position.x_m > ACTS_AT_M));
    flight.send(MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        target_system: 1,
        target_component: 1,
        command: MavCmd::MAV_CMD_DO_SET_MISSION_CURRENT,
        param1: 4.0,
        ..COMMAND_LONG_DATA::default()
    }));
    let mut nearest_m = f64::INFINITY;
    lands_at(&mut flight, COPTER, place(30.0, -4.0), |truth| {
        let away = truth.position.vector() - aside.vector();
        nearest_m = nearest_m.min(away.norm());
    });
    assert!(nearest_m > 6.0, "{nearest_m}");
}

/// Whoever lets the autopilot fly its mission while jink flies it gets it flown by jink, as from any other mode.
pub fn chosen_flights() -> Flights {
    let mut flights = Flights::new();
    for whose in FOLLOWERS {
        flights.add(whose.name(), false, move || {
            let mut flight = LockStep::new(whose.forest(1).unwrap()).unwrap();
            assert!(flight.run_until(60.0, |f| f.truth().position.x_m > ACTS_AT_M));
            assert_eq!(flight.truth().mode.get(), NavMode::Offboard, "{whose:?}");
            whose.command_mode(&mut flight, NavMode::Mission);
            assert!(
                flight.run_until(1.0, |f| f.truth().mode.get() == NavMode::Mission),
                "{whose:?}"
            );
            assert!(
                flight.run_until(5.0, |f| f.truth().mode.get() == NavMode::Offboard),
                "{whose:?}"
            );
            lands_at(&mut flight, whose, place(60.0, 0.0), |_| {});
        });
    }
    flights
}
