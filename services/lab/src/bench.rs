//! `jink bench`: how long it takes from the sensor to the wire on this board, and parts of jink measured beside what others have.

use crate::bench_latency;
use jink_control::{Problem, beside};
use std::process::ExitCode;

/// What to measure.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Exit codes: 0 measured; 1 not, or not all; 2 wrong arguments.")]
pub struct Args {
    #[command(subcommand)]
    command: Subcommand,
}

#[derive(Clone, Debug, clap::Subcommand)]
enum Subcommand {
    /// From the capture of a range to the bytes of a setpoint, stage by stage, on the real processes
    Latency(Box<bench_latency::Args>),
    /// The transport beside bare iceoryx2, shared memory, sockets and others: what handing samples on costs
    Transport(beside::Args),
    /// The map beside OctoMap: time per cloud and stage, and both compared cell by cell
    Map(beside::Args),
}

/// Measures it, or becomes the program that does.
pub fn run(args: &Args) -> Result<ExitCode, Problem> {
    match &args.command {
        Subcommand::Latency(args) => bench_latency::run(args),
        Subcommand::Map(args) => Err(beside::become_program(
            "jink bench map",
            "jink-map-bench",
            &args.arguments,
        )),
        Subcommand::Transport(args) => Err(beside::become_program(
            "jink bench transport",
            "jink-transport-bench",
            &args.arguments,
        )),
    }
}
