//! `jink world`: the simulator knows the worlds.

use jink_control::{Problem, arguments, places, worlds};
use std::os::unix::process::CommandExt;
use std::process::ExitCode;

/// Which world.
#[derive(Clone, Debug, clap::Args)]
#[command(
    after_help = "Exit codes: 0 shown; 1 there is no simulator, or nothing could be written; 2 there is no such world."
)]
pub struct Args {
    /// Kind of world: forest, gap, corridor, utrap, building, empty, or FILE.toml
    #[arg(long, default_value = "forest")]
    world: String,
    /// Seed: the same one gives the same world
    #[arg(long, default_value_t = 1, value_parser = arguments::seed)]
    seed: u64,
    /// Trees per square metre; without it the world's own
    #[arg(long)]
    density: Option<f64>,
    /// One JSON object with everything in it
    #[arg(long)]
    json: bool,
}

/// Becomes the simulator.
pub fn run(args: &Args) -> Result<ExitCode, Problem> {
    let mut command = worlds::describe(&places::program_folder()?, &args.world, args.seed, args.density)?;
    if args.json {
        command.arg("--json");
    }
    Err(Problem::io("jink-simulator")(command.exec()))
}
