//! The programs that an aircraft needs, by name ([`jink_runtime::programs`]).

use jink_runtime::config::sensor_table::{SensorTable, Told};
use jink_runtime::device::{self, Driver};
use jink_runtime::run;
use std::process::ExitCode;

/// The `main` of the program called `name`; `None` for the command itself.
pub fn named(name: &str) -> Option<fn() -> ExitCode> {
    Some(match name {
        "jink-supervisor" => jink_supervisor::program::main,
        "jink-obstacle-fusion" => run::<jink_obstacle_fusion::FusionService>,
        "jink-planner" => run::<jink_planner::PlannerService>,
        "jink-bezier-generator" => run::<jink_bezier_generator::GeneratorService>,
        "jink-collision-guard" => run::<jink_collision_guard::GuardService>,
        "jink-mavlink-gateway" => run::<jink_mavlink_gateway::GatewayService>,
        "jink-parameter-server" => run::<jink_parameter_server::ParameterService>,
        "jink-ground-services" => run::<jink_ground_services::GroundServicesService>,
        "jink-recorder" => run::<jink_recorder::RecorderService>,
        "jink-viewer" => run::<jink_viewer::ViewerService>,
        "jink-rangefinder-driver" => device::run::<jink_rangefinder_driver::RangefinderService>,
        "jink-depth-driver" => device::run::<jink_depth_driver::DepthCameraService>,
        "jink-lidar-driver" => device::run::<jink_lidar_driver::LidarService>,
        "jink-link-check" => || jink_link_check::run(&arguments()),
        _ => return None,
    })
}

/// Whether the table of the sensor of this name is right ([`Driver::check`]).
pub type SensorCheck = fn(&[SensorTable], &str) -> Result<(), Told>;

/// The check of a sensor's table by the driver called `name`; `None` if jink has no such driver.
pub fn sensor_check(name: &str) -> Option<SensorCheck> {
    Some(match name {
        "jink-rangefinder-driver" => jink_rangefinder_driver::RangefinderService::check,
        "jink-depth-driver" => jink_depth_driver::DepthCameraService::check,
        "jink-lidar-driver" => jink_lidar_driver::LidarService::check,
        _ => return None,
    })
}

fn arguments() -> Vec<String> {
    std::env::args().skip(1).collect()
}

#[cfg(test)]
mod tests {
    use super::named;
    use jink_runtime::programs::IN_JINK;

    #[test]
    fn every_program_of_an_aircraft_is_in_it() {
        assert!(IN_JINK.into_iter().all(|name| named(name).is_some()));
        assert!(named("jink").is_none());
    }
}
