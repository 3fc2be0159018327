//! One process as the supervisor follows it: its run state, its last heartbeat, and what that means.

use crate::health::View;
use crate::policy::RestartHistory;
use crate::slowness::Slowness;
use crate::table::{OnFailure, ProcessRules};
use jink_shared_types::Timestamp;
use jink_shared_types::coded::{Coded, Flag};
use jink_shared_types::health::{
    EXIT_NOT_SPAWNED, EXIT_UNKNOWN, Heartbeat, Name, ProcessStatus, ReplaceReason, Role, ServiceState,
};
use std::fmt;
use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;

/// How a process ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// It ended itself with this code.
    Code(u8),
    /// A signal ended it.
    Signal(u8),
    /// It could not even be started.
    NotSpawned,
    /// It was started by an earlier supervisor, and only its own parent is informed how a process ends.
    Unknown,
}

impl Exit {
    /// What the kernel says of it.
    pub fn of(status: ExitStatus) -> Self {
        let small = |number: i32| u8::try_from(number).unwrap_or(u8::MAX);
        match (status.code(), status.signal()) {
            (Some(code), _) => Self::Code(small(code)),
            (None, signal) => Self::Signal(small(signal.unwrap_or_default())),
        }
    }

    /// As in [`ProcessStatus::last_exit`].
    pub fn code(self) -> u32 {
        match self {
            Self::Code(code) => u32::from(code),
            Self::Signal(signal) => 256 + u32::from(signal),
            Self::NotSpawned => EXIT_NOT_SPAWNED,
            Self::Unknown => EXIT_UNKNOWN,
        }
    }
}

impl fmt::Display for Exit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Code(code) => write!(f, "exit code {code}"),
            Self::Signal(signal) => write!(f, "signal {signal}"),
            Self::NotSpawned => f.write_str("an error before it ran: the kernel cannot execute it"),
            Self::Unknown => f.write_str("an exit status that is not known"),
        }
    }
}

/// The run state of a process.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum RunState {
    /// Its turn to be started has not come.
    Waiting,
    /// Started, as far as known alive.
    Running,
    /// Asked to end; the kernel reports its death later.
    Ending {
        /// When asking becomes killing; `None`: has been killed.
        kill_at: Option<Timestamp>,
        /// It is not to be started again.
        for_good: bool,
    },
    /// Dead, to be started again.
    Resting {
        /// When.
        until: Timestamp,
    },
    /// Dead on request.
    Down,
    /// Dead and given up.
    Failed,
}

/// A process that an earlier supervisor of the instance has started.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Adopted {
    /// Which start of it this is.
    pub generation: u32,
    /// The newest generation given to any instance of it.
    pub last_generation: u32,
    /// Its epoch.
    pub epoch: u32,
    /// Its restarts so far.
    pub restarts: u32,
    /// Its process id.
    pub pid: u32,
    /// When it was started.
    pub started: Timestamp,
    /// How the instance before it ended, as in [`ProcessStatus::last_exit`].
    pub last_exit: u32,
    /// Why that one was replaced.
    pub reason: ReplaceReason,
}

/// One process.
#[derive(Clone, Debug)]
pub(crate) struct Process {
    pub(crate) rules: ProcessRules,
    pub(crate) run_state: RunState,
    pub(crate) history: RestartHistory,
    pub(crate) generation: u32,
    /// The newest generation given to any instance of it.
    last_generation: u32,
    /// High half of its sequence numbers: see [`jink_shared_types::control`].
    pub(crate) epoch: u32,
    pub(crate) pid: u32,
    pub(crate) reason: ReplaceReason,
    pub(crate) slowness: Slowness,
    /// When it was last replaced because it was slow.
    pub(crate) slow_replaced: Timestamp,
    /// When late outputs were reported last, and how many there had been.
    pub(crate) late_reported: Timestamp,
    late_before: u64,
    pub(crate) started: Timestamp,
    /// Since when this supervisor has listened to it.
    watched_since: Timestamp,
    /// Since when it has been missing, until it works again.
    pub(crate) missing_since: Option<Timestamp>,
    /// What it left in shared memory has not been removed.
    pub(crate) has_stale_resources: bool,
    /// It has reached its loop at least once.
    pub(crate) was_up: bool,
    /// Until then its silence has been explained.
    pub(crate) excused_until: Timestamp,
    heartbeat: Heartbeat,
    heartbeat_time: Timestamp,
    restarts: u32,
    recovery_us: u32,
    back: Timestamp,
    last_exit: u32,
}

