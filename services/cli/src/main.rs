//! `jink`: start, stop, look at and try out an obstacle-avoidance system.

/// Like `print!`, but somebody who reads no further (`| head`) is no reason to end, least of all in the middle of a
/// flight.
macro_rules! say {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        let mut out = std::io::stdout().lock();
        let _nobody_reads = write!(out, $($text)*).and_then(|()| out.flush());
    }};
}

/// The same with the end of a line.
macro_rules! sayln {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        let _nobody_reads = writeln!(std::io::stdout(), $($text)*);
    }};
}

mod cmd;

use clap::{Parser, Subcommand};
use jink_runtime::Instance;
use std::process::ExitCode;

/// Obstacle avoidance for multicopters
#[derive(Debug, Parser)]
#[command(version, propagate_version = true, arg_required_else_help = true)]
struct Cli {
    /// Which jink on this host (the demonstration takes one of its own)
    #[arg(long, global = true, default_value = cmd::DEFAULT_INSTANCE)]
    instance: Instance,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Start the system
    Up(cmd::up::Args),
    /// Stop the system
    Down(cmd::down::Args),
    /// Show every service, the health of the whole and the link
    Status(cmd::status::Args),
    /// Show all that live: services, hops, rates, news
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
    Demo(cmd::demo::Args),
    /// Fly missions with faults at random times
    Chaos(cmd::chaos::Args),
    /// Fly many missions in virtual worlds, faster than real time, and count
    Campaign(cmd::beside::Args),
    /// Drive a simulated pilot at walls, and plot how near he comes
    Approach(cmd::beside::Args),
    /// List the jinks of this host, and remove what ended ones have left
    Instances(cmd::instances::Args),
    /// Measure parts of jink beside what others have
    Bench(cmd::bench::Args),
}

fn main() -> ExitCode {
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
        Command::Chaos(args) => cmd::chaos::run(&args),
        Command::Campaign(args) => cmd::beside::run("jink-campaign", &args),
        Command::Approach(args) => cmd::beside::run("jink-approach", &args),
        Command::Instances(args) => cmd::instances::run(&args),
        Command::Bench(args) => cmd::bench::run(&args),
        Command::Demo(args) => cmd::demo::run(&cli.instance, &args),
    };
    outcome.unwrap_or_else(|problem| {
        eprintln!("jink: {problem}");
        ExitCode::from(problem.exit_code())
    })
}
