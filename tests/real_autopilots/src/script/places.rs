//! Places in the world that make a situation.

use crate::flight::{Flight, HEIGHT_M, Trouble};
use crate::mission::Place;
use jink_shared_types::frames::Point;
use jink_simulated_world::world::World;

/// Room that a place needs for a vehicle to come to it (m).
const ROOM_M: f64 = 1.4;
/// The straight line there comes so near to a trunk's surface, or into it, that flying it is a collision (m).
const BLOCKED_M: f64 = 0.15;
/// Step along a line (m).
const STEP_M: f64 = 0.1;

/// Least clearance on the straight line (m).
fn line_clearance_m(world: &World, from: Place, to: Place) -> f64 {
    let (north_m, east_m) = (to.north_m - from.north_m, to.east_m - from.east_m);
    let steps = (north_m.hypot(east_m) / STEP_M).ceil().max(1.0);
    (0..=steps as u32)
        .map(|step| {
            let share = f64::from(step) / steps;
            let point = Point::new(
                from.north_m + share * north_m,
                from.east_m + share * east_m,
                -HEIGHT_M,
            );
            world.clearance_to_obstacles_m(point)
        })
        .fold(f64::INFINITY, f64::min)
}

fn clearance_m(world: &World, place: Place) -> f64 {
    world.clearance_to_obstacles_m(Point::new(place.north_m, place.east_m, -HEIGHT_M))
}

/// Candidates around `from`, so far to the north at least and at most, the nearest to the axis first.
fn ahead(from: Place, near_m: f64, far_m: f64) -> impl Iterator<Item = Place> {
    let steps = ((far_m - near_m) / 0.5) as u32;
    let norths = (0..=steps).map(move |step| from.north_m + far_m - 0.5 * f64::from(step));
    norths.flat_map(|north_m| {
        (0..20).flat_map(move |step| {
            let east_m = 0.5 * f64::from(step);
            [
                Place::new(north_m, east_m, HEIGHT_M),
                Place::new(north_m, -east_m, HEIGHT_M),
            ]
        })
    })
}

/// A place with room, `near_m` to `far_m` north of `from`, whose straight line from there goes through a trunk or a wall.
pub fn hidden(world: &World, from: Place, near_m: f64, far_m: f64) -> Result<Place, Trouble> {
    ahead(from, near_m, far_m)
        .find(|place| {
            clearance_m(world, *place) > ROOM_M && line_clearance_m(world, from, *place) < BLOCKED_M
        })
        .ok_or_else(|| {
            Trouble::Start(format!(
                "no place {near_m} to {far_m} m ahead is behind an obstacle"
            ))
        })
}

/// The place with room that is nearest to one.
pub fn free_near(world: &World, north_m: f64, east_m: f64) -> Place {
    let mut best = Place::new(north_m, east_m, HEIGHT_M);
    let mut nearest_m = f64::INFINITY;
    for north_step in -8..=8 {
        for east_step in -8..=8 {
            let place = Place::new(
                north_m + 0.5 * f64::from(north_step),
                east_m + 0.5 * f64::from(east_step),
                HEIGHT_M,
            );
            let from_m = (place.north_m - north_m).hypot(place.east_m - east_m);
            if from_m < nearest_m && clearance_m(world, place) > ROOM_M {
                (best, nearest_m) = (place, from_m);
            }
        }
    }
    best
}

/// A place inside an obstacle, 12 to 25 m north of the start: where the clearance is least.
pub fn inside(world: &World) -> Place {
    let places = ahead(Place::new(0.0, 0.0, HEIGHT_M), 12.0, 25.0);
    places
        .min_by(|a, b| clearance_m(world, *a).total_cmp(&clearance_m(world, *b)))
        .unwrap_or(Place::new(15.0, 0.0, HEIGHT_M))
}

/// Waits until it flies fast with `free_m` of open way in the direction of its velocity.
///
/// # Errors
/// As [`Flight::wait`].
pub fn wait_free_ahead(flight: &Flight, speed_mps: f64, free_m: f64) -> Result<(), Trouble> {
    let world = &flight.world;
    flight.wait(
        &format!("{free_m} m of open way at {speed_mps} m/s"),
        40.0,
        |record| {
            record.last().is_some_and(|truth| {
                let speed = truth.speed_mps();
                let from = Place::new(truth.place.x_m, truth.place.y_m, HEIGHT_M);
                let to = Place::new(
                    from.north_m + free_m * truth.velocity_mps.x / speed.max(0.1),
                    from.east_m + free_m * truth.velocity_mps.y / speed.max(0.1),
                    HEIGHT_M,
                );
                speed > speed_mps && line_clearance_m(world, from, to) > 0.7
            })
        },
    )
}
