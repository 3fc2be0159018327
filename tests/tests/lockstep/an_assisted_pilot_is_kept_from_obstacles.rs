//! Assisted flight on autopilots as they are released: the pilot's sticks pass through the guard in OFFBOARD and GUIDED, and every way
//! out leads to his mode or to the one that holds.

use jink_emulated_ground_station::Make;
use jink_runtime::config::Config;
use jink_shared_types::events;
use jink_shared_types::link::AssistState;
use jink_shared_types::vehicle::NavMode;
use jink_tests::assisted::{AssistedPilot, CENTRED};
use jink_tests::campaign::{MID360, SPHERE, sensor_set, sensors_of};
use jink_tests::flights::Flights;
use jink_tests::lockstep::LockStep;
use jink_tests::pairing::{COPTER, PX4_CURRENT, Pairing};
use nalgebra::Vector3;

/// Distance that collision prevention keeps (m).
const CP_DIST_M: f64 = 1.5;
/// Reported is the distance of the centre, and clearance counts from the hull (m).
const HULL_M: f64 = 0.3;
/// What of it may be lost: the sensor's noise, a trunk between two rays, the autopilot's overshoot (m).
const LOST_M: f64 = 0.3;
/// Both autopilots that follow setpoints.
const BOTH: [Pairing; 2] = [PX4_CURRENT, COPTER];

fn assisted(pairing: Pairing, seed: u64) -> (LockStep, AssistedPilot) {
    let (mut flight, mut pilot) = AssistedPilot::take_off(pairing, seed, |_| {});
    pilot.engage(&mut flight);
    (flight, pilot)
}

fn position(flight: &LockStep) -> Vector3<f64> {
    flight.truth().position.vector()
}

fn speed_mps(flight: &LockStep) -> f64 {
    flight.truth().velocity.vector().norm()
}

/// What was reported to the pilot last about assisted flight.
fn reported(flight: &LockStep) -> String {
    let ours = [
        &events::ASSIST_ON,
        &events::ASSIST_OFF,
        &events::ASSIST_REFUSED,
        &events::ASSIST_HOLDS,
    ];
    let last = flight.events.iter().rev();
    let mut texts = last.filter(|(_, sample)| ours.iter().any(|event| event.id == sample.id));
    texts.next().map_or_else(String::new, |(_, sample)| sample.text())
}

pub fn forest_flights() -> Flights {
    let mut flights = Flights::new();
    for pairing in BOTH {
        for (sensors, seeds) in [(SPHERE, 1..=6), (MID360, 1..=3)] {
            for seed in seeds {
                let in_every_run = (pairing, seed) == (COPTER, 1);
                flights.add(
                    &format!("{} {sensors} seed {seed}", pairing.name()),
                    in_every_run,
                    move || {
                        is_kept_from_trees(pairing, sensors, seed);
                    },
                );
            }
        }
    }
    flights
}

/// Full stick ahead, then to all sides.
fn is_kept_from_trees(pairing: Pairing, sensors: &str, seed: u64) {
    let set = sensor_set(sensors).unwrap();
    let (mut flight, mut pilot) = AssistedPilot::take_off(pairing, seed, |setup| {
        setup.sensors = sensors_of(&set).unwrap();
        let config = Config::parse(&set.file, &set.text).unwrap();
        // Of the set's parameters those that declare what it does not see.
        for (param, value) in config.params.rows() {
            if param.name.starts_with("OA_DCL_") {
                setup.params.set(param.name, value).unwrap();
            }
        }
    });
    pilot.engage(&mut flight);
    let mut fastest_mps: f64 = 0.0;
    let mut way_m = 0.0;
    let mut last = position(&flight);
    let nearest_m = pilot.fly(&mut flight, 40.0, |flight, t| {
        fastest_mps = fastest_mps.max(speed_mps(flight));
        way_m += (position(flight) - last).norm();
        last = position(flight);
        let turn = (t / 5.0).floor() * 0.9;
        [turn.cos(), turn.sin(), 0.0, 0.0]
    });
    let what = format!("{} {sensors} {seed}", pairing.autopilot);
    println!(
        "{what}: nearest {nearest_m:.2} m, {way_m:.1} m flown, up to {fastest_mps:.1} m/s, {} reports",
        flight.count(&events::PREVENTION_ACTS)
    );
    assert_eq!(flight.truth().collisions, 0, "{what}");
    assert_eq!(flight.assist(), AssistState::On, "{what}");
    assert!(nearest_m > CP_DIST_M - HULL_M - LOST_M, "{what}: {nearest_m} m");
    assert!(flight.count(&events::PREVENTION_ACTS) > 0, "{what}");
    assert!(fastest_mps > 2.0, "{what} is flown: {fastest_mps} m/s");
    assert_eq!(flight.count(&events::SETPOINTS_IGNORED), 0, "{what}");
}

