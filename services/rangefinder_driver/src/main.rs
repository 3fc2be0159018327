//! A rangefinder as a process.

use std::process::ExitCode;

fn main() -> ExitCode {
    jink_runtime::run::<jink_rangefinder_driver::RangefinderService>()
}
