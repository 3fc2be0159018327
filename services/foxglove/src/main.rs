//! `jink-foxglove`: flights in [Foxglove](https://foxglove.dev), and in whatever else reads its schemas.
//!
//! | command | in | out |
//! |---|---|---|
//! | `live` | the topics of a running instance, as a spectator | Foxglove's WebSocket protocol |
//! | `convert` | a recording | an MCAP file |
//!
//! Both show the same: [`views`] says what of which sample.

mod convert;
mod frames;
mod live;
mod numbers;
mod views;

use clap::{Parser, Subcommand};
use jink_control::arguments;
use std::process::ExitCode;

/// Flights in Foxglove
#[derive(Debug, Parser)]
#[command(
    name = "jink-foxglove",
    version,
    propagate_version = true,
    arg_required_else_help = true
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Serve the flight of a running instance
    Live(live::Args),
    /// Write the views of a recording into a new file
    Convert(convert::Args),
}

fn main() -> ExitCode {
    jink_runtime::descriptors::reserve();
    let cli: Cli = arguments::parse();
    let level = match cli.command {
        Command::Live(_) => tracing::Level::WARN,
        // What goes wrong ends it, and is said then.
        Command::Convert(_) => tracing::Level::ERROR,
    };
    jink_runtime::logging::init("jink-foxglove", level);
    let outcome = match cli.command {
        Command::Live(args) => live::run(&args),
        Command::Convert(args) => convert::run(&args),
    };
    outcome.unwrap_or_else(|problem| {
        eprintln!("jink-foxglove: {problem}");
        ExitCode::from(problem.exit_code())
    })
}