#[test]
fn pushed_into_forests_at_full_stick_it_touches_nothing() {
    forest_flights().fly_some();
}

pub fn what_is_steered_is_flown_and_released_sticks_hold_the_place() -> Flights {
    Flights::of_one(
        "what_is_steered_is_flown_and_released_sticks_hold_the_place",
        || {
            for pairing in BOTH {
                let (mut flight, mut pilot) = assisted(pairing, 1);
                let yaw_rad = flight.truth().attitude.yaw_rad();
                let begin = position(&flight);
                // Back to where nothing stands, up, and round.
                pilot.fly(&mut flight, 4.0, |_, _| [-0.4, 0.0, 0.5, 0.0]);
                pilot.fly(&mut flight, 2.0, |_, _| [0.0, 0.0, 0.0, 0.5]);
                pilot.fly(&mut flight, 3.0, |_, _| CENTRED);
                let moved = position(&flight) - begin;
                let turned_rad =
                    jink_shared_types::frames::wrap_pi(flight.truth().attitude.yaw_rad() - yaw_rad);
                assert!(moved.x < -3.0 && moved.z < -1.0, "{pairing:?}: {moved}");
                assert!((0.5..1.6).contains(&turned_rad), "{pairing:?}: {turned_rad}");
                let place = position(&flight);
                let mut farthest_m: f64 = 0.0;
                pilot.fly(&mut flight, 30.0, |flight, _| {
                    farthest_m = farthest_m.max((position(flight) - place).norm());
                    CENTRED
                });
                println!("{}: held within {farthest_m:.2} m", pairing.autopilot);
                assert!(farthest_m < 0.3, "{pairing:?}: {farthest_m} m");
                assert_eq!(flight.assist(), AssistState::On, "centred sticks are no way out");
                // Down: as far as it goes, which is not the ground.
                pilot.fly(&mut flight, 20.0, |_, _| [0.0, 0.0, -1.0, 0.0]);
                let height_m = -position(&flight).z;
                assert!((0.8..1.4).contains(&height_m), "{pairing:?}: {height_m} m");
                assert!(!flight.autopilot().is_landed());
            }
        },
    )
}

#[test]
fn switched_off_the_pilot_flies_in_his_own_mode() {
    for pairing in BOTH {
        let (mut flight, mut pilot) = assisted(pairing, 2);
        pilot.fly(&mut flight, 3.0, |_, _| [1.0, 0.0, 0.0, 0.0]);
        pilot.choose(&mut flight, false);
        pilot.fly(&mut flight, 0.5, |_, _| CENTRED);
        assert_eq!(flight.truth().mode, NavMode::Position, "{pairing:?}");
        assert_eq!(reported(&flight), "jink: assisted flight off: switched off");
        pilot.fly(&mut flight, 10.0, |_, _| CENTRED);
        assert_eq!(
            (flight.truth().mode.get(), flight.assist()),
            (NavMode::Position, AssistState::Off)
        );
        // And again.
        pilot.engage(&mut flight);
        assert_eq!(flight.truth().collisions, 0);
    }
}

pub fn a_mode_that_the_pilot_changes_is_never_asked_for_back() -> Flights {
    Flights::of_one("a_mode_that_the_pilot_changes_is_never_asked_for_back", || {
        for pairing in BOTH {
            for mode in [NavMode::Position, NavMode::Hold, NavMode::Return] {
                let (mut flight, mut pilot) = assisted(pairing, 3);
                pilot.fly(&mut flight, 2.0, |_, _| [0.5, 0.0, 0.0, 0.0]);
                pilot.change_mode(&mut flight, mode);
                pilot.fly(&mut flight, 6.0, |_, _| CENTRED);
                assert_eq!(flight.truth().mode, mode, "{pairing:?}");
                assert_eq!(flight.assist(), AssistState::Off, "{pairing:?}");
                assert_eq!(reported(&flight), "jink: assisted flight off: mode changed");
            }
        }
    })
}

/// PX4 notices the loss by itself and holds, sooner than jink asks for it.
#[test]
fn without_sticks_it_stops_and_then_the_autopilot_holds() {
    for pairing in BOTH {
        let (mut flight, mut pilot) = assisted(pairing, 1);
        pilot.fly(&mut flight, 3.0, |_, _| [-0.6, 0.0, 0.0, 0.0]);
        assert!(speed_mps(&flight) > 1.5, "{pairing:?}: {}", speed_mps(&flight));
        // ArduCopter's own RC_CHANNELS go on with its receiver's after three seconds; the stream itself ends.
        pilot.is_received = false;
        flight.mute_sticks = true;
        pilot.fly(&mut flight, 3.0, |_, _| CENTRED);
        assert!(speed_mps(&flight) < 0.7, "{pairing:?}: {}", speed_mps(&flight));
        assert_eq!(flight.truth().mode, NavMode::Hold, "{pairing:?}");
        assert_eq!(flight.assist(), AssistState::Off, "{pairing:?}");
        let words = if pairing.make == Make::Px4 {
            "mode changed"
        } else {
            "no sticks"
        };
        assert_eq!(reported(&flight), format!("jink: assisted flight off: {words}"));
    }
}

