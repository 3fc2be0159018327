//! `jink swap`, `jink restart`, `jink stop`: requests to the running supervisor.

use jink_control::sayln;
use jink_control::{EXIT_NOT_RUNNING, EXIT_PROBLEM, Problem, request, running};
use jink_runtime::request::Request;
use jink_runtime::{Instance, programs};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// The supervisor in the place of a process.
const SUPERVISOR: &str = "supervisor";

/// Which binary is to take over from which process.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "\
The new binary starts beside the old one, reads the same inputs and publishes nothing. When it has run its cycles within
budget, with outputs that can be used, ownership changes at one moment that both know before; the old one stands by for
two more seconds and takes back if the new one fails, or if others lack what they need since. The program of another
service is refused before it has opened anything.

`jink swap supervisor BINARY` lets another supervisor go on; the services do not notice.

Exit codes: 0 swapped (with --dry-run: it would be); 1 refused or rolled back; 3 nothing is running.")]
pub struct SwapArgs {
    /// Process to be replaced: a name of the process table, or supervisor
    service: String,
    /// The new binary
    binary: PathBuf,
    /// Judge the new binary beside the old one, and change nothing
    #[arg(long)]
    dry_run: bool,
    /// Cycles it has to run within budget [default: 50]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    cycles: Option<u64>,
}

/// Which process is to be started anew.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "\
What is started is the program that services.toml names, whatever has been swapped in. Without --hard the replacement runs
beside the old one first and takes over without a gap, like a swap. A process that is down is started.

Exit codes: 0 done; 1 refused; 3 nothing is running.")]
pub struct RestartArgs {
    /// Process to be restarted
    service: String,
    /// End it first, then start it
    #[arg(long)]
    hard: bool,
}

/// Which process is to be ended.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Exit codes: 0 done; 1 refused; 3 nothing is running.")]
pub struct StopArgs {
    /// Process to be ended; `jink down` stops all
    service: String,
}

/// Runs `jink swap`.
pub fn swap(instance: &Instance, args: &SwapArgs) -> Result<ExitCode, Problem> {
    let program = absolute(&args.binary).map_err(Problem::io(args.binary.display().to_string()))?;
    if args.service == SUPERVISOR {
        if args.dry_run {
            return Err(Problem::Other(
                "a supervisor has no probation: without --dry-run it is only taken if its layouts agree"
                    .to_owned(),
            ));
        }
        return ask(instance, &Request::Upgrade { program });
    }
    ask(
        instance,
        &Request::Swap {
            process: args.service.clone(),
            program: Some(program),
            cycles: args.cycles,
            dry_run: args.dry_run,
        },
    )
}

/// Where `program` is, for the supervisor, which has a working folder of its own. Its name stays as it was called: one file has many
/// programs in it.
fn absolute(program: &Path) -> std::io::Result<PathBuf> {
    // That there is one at all.
    std::fs::metadata(programs::file_of(program))?;
    let program = std::path::absolute(program)?;
    match (program.parent(), program.file_name()) {
        (Some(folder), Some(name)) => Ok(std::fs::canonicalize(folder)?.join(name)),
        _ => Ok(program),
    }
}

/// Runs `jink restart`.
pub fn restart(instance: &Instance, args: &RestartArgs) -> Result<ExitCode, Problem> {
    let process = args.service.clone();
    let request = if args.hard {
        Request::Restart { process }
    } else {
        Request::Swap {
            process,
            program: None,
            cycles: None,
            dry_run: false,
        }
    };
    ask(instance, &request)
}

/// Runs `jink stop`.
pub fn stop(instance: &Instance, args: &StopArgs) -> Result<ExitCode, Problem> {
    let process = args.service.clone();
    ask(instance, &Request::Stop { process })
}

/// Asks, and prints every answer until the last one.
fn ask(instance: &Instance, asked: &Request) -> Result<ExitCode, Problem> {
    if running::find(instance)?.is_none() {
        eprintln!("jink {instance}: not running");
        return Ok(ExitCode::from(EXIT_NOT_RUNNING));
    }
    let mut last = None;
    request::put(&instance.request_socket(), asked, |answer| {
        if answer.good {
            sayln!("{}", answer.text);
        } else {
            eprintln!("jink: {}", answer.text);
        }
        last = Some(answer.clone());
    })?;
    let good = last.is_some_and(|answer| answer.good);
    Ok(ExitCode::from(if good { 0 } else { EXIT_PROBLEM }))
}
