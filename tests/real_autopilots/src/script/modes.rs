//! Modes that somebody chooses, go-tos, returns, landings.

use super::missions::{START, plain, through};
use super::places::{free_near, hidden};
use crate::flight::{Flight, HEIGHT_M, Trouble, height_m};
use crate::mission::Place;
use jink_emulated_ground_station::Make;
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::{MavCmd, MavResult};

type Done = Result<(), Trouble>;

fn granted(what: &str, answer: Option<MavResult>) -> Done {
    if answer == Some(MavResult::MAV_RESULT_ACCEPTED) {
        return Ok(());
    }
    Err(Trouble::Refused {
        what: what.to_owned(),
        answer: format!("{answer:?}"),
    })
}

/// A click on the map behind trees, from where it is.
fn go_to_hidden(flight: &mut Flight, near_m: f64, far_m: f64) -> Done {
    let place = hidden(&flight.world, flight.place(), near_m, far_m)?;
    flight.aim.end = place;
    flight.mark();
    granted("go-to", flight.station.go_to(&flight.anchor()?, place))
}

/// Take-off, then a go-to from the hover.
pub fn go_to(flight: &mut Flight) -> Done {
    flight.take_off()?;
    go_to_hidden(flight, 14.0, 26.0)
}

/// The same while jink flies something else. ArduCopter shows it until the next setpoint only, so it may be overlooked; then the pilot
/// clicks again, as docs/missions.md says.
fn go_to_hidden_in_motion(flight: &mut Flight, near_m: f64, far_m: f64) -> Done {
    const CLICKS: u32 = 5;
    go_to_hidden(flight, near_m, far_m)?;
    let (place, marked_s) = (flight.aim.end, flight.aim.marked_s);
    for _ in 1..CLICKS {
        flight.watch(1.0)?;
        let is_taken = flight
            .record
            .lock()
            .texts
            .iter()
            .any(|text| text.at_s >= marked_s && text.text.contains("go-to"));
        if is_taken {
            break;
        }
        granted("go-to", flight.station.go_to(&flight.anchor()?, place))?;
    }
    Ok(())
}

/// A go-to in the middle of a mission that jink flies.
pub fn go_to_in_mission(flight: &mut Flight) -> Done {
    plain(flight)?;
    flight.wait_cruise(2.0, 8.0)?;
    go_to_hidden_in_motion(flight, 10.0, 22.0)
}

/// A second go-to replaces the first on its way.
pub fn go_to_twice(flight: &mut Flight) -> Done {
    go_to(flight)?;
    flight.wait("speed on the way", 20.0, |record| {
        record.last().is_some_and(|truth| truth.speed_mps() > 1.5)
    })?;
    go_to_hidden_in_motion(flight, 8.0, 20.0)
}

/// Another program beside jink sends a position.
pub fn other_position_target(flight: &mut Flight) -> Done {
    flight.take_off()?;
    if flight.make() == Make::Px4 {
        flight.mode(NavMode::Offboard)?;
    }
    flight.watch(2.0)?;
    let place = hidden(&flight.world, flight.place(), 12.0, 24.0)?;
    flight.aim.end = place;
    flight.mark();
    flight.station.set_position_target(250, place);
    Ok(())
}

/// Hold in the middle of a mission.
pub fn hold_at_speed(flight: &mut Flight) -> Done {
    plain(flight)?;
    flight.wait_cruise(2.7, 10.0)?;
    flight.mark();
    flight.mode(NavMode::Hold)
}

/// A circle around a place behind trees.
pub fn orbit(flight: &mut Flight) -> Done {
    flight.take_off()?;
    let centre = hidden(&flight.world, flight.place(), 12.0, 24.0)?;
    flight.aim.end = centre;
    flight.mark();
    flight.station.expect_mode_change();
    let anchor = flight.anchor()?;
    // What is refused is refused: then it stays where it is.
    let _refused = flight
        .station
        .command_at(&anchor, MavCmd::MAV_CMD_DO_ORBIT, [5.0, 2.0, 0.0, 0.0], centre);
    Ok(())
}

/// ArduCopter's CIRCLE, out of a mission between trees.
pub fn circle(flight: &mut Flight) -> Done {
    const CIRCLE: f32 = 7.0;
    plain(flight)?;
    flight.wait_cruise(2.0, 10.0)?;
    flight.mark();
    flight.station.expect_mode_change();
    let answer = flight.station.command(
        MavCmd::MAV_CMD_DO_SET_MODE,
        [1.0, CIRCLE, 0.0, 0.0, 0.0, 0.0, 0.0],
    );
    granted("CIRCLE", answer)
}

/// Flies 25 m and rests there in the air.
fn go_out(flight: &mut Flight) -> Done {
    let far = free_near(&flight.world, 25.0, 0.0);
    flight.aim.end = far;
    flight.fly_mission(&through(&[far])[..2])?;
    flight.wait("the far end", 60.0, |record| {
        record
            .last()
            .is_some_and(|truth| far.level_distance_m(truth.place) < 2.5 && truth.speed_mps() < 1.0)
    })
}

