//! `jink demo`: a whole system in an instance of its own, a mission through a virtual world, faults on request, figures.

use jink_control::{
    DEFAULT_INSTANCE, EXIT_PROBLEM, Interrupt, Problem, arguments, autopilot, places, say, sayln,
};
use jink_lab::drill::{Drill, SUPERVISOR};
use jink_lab::flight_log::Outcome;
use jink_lab::rig::live_page::ShownPage;
use jink_lab::rig::show::Show;
use jink_lab::rig::{Plan, instance, usual_limit_s};
use jink_runtime::Instance;
use jink_runtime::config::{Config, process_names};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{ExitCode, Stdio};

/// What to fly.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "\
A live page shows the flight in a browser; the line `watch:` says where (docs/viewer.md); `--set viewer.address=` serves none.

Flights are recorded in ~/.local/state/jink/recordings, the last ten minutes or so (docs/recordings.md); `--set recorder.folder=` records
none.

Names for --kill: planner, fusion, bezier, guard, gateway, sensor, supervisor, or any name of the process table.

Exit codes: 0 the goal was reached without a collision; 1 otherwise; 2 wrong usage; 78 the system cannot start.")]
pub struct Args {
    /// Virtual world: forest, gap, corridor, utrap, building, empty, or FILE.toml
    #[arg(long, default_value = "forest")]
    world: String,
    /// Seed of the world
    #[arg(long, default_value_t = 1, value_parser = arguments::seed)]
    seed: u64,
    /// Trees per square metre
    #[arg(long)]
    density: Option<f64>,
    /// Sensors: sphere, mid360, os0, os1, vlp16, d435, d435x3, sf45, rplidar (docs/sensors), several with a plus between them, or
    /// FILE.toml with tables of sensors and parameters [default: mid360, or with --config those of its jink.toml]
    #[arg(long, value_name = "NAME|FILE.toml")]
    sensor: Option<String>,
    /// Highest speed (m/s)
    #[arg(long, value_name = "V")]
    speed: Option<f64>,
    /// Fly the way so often: there, back, there
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    legs: u32,
    /// Kill a process so long after the start of the mission, e.g. planner@8s (repeatable)
    #[arg(long = "kill", value_name = "NAME@TIMEs")]
    kills: Vec<Drill>,
    /// Longest flight (s) [default: 180 for each leg]
    #[arg(long, value_name = "S", value_parser = arguments::seconds)]
    timeout: Option<f64>,
    /// Make a page of the flight, which opens in any browser (`jink report`)
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Plain lines of progress even on a terminal, and no live page
    #[arg(long)]
    headless: bool,
    /// One JSON object with the figures as the last line
    #[arg(long)]
    json: bool,
    /// Configuration folder; without it ./config, /etc/jink or that of the checkout
    #[arg(long, value_name = "DIR")]
    config: Option<PathBuf>,
    /// Value laid over the configuration (repeatable)
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    overrides: Vec<String>,
    #[command(flatten)]
    autopilot: autopilot::Args,
}

/// Logs are kept of so many flights that ended badly, the newest ones.
const DEMONSTRATIONS_KEPT: usize = 10;

/// What the recordings of demonstrations may take together (MB): some ten minutes of flight, with the clouds of a lidar.
const RECORDINGS_MAX_MB: u32 = 1000;

/// What flies where neither sensors nor a configuration are named: what can be bought.
const SENSORS: &str = "mid360";

impl Args {
    fn sensors(&self) -> Option<String> {
        let usual = self.config.is_none().then(|| SENSORS.to_owned());
        self.sensor.clone().or(usual)
    }

    /// The flight is recorded, unless the configuration says where or there is no place for it.
    fn recording(&self, config: &Path) -> Vec<String> {
        let is_named = Config::load(config).is_ok_and(|config| config.recorder.folder.is_some());
        let folder = places::recordings_folder().filter(|folder| {
            let is_off = |set: &String| set.starts_with("recorder.folder=");
            !is_named && !self.overrides.iter().any(is_off) && std::fs::create_dir_all(folder).is_ok()
        });
        folder.map_or_else(Vec::new, |folder| {
            vec![
                format!("recorder.folder={}", folder.display()),
                format!("recorder.max_mb={RECORDINGS_MAX_MB}"),
                // Fusion and guard can be replayed with them only.
                "recorder.clouds=true".to_owned(),
            ]
        })
    }

    /// The live page is served, unless the configuration names an address or the demonstration is headless.
    fn viewer(&self, config: &Path) -> Option<String> {
        let is_named = Config::load(config).is_ok_and(|config| config.viewer.address.is_some());
        let is_set = self
            .overrides
            .iter()
            .any(|set| set.starts_with("viewer.address="));
        (!self.headless && !is_named && !is_set).then(|| "viewer.address=127.0.0.1:0".to_owned())
    }

