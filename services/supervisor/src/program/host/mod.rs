//! Everything of the supervisor that touches the operating system.
//!
//! | module | holds |
//! |---|---|
//! | [`instance_lock`] | the lock that makes a supervisor the only one of its instance; removing the instance's memory |
//! | [`record`] | which processes were started, for the supervisor after a killed one |
//! | [`children`], [`log_file`] | starting, signalling, reaping; what the processes write |
//! | [`cores`] | whether a core runs at all, as a virtual one may not |
//! | [`requests`] | requests of the command line |
//! | [`post_mortem`] | how a process ended, for later queries |
//! | [`notify`] | systemd |
//! | [`sweeper`] | removing what dead processes left in shared memory |
//! | [`upgrade`] | the binary that the supervisor is to go on as, asked for its layouts |
//! | [`system`] | the loop |

mod children;
mod cores;
mod instance_lock;
mod log_file;
mod notify;
mod post_mortem;
mod record;
mod requests;
mod sweeper;
mod system;
mod upgrade;

use crate::program::args::Args;
use crate::shared::{PROGRAM, SupervisorTopics};
use crate::supervision::{End, Supervision};
use crate::table::{ProcessRow, ProcessTable};
use children::{Children, Launch};
use instance_lock::InstanceLock;
use jink_runtime::config::{CONFIG_FILE, Config, Foreign, PROCESS_FILE, Resolved, process_names};
use jink_runtime::room::Need;
use jink_runtime::service::EXIT_CANNOT_START;
use jink_runtime::spool::Carrier;
use jink_runtime::{Instance, ParamStore, Session};
use jink_shared_types::Timestamp;
use log_file::LogFile;
use notify::Notifier;
use record::{ProcessRecord, SurvivingProcess};
use requests::Requests;
use rustix::process::{Signal, pidfd_send_signal};
use signal_hook::consts::{SIGINT, SIGTERM};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;
use sweeper::Sweeper;
use system::{Report, System};

/// A process was given up whose row says that the system then stops (EX_SOFTWARE of sysexits.h).
const EXIT_GAVE_UP: u8 = 70;

/// How long the end of a run waits for the disk: what an SD card takes when it tidies up.
const CARRY_PATIENCE: Duration = Duration::from_secs(5);

type Failure = Box<dyn std::error::Error>;

/// Runs the system until it is stopped or fails.
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
    let lock = InstanceLock::take(&args.instance)?;
    let record = ProcessRecord::new(&args.instance);
    let surviving = record.surviving();
    let is_first = surviving.is_empty();
    let mut terminal = None;
    let run = supervise(args, &lock, record, surviving, &mut terminal);
    let has_failed = match &run {
        Ok(run) => matches!(run.end, End::CannotStart { .. }),
        Err(_) => true,
    };
    if let Some(terminal) = terminal.as_ref().filter(|_| has_failed) {
        // What is said here is all that is left of a start that fails.
        rustix::stdio::dup2_stderr(terminal)?;
    }
    let run = match run {
        Ok(run) => run,
        Err(error) => {
            if is_first {
                lock.abandon();
            }
            return Err(error);
        }
    };
    let code = conclude(run.end, &run.report.reason);
    let are_carried = carry_the_rest(run.carrier);
    // Of a start that could not be, all has been said.
    if !has_failed && (args.keep_logs || run.report.any_failed || run.end != End::Stopped) {
        lock.clear_but_logs(are_carried)?;
        let folder = args.instance.log_place();
        tracing::info!("logs are kept in {}", folder.display());
        if let Some(terminal) = terminal.filter(|_| run.end != End::Stopped) {
            let text = format!(
                "jink-supervisor: {}; logs: {}\n",
                run.report.reason,
                folder.display()
            );
            // Who has started it may have gone.
            let _nobody_listens = rustix::io::write(&terminal, text.as_bytes());
        }
    } else {
        lock.release()?;
    }
    Ok(code)
}

/// Carries to the disk what is still in memory, unless the disk hangs. Returns whether nothing is left of it.
fn carry_the_rest(mut carrier: Carrier) -> bool {
    let (done, carried) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let not_carried = carrier.carry();
        let are_carried = not_carried.logs.is_none();
        for why in [not_carried.logs, not_carried.tlog].into_iter().flatten() {
            tracing::error!("not on the disk: {why}");
        }
        // The supervisor may have ended without it.
        let _too_late = done.send(are_carried);
    });
    carried.recv_timeout(CARRY_PATIENCE).unwrap_or(false)
}

/// How a run has ended.
struct Run {
    end: End,
    report: Report,
    /// For what has been written since the recorder ended, or without one.
    carrier: Carrier,
}

