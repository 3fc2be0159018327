//! Whether a core runs at all. A virtual one is taken away by its host for hundreds of milliseconds at times: what is
//! bound to happen on it does not happen, timers included, and the process that it was running seems to run on.
//!
//! One thread per core, bound to it and above everything that is supervised, answers requests. It sleeps otherwise.

use jink_runtime::realtime::{Scheduling, bind_to_core, schedule};
use jink_shared_types::Timestamp;
use rustix::thread::CpuSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::{Builder, JoinHandle};

/// An answer that took longer means that the core had stood still (s).
const PROMPT_S: f64 = 0.004;
/// After it has stood still: time for those on it to do what they are late with (s).
const CATCH_UP_S: f64 = 0.05;
/// An answer that is older means nothing now (s); a silent process is inspected every 5 ms.
const TOO_OLD_S: f64 = 0.02;
/// SCHED_FIFO priority: the highest, so that a process that hogs its core is not taken for a core that stands still.
const PRIORITY: u8 = 99;
/// A thread that waits and answers needs little.
const STACK_BYTES: usize = 64 * 1024;

/// The last question and the last answer, as clock times (ns).
#[derive(Debug, Default)]
struct CoreExchange {
    asked: AtomicU64,
    answered: AtomicU64,
}

/// What follows from them.
#[derive(Clone, Copy, Debug, PartialEq)]
enum CoreState {
    /// It ran a moment ago.
    Runs,
    /// It does not answer, or did so late a moment ago.
    StandsStill,
    /// A request has to be sent first.
    Unknown,
}

impl CoreExchange {
    /// What is known at `now`.
    fn state(&self, now: Timestamp) -> CoreState {
        let at = |time: &AtomicU64| Timestamp::from_ns(time.load(Ordering::Acquire));
        let (asked, answered) = (at(&self.asked), at(&self.answered));
        if answered < asked {
            return CoreState::StandsStill;
        }
        let age_s = now.seconds_since(answered);
        let was_late = answered.seconds_since(asked) > PROMPT_S;
        if !asked.is_set() || age_s > TOO_OLD_S || was_late && age_s > CATCH_UP_S {
            CoreState::Unknown
        } else if was_late {
            CoreState::StandsStill
        } else {
            CoreState::Runs
        }
    }
}

struct Core {
    number: usize,
    exchange: Arc<CoreExchange>,
    thread: JoinHandle<()>,
}

/// All cores of the machine.
pub struct Cores {
    cores: Vec<Core>,
}

impl Cores {
    /// Starts to watch those that this process may use. A core that cannot be watched counts as one that runs.
    pub fn watch() -> Self {
        let ours = rustix::thread::sched_getaffinity(None).unwrap_or_default();
        let numbers = (0..CpuSet::MAX_CPU).filter(|core| ours.is_set(*core));
        let cores = numbers.filter_map(|core| match Core::watch(core) {
            Ok(core) => Some(core),
            Err(error) => {
                tracing::warn!("core {core} is not watched: {error}");
                None
            }
        });
        Self {
            cores: cores.collect(),
        }
    }

    /// Whether `core` is known to run at `now`; if nothing is known, a request is sent, and the next call knows more.
    pub fn runs(&self, core: usize, now: Timestamp) -> bool {
        let Some(core) = self.cores.iter().find(|one| one.number == core) else {
            return true;
        };
        match core.exchange.state(now) {
            CoreState::Runs => true,
            CoreState::StandsStill => false,
            CoreState::Unknown => {
                core.exchange
                    .asked
                    .store(now.ns_since(Timestamp::NEVER), Ordering::Release);
                core.thread.thread().unpark();
                false
            }
        }
    }
}

impl Core {
    fn watch(number: usize) -> std::io::Result<Self> {
        let exchange = Arc::new(CoreExchange::default());
        let answers = Arc::clone(&exchange);
        let thread = Builder::new()
            .name(format!("core {number}"))
            .stack_size(STACK_BYTES)
            .spawn(move || answer(number, &answers))?;
        Ok(Self {
            number,
            exchange,
            thread,
        })
    }
}

/// Lives as long as the process.
fn answer(core: usize, exchange: &CoreExchange) {
    if let Err(error) = bind_to_core(core) {
        tracing::debug!("core {core} is watched from elsewhere: {error}");
    }
    if let Err(error) = schedule(0, Scheduling::FifoItself(PRIORITY)) {
        tracing::debug!("core {core} is watched with ordinary priority: {error}");
    }
    loop {
        std::thread::park();
        if exchange.answered.load(Ordering::Acquire) < exchange.asked.load(Ordering::Acquire) {
            let now = jink_runtime::now().ns_since(Timestamp::NEVER);
            exchange.answered.store(now, Ordering::Release);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{CoreExchange, CoreState, Cores};
    use jink_shared_types::Timestamp;
    use std::sync::atomic::Ordering;
    use std::time::{Duration, Instant};

    fn exchange(asked_s: f64, answered_s: f64) -> CoreExchange {
        let exchange = CoreExchange::default();
        exchange.asked.store((asked_s * 1e9) as u64, Ordering::Relaxed);
        exchange
            .answered
            .store((answered_s * 1e9) as u64, Ordering::Relaxed);
        exchange
    }

    #[test]
    fn a_core_runs_if_it_has_just_answered_at_once() {
        let at = Timestamp::from_seconds;
        assert_eq!(
            CoreExchange::default().state(at(10.0)),
            CoreState::Unknown,
            "never asked"
        );
        assert_eq!(
            exchange(10.0, 0.0).state(at(10.1)),
            CoreState::StandsStill,
            "no answer"
        );
        assert_eq!(exchange(10.0, 10.0001).state(at(10.01)), CoreState::Runs);
        assert_eq!(
            exchange(10.0, 10.0001).state(at(10.5)),
            CoreState::Unknown,
            "long ago"
        );
        assert_eq!(
            exchange(10.0, 10.3).state(at(10.31)),
            CoreState::StandsStill,
            "it comes back from standing still, and those on it are late"
        );
        assert_eq!(
            exchange(10.0, 10.3).state(at(10.4)),
            CoreState::Unknown,
            "they had their time"
        );
    }

    #[test]
    fn every_core_of_this_machine_answers() {
        let cores = Cores::watch();
        assert!(!cores.cores.is_empty());
        for core in cores.cores.iter().map(|core| core.number) {
            let patience = Instant::now();
            while !cores.runs(core, jink_runtime::now()) {
                assert!(patience.elapsed() < Duration::from_secs(60), "core {core}");
                std::thread::sleep(Duration::from_millis(1));
            }
        }
        assert!(cores.runs(usize::MAX, jink_runtime::now()), "none of ours");
    }
}
