//! One process as the supervisor follows it: where it is in its life, what it last said, and what that means.

use crate::health::View;
use crate::policy::RestartHistory;
use crate::table::{OnFailure, Rules};
use jink_shared_types::Timestamp;
use jink_shared_types::coded::{Coded, Flag};
use jink_shared_types::health::{Heartbeat, Name, ProcessStatus, ServiceState};
use std::fmt;

/// How a process ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// It ended itself with this code.
    Code(u8),
    /// A signal ended it.
    Signal(u8),
    /// It could not even be started.
    NotSpawned,
}

impl Exit {
    /// As in [`ProcessStatus::last_exit`]; 127 for a program that could not be started, as in shells.
    pub fn code(self) -> u32 {
        match self {
            Self::Code(code) => u32::from(code),
            Self::Signal(signal) => 256 + u32::from(signal),
            Self::NotSpawned => 127,
        }
    }
}

impl fmt::Display for Exit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Code(code) => write!(f, "exit code {code}"),
            Self::Signal(signal) => write!(f, "signal {signal}"),
            Self::NotSpawned => f.write_str("not started"),
        }
    }
}

/// Where a process is in its life.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Life {
    /// Its turn to be started has not come.
    Waiting,
    /// Started, as far as known alive.
    Running,
    /// Told to end; the kernel reports its death later.
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

/// One process.
#[derive(Clone, Debug)]
pub(crate) struct Process {
    pub(crate) rules: Rules,
    pub(crate) life: Life,
    pub(crate) history: RestartHistory,
    pub(crate) generation: u32,
    pub(crate) pid: u32,
    pub(crate) started: Timestamp,
    /// Since when it has been missing, until it works again.
    pub(crate) missing_since: Option<Timestamp>,
    /// What it left in shared memory has not been removed.
    pub(crate) left_behind: bool,
    /// It has reached its loop at least once.
    pub(crate) was_up: bool,
    /// Until then its silence has been explained.
    pub(crate) excused_until: Timestamp,
    heartbeat: Heartbeat,
    heartbeat_time: Timestamp,
    restarts: u32,
    recovery_us: u32,
    last_exit: u32,
}

impl Process {
    pub(crate) fn new(rules: Rules) -> Self {
        Self {
            heartbeat: Heartbeat {
                name: Name::new(&rules.name),
                ..Heartbeat::default()
            },
            rules,
            life: Life::Waiting,
            history: RestartHistory::default(),
            generation: 0,
            pid: 0,
            started: Timestamp::NEVER,
            missing_since: None,
            left_behind: false,
            was_up: false,
            excused_until: Timestamp::NEVER,
            heartbeat_time: Timestamp::NEVER,
            restarts: 0,
            recovery_us: 0,
            last_exit: 0,
        }
    }

    /// It is being started at `now`.
    pub(crate) fn start(&mut self, now: Timestamp) {
        if self.generation > 0 {
            self.restarts += 1;
            self.history.restarted(now);
        }
        self.generation += 1;
        self.life = Life::Running;
        self.started = now;
        self.excused_until = Timestamp::NEVER;
        self.pid = 0;
    }

    /// It has died.
    pub(crate) fn end(&mut self, exit: Exit) {
        self.pid = 0;
        self.last_exit = exit.code();
        self.left_behind = true;
    }

    /// Takes a heartbeat; answers how long the process had been missing (s) if this one ends that. A heartbeat may be read
    /// after the death of its sender: then it is its last word, and says nothing about a replacement.
    pub(crate) fn heard(&mut self, heartbeat: &Heartbeat, time: Timestamp) -> Option<f64> {
        if heartbeat.generation != self.generation || self.generation == 0 {
            return None;
        }
        self.heartbeat = *heartbeat;
        self.heartbeat.name = Name::new(&self.rules.name);
        self.heartbeat_time = time;
        self.was_up |= self.in_loop();
        let works = matches!(
            heartbeat.state.get(),
            ServiceState::Active | ServiceState::Standby
        );
        let back = works && self.life == Life::Running;
        let missing_s = time.seconds_since(self.missing_since.filter(|_| back)?);
        self.missing_since = None;
        self.recovery_us = (missing_s * 1e6).max(0.0) as u32;
        Some(missing_s)
    }

    pub(crate) fn is_alive(&self) -> bool {
        matches!(self.life, Life::Running | Life::Ending { .. })
    }

    /// It has been heard since its last start.
    pub(crate) fn is_heard(&self) -> bool {
        self.generation > 0 && self.heartbeat.generation == self.generation
    }

    /// It has been heard from within its loop.
    pub(crate) fn in_loop(&self) -> bool {
        self.is_heard()
            && matches!(
                self.heartbeat.state.get(),
                ServiceState::Standby | ServiceState::Active | ServiceState::Degraded
            )
    }

    /// How long it may be silent (s): the grace while it starts, the time-out of its heartbeat afterwards.
    pub(crate) fn silence_limit_s(&self) -> f64 {
        if !self.is_heard() || self.heartbeat.state == ServiceState::Starting {
            self.rules.start_grace_s
        } else {
            self.rules.heartbeat_timeout_s
        }
    }

    /// When its silence becomes suspicious. The grace runs from its start, whatever it has said before its loop.
    pub(crate) fn suspicious_from(&self) -> Timestamp {
        self.silent_since()
            .plus_seconds(self.silence_limit_s())
            .max(self.excused_until)
    }

    /// Since when it has been silent.
    pub(crate) fn silent_since(&self) -> Timestamp {
        if self.is_heard() && self.heartbeat.state != ServiceState::Starting {
            self.heartbeat_time
        } else {
            self.started
        }
    }

    /// CPU time it has used since its last heartbeat (s), of `cpu_s` in all.
    pub(crate) fn cpu_since_heartbeat_s(&self, cpu_s: f64) -> f64 {
        if self.is_heard() {
            cpu_s - f64::from(self.heartbeat.cpu_ms) * 1e-3
        } else {
            cpu_s
        }
    }

    /// The next process of the table may be started: this one is heard, or not worth waiting for.
    pub(crate) fn lets_next_start(&self, now: Timestamp) -> bool {
        let grace_over = now.seconds_since(self.started) >= self.rules.start_grace_s;
        match self.life {
            Life::Waiting => false,
            Life::Running => !self.rules.essential || self.is_heard() || self.generation > 1 || grace_over,
            Life::Ending { .. } | Life::Resting { .. } | Life::Down | Life::Failed => true,
        }
    }

    /// Its state as the supervisor judges it; `stopping` tells a death on request from another.
    pub(crate) fn state(&self, stopping: bool) -> ServiceState {
        match self.life {
            Life::Waiting => ServiceState::Unknown,
            Life::Running if self.is_heard() => self.heartbeat.state.get(),
            Life::Running => ServiceState::Starting,
            Life::Ending { .. } if stopping => ServiceState::Stopping,
            Life::Ending { .. } | Life::Resting { .. } => ServiceState::Dead,
            Life::Down if stopping => ServiceState::Dead,
            Life::Down | Life::Failed => ServiceState::Failed,
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
            last_exit: self.last_exit,
            state: Coded::new(self.state(stopping)),
            essential: Flag::from(self.rules.essential),
            pid: self.pid,
            ..ProcessStatus::default()
        }
    }
}
