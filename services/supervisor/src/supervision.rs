//! The state machine: what was observed in, what to do out. It holds no handle and reads no clock.
//!
//! * Start: in table order, the next process as soon as the essential one before it has sent a heartbeat or its grace
//!   is over. An essential process that reports that it cannot start while the system is coming up ends the whole
//!   start: a wrong configuration is shown to the user at once, not retried.
//! * Death: restart by `crate::policy`; what the dead left in shared memory is removed only after its replacement has
//!   been started, because removing takes longer than starting.
//! * Hang: silence longer than the row allows is answered with SIGKILL, unless the process wants to run and cannot, or
//!   its core stands still. A supervisor that was itself not running for a while judges no process until each had time
//!   for a heartbeat.
//! * Stop: in reverse order, one at a time, SIGTERM and after a second SIGKILL.

mod deadlines;
mod exchange;
mod second_instance;
mod silence;
mod status;
mod stopping;

use crate::health::Announcer;
use crate::policy::RestartDecision;
use crate::process::{Process, RunState};
use crate::shadow::SwapRefusal;
use crate::table::{OnFailure, ProcessRules};
use jink_runtime::heartbeat::HEARTBEAT_PERIOD_S;
use jink_runtime::service::EXIT_CANNOT_START;
use jink_shared_types::Timestamp;
use jink_shared_types::events::{self, Event, EventSample};
use jink_shared_types::health::{Health, PROCESSES, ReplaceReason, ServiceState, SwapPhase};
use second_instance::SecondInstance;
use stopping::{end_for_good, end_to_start_again};

pub use crate::process::{Adopted, Exit};
pub use exchange::{Action, End, Observation, ProcessActivity};

/// How often a process that is starting is checked (s): bounds how late the next one starts and a recovery is seen.
const LOOK_S: f64 = 0.01;
/// How long an adopted process is waited for before the status reports it missing (s): three heartbeats.
const SETTLING_S: f64 = 0.15;
/// A wake-up this much later than planned means that the whole machine stood still, not that a process hangs (s).
const STALL_S: f64 = 0.02;

/// The state machine over all processes.
#[derive(Clone, Debug)]
pub struct Supervision {
    started: Timestamp,
    pid: u32,
    processes: Vec<Process>,
    second_instances: Vec<SecondInstance>,
    stopping: Option<End>,
    /// Second instances are still to be ended.
    ending_seconds: bool,
    ended: bool,
    up: bool,
    health: Health,
    was_healthy: bool,
    announcer: Announcer,
    /// When processes of an earlier supervisor were adopted.
    adopted_at: Option<Timestamp>,
    expected: Timestamp,
    judge_from: Timestamp,
    shown: Vec<(ServiceState, u32, u32, u32, SwapPhase)>,
}

impl Supervision {
    /// A system of the given processes, in start order, none of them started; `pid` is the supervisor's own.
    /// Processes beyond [`PROCESSES`] are left out (the table refuses them).
    pub fn new(rules: impl IntoIterator<Item = ProcessRules>, now: Timestamp, pid: u32) -> Self {
        let processes: Vec<Process> = rules.into_iter().take(PROCESSES).map(Process::new).collect();
        Self {
            started: now,
            pid,
            shown: Vec::with_capacity(processes.len()),
            second_instances: vec![SecondInstance::default(); processes.len()],
            processes,
            stopping: None,
            ending_seconds: false,
            ended: false,
            up: false,
            health: Health::Starting,
            was_healthy: false,
            announcer: Announcer::default(),
            adopted_at: None,
            expected: now,
            judge_from: now,
        }
    }

    /// Process `index` is running already: an earlier supervisor has started it.
    pub fn adopt(&mut self, index: usize, found: &Adopted, now: Timestamp) {
        if let Some(process) = self.processes.get_mut(index) {
            process.adopt(found, now);
            self.adopted_at = Some(now);
        }
    }

    /// Whether the status should wait: some adopted processes have not sent a heartbeat to this supervisor yet. Readers
    /// have the status of the supervisor before meanwhile, and that is not stale yet.
    pub fn is_settling(&self, now: Timestamp) -> bool {
        let is_new = self
            .adopted_at
            .is_some_and(|at| now.seconds_since(at) < SETTLING_S);
        is_new && self.stopping.is_none() && self.processes.iter().any(Process::is_awaited)
    }

