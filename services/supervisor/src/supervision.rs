//! The state machine: what was observed in, what to do out. It holds no handle and reads no clock.
//!
//! * Start: in table order, the next process as soon as the essential one before it has sent a heartbeat or its grace
//!   is over. An essential process that reports that it cannot start while the system is coming up ends the whole
//!   start: a wrong configuration is shown to the user at once, not retried.
//! * Death: restart by [`crate::policy`]; what the dead left in shared memory is removed only after its replacement has
//!   been started, because removing takes longer than starting.
//! * Hang: silence longer than the row allows is answered with SIGKILL, unless the process wants to run and cannot, or
//!   its core stands still. A supervisor that was itself not running for a while judges no process until each had time
//!   for a heartbeat.
//! * Stop: in reverse order, one at a time, SIGTERM and after a second SIGKILL.

mod exchange;
mod second_instance;

use crate::health::{Announcer, judge};
use crate::policy::RestartDecision;
use crate::process::{Process, RunState};
use crate::shadow::{Shadow, SwapRefusal};
use crate::slowness::{SlownessLevel, WINDOW_S};
use crate::table::{OnFailure, ProcessRules};
use jink_runtime::heartbeat::HEARTBEAT_PERIOD_S;
use jink_runtime::service::EXIT_CANNOT_START;
use jink_shared_types::coded::Coded;
use jink_shared_types::events::{self, Event, EventSample};
use jink_shared_types::health::{
    Health, Heartbeat, PROCESSES, ReplaceReason, ServiceState, SwapPhase, SystemStatus,
};
use jink_shared_types::{STAGE_NAMES, Timestamp};
use second_instance::SecondInstance;

pub use crate::process::{Adopted, Exit};
pub use exchange::{Action, End, Observation, ProcessActivity};

