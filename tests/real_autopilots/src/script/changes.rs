//! Missions that somebody changes in flight.

use super::missions::{START, plain, through};
use super::places::{free_near, hidden};
use crate::flight::{Flight, HEIGHT_M, Trouble};
use crate::mission::{Item, Place};
use jink_shared_types::vehicle::NavMode;

type Done = Result<(), Trouble>;

/// On its way to the goal, fast.
fn under_way(flight: &mut Flight) -> Result<Place, Trouble> {
    plain(flight)?;
    flight.wait_cruise(2.0, 8.0)?;
    Ok(flight.place())
}

/// Uploads a mission that begins as the one under way does.
fn upload_in_flight(flight: &Flight, items: &[Item]) -> Done {
    let has_takeoff = flight.items_before_waypoints() > 0;
    flight.upload(if has_takeoff { items } else { &items[1..] })
}

/// Another mission of as many items.
pub fn same_length(flight: &mut Flight) -> Done {
    let here = under_way(flight)?;
    flight.aim.never = vec![flight.aim.end];
    flight.aim.end = hidden(&flight.world, here, 8.0, 20.0)?;
    flight.mark();
    upload_in_flight(flight, &through(&[flight.aim.end]))
}

/// Another mission of one item more.
pub fn other_length(flight: &mut Flight) -> Done {
    let here = under_way(flight)?;
    flight.aim.never = vec![flight.aim.end];
    let end = hidden(&flight.world, here, 8.0, 16.0)?;
    let beyond = free_near(&flight.world, end.north_m + 6.0, 0.0);
    flight.aim.end = beyond;
    flight.mark();
    upload_in_flight(flight, &through(&[end, beyond]))
}

/// The mission is removed.
pub fn cleared(flight: &mut Flight) -> Done {
    under_way(flight)?;
    flight.aim.never = vec![flight.aim.end];
    flight.mark();
    flight.station.expect_mode_change();
    match flight.station.clear_mission() {
        Some(0) => Ok(()),
        other => Err(Trouble::Refused {
            what: "clearing the mission".to_owned(),
            answer: format!("{other:?}"),
        }),
    }
}

/// The station makes the third waypoint current on the way to the first; the second lies aside.
pub fn current_set(flight: &mut Flight) -> Done {
    let first = free_near(&flight.world, 20.0, 0.0);
    let aside = free_near(&flight.world, 28.0, 10.0);
    let end = free_near(&flight.world, 36.0, 0.0);
    flight.aim.end = end;
    flight.aim.never = vec![aside];
    flight.fly_mission(&through(&[first, aside, end]))?;
    flight.wait_cruise(2.0, 6.0)?;
    flight.mark();
    flight.station.set_current(flight.items_before_waypoints() + 2);
    Ok(())
}

/// The pilot holds and chooses the mission again.
pub fn resumed(flight: &mut Flight) -> Done {
    under_way(flight)?;
    flight.mode(NavMode::Hold)?;
    flight.watch(5.0)?;
    flight.mode(NavMode::Mission)
}

/// Two waypoints and a landing, where the autopilot begins missions anew (MIS_RESTART).
pub fn begins_anew(flight: &mut Flight) -> Done {
    let end = free_near(&flight.world, 20.0, 0.0);
    flight.aim.end = end;
    let items = [
        Item::takeoff(START),
        Item::waypoint(8.0, 0.0, HEIGHT_M),
        Item::waypoint(end.north_m, end.east_m, HEIGHT_M),
        Item::land(end.north_m, end.east_m),
    ];
    flight.fly_mission(&items)
}

/// A second station comes in flight: it fetches the mission and asks for parameters.
pub fn second_station(flight: &mut Flight) -> Done {
    use mavlink::dialect::{MISSION_REQUEST_LIST_DATA, MavMessage, PARAM_REQUEST_LIST_DATA};
    under_way(flight)?;
    let target_system = 1;
    for message in [
        MavMessage::MISSION_REQUEST_LIST(MISSION_REQUEST_LIST_DATA {
            target_system,
            target_component: 1,
            ..Default::default()
        }),
        MavMessage::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA {
            target_system: 0,
            target_component: 0,
        }),
    ] {
        flight.station.say_as(250, message);
        flight.watch(0.5)?;
    }
    Ok(())
}