/// Return from behind the trees.
pub fn return_home(flight: &mut Flight) -> Done {
    go_out(flight)?;
    flight.aim.end = START;
    flight.mark();
    flight.mode(NavMode::Return)
}

/// The same to a rally point that is nearer than home.
pub fn return_to_rally(flight: &mut Flight) -> Done {
    let rally = free_near(&flight.world, 18.0, 6.0);
    flight.wait_active()?;
    flight.station.upload_rally(&flight.anchor()?, &[rally]);
    go_out(flight)?;
    flight.aim.end = rally;
    flight.mark();
    flight.mode(NavMode::Return)
}

/// Land in the middle of a mission.
pub fn land_here(flight: &mut Flight) -> Done {
    plain(flight)?;
    super::places::wait_free_ahead(flight, 2.0, 6.0)?;
    let here = flight.place();
    flight.aim.end = Place::new(here.north_m + 2.0, here.east_m, 0.0);
    flight.mark();
    flight.mode(NavMode::Land)
}

/// The setpoint mode is chosen on the ground, with nothing to fly to.
pub fn setpoint_mode_on_the_ground(flight: &mut Flight) -> Done {
    flight.wait_active()?;
    flight.aim.unsaid = vec!["ignores setpoints"];
    // Nobody chooses a mode in the moment in which it becomes possible: the stream begins with ACTIVE, and PX4 needs some of it.
    flight.watch(0.5)?;
    flight.mark();
    flight.mode(NavMode::Offboard)
}

/// The same in the air without a mission on board.
pub fn setpoint_mode_in_the_air(flight: &mut Flight) -> Done {
    flight.take_off()?;
    if flight.make() == Make::ArduCopter {
        flight.mode(NavMode::Hold)?;
        flight.watch(2.0)?;
    }
    flight.mark();
    flight.mode(NavMode::Offboard)
}

/// Take-off in GUIDED as soon as jink says ACTIVE, without a mission.
pub fn guided_take_off(flight: &mut Flight) -> Done {
    flight.take_off()?;
    let begin_m = height_m(&flight.record.lock());
    flight.watch(4.0)?;
    let end_m = height_m(&flight.record.lock());
    if end_m > begin_m - 0.6 {
        return Ok(());
    }
    Err(Trouble::Refused {
        what: "resting at the take-off height".to_owned(),
        answer: format!("sank from {begin_m:.1} to {end_m:.1} m"),
    })
}

/// The same with a mission on board that nobody has started.
pub fn guided_take_off_with_mission(flight: &mut Flight) -> Done {
    flight.wait_active()?;
    let goal = flight.aim.end;
    flight.upload(&through(&[goal]))?;
    flight.aim.never = vec![goal];
    guided_take_off(flight)
}

/// The gateway dies two seconds after NAV_TAKEOFF.
pub fn guided_take_off_without_gateway(flight: &mut Flight) -> Done {
    flight.wait_active()?;
    flight.arm_in(NavMode::Offboard)?;
    flight.command_take_off()?;
    flight.watch(2.0)?;
    flight.jink.kill("mavlink_gateway");
    flight.mark();
    flight.wait("hover after take-off", 30.0, |record| {
        height_m(record) > 0.85 * HEIGHT_M && record.rests(1.0, 0.3)
    })
}

/// Far from home, without a mission, the setpoint mode is chosen once more.
pub fn item_home(flight: &mut Flight) -> Done {
    flight.take_off()?;
    let far = free_near(&flight.world, 12.0, 0.0);
    flight.aim.end = far;
    granted("go-to", flight.station.go_to(&flight.anchor()?, far))?;
    flight.wait("the far end", 40.0, |record| {
        record
            .last()
            .is_some_and(|truth| far.level_distance_m(truth.place) < 1.5)
            && record.rests(2.0, 0.3)
    })?;
    flight.mode(NavMode::Hold)?;
    flight.watch(2.0)?;
    flight.mark();
    flight.mode(NavMode::Offboard)
}

/// The mission mode is chosen while jink flies the mission.
pub fn mission_from_setpoint_mode(flight: &mut Flight) -> Done {
    plain(flight)?;
    flight.wait_mode(NavMode::Offboard, 30.0)?;
    flight.wait_cruise(2.0, 8.0)?;
    flight.mark();
    flight.mode(NavMode::Mission)
}

/// The mission is started while jink runs with a profile that does not fit the firmware.
pub fn wrong_profile(flight: &mut Flight) -> Done {
    flight.mark();
    let never = flight.wait("ACTIVE", 12.0, |record| record.is_active());
    if never.is_ok() {
        return Err(Trouble::Refused {
            what: "staying inactive".to_owned(),
            answer: "component 196 says ACTIVE".to_owned(),
        });
    }
    Ok(())
}
