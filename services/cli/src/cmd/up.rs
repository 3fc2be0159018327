//! `jink up`.

use jink_control::narrate::{Narrator, Waits, health_line, is_standing_by};
use jink_control::sayln;
use jink_control::supervisor::{StartOptions, Supervisor, exit_code};
use jink_control::{Interrupt, Problem, arguments, autopilot, places, ports, running, worlds};
use jink_runtime::Instance;
use jink_runtime::config::Config;
use jink_runtime::service::EXIT_CANNOT_START;
use jink_shared_types::health::{Health, SystemStatus};
use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// What to start, and how to watch it.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "\
Without --link and --world the vehicle of the configuration is flown. --world alone simulates vehicle, autopilot and
sensors; --link and --world render the sensors around an external autopilot; --world and --sitl start a real autopilot in
simulation and are its simulator.

Exit codes: 0 stopped on request (with --detach: started); 70 a process was given up and the process table says that
the system then stops; 78 the system cannot start; 1 anything else.")]
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
    /// Virtual world: forest, gap, corridor, utrap, building, empty, or FILE.toml
    #[arg(long)]
    world: Option<String>,
    /// Seed of the world
    #[arg(long, requires = "world", value_parser = arguments::seed)]
    seed: Option<u64>,
    /// Trees per square metre
    #[arg(long, requires = "world")]
    density: Option<f64>,
    /// Configuration folder; without it ./config, /etc/jink or that of the checkout
    #[arg(long, value_name = "DIR")]
    config: Option<PathBuf>,
    /// Value laid over the configuration, e.g. params.OA_SPD_MAX=4 (repeatable)
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    overrides: Vec<String>,
    /// Return as soon as the system is ready, or waits for something that may come later
    #[arg(long)]
    detach: bool,
    #[command(flatten)]
    autopilot: autopilot::Args,
}

/// How often the system's status is read.
const LOOK: Duration = Duration::from_millis(20);
/// A system that is not up by then has a reason that a person must see; a good one takes a second or two.
const READY_PATIENCE: Duration = Duration::from_secs(30);
/// Standing by for this long means waiting for somebody else (the autopilot), not passing through.
const STANDBY_FOR: Duration = Duration::from_secs(1);
/// The same of a simulated vehicle, which has all that is waited for within seconds.
const STANDBY_IN_A_WORLD_FOR: Duration = Duration::from_secs(5);

/// Starts the instance and watches it until Ctrl-C, or until it is started.
pub fn run(instance: &Instance, args: &Args) -> Result<ExitCode, Problem> {
    if let Some(running) = running::find(instance)? {
        return Err(Problem::NotUp {
            reason: format!(
                "cannot start: instance {instance} is already up, held by the supervisor with process id {}",
                running.pid
            ),
            code: EXIT_CANNOT_START,
        });
    }
    let interrupt = Interrupt::listen()?;
    let mut supervisor = Supervisor::start(instance, &options(args)?)?;
    let mut watch = supervisor.watch(&interrupt)?;
    let mut narrator = Narrator::default();
    let mut waits = Waits::default();
    let addresses =
        Config::load(&instance.run_config()).map_or_else(|_| Vec::new(), |config| addresses(&config));
    let begin = Instant::now();
    let mut standing_by_since = None;
    loop {
        if let Some(status) = watch.status() {
            for line in narrator.update(&status) {
                sayln!("{line}");
            }
            if let Some(link) = watch.link() {
                for line in waits.update(link.sample, &addresses) {
                    sayln!("{line}");
                }
            }
            if status.health == Health::Stopping {
                drop(watch);
                return conclude(&mut supervisor);
            }
            let since = is_standing_by(&status).then(|| *standing_by_since.get_or_insert(Instant::now()));
            standing_by_since = since;
            let patience = if args.world.is_some() {
                STANDBY_IN_A_WORLD_FOR
            } else {
                STANDBY_FOR
            };
            let settled = since.is_some_and(|since| since.elapsed() > patience);
            let is_ready = status.health == Health::Healthy;
            if args.detach && (is_ready || settled) {
                let how = if is_ready {
                    "is ready"
                } else {
                    "is up and goes on waiting (for an autopilot to be switched on, a sensor to be plugged in?)"
                };
                sayln!("jink {instance} {how}; `jink status` shows it, `jink down` stops it");
                return Ok(ExitCode::SUCCESS);
            }
            if args.detach && begin.elapsed() > READY_PATIENCE {
                drop(watch);
                supervisor.stop()?;
                return Err(Problem::Other(not_ready(instance, &status)));
            }
        }
        if supervisor.ended()?.is_some() || interrupt.has_come() {
            drop(watch);
            return conclude(&mut supervisor);
        }
        std::thread::sleep(LOOK);
    }
}

/// Where the links of a configuration lead, in the gateway's order.
fn addresses(config: &Config) -> Vec<String> {
    config.link.rows().into_iter().map(|row| row.address).collect()
}

