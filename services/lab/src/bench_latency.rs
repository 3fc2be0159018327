//! `jink bench latency`: flies the real processes under several loads and says how long the way from the sensor to the wire takes.

use jink_control::{EXIT_PROBLEM, Interrupt, Problem, arguments, autopilot, places, provenance, say, sayln};
use jink_lab::latency::{Bench, Disturbance, Disturber, Load, Measured, Provenance, Readers, Recorder, html};
use jink_lab::rig::live_page::ShownPage;
use jink_lab::rig::show::Show;
use jink_lab::rig::{Observer, Plan, instance};
use jink_runtime::{Instance, Session};
use jink_shared_types::health::SystemStatus;
use jink_shared_types::ranges::{CLOUD_POINTS, SENSORS};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

/// Take-off, the way to the first figures, and what a slow board takes longer (s).
const BEFORE_S: f64 = 90.0;
/// There and back so often that no measurement outlasts the mission.
const LEGS: u32 = 400;

/// As many as a system may have.
const SENSORS_MAX: i64 = SENSORS as i64;
/// As many as a frame holds.
const POINTS_MAX: i64 = CLOUD_POINTS as i64;

/// Which loads.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "\
Every combination of --points, --rates, --sensors, --readers, --beside and --realtime is a flight of its own: take-off, 3 s to settle, then --seconds that count.
A trajectory counts when the autopilot has been sent it, or was sent the same before.

first plan  \"sensor..wire\" of those trajectories that were the first of their map: a second one is made when the goal changes, or
         when no plan was found at first
busy     from the publication of a stage's input until the stage was free for it, or made something of it once more
wake-up  from then until it began
compute  from its begin to its own publication
jitter   mean difference between one trajectory and the next

Where three or more loads differ in one thing only, lines of least squares show how the cost grows with it.

Simulated sensors stamp a frame and then render it, which a real one does not: \"sensor..wire\" leaves that out.

Exit codes: 0 every load was measured; 1 otherwise; 2 wrong arguments.")]
pub struct Args {
    /// Points of a frame
    #[arg(long, value_delimiter = ',', default_values_t = [20_000, 100_000], value_parser = clap::value_parser!(u32).range(100..=POINTS_MAX))]
    points: Vec<u32>,
    /// Frames per second
    #[arg(long, value_delimiter = ',', default_values_t = [10.0, 30.0], value_parser = rate, value_name = "HZ")]
    rates: Vec<f64>,
    /// Lidars, each with so many points and frames
    #[arg(long, value_delimiter = ',', default_values_t = [1], value_parser = clap::value_parser!(u32).range(1..=SENSORS_MAX), value_name = "N")]
    sensors: Vec<u32>,
    /// Additional readers of every large topic
    #[arg(long, value_delimiter = ',', default_values_t = [0], value_parser = clap::value_parser!(u32).range(0..=64), value_name = "N")]
    readers: Vec<u32>,
    /// What disturbs the processes
    #[arg(long, value_delimiter = ',', default_value = "none,hog")]
    beside: Vec<Disturbance>,
    /// With SCHED_FIFO and locked memory for every process; needs the rights to it
    #[arg(long, value_delimiter = ',', default_values_t = [Switch::Off, Switch::On], value_name = "off|on")]
    realtime: Vec<Switch>,
    /// How long each load is looked at (s)
    #[arg(long, default_value_t = 30.0, value_parser = seconds, value_name = "S")]
    seconds: f64,
    /// Virtual world
    #[arg(long, default_value = "forest")]
    world: String,
    /// Its seed
    #[arg(long, default_value_t = 1, value_parser = arguments::seed)]
    seed: u64,
    /// Highest speed (m/s)
    #[arg(long, default_value_t = 3.0, value_name = "V")]
    speed: f64,
    /// Keep the figures
    #[arg(long, value_name = "FILE.json")]
    json: Option<PathBuf>,
    /// Ratios to the figures of an earlier run
    #[arg(long, value_name = "FILE.json")]
    compare: Option<PathBuf>,
    /// A page with plots of the distributions
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Configuration folder; without it ./config, /etc/jink or that of the checkout
    #[arg(long, value_name = "DIR")]
    config: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Switch {
    Off,
    On,
}

impl std::fmt::Display for Switch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Off => "off",
            Self::On => "on",
        })
    }
}

fn rate(text: &str) -> Result<f64, String> {
    arguments::number(text, 1.0..=100.0)
}

fn seconds(text: &str) -> Result<f64, String> {
    arguments::number(text, 1.0..=3600.0)
}

/// A folder for the files of one load; it goes with this.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Result<Self, Problem> {
        let path = std::env::temp_dir().join(format!("jink_bench_{}", std::process::id()));
        std::fs::create_dir_all(&path).map_err(Problem::io(path.display().to_string()))?;
        Ok(Self(path))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // It lies among temporary files.
        let _stays = std::fs::remove_dir_all(&self.0);
    }
}

/// Looks on while something disturbs the flight.
struct Disturbed {
    recorder: Recorder,
    load: Load,
    instance: Instance,
    disturber: Option<Disturber>,
    readers: Option<Readers>,
}

impl Observer for Disturbed {
    fn begin(&mut self, session: &Session) -> Result<(), Problem> {
        self.disturber = self.load.beside.start(&self.instance)?;
        self.readers = Some(Readers::start(&self.instance, self.load.readers)?);
        self.recorder.begin(session)
    }

