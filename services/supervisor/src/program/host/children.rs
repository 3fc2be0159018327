//! Starting processes, signalling them, and learning that they have ended.
//!
//! A process is started ahead of ordinary programs, where this is permitted: a replacement that waits for a turn of the
//! scheduler at every step takes twice as long. It gives that up after its first cycle, and loses it if it takes longer
//! than a start should. Candidates of a swap are in no hurry, and nothing is known about them: they never have it.

use super::cores::Cores;
use super::log_file::LogFile;
use super::record::{ProcessRecord, RecordEntry};
use crate::supervision::{Adopted, Exit, Observation, ProcessActivity};
use crate::table::{ProcessRow, Start};
use jink_runtime::procfs::ProcessStat;
use jink_runtime::realtime::{STARTING_PRIORITY, Scheduling, schedule};
use jink_runtime::{Instance, programs};
use jink_shared_types::Timestamp;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Pid, PidfdFlags, Signal, WaitOptions, pidfd_open, pidfd_send_signal, waitpid};
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};

/// Lines of a dead process's log that are repeated in the supervisor's.
const POST_MORTEM_LINES: usize = 20;
/// How long a process is started ahead of others (s): several times what a start takes.
const AHEAD_S: f64 = 0.05;
/// SCHED_FIFO priority of the supervisor: above the processes that it starts.
const OWN_PRIORITY: u8 = STARTING_PRIORITY + 1;

/// The arguments of every process.
#[derive(Clone, Debug)]
pub struct Launch {
    instance: Instance,
    config: PathBuf,
    log: tracing::Level,
}

impl Launch {
    /// For processes of `instance`, with the log level of rows that give none.
    pub fn new(instance: &Instance, log: tracing::Level) -> Self {
        Self {
            instance: instance.clone(),
            config: instance.run_config(),
            log,
        }
    }

    fn command(&self, row: &ProcessRow, program: &Path, generation: u32, shadow: bool) -> Command {
        let mut command = programs::command(program, &row.program_name);
        command.args(row.arguments_of(&Start {
            instance: &self.instance,
            config: &self.config,
            log: self.log,
            generation,
            is_shadow: shadow,
        }));
        // The service manager's socket is the supervisor's: a child that wrote to it would report for the whole system.
        for variable in ["NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"] {
            command.env_remove(variable);
        }
        // A group of its own: Ctrl-C at the terminal reaches the supervisor, which stops the others in order.
        command.stdin(Stdio::null()).process_group(0);
        command
    }
}

/// A process that runs: a child, or one that an earlier supervisor has started.
struct Running {
    pid: u32,
    /// `None`: not our child, so how it ended is not known.
    child: Option<Child>,
    handle: OwnedFd,
    /// It has been started ahead of others, until then.
    ahead_until: Option<Timestamp>,
}

impl Running {
    /// How it ended, if it has.
    fn reap(&mut self) -> Option<Exit> {
        match &mut self.child {
            Some(child) => Some(Exit::of(child.try_wait().ok()??)),
            // A supervisor that was upgraded in place is still the parent of its processes.
            None => has_ended(&self.handle).then(|| {
                let pid = i32::try_from(self.pid).ok().and_then(Pid::from_raw);
                let status = waitpid(pid, WaitOptions::NOHANG).ok().flatten();
                status.map_or(Exit::Unknown, |(_, status)| {
                    Exit::of(ExitStatus::from_raw(status.as_raw()))
                })
            }),
        }
    }
}

struct Slot {
    row: ProcessRow,
    /// The program that the table names, whatever has been swapped in since.
    own: PathBuf,
    /// The program before the last swap.
    former: Option<PathBuf>,
    log: LogFile,
    /// Of the second instance: the two change their logs when they change their places.
    shadow_log: LogFile,
    running: Option<Running>,
    shadow: Option<Running>,
    /// The program of a requested swap.
    staged: Option<PathBuf>,
}

/// All processes of the system.
pub struct Children {
    launch: Launch,
    slots: Vec<Slot>,
    record: ProcessRecord,
    cores: Cores,
}