impl Process {
    pub(crate) fn new(rules: ProcessRules) -> Self {
        Self {
            heartbeat: Heartbeat {
                name: Name::new(&rules.name),
                ..Heartbeat::default()
            },
            rules,
            run_state: RunState::Waiting,
            history: RestartHistory::default(),
            generation: 0,
            last_generation: 0,
            epoch: 0,
            pid: 0,
            reason: ReplaceReason::Never,
            slowness: Slowness::default(),
            slow_replaced: Timestamp::NEVER,
            late_reported: Timestamp::NEVER,
            late_before: 0,
            started: Timestamp::NEVER,
            watched_since: Timestamp::NEVER,
            missing_since: None,
            has_stale_resources: false,
            was_up: false,
            excused_until: Timestamp::NEVER,
            heartbeat_time: Timestamp::NEVER,
            restarts: 0,
            recovery_us: 0,
            back: Timestamp::NEVER,
            last_exit: 0,
        }
    }

    /// It is being started at `now`.
    pub(crate) fn start(&mut self, now: Timestamp) {
        if self.generation > 0 {
            self.restarts += 1;
            self.history.restarted(now);
        }
        self.generation = self.next_generation();
        self.epoch = self.generation;
        self.slowness = Slowness::default();
        self.run_state = RunState::Running;
        self.started = now;
        self.watched_since = now;
        self.excused_until = Timestamp::NEVER;
        self.pid = 0;
    }

    /// A generation that no instance of it has had.
    pub(crate) fn next_generation(&mut self) -> u32 {
        self.last_generation += 1;
        self.last_generation
    }

    /// It was found running, started by an earlier supervisor.
    pub(crate) fn adopt(&mut self, found: &Adopted, now: Timestamp) {
        self.generation = found.generation;
        self.last_generation = found.last_generation.max(found.generation);
        self.epoch = found.epoch;
        self.pid = found.pid;
        self.restarts = found.restarts;
        self.run_state = RunState::Running;
        self.started = found.started;
        self.last_exit = found.last_exit;
        self.reason = found.reason;
        self.watched_since = now;
        self.was_up = true;
    }

    /// Another instance has taken its place at `now`, after it had died.
    pub(crate) fn taken_over(&mut self, now: Timestamp) {
        self.run_state = RunState::Running;
        self.restarts += 1;
        self.reason = ReplaceReason::TakenOver;
        self.slowness = Slowness::default();
        self.missing_since.get_or_insert(now);
    }

    /// Its last heartbeat.
    pub(crate) fn heartbeat(&self) -> Heartbeat {
        self.heartbeat
    }

    /// Outputs over their budget since the last report, if there are enough to be reported; `None` = not enough.
    pub(crate) fn lateness(&mut self, beat: &Heartbeat) -> Option<u64> {
        let late = beat
            .late_outputs
            .checked_sub(self.late_before)
            .unwrap_or_else(|| {
                self.late_before = 0;
                beat.late_outputs
            });
        (late > 0).then_some(late)
    }

    /// `late` outputs over their budget in all were reported to the pilot at `now`.
    pub(crate) fn late_reported(&mut self, now: Timestamp, late: u64) {
        self.late_reported = now;
        self.late_before = late;
    }

    /// Exchanges its last heartbeat with that of another instance.
    pub(crate) fn exchange_heartbeat(&mut self, heartbeat: &mut Heartbeat, time: &mut Timestamp) {
        std::mem::swap(&mut self.heartbeat, heartbeat);
        std::mem::swap(&mut self.heartbeat_time, time);
        self.heartbeat.name = Name::new(&self.rules.name);
    }

    /// What the next supervisor must know of it.
    pub(crate) fn as_adoptable(&self) -> Option<Adopted> {
        (self.run_state == RunState::Running && self.pid != 0).then_some(Adopted {
            generation: self.generation,
            last_generation: self.last_generation,
            epoch: self.epoch,
            restarts: self.restarts,
            pid: self.pid,
            started: self.started,
            last_exit: self.last_exit,
            reason: self.reason,
        })
    }

    /// Whether it runs, and this supervisor has not received a heartbeat of it yet.
    pub(crate) fn is_awaited(&self) -> bool {
        self.run_state == RunState::Running && !self.has_heartbeat()
    }

    /// It has died.
    pub(crate) fn end(&mut self, exit: Exit) {
        self.pid = 0;
        self.last_exit = exit.code();
        self.has_stale_resources = true;
    }

    /// Takes a heartbeat; answers how long the process had been missing (s) if this one ends that. A heartbeat may be
    /// read after the death of its sender: then it is its last one, and shows nothing about a replacement. Nor does one
    /// of a second instance that has not yet learned that it is the owner.
    pub(crate) fn on_heartbeat(&mut self, heartbeat: &Heartbeat, time: Timestamp) -> Option<f64> {
        if heartbeat.generation != self.generation || self.generation == 0 {
            return None;
        }
        self.heartbeat = *heartbeat;
        self.heartbeat.name = Name::new(&self.rules.name);
        self.heartbeat_time = time;
        self.was_up |= self.in_loop();
        self.slowness.on_heartbeat(heartbeat, time);
        let works = matches!(
            heartbeat.state.get(),
            ServiceState::Active | ServiceState::Standby
        );
        let back = works && heartbeat.role == Role::Owner && self.run_state == RunState::Running;
        let missing_s = time.seconds_since(self.missing_since.filter(|_| back)?);
        self.missing_since = None;
        self.recovery_us = (missing_s * 1e6).max(0.0) as u32;
        self.back = time;
        Some(missing_s)
    }

