//! What every simulation does around its steps: it goes with the real time, and the truth goes to whoever wants it.

use super::process::AutopilotProcess;
use super::relay;
use super::watch::{AutopilotState, AutopilotWatch};
use jink_shared_types::Timestamp;
use jink_simulated_world::vehicle::{STEP_US, VehicleTruth};
use std::collections::VecDeque;
use std::io::Write;
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Longest time until an autopilot sends to its simulator: it needs a few seconds on a busy machine.
pub(super) const CONNECT_PATIENCE: Duration = Duration::from_secs(30);
/// Samples kept for a reader that does not come (4 s).
const SAMPLES_MAX: usize = 1_000;
/// More steps than this behind, the simulation goes on slower than real time instead of catching up: 200 ms.
const CATCH_UP_STEPS: u64 = 50;
/// Truth samples (Hz).
const STEP_RATE_HZ: u32 = 1_000_000 / STEP_US as u32;

/// The truth at one moment, 250 times a second.
#[derive(Clone, Copy, Debug)]
pub struct SitlSample {
    /// When, on the board's clock.
    pub time: Timestamp,
    /// Simulated time since the start (s).
    pub time_s: f64,
    /// Where the vehicle really is; local NED about its start.
    pub truth: VehicleTruth,
    /// What the autopilot says.
    pub autopilot: AutopilotState,
    /// By how much the simulation ran behind real time (s).
    pub late_s: f64,
}

/// What the threads have in common.
pub(super) struct Shared {
    pub samples: Mutex<VecDeque<SitlSample>>,
    pub ended: Mutex<Option<String>>,
    pub stop: AtomicBool,
    pub now_us: AtomicU64,
    pub watch: Arc<Mutex<AutopilotWatch>>,
}

/// What every simulation does around its steps.
pub(super) struct Stage {
    shared: Arc<Shared>,
    wakes: UnixStream,
    process: AutopilotProcess,
    begin: Timestamp,
    steps: u64,
}

impl Stage {
    /// Before the first step of `process`. Who reads the samples is woken by `wakes`.
    pub(super) fn new(shared: Arc<Shared>, wakes: UnixStream, process: AutopilotProcess) -> Self {
        Self {
            shared,
            wakes,
            process,
            begin: Timestamp::NEVER,
            steps: 0,
        }
    }

    /// Ends the process. An error is why the simulation is over.
    pub(super) fn end(&mut self, result: Result<(), String>) {
        self.process.stop();
        if let Err(reason) = result {
            *guard(&self.shared.ended) = Some(reason);
            self.wake();
        }
    }

    /// Whether to go on; an error if the autopilot has died.
    pub(super) fn goes_on(&mut self) -> Result<bool, String> {
        if self.shared.stop.load(Ordering::Relaxed) {
            return Ok(false);
        }
        match self.process.ended() {
            None => Ok(true),
            Some(status) => Err(format!(
                "the autopilot's process ended ({status}); its log is {}; it ends: {}",
                self.process.log().display(),
                self.process.last_words()
            )),
        }
    }

    /// The text for an autopilot from which nothing comes.
    pub(super) fn silence(&self, what: &str) -> String {
        format!(
            "{what}; the autopilot's log is {}; it ends: {}",
            self.process.log().display(),
            self.process.last_words()
        )
    }

    /// Publishes the truth after [`STEP_US`] more, which the simulation has reached with `late_s`; waits until the step is due
    /// in real time.
    pub(super) fn pace(&mut self, truth: VehicleTruth) {
        if !self.begin.is_set() {
            // Sensor frames end on beats of the clock: a pose is there then.
            self.begin = jink_runtime::now().next_beat(STEP_RATE_HZ);
        }
        self.steps += 1;
        let now = jink_runtime::now();
        let due_steps = now.ns_since(self.begin) / (STEP_US * 1_000);
        if due_steps > self.steps + CATCH_UP_STEPS {
            let behind = due_steps - self.steps - CATCH_UP_STEPS;
            self.begin = self.begin.plus_seconds(behind as f64 * STEP_US as f64 * 1e-6);
        }
        let due = Timestamp::from_ns(self.begin.ns + self.steps * STEP_US * 1_000);
        let wait_ns = due.ns_since(now);
        if wait_ns > 0 {
            std::thread::sleep(Duration::from_nanos(wait_ns));
        }
        let late_s = jink_runtime::now().seconds_since(due).max(0.0);
        self.publish(due, self.steps as f64 * STEP_US as f64 * 1e-6, truth, late_s);
    }

    /// Publishes the truth at `time`.
    pub(super) fn publish(&mut self, time: Timestamp, time_s: f64, truth: VehicleTruth, late_s: f64) {
        self.shared.now_us.store((time_s * 1e6) as u64, Ordering::Relaxed);
        let autopilot = {
            let mut watch = relay::lock(&self.shared.watch);
            watch.see_truth(time_s, truth.position, truth.on_ground);
            *watch.state()
        };
        let mut samples = guard(&self.shared.samples);
        if samples.len() >= SAMPLES_MAX {
            samples.pop_front();
        }
        samples.push_back(SitlSample {
            time,
            time_s,
            truth,
            autopilot,
            late_s,
        });
        drop(samples);
        self.wake();
    }

    fn wake(&mut self) {
        // A full pipe wakes as well.
        let _full = self.wakes.write(&[0]);
    }
}

/// Locks, whoever panicked with it.
pub(super) fn guard<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