impl Children {
    /// None of them started.
    pub fn new(launch: Launch, rows: Vec<ProcessRow>, record: ProcessRecord) -> Self {
        let slots = rows
            .into_iter()
            .map(|row| Slot {
                log: LogFile::new(&launch.instance, &row.rules.name),
                shadow_log: LogFile::new(&launch.instance, &format!("{}.shadow", row.rules.name)),
                own: row.program.clone(),
                former: None,
                row,
                running: None,
                shadow: None,
                staged: None,
            })
            .collect();
        Self {
            launch,
            slots,
            record,
            cores: Cores::watch(),
        }
    }

    /// Puts the supervisor itself ahead of ordinary programs, where this is permitted.
    pub fn raise_priority() {
        if let Err(error) = schedule(0, Scheduling::FifoItself(OWN_PRIORITY)) {
            tracing::debug!("no SCHED_FIFO for the supervisor: {error}");
        }
    }

    /// Ends the precedence of processes whose start takes too long.
    pub fn restore_priority(&mut self, now: Timestamp) {
        for running in self.slots.iter_mut().filter_map(|slot| slot.running.as_mut()) {
            if running.ahead_until.is_some_and(|until| now >= until) {
                running.ahead_until = None;
                // It may have ended meanwhile.
                let _ = schedule(running.pid, Scheduling::Ordinary);
            }
        }
    }

    /// Starts process `index`; what came of it is the observation.
    pub fn spawn(&mut self, index: usize, generation: u32) -> Option<Observation> {
        let slot = self.slots.get_mut(index)?;
        let name = &slot.row.rules.name;
        let command = self
            .launch
            .command(&slot.row, &slot.row.program, generation, false);
        let ahead = match slot.row.priority {
            0 => STARTING_PRIORITY,
            priority => priority,
        };
        // Where this is refused it starts like any other program.
        let _ = schedule(0, Scheduling::Fifo(ahead));
        let started = start(command, &mut slot.log);
        Self::raise_priority();
        match started {
            Ok(mut running) => {
                running.ahead_until =
                    (slot.row.priority == 0).then(|| jink_runtime::now().plus_seconds(AHEAD_S));
                let pid = running.pid;
                tracing::info!(process = name, pid, generation, "started");
                slot.running = Some(running);
                Some(Observation::Spawned { process: index, pid })
            }
            Err(error) => {
                tracing::error!(
                    process = name,
                    "cannot be started: {}: {error}",
                    slot.row.program.display()
                );
                Some(Observation::Died {
                    process: index,
                    exit: Exit::NotSpawned,
                })
            }
        }
    }

    /// Starts a second instance of process `index`, of the staged program if it is a `candidate`.
    pub fn spawn_shadow(&mut self, index: usize, generation: u32, candidate: bool) -> Option<Observation> {
        let slot = self.slots.get_mut(index)?;
        let staged = slot.staged.as_ref().filter(|_| candidate);
        let program = staged.unwrap_or(&slot.row.program).clone();
        let command = self.launch.command(&slot.row, &program, generation, true);
        let name = &slot.row.rules.name;
        // Its log is its own, so that its last lines are not mixed with those of the owner.
        match start(command, &mut slot.shadow_log) {
            Ok(running) => {
                let pid = running.pid;
                tracing::info!(process = name, pid, generation, program = %program.display(), "shadow started");
                slot.shadow = Some(running);
                Some(Observation::ShadowSpawned { process: index, pid })
            }
            Err(error) => {
                tracing::error!(
                    process = name,
                    "shadow cannot be started: {}: {error}",
                    program.display()
                );
                Some(Observation::ShadowDied {
                    process: index,
                    exit: Exit::NotSpawned,
                })
            }
        }
    }

    /// The program with which the next candidate of process `index` is started; `None` = the one that the table names.
    pub fn stage(&mut self, index: usize, program: Option<PathBuf>) {
        if let Some(slot) = self.slots.get_mut(index) {
            slot.staged = Some(program.unwrap_or_else(|| slot.own.clone()));
        }
    }

