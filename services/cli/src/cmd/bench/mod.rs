//! `jink bench`: parts of jink measured beside what others have.

mod map;

use super::Problem;
use std::process::ExitCode;

/// What to measure.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    command: Subcommand,
}

#[derive(Clone, Debug, clap::Subcommand)]
enum Subcommand {
    /// The map beside OctoMap: time per cloud and stage, and both compared cell by cell
    Map(map::Args),
}

/// Measures it.
pub fn run(args: &Args) -> Result<ExitCode, Problem> {
    match &args.command {
        Subcommand::Map(args) => map::run(args),
    }
}
