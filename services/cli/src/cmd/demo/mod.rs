//! `jink demo`: a whole system in an instance of its own, a mission through a virtual world, faults on request, figures.

pub mod drills;
pub mod fly;
mod machine;
mod memory;
mod pilot;
mod sensed;
pub mod show;

use super::supervisor::{StartOptions, Supervisor, world_overrides};
use super::watch::Watch;
use super::{DEFAULT_INSTANCE, EXIT_PROBLEM, Interrupt, Problem, autopilot, instances, places, world};
use drills::{Drills, SUPERVISOR};
use fly::{Flight, Flown};
use jink_cli::drill::Drill;
use jink_cli::flight::{Outcome, Summary};
use jink_cli::picture::{Scene, World, svg};
use jink_runtime::Instance;
use jink_runtime::config::process_names;
use machine::Machine;
use pilot::Pilot;
use show::Show;
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, ExitStatus};
use std::time::Duration;

/// What to fly.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(after_help = "\
Names for --kill: planner, fusion, bezier, guard, gateway, sensor, supervisor, or any name of the process table.

Exit codes: 0 the goal was reached without a collision; 1 otherwise.")]
pub struct Args {
    /// Build every program in release first
    #[arg(long)]
    build: bool,
    /// Virtual world: forest, gap, corridor, utrap, building, empty, or FILE.toml
    #[arg(long, default_value = "forest")]
    world: String,
    /// Seed of the world
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Trees per square metre
    #[arg(long)]
    density: Option<f64>,
    /// Sensors instead of those of jink.toml: sphere, mid360, os0, os1, vlp16, d435, d435x3, sf45, rplidar (docs/sensors), several
    /// with a plus between them, or FILE.toml with tables of sensors and parameters
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
    #[arg(long, value_name = "S")]
    timeout: Option<f64>,
    /// Draw the flight from above
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    /// Plain lines of progress even on a terminal
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
/// Longest time for one leg unless told otherwise (s).
const LEG_LIMIT_S: f64 = 180.0;
/// What a real autopilot takes besides until it has found its position and lets itself be armed (s).
const SITL_BOOT_S: f64 = 90.0;

impl Args {
    /// Longest flight (s).
    fn limit_s(&self) -> f64 {
        let boot_s = if self.autopilot.is_sitl() {
            SITL_BOOT_S
        } else {
            0.0
        };
        self.timeout
            .unwrap_or(LEG_LIMIT_S * f64::from(self.legs) + boot_s)
    }

