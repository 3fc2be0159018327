//! `jink check config`: every mistake of a configuration, as those who are going to read it see it. `jink up` and the demonstration ask the
//! same before they start anything.

use super::Outcome;
use crate::services;
use jink_control::findings::{Finding, Findings, Grade};
use jink_control::{Problem, places};
use jink_mavlink_gateway::check_links;
use jink_mavlink_gateway::ranges::{RangeSources, SensorTable as OverMavlink};
use jink_runtime::config::sensor_table::SensorTable;
use jink_runtime::config::{CONFIG_FILE, Config, ConfigError, Examined, PROCESS_FILE};
use jink_runtime::programs;
use jink_supervisor::table::{Mode, ProcessRow, ProcessTable};
use serde_json::Map;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

/// Which configuration.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Args {
    /// Profile laid over jink.toml: profiles/PROFILE.toml
    #[arg(long)]
    profile: Option<String>,
    /// Where the autopilot is: udpin:ADDRESS:PORT, udpout:ADDRESS:PORT or serial:DEVICE:BAUD
    #[arg(long, value_name = "ADDRESS")]
    link: Option<String>,
    /// Sensors instead of those of jink.toml: sphere, mid360, os0, os1, vlp16, d435, d435x3, sf45, rplidar (docs/sensors), several
    /// with a plus between them, or FILE.toml with tables of sensors and parameters
    #[arg(long, value_name = "NAME|FILE.toml")]
    sensor: Option<String>,
    /// As `jink up` would start it in this virtual world: forest, gap, corridor, utrap, building, empty, or FILE.toml
    #[arg(long)]
    world: Option<String>,
    /// Configuration folder; without it ./config, /etc/jink or that of the checkout
    #[arg(long, value_name = "DIR")]
    config: Option<PathBuf>,
    /// Value laid over the configuration (repeatable)
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    overrides: Vec<String>,
    /// One JSON object instead of a table
    #[arg(long)]
    pub(super) json: bool,
    /// real, virtual_world or simulated_vehicle, for those who ask before they start something
    #[arg(long, hide = true)]
    mode: Option<String>,
}

impl Args {
    fn mode(&self) -> Mode {
        let named = Mode::NAMES
            .iter()
            .find(|(name, _)| Some(*name) == self.mode.as_deref());
        match (named, &self.world, &self.link) {
            (Some((_, mode)), ..) => *mode,
            (None, None, _) => Mode::Real,
            (None, Some(_), None) => Mode::SimulatedVehicle,
            (None, Some(_), Some(_)) => Mode::VirtualWorld,
        }
    }

    /// What lies over the configuration, in the order in which `jink up` lays it.
    fn overrides(&self) -> Vec<String> {
        let link = self
            .link
            .as_ref()
            .map(|address| format!("link.address={address}"));
        let world = self
            .world
            .as_ref()
            .map(|world| format!("simulation.world={world}"));
        link.into_iter()
            .chain(world)
            .chain(self.overrides.iter().cloned())
            .collect()
    }
}

/// Looks for everything that is wrong.
pub fn run(args: &Args) -> Result<Outcome, Problem> {
    let begin = Instant::now();
    let folder = places::config_folder(args.config.as_deref())?;
    let mistakes = mistakes(args, &folder)?;
    let finding = |mistake: ConfigError| Finding {
        grade: Grade::Blocker,
        about: mistake
            .file
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .split(' ')
            .next()
            .unwrap_or_default()
            .to_owned(),
        is: mistake.to_string(),
        remedy: String::new(),
    };
    let findings = Findings {
        findings: mistakes.into_iter().map(finding).collect(),
        subject: format!("configuration in {}", folder.display()),
        seconds: begin.elapsed().as_secs_f64(),
    };
    Ok(Outcome::Found(findings, Map::new(), String::new()))
}