#[test]
fn without_ranges_it_stops_and_after_five_seconds_the_autopilot_holds() {
    for pairing in BOTH {
        let (mut flight, mut pilot) = assisted(pairing, 1);
        pilot.fly(&mut flight, 3.0, |_, _| [-0.6, 0.0, 0.0, 0.0]);
        assert!(speed_mps(&flight) > 1.5);
        flight.silent_sensors.insert(0);
        let silent_s = flight.truth().time_s;
        pilot.fly(&mut flight, 3.0, |_, _| [1.0, 0.0, 0.0, 0.0]);
        assert!(speed_mps(&flight) < 0.3, "{pairing:?}: {}", speed_mps(&flight));
        assert_eq!(flight.truth().mode, NavMode::Offboard);
        assert_eq!(reported(&flight), "jink: assisted flight holds: no range data");
        let mut held_s = None;
        pilot.fly(&mut flight, 5.0, |flight, _| {
            if flight.truth().mode == NavMode::Hold {
                held_s.get_or_insert(flight.truth().time_s - silent_s);
            }
            [1.0, 0.0, 0.0, 0.0]
        });
        let held_s = held_s.expect("it holds");
        println!("{}: Hold {held_s:.1} s after the last range", pairing.autopilot);
        assert!((5.0..6.5).contains(&held_s), "{pairing:?}: {held_s} s");
        assert_eq!(flight.assist(), AssistState::Off);
        assert_eq!(flight.truth().mode, NavMode::Hold, "{pairing:?}");
    }
}

#[test]
fn a_gateway_that_is_started_again_goes_on_without_a_jump() {
    for pairing in BOTH {
        let (mut flight, mut pilot) = assisted(pairing, 1);
        pilot.fly(&mut flight, 4.0, |_, _| [-0.5, 0.0, 0.0, 0.0]);
        let before_mps = speed_mps(&flight);
        assert!(before_mps > 1.5);
        flight.board().kill("mavlink_gateway");
        let mut slowest_mps = f64::INFINITY;
        pilot.fly(&mut flight, 2.0, |flight, _| {
            slowest_mps = slowest_mps.min(speed_mps(flight));
            [-0.5, 0.0, 0.0, 0.0]
        });
        println!(
            "{}: {before_mps:.1} m/s, then at least {slowest_mps:.1}",
            pairing.autopilot
        );
        assert!(slowest_mps > 0.8 * before_mps, "{pairing:?}: {slowest_mps} m/s");
        assert_eq!(
            flight.assist(),
            AssistState::On,
            "{pairing:?}: {}",
            reported(&flight)
        );
        assert_eq!(flight.truth().mode, NavMode::Offboard);
        // What was chosen may still be switched off, into the mode from before.
        pilot.choose(&mut flight, false);
        pilot.fly(&mut flight, 1.0, |_, _| CENTRED);
        assert_eq!(
            flight.truth().mode,
            NavMode::Position,
            "{pairing:?}: {}",
            reported(&flight)
        );
    }
}

#[test]
fn what_speaks_against_it_is_reported_and_nothing_changes() {
    for pairing in BOTH {
        let (mut flight, mut pilot) =
            AssistedPilot::take_off(pairing, 1, |setup| setup.params.set("CP_DIST", -1.0).unwrap());
        pilot.choose(&mut flight, true);
        pilot.fly(&mut flight, 2.0, |_, _| CENTRED);
        assert_eq!(flight.truth().mode, NavMode::Position);
        assert_eq!(
            reported(&flight),
            "jink: no assisted flight: set CP_DIST",
            "{pairing:?}"
        );
    }
    // Sticks that move would end OFFBOARD.
    let (mut flight, mut pilot) = AssistedPilot::take_off(PX4_CURRENT, 1, |setup| {
        let autopilot = setup.autopilot.clone();
        setup.autopilot = autopilot.with_parameter("MAN_OVERRIDE_SPD", 1.0);
    });
    pilot.choose(&mut flight, true);
    pilot.fly(&mut flight, 2.0, |_, _| CENTRED);
    assert_eq!(flight.truth().mode, NavMode::Position);
    assert_eq!(
        reported(&flight),
        "jink: no assisted flight: set MAN_OVERRIDE_SPD -1"
    );
}
