//! `jink-lab`: simulated flights. `jink demo` is this program's `demo`, and so on; started as `jink-simulator` it is the simulator.

mod bench;
mod bench_latency;
mod chaos;
mod demo;

use clap::{Parser, Subcommand};
use jink_control::{DEFAULT_INSTANCE, arguments, beside};
use jink_runtime::{Instance, programs};
use std::process::ExitCode;

/// Simulated flights of jink
#[derive(Debug, Parser)]
#[command(
    name = "jink",
    bin_name = "jink",
    version,
    propagate_version = true,
    arg_required_else_help = true
)]
struct Cli {
    /// Which jink on this host; without it a demonstration takes one of its own
    #[arg(long, global = true, default_value = DEFAULT_INSTANCE)]
    instance: Instance,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Fly a mission in a virtual world
    Demo(demo::Args),
    /// Fly missions with faults at random times
    Chaos(chaos::Args),
    /// Fly many missions in virtual worlds, faster than real time, and count
    Campaign(beside::Args),
    /// Drive a simulated pilot at walls, and plot how near the vehicle comes
    Approach(beside::Args),
    /// Measure this board: how long the way from the sensor to the wire takes, and parts of jink beside what others have
    Bench(bench::Args),
}

fn main() -> ExitCode {
    if programs::own_name() == programs::SIMULATOR {
        return jink_simulator::program::main();
    }
    jink_runtime::descriptors::reserve();
    let cli: Cli = arguments::parse();
    // Also keeps the transport's own messages to what is wrong.
    jink_runtime::logging::init("jink", tracing::Level::ERROR);
    let outcome = match cli.command {
        Command::Demo(args) => demo::run(&cli.instance, &args),
        Command::Chaos(args) => chaos::run(&args),
        // Flown in lock-step, which takes the libraries of all services: programs of their own.
        Command::Campaign(args) => Err(beside::become_program(
            "jink campaign",
            "jink-campaign",
            args.arguments,
        )),
        Command::Approach(args) => Err(beside::become_program(
            "jink approach",
            "jink-approach",
            args.arguments,
        )),
        Command::Bench(args) => bench::run(&args),
    };
    outcome.unwrap_or_else(|problem| {
        eprintln!("jink: {problem}");
        ExitCode::from(problem.exit_code())
    })
}