    /// First and second instance of process `index` exchange their places.
    pub fn promote(&mut self, index: usize) {
        if let Some(slot) = self.slots.get_mut(index) {
            std::mem::swap(&mut slot.running, &mut slot.shadow);
            std::mem::swap(&mut slot.log, &mut slot.shadow_log);
        }
    }

    /// The staged program is the program of process `index` from now on.
    pub fn commit(&mut self, index: usize) {
        if let Some(slot) = self.slots.get_mut(index)
            && let Some(program) = slot.staged.take()
        {
            tracing::info!(process = slot.row.rules.name, program = %program.display(), "program");
            slot.former = Some(std::mem::replace(&mut slot.row.program, program));
        }
    }

    /// The program before that is the program of process `index` again.
    pub fn take_back(&mut self, index: usize) {
        if let Some(slot) = self.slots.get_mut(index)
            && let Some(program) = slot.former.take()
        {
            tracing::info!(process = slot.row.rules.name, program = %program.display(), "program taken back");
            slot.row.program = program;
        }
    }

    /// The number of the process called `name`.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.slots.iter().position(|slot| slot.row.rules.name == name)
    }

    /// The names of all processes.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.slots.iter().map(|slot| slot.row.rules.name.as_str())
    }

    /// Takes over a process that an earlier supervisor has started, and its program if that is known.
    pub fn adopt(&mut self, index: usize, pid: u32, handle: OwnedFd, program: Option<PathBuf>) {
        if let Some(slot) = self.slots.get_mut(index) {
            if let Some(program) = program {
                slot.row.program = program;
            }
            slot.running = Some(Running {
                pid,
                child: None,
                handle,
                ahead_until: None,
            });
        }
    }

    /// Sends `signal` to process `index`, if it runs.
    pub fn signal(&self, index: usize, signal: Signal) {
        if let Some(running) = self.slots.get(index).and_then(|slot| slot.running.as_ref()) {
            // It may have ended meanwhile; then that is what will be observed.
            let _ = pidfd_send_signal(&running.handle, signal);
        }
    }

    /// Kills the second instance of process `index`, if it runs.
    pub fn kill_shadow(&self, index: usize) {
        if let Some(shadow) = self.slots.get(index).and_then(|slot| slot.shadow.as_ref()) {
            let _ = pidfd_send_signal(&shadow.handle, Signal::KILL);
        }
    }

    /// Readable when an instance of a process has ended.
    pub fn handles(&self) -> impl Iterator<Item = BorrowedFd<'_>> {
        let instances = self.slots.iter().flat_map(|slot| [&slot.running, &slot.shadow]);
        instances.flatten().map(|running| running.handle.as_fd())
    }

    /// What process `index` is doing, as the kernel reports it.
    pub fn inspect(&mut self, index: usize) -> Option<Observation> {
        let slot = self.slots.get(index)?;
        let pid = slot.running.as_ref()?.pid;
        let ProcessStat {
            state,
            cpu_s,
            core,
            is_ending,
            ..
        } = ProcessStat::now(pid)?;
        if is_ending {
            hasten(pid);
        }
        // One that ends does not hang: its end is waited for.
        let activity = match is_ending {
            true => ProcessActivity::Runnable,
            false => activity_of(state),
        };
        let core_runs = self.cores.runs(core, jink_runtime::now()) && !is_ending;
        tracing::debug!(
            process = slot.row.rules.name,
            doing = ?activity,
            cpu_s,
            core,
            core_runs,
            is_ending,
            "silent"
        );
        Some(Observation::Inspected {
            process: index,
            activity,
            cpu_s,
            core_runs,
        })
    }

    /// Number of processes.
    pub fn len(&self) -> usize {
        self.slots.len()
    }

    /// Reaps process `index` if it has ended.
    pub fn reap(&mut self, index: usize) -> Option<Exit> {
        let slot = self.slots.get_mut(index)?;
        let exit = slot.running.as_mut()?.reap()?;
        slot.running = None;
        Some(exit)
    }

    /// Reaps the second instance of process `index` if it has ended.
    pub fn reap_shadow(&mut self, index: usize) -> Option<Exit> {
        let slot = self.slots.get_mut(index)?;
        let exit = slot.shadow.as_mut()?.reap()?;
        slot.shadow = None;
        Some(exit)
    }

    /// The last lines that the second instance of process `index` wrote.
    pub fn last_shadow_lines(&self, index: usize) -> Vec<String> {
        self.slots
            .get(index)
            .map_or_else(Vec::new, |slot| slot.shadow_log.last_lines(POST_MORTEM_LINES))
    }

    /// The last lines that process `index` wrote.
    pub fn last_lines(&self, index: usize) -> Vec<String> {
        self.slots
            .get(index)
            .map_or_else(Vec::new, |slot| slot.log.last_lines(POST_MORTEM_LINES))
    }

    /// Moves logs aside that are longer than `max_bytes`.
    pub fn limit_logs(&mut self, max_bytes: u64) {
        for slot in &mut self.slots {
            // A log that is not there yet is short enough.
            let _ = (slot.log.limit(max_bytes), slot.shadow_log.limit(max_bytes));
        }
    }

    /// Writes down what runs, for the next supervisor; `adoptable` is what it must know of each.
    pub fn write_record(&self, adoptable: impl Fn(usize) -> Option<Adopted>) {
        let entries = self.slots.iter().enumerate().flat_map(|(index, slot)| {
            let entry = |pid: u32, found: Option<Adopted>| RecordEntry {
                name: slot.row.rules.name.clone(),
                pid,
                program: slot.row.program.clone(),
                found,
            };
            let main = slot
                .running
                .as_ref()
                .map(|running| entry(running.pid, adoptable(index)));
            let shadow = slot.shadow.as_ref().map(|shadow| entry(shadow.pid, None));
            [main, shadow].into_iter().flatten()
        });
        if let Err(error) = self.record.write(&entries.collect::<Vec<_>>()) {
            tracing::warn!("the record of processes cannot be written: {error}");
        }
    }
}

