//! Missions of all kinds of items.

use super::places::{free_near, hidden, inside};
use crate::flight::{Flight, HEIGHT_M, Trouble, height_m};
use crate::mission::{Item, Place};
use mavlink::dialect::MavCmd;

/// Where every mission begins.
pub const START: Place = Place::new(0.0, 0.0, HEIGHT_M);
type Done = Result<(), Trouble>;

/// A take-off where it stands, waypoints, a landing at the last one.
pub fn through(places: &[Place]) -> Vec<Item> {
    let mut items = vec![Item::takeoff(START)];
    items.extend(
        places
            .iter()
            .map(|place| Item::at(MavCmd::MAV_CMD_NAV_WAYPOINT, *place)),
    );
    items.extend(places.last().map(|place| Item::land(place.north_m, place.east_m)));
    items
}

/// One waypoint at the world's goal, and a landing there.
pub fn plain(flight: &mut Flight) -> Done {
    let goal = flight.aim.end;
    flight.fly_mission(&through(&[goal]))
}

/// A goal behind the wall, nearer to it than NAV_ACC_RAD.
pub fn behind_the_wall(flight: &mut Flight) -> Done {
    flight.aim.end = Place::new(18.0, 0.0, HEIGHT_M);
    plain(flight)
}

/// The same without a landing: the mission ends in the air.
pub fn ends_in_the_air(flight: &mut Flight) -> Done {
    let goal = Place::new(18.0, 0.0, HEIGHT_M);
    flight.aim.end = goal;
    let mut items = through(&[goal]);
    items.pop();
    flight.fly_mission(&items)
}

/// A waypoint near the start, a landing behind trees.
pub fn land_elsewhere(flight: &mut Flight) -> Done {
    let first = free_near(&flight.world, 4.0, 0.0);
    let end = hidden(&flight.world, first, 14.0, 26.0)?;
    flight.aim.through = vec![first];
    flight.aim.end = end;
    let items = [
        Item::takeoff(START),
        Item::waypoint(first.north_m, first.east_m, HEIGHT_M),
        Item::land(end.north_m, end.east_m),
    ];
    flight.fly_mission(&items)
}

/// A waypoint, an item of `command` behind trees, a waypoint beyond, a landing there.
fn with_item(flight: &mut Flight, command: MavCmd, params: [f32; 4]) -> Done {
    let first = free_near(&flight.world, 5.0, 0.0);
    let second = hidden(&flight.world, first, 10.0, 22.0)?;
    let end = free_near(&flight.world, second.north_m + 8.0, 0.0);
    flight.aim.through = vec![first, second];
    flight.aim.end = end;
    let items = [
        Item::takeoff(START),
        Item::waypoint(first.north_m, first.east_m, HEIGHT_M),
        Item::at(command, second).with(params),
        Item::waypoint(end.north_m, end.east_m, HEIGHT_M),
        Item::land(end.north_m, end.east_m),
    ];
    flight.fly_mission(&items)
}

/// Loiter for three seconds.
pub fn loiter_time(flight: &mut Flight) -> Done {
    with_item(flight, MavCmd::MAV_CMD_NAV_LOITER_TIME, [3.0, 0.0, 0.0, 0.0])
}

/// Loiter for one turn of 3 m.
pub fn loiter_turns(flight: &mut Flight) -> Done {
    with_item(flight, MavCmd::MAV_CMD_NAV_LOITER_TURNS, [1.0, 0.0, 3.0, 0.0])
}

/// Loiter for ever.
pub fn loiter_unlimited(flight: &mut Flight) -> Done {
    let first = free_near(&flight.world, 5.0, 0.0);
    let end = hidden(&flight.world, first, 10.0, 22.0)?;
    flight.aim.through = vec![first];
    flight.aim.end = end;
    let loiter = Item::at(MavCmd::MAV_CMD_NAV_LOITER_UNLIM, end).with([0.0; 4]);
    flight.fly_mission(&[
        Item::takeoff(START),
        Item::waypoint(first.north_m, first.east_m, HEIGHT_M),
        loiter,
    ])
}