/// One run, to its end. Standard error is kept in `terminal` where the log goes into a file instead.
fn supervise(
    args: &Args,
    lock: &InstanceLock,
    record: ProcessRecord,
    surviving: Vec<SurvivingProcess>,
    terminal: &mut Option<OwnedFd>,
) -> Result<Run, Failure> {
    let programs = program_folder()?;
    let is_new = surviving.is_empty();
    let (config, rows) = if is_new {
        let (resolved, rows) = configured(args, &programs)?;
        lock.clear()?;
        has_room(args, &resolved.config)?;
        lock.announce()?;
        keep_configuration(args, &resolved.text)?;
        ParamStore::of(&resolved.config, &args.instance).begin_run()?;
        (resolved.config, rows)
    } else {
        // Processes of a supervisor that was killed are flying: what they were started with stays in force, whatever has become of
        // the configuration that it was made from.
        lock.announce()?;
        let folder = args.instance.run_config();
        let config = Config::load(&folder)?;
        let rows = ProcessTable::load(&folder)?.select(args.mode, &programs, &config)?;
        (config, rows)
    };
    std::fs::create_dir_all(args.instance.log_folder())?;
    if args.log_to_file {
        let mut log = LogFile::new(&args.instance, "supervisor");
        *terminal = Some(rustix::io::fcntl_dupfd_cloexec(rustix::stdio::stderr(), 0)?);
        rustix::stdio::dup2_stderr(log.open()?)?;
    }
    if let Some(why) = ProcessTable::nobody_carries(&rows, &config) {
        tracing::warn!("{why}");
    }
    let stop_signal = signals()?;

    let names: Vec<&str> = rows.iter().map(|row| row.rules.name.as_str()).collect();
    let foreign = Foreign::load(&args.instance.run_config())?;
    let session = Session::open(&args.instance, PROGRAM)?.with(&foreign);
    let shared = SupervisorTopics::open(session, &config, &names, count_start(&args.instance)?)?;
    let rules = rows.iter().map(|row| row.rules.clone());
    let now = jink_runtime::now();
    let mut supervision = Supervision::new(rules, now, std::process::id());
    let mut children = Children::new(Launch::new(&args.instance, args.log), rows, record);
    let adopted = adopt(surviving, &mut supervision, &mut children, now);
    tracing::info!(instance = %args.instance, config = %args.config.display(), adopted, "starting");

    let requests = Requests::listen(&args.instance)?;
    let mut system = System::new(
        supervision,
        children,
        shared,
        Notifier::new(),
        stop_signal,
        requests,
        Sweeper::start(&args.instance)?,
        &args.instance,
    );
    if adopted > 0 {
        system.report_adopted(adopted);
    }
    let end = system.run();
    let report = system.into_report();
    Ok(Run {
        end,
        report,
        carrier: Carrier::new(&args.instance, &config),
    })
}

/// The configuration that the command line asks for, and the processes of it.
fn configured(args: &Args, programs: &Path) -> Result<(Resolved, Vec<ProcessRow>), Failure> {
    let resolved = Config::resolve(
        &args.config,
        args.profile.as_deref(),
        args.sensors.as_deref(),
        &args.overrides,
    )?;
    let table = ProcessTable::load(&args.config)?;
    let rows = table.select(args.mode, programs, &resolved.config)?;
    Ok((resolved, rows))
}

/// Refuses a configuration whose samples have no room: in flight that would end a process by a signal.
fn has_room(args: &Args, config: &Config) -> Result<(), Failure> {
    let foreign = Foreign::load(&args.config)?;
    // The supervisor publishes, too.
    let processes = process_names(&args.config).len() + 1;
    Ok(Need::of(processes, config, &foreign.topics).has_room()?)
}

/// Adopts what an earlier supervisor has started; returns how many. Second instances are ended: what they
/// were for was known to that supervisor only.
fn adopt(
    surviving: Vec<SurvivingProcess>,
    supervision: &mut Supervision,
    children: &mut Children,
    now: Timestamp,
) -> u32 {
    let mut adopted = 0;
    for SurvivingProcess {
        entry,
        handle,
        program,
    } in surviving
    {
        match (entry.found, children.find(&entry.name)) {
            (Some(found), Some(index)) => {
                tracing::info!(process = entry.name, pid = entry.pid, "adopted");
                supervision.adopt(index, &found, now);
                children.adopt(index, entry.pid, handle, program);
                adopted += 1;
            }
            _ => {
                tracing::warn!(process = entry.name, pid = entry.pid, "ending what has no place");
                let _ = pidfd_send_signal(&handle, Signal::KILL);
            }
        }
    }
    adopted
}

/// Which start of a supervisor of this instance it is, counted in its folder.
fn count_start(instance: &Instance) -> std::io::Result<u32> {
    let path = instance.folder().join("supervisor.starts");
    let before = std::fs::read_to_string(&path).unwrap_or_default();
    let start = before.trim().parse::<u32>().unwrap_or(0) + 1;
    std::fs::write(path, start.to_string())?;
    Ok(start)
}

/// Puts the configuration in force where the processes read it. `jink.toml` comes last and at once.
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
        let lock = InstanceLock::take(instance)?;
        let ended = ProcessRecord::new(instance).end_surviving()?;
        lock.release()?;
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
