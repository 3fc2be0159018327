//! Whether a core runs at all. A virtual one is taken away by its host for hundreds of milliseconds at times: what is
//! bound to happen on it does not happen, timers included, and the process that it was running seems to run on.
//!
//! One thread per core, bound to it and above everything that is supervised, answers when asked. It sleeps otherwise.

use jink_runtime::realtime::{Scheduling, bind_to_core, schedule};
use jink_shared_types::Timestamp;
use rustix::thread::CpuSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::{Builder, JoinHandle};

/// An answer that took longer says that the core had stood still (s).
const PROMPT_S: f64 = 0.004;
/// After it has stood still: time for those on it to do what they are late with (s).
const CATCH_UP_S: f64 = 0.05;
/// An answer that is older says nothing about now (s); a silent process is looked at every 5 ms.
const TOO_OLD_S: f64 = 0.02;
/// SCHED_FIFO priority: the highest, so that a process that hogs its core is not taken for a core that stands still.
const PRIORITY: u8 = 99;
/// A thread that waits and answers needs little.
const STACK_BYTES: usize = 64 * 1024;

/// The last question and the last answer, as clock times (ns).
#[derive(Debug, Default)]
struct Talk {
    asked: AtomicU64,
    answered: AtomicU64,
}

/// What follows from them.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Finding {
    /// It ran a moment ago.
    Runs,
    /// It does not answer, or did so late a moment ago.
    StandsStill,
    /// It has to be asked first.
    Unknown,
}

impl Talk {
    /// What is known at `now`.
    fn finding(&self, now: Timestamp) -> Finding {
        let at = |time: &AtomicU64| Timestamp::from_ns(time.load(Ordering::Acquire));
        let (asked, answered) = (at(&self.asked), at(&self.answered));
        if answered < asked {
            return Finding::StandsStill;
        }
        let age_s = now.seconds_since(answered);
        let was_late = answered.seconds_since(asked) > PROMPT_S;
        if !asked.is_set() || age_s > TOO_OLD_S || was_late && age_s > CATCH_UP_S {
            Finding::Unknown
        } else if was_late {
            Finding::StandsStill
        } else {
            Finding::Runs
        }
    }
}

struct Core {
    number: usize,
    talk: Arc<Talk>,
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

    /// Whether `core` is known to run at `now`; if nothing is known, it is asked, and the next call knows more.
    pub fn runs(&self, core: usize, now: Timestamp) -> bool {
        let Some(core) = self.cores.iter().find(|one| one.number == core) else {
            return true;
        };
        match core.talk.finding(now) {
            Finding::Runs => true,
            Finding::StandsStill => false,
            Finding::Unknown => {
                core.talk
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
        let talk = Arc::new(Talk::default());
        let answers = Arc::clone(&talk);
        let thread = Builder::new()
            .name(format!("core {number}"))
            .stack_size(STACK_BYTES)
            .spawn(move || answer(number, &answers))?;
        Ok(Self { number, talk, thread })
    }
}

/// Lives as long as the process.
fn answer(core: usize, talk: &Talk) {
    if let Err(error) = bind_to_core(core) {
        tracing::debug!("core {core} is watched from elsewhere: {error}");
    }
    if let Err(error) = schedule(0, Scheduling::FifoItself(PRIORITY)) {
        tracing::debug!("core {core} is watched with ordinary priority: {error}");
    }
    loop {
        std::thread::park();
        if talk.answered.load(Ordering::Acquire) < talk.asked.load(Ordering::Acquire) {
            let now = jink_runtime::now().ns_since(Timestamp::NEVER);
            talk.answered.store(now, Ordering::Release);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Cores, Finding, Talk};
    use jink_shared_types::Timestamp;
    use std::sync::atomic::Ordering;
    use std::time::{Duration, Instant};

    fn talk(asked_s: f64, answered_s: f64) -> Talk {
        let talk = Talk::default();
        talk.asked.store((asked_s * 1e9) as u64, Ordering::Relaxed);
        talk.answered.store((answered_s * 1e9) as u64, Ordering::Relaxed);
        talk
    }

    #[test]
    fn a_core_runs_if_it_has_just_answered_at_once() {
        let at = Timestamp::from_seconds;
        assert_eq!(Talk::default().finding(at(10.0)), Finding::Unknown, "never asked");
        assert_eq!(
            talk(10.0, 0.0).finding(at(10.1)),
            Finding::StandsStill,
            "no answer"
        );
        assert_eq!(talk(10.0, 10.0001).finding(at(10.01)), Finding::Runs);
        assert_eq!(
            talk(10.0, 10.0001).finding(at(10.5)),
            Finding::Unknown,
            "long ago"
        );
        assert_eq!(
            talk(10.0, 10.3).finding(at(10.31)),
            Finding::StandsStill,
            "it comes back from standing still, and those on it are late"
        );
        assert_eq!(
            talk(10.0, 10.3).finding(at(10.4)),
            Finding::Unknown,
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
