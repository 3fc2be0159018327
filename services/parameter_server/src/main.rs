//! The parameter server as a process.

use std::process::ExitCode;

fn main() -> ExitCode {
    jink_runtime::run::<jink_parameter_server::ParameterService>()
}
