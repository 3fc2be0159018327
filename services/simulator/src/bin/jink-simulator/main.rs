//! The simulator's processes and tools.
//!
//! As a service, started by the supervisor, it plays one of two roles (the argument behind `--`):
//! `vehicle` is the world, the vehicle and its autopilot, which speaks MAVLink over UDP; `sensors` renders the
//! configured sensors around the vehicle's true pose, or, as `sensors external`, around somebody else's vehicle, whose
//! pose comes from `vehicle/state`. As a tool, `jink-simulator world` prints a world, `jink-simulator fly` is a ground
//! station that flies a mission.

mod fly;
mod sensors;
mod settings;
mod udp;
mod vehicle;
mod world;

use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().collect();
    match arguments.get(1).map(String::as_str) {
        Some("world") => return world::run(),
        Some("fly") => return fly::run(),
        _ => {}
    }
    let role = arguments
        .iter()
        .position(|argument| argument == "--")
        .and_then(|at| arguments.get(at + 1));
    match role.map(String::as_str) {
        Some("vehicle") => jink_runtime::run::<vehicle::VehicleService>(),
        Some("sensors") => jink_runtime::run::<sensors::SensorService>(),
        other => {
            eprintln!(
                "jink-simulator: {}: expected a tool (world, fly) or, behind --, a role (vehicle, sensors)",
                other.map_or("no role".to_owned(), |role| format!("unknown role {role:?}"))
            );
            ExitCode::from(jink_runtime::service::EXIT_CANNOT_START)
        }
    }
}