fn start(mut command: Command, log: &mut LogFile) -> io::Result<Running> {
    let out = log.open()?;
    let error = out.try_clone()?;
    let mut child = command.stdout(out).stderr(error).spawn()?;
    let id = child.id();
    let pid = i32::try_from(id).ok().and_then(Pid::from_raw);
    let handle = match pid.map(|pid| pidfd_open(pid, PidfdFlags::empty())) {
        Some(Ok(handle)) => handle,
        cause => {
            // A child that cannot be watched must not fly.
            child.kill()?;
            child.wait()?;
            return Err(io::Error::other(format!("no handle on the process: {cause:?}")));
        }
    };
    Ok(Running {
        pid: id,
        child: Some(child),
        handle,
        ahead_until: None,
    })
}

/// Puts a process that ends ahead of ordinary programs, as one that starts is: each of its threads needs a processor for that, and
/// nobody takes over before.
fn hasten(pid: u32) {
    let threads = std::fs::read_dir(format!("/proc/{pid}/task"));
    for thread in threads.into_iter().flatten().flatten() {
        if let Some(thread) = thread.file_name().to_str().and_then(|id| id.parse().ok()) {
            // It may have ended meanwhile; where this is refused it ends like any other program.
            let _ = schedule(thread, Scheduling::FifoItself(STARTING_PRIORITY));
        }
    }
}

/// Whether the process behind a handle has ended.
fn has_ended(handle: &OwnedFd) -> bool {
    let mut fds = [PollFd::from_borrowed_fd(handle.as_fd(), PollFlags::IN)];
    poll(&mut fds, Some(&Timespec::default())).is_ok_and(|ready| ready > 0)
}

/// What a state of the kernel means. Waiting for a disk counts as runnable: it is the machine that is slow, and no signal would end
/// it.
fn activity_of(state: char) -> ProcessActivity {
    match state {
        'R' | 'D' => ProcessActivity::Runnable,
        'S' | 'I' => ProcessActivity::Sleeping,
        _ => ProcessActivity::Stopped,
    }
}