    pub(crate) fn is_alive(&self) -> bool {
        matches!(self.run_state, RunState::Running | RunState::Ending { .. })
    }

    /// It has sent a heartbeat since its last start.
    pub(crate) fn has_heartbeat(&self) -> bool {
        self.generation > 0 && self.heartbeat.generation == self.generation
    }

    /// It has sent a heartbeat from within its loop.
    pub(crate) fn in_loop(&self) -> bool {
        self.has_heartbeat()
            && matches!(
                self.heartbeat.state.get(),
                ServiceState::Standby | ServiceState::Active | ServiceState::Degraded
            )
    }

    /// How long it may be silent (s): the grace while it starts, the time-out of its heartbeat afterwards.
    pub(crate) fn silence_limit_s(&self) -> f64 {
        if !self.has_heartbeat() || self.heartbeat.state == ServiceState::Starting {
            self.rules.start_grace_s
        } else {
            self.rules.heartbeat_timeout_s
        }
    }

    /// When its silence becomes suspicious. The grace runs from its start, whatever it has sent before its loop.
    pub(crate) fn suspicious_from(&self) -> Timestamp {
        self.silent_since()
            .plus_seconds(self.silence_limit_s())
            .max(self.excused_until)
    }

    /// Since when it has been silent.
    pub(crate) fn silent_since(&self) -> Timestamp {
        if self.has_heartbeat() && self.heartbeat.state != ServiceState::Starting {
            self.heartbeat_time
        } else {
            self.watched_since
        }
    }

    /// CPU time it has used since its last heartbeat (s), of `cpu_s` in all.
    pub(crate) fn cpu_since_heartbeat_s(&self, cpu_s: f64) -> f64 {
        if self.has_heartbeat() {
            cpu_s - f64::from(self.heartbeat.cpu_ms) * 1e-3
        } else {
            cpu_s
        }
    }

    /// The next process of the table may be started: this one has sent a heartbeat, or is not worth waiting for.
    pub(crate) fn lets_next_start(&self, now: Timestamp) -> bool {
        let grace_over = now.seconds_since(self.started) >= self.rules.start_grace_s;
        match self.run_state {
            RunState::Waiting => false,
            RunState::Running => {
                !self.rules.essential || self.has_heartbeat() || self.generation > 1 || grace_over
            }
            RunState::Ending { .. } | RunState::Resting { .. } | RunState::Down | RunState::Failed => true,
        }
    }

    /// Its state as the supervisor judges it; `stopping` distinguishes a death on request from another.
    pub(crate) fn state(&self, stopping: bool) -> ServiceState {
        match self.run_state {
            RunState::Waiting => ServiceState::Unknown,
            RunState::Running if self.has_heartbeat() => match self.heartbeat.state.get() {
                ServiceState::Active if self.slowness.is_degraded() => ServiceState::Degraded,
                state => state,
            },
            RunState::Running => ServiceState::Starting,
            RunState::Ending { .. } if stopping => ServiceState::Stopping,
            RunState::Ending { .. } | RunState::Resting { .. } => ServiceState::Dead,
            RunState::Down if stopping => ServiceState::Dead,
            RunState::Down => ServiceState::Stopped,
            RunState::Failed => ServiceState::Failed,
        }
    }

    pub(crate) fn view(&self, stopping: bool) -> View<'_> {
        View {
            name: &self.rules.name,
            state: self.state(stopping),
            essential: self.rules.essential,
            failure_ignored: self.rules.on_failure == OnFailure::Ignore,
            restarted: self.generation > 1,
        }
    }

    pub(crate) fn status(&self, stopping: bool) -> ProcessStatus {
        ProcessStatus {
            heartbeat: self.heartbeat,
            heartbeat_time: self.heartbeat_time,
            started: self.started,
            cycle_budget_us: self.rules.cycle_budget_us,
            restarts: self.restarts,
            recovery_us: self.recovery_us,
            back: self.back,
            last_exit: self.last_exit,
            state: Coded::new(self.state(stopping)),
            essential: Flag::from(self.rules.essential),
            pid: self.pid,
            reason: Coded::new(self.reason),
            slow: Flag::from(self.slowness.is_degraded()),
            end_to_end_budget_us: self.rules.end_to_end_us,
            ..ProcessStatus::default()
        }
    }
}
