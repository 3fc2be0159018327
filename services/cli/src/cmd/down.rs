//! `jink down`.

use super::supervisor::sweep;
use super::{EXIT_NOT_RUNNING, Problem, places, running};
use jink_runtime::Instance;
use std::process::ExitCode;
use std::time::Duration;

/// Exit codes, for the help.
pub const EXIT_CODES: &str = "Exit codes: 0 stopped; 1 could not be stopped; 3 nothing was running.";

/// Every process may take a second to be killed.
const PATIENCE: Duration = Duration::from_secs(40);

/// Stops the instance: asks its supervisor; ends a supervisor that does not answer; ends what a killed one left behind.
pub fn run(instance: &Instance) -> Result<ExitCode, Problem> {
    let programs = places::program_folder()?;
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
