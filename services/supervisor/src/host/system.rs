//! The loop: sleep until a process ends, a signal comes or something is due; observe; step; act.

use super::children::Children;
use super::notify::Notifier;
use super::shared::Shared;
use jink_shared_types::Timestamp;
use jink_shared_types::health::{Health, PROCESSES, SystemStatus};
use jink_supervisor::supervision::{Action, End, Exit, Observation, Supervision};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::Signal;
use std::io::Read;
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;

/// The status is published this often even if nothing changes (s): the topic's rate.
const STATUS_PERIOD_S: f64 = 0.1;
/// How often the logs are measured (s); in that time even a chatty process writes little against their limit.
const LOGS_PERIOD_S: f64 = 1.0;

/// What is known at the end.
#[derive(Debug, Default)]
pub struct Report {
    /// A process ended otherwise than on request.
    pub any_failed: bool,
    /// The last such end, in one sentence.
    pub reason: String,
}

/// The running system.
pub struct System {
    supervision: Supervision,
    children: Children,
    shared: Shared,
    notifier: Notifier,
    stop_signal: UnixStream,
    status: Box<SystemStatus>,
    status_due: Timestamp,
    logs_due: Timestamp,
    observations: Vec<Observation>,
    actions: Vec<Action>,
    report: Report,
}

impl System {
    /// A system that has not started anything.
    pub fn new(
        supervision: Supervision,
        children: Children,
        shared: Shared,
        notifier: Notifier,
        stop_signal: UnixStream,
    ) -> Self {
        Self {
            supervision,
            children,
            shared,
            notifier,
            stop_signal,
            status: Box::default(),
            status_due: Timestamp::NEVER,
            logs_due: Timestamp::NEVER,
            observations: Vec::with_capacity(4 * PROCESSES),
            actions: Vec::with_capacity(4 * PROCESSES),
            report: Report::default(),
        }
    }

    /// Runs until everything has ended.
    pub fn run(&mut self) -> End {
        loop {
            let now = jink_runtime::now();
            self.actions.clear();
            let changed = self.supervision.step(now, &self.observations, &mut self.actions);
            self.observations.clear();
            if let Some(end) = self.act(now) {
                self.publish(now, true);
                return end;
            }
            self.publish(now, changed);
            self.notifier.update(now, &self.supervision);
            if now >= self.logs_due {
                self.logs_due = now.plus_seconds(LOGS_PERIOD_S);
                self.children.limit_logs();
                self.shared.greet();
            }
            // What an action led to is to be looked at before anything else.
            if self.observations.is_empty() {
                self.sleep();
                // Before deaths are looked for: a last heartbeat belongs before its sender's end.
                self.shared.read_heartbeats(&mut self.observations);
                self.look();
            }
        }
    }

    /// Everything has ended: lets go of shared memory and tells how it went.
    pub fn into_report(self) -> Report {
        self.report
    }

    fn act(&mut self, now: Timestamp) -> Option<End> {
        for action in &self.actions {
            match *action {
                Action::Spawn { process, generation } => {
                    self.observations.extend(self.children.spawn(process, generation));
                }
                Action::Examine { process } => self.observations.extend(self.children.examine(process)),
                Action::Terminate { process } => self.children.signal(process, Signal::TERM),
                Action::Kill { process } => self.children.signal(process, Signal::KILL),
                Action::CleanUp => self.shared.clean_up(),
                Action::Raise(event) => self.shared.raise(now, &event),
                Action::End(end) => return Some(end),
            }
        }
        None
    }

    fn publish(&mut self, now: Timestamp, changed: bool) {
        if changed || now >= self.status_due {
            self.supervision.write_status(&mut self.status);
            self.shared.publish(now, &self.status);
            self.status_due = now.plus_seconds(STATUS_PERIOD_S);
        }
    }

    fn sleep(&self) {
        let now = jink_runtime::now();
        let until = [self.supervision.next_wake(now), self.status_due, self.logs_due]
            .into_iter()
            .chain(self.notifier.due())
            .min()
            .unwrap_or(now);
        let left_ns = until.ns_since(now);
        let timeout = Timespec {
            tv_sec: (left_ns / 1_000_000_000) as i64,
            tv_nsec: (left_ns % 1_000_000_000) as i64,
        };
        let signal = PollFd::from_borrowed_fd(self.stop_signal.as_fd(), PollFlags::IN);
        let mut fds: [PollFd<'_>; PROCESSES + 1] = std::array::from_fn(|_| signal.clone());
        let mut used = 1;
        let handles = (0..self.children.len()).filter_map(|process| self.children.handle(process));
        for (slot, handle) in fds[1..].iter_mut().zip(handles) {
            *slot = PollFd::from_borrowed_fd(handle, PollFlags::IN);
            used += 1;
        }
        // Interrupted by a signal: as good as woken, everything is looked at anyway.
        let _interrupted = poll(&mut fds[..used], Some(&timeout));
    }

    fn look(&mut self) {
        let mut signals = [0; 16];
        if self.stop_signal.read(&mut signals).is_ok_and(|count| count > 0) {
            tracing::info!("stop requested");
            self.observations.push(Observation::StopRequested);
        }
        for process in 0..self.children.len() {
            if let Some(exit) = self.children.reap(process) {
                self.post_mortem(process, exit);
                self.observations.push(Observation::Died { process, exit });
            }
        }
    }

    /// Says how a process ended; an end that nobody asked for comes with its last words.
    fn post_mortem(&mut self, process: usize, exit: Exit) {
        let now = jink_runtime::now();
        let Some((name, lived_s)) = self.supervision.describe(process, now) else {
            return;
        };
        let asked_for = self.supervision.health() == Health::Stopping;
        if asked_for && matches!(exit, Exit::Code(0)) {
            tracing::info!(process = name, "stopped");
            return;
        }
        let last_lines = self.children.last_lines(process);
        let last_line = last_lines.last().map_or("", String::as_str);
        tracing::error!(
            process = name,
            lived_s,
            last_lines = last_lines.join("\n"),
            "ended: {exit}"
        );
        // A reason why the system stops comes before what happens while it stops.
        if !asked_for {
            self.report.reason = format!("{name} ended with {exit}: {last_line}");
        }
        self.report.any_failed = true;
    }
}
