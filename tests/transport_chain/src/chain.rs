//! All processes of a chain: started, watched and ended; what was measured.

use crate::stage::{Account, account_file, first_file};
use crate::{Fault, PLACES, now_ns};
use rustix::process::{Pid, Signal, kill_process};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// The first message has to have passed within this (s).
const PATIENCE_S: f64 = 20.0;
/// What is sent in this time after the first arrival is not counted (s).
const WARM_UP_S: f64 = 1.0;
/// What is sent in this time before the end is not counted: it may be under way (s).
const UNDER_WAY_S: f64 = 0.3;
/// A process has this long to end by itself (s).
const END_S: f64 = 5.0;

/// What is to be measured.
#[derive(Clone, Debug, clap::Args)]
pub struct Chain {
    /// Transport
    #[arg(long)]
    pub transport: String,
    /// Size of the message of each hop (bytes, multiples of 8)
    #[arg(long, value_delimiter = ',')]
    pub bytes: Vec<usize>,
    /// Messages of the first process (Hz)
    #[arg(long)]
    pub rate_hz: f64,
    /// How long it is measured (s)
    #[arg(long)]
    pub seconds: f64,
    /// Empty folder for sockets, shared memory and results
    #[arg(long)]
    pub folder: PathBuf,
    /// Cores that the processes are laid out over, one after the other; 0 = wherever the kernel puts them
    #[arg(long, default_value_t = 0)]
    pub cores: usize,
}

/// One measurement of one transport.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Round {
    /// Which transport.
    pub transport: String,
    /// From the begin of filling the first message to the end of reading the last (us), in the order of sending.
    pub latencies_us: Vec<f64>,
    /// Messages that did not pass.
    pub lost: usize,
    /// Messages that were not whole somewhere.
    pub torn: u64,
    /// Processor time of all processes of the chain (% of one core).
    pub cpu_percent: f64,
}

/// The processes; they end with this.
struct Processes(Vec<Child>);

impl Processes {
    /// An error if one of them has ended.
    fn check(&mut self) -> Result<(), Fault> {
        for (place, child) in self.0.iter_mut().enumerate() {
            if let Some(status) = child.try_wait()? {
                return Err(format!("the {} of the chain has ended: {status}", PLACES[place]).into());
            }
        }
        Ok(())
    }

    /// Asks all of them to end, and waits for it.
    fn end(&mut self) -> Result<(), Fault> {
        for child in &self.0 {
            kill_process(Pid::from_child(child), Signal::TERM)?;
        }
        let until = Instant::now() + Duration::from_secs_f64(END_S);
        for (place, child) in self.0.iter_mut().enumerate() {
            loop {
                match child.try_wait()? {
                    Some(status) if status.success() => break,
                    Some(status) => return Err(format!("the {} failed: {status}", PLACES[place]).into()),
                    None if Instant::now() > until => {
                        return Err(format!("the {} does not end", PLACES[place]).into());
                    }
                    None => std::thread::sleep(Duration::from_millis(5)),
                }
            }
        }
        Ok(())
    }
}

impl Drop for Processes {
    fn drop(&mut self) {
        for child in &mut self.0 {
            // Those that have ended are none of ours any more, and the others have no say.
            let _gone = child.kill();
            let _reaped = child.wait();
        }
    }
}

impl Chain {
    /// The core of the process at `place`.
    pub fn core_of(&self, place: usize) -> Option<usize> {
        (self.cores > 0).then(|| place % self.cores)
    }

    /// The command line of the stage at `place` of program `program`, as [`crate::program`] understands it.
    pub fn stage_command(&self, program: &Path, place: usize) -> Command {
        let mut command = Command::new(program);
        let bytes: Vec<String> = self.bytes.iter().map(usize::to_string).collect();
        command
            .args(["stage", "--transport", &self.transport])
            .args(["--place", &place.to_string(), "--bytes", &bytes.join(",")])
            .args(["--rate-hz", &self.rate_hz.to_string(), "--folder"])
            .arg(&self.folder);
        if let Some(core) = self.core_of(place) {
            command.args(["--core", &core.to_string()]);
        }
        command
    }

