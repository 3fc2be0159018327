//! `jink down`: of a vehicle in the air, the vehicle first.

use jink_control::supervisor::sweep;
use jink_control::watch::{PROGRAM, Watch};
use jink_control::{EXIT_NOT_RUNNING, Problem, places, running};
use jink_control::{say, sayln};
use jink_runtime::{Input, Instance, Session};
use jink_shared_types::link::StopRequest;
use jink_shared_types::vehicle::{NavMode, VehicleState};
use jink_shared_types::{Reading, SampleHeader, topics};
use std::io::{IsTerminal, Write};
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// How to stop.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = EXIT_CODES)]
pub struct Args {
    /// At once, also in flight: neither ask nor bring the vehicle to rest before
    #[arg(long)]
    now: bool,
}

/// Exit codes, for the help.
pub const EXIT_CODES: &str =
    "Exit codes: 0 stopped; 1 could not be stopped, or was not wanted; 3 nothing was running.";

/// The vehicle's state comes 50 times a second.
const STATE_PATIENCE: Duration = Duration::from_millis(300);
/// A way that is committed ends within eight seconds, and a mode is changed within two more.
const REST_PATIENCE: Duration = Duration::from_secs(15);
/// Slower than this (m/s) the vehicle counts as at rest.
const REST_MPS: f64 = 0.3;

/// Every process may take a second to be killed.
const PATIENCE: Duration = Duration::from_secs(40);

/// Stops the instance: asks its supervisor; ends a supervisor that does not answer; ends what a killed one left behind.
pub fn run(instance: &Instance, args: &Args) -> Result<ExitCode, Problem> {
    let programs = places::program_folder()?;
    if !args.now && running::find(instance)?.is_some() && !leave_the_vehicle(instance)? {
        return Ok(ExitCode::FAILURE);
    }
    match running::find(instance)? {
        Some(supervisor) if supervisor.stop(PATIENCE)? => {
            sayln!("jink {instance}: stopped");
        }
        Some(supervisor) => {
            supervisor.kill()?;
            sweep(&programs, instance)?;
            sayln!(
                "jink {instance}: the supervisor did not answer and was killed; its processes have been ended"
            );
        }
        None if running::has_orphans(instance) => {
            sweep(&programs, instance)?;
            sayln!("jink {instance}: ended what a killed supervisor had left running");
        }
        None => {
            sayln!("jink {instance}: nothing is running");
            return Ok(ExitCode::from(EXIT_NOT_RUNNING));
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Brings a vehicle that jink flies to rest and leaves it to the autopilot. Answers whether jink may be ended.
fn leave_the_vehicle(instance: &Instance) -> Result<bool, Problem> {
    if !Watch::is_ready(instance) {
        return Ok(true);
    }
    let session = Session::open(instance, PROGRAM)?;
    let mut states = session.input(topics::VEHICLE_STATE, "")?;
    let begin = Instant::now();
    let state = loop {
        match newest(&mut states) {
            None if begin.elapsed() < STATE_PATIENCE => std::thread::sleep(Duration::from_millis(10)),
            state => break state,
        }
    };
    // Nobody knows of a vehicle, or it stands on the ground, or its pilot flies it.
    let Some(state) = state.filter(is_flown_by_jink) else {
        return Ok(true);
    };
    sayln!(
        "jink {instance}: the vehicle is in the air ({}, {:.1} m/s) and will be stopped; then the autopilot holds it, and nobody looks \
         for obstacles",
        state.mode.get(),
        speed_mps(&state)
    );
    if std::io::stdin().is_terminal() && !is_wanted()? {
        sayln!("jink {instance}: goes on");
        return Ok(false);
    }
    let mut stop_requests = session.output(topics::STOP_REQUEST, "", std::process::id())?;
    let request = StopRequest {
        pid: u64::from(std::process::id()),
    };
    stop_requests.send(SampleHeader::at(jink_runtime::now()), &request);
    let begin = Instant::now();
    while begin.elapsed() < REST_PATIENCE {
        std::thread::sleep(Duration::from_millis(20));
        // A vehicle whose state is not received any more cannot be stopped.
        let Some(state) = newest(&mut states) else {
            return Ok(true);
        };
        if !is_flown_by_jink(&state) && speed_mps(&state) < REST_MPS {
            sayln!("jink {instance}: the vehicle rests, and the autopilot holds it");
            return Ok(true);
        }
    }
    sayln!(
        "jink {instance}: the vehicle has not come to rest within {} s",
        REST_PATIENCE.as_secs()
    );
    Ok(true)
}

fn newest(states: &mut Input<VehicleState>) -> Option<VehicleState> {
    match states.latest(jink_runtime::now()) {
        Reading::Fresh(state) => Some(*state.sample),
        Reading::Stale { .. } | Reading::Never => None,
    }
}

fn speed_mps(state: &VehicleState) -> f64 {
    state.velocity.vector().norm()
}

/// Whether it flies by itself, in a mode in which it may follow what jink sends.
fn is_flown_by_jink(state: &VehicleState) -> bool {
    let mode = state.mode.get();
    let by_itself = matches!(mode, NavMode::Mission | NavMode::Offboard | NavMode::Return);
    state.armed.is_set() && !state.landed.is_set() && by_itself
}

fn is_wanted() -> Result<bool, Problem> {
    say!("end jink? [y/N] ");
    std::io::stdout().flush().map_err(Problem::io("the terminal"))?;
    let mut answer = String::new();
    std::io::stdin()
        .read_line(&mut answer)
        .map_err(Problem::io("the terminal"))?;
    Ok(matches!(answer.trim(), "y" | "Y" | "yes"))
}