    /// What the next supervisor must know of process `index`, if it runs.
    pub fn adoptable(&self, index: usize) -> Option<Adopted> {
        self.processes.get(index)?.as_adoptable()
    }

    /// Takes what was observed until `now` and appends what to do now to `actions`. Answers whether the status has
    /// changed in a way that readers should know at once.
    pub fn step(&mut self, now: Timestamp, observations: &[Observation], actions: &mut Vec<Action>) -> bool {
        if self.ended {
            return false;
        }
        if now.seconds_since(self.expected) > STALL_S {
            self.judge_from = now.plus_seconds(HEARTBEAT_PERIOD_S + STALL_S);
        }
        for observation in observations {
            self.observe(now, observation, actions);
        }
        self.kill_unresponsive(now, actions);
        if std::mem::take(&mut self.ending_seconds) {
            self.end_second_instances(actions);
        }
        if self.stopping.is_some() {
            self.stop_next(now, actions);
        } else {
            self.suspect_silence(now, actions);
            self.judge_slowness(now, actions);
            self.judge_lateness(now, actions);
            self.start_due(now, actions);
            self.step_second_instances(now, actions);
        }
        self.clean_up_stale(actions);
        let changed = self.refresh(now, actions);
        self.expected = self.next_wake(now);
        changed
    }

    /// When the machine wants to be stepped at the latest, if nothing is observed.
    pub fn next_wake(&self, now: Timestamp) -> Timestamp {
        let of_processes = self
            .processes
            .iter()
            .filter_map(|process| match process.run_state {
                RunState::Running if process.in_loop() => {
                    Some(process.suspicious_from().max(self.judge_from))
                }
                RunState::Running => Some(now.plus_seconds(LOOK_S)),
                RunState::Ending { kill_at, .. } => kill_at,
                RunState::Resting { until } => Some(until),
                RunState::Waiting | RunState::Down | RunState::Failed => None,
            });
        let never = Timestamp::from_ns(u64::MAX);
        of_processes
            .chain(self.announcer.due())
            .chain(self.second_instances_wake(now))
            .min()
            .unwrap_or(never)
    }

    fn observe(&mut self, now: Timestamp, observation: &Observation, actions: &mut Vec<Action>) {
        match *observation {
            Observation::StopRequested => self.begin_stop(End::Stopped),
            Observation::Spawned { process, pid } => {
                if let Some(process) = self.processes.get_mut(process) {
                    process.pid = pid;
                }
            }
            Observation::Heartbeat {
                process,
                heartbeat,
                time,
            } => {
                let shadow = self
                    .second_instances
                    .get_mut(process)
                    .and_then(|one| one.shadow.as_mut());
                if shadow.is_some_and(|shadow| shadow.on_heartbeat(&heartbeat, time)) {
                    return;
                }
                if let Some(process) = self.processes.get_mut(process)
                    && let Some(missing_s) = process.on_heartbeat(&heartbeat, time)
                {
                    raise(actions, &events::PROCESS_RESTARTED, process, missing_s);
                }
            }
            Observation::Inspected {
                process,
                activity,
                cpu_s,
                core_runs,
            } => {
                // What a process does on a core that stands still is what it did when the core stopped.
                let activity = (core_runs || activity == ProcessActivity::Stopped).then_some(activity);
                self.inspected(now, process, activity, cpu_s, actions);
            }
            Observation::Died { process, exit } => self.died(now, process, exit, actions),
            Observation::ShadowSpawned { process, pid } => {
                if let Some(shadow) = self
                    .second_instances
                    .get_mut(process)
                    .and_then(|one| one.shadow.as_mut())
                {
                    shadow.pid = pid;
                }
            }
            Observation::ShadowDied { process, exit } => self.shadow_died(now, process, exit, actions),
            Observation::SwapRequested {
                process,
                cycles,
                dry_run,
            } => self.swap_requested(now, process, cycles, dry_run, actions),
            Observation::RestartRequested { process } => self.restart_requested(now, process, actions),
            Observation::EndRequested { process } => self.end_requested(now, process, actions),
        }
    }

    fn restart_requested(&mut self, now: Timestamp, index: usize, actions: &mut Vec<Action>) {
        if self.stopping.is_some() || index >= self.processes.len() {
            return;
        }
        self.forget_replaced(index, actions);
        let process = &mut self.processes[index];
        process.reason = ReplaceReason::Asked;
        match process.run_state {
            RunState::Running => end_to_start_again(process, index, now, actions),
            RunState::Resting { .. } | RunState::Down | RunState::Failed => {
                process.run_state = RunState::Resting { until: now }
            }
            RunState::Waiting | RunState::Ending { .. } => {}
        }
    }

