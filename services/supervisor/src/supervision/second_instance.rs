//! Second instances in the state machine: swaps, hot shadows, and which instance takes over when an owner dies. The
//! rules are in [`crate::shadow`].

use super::stopping::{end_to_start_again, kill_for_replacement};
use super::{Action, Exit, LOOK_S, Supervision, raise};
use crate::process::{Process, RunState};
use crate::shadow::{
    Outcome, SETTLE_S, SWITCH_LEAD_S, Shadow, ShadowRole, Swap, SwapProgress, SwapRefusal, TrialVerdict,
    WATCH_S, quiet_moment,
};
use jink_shared_types::Timestamp;
use jink_shared_types::coded::Wire;
use jink_shared_types::control::{Control, ControlEntry};
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::health::{Name, ReplaceReason, ServiceState, SwapPhase};

/// A hot shadow is started when its owner has run this long (s): where owners die at once, a shadow would die, too.
const HOT_AFTER_S: f64 = 1.0;
/// A hot shadow that has died is started again after this long (s).
const HOT_AGAIN_S: f64 = 2.0;

/// What belongs to the second instance of one process.
#[derive(Clone, Debug, Default)]
pub(super) struct SecondInstance {
    pub(super) shadow: Option<Shadow>,
    /// A swap that waits for its place.
    wanted: Option<Swap>,
    /// Of a row without second instances: a new program has been started behind this generation, and is watched.
    replaced: Option<u32>,
    /// No hot shadow before.
    not_before: Timestamp,
    /// What it left in shared memory has not been removed.
    has_stale_resources: bool,
}

impl SecondInstance {
    /// Whether it has left resources to be removed; true once.
    pub(super) fn take_stale(&mut self) -> bool {
        std::mem::take(&mut self.has_stale_resources)
    }
}

impl Supervision {
    /// Writes the owner of each process.
    pub fn write_control(&self, control: &mut Control) {
        control.len = self.processes.len() as u32;
        for ((slot, process), second) in control
            .entries
            .iter_mut()
            .zip(&self.processes)
            .zip(&self.second_instances)
        {
            *slot = ControlEntry {
                name: Name::new(&process.rules.name),
                active: process.generation,
                epoch: process.epoch,
                ..ControlEntry::default()
            };
            if let Some(shadow) = &second.shadow
                && let ShadowRole::Candidate(swap) = shadow.role
                && swap.phase == SwapPhase::Switching
            {
                slot.next = shadow.generation;
                slot.next_epoch = shadow.epoch;
                slot.from = swap.from;
            }
        }
    }

    /// Whether a swap of process `index` is under way: another one is not even prepared then.
    pub fn is_swapping(&self, index: usize) -> bool {
        self.second_instances.get(index).is_some_and(|second| {
            let busy = second
                .shadow
                .as_ref()
                .is_some_and(|one| one.role != ShadowRole::Hot);
            busy || second.wanted.is_some() || second.replaced.is_some()
        })
    }

    pub(super) fn swap_requested(
        &mut self,
        now: Timestamp,
        index: usize,
        cycles: u64,
        dry_run: bool,
        actions: &mut Vec<Action>,
    ) {
        let busy = self.is_swapping(index);
        let (Some(process), Some(second)) = (
            self.processes.get_mut(index),
            self.second_instances.get_mut(index),
        ) else {
            return;
        };
        let refusal = if self.stopping.is_some() {
            Some(SwapRefusal::Stopping)
        } else if busy {
            Some(SwapRefusal::Busy)
        } else if process.run_state != RunState::Running || !process.in_loop() {
            Some(SwapRefusal::NotRunning)
        } else if dry_run && !process.rules.has_shadow {
            Some(SwapRefusal::NoShadow)
        } else {
            None
        };
        if let Some(refusal) = refusal {
            report_swap(actions, index, SwapProgress::Refused(refusal));
            return;
        }
        if !process.rules.has_shadow {
            process.reason = ReplaceReason::Swapped;
            second.replaced = Some(process.generation);
            end_to_start_again(process, index, now, actions);
            actions.push(Action::Commit { process: index });
            report_swap(actions, index, SwapProgress::Replaced);
            return;
        }
        second.wanted = Some(Swap {
            phase: SwapPhase::Starting,
            cycles,
            dry_run,
            since: Timestamp::NEVER,
            begin: None,
            from: Timestamp::NEVER,
        });
        // A hot shadow is ended first.
        end(second, index, actions);
    }

