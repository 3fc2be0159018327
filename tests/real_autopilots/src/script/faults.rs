//! Processes killed, links cut, programs restarted.

use super::missions::plain;
use super::places::wait_free_ahead;
use crate::flight::{Flight, Trouble};
use jink_shared_types::vehicle::NavMode;

type Done = Result<(), Trouble>;

/// The services of the process table that fly.
pub const SERVICES: [&str; 6] = [
    "mavlink_gateway",
    "collision_guard",
    "bezier_generator",
    "planner",
    "obstacle_fusion",
    "sensors",
];

fn kill(flight: &Flight, service: &str) -> Done {
    if flight.jink.kill(service) {
        return Ok(());
    }
    Err(Trouble::Start(format!(
        "there is no process {service} to be killed"
    )))
}

/// One service dies twice in flight.
pub fn killed<const SERVICE: usize>(flight: &mut Flight) -> Done {
    plain(flight)?;
    for north_m in [8.0, 20.0] {
        flight.wait_cruise(1.5, north_m)?;
        kill(flight, SERVICES[SERVICE])?;
    }
    Ok(())
}

/// All of them die in one flight, one after the other.
pub fn all_killed(flight: &mut Flight) -> Done {
    plain(flight)?;
    flight.wait_cruise(1.5, 4.0)?;
    for service in SERVICES {
        kill(flight, service)?;
        flight.watch(2.5)?;
    }
    Ok(())
}

/// The line between autopilot and jink is dead for so many tenths of a second. Where the autopilot stays in Hold by its own
/// decision, the pilot chooses the mission again.
pub fn cut<const TENTHS: u32>(flight: &mut Flight) -> Done {
    plain(flight)?;
    wait_free_ahead(flight, 2.5, 8.0)?;
    flight.relay.set_cut(true);
    flight.watch(0.1 * f64::from(TENTHS))?;
    flight.relay.set_cut(false);
    if flight.setup.has_setpoint_mode() || TENTHS < 8 {
        return Ok(());
    }
    flight.wait_mode(NavMode::Hold, 5.0)?;
    flight.wait_active()?;
    flight.watch(2.0)?;
    flight.mode(NavMode::Mission)
}

/// `jink down` in flight, `jink up` six seconds later; then the pilot chooses the mission again.
pub fn down_and_up(flight: &mut Flight) -> Done {
    plain(flight)?;
    wait_free_ahead(flight, 2.5, 9.0)?;
    let since_s = flight.record.lock().now_s();
    flight.jink_down();
    flight.watch(6.0)?;
    flight.jink.up().map_err(Trouble::Start)?;
    flight.wait_active()?;
    let mut record = flight.record.lock();
    let now_s = record.now_s();
    record.silences_s.push((since_s, now_s));
    drop(record);
    flight.watch(2.0)?;
    flight.mode(NavMode::Mission)
}

/// The autopilot is reset on the ground before the flight.
pub fn autopilot_restarted(flight: &mut Flight) -> Done {
    flight.wait_active()?;
    flight.autopilot.restart().map_err(Trouble::Start)?;
    flight.record.lock().global = None;
    flight.wait("loss of the autopilot", 20.0, |record| !record.is_active())?;
    flight.wait("position after the restart", 90.0, |record| {
        record.global.is_some() && record.is_active()
    })?;
    plain(flight)
}
