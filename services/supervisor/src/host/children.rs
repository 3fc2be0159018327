//! Starting processes, signalling them, and learning that they have ended.

use super::log_file::LogFile;
use super::record::Record;
use jink_runtime::Instance;
use jink_supervisor::supervision::{Exit, Observation};
use jink_supervisor::table::ProcessRow;
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};

/// Lines of a dead process's log that are repeated in the supervisor's.
const POST_MORTEM_LINES: usize = 20;

/// What every process is told.
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

    fn command(&self, row: &ProcessRow, generation: u32) -> Command {
        let mut command = Command::new(&row.program);
        command
            .args(["--process", &row.rules.name])
            .args(["--instance", &self.instance.to_string()])
            .arg("--config")
            .arg(&self.config)
            .args(["--generation", &generation.to_string()])
            .args(["--budget-us", &row.rules.cycle_budget_us.to_string()])
            .args(["--priority", &row.priority.to_string()])
            .args(["--log", &row.log.unwrap_or(self.log).to_string().to_lowercase()]);
        if let Some(core) = row.core {
            command.args(["--core", &core.to_string()]);
        }
        if row.lock_memory {
            command.arg("--lock-memory");
        }
        if !row.arguments.is_empty() {
            command.arg("--").args(&row.arguments);
        }
        // The service manager's socket is the supervisor's: a child that spoke to it would speak for the whole system.
        for variable in ["NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"] {
            command.env_remove(variable);
        }
        // A group of its own: Ctrl-C at the terminal reaches the supervisor, which stops the others in order.
        command.stdin(Stdio::null()).process_group(0);
        command
    }
}

struct Running {
    child: Child,
    handle: OwnedFd,
}

struct Slot {
    row: ProcessRow,
    log: LogFile,
    running: Option<Running>,
}

/// All processes of the system.
pub struct Children {
    launch: Launch,
    slots: Vec<Slot>,
    record: Record,
}

impl Children {
    /// None of them started.
    pub fn new(launch: Launch, rows: Vec<ProcessRow>, record: Record) -> Self {
        let slots = rows
            .into_iter()
            .map(|row| Slot {
                log: LogFile::new(&launch.instance, &row.rules.name),
                row,
                running: None,
            })
            .collect();
        Self {
            launch,
            slots,
            record,
        }
    }