fn mistakes(args: &Args, folder: &Path) -> Result<Vec<ConfigError>, Problem> {
    let overrides = args.overrides();
    let (profile, sensor) = (args.profile.as_deref(), args.sensor.as_deref());
    let examined = Config::examine(folder, profile, sensor, &overrides);
    let config = &examined.resolved.config;
    let mut mistakes = examined.mistakes.clone();
    if !folder.join(CONFIG_FILE).is_file() {
        return Ok(mistakes);
    }
    mistakes.extend(
        check_links(&config.link)
            .into_iter()
            .map(|(table, key, message)| {
                let section = table.split('.').next().unwrap_or_default();
                let key = if table == section { key.as_str() } else { "also" };
                at(&examined, section, key, message)
            }),
    );
    if config.sensors.is_empty() && mistakes.is_empty() {
        mistakes.push(ConfigError {
            file: examined.sensors.file.clone(),
            line: 0,
            message: "there is no [[sensor]] in it: jink flies where sensors see".to_owned(),
        });
    }
    for sensor in &config.sensors {
        mistakes.extend(
            examined
                .sensors
                .mistakes_of_sensor(&sensor.name, |tables: &[OverMavlink]| {
                    RangeSources::new(tables).map_or_else(|mistake| Err(mistake.told()), |_| Ok(()))
                }),
        );
    }
    let programs = places::program_folder()?;
    let (rows, of_rows) = ProcessTable::examine(folder, args.mode(), &programs, config);
    for row in &rows {
        mistakes.extend(of_driver(row, &examined));
    }
    mistakes.extend(of_rows);
    mistakes.extend(
        ProcessTable::nobody_carries(&rows, config).map(|message| ConfigError {
            file: folder.join(PROCESS_FILE),
            line: 0,
            message,
        }),
    );
    let simulator = rows.iter().find(|row| row.program_name == programs::SIMULATOR);
    if let Some(row) = simulator {
        let mut command = programs::command(&row.program, &row.program_name);
        command.arg("check").arg("--config").arg(folder);
        mistakes.extend(of_simulator(command, args, &overrides)?);
    }
    let mut each_once: Vec<ConfigError> = Vec::new();
    for mistake in mistakes {
        if !each_once.contains(&mistake) {
            each_once.push(mistake);
        }
    }
    Ok(each_once)
}

fn at(examined: &Examined, section: &str, key: &str, message: String) -> ConfigError {
    let (file, line) = examined.place(section, key).unwrap_or_default();
    ConfigError { file, line, message }
}

/// What the driver that `row` starts would refuse of its sensor.
fn of_driver(row: &ProcessRow, examined: &Examined) -> Vec<ConfigError> {
    let check = services::sensor_check(&row.program_name.to_string_lossy());
    match (check, row.arguments.as_slice()) {
        (Some(check), [option, sensor]) if option == "--sensor" => examined
            .sensors
            .mistakes_of_sensor(sensor, |tables: &[SensorTable]| check(tables, sensor)),
        _ => Vec::new(),
    }
}

/// What the simulator would refuse.
fn of_simulator(
    mut command: Command,
    args: &Args,
    overrides: &[String],
) -> Result<Vec<ConfigError>, Problem> {
    for (option, value) in [("--profile", &args.profile), ("--sensors", &args.sensor)] {
        command.args(value.iter().flat_map(|value| [option, value.as_str()]));
    }
    command.args(overrides.iter().flat_map(|text| ["--set", text.as_str()]));
    if args.mode() == Mode::VirtualWorld {
        command.arg("--external");
    }
    let answer = command.output().map_err(Problem::io(programs::SIMULATOR))?;
    let mistakes: Vec<(PathBuf, usize, String)> = serde_json::from_slice(&answer.stdout).map_err(|_| {
        let words = String::from_utf8_lossy(&answer.stderr);
        Problem::Other(format!("{} check: {}", programs::SIMULATOR, words.trim()))
    })?;
    let mistakes = mistakes.into_iter();
    Ok(mistakes
        .map(|(file, line, message)| ConfigError { file, line, message })
        .collect())
}
