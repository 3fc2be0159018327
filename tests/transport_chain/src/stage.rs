//! One process of the chain.

use crate::{Fault, message, now_ns};
use rustix::process::{Signal, set_parent_process_death_signal};
use rustix::time::{ClockId, clock_gettime};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// A process looks this often whether it is to end.
const PATIENCE: Duration = Duration::from_millis(50);

/// Which process of which chain.
#[derive(Clone, Debug, clap::Args)]
pub struct StageArgs {
    /// Transport
    #[arg(long)]
    pub transport: String,
    /// Place in the chain; 0 = sensor
    #[arg(long)]
    pub place: usize,
    /// Size of the message of each hop (bytes, multiples of 8)
    #[arg(long, value_delimiter = ',')]
    pub bytes: Vec<usize>,
    /// Messages of the first process (Hz)
    #[arg(long)]
    pub rate_hz: f64,
    /// Core to stay on
    #[arg(long)]
    pub core: Option<usize>,
    /// Folder for sockets, shared memory and results
    #[arg(long)]
    pub folder: PathBuf,
}

impl StageArgs {
    /// Size of the message that it gets (bytes); `None` of the first.
    pub fn bytes_in(&self) -> Option<usize> {
        self.place
            .checked_sub(1)
            .and_then(|hop| self.bytes.get(hop))
            .copied()
    }

    /// Size of the message that it sends (bytes); `None` of the last.
    pub fn bytes_out(&self) -> Option<usize> {
        self.bytes.get(self.place).copied()
    }

    /// A file of hop `hop`.
    pub fn hop_file(&self, hop: usize, suffix: &str) -> PathBuf {
        self.folder.join(format!("{hop}.{suffix}"))
    }
}

/// The end of a hop that messages come out of.
pub trait Incoming {
    /// Waits for one message, at most for `patience`, and hands it to `take`.
    ///
    /// # Errors
    /// The transport's.
    fn receive(&mut self, patience: Duration, take: &mut dyn FnMut(&[u8])) -> Result<(), Fault>;
}

/// The end of a hop that messages go into.
pub trait Outgoing {
    /// Has `fill` write one message and sends it.
    ///
    /// # Errors
    /// The transport's.
    fn send(&mut self, fill: &mut dyn FnMut(&mut [u8])) -> Result<(), Fault>;
}

/// What a process has to say when it ends.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Account {
    /// When it sent or got its first message, and when it wrote this (ns).
    pub span_ns: [u64; 2],
    /// Processor time that it used between the two (s).
    pub cpu_s: f64,
    /// Marks that it sent: of the first process.
    pub sent: Vec<u64>,
    /// Marks that it got, and when it had read them (ns): of the last process.
    pub arrived: Vec<[u64; 2]>,
    /// Messages that were not whole.
    pub torn: u64,
    /// When it began (s of processor time).
    #[serde(skip)]
    begin_s: f64,
}

fn cpu_s() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

impl Account {
    fn begin(&mut self) {
        if self.span_ns[0] == 0 {
            self.span_ns[0] = now_ns();
            self.begin_s = cpu_s();
        }
    }

    /// The message of this mark is about to be sent.
    pub fn sends(&mut self, mark: u64) {
        self.begin();
        self.sent.push(mark);
    }

    /// A message has been read: its mark, or that it was torn. Returns the mark.
    pub fn got(&mut self, mark: Option<u64>, is_last: bool) -> Option<u64> {
        let now = now_ns();
        self.begin();
        match mark {
            Some(mark) if is_last => self.arrived.push([mark, now]),
            Some(_) => {}
            None => self.torn += 1,
        }
        mark
    }

    /// Writes it where the chain looks for it.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&mut self, folder: &Path, place: usize) -> Result<(), Fault> {
        self.span_ns[1] = now_ns();
        self.cpu_s = cpu_s() - self.begin_s;
        std::fs::write(account_file(folder, place), serde_json::to_vec(self)?)?;
        Ok(())
    }
}

/// Where the process at `place` writes its account.
pub fn account_file(folder: &Path, place: usize) -> PathBuf {
    folder.join(format!("{place}.json"))
}

/// Says that the first message has passed the whole chain.
///
/// # Errors
/// The file cannot be written.
pub fn announce_first(folder: &Path) -> Result<(), Fault> {
    std::fs::write(first_file(folder), b"")?;
    Ok(())
}

/// The file that says so.
pub fn first_file(folder: &Path) -> PathBuf {
    folder.join("first")
}

/// What every process does at its start: it ends with who started it, and at SIGTERM or SIGINT.
///
/// # Errors
/// The kernel refuses.
pub fn prepare(core: Option<usize>) -> Result<Arc<AtomicBool>, Fault> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    set_parent_process_death_signal(Some(Signal::TERM))?;
    if let Some(core) = core {
        let mut set = rustix::thread::CpuSet::new();
        set.set(core);
        rustix::thread::sched_setaffinity(None, &set)?;
    }
    Ok(stop)
}

/// Runs one process until SIGTERM or SIGINT. The first has no `incoming`, the last no `outgoing`.
///
/// # Errors
/// The transport's, or the account cannot be written.
pub fn run(
    args: &StageArgs,
    stop: &AtomicBool,
    mut incoming: Option<Box<dyn Incoming>>,
    mut outgoing: Option<Box<dyn Outgoing>>,
) -> Result<(), Fault> {
    let mut account = Account::default();
    let period = Duration::from_secs_f64(1.0 / args.rate_hz);
    let mut next = std::time::Instant::now() + period;
    let is_last = outgoing.is_none();
    while !stop.load(Ordering::Relaxed) {
        let mark = match &mut incoming {
            Some(incoming) => {
                let mut mark = None;
                incoming.receive(PATIENCE, &mut |message| {
                    mark = account.got(message::mark_of(message), is_last);
                })?;
                if is_last && account.arrived.len() == 1 {
                    announce_first(&args.folder)?;
                }
                mark
            }
            None => {
                std::thread::sleep(next.saturating_duration_since(std::time::Instant::now()));
                next += period;
                let mark = now_ns();
                account.sends(mark);
                Some(mark)
            }
        };
        if let (Some(mark), Some(outgoing)) = (mark, &mut outgoing) {
            outgoing.send(&mut |message| message::fill(message, mark))?;
        }
    }
    account.write(&args.folder, args.place)
}
