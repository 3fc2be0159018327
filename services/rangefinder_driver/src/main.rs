//! A rangefinder as a process.

use std::process::ExitCode;

fn main() -> ExitCode {
    jink_runtime::device::run::<jink_rangefinder_driver::RangefinderService>()
}
