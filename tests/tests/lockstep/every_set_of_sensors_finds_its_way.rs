//! Flights that once ended before their goal: each with the sensors and the place that it took.

use jink_simulated_world::world::WorldKind;
use jink_tests::campaign::{Cell, FlightOutcome, fly, sensor_set};
use jink_tests::flights::Flights;

/// Flies `seed` in `world` with `sensors`.
fn reaches_its_goal(sensors: &str, world: &str, seed: u64) {
    let kind: WorldKind = world.parse().unwrap();
    let mut cell = Cell::of(kind).unwrap();
    cell.sensors = sensor_set(sensors).unwrap();
    let flight = fly(&cell, seed).unwrap();
    assert_eq!(flight.outcome, FlightOutcome::Goal, "{flight:?}");
    assert_eq!(flight.collisions, 0, "{flight:?}");
}

/// Each with why it once did not.
pub fn flights() -> Flights {
    let mut flights = Flights::new();
    let mut add = |in_every_run, sensors: &'static str, world: &'static str, seed| {
        let name = format!("{sensors} {world} {seed}");
        flights.add(&name, in_every_run, move || {
            reaches_its_goal(sensors, world, seed);
        });
    };
    // The way past the end of the wall looked nearer whenever the vehicle was too fast for the gap.
    add(false, "rplidar", "gap", 6);
    // The way led along a diagonal past the corner of a cell that is not known to be free.
    add(false, "mid360", "corridor", 6);
    // The lamps, the furniture and the walls leave 1.3 m here and there.
    add(false, "mid360", "building", 3);
    // The vehicle looked again and again for a faster way than the one that it had.
    add(false, "mid360", "corridor", 1);
    // It turned to one side and to the other for ever: half a turn takes longer than a look is remembered, and a turn toward the way
    // to a look did not count as one.
    add(true, "d435", "forest", 39);
    // With nothing but the ground in range the take-off was refused, or never began: a frame may be without a single answer.
    add(true, "mid360", "empty", 1);
    add(true, "mid360", "empty", 2);
    add(true, "vlp16", "empty", 1);
    add(true, "d435", "empty", 1);
    add(false, "mid360", "corridor", 39);
    flights
}

#[test]
fn whatever_once_kept_it_from_there() {
    flights().fly_some();
}