    /// Starts candidates and hot shadows, and moves swaps on.
    pub(super) fn step_second_instances(&mut self, now: Timestamp, actions: &mut Vec<Action>) {
        for index in 0..self.second_instances.len() {
            self.start_second(now, index, actions);
            self.step_second(now, index, actions);
            self.conclude_replaced(now, index, actions);
        }
    }

    fn start_second(&mut self, now: Timestamp, index: usize, actions: &mut Vec<Action>) {
        let (process, second) = (&mut self.processes[index], &mut self.second_instances[index]);
        if second.shadow.is_some() {
            return;
        }
        let hot = process.rules.hot_shadow
            && process.run_state == RunState::Running
            && process.in_loop()
            && now.seconds_since(process.started) > HOT_AFTER_S
            && now >= second.not_before;
        let kind = match second.wanted.take() {
            Some(swap) => ShadowRole::Candidate(swap),
            None if hot => ShadowRole::Hot,
            None => return,
        };
        let generation = process.next_generation();
        second.shadow = Some(Shadow::new(kind, generation, now));
        actions.push(Action::SpawnShadow {
            process: index,
            generation,
            candidate: kind != ShadowRole::Hot,
        });
    }

    /// A program that took the place of another one without a second instance is good once it has run in its loop for a while.
    fn conclude_replaced(&mut self, now: Timestamp, index: usize, actions: &mut Vec<Action>) {
        let (process, second) = (&self.processes[index], &mut self.second_instances[index]);
        let is_good = process.in_loop() && now.seconds_since(process.started) >= WATCH_S;
        if second
            .replaced
            .take_if(|before| is_good && process.generation > *before)
            .is_some()
        {
            report_swap(actions, index, SwapProgress::Done);
            raise(actions, &events::PROCESS_SWAPPED, process, 0.0);
        }
    }

    /// A program that took the place of another one without a second instance has died: whether the former one is started again.
    pub(super) fn take_back(
        &mut self,
        now: Timestamp,
        index: usize,
        exit: Exit,
        actions: &mut Vec<Action>,
    ) -> bool {
        let (process, second) = (&mut self.processes[index], &mut self.second_instances[index]);
        let failed = second.replaced.take_if(|before| process.generation > *before);
        if failed.is_none() {
            return false;
        }
        process.run_state = RunState::Resting { until: now };
        actions.push(Action::TakeBack { process: index });
        report_swap(actions, index, SwapProgress::RolledBack(SwapRefusal::Ended(exit)));
        raise(actions, &events::SWAP_ROLLED_BACK, process, 0.0);
        true
    }

    /// Somebody else decides what runs as process `index`: nobody watches a replaced program any more.
    pub(super) fn forget_replaced(&mut self, index: usize, actions: &mut Vec<Action>) {
        if self.second_instances[index].replaced.take().is_some() {
            report_swap(actions, index, SwapProgress::Done);
        }
    }

    /// The processes that the system needs and that say that they work, one bit each.
    fn working(&self) -> u32 {
        let is_working = |process: &Process| {
            process.rules.essential
                && process.run_state == RunState::Running
                && process.heartbeat().state == ServiceState::Active
        };
        let processes = self.processes.iter().enumerate();
        processes.fold(0, |bits, (index, process)| {
            bits | u32::from(is_working(process)) << index
        })
    }

