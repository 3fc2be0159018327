//! The Bezier generator as a process.

use std::process::ExitCode;

fn main() -> ExitCode {
    jink_runtime::run::<jink_bezier_generator::GeneratorService>()
}
