//! `jink`: start, stop, look at and try out an obstacle-avoidance system. Started under the name of one of the programs that an
//! aircraft needs, it is that program.

mod cmd;
mod services;

use clap::{Parser, Subcommand};
use jink_control::{DEFAULT_INSTANCE, Problem, beside};
use jink_runtime::{Instance, programs};
use std::ffi::OsString;
use std::process::ExitCode;

/// Obstacle avoidance for multicopters
#[derive(Debug, Parser)]
#[command(version, propagate_version = true, arg_required_else_help = true)]
struct Cli {
    /// Which jink on this host (the demonstration takes one of its own)
    #[arg(long, global = true, default_value = DEFAULT_INSTANCE)]
    instance: Instance,
    #[command(subcommand)]
    command: Command,
}

// Made once per process.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Subcommand)]
enum Command {
    /// Start the system
    Up(cmd::up::Args),
    /// Stop the system
    Down(cmd::down::Args),
    /// Show every service, the health of the whole and the link
    Status(cmd::status::Args),
    /// Show all that live: services, hops, rates, events
    Top(cmd::top::Args),
    /// Show what the guard sees around the vehicle, or have it plotted
    Ring(cmd::ring::Args),
    /// List topics, measure their rates, show what they say
    Topic(cmd::topic::Args),
    /// Show what topics carry, also as a C header, a Python module or JSON
    Schema(cmd::schema::Args),
    /// Show parameters, and change them while jink runs
    Param(cmd::param::Args),
    /// Examine before the flight: the link to the autopilot, the sensors, shared memory
    Check(cmd::check::Args),
    /// Look into recordings of lidars
    Lidar(cmd::lidar::Args),
    /// Let another binary take the place of a service in flight
    Swap(cmd::ask::SwapArgs),
    /// Replace a service by a fresh instance of itself
    Restart(cmd::ask::RestartArgs),
    /// End one service
    Stop(cmd::ask::StopArgs),
    /// Show a virtual world
    World(cmd::world::Args),
    /// Fly a mission in a virtual world
    Demo(beside::Args),
    /// Fly missions with faults at random times
    Chaos(beside::Args),
    /// Fly many missions in virtual worlds, faster than real time, and count
    Campaign(beside::Args),
    /// Drive a simulated pilot at walls, and plot how near he comes
    Approach(beside::Args),
    /// List the jinks of this host, and remove what ended ones have left
    Instances(cmd::instances::Args),
    /// Measure parts of jink beside what others have
    Bench(beside::Args),
}

fn main() -> ExitCode {
    if let Some(service) = services::named(&programs::own_name()) {
        return service();
    }
    jink_runtime::descriptors::reserve();
    let cli = Cli::parse();
    // Also keeps the transport's own messages to what is wrong.
    jink_runtime::logging::init("jink", tracing::Level::ERROR);
    let outcome = match cli.command {
        Command::Up(args) => cmd::up::run(&cli.instance, &args),
        Command::Down(args) => cmd::down::run(&cli.instance, &args),
        Command::Status(args) => cmd::status::run(&cli.instance, &args),
        Command::Top(args) => cmd::top::run(&cli.instance, &args),
        Command::Ring(args) => cmd::ring::run(&cli.instance, &args),
        Command::Topic(args) => cmd::topic::run(&cli.instance, &args),
        Command::Schema(args) => cmd::schema::run(&args),
        Command::Param(args) => cmd::param::run(&cli.instance, &args),
        Command::Check(args) => cmd::check::run(&cli.instance, &args),
        Command::Lidar(args) => cmd::lidar::run(&args),
        Command::Swap(args) => cmd::ask::swap(&cli.instance, &args),
        Command::Restart(args) => cmd::ask::restart(&cli.instance, &args),
        Command::Stop(args) => cmd::ask::stop(&cli.instance, &args),
        Command::World(args) => cmd::world::run(&args),
        Command::Chaos(args) => Err(simulate(&cli.instance, "chaos", args)),
        Command::Campaign(args) => Err(simulate(&cli.instance, "campaign", args)),
        Command::Approach(args) => Err(simulate(&cli.instance, "approach", args)),
        Command::Instances(args) => cmd::instances::run(&args),
        Command::Bench(args) => Err(simulate(&cli.instance, "bench", args)),
        Command::Demo(args) => Err(simulate(&cli.instance, "demo", args)),
    };
    outcome.unwrap_or_else(|problem| {
        eprintln!("jink: {problem}");
        ExitCode::from(problem.exit_code())
    })
}

/// Becomes the program of simulated flights, which an aircraft need not carry.
fn simulate(instance: &Instance, command: &str, args: beside::Args) -> Problem {
    let mut arguments: Vec<OsString> = Vec::new();
    if instance.to_string() != DEFAULT_INSTANCE {
        arguments.extend(["--instance".into(), instance.to_string().into()]);
    }
    arguments.push(command.into());
    arguments.extend(args.arguments);
    beside::become_program(&format!("jink {command}"), programs::LAB, arguments)
}
