//! What the machine itself did during the flight: a gap in the setpoints on a host that stood still says nothing about
//! the flight code.

use jink_runtime::procfs::CpuTimes;
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A thread that wants to run this often and does nothing else.
const PERIOD: Duration = Duration::from_millis(2);

/// Watches the machine until it is asked.
#[derive(Debug)]
pub struct Machine {
    stop: Arc<AtomicBool>,
    /// One on each processor: the hypervisor takes them away one at a time.
    watchers: Vec<JoinHandle<Duration>>,
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
        let allowed = sched_getaffinity(None).unwrap_or_else(|_| CpuSet::new());
        let watchers = (0..CpuSet::MAX_CPU)
            .filter(|processor| allowed.is_set(*processor))
            .map(|processor| {
                let stopped = Arc::clone(&stop);
                std::thread::spawn(move || watch_processor(processor, &stopped))
            })
            .collect();
        Self {
            stop,
            watchers,
            stolen_before_ms: stolen_ms(),
        }
    }

    /// Ends watching.
    pub fn times(self) -> MachineTimes {
        self.stop.store(true, Ordering::Relaxed);
        MachineTimes {
            stall_max_ms: self
                .watchers
                .into_iter()
                .filter_map(|watcher| watcher.join().ok())
                .max()
                .map_or(0.0, |longest| longest.as_secs_f64() * 1e3),
            stolen_ms: stolen_ms() - self.stolen_before_ms,
        }
    }
}

/// Sleeps again and again on one processor; the longest time by which it was woken late.
fn watch_processor(processor: usize, stop: &AtomicBool) -> Duration {
    let mut only = CpuSet::new();
    only.set(processor);
    // Where that is not allowed it watches whichever processor it is given.
    let _anywhere = sched_setaffinity(None, &only);
    let mut longest = Duration::ZERO;
    while !stop.load(Ordering::Relaxed) {
        let begin = Instant::now();
        std::thread::sleep(PERIOD);
        longest = longest.max(begin.elapsed().saturating_sub(PERIOD));
    }
    longest
}

fn stolen_ms() -> f64 {
    CpuTimes::now().map_or(0.0, |times| times.all.stolen_ms())
}