    /// A flight of a campaign.
    pub fn of_campaign(
        world: &str,
        seed: u64,
        sensor: Option<String>,
        config: Option<PathBuf>,
        overrides: Vec<String>,
    ) -> Self {
        Self {
            world: world.to_owned(),
            seed,
            sensor,
            legs: 1,
            headless: true,
            config,
            overrides,
            ..Self::default()
        }
    }
}

/// Flies the demonstration, in an instance of its own unless `instance` names one.
pub fn run(instance: &Instance, args: &Args) -> Result<ExitCode, Problem> {
    let programs = if args.build {
        build()?
    } else {
        places::program_folder()?
    };
    if let Some(file) = &args.svg {
        // A flight later it would be too late to say so. What was drawn there stays until there is a new picture.
        let opened = std::fs::File::options().create(true).append(true).open(file);
        opened.map_err(Problem::io(format!("--svg {}", file.display())))?;
    }
    let world = args
        .svg
        .as_ref()
        .map(|_| describe_world(&programs, args))
        .transpose()?;
    let mut names = process_names(&places::config_folder(args.config.as_deref())?);
    names.push(SUPERVISOR.to_owned());
    Drill::check(&args.kills, &names).map_err(Problem::Other)?;
    let interrupt = Interrupt::listen()?;
    instances::remove_old_demonstrations(DEMONSTRATIONS_KEPT);
    let instance = if instance.to_string() == DEFAULT_INSTANCE {
        own_instance("")?
    } else {
        instance.clone()
    };
    let mut show = Show::new(args.headless);
    let (flown, stopped) = fly_once(
        args,
        &programs,
        &instance,
        args.kills.clone(),
        &mut show,
        &interrupt,
    )?;
    conclude(args, world.as_ref(), &flown)?;
    let good = flown.outcome == Outcome::Goal;
    match stopped {
        Ok(_) if good => drop(std::fs::remove_dir_all(instance.folder())),
        Ok(_) if instance.log_folder().is_dir() => eprintln!("logs: {}", instance.log_folder().display()),
        Ok(_) => {}
        Err(problem) => eprintln!("jink: {problem}"),
    }
    if args.json {
        let json =
            serde_json::to_string(&flown.summary).map_err(|error| Problem::Other(error.to_string()))?;
        sayln!("{json}");
    }
    Ok(ExitCode::from(if good { 0 } else { EXIT_PROBLEM }))
}

/// One flight of `args` with `drills`, in `instance`, from start to stop; its figures, and how the stop went.
pub fn fly_once(
    args: &Args,
    programs: &Path,
    instance: &Instance,
    drills: Vec<Drill>,
    show: &mut Show,
    interrupt: &Interrupt,
) -> Result<(Flown, Result<ExitStatus, Problem>), Problem> {
    let ports = free_ports()?;
    let options = options(args, programs, ports, show)?;
    let mut supervisor = Supervisor::start(instance, &options)?;
    let drills = Drills::new(drills, instance.clone(), ports[0]);
    let flown = with_system(args, programs, ports[1], &mut supervisor, drills, show, interrupt);
    show.finish();
    // Whatever happened, the system is taken down before anything is said about it.
    let stopped = supervisor.stop();
    Ok((flown?, stopped))
}

/// Builds the checkout that this program lies in; answers where the programs are then.
fn build() -> Result<PathBuf, Problem> {
    let own = places::program_folder()?;
    let workspace = places::workspace(&own)?;
    let status = Command::new("cargo")
        .args(["build", "--release", "--workspace", "--bins"])
        .current_dir(&workspace)
        .status()
        .map_err(Problem::io("cargo"))?;
    if !status.success() {
        return Err(Problem::Other(format!("the build failed ({status})")));
    }
    // Beside the folder of this build's own profile.
    Ok(own.with_file_name("release"))
}

fn describe_world(programs: &Path, args: &Args) -> Result<World, Problem> {
    let mut command = world::command(programs, &args.world, args.seed, args.density)?;
    let answer = command
        .arg("--json")
        .output()
        .map_err(Problem::io("jink-simulator"))?;
    if !answer.status.success() {
        let words = String::from_utf8_lossy(&answer.stderr);
        return Err(Problem::Other(format!(
            "the world cannot be made: {}",
            words.trim()
        )));
    }
    serde_json::from_slice(&answer.stdout)
        .map_err(|error| Problem::Other(format!("the description of the world is not understood: {error}")))
}

/// An instance that no other flight has; `suffix` tells those of one process apart.
pub fn own_instance(suffix: &str) -> Result<Instance, Problem> {
    let name = format!("demo_{}{suffix}", std::process::id());
    name.parse().map_err(|error| Problem::Other(format!("{error}")))
}

/// Two UDP ports that are free now: for the gateway, and for the ground station.
pub fn free_ports() -> Result<[u16; 2], Problem> {
    let bind = || UdpSocket::bind(("127.0.0.1", 0)).map_err(Problem::io("UDP port"));
    // Both open at once, so that they differ.
    let (gateway, ground_station) = (bind()?, bind()?);
    let port = |socket: &UdpSocket| {
        socket
            .local_addr()
            .map(|address| address.port())
            .map_err(Problem::io("UDP port"))
    };
    Ok([port(&gateway)?, port(&ground_station)?])
}

fn options(
    args: &Args,
    programs: &Path,
    [gateway, ground_station]: [u16; 2],
    show: &mut Show,
) -> Result<StartOptions, Problem> {
    let build = args.autopilot.describe(programs)?;
    let mut overrides = vec![
        format!("link.address=udpin:127.0.0.1:{gateway}"),
        format!("simulation.ground_station_port={ground_station}"),
    ];
    overrides.extend(world_overrides(Some(&args.world), Some(args.seed), args.density));
    overrides.extend(args.autopilot.overrides(build.as_ref(), false, &args.overrides)?);
    if let Some(build) = &build {
        show.news(&build.text());
    }
    overrides.extend(args.speed.map(|speed| format!("params.OA_SPD_MAX={speed}")));
    overrides.extend(args.overrides.iter().cloned());
    Ok(StartOptions {
        programs: programs.to_owned(),
        config: places::config_folder(args.config.as_deref())?,
        profile: None,
        sensors: args.sensor.clone(),
        overrides,
        mode: "simulated_vehicle",
        // A flight that ended badly is looked into; after a good one the folder is removed below.
        keep_logs: true,
    })
}

/// Everything between the start and the stop of the system. The readers of shared memory end with it.
fn with_system(
    args: &Args,
    programs: &Path,
    ground_station_port: u16,
    supervisor: &mut Supervisor,
    drills: Drills,
    show: &mut Show,
    interrupt: &Interrupt,
) -> Result<Flown, Problem> {
    let watch: Watch = supervisor.watch(interrupt)?;
    let mut flight = Flight::new(watch, args.svg.is_some(), args.autopilot.is_sitl(), drills)?;
    let machine = Machine::watch();
    let outcome = match flight.wait_until_ready(supervisor, show, interrupt)? {
        Some(outcome) => outcome,
        None => {
            let mut pilot = Pilot::start(programs, ground_station_port, args)?;
            let limit_s = args.limit_s();
            let limit = Duration::try_from_secs_f64(limit_s)
                .map_err(|error| Problem::Other(format!("--timeout {limit_s}: {error}")))?;
            flight.fly(supervisor, &mut pilot, show, interrupt, limit)?
        }
    };
    Ok(flight.end(outcome, &args.world, args.seed, machine.times()))
}

fn conclude(args: &Args, world: Option<&World>, flown: &Flown) -> Result<(), Problem> {
    say!("{}", flown.summary.text());
    match (world, &args.svg) {
        (Some(_), Some(_)) if flown.log.course().is_empty() => {
            sayln!("no picture: the vehicle was never armed");
        }
        (Some(world), Some(file)) => {
            draw(world, flown, file)?;
            sayln!("picture: {}", file.display());
        }
        _ => {}
    }
    Ok(())
}

fn draw(world: &World, flown: &Flown, file: &Path) -> Result<(), Problem> {
    let picture = svg(&Scene {
        world,
        course: &flown.log.course(),
        sensed: &flown.sensed,
        faults: &flown.summary.faults,
        title: &title(&flown.summary),
    });
    std::fs::write(file, picture).map_err(Problem::io(file.display().to_string()))
}

/// Keeps figures and picture of a flight beside its logs.
pub fn keep(args: &Args, programs: &Path, flown: &Flown, folder: &Path) -> Result<(), Problem> {
    let json = serde_json::to_string(&flown.summary).map_err(|error| Problem::Other(error.to_string()))?;
    let file = folder.join("summary.json");
    std::fs::write(&file, json).map_err(Problem::io(file.display().to_string()))?;
    draw(
        &describe_world(programs, args)?,
        flown,
        &folder.join("flight.svg"),
    )
}

fn title(summary: &Summary) -> String {
    format!(
        "jink: {} {}, {}, {:.2} m/s mean, clearance {}",
        summary.world,
        summary.seed,
        summary.outcome,
        summary.mean_speed_mps,
        summary
            .min_clearance_m
            .map_or("-".to_owned(), |m| format!("{m:.2} m"))
    )
}