fn not_ready(instance: &Instance, status: &SystemStatus) -> String {
    let mut text = format!(
        "not ready within {} s, stopped again; {}",
        READY_PATIENCE.as_secs(),
        health_line(status)
    );
    let logs = instance.log_place();
    if logs.is_dir() {
        text += &format!("\nlogs: {}", logs.display());
    }
    text
}

fn options(args: &Args) -> Result<StartOptions, Problem> {
    if args.autopilot.is_given() && (args.world.is_none() || args.link.is_some()) {
        let what =
            "--autopilot, --sitl and --wind belong to a simulated vehicle: with --world, without --link";
        return Err(Problem::Other(what.to_owned()));
    }
    let programs = places::program_folder()?;
    let build = args.autopilot.describe(&programs)?;
    let autopilot = args
        .autopilot
        .overrides(build.as_ref(), args.profile.is_some(), &args.overrides)?;
    if let Some(build) = &build {
        sayln!("{}", build.text());
    }
    // The usual port belongs to the autopilot's end of the link: the simulator passes on what comes there.
    let of_sitl = build.is_some().then(ports::free).transpose()?;
    let of_sitl = of_sitl.map(|[gateway]: [u16; 1]| format!("udpin:127.0.0.1:{gateway}"));
    let config = places::config_folder(args.config.as_deref())?;
    let other_port = match (&args.link, &of_sitl, &args.world) {
        (None, None, Some(_)) => other_port(&config, args)?,
        _ => None,
    };
    let link = args
        .link
        .as_ref()
        .or(of_sitl.as_ref())
        .or(other_port.as_ref())
        .map(|address| format!("link.address={address}"));
    let world = worlds::overrides(args.world.as_deref(), args.seed, args.density);
    Ok(StartOptions {
        programs,
        config,
        profile: args.profile.clone(),
        sensors: args.sensor.clone(),
        overrides: link
            .into_iter()
            .chain(world)
            .chain(autopilot)
            .chain(args.overrides.iter().cloned())
            .collect(),
        mode: match (&args.link, &args.world) {
            (_, None) => "real",
            (Some(_), Some(_)) => "virtual_world",
            (None, Some(_)) => "simulated_vehicle",
        },
        keep_logs: false,
    })
}

/// Where a simulated autopilot and its gateway meet instead, if another program (a second simulated vehicle) has the UDP port that
/// the configuration names.
fn other_port(config: &Path, args: &Args) -> Result<Option<String>, Problem> {
    let resolved = Config::resolve(
        config,
        args.profile.as_deref(),
        args.sensor.as_deref(),
        &args.overrides,
    );
    // What is wrong with it is said by the supervisor.
    let Ok(resolved) = resolved else { return Ok(None) };
    let is_named = args.overrides.iter().any(|text| text.starts_with("link.address"));
    let address = resolved.config.link.address.strip_prefix("udpin:");
    let address = address.and_then(|address| address.parse::<SocketAddr>().ok());
    let taken = address.filter(|address| {
        let bound = UdpSocket::bind(address);
        bound.is_err_and(|error| error.kind() == ErrorKind::AddrInUse)
    });
    let Some(taken) = taken.filter(|_| !is_named) else {
        return Ok(None);
    };
    let [port] = ports::free()?;
    sayln!(
        "port {} is taken: this vehicle's autopilot speaks on port {port}",
        taken.port()
    );
    Ok(Some(format!("udpin:127.0.0.1:{port}")))
}

/// Waits for the end, asks for it if need be, and says why if it was not asked for.
fn conclude(supervisor: &mut Supervisor) -> Result<ExitCode, Problem> {
    let code = exit_code(supervisor.stop()?);
    if code == 0 {
        sayln!("stopped");
    } else {
        eprintln!("jink: {}", supervisor.reason());
    }
    Ok(ExitCode::from(code))
}

#[cfg(test)]
mod tests {
    use super::{Args, options};
    use clap::Parser;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        args: Args,
    }

    #[test]
    fn link_and_world_choose_the_mode() {
        let mode = |line: &str| {
            let line = format!("up --config here {line}");
            let args = Line::parse_from(line.split_whitespace()).args;
            let options = options(&args).unwrap();
            (options.mode, options.overrides.join(" "))
        };
        assert_eq!(mode(""), ("real", String::new()));
        assert_eq!(mode("--link serial:/dev/x:1").0, "real");
        let (mode_of_both, overrides) =
            mode("--link udpin:0.0.0.0:1 --world gap --seed 3 --set params.OA_SPD_MAX=4");
        assert_eq!(mode_of_both, "virtual_world");
        assert_eq!(
            overrides,
            "link.address=udpin:0.0.0.0:1 simulation.world=gap simulation.seed=3 params.OA_SPD_MAX=4"
        );
        let (alone, overrides) = mode("--world forest --density 1");
        assert_eq!(
            (alone, overrides.as_str()),
            (
                "simulated_vehicle",
                "simulation.world=forest simulation.density_per_m2=1.0"
            )
        );
    }
}