    fn step_second(&mut self, now: Timestamp, index: usize, actions: &mut Vec<Action>) {
        let working = self.working();
        let watched = match self.second_instances[index]
            .shadow
            .as_ref()
            .map(|shadow| shadow.role)
        {
            Some(ShadowRole::Former { outcome, .. }) => outcome.worked & !working,
            _ => 0,
        };
        let lacking = self
            .processes
            .get(watched.trailing_zeros() as usize)
            .map(|process| Name::new(&process.rules.name));
        let (process, second) = (&mut self.processes[index], &mut self.second_instances[index]);
        let Some(shadow) = second.shadow.as_mut().filter(|shadow| !shadow.ending) else {
            return;
        };
        let silent = shadow.is_silent(now, process.rules.heartbeat_timeout_s);
        let ownerless = process.run_state != RunState::Running;
        match &mut shadow.role {
            ShadowRole::Candidate(_) if ownerless => {
                refuse(process, second, index, SwapRefusal::OwnerDied, actions);
            }
            ShadowRole::Hot if silent => end(second, index, actions),
            ShadowRole::Hot => {}
            ShadowRole::Former { until, outcome } => {
                if outcome.judge(now, lacking) {
                    if process.run_state == RunState::Running {
                        kill_for_replacement(now, index, process, ReplaceReason::Swapped, actions);
                    }
                } else if silent || (now >= *until && outcome.is_good()) {
                    actions.push(Action::Commit { process: index });
                    report_swap(actions, index, SwapProgress::Done);
                    raise(actions, &events::PROCESS_SWAPPED, process, 0.0);
                    end(second, index, actions);
                }
            }
            ShadowRole::Candidate(_) if silent => {
                refuse(process, second, index, SwapRefusal::Silent, actions);
            }
            ShadowRole::Candidate(swap) => match swap.phase {
                SwapPhase::Starting => {
                    let cycles = swap.cycles;
                    if now.seconds_since(shadow.started) > process.rules.start_grace_s {
                        refuse(process, second, index, SwapRefusal::NeverUp, actions);
                    } else if shadow.in_loop() {
                        let beats = (shadow.heartbeat, process.heartbeat());
                        if let ShadowRole::Candidate(swap) = &mut shadow.role {
                            swap.phase = SwapPhase::Probation;
                            swap.since = now;
                            swap.begin = Some(beats);
                        }
                        report_swap(actions, index, SwapProgress::Probation { cycles });
                    }
                }
                SwapPhase::Probation => match swap.judge(now, &shadow.heartbeat, &process.heartbeat()) {
                    TrialVerdict::Goes => {}
                    TrialVerdict::Failed(refusal) => refuse(process, second, index, refusal, actions),
                    TrialVerdict::Passed(trial) if swap.dry_run => {
                        report_swap(actions, index, SwapProgress::DryRunPassed { trial });
                        end(second, index, actions);
                    }
                    TrialVerdict::Passed(trial) => {
                        swap.phase = SwapPhase::Switching;
                        swap.from = quiet_moment(now.plus_seconds(SWITCH_LEAD_S));
                        report_swap(actions, index, SwapProgress::Switching { trial });
                    }
                },
                SwapPhase::Switching => {
                    if now.seconds_since(swap.from) >= SETTLE_S {
                        exchange(process, shadow);
                        process.reason = ReplaceReason::Swapped;
                        shadow.role = ShadowRole::Former {
                            until: now.plus_seconds(WATCH_S),
                            outcome: Outcome::new(working),
                        };
                        actions.push(Action::Promote { process: index });
                        report_swap(actions, index, SwapProgress::Switched);
                    }
                }
                SwapPhase::Idle | SwapPhase::Watching => {}
            },
        }
    }

    /// The owner has died: whether its second instance takes over.
    pub(super) fn take_over(
        &mut self,
        now: Timestamp,
        index: usize,
        exit: Exit,
        actions: &mut Vec<Action>,
    ) -> bool {
        let (process, second) = (&mut self.processes[index], &mut self.second_instances[index]);
        let Some(mut shadow) = second.shadow.take_if(|shadow| shadow.is_ready()) else {
            return false;
        };
        let kind = shadow.role;
        match kind {
            ShadowRole::Candidate(swap) if swap.phase != SwapPhase::Switching => {
                // It has not proven itself: an ordinary restart is the better choice.
                second.shadow = Some(shadow);
                refuse(process, second, index, SwapRefusal::OwnerDied, actions);
                return false;
            }
            ShadowRole::Former { outcome, .. } => {
                shadow.epoch = process.next_generation();
                let why = outcome.failed.unwrap_or(SwapRefusal::Ended(exit));
                report_swap(actions, index, SwapProgress::RolledBack(why));
                raise(actions, &events::SWAP_ROLLED_BACK, process, 0.0);
            }
            ShadowRole::Candidate(_) => {
                actions.push(Action::Commit { process: index });
                report_swap(actions, index, SwapProgress::Done);
            }
            ShadowRole::Hot => {}
        }
        exchange(process, &mut shadow);
        process.taken_over(now);
        second.not_before = now.plus_seconds(HOT_AGAIN_S);
        actions.push(Action::Promote { process: index });
        raise(actions, &events::PROCESS_TAKEN_OVER, process, 0.0);
        true
    }

