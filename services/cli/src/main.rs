//! `jink`: start, stop, look at and try out an obstacle-avoidance system. Started under the name of one of the programs that an
//! aircraft needs, it is that program.

mod cmd;
mod services;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use jink_control::{DEFAULT_INSTANCE, Problem, arguments, beside};
use jink_runtime::{Instance, programs};
use std::ffi::OsString;
use std::process::ExitCode;

/// Obstacle avoidance for multicopters
#[derive(Debug, Parser)]
#[command(version, propagate_version = true, arg_required_else_help = true)]
struct Cli {
    /// Which jink on this host
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
    /// Show what the services have logged, also of runs before
    Log(cmd::log::Args),
    /// Show what the guard sees around the vehicle, or have it plotted
    Ring(cmd::ring::Args),
    /// List topics, measure their rates, show what they say
    Topic(cmd::topic::Args),
    /// Show what topics carry, also as a C header, a Python module or JSON
    Schema(cmd::schema::Args),
    /// Show parameters, and change them while jink runs
    Param(cmd::param::Args),
    /// Examine the configuration, the board, the link to the autopilot, the sensors, shared memory
    Check(cmd::check::Args),
    /// Look into recordings of lidars
    Lidar(cmd::lidar::Args),
    /// Look into recordings of flights: list them, what they hold, tables for other programs
    Recording(cmd::recording::Args),
    /// Fly a recorded flight once more, service by service, and compare bit by bit
    Replay(cmd::replay::Args),
    /// Make one page of a recorded flight, which opens in any browser
    Report(cmd::report::Args),
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
    /// Drive a simulated pilot at walls, and plot how near the vehicle comes
    Approach(beside::Args),
    /// List the jinks of this host, and remove what ended ones have left
    Instances(cmd::instances::Args),
    /// Measure parts of jink beside what others have
    Bench(beside::Args),
}

/// What the commands are for, as the help lists them.
const GROUPS: [(&str, &[&str]); 6] = [
    (
        "Fly (`jink demo` is the first to try, and needs nothing else)",
        &["demo", "up", "down", "instances"],
    ),
    (
        "Look",
        &[
            "status",
            "top",
            "log",
            "ring",
            "topic",
            "schema",
            "recording",
            "replay",
            "report",
        ],
    ),
    ("Change", &["param", "swap", "restart", "stop"]),
    ("Check before the flight", &["check"]),
    ("Simulate", &["world", "chaos", "campaign", "approach"]),
    ("Measure", &["bench", "lidar"]),
];

/// The command line, with its commands in groups.
fn command() -> clap::Command {
    let command = arguments::with_negative_numbers(Cli::command());
    let mut list = String::new();
    for (title, names) in GROUPS {
        list += &format!("{title}:\n");
        for name in names {
            let about = command.find_subcommand(name).and_then(clap::Command::get_about);
            list += &format!("  {name:10} {}\n", about.cloned().unwrap_or_default());
        }
        list += "\n";
    }
    command
        .mut_subcommands(|command| match WITHOUT_INSTANCE.contains(&command.get_name()) {
            // An argument of the same name takes the place of the global one.
            true => command.arg(clap::Arg::new("instance").long("instance").hide(true)),
            false => command,
        })
        .help_template(format!(
            "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{list}`jink COMMAND --help` says more.\n\nOptions:\n{{options}}"
        ))
}

/// Commands to which it is all the same which jink runs.
const WITHOUT_INSTANCE: [&str; 6] = ["schema", "lidar", "world", "instances", "replay", "report"];

fn main() -> ExitCode {
    if let Some(service) = services::named(&programs::own_name()) {
        return service();
    }
    jink_runtime::descriptors::reserve();
    let cli = Cli::from_arg_matches(&command().get_matches()).unwrap_or_else(|error| error.exit());
    // Also keeps the transport's own messages to what is wrong.
    jink_runtime::logging::init("jink", tracing::Level::ERROR);
    let outcome = match cli.command {
        Command::Up(args) => cmd::up::run(&cli.instance, &args),
        Command::Down(args) => cmd::down::run(&cli.instance, &args),
        Command::Status(args) => cmd::status::run(&cli.instance, &args),
        Command::Top(args) => cmd::top::run(&cli.instance, &args),
        Command::Log(args) => cmd::log::run(&cli.instance, &args),
        Command::Ring(args) => cmd::ring::run(&cli.instance, &args),
        Command::Topic(args) => cmd::topic::run(&cli.instance, &args),
        Command::Schema(args) => cmd::schema::run(&args),
        Command::Param(args) => cmd::param::run(&cli.instance, &args),
        Command::Check(args) => cmd::check::run(&cli.instance, &args),
        Command::Lidar(args) => cmd::lidar::run(&args),
        Command::Recording(args) => cmd::recording::run(&cli.instance, &args),
        Command::Replay(args) => cmd::replay::run(&args),
        Command::Report(args) => cmd::report::run(&args),
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

#[cfg(test)]
mod tests {
    use super::{GROUPS, command};

    #[test]
    fn every_command_stands_in_one_group_of_the_help() {
        let mut grouped: Vec<&str> = GROUPS
            .iter()
            .flat_map(|(_, names)| names.iter().copied())
            .collect();
        grouped.sort_unstable();
        let command = command();
        let mut all: Vec<&str> = command.get_subcommands().map(clap::Command::get_name).collect();
        all.sort_unstable();
        assert_eq!(grouped, all);
        command.debug_assert();
    }

    #[test]
    fn the_instance_is_offered_where_it_does_something() {
        let help = |name: &str| {
            let mut command = command();
            command.build();
            command
                .find_subcommand_mut(name)
                .unwrap()
                .render_long_help()
                .to_string()
        };
        for (name, is_offered) in [
            ("up", true),
            ("status", true),
            ("schema", false),
            ("world", false),
        ] {
            assert_eq!(help(name).contains("--instance"), is_offered, "{name}");
        }
    }

    #[test]
    fn every_command_says_its_exit_codes() {
        fn check(command: &clap::Command, path: &str, is_said_above: bool) {
            let is_passed_on = command
                .get_arguments()
                .any(|argument| argument.get_id() == "arguments");
            let after = command
                .get_after_help()
                .map(ToString::to_string)
                .unwrap_or_default();
            let is_said = is_said_above || after.contains("Exit codes: ");
            let mut within = command.get_subcommands().peekable();
            assert!(is_said || is_passed_on || within.peek().is_some(), "{path}");
            within.for_each(|command| check(command, &format!("{path} {}", command.get_name()), is_said));
        }
        check(&command(), "jink", false);
    }
}
