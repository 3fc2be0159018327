//! The ground services as a process.

use std::process::ExitCode;

fn main() -> ExitCode {
    jink_runtime::run::<jink_ground_services::GroundServicesService>()
}