    /// Starts process `index`; what came of it is the observation.
    pub fn spawn(&mut self, index: usize, generation: u32) -> Option<Observation> {
        let slot = self.slots.get_mut(index)?;
        let name = &slot.row.rules.name;
        match start(&self.launch, &slot.row, &mut slot.log, generation) {
            Ok(running) => {
                let pid = running.child.id();
                tracing::info!(process = name, pid, generation, "started");
                slot.running = Some(running);
                self.write_record();
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

    /// Sends `signal` to process `index`, if it runs.
    pub fn signal(&self, index: usize, signal: Signal) {
        if let Some(running) = self.slots.get(index).and_then(|slot| slot.running.as_ref()) {
            // It may have ended meanwhile; then that is what will be observed.
            let _gone_already = pidfd_send_signal(&running.handle, signal);
        }
    }

    /// Readable when process `index` has ended.
    pub fn handle(&self, index: usize) -> Option<BorrowedFd<'_>> {
        Some(self.slots.get(index)?.running.as_ref()?.handle.as_fd())
    }

    /// What process `index` is doing, as the kernel says.
    pub fn examine(&self, index: usize) -> Option<Observation> {
        let slot = self.slots.get(index)?;
        let stat =
            std::fs::read_to_string(format!("/proc/{}/stat", slot.running.as_ref()?.child.id())).ok()?;
        let (runnable, cpu_s) = doing(&stat)?;
        tracing::debug!(process = slot.row.rules.name, runnable, cpu_s, "silent");
        Some(Observation::Examined {
            process: index,
            runnable,
            cpu_s,
        })
    }

    /// Number of processes.
    pub fn len(&self) -> usize {
        self.slots.len()
    }

    /// Reaps process `index` if it has ended.
    pub fn reap(&mut self, index: usize) -> Option<Exit> {
        let slot = self.slots.get_mut(index)?;
        let status = slot.running.as_mut()?.child.try_wait().ok()??;
        slot.running = None;
        Some(exit_of(status))
    }

    /// The last lines that process `index` wrote.
    pub fn last_lines(&self, index: usize) -> Vec<String> {
        self.slots
            .get(index)
            .map_or_else(Vec::new, |slot| slot.log.last_lines(POST_MORTEM_LINES))
    }

    /// Keeps the logs within their bounds.
    pub fn limit_logs(&mut self) {
        for slot in &mut self.slots {
            // A log that is not there yet is short enough.
            let _not_there_yet = slot.log.limit();
        }
    }

    fn write_record(&self) {
        let running = self.slots.iter().filter_map(|slot| {
            let pid = slot.running.as_ref()?.child.id();
            Some((pid, slot.row.rules.name.as_str()))
        });
        if let Err(error) = self.record.write(running) {
            tracing::warn!("the record of processes cannot be written: {error}");
        }
    }
}

fn start(launch: &Launch, row: &ProcessRow, log: &mut LogFile, generation: u32) -> io::Result<Running> {
    let out = log.open()?;
    let error = out.try_clone()?;
    let mut child = launch
        .command(row, generation)
        .stdout(out)
        .stderr(error)
        .spawn()?;
    let pid = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
    let handle = match pid.map(|pid| pidfd_open(pid, PidfdFlags::empty())) {
        Some(Ok(handle)) => handle,
        cause => {
            // A child that cannot be watched must not fly.
            child.kill()?;
            child.wait()?;
            return Err(io::Error::other(format!("no handle on the process: {cause:?}")));
        }
    };
    Ok(Running { child, handle })
}

fn exit_of(status: ExitStatus) -> Exit {
    let small = |number: i32| u8::try_from(number).unwrap_or(u8::MAX);
    match (status.code(), status.signal()) {
        (Some(code), _) => Exit::Code(small(code)),
        (None, signal) => Exit::Signal(small(signal.unwrap_or_default())),
    }
}

/// Whether a process is runnable, and the CPU time it has used (s), out of its `/proc/<pid>/stat` (proc(5): the state is
/// the first field behind the name in parentheses, user and system time are the 12th and 13th, in hundredths of a second).
/// Waiting for a disk counts as runnable: it is the machine that is slow, and no signal would end it.
fn doing(stat: &str) -> Option<(bool, f64)> {
    const TICKS_PER_S: f64 = 100.0;
    let (_, fields) = stat.rsplit_once(") ")?;
    let fields: Vec<&str> = fields.split(' ').collect();
    let ticks = |index: usize| fields.get(index)?.parse::<f64>().ok();
    let cpu_s = (ticks(11)? + ticks(12)?) / TICKS_PER_S;
    Some((matches!(*fields.first()?, "R" | "D"), cpu_s))
}

#[cfg(test)]
mod tests {
    use super::doing;

    #[test]
    fn the_kernels_words_are_understood() {
        let rest = "1 2 2 0 -1 4194304 100 0 0 0 12 30 0 0 20 0 1 0 100 1000 10";
        assert_eq!(doing(&format!("7 (a (b) c) R {rest}")), Some((true, 0.42)));
        assert_eq!(doing(&format!("7 (x) D {rest}")), Some((true, 0.42)));
        for still in ["T", "S", "Z"] {
            assert_eq!(doing(&format!("7 (x) {still} {rest}")), Some((false, 0.42)));
        }
        assert_eq!(doing(""), None);
        let own = std::fs::read_to_string("/proc/self/stat").unwrap();
        assert!(doing(&own).is_some_and(|(_, cpu_s)| (0.0..1e6).contains(&cpu_s)));
    }
}
