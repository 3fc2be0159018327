//! `jink-simulator sitl`: what a folder offers as an autopilot in simulation.

use crate::sitl::SitlBuild;
use clap::Parser;
use jink_emulated_ground_station::Make;
use serde_json::json;
use std::path::PathBuf;
use std::process::ExitCode;

/// Prints the build of PX4 or ArduCopter found in a folder
///
/// Exit codes: 0 found; 1 not, with what was looked for.
#[derive(Parser)]
#[command(name = "jink-simulator sitl", bin_name = "jink-simulator sitl", version)]
struct Arguments {
    /// Source folder with a build inside, or the build folder
    folder: PathBuf,
    /// Print JSON instead of a sentence
    #[arg(long)]
    json: bool,
}

pub fn run() -> ExitCode {
    let arguments = Arguments::parse_from(std::env::args().skip(1));
    let build = match SitlBuild::find(&arguments.folder) {
        Ok(build) => build,
        Err(error) => {
            eprintln!("jink-simulator sitl: {error}");
            return ExitCode::FAILURE;
        }
    };
    let make = match build.make {
        Make::Px4 => "px4",
        Make::ArduCopter => "ardupilot",
    };
    let interfaces: Vec<_> = build.interfaces.iter().map(|one| one.name()).collect();
    if arguments.json {
        let description = json!({
            "autopilot": make,
            "version": build.version,
            "program": build.program,
            "profile": build.profile,
            "profiles": build.profiles(),
            "interfaces": interfaces,
        });
        println!("{description}");
    } else {
        println!(
            "{make} {} ({}), profile {}, interfaces: {}",
            build.version,
            build.program.display(),
            build.profile,
            interfaces.join(" ")
        );
    }
    ExitCode::SUCCESS
}
