//! Obstacle fusion as a process.

use std::process::ExitCode;

fn main() -> ExitCode {
    jink_runtime::run::<jink_obstacle_fusion::FusionService>()
}
