//! Virtual worlds: the simulator knows them.

use crate::{Problem, places};
use std::path::Path;
use std::process::Command;

/// The command that describes a world; with `--json` as JSON.
///
/// # Errors
/// There is no simulator in `programs`.
pub fn describe(programs: &Path, world: &str, seed: u64, density: Option<f64>) -> Result<Command, Problem> {
    let mut command = places::program(programs, "jink-simulator")?;
    command.args(["world", "--world", world, "--seed", &seed.to_string()]);
    if let Some(density) = density {
        command.args(["--density", &density.to_string()]);
    }
    Ok(command)
}

/// What chooses a world, as values laid over the configuration.
pub fn overrides(world: Option<&str>, seed: Option<u64>, density: Option<f64>) -> Vec<String> {
    let world = world.map(|world| format!("simulation.world={world}"));
    let seed = seed.map(|seed| format!("simulation.seed={seed}"));
    // A number with a point, so that 1 is taken for a density as well.
    let density = density.map(|density| format!("simulation.density_per_m2={density:?}"));
    world.into_iter().chain(seed).chain(density).collect()
}
