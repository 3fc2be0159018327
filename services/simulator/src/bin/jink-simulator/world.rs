//! `jink-simulator world`: what stands in a world, so that anyone can judge a flight against the ground truth.

use crate::settings;
use clap::Parser;
use std::process::ExitCode;

/// Prints the obstacles of a world: local NED, heights up
#[derive(Parser)]
#[command(name = "jink-simulator world", bin_name = "jink-simulator world", version)]
struct Arguments {
    /// Kind of world: forest, gap, corridor, utrap, empty
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
    match settings::build(&arguments.world, arguments.seed, arguments.density) {
        Ok(world) if arguments.json => {
            println!("{}", world.json());
            ExitCode::SUCCESS
        }
        Ok(world) => {
            println!(
                "{} with seed {}: {} obstacles",
                world.name(),
                world.seed(),
                world.obstacles().len()
            );
            for obstacle in world.obstacles() {
                println!("  {obstacle:?}");
            }
            for goal in world.goals() {
                println!("  goal {:.1} m north, {:.1} m east", goal.x_m, goal.y_m);
            }
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("jink-simulator world: {error}");
            ExitCode::from(2)
        }
    }
}
