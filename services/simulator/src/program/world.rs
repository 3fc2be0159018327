//! `jink-simulator world`: what stands in a world, so that anyone can judge a flight against the ground truth.

use crate::service::settings;
use clap::Parser;
use jink_simulated_world::world::World;
use std::io::{ErrorKind, Write};
use std::process::ExitCode;

/// Prints the obstacles of a world: local NED, heights up
#[derive(Parser)]
#[command(name = "jink world", bin_name = "jink world", version)]
struct Arguments {
    /// Kind of world: forest, gap, corridor, utrap, building, empty, or FILE.toml
    #[arg(long, default_value = "forest")]
    world: String,
    /// Seed of the world
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Trees per square metre (forest only)
    #[arg(long)]
    density: Option<f64>,
    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,
}

pub fn run() -> ExitCode {
    let arguments = Arguments::parse_from(std::env::args().skip(1));
    let world = match settings::build(&arguments.world, arguments.seed, arguments.density) {
        Ok(world) => world,
        Err(error) => {
            eprintln!("jink: {error}");
            return ExitCode::from(2);
        }
    };
    match describe(&world, arguments.json, &mut std::io::stdout().lock()) {
        // Whoever reads has seen enough (`| head`).
        Err(error) if error.kind() == ErrorKind::BrokenPipe => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("jink: {error}");
            ExitCode::FAILURE
        }
        Ok(()) => ExitCode::SUCCESS,
    }
}

fn describe(world: &World, json: bool, out: &mut impl Write) -> std::io::Result<()> {
    if json {
        return writeln!(out, "{}", world.json());
    }
    writeln!(
        out,
        "{} with seed {}: {} obstacles",
        world.name(),
        world.seed(),
        world.obstacles().len()
    )?;
    for obstacle in world.obstacles() {
        writeln!(out, "  {obstacle}")?;
    }
    if !world.structures().is_empty() {
        writeln!(
            out,
            "  {} structures (--json draws their outlines)",
            world.structures().len()
        )?;
    }
    for goal in world.goals() {
        writeln!(out, "  goal {:.1} m north, {:.1} m east", goal.x_m, goal.y_m)?;
    }
    Ok(())
}
