//! The gateway as a process.

fn main() -> std::process::ExitCode {
    jink_runtime::run::<jink_mavlink_gateway::GatewayService>()
}