/// A spline waypoint.
pub fn spline(flight: &mut Flight) -> Done {
    with_item(flight, MavCmd::MAV_CMD_NAV_SPLINE_WAYPOINT, [0.0; 4])
}

/// A take-off item that lies behind trees.
pub fn takeoff_elsewhere(flight: &mut Flight) -> Done {
    let there = hidden(&flight.world, START, 9.0, 22.0)?;
    let end = free_near(&flight.world, there.north_m + 8.0, 0.0);
    flight.aim.end = end;
    let items = [
        Item::takeoff(Place { up_m: 4.0, ..there }),
        Item::waypoint(end.north_m, end.east_m, HEIGHT_M),
        Item::land(end.north_m, end.east_m),
    ];
    flight.fly_mission(&items)
}

/// A landing sequence that is marked as such.
pub fn land_start(flight: &mut Flight) -> Done {
    let (first, end) = (
        free_near(&flight.world, 10.0, 0.0),
        free_near(&flight.world, 22.0, 0.0),
    );
    flight.aim.through = vec![first];
    flight.aim.end = end;
    let items = [
        Item::takeoff(START),
        Item::waypoint(first.north_m, first.east_m, HEIGHT_M),
        Item::bare(MavCmd::MAV_CMD_DO_LAND_START, [0.0; 4]),
        Item::waypoint(end.north_m, end.east_m, HEIGHT_M),
        Item::land(end.north_m, end.east_m),
    ];
    flight.fly_mission(&items)
}

/// Two waypoints flown twice.
pub fn jump(flight: &mut Flight) -> Done {
    let (first, second) = (
        free_near(&flight.world, 8.0, 0.0),
        free_near(&flight.world, 20.0, 0.0),
    );
    flight.aim.through = vec![first, second, first, second];
    flight.aim.end = second;
    let target = f32::from(flight.items_before_waypoints());
    let items = [
        Item::takeoff(START),
        Item::waypoint(first.north_m, first.east_m, HEIGHT_M),
        Item::waypoint(second.north_m, second.east_m, HEIGHT_M),
        Item::bare(MavCmd::MAV_CMD_DO_JUMP, [target, 1.0, 0.0, 0.0]),
        Item::land(second.north_m, second.east_m),
    ];
    flight.fly_mission(&items)
}

/// A waypoint that cannot be reached, and one behind it. The mark is when it is near, or when a vehicle that climbs first, as a PX4
/// that flies its mission itself does, rests below it.
fn out_of_reach(flight: &mut Flight, place: Place) -> Done {
    let end = free_near(&flight.world, 30.0, 0.0);
    flight.aim.end = end;
    flight.fly_mission(&through(&[place, end]))?;
    flight.wait("nearness of the waypoint", 40.0, |record| {
        let is_near = record
            .last()
            .is_some_and(|truth| place.level_distance_m(truth.place) < 5.0);
        is_near || height_m(record) > 2.0 * HEIGHT_M && record.rests(2.0, 0.3)
    })?;
    flight.mark();
    Ok(())
}

/// A waypoint inside a trunk or a wall.
pub fn inside_obstacle(flight: &mut Flight) -> Done {
    let place = inside(&flight.world);
    out_of_reach(flight, place)
}

/// A waypoint below the ground.
pub fn below_ground(flight: &mut Flight) -> Done {
    let place = free_near(&flight.world, 12.0, 0.0);
    out_of_reach(flight, Place { up_m: -3.0, ..place })
}

/// A waypoint above OA_ALT_MAX.
pub fn above_ceiling(flight: &mut Flight) -> Done {
    let place = free_near(&flight.world, 12.0, 0.0);
    out_of_reach(flight, Place { up_m: 14.0, ..place })
}
