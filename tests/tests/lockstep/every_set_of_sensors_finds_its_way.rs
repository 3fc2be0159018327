//! Flights that once ended before their goal: each with the sensors and the place that it took.

use jink_simulated_world::world::WorldKind;
use jink_tests::campaign::{Cell, FlightOutcome, fly, sensor_set};

/// Flies `seed` in `world` with `sensors`.
fn reaches_its_goal(sensors: &str, world: &str, seed: u64) {
    let kind: WorldKind = world.parse().unwrap();
    let mut cell = Cell::of(kind).unwrap();
    cell.sensors = sensor_set(sensors).unwrap();
    let flight = fly(&cell, seed).unwrap();
    assert_eq!(flight.outcome, FlightOutcome::Goal, "{flight:?}");
    assert_eq!(flight.collisions, 0, "{flight:?}");
}

/// The way past the end of the wall looked nearer whenever the vehicle was too fast for the gap.
#[test]
fn a_gap_is_slowed_down_for_rather_than_left() {
    reaches_its_goal("rplidar", "gap", 6);
}

/// The way led along a diagonal past the corner of a cell that is not known to be free.
#[test]
fn a_way_past_a_corner_of_the_unknown_is_flown() {
    reaches_its_goal("mid360", "corridor", 6);
}

/// The lamps, the furniture and the walls leave 1.3 m here and there.
#[test]
fn the_corridor_of_a_building_is_flown_through() {
    reaches_its_goal("mid360", "building", 3);
}

/// The vehicle looked again and again for a faster way than the one that it had.
#[test]
fn a_slow_way_is_taken_where_looks_show_no_faster_one() {
    reaches_its_goal("mid360", "corridor", 1);
}

/// It turned to one side and to the other for ever: half a turn takes longer than a look is remembered, and a turn toward the way to
/// a look did not count as one.
#[test]
fn turning_to_and_fro_is_looking_and_ends() {
    reaches_its_goal("d435", "forest", 39);
    reaches_its_goal("mid360", "corridor", 39);
}