    fn end_requested(&mut self, now: Timestamp, index: usize, actions: &mut Vec<Action>) {
        if self.processes.get(index).is_none() {
            return;
        }
        self.end_second_of(index, SwapRefusal::Stopping, actions);
        let process = &mut self.processes[index];
        process.reason = ReplaceReason::Asked;
        end_for_good(process, index, now, actions);
    }

    fn died(&mut self, now: Timestamp, index: usize, exit: Exit, actions: &mut Vec<Action>) {
        let (stopping, coming_up) = (self.stopping.is_some(), !self.up);
        let Some(process) = self.processes.get_mut(index) else {
            return;
        };
        process.end(exit);
        let for_good = matches!(process.run_state, RunState::Ending { for_good: true, .. });
        if stopping || for_good {
            process.run_state = RunState::Down;
            return;
        }
        let asked = matches!(process.run_state, RunState::Ending { .. });
        process.missing_since.get_or_insert(now);
        if !asked {
            process.reason = ReplaceReason::Died;
        }
        if self.take_over(now, index, exit, actions) || self.take_back(now, index, exit, actions) {
            return;
        }
        let Some(process) = self.processes.get_mut(index) else {
            return;
        };
        if asked && matches!(process.reason, ReplaceReason::Asked | ReplaceReason::Swapped) {
            process.run_state = RunState::Resting { until: now };
            return;
        }
        let lived_s = now.seconds_since(process.started);
        let refused = exit == Exit::Code(EXIT_CANNOT_START) && lived_s < process.rules.start_grace_s;
        let spawned = exit != Exit::NotSpawned;
        if (refused || !spawned) && coming_up && process.rules.essential {
            process.run_state = RunState::Failed;
            self.begin_stop(End::CannotStart { process: index });
            return;
        }
        let (rule, history) = (&process.rules.restart, &mut process.history);
        let decision = match spawned {
            true => history.died(rule, now, lived_s, refused),
            false => RestartDecision::RestartAfter(history.not_spawned(rule)),
        };
        match decision {
            RestartDecision::RestartAfter(delay_s) => {
                process.run_state = RunState::Resting {
                    until: now.plus_seconds(delay_s),
                };
            }
            RestartDecision::GiveUp => {
                process.run_state = RunState::Failed;
                raise(actions, &events::PROCESS_FAILED, process, 0.0);
                match process.rules.on_failure {
                    OnFailure::Hold | OnFailure::Ignore => {}
                    OnFailure::StopOutput => self.stop_output(now, actions),
                    OnFailure::Shutdown => self.begin_stop(End::GaveUp { process: index }),
                }
            }
        }
    }

    fn start_due(&mut self, now: Timestamp, actions: &mut Vec<Action>) {
        let mut before_lets_start = true;
        for (index, process) in self.processes.iter_mut().enumerate() {
            let due = match process.run_state {
                RunState::Waiting => before_lets_start,
                RunState::Resting { until } => now >= until,
                RunState::Running | RunState::Ending { .. } | RunState::Down | RunState::Failed => false,
            };
            if due {
                process.start(now);
                actions.push(Action::Spawn {
                    process: index,
                    generation: process.generation,
                });
            }
            before_lets_start = process.lets_next_start(now);
        }
    }

    /// Only after the replacement has been started, or when there will be none. When the whole system stops, its memory
    /// is wiped as a whole.
    fn clean_up_stale(&mut self, actions: &mut Vec<Action>) {
        let mut any = false;
        for second in &mut self.second_instances {
            any |= second.take_stale();
        }
        for process in &mut self.processes {
            let settled = matches!(
                process.run_state,
                RunState::Running | RunState::Failed | RunState::Down
            );
            if process.has_stale_resources && settled {
                process.has_stale_resources = false;
                any = true;
            }
        }
        if any && self.stopping.is_none() {
            actions.push(Action::CleanUp);
        }
    }
}

/// An event about a process with a duration in milliseconds.
fn raise(actions: &mut Vec<Action>, event: &Event, process: &Process, seconds: f64) {
    let sample = EventSample::new(event, &process.rules.name, [(seconds * 1e3).round(), 0.0]);
    actions.push(Action::PublishEvent(sample));
}

#[cfg(test)]
mod tests;