/// From SIGTERM to SIGKILL (s): a service leaves its loop within a cycle, which is two orders of magnitude less.
const PATIENCE_S: f64 = 1.0;
/// How often a process that is starting is checked (s): bounds how late the next one starts and a recovery is seen.
const LOOK_S: f64 = 0.01;
/// A silent process that could run is starved if it has used less than this share of the time it may be silent: an
/// endless loop uses nearly all of it.
const STARVED_SHARE: f64 = 0.5;
/// Starvation is accepted as the cause for this many times the silence allowed: at 100 ms a second and a half, within
/// which a committed trajectory is still far from its end. Then the process is replaced after all.
const STARVED_TIMES: f64 = 15.0;
/// A late timer is accepted as the cause of a sleeping process's silence for this many times the silence allowed: on a
/// virtual machine one processor may stand still for 200 ms and every timer on it with it.
const SLEEPING_TIMES: f64 = 2.5;
/// How long one inspection of a silent process excuses its silence (s): it may have been stopped right after, and the
/// first one finds out nothing yet about its core.
const EXCUSE_S: f64 = 0.005;
/// Late outputs are reported when so many are over their end-to-end budget since the last report.
const LATE_MIN: u64 = 3;
/// Least time between two reports of late outputs of one process (s).
const LATE_REPORTED_AGAIN_S: f64 = 5.0;
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

    /// Every essential process has reached its loop at least once: the system is started, healthy or not.
    pub fn is_up(&self) -> bool {
        self.up
    }

    /// Health of the whole.
    pub fn health(&self) -> Health {
        self.health
    }

    /// Name of a process, and how long it has been up at `now` (s).
    pub fn describe(&self, process: usize, now: Timestamp) -> Option<(&str, f64)> {
        let process = self.processes.get(process)?;
        Some((&process.rules.name, now.seconds_since(process.started)))
    }

    /// The last heartbeat of a process.
    pub fn heartbeat(&self, process: usize) -> Option<Heartbeat> {
        self.processes.get(process).map(Process::heartbeat)
    }

    /// Writes the whole status.
    pub fn write_status(&self, status: &mut SystemStatus) {
        status.started = self.started;
        status.health = Coded::new(self.health);
        status.len = self.processes.len() as u32;
        status.pid = self.pid;
        status.restarts = 0;
        let slots = status
            .processes
            .iter_mut()
            .zip(&self.processes)
            .zip(&self.second_instances);
        for ((slot, process), second) in slots {
            *slot = process.status(self.stopping.is_some());
            if let Some(shadow) = &second.shadow {
                slot.shadow_pid = shadow.pid;
                slot.swap = Coded::new(shadow.phase());
            }
            status.restarts += slot.restarts;
        }
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

    /// Whether process `index` is down for good: stopped on request, or given up.
    pub fn is_down(&self, index: usize) -> bool {
        let process = self.processes.get(index);
        process.is_some_and(|process| matches!(process.run_state, RunState::Down | RunState::Failed))
    }

    fn restart_requested(&mut self, now: Timestamp, index: usize, actions: &mut Vec<Action>) {
        let Some(process) = self.processes.get_mut(index).filter(|_| self.stopping.is_none()) else {
            return;
        };
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
        match process.run_state {
            RunState::Running => terminate(process, index, now, actions),
            RunState::Ending { kill_at, .. } => {
                process.run_state = RunState::Ending {
                    kill_at,
                    for_good: true,
                };
            }
            RunState::Waiting | RunState::Resting { .. } => process.run_state = RunState::Down,
            RunState::Down | RunState::Failed => {}
        }
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
        if self.take_over(now, index, exit, actions) {
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
        let cannot_start = exit == Exit::Code(EXIT_CANNOT_START) && lived_s < process.rules.start_grace_s;
        if cannot_start && coming_up && process.rules.essential {
            process.run_state = RunState::Failed;
            self.begin_stop(End::CannotStart { process: index });
            return;
        }
        match process
            .history
            .died(&process.rules.restart, now, lived_s, cannot_start)
        {
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

    fn begin_stop(&mut self, end: End) {
        if self.stopping.is_some() {
            return;
        }
        self.stopping = Some(end);
        self.ending_seconds = true;
        for process in &mut self.processes {
            if matches!(process.run_state, RunState::Waiting | RunState::Resting { .. }) {
                process.run_state = RunState::Down;
            }
        }
    }

    fn stop_output(&mut self, now: Timestamp, actions: &mut Vec<Action>) {
        for index in 0..self.processes.len() {
            let process = &mut self.processes[index];
            if !process.rules.is_output {
                continue;
            }
            match process.run_state {
                RunState::Running => terminate(process, index, now, actions),
                RunState::Ending { kill_at, .. } => {
                    process.run_state = RunState::Ending {
                        kill_at,
                        for_good: true,
                    };
                }
                RunState::Waiting | RunState::Resting { .. } => process.run_state = RunState::Down,
                RunState::Down | RunState::Failed => {}
            }
        }
    }

    fn kill_unresponsive(&mut self, now: Timestamp, actions: &mut Vec<Action>) {
        for (index, process) in self.processes.iter_mut().enumerate() {
            if let RunState::Ending {
                kill_at: Some(at),
                for_good,
            } = process.run_state
                && now >= at
            {
                process.run_state = RunState::Ending {
                    kill_at: None,
                    for_good,
                };
                actions.push(Action::Kill { process: index });
            }
        }
    }

    /// Reverse order: the last one started that is still alive goes first, then the one before it.
    fn stop_next(&mut self, now: Timestamp, actions: &mut Vec<Action>) {
        let last_alive = self.processes.iter().rposition(Process::is_alive);
        match (last_alive, self.stopping) {
            (Some(index), _) => {
                let process = &mut self.processes[index];
                if process.run_state == RunState::Running {
                    terminate(process, index, now, actions);
                }
            }
            // Second instances have been killed: their deaths come by themselves.
            (None, Some(_)) if self.second_instances.iter().any(|second| second.shadow.is_some()) => {}
            (None, Some(end)) => {
                self.ended = true;
                actions.push(Action::End(end));
            }
            (None, None) => {}
        }
    }

    /// Cycles over budget, graded by the process's own rule.
    fn judge_slowness(&mut self, now: Timestamp, actions: &mut Vec<Action>) {
        for (index, process) in self.processes.iter_mut().enumerate() {
            if process.run_state != RunState::Running || !process.in_loop() {
                continue;
            }
            let misses = process.slowness.misses();
            let Some(grade) = process.slowness.judge(&process.rules.slow) else {
                continue;
            };
            let numbers = [f64::from(misses), WINDOW_S];
            match grade {
                SlownessLevel::Fine => {}
                SlownessLevel::Event | SlownessLevel::Degraded => actions.push(Action::PublishEvent(
                    EventSample::new(&events::PROCESS_SLOW, &process.rules.name, numbers),
                )),
                SlownessLevel::Replace => {
                    raise(actions, &events::PROCESS_TOO_SLOW, process, 0.0);
                    kill_for_replacement(now, index, process, ReplaceReason::Slow, actions);
                }
            }
        }
    }

    /// Outputs older than their end-to-end budget: reported with the stage that took most, at most once in a while.
    fn judge_lateness(&mut self, now: Timestamp, actions: &mut Vec<Action>) {
        for process in &mut self.processes {
            let beat = process.heartbeat();
            let Some(late) = process.lateness(&beat) else {
                continue;
            };
            if now.seconds_since(process.late_reported) < LATE_REPORTED_AGAIN_S || late < LATE_MIN {
                continue;
            }
            process.late_reported(now, beat.late_outputs);
            let stage = STAGE_NAMES.get(usize::from(beat.late_stage)).unwrap_or(&"");
            let numbers = [beat.late_stage_us, beat.late_us].map(|us| (f64::from(us) * 1e-3).round());
            actions.push(Action::PublishEvent(EventSample::new(
                &events::OUTPUT_LATE,
                stage,
                numbers,
            )));
        }
    }

    fn suspect_silence(&mut self, now: Timestamp, actions: &mut Vec<Action>) {
        if now < self.judge_from {
            return;
        }
        let silent =
            |process: &Process| process.run_state == RunState::Running && now > process.suspicious_from();
        let in_loops = self.processes.iter().filter(|process| process.in_loop()).count();
        let silent_in_loops = self
            .processes
            .iter()
            .filter(|one| one.in_loop() && silent(one))
            .count();
        // Most of them at once: it is the machine.
        let machine = silent_in_loops > 1 && 2 * silent_in_loops > in_loops;
        for (index, process) in self.processes.iter_mut().enumerate() {
            if !silent(process) {
                continue;
            }
            let silence_s = now.seconds_since(process.silent_since());
            if machine && process.in_loop() && silence_s < STARVED_TIMES * process.silence_limit_s() {
                process.excused_until = now.plus_seconds(EXCUSE_S);
            } else {
                actions.push(Action::Inspect { process: index });
            }
        }
    }

    fn inspected(
        &mut self,
        now: Timestamp,
        index: usize,
        activity: Option<ProcessActivity>,
        cpu_s: f64,
        actions: &mut Vec<Action>,
    ) {
        let Some(process) = self.processes.get_mut(index) else {
            return;
        };
        // A heartbeat, or its death, may have come before the answer.
        if process.run_state != RunState::Running || now <= process.suspicious_from() {
            return;
        }
        let limit_s = process.silence_limit_s();
        let silence_s = now.seconds_since(process.silent_since());
        let idle = process.cpu_since_heartbeat_s(cpu_s) < STARVED_SHARE * limit_s;
        let excused_s = match activity {
            None => STARVED_TIMES * limit_s,
            Some(ProcessActivity::Runnable) if idle => STARVED_TIMES * limit_s,
            Some(ProcessActivity::Sleeping) => SLEEPING_TIMES * limit_s,
            Some(ProcessActivity::Runnable | ProcessActivity::Stopped) => 0.0,
        };
        if silence_s < excused_s {
            process.excused_until = now.plus_seconds(EXCUSE_S);
            return;
        }
        raise(actions, &events::PROCESS_HUNG, process, silence_s);
        kill_for_replacement(now, index, process, ReplaceReason::Hung, actions);
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

    fn refresh(&mut self, now: Timestamp, actions: &mut Vec<Action>) -> bool {
        let stopping = self.stopping.is_some();
        let essential = || self.processes.iter().filter(|process| process.rules.essential);
        self.up |= essential().all(|process| process.was_up)
            && self
                .processes
                .iter()
                .all(|process| process.run_state != RunState::Waiting);
        let health = if stopping {
            Health::Stopping
        } else {
            judge(
                self.processes.iter().map(|process| process.view(false)),
                self.was_healthy,
            )
        };
        let culprit = essential()
            .map(|process| process.view(stopping))
            .find(|view| view.state != ServiceState::Active)
            .map_or("", |view| view.name);
        if let Some(event) = self.announcer.update(now, health, culprit) {
            actions.push(Action::PublishEvent(event));
        }
        let mut changed = health != self.health;
        self.health = health;
        self.was_healthy |= health == Health::Healthy;
        for (index, (process, second)) in self.processes.iter().zip(&self.second_instances).enumerate() {
            let shadow = second.shadow.as_ref();
            let shown = (
                process.state(stopping),
                process.pid,
                process.generation,
                shadow.map_or(0, |shadow| shadow.pid),
                shadow.map_or(SwapPhase::Idle, Shadow::phase),
            );
            match self.shown.get_mut(index) {
                Some(before) => {
                    changed |= *before != shown;
                    *before = shown;
                }
                None => self.shown.push(shown),
            }
        }
        changed
    }
}

fn terminate(process: &mut Process, index: usize, now: Timestamp, actions: &mut Vec<Action>) {
    process.run_state = RunState::Ending {
        kill_at: Some(now.plus_seconds(PATIENCE_S)),
        for_good: true,
    };
    actions.push(Action::Terminate { process: index });
}

/// Asks a process to end, and starts it again at once when it has.
fn end_to_start_again(process: &mut Process, index: usize, now: Timestamp, actions: &mut Vec<Action>) {
    process.run_state = RunState::Ending {
        kill_at: Some(now.plus_seconds(PATIENCE_S)),
        for_good: false,
    };
    actions.push(Action::Terminate { process: index });
}

/// Kills a process so that it is started anew when its death is seen; what it does not do counts as missing from now.
fn kill_for_replacement(
    now: Timestamp,
    index: usize,
    process: &mut Process,
    reason: ReplaceReason,
    actions: &mut Vec<Action>,
) {
    process.reason = reason;
    process.missing_since.get_or_insert(now);
    process.run_state = RunState::Ending {
        kill_at: None,
        for_good: false,
    };
    actions.push(Action::Kill { process: index });
}

/// An event about a process with a duration in milliseconds.
fn raise(actions: &mut Vec<Action>, event: &Event, process: &Process, seconds: f64) {
    let sample = EventSample::new(event, &process.rules.name, [(seconds * 1e3).round(), 0.0]);
    actions.push(Action::PublishEvent(sample));
}

#[cfg(test)]
mod tests;
