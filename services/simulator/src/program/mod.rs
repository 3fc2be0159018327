//! The program `jink-simulator`: the simulator's processes and tools.
//!
//! As a service, started by the supervisor, it plays one of two roles (the argument behind `--`):
//! `vehicle` is the world, the vehicle and its autopilot, which speaks MAVLink over UDP; `sensors` renders the
//! configured sensors around the vehicle's true pose, or, as `sensors external`, around somebody else's vehicle, whose
//! pose comes from `vehicle/state`. With `simulation.sitl` the vehicle's autopilot is a real one in simulation. As a tool,
//! `jink-simulator world` prints a world, `jink-simulator check` what is wrong with a configuration, `jink-simulator sitl` what a
//! build of an autopilot offers, and `jink-simulator fly` is a ground station that flies a mission.

mod check;
mod fly;
mod sitl;
mod sitl_vehicle;
mod world;

use crate::service::{SensorService, VehicleService};
use jink_runtime::{Cycle, Ports, Service, StartError, Wake};
use std::os::fd::BorrowedFd;
use std::process::ExitCode;

/// The vehicle with whichever autopilot the configuration names.
enum Vehicle {
    /// An emulated one, in this process.
    Emulated(Box<VehicleService>),
    /// Somebody's build of a real one.
    Sitl(Box<sitl_vehicle::SitlVehicle>),
}

impl Service for Vehicle {
    const PROGRAM: &'static str = "simulator";
    const REPLAYS: bool = false;

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        Ok(match ports.config().simulation.sitl.is_empty() {
            true => Self::Emulated(Box::new(VehicleService::open(ports)?)),
            false => Self::Sitl(Box::new(sitl_vehicle::SitlVehicle::open(ports)?)),
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        match self {
            Self::Emulated(vehicle) => vehicle.cycle(cycle),
            Self::Sitl(vehicle) => vehicle.cycle(cycle),
        }
    }

    fn watched(&self) -> [Option<BorrowedFd<'_>>; jink_runtime::service::WATCHED_FDS] {
        match self {
            Self::Emulated(vehicle) => vehicle.watched(),
            Self::Sitl(vehicle) => vehicle.watched(),
        }
    }
}

/// Runs the role or the tool that the command line names.
pub fn main() -> ExitCode {
    jink_runtime::descriptors::reserve();
    let arguments: Vec<String> = std::env::args().collect();
    match arguments.get(1).map(String::as_str) {
        Some("check") => return check::run(),
        Some("world") => return world::run(),
        Some("fly") => return fly::run(),
        Some("sitl") => return sitl::run(),
        _ => {}
    }
    let role = arguments
        .iter()
        .position(|argument| argument == "--")
        .and_then(|at| arguments.get(at + 1));
    match role.map(String::as_str) {
        Some("vehicle") => jink_runtime::run::<Vehicle>(),
        Some("sensors") => jink_runtime::run::<SensorService>(),
        other => {
            eprintln!(
                "jink-simulator: {}: expected a tool (check, world, sitl, fly) or, behind --, a role (vehicle, sensors)",
                other.map_or("no role".to_owned(), |role| format!("unknown role {role:?}"))
            );
            ExitCode::from(jink_runtime::service::EXIT_CANNOT_START)
        }
    }
}
