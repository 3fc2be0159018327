//! `jink world`: the simulator knows the worlds.

use super::{Problem, places};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, ExitCode};

/// Which world.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Kind of world: forest, gap, corridor, utrap, building, empty, or FILE.toml
    #[arg(long, default_value = "forest")]
    world: String,
    /// Seed: the same one gives the same world
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Trees per square metre; without it the world's own
    #[arg(long)]
    density: Option<f64>,
    /// One JSON object with everything in it
    #[arg(long)]
    json: bool,
}

/// The command that describes a world.
pub fn command(programs: &Path, world: &str, seed: u64, density: Option<f64>) -> Result<Command, Problem> {
    let mut command = Command::new(places::program(programs, "jink-simulator")?);
    command.args(["world", "--world", world, "--seed", &seed.to_string()]);
    if let Some(density) = density {
        command.args(["--density", &density.to_string()]);
    }
    Ok(command)
}

/// Becomes the simulator.
pub fn run(args: &Args) -> Result<ExitCode, Problem> {
    let mut command = command(&places::program_folder()?, &args.world, args.seed, args.density)?;
    if args.json {
        command.arg("--json");
    }
    Err(Problem::io("jink-simulator")(command.exec()))
}
