//! `jink bench`: parts of jink measured beside what others have, by programs of their own.

use jink_control::{Problem, beside};

/// What to measure.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    command: Subcommand,
}

#[derive(Clone, Debug, clap::Subcommand)]
enum Subcommand {
    /// The map beside OctoMap: time per cloud and stage, and both compared cell by cell
    Map(beside::Args),
}

/// Becomes the program that measures it.
pub fn run(args: Args) -> Problem {
    match args.command {
        Subcommand::Map(args) => beside::become_program("jink bench map", "jink-map-bench", args.arguments),
    }
}