    pub(super) fn shadow_died(
        &mut self,
        now: Timestamp,
        index: usize,
        exit: Exit,
        actions: &mut Vec<Action>,
    ) {
        let (Some(process), Some(second)) = (
            self.processes.get_mut(index),
            self.second_instances.get_mut(index),
        ) else {
            return;
        };
        let Some(shadow) = second.shadow.take() else {
            return;
        };
        second.has_stale_resources = true;
        second.not_before = now.plus_seconds(HOT_AGAIN_S);
        if shadow.ending {
            return;
        }
        match shadow.role {
            ShadowRole::Hot => {}
            ShadowRole::Candidate(swap) => {
                turn_down(process, &swap, index, SwapRefusal::Ended(exit), actions);
            }
            ShadowRole::Former { .. } => {
                actions.push(Action::Commit { process: index });
                report_swap(actions, index, SwapProgress::Done);
                raise(actions, &events::PROCESS_SWAPPED, process, 0.0);
            }
        }
    }

    /// Ends every second instance; swaps that are under way are over.
    pub(super) fn end_second_instances(&mut self, actions: &mut Vec<Action>) {
        for index in 0..self.second_instances.len() {
            self.end_second_of(index, SwapRefusal::Stopping, actions);
        }
    }

    /// Ends the second instance of one process, because of `refusal` if it was a candidate.
    pub(super) fn end_second_of(&mut self, index: usize, refusal: SwapRefusal, actions: &mut Vec<Action>) {
        self.forget_replaced(index, actions);
        let (process, second) = (&mut self.processes[index], &mut self.second_instances[index]);
        let candidate = second
            .shadow
            .as_ref()
            .is_some_and(|one| !one.ending && matches!(one.role, ShadowRole::Candidate(_)));
        if second.wanted.take().is_some() || candidate {
            refuse(process, second, index, refusal, actions);
        } else {
            end(second, index, actions);
        }
    }

    /// When second instances have to be stepped again.
    pub(super) fn second_instances_wake(&self, now: Timestamp) -> Option<Timestamp> {
        let any = self
            .second_instances
            .iter()
            .any(|second| second.shadow.is_some() || second.wanted.is_some() || second.replaced.is_some());
        any.then(|| now.plus_seconds(LOOK_S))
    }
}

/// Ends the second instance, if there is one.
fn end(second: &mut SecondInstance, index: usize, actions: &mut Vec<Action>) {
    if let Some(shadow) = second.shadow.as_mut().filter(|shadow| !shadow.ending) {
        shadow.ending = true;
        actions.push(Action::KillShadow { process: index });
    }
}

fn refuse(
    process: &mut Process,
    second: &mut SecondInstance,
    index: usize,
    refusal: SwapRefusal,
    actions: &mut Vec<Action>,
) {
    match second.shadow.as_ref().map(|shadow| shadow.role) {
        Some(ShadowRole::Candidate(swap)) => turn_down(process, &swap, index, refusal, actions),
        _ => {
            report_refusal(actions, index, process, refusal);
        }
    }
    end(second, index, actions);
}

/// A candidate is rejected. If its moment had come already it may have published: then the owner continues in a newer
/// epoch, so that readers do not take its samples for older ones.
fn turn_down(
    process: &mut Process,
    swap: &Swap,
    index: usize,
    refusal: SwapRefusal,
    actions: &mut Vec<Action>,
) {
    if swap.phase == SwapPhase::Switching {
        process.epoch = process.next_generation();
        report_swap(actions, index, SwapProgress::RolledBack(refusal));
        raise(actions, &events::SWAP_ROLLED_BACK, process, 0.0);
    } else {
        report_refusal(actions, index, process, refusal);
    }
}

fn report_swap(actions: &mut Vec<Action>, process: usize, progress: SwapProgress) {
    actions.push(Action::ReportSwap { process, progress });
}

fn report_refusal(actions: &mut Vec<Action>, index: usize, process: &Process, refusal: SwapRefusal) {
    report_swap(actions, index, SwapProgress::Refused(refusal));
    let reason = f64::from(refusal.reason().code());
    let event = EventSample::new(&events::SWAP_REFUSED, &process.rules.name, [reason, 0.0]);
    actions.push(Action::PublishEvent(event));
}

/// Owner and second instance exchange their places.
fn exchange(process: &mut Process, shadow: &mut Shadow) {
    let mut heartbeat = shadow.heartbeat;
    let mut heartbeat_time = shadow.heartbeat_time;
    process.exchange_heartbeat(&mut heartbeat, &mut heartbeat_time);
    shadow.heartbeat = heartbeat;
    shadow.heartbeat_time = heartbeat_time;
    std::mem::swap(&mut process.generation, &mut shadow.generation);
    std::mem::swap(&mut process.epoch, &mut shadow.epoch);
    std::mem::swap(&mut process.pid, &mut shadow.pid);
    std::mem::swap(&mut process.started, &mut shadow.started);
    process.excused_until = Timestamp::NEVER;
}
