//! `jink-simulator check`: what of a configuration a simulation could not start with. Whoever starts one asks first.

use crate::autopilot::AutopilotConfig;
use crate::service::settings;
use clap::Parser;
use jink_runtime::config::{Config, ConfigError, Examined};
use jink_simulated_world::sensors::{SensorRig, SensorSpec};
use serde_json::json;
use std::path::PathBuf;
use std::process::ExitCode;

/// Prints every mistake of a configuration that concerns the simulation: a JSON array of file, line and sentence
///
/// Exit codes: 0 there is none; 1 there are some.
#[derive(Parser)]
#[command(name = "jink-simulator check", bin_name = "jink-simulator check", version)]
struct Arguments {
    /// Folder with jink.toml
    #[arg(long)]
    config: PathBuf,
    /// Profile laid over it
    #[arg(long)]
    profile: Option<String>,
    /// Set of sensors
    #[arg(long)]
    sensors: Option<String>,
    /// Value laid over it (repeatable)
    #[arg(long = "set")]
    overrides: Vec<String>,
    /// The vehicle flies elsewhere: only its sensors are rendered
    #[arg(long)]
    external: bool,
}

pub fn run() -> ExitCode {
    let arguments = Arguments::parse_from(std::env::args().skip(1));
    let examined = Config::examine(
        &arguments.config,
        arguments.profile.as_deref(),
        arguments.sensors.as_deref(),
        &arguments.overrides,
    );
    let mistakes = mistakes(&examined, arguments.external);
    let list = mistakes
        .iter()
        .map(|mistake| json!([mistake.file, mistake.line, mistake.message]));
    println!(
        "{}",
        list.collect::<Vec<_>>()
            .into_iter()
            .collect::<serde_json::Value>()
    );
    ExitCode::from(u8::from(!mistakes.is_empty()))
}

/// What is wrong with the world, with what flies in it, and with its sensors. The rest is found by who has asked.
fn mistakes(examined: &Examined, is_external: bool) -> Vec<ConfigError> {
    let config = &examined.resolved.config;
    let simulation = &config.simulation;
    let at = |section: &str, key: &str, message: String| {
        let (file, line) = examined.place(section, key).unwrap_or_default();
        ConfigError { file, line, message }
    };
    let mut mistakes = Vec::new();
    let world = settings::build(&simulation.world, simulation.seed, simulation.density_per_m2);
    if let Err(error) = world {
        let key = if error.is_about_density() {
            "density_per_m2"
        } else {
            "world"
        };
        mistakes.push(at("simulation", key, error.to_string()));
    }
    if !is_external {
        let name = simulation.autopilot.as_str();
        if name != "auto" && AutopilotConfig::named(name).is_none() {
            let message = format!("{name:?}: there are auto {}", AutopilotConfig::NAMES.join(" "));
            mistakes.push(at("simulation", "autopilot", message));
        }
        if let Err(error) = settings::companion_address(&config.link.address) {
            mistakes.push(at("link", "address", error.to_string()));
        }
    }
    let read = examined.sensors.mistakes_of_sensors_as::<SensorSpec>();
    mistakes.extend(read.mistakes);
    for sensor in &config.sensors {
        mistakes.extend(
            read.layer
                .mistakes_of_sensor(&sensor.name, |specs: &[SensorSpec]| {
                    let rendered = specs.iter().filter(|spec| spec.kind.is_rendered());
                    let rendered: Vec<SensorSpec> = rendered.cloned().collect();
                    SensorRig::new(&rendered, simulation.seed)
                        .map_or_else(|error| Err(error.told()), |_| Ok(()))
                }),
        );
    }
    mistakes
}