    fn look(&mut self, status: Option<&SystemStatus>) -> bool {
        self.recorder.look(status)
    }

    fn end(&mut self) {
        self.disturber = None;
        self.readers = None;
        self.recorder.end();
    }
}

impl Args {
    fn loads(&self) -> Vec<Load> {
        let mut loads = Vec::new();
        for realtime in &self.realtime {
            for beside in &self.beside {
                for readers in &self.readers {
                    for sensors in &self.sensors {
                        for points in &self.points {
                            loads.extend(self.rates.iter().map(|rate_hz| Load {
                                points: *points,
                                rate_hz: *rate_hz,
                                sensors: *sensors,
                                readers: *readers,
                                beside: *beside,
                                realtime: *realtime == Switch::On,
                            }));
                        }
                    }
                }
            }
        }
        loads
    }

    fn plan(&self, programs: &Path, config: &Path, sensors: &Path) -> Plan {
        Plan {
            programs: programs.to_owned(),
            config: config.to_owned(),
            world: self.world.clone(),
            seed: self.seed,
            density: None,
            sensors: Some(sensors.display().to_string()),
            speed: Some(self.speed),
            legs: LEGS,
            limit_s: self.seconds + BEFORE_S,
            overrides: Vec::new(),
            autopilot: autopilot::Args::default(),
            live_page: ShownPage::Ignored,
        }
    }

    fn measure(
        &self,
        load: Load,
        programs: &Path,
        config: &Path,
        interrupt: &Interrupt,
    ) -> Result<Measured, Problem> {
        let folder = Folder::new()?;
        load.write_config(config, &folder.0)?;
        let sensors = load.write_sensors(&folder.0)?;
        let plan = self.plan(programs, &folder.0, &sensors);
        let own = instance::own("")?;
        let mut disturbed = Disturbed {
            recorder: Recorder::new(Duration::from_secs_f64(self.seconds)),
            load,
            instance: own.clone(),
            disturber: None,
            readers: None,
        };
        let (flown, stopped) =
            plan.fly_observed(&own, Vec::new(), &mut Show::silent(), interrupt, &mut disturbed)?;
        let recorder = disturbed.recorder;
        stopped?;
        let reason = flown.summary.reason.unwrap_or_default();
        let measured = recorder.measured(load).filter(|measured| measured.seconds > 0.0);
        let measured = measured.ok_or_else(|| {
            Problem::Other(format!(
                "{load}: the flight ended ({} {reason}) before {} s were measured; logs: {}",
                flown.outcome.word(),
                self.seconds,
                own.log_folder().display()
            ))
        })?;
        if load.realtime && !recorder.is_realtime() {
            return Err(Problem::Other(format!(
                "{load}: not every process was given SCHED_FIFO and locked memory; run with the rights to it (CAP_SYS_NICE, \
                 CAP_IPC_LOCK), or with --realtime off; logs: {}",
                own.log_folder().display()
            )));
        }
        // Nothing went wrong: nobody needs its logs.
        let _stays = std::fs::remove_dir_all(own.folder());
        Ok(measured)
    }
}

/// Measures every load, one after the other; what was measured before one failed is kept.
pub fn run(args: &Args) -> Result<ExitCode, Problem> {
    let programs = places::program_folder()?;
    let config = places::config_folder(args.config.as_deref())?;
    let before = args.compare.as_deref().map(read).transpose()?;
    let interrupt = Interrupt::listen()?;
    let loads = args.loads();
    let mut bench = Bench {
        provenance: Provenance {
            commit: provenance::commit(&programs),
            cpu: provenance::cpu(),
            kernel: provenance::kernel(),
            world: args.world.clone(),
            seed: args.seed,
            speed_mps: args.speed,
        },
        loads: Vec::new(),
    };
    sayln!("{}", bench.head());
    let mut failed = false;
    for (n, load) in loads.iter().enumerate() {
        eprintln!(
            "{} of {}: {load}, about {:.0} s",
            n + 1,
            loads.len(),
            args.seconds + 20.0
        );
        match args.measure(*load, &programs, &config, &interrupt) {
            Ok(measured) => {
                say!("\n{}", measured.text());
                bench.loads.push(measured);
            }
            Err(problem) => {
                eprintln!("jink: {problem}");
                failed = true;
            }
        }
        if interrupt.has_come() {
            failed = true;
            break;
        }
    }
    let scaling = bench.scaling();
    if !scaling.is_empty() {
        say!("\n{scaling}");
    }
    if let Some(before) = &before {
        say!("\n{}", bench.compared(before));
    }
    if let Some(file) = &args.json {
        let json = serde_json::to_string(&bench).map_err(|error| Problem::Other(error.to_string()))?;
        write(file, &(json + "\n"))?;
    }
    if let Some(file) = &args.report {
        write(file, &html(&bench))?;
        sayln!("report: {}", file.display());
    }
    Ok(ExitCode::from(if failed { EXIT_PROBLEM } else { 0 }))
}

fn write(file: &Path, text: &str) -> Result<(), Problem> {
    std::fs::write(file, text).map_err(Problem::io(file.display().to_string()))
}

fn read(file: &Path) -> Result<Bench, Problem> {
    let name = || file.display().to_string();
    let text = std::fs::read_to_string(file).map_err(Problem::io(name()))?;
    serde_json::from_str(text.trim_start_matches('\u{feff}'))
        .map_err(|error| Problem::Other(format!("{}: no figures of jink bench latency: {error}", name())))
}
