//! The gateway as a process; as a tool, the examination of the links before the flight.

use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let Some((_, rest)) = arguments.split_first().filter(|(first, _)| *first == "check") {
        return jink_mavlink_gateway::check::run(rest);
    }
    jink_runtime::run::<jink_mavlink_gateway::GatewayService>()
}
