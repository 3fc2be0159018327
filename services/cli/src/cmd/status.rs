//! `jink status`.

use jink_control::status::{LEGEND, Report, exit_code};
use jink_control::watch::{SpaceWatch, Watch};
use jink_control::{EXIT_NOT_RUNNING, Problem, running};
use jink_control::{say, sayln};
use jink_runtime::Instance;
use jink_shared_types::health::{ProcessStatus, SystemStatus};
use std::process::ExitCode;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// How to look.
#[derive(Clone, Debug, clap::Args)]
#[command(
    after_help = format!("{LEGEND}\nExit codes: 0 healthy; 1 starting, degraded, stopping, or not ready; 2 failed; 3 not running.")
)]
pub struct Args {
    /// One JSON object instead of a screen
    #[arg(long)]
    json: bool,
}

/// The status comes ten times a second; a supervisor that is silent for so long does not work.
const STATUS_PATIENCE: Duration = Duration::from_secs(2);
/// The link's figures come five times a second, if a gateway runs.
const LINK_PATIENCE: Duration = Duration::from_millis(500);
/// Map and routes come ten times a second and more often, if fusion and planner run.
const SPACE_PATIENCE: Duration = Duration::from_millis(300);
const EXIT_SILENT: u8 = 1;
/// Healthy, with a profile that is not for the autopilot, or with sensors that do not suffice.
const EXIT_NOT_READY: u8 = 1;
const EXIT_FAILED: u8 = 2;

/// Shows the state of the instance.
pub fn run(instance: &Instance, args: &Args) -> Result<ExitCode, Problem> {
    let Some(supervisor) = running::find(instance)? else {
        if running::has_orphans(instance) {
            eprintln!(
                "jink {instance}: the supervisor was killed, its processes may still fly; `jink down` ends them"
            );
            return Ok(ExitCode::from(EXIT_FAILED));
        }
        eprintln!("jink {instance}: not running");
        return Ok(ExitCode::from(EXIT_NOT_RUNNING));
    };
    let status = wait(STATUS_PATIENCE, || Watch::is_ready(instance).then_some(()))
        .map(|()| Watch::open(instance))
        .transpose()?
        .and_then(|mut watch| Some((wait(STATUS_PATIENCE, || watch.status())?, watch)));
    let Some((status, mut watch)) = status else {
        eprintln!(
            "jink {instance}: the supervisor (process id {}) gives no status",
            supervisor.pid
        );
        return Ok(ExitCode::from(EXIT_SILENT));
    };
    wait(LINK_PATIENCE, || watch.link().map(|_| ()));
    let mut space = SpaceWatch::open(watch.session())?;
    let known = wait(SPACE_PATIENCE, || space.look());
    // Newer by the time spent waiting.
    let status = watch.status().unwrap_or(status);
    let report = Report::of_instance(instance, &status, &mut watch, known, space.speed());
    if args.json {
        let json = report.json().map_err(|error| Problem::Other(error.to_string()))?;
        sayln!("{json}");
    } else {
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH);
        say!(
            "{}",
            report.text(since_1970.map_or(0.0, |time| time.as_secs_f64()))
        );
        if let Some(address) = live_page(instance, &status) {
            sayln!("viewer: {address}");
        }
    }
    let is_unfit = report.is_unfit();
    let code = exit_code(status.health.get());
    Ok(ExitCode::from(if is_unfit {
        code.max(EXIT_NOT_READY)
    } else {
        code
    }))
}

/// Where the live page is, if it is served now.
fn live_page(instance: &Instance, status: &SystemStatus) -> Option<String> {
    let is_viewer = |process: &&ProcessStatus| process.heartbeat.name.as_str() == "viewer";
    status
        .processes()
        .iter()
        .find(is_viewer)
        .filter(|process| process.pid != 0)?;
    let address = std::fs::read_to_string(instance.viewer_address()).ok()?;
    Some(address.trim().to_owned())
}

fn wait<T>(patience: Duration, mut condition: impl FnMut() -> Option<T>) -> Option<T> {
    let begin = Instant::now();
    loop {
        let value = condition();
        if value.is_some() || begin.elapsed() > patience {
            return value;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}