    /// Where a real autopilot leaves its log for the report, unless the user says where it works.
    fn sitl_folder(&self) -> Option<PathBuf> {
        let is_set = |set: &String| set.starts_with("simulation.sitl_folder=");
        let is_wanted =
            self.report.is_some() && self.autopilot.is_sitl() && !self.overrides.iter().any(is_set);
        is_wanted.then(|| std::env::temp_dir().join(format!("jink_sitl_{}", std::process::id())))
    }

    fn plan(&self, programs: PathBuf) -> Result<Plan, Problem> {
        let usual_s = usual_limit_s(self.legs, self.autopilot.is_sitl());
        let config = places::config_folder(self.config.as_deref())?;
        let mut overrides = self.recording(&config);
        overrides.extend(self.viewer(&config));
        overrides.extend_from_slice(&self.overrides);
        Ok(Plan {
            programs,
            config,
            world: self.world.clone(),
            seed: self.seed,
            density: self.density,
            sensors: self.sensors(),
            speed: self.speed,
            legs: self.legs,
            limit_s: self.timeout.unwrap_or(usual_s),
            overrides,
            autopilot: self.autopilot.clone(),
            live_page: match self.headless {
                true => ShownPage::Named,
                false => ShownPage::Opened,
            },
        })
    }
}

/// Flies the demonstration, in an instance of its own unless `instance` names one.
pub fn run(instance: &Instance, args: &Args) -> Result<ExitCode, Problem> {
    let programs = places::program_folder()?;
    if let Some(file) = &args.report {
        places::writable(file).map_err(Problem::io(format!("--report {}", file.display())))?;
    }
    let mut plan = args.plan(programs)?;
    let sitl = args.sitl_folder();
    if let Some(folder) = &sitl {
        plan.overrides
            .push(format!("simulation.sitl_folder={}", folder.display()));
    }
    let mut names = process_names(&plan.config);
    names.push(SUPERVISOR.to_owned());
    Drill::check(&args.kills, &names).map_err(Problem::Other)?;
    let interrupt = Interrupt::listen()?;
    instance::remove_old(DEMONSTRATIONS_KEPT);
    let instance = if instance.to_string() == DEFAULT_INSTANCE {
        instance::own("")?
    } else {
        instance.clone()
    };
    let mut show = Show::new(args.headless);
    let (flown, stopped) = plan.fly(&instance, args.kills.clone(), &mut show, &interrupt)?;
    say!("{}", flown.summary.text());
    let recording = std::fs::read_link(instance.recording()).ok();
    if let Some(file) = &recording {
        sayln!("recording: {}", file.display());
    }
    let reported = match &args.report {
        Some(page) => report(recording.as_deref(), sitl.as_deref(), page),
        None => Ok(()),
    };
    if let Some(folder) = &sitl {
        let _not_there = std::fs::remove_dir_all(folder);
    }
    let good = flown.outcome == Outcome::Goal;
    match stopped {
        Ok(_) if good => drop(std::fs::remove_dir_all(instance.folder())),
        Ok(_) if instance.log_place().is_dir() => eprintln!("logs: {}", instance.log_place().display()),
        Ok(_) => {}
        Err(problem) => eprintln!("jink: {problem}"),
    }
    if args.json {
        let json =
            serde_json::to_string(&flown.summary).map_err(|error| Problem::Other(error.to_string()))?;
        sayln!("{json}");
    }
    // The figures are there without the page.
    reported?;
    Ok(ExitCode::from(if good { 0 } else { EXIT_PROBLEM }))
}

/// Makes the page of a recorded flight, with the log that a real autopilot has left in its folder.
fn report(recording: Option<&Path>, sitl: Option<&Path>, page: &Path) -> Result<(), Problem> {
    let Some(recording) = recording else {
        return Err(Problem::Other(format!(
            "--report {}: the flight was not recorded",
            page.display()
        )));
    };
    let mut command = places::program(&places::program_folder()?, "jink")?;
    command.arg("report").arg(recording).arg("--out").arg(page);
    if let Some(log) = sitl.and_then(own_log) {
        command.arg("--log").arg(log);
    }
    let status = command
        .stdout(Stdio::null())
        .status()
        .map_err(Problem::io("jink report"))?;
    match status.success() {
        true => sayln!("report: {}", page.display()),
        // It has said why.
        false => {
            return Err(Problem::Other(format!(
                "--report {}: not written",
                page.display()
            )));
        }
    }
    Ok(())
}

/// The newest log of an autopilot in `folder` or below.
fn own_log(folder: &Path) -> Option<PathBuf> {
    let is_log = |path: &Path| {
        let extension = path.extension().and_then(OsStr::to_str).unwrap_or_default();
        ["ulg", "BIN"].contains(&extension)
    };
    let entries = std::fs::read_dir(folder).ok()?.flatten();
    let logs = entries.filter_map(|entry| match entry.file_type().ok()? {
        kind if kind.is_dir() => own_log(&entry.path()),
        _ => Some(entry.path()).filter(|path| is_log(path)),
    });
    logs.max_by_key(|log| {
        std::fs::metadata(log)
            .and_then(|metadata| metadata.modified())
            .ok()
    })
}
