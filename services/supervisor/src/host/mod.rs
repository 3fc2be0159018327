//! Everything of the supervisor that touches the operating system.
//!
//! | module | holds |
//! |---|---|
//! | [`claim`] | the lock that makes a supervisor the only one of its instance; removing the instance's memory |
//! | [`record`] | which processes were started, for whoever comes after a killed supervisor |
//! | [`children`], [`log_file`] | starting, signalling, reaping; what the processes write |
//! | [`shared`] | topics held open, heartbeats in, status and events out |
//! | [`notify`] | systemd |
//! | [`system`] | the loop |

mod children;
mod claim;
mod log_file;
mod notify;
mod record;
mod shared;
mod system;

use crate::args::Args;
use children::{Children, Launch};
use claim::Claim;
use jink_runtime::config::{CONFIG_FILE, Config, PROCESS_FILE};
use jink_runtime::service::EXIT_CANNOT_START;
use jink_runtime::{Instance, Session};
use jink_supervisor::supervision::{End, Supervision};
use jink_supervisor::table::ProcessTable;
use log_file::LogFile;
use notify::Notifier;
use record::Record;
use shared::Shared;
use signal_hook::consts::{SIGINT, SIGTERM};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::process::ExitCode;
use system::System;

/// A process was given up whose row says that the system then stops (EX_SOFTWARE of sysexits.h).
const EXIT_GAVE_UP: u8 = 70;

type Failure = Box<dyn std::error::Error>;

/// Runs the system until it is stopped or cannot go on.
pub fn run(args: &Args) -> ExitCode {
    match start(args) {
        Ok(code) => code,
        Err(error) => {
            tracing::error!("cannot start: {error}");
            ExitCode::from(EXIT_CANNOT_START)
        }
    }
}

fn start(args: &Args) -> Result<ExitCode, Failure> {
    let resolved = Config::resolve(&args.config, args.profile.as_deref(), &args.overrides)?;
    let rows = ProcessTable::load(&args.config)?.select(args.mode, &program_folder()?)?;

    let claim = Claim::take(&args.instance)?;
    let record = Record::new(&args.instance);
    record.refuse_living()?;
    claim.clear()?;
    std::fs::create_dir_all(args.instance.log_folder())?;
    keep_configuration(args, &resolved.text)?;
    std::fs::copy(
        args.config.join(PROCESS_FILE),
        args.instance.run_config().join(PROCESS_FILE),
    )?;
    if args.log_to_file {
        let mut log = LogFile::new(&args.instance, "supervisor");
        rustix::stdio::dup2_stderr(log.open()?)?;
    }
    let stop_signal = signals()?;

    let names: Vec<&str> = rows.iter().map(|row| row.rules.name.as_str()).collect();
    let session = Session::open(&args.instance, shared::PROGRAM)?;
    let shared = Shared::open(session, &resolved.config, &names)?;
    let rules = rows.iter().map(|row| row.rules.clone());
    let supervision = Supervision::new(rules, jink_runtime::now(), std::process::id());
    let children = Children::new(Launch::new(&args.instance, args.log), rows, record);
    tracing::info!(instance = %args.instance, config = %args.config.display(), "starting");

    let mut system = System::new(supervision, children, shared, Notifier::new(), stop_signal);
    let end = system.run();
    let report = system.into_report();
    let code = conclude(end, &report.reason);
    if report.any_failed || end != End::Stopped || args.keep_logs {
        let folder = claim.clear_but_logs()?;
        tracing::info!("logs are kept in {}", folder.display());
    } else {
        claim.release()?;
    }
    Ok(code)
}

/// Puts the configuration in force where the processes read it. `jink.toml` comes last and at once: who sees it may
/// connect to the instance.
fn keep_configuration(args: &Args, text: &str) -> std::io::Result<()> {
    let folder = args.instance.run_config();
    std::fs::create_dir_all(&folder)?;
    std::fs::copy(args.config.join(PROCESS_FILE), folder.join(PROCESS_FILE))?;
    let new = folder.join("jink.toml.new");
    std::fs::write(&new, text)?;
    std::fs::rename(new, folder.join(CONFIG_FILE))
}

/// Where the supervisor's own program lies, and the others beside it.
fn program_folder() -> Result<PathBuf, Failure> {
    let own = std::env::current_exe()?;
    let folder = own.parent().ok_or("the supervisor's own program has no folder")?;
    Ok(folder.to_owned())
}

/// Readable once SIGTERM or SIGINT has come.
fn signals() -> std::io::Result<UnixStream> {
    let (read, write) = UnixStream::pair()?;
    read.set_nonblocking(true)?;
    for signal in [SIGTERM, SIGINT] {
        signal_hook::low_level::pipe::register(signal, write.try_clone()?)?;
    }
    Ok(read)
}

fn conclude(end: End, reason: &str) -> ExitCode {
    match end {
        End::Stopped => {
            tracing::info!("stopped");
            ExitCode::SUCCESS
        }
        End::CannotStart { .. } => {
            tracing::error!("cannot start: {reason}");
            ExitCode::from(EXIT_CANNOT_START)
        }
        End::GaveUp { .. } => {
            tracing::error!("stopped: {reason}");
            ExitCode::from(EXIT_GAVE_UP)
        }
    }
}

/// Ends what a killed supervisor left running and removes its memory.
pub fn sweep(instance: &Instance) -> ExitCode {
    let swept = || -> Result<usize, Failure> {
        let claim = Claim::take(instance)?;
        let ended = Record::new(instance).end_living()?;
        claim.release()?;
        Ok(ended)
    };
    match swept() {
        Ok(ended) => {
            tracing::info!(ended, "swept instance {instance}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            tracing::error!("cannot sweep: {error}");
            ExitCode::from(EXIT_CANNOT_START)
        }
    }
}
