//! `jink chaos`: flights with faults at random times.

use jink_control::{EXIT_PROBLEM, Interrupt, Problem, arguments, autopilot, places, say, sayln};
use jink_lab::drill::{APART_S, Fault, SUPERVISOR, drawn};
use jink_lab::fault_matrix::Campaign;
use jink_lab::flight_log::Outcome;
use jink_lab::rig::live_page::ShownPage;
use jink_lab::rig::show::Show;
use jink_lab::rig::{Plan, instance, usual_limit_s};
use jink_runtime::config::process_names;
use std::path::PathBuf;
use std::process::ExitCode;

/// Processes that are only victims where they are named: the world, and the supervisor, which can be killed and nothing else.
const NOT_OURS: [&str; 2] = ["simulator", SUPERVISOR];

/// Faults that are closer than this cannot be distinguished (s).
const SOONEST_S: f64 = 0.2;

/// How many flights, with which faults.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "\
Every flight is that of `jink demo` with some six faults between arming and landing, at random times and to
random services: kill (SIGKILL), stop (SIGSTOP, a hang), slow (stopped for most of every 100 ms), swap (for its own binary), garbage
(on the link). The same seed draws the same faults.

Exit codes: 0 every goal was reached, nothing was touched, the autopilot never fell to Hold; 1 otherwise.")]
pub struct Args {
    /// Number of flights
    #[arg(long, default_value_t = 10, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    flights: u64,
    /// Only flight I of the campaign (the first is 1), to look at it again
    #[arg(long, default_value_t = 0, value_name = "I", hide_default_value = true)]
    only: u64,
    /// Seed of the faults, and of the first flight's world; the next worlds have the seeds after it
    #[arg(long, default_value_t = 1, value_parser = arguments::seed)]
    seed: u64,
    /// Kinds of faults
    #[arg(long, value_delimiter = ',', default_value = "kill,stop,slow,swap,garbage")]
    faults: Vec<Fault>,
    /// Two faults of a flight are this far to twice this far apart (s)
    #[arg(long, default_value_t = APART_S, value_name = "S", value_parser = arguments::seconds)]
    apart: f64,
    /// Only to these processes; without it to all but the simulator and the supervisor
    #[arg(long, value_delimiter = ',', value_name = "NAME")]
    services: Vec<String>,
    /// Virtual world
    #[arg(long, default_value = "forest")]
    world: String,
    /// One JSON object with the figures as the last line
    #[arg(long)]
    json: bool,
    /// Sensors instead of those of jink.toml: sphere, mid360, os0, os1, vlp16, d435, d435x3, sf45, rplidar (docs/sensors), several
    /// with a plus between them, or FILE.toml with tables of sensors and parameters
    #[arg(long, value_name = "NAME|FILE.toml")]
    sensor: Option<String>,
    /// Configuration folder
    #[arg(long, value_name = "DIR")]
    config: Option<PathBuf>,
    /// Value laid over the configuration (repeatable)
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    overrides: Vec<String>,
}

impl Args {
    fn plan(&self) -> Result<Plan, Problem> {
        const LEGS: u32 = 1;
        Ok(Plan {
            programs: places::program_folder()?,
            config: places::config_folder(self.config.as_deref())?,
            world: self.world.clone(),
            seed: self.seed,
            density: None,
            sensors: self.sensor.clone(),
            speed: None,
            legs: LEGS,
            limit_s: usual_limit_s(LEGS, false),
            overrides: self.overrides.clone(),
            autopilot: autopilot::Args::default(),
            live_page: ShownPage::Ignored,
        })
    }
}

/// Flies the campaign.
pub fn run(args: &Args) -> Result<ExitCode, Problem> {
    let mut plan = args.plan()?;
    let mut names = process_names(&plan.config);
    names.push(SUPERVISOR.to_owned());
    if let Some(unknown) = args.services.iter().find(|name| !names.contains(name)) {
        let known = names.join(", ");
        return Err(Problem::Other(format!(
            "--services: there is no {unknown:?}; there are {known}"
        )));
    }
    if args.apart.is_nan() || args.apart < SOONEST_S {
        return Err(Problem::Other(format!(
            "--apart {}: at least {SOONEST_S} s",
            args.apart
        )));
    }
    let victims: Vec<String> = names
        .into_iter()
        .filter(|name| match args.services.as_slice() {
            [] => !NOT_OURS.contains(&name.as_str()),
            chosen => chosen.contains(name),
        })
        .collect();
    let interrupt = Interrupt::listen()?;
    let mut flights = Vec::new();
    let (first, end) = match args.only {
        0 => (0, args.flights),
        only => (only - 1, only),
    };
    for number in first..end {
        if interrupt.has_come() {
            break;
        }
        let world_seed = args.seed + number;
        plan.seed = world_seed;
        let instance = instance::own(&format!("_{number}"))?;
        let faults = drawn(args.seed, number, &args.faults, &victims, args.apart);
        let (flown, stopped) = plan.fly(&instance, faults, &mut Show::silent(), &interrupt)?;
        let good = flown.outcome == Outcome::Goal && flown.summary.fcu_hold_count == 0;
        sayln!(
            "flight {} of {} (seed {world_seed}): {}, {} faults, largest gap {:.0} ms, {} falls to Hold",
            number + 1,
            args.flights,
            flown.outcome.word(),
            flown.summary.faults.len(),
            flown.summary.setpoint_max_gap_ms,
            flown.summary.fcu_hold_count
        );
        if good && stopped.is_ok() {
            let _gone_already = std::fs::remove_dir_all(instance.folder());
        } else {
            if let Some(last) = flown.log.course().last() {
                let (north_m, east_m) = (last.north_m, last.east_m);
                let time_s = flown.summary.flight_time_s;
                sayln!("  ended {time_s:.1} s into the mission, {north_m:.1} m north, {east_m:.1} m east");
            }
            for fault in &flown.summary.faults {
                sayln!("  {}", fault.line());
            }
            let kept = plan
                .world()
                .and_then(|world| flown.keep(&world, &instance.log_folder()));
            if let Err(problem) = kept {
                eprintln!("jink: {problem}");
            }
            sayln!("  logs: {}", instance.log_folder().display());
        }
        flights.push(flown.summary);
    }
    let campaign = Campaign::of(&flights);
    say!("\n{}", campaign.text());
    if args.json {
        let json = serde_json::to_string(&campaign).map_err(|error| Problem::Other(error.to_string()))?;
        sayln!("{json}");
    }
    let good = campaign.lost == 0 && campaign.collisions == 0 && campaign.fcu_hold_count == 0;
    Ok(ExitCode::from(if good { 0 } else { EXIT_PROBLEM }))
}
