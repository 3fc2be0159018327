//! `jink-real-autopilots`: flies the table of situations on the builds at hand.

use clap::Parser;
use jink_real_autopilots::autopilot::Build;
use jink_real_autopilots::runner::{self, Options};
use jink_real_autopilots::scenarios::{Planned, planned};
use jink_real_autopilots::setup::{Autopilot, Setup};
use jink_real_autopilots::{builds, jink, table};
use std::path::PathBuf;
use std::process::ExitCode;

/// Flies jink on real autopilots in simulation and judges every flight by truth
#[derive(Parser)]
#[command(
    name = "jink-real-autopilots",
    version,
    after_help = "\
Builds that are not named are taken from tests/real_autopilots/builds.toml, if it is there; what is not found is reported as
NOT TESTED.

Exit codes: 0 every flight passed; 1 one did not; 2 there was nothing to fly."
)]
struct Arguments {
    /// Build of PX4 1.11 to 1.15: its source folder, or build/px4_sitl_default in it
    #[arg(long, value_name = "DIR")]
    px4_2021: Option<PathBuf>,
    /// Build of PX4 of today
    #[arg(long, value_name = "DIR")]
    px4: Option<PathBuf>,
    /// Source folder of ArduPilot with a build of ArduCopter for SITL
    #[arg(long, value_name = "DIR")]
    ardupilot: Option<PathBuf>,
    /// Fly only what has this in its name (autopilot/profile/flight; parts with commas between them, $ = its end; repeatable)
    #[arg(long, value_name = "PART")]
    only: Vec<String>,
    /// Print what would be flown
    #[arg(long)]
    list: bool,
    /// Flights at a time: each takes about one core
    #[arg(long, default_value_t = 1, value_name = "N")]
    jobs: u16,
    /// One JSON object for each flight, added to FILE as soon as it is over
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the table here, too
    #[arg(long, value_name = "FILE")]
    table: Option<PathBuf>,
    /// A picture of each flight
    #[arg(long, value_name = "DIR")]
    svg: Option<PathBuf>,
    /// Keep the logs and what was seen of each flight
    #[arg(long, value_name = "DIR")]
    keep: Option<PathBuf>,
    /// Folder of jink's programs; without it that of this one, in which they are built first
    #[arg(long, value_name = "DIR")]
    programs: Option<PathBuf>,
    /// Instance number of the first autopilot, if others run on this machine
    #[arg(long, default_value_t = 0, value_name = "N")]
    instance: u16,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(code) => code,
        Err(text) => {
            eprintln!("jink-real-autopilots: {text}");
            ExitCode::from(2)
        }
    }
}

fn run(arguments: &Arguments) -> Result<ExitCode, String> {
    let mut flights = planned(&arguments.only);
    if arguments.list {
        for flight in &flights {
            let (kind, seed) = flight.scenario.world;
            println!(
                "{:<60} {kind} {seed}: {}",
                flight.name(),
                flight.scenario.expectation
            );
        }
        return Ok(ExitCode::SUCCESS);
    }
    let mut found = builds::configured()?;
    for (autopilot, folder) in [
        (Autopilot::Px4Of2021, &arguments.px4_2021),
        (Autopilot::Px4, &arguments.px4),
        (Autopilot::ArduCopter, &arguments.ardupilot),
    ] {
        if let Some(folder) = folder {
            found.insert(autopilot, Build::find(autopilot, folder)?);
        }
    }
    let mut untested = Vec::new();
    for setup in Setup::ALL {
        if let Err(why) = runner::is_flown(setup, &found) {
            flights.retain(|flight| flight.setup != setup);
            untested.push((setup, why));
        }
    }
    if flights.is_empty() {
        print!("{}", table::markdown(&[], &untested));
        return Err("nothing to fly".to_owned());
    }
    for folder in [&arguments.svg, &arguments.keep].into_iter().flatten() {
        std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    }
    has_ports(&flights, arguments)?;
    let options = Options {
        builds: found,
        jobs: arguments.jobs,
        first_instance: arguments.instance,
        json: arguments.json.clone(),
        svg: arguments.svg.clone(),
        keep: arguments.keep.clone(),
        programs: arguments.programs.clone().map_or_else(runner::programs, Ok)?,
        config: runner::workspace().join("config"),
    };
    jink::end_with_us(&options.programs, options.instances()).map_err(|error| format!("signals: {error}"))?;
    let verdicts = runner::run(&flights, &options);
    let text = table::markdown(&verdicts, &untested);
    print!("{text}");
    if let Some(file) = &arguments.table {
        std::fs::write(file, &text).map_err(|error| format!("{}: {error}", file.display()))?;
    }
    let all_passed = verdicts.len() == flights.len() && verdicts.iter().all(|verdict| verdict.passed);
    Ok(ExitCode::from(u8::from(!all_passed)))
}

/// PX4 gives each of its first ten instances ports of its own, and all others the same.
fn has_ports(flights: &[Planned], arguments: &Arguments) -> Result<(), String> {
    const PX4_LAST: u16 = 9;
    let last = arguments
        .instance
        .saturating_add(arguments.jobs.saturating_sub(1));
    let is_px4 = |flight: &Planned| flight.setup.autopilot() != Autopilot::ArduCopter;
    if last > PX4_LAST && flights.iter().any(is_px4) {
        return Err(format!(
            "--instance {} with --jobs {} ends at instance {last}: PX4 has ports of their own for instances 0 to {PX4_LAST}",
            arguments.instance, arguments.jobs
        ));
    }
    Ok(())
}
