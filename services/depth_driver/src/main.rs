//! A depth camera as a process.

use std::process::ExitCode;

fn main() -> ExitCode {
    jink_runtime::device::run::<jink_depth_driver::DepthCameraService>()
}
