//! What the machine itself did during the flight: a gap in the setpoints on a host that stood still says nothing about
//! the flight code.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A thread that wants to run this often and does nothing else.
const PERIOD: Duration = Duration::from_millis(2);
/// One tick of /proc/stat (ms).
const TICK_MS: f64 = 10.0;

/// Watches the machine until it is asked.
#[derive(Debug)]
pub struct Machine {
    stop: Arc<AtomicBool>,
    watcher: JoinHandle<Duration>,
    stolen_before_ms: f64,
}

/// What was seen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MachineTimes {
    /// The longest time by which a sleeping thread was woken late (ms).
    pub stall_max_ms: f64,
    /// Time the hypervisor gave to others, all processors together (ms); 0 where the kernel does not say.
    pub stolen_ms: f64,
}

impl Machine {
    /// Begins to watch.
    pub fn watch() -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let watcher = std::thread::spawn(move || {
            let mut longest = Duration::ZERO;
            while !stopped.load(Ordering::Relaxed) {
                let begin = Instant::now();
                std::thread::sleep(PERIOD);
                longest = longest.max(begin.elapsed().saturating_sub(PERIOD));
            }
            longest
        });
        Self {
            stop,
            watcher,
            stolen_before_ms: stolen_ms(),
        }
    }

    /// Ends watching.
    pub fn times(self) -> MachineTimes {
        self.stop.store(true, Ordering::Relaxed);
        MachineTimes {
            stall_max_ms: self
                .watcher
                .join()
                .map_or(0.0, |longest| longest.as_secs_f64() * 1e3),
            stolen_ms: stolen_ms() - self.stolen_before_ms,
        }
    }
}

/// The ninth field of the first line of /proc/stat (proc(5): `cpu user nice system idle iowait irq softirq steal`).
fn stolen_ms() -> f64 {
    let stat = std::fs::read_to_string("/proc/stat").unwrap_or_default();
    let ticks = stat
        .split_whitespace()
        .nth(8)
        .and_then(|ticks| ticks.parse().ok());
    ticks.unwrap_or(0.0) * TICK_MS
}
