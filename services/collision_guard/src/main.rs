//! The guard as a process.

use std::process::ExitCode;

fn main() -> ExitCode {
    jink_runtime::run::<jink_collision_guard::GuardService>()
}