    /// Measures: starts what `command` says for each place, last place first, so that whoever sends finds a reader.
    ///
    /// # Errors
    /// A process cannot be started, ends before it is to, or nothing passes; `is_interrupted` has said so.
    pub fn measure(
        &self,
        command: impl Fn(usize) -> Command,
        is_interrupted: &dyn Fn() -> bool,
    ) -> Result<Round, Fault> {
        let mut children = Processes(Vec::new());
        for place in (0..=self.bytes.len()).rev() {
            let child = command(place).stdin(Stdio::null()).stdout(Stdio::null()).spawn();
            children
                .0
                .insert(0, child.map_err(|error| format!("{}: {error}", PLACES[place]))?);
        }
        self.watch(&mut || children.check(), is_interrupted)?;
        let window = self.window(is_interrupted)?;
        children.check()?;
        children.end()?;
        self.round(window)
    }

    /// Waits for the first message that has passed.
    ///
    /// # Errors
    /// It does not come, `check` says so, or `is_interrupted`.
    pub fn watch(
        &self,
        check: &mut dyn FnMut() -> Result<(), Fault>,
        is_interrupted: &dyn Fn() -> bool,
    ) -> Result<(), Fault> {
        let until = Instant::now() + Duration::from_secs_f64(PATIENCE_S);
        while !first_file(&self.folder).exists() {
            check()?;
            if is_interrupted() {
                return Err("interrupted".into());
            }
            if Instant::now() > until {
                return Err(format!(
                    "{}: nothing has passed the chain in {PATIENCE_S} s",
                    self.transport
                )
                .into());
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        Ok(())
    }

    /// Lets the time of the measurement pass; what is sent between the two times counts (ns).
    ///
    /// # Errors
    /// `is_interrupted` says so.
    pub fn window(&self, is_interrupted: &dyn Fn() -> bool) -> Result<[u64; 2], Fault> {
        std::thread::sleep(Duration::from_secs_f64(WARM_UP_S));
        let begin_ns = now_ns();
        let end_ns = begin_ns + (self.seconds * 1e9) as u64;
        let until_ns = end_ns + (UNDER_WAY_S * 1e9) as u64;
        while now_ns() < until_ns {
            if is_interrupted() {
                return Err("interrupted".into());
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        Ok([begin_ns, end_ns])
    }

    /// What the processes have written down.
    ///
    /// # Errors
    /// One of them has not.
    pub fn round(&self, [begin_ns, end_ns]: [u64; 2]) -> Result<Round, Fault> {
        let mut accounts = Vec::new();
        for place in 0..=self.bytes.len() {
            let file = account_file(&self.folder, place);
            let text = std::fs::read(&file).map_err(|error| format!("{}: {error}", file.display()))?;
            let account: Account = serde_json::from_slice(&text)?;
            accounts.push(account);
        }
        let (Some(first), Some(last)) = (accounts.first(), accounts.last()) else {
            return Err("a chain without processes".into());
        };
        let counted = |mark: u64| (begin_ns..end_ns).contains(&mark);
        let sent = first.sent.iter().filter(|mark| counted(**mark)).count();
        let arrived = last.arrived.iter().filter(|[mark, _]| counted(*mark));
        let latencies_us: Vec<f64> = arrived
            .map(|[mark, read]| read.saturating_sub(*mark) as f64 * 1e-3)
            .collect();
        let cpu = accounts.iter().map(|account| {
            let [from_ns, to_ns] = account.span_ns;
            account.cpu_s / (to_ns.saturating_sub(from_ns).max(1) as f64 * 1e-9)
        });
        Ok(Round {
            transport: self.transport.clone(),
            lost: sent.saturating_sub(latencies_us.len()),
            latencies_us,
            torn: accounts.iter().map(|account| account.torn).sum(),
            cpu_percent: 100.0 * cpu.sum::<f64>(),
        })
    }
}
