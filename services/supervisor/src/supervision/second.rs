//! Second instances in the state machine: swaps, hot shadows, and who takes over when an owner dies. The rules are in
//! [`crate::shadow`].

use super::{Action, Exit, LOOK_S, Supervision, end_to_start_again, raise};
use crate::process::{Life, Process};
use crate::shadow::{
    Judgement, Kind, Refusal, SETTLE_S, SWITCH_LEAD_S, Shadow, Swap, SwapNews, WATCH_S, quiet_moment,
};
use jink_shared_types::Timestamp;
use jink_shared_types::control::{Control, ControlEntry};
use jink_shared_types::events;
use jink_shared_types::health::{Name, ReplaceReason, SwapPhase};

/// A hot shadow is started when its owner has lived this long (s): owners that die at once need no second victim.
const HOT_AFTER_S: f64 = 1.0;
/// A hot shadow that has died is started again after this long (s).
const HOT_AGAIN_S: f64 = 2.0;

/// What belongs to the second instance of one process.
#[derive(Clone, Debug, Default)]
pub(super) struct Second {
    pub(super) shadow: Option<Shadow>,
    /// A swap that waits for its place.
    wanted: Option<Swap>,
    /// No hot shadow before.
    not_before: Timestamp,
    /// What it left in shared memory has not been removed.
    left_behind: bool,
}

impl Second {
    /// Whether it has left something to be removed; asked once.
    pub(super) fn take_remains(&mut self) -> bool {
        std::mem::take(&mut self.left_behind)
    }
}

impl Supervision {
    /// Writes who owns what.
    pub fn write_control(&self, control: &mut Control) {
        control.len = self.processes.len() as u32;
        for ((slot, process), second) in control.entries.iter_mut().zip(&self.processes).zip(&self.seconds) {
            *slot = ControlEntry {
                name: Name::new(&process.rules.name),
                active: process.generation,
                epoch: process.epoch,
                ..ControlEntry::default()
            };
            if let Some(shadow) = &second.shadow
                && let Kind::Candidate(swap) = shadow.kind
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
        self.seconds.get(index).is_some_and(|second| {
            let busy = second.shadow.as_ref().is_some_and(|one| one.kind != Kind::Hot);
            busy || second.wanted.is_some()
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
        let (Some(process), Some(second)) = (self.processes.get_mut(index), self.seconds.get_mut(index))
        else {
            return;
        };
        let refusal = if self.stopping.is_some() {
            Some(Refusal::Stopping)
        } else if busy {
            Some(Refusal::Busy)
        } else if process.life != Life::Running || !process.in_loop() {
            Some(Refusal::NotRunning)
        } else if dry_run && !process.rules.has_shadow {
            Some(Refusal::NoShadow)
        } else {
            None
        };
        if let Some(refusal) = refusal {
            tell(actions, index, SwapNews::Refused(refusal));
            return;
        }
        if !process.rules.has_shadow {
            process.reason = ReplaceReason::Swapped;
            end_to_start_again(process, index, now, actions);
            actions.push(Action::Commit { process: index });
            tell(actions, index, SwapNews::Replaced);
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
        // A hot shadow makes room.
        end(second, index, actions);
    }

    /// Starts candidates and hot shadows, and moves swaps on.
    pub(super) fn step_seconds(&mut self, now: Timestamp, actions: &mut Vec<Action>) {
        for index in 0..self.seconds.len() {
            self.start_second(now, index, actions);
            self.step_second(now, index, actions);
        }
    }

    fn start_second(&mut self, now: Timestamp, index: usize, actions: &mut Vec<Action>) {
        let (process, second) = (&mut self.processes[index], &mut self.seconds[index]);
        if second.shadow.is_some() {
            return;
        }
        let hot = process.rules.hot_shadow
            && process.life == Life::Running
            && process.in_loop()
            && now.seconds_since(process.started) > HOT_AFTER_S
            && now >= second.not_before;
        let kind = match second.wanted.take() {
            Some(swap) => Kind::Candidate(swap),
            None if hot => Kind::Hot,
            None => return,
        };
        let generation = process.next_generation();
        second.shadow = Some(Shadow::new(kind, generation, now));
        actions.push(Action::SpawnShadow {
            process: index,
            generation,
            candidate: kind != Kind::Hot,
        });
    }

    fn step_second(&mut self, now: Timestamp, index: usize, actions: &mut Vec<Action>) {
        let (process, second) = (&mut self.processes[index], &mut self.seconds[index]);
        let Some(shadow) = second.shadow.as_mut().filter(|shadow| !shadow.ending) else {
            return;
        };
        let silent = shadow.is_silent(now, process.rules.heartbeat_timeout_s);
        let ownerless = process.life != Life::Running;
        match &mut shadow.kind {
            Kind::Candidate(_) if ownerless => refuse(process, second, index, Refusal::OwnerDied, actions),
            Kind::Hot if silent => end(second, index, actions),
            Kind::Hot => {}
            Kind::Former { until } => {
                if now >= *until || silent {
                    actions.push(Action::Commit { process: index });
                    tell(actions, index, SwapNews::Done);
                    raise(actions, &events::PROCESS_SWAPPED, process, 0.0);
                    end(second, index, actions);
                }
            }
            Kind::Candidate(_) if silent => refuse(process, second, index, Refusal::Silent, actions),
            Kind::Candidate(swap) => match swap.phase {
                SwapPhase::Starting => {
                    let cycles = swap.cycles;
                    if now.seconds_since(shadow.started) > process.rules.start_grace_s {
                        refuse(process, second, index, Refusal::NeverUp, actions);
                    } else if shadow.in_loop() {
                        let beats = (shadow.heartbeat, process.heartbeat());
                        if let Kind::Candidate(swap) = &mut shadow.kind {
                            swap.phase = SwapPhase::Probation;
                            swap.since = now;
                            swap.begin = Some(beats);
                        }
                        tell(actions, index, SwapNews::Probation { cycles });
                    }
                }
                SwapPhase::Probation => match swap.judge(now, &shadow.heartbeat, &process.heartbeat()) {
                    Judgement::Goes => {}
                    Judgement::Failed(refusal) => refuse(process, second, index, refusal, actions),
                    Judgement::Passed(trial) if swap.dry_run => {
                        tell(actions, index, SwapNews::DryRunPassed { trial });
                        end(second, index, actions);
                    }
                    Judgement::Passed(trial) => {
                        swap.phase = SwapPhase::Switching;
                        swap.from = quiet_moment(now.plus_seconds(SWITCH_LEAD_S));
                        tell(actions, index, SwapNews::Switching { trial });
                    }
                },
                SwapPhase::Switching => {
                    if now.seconds_since(swap.from) >= SETTLE_S {
                        exchange(process, shadow);
                        process.reason = ReplaceReason::Swapped;
                        shadow.kind = Kind::Former {
                            until: now.plus_seconds(WATCH_S),
                        };
                        actions.push(Action::Promote { process: index });
                        tell(actions, index, SwapNews::Switched);
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
        let (process, second) = (&mut self.processes[index], &mut self.seconds[index]);
        let Some(mut shadow) = second.shadow.take_if(|shadow| shadow.is_ready()) else {
            return false;
        };
        let kind = shadow.kind;
        match kind {
            Kind::Candidate(swap) if swap.phase != SwapPhase::Switching => {
                // It has not proven itself: an ordinary restart is the better choice.
                second.shadow = Some(shadow);
                refuse(process, second, index, Refusal::OwnerDied, actions);
                return false;
            }
            Kind::Former { .. } => {
                shadow.epoch = process.next_generation();
                tell(actions, index, SwapNews::RolledBack(Refusal::Ended(exit)));
                raise(actions, &events::SWAP_ROLLED_BACK, process, 0.0);
            }
            Kind::Candidate(_) => {
                actions.push(Action::Commit { process: index });
                tell(actions, index, SwapNews::Done);
            }
            Kind::Hot => {}
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
        let (Some(process), Some(second)) = (self.processes.get_mut(index), self.seconds.get_mut(index))
        else {
            return;
        };
        let Some(shadow) = second.shadow.take() else {
            return;
        };
        second.left_behind = true;
        second.not_before = now.plus_seconds(HOT_AGAIN_S);
        if shadow.ending {
            return;
        }
        match shadow.kind {
            Kind::Hot => {}
            Kind::Candidate(swap) => turn_down(process, &swap, index, Refusal::Ended(exit), actions),
            Kind::Former { .. } => {
                actions.push(Action::Commit { process: index });
                tell(actions, index, SwapNews::Done);
                raise(actions, &events::PROCESS_SWAPPED, process, 0.0);
            }
        }
    }

    /// Ends every second instance; swaps that are under way are over.
    pub(super) fn end_seconds(&mut self, actions: &mut Vec<Action>) {
        for index in 0..self.seconds.len() {
            self.end_second_of(index, Refusal::Stopping, actions);
        }
    }

    /// Ends the second instance of one process, because of `refusal` if it was a candidate.
    pub(super) fn end_second_of(&mut self, index: usize, refusal: Refusal, actions: &mut Vec<Action>) {
        let (process, second) = (&mut self.processes[index], &mut self.seconds[index]);
        let candidate = second
            .shadow
            .as_ref()
            .is_some_and(|one| !one.ending && matches!(one.kind, Kind::Candidate(_)));
        if second.wanted.take().is_some() || candidate {
            refuse(process, second, index, refusal, actions);
        } else {
            end(second, index, actions);
        }
    }

    /// When second instances want to be looked at again.
    pub(super) fn seconds_wake(&self, now: Timestamp) -> Option<Timestamp> {
        let any = self
            .seconds
            .iter()
            .any(|second| second.shadow.is_some() || second.wanted.is_some());
        any.then(|| now.plus_seconds(LOOK_S))
    }
}

/// Ends the second instance, if there is one.
fn end(second: &mut Second, index: usize, actions: &mut Vec<Action>) {
    if let Some(shadow) = second.shadow.as_mut().filter(|shadow| !shadow.ending) {
        shadow.ending = true;
        actions.push(Action::KillShadow { process: index });
    }
}

fn refuse(
    process: &mut Process,
    second: &mut Second,
    index: usize,
    refusal: Refusal,
    actions: &mut Vec<Action>,
) {
    match second.shadow.as_ref().map(|shadow| shadow.kind) {
        Some(Kind::Candidate(swap)) => turn_down(process, &swap, index, refusal, actions),
        _ => {
            tell(actions, index, SwapNews::Refused(refusal));
            raise(actions, &events::SWAP_REFUSED, process, 0.0);
        }
    }
    end(second, index, actions);
}

/// A candidate is not taken. If its moment had come already it may have spoken: then the owner goes on in a newer epoch, so
/// that readers do not take its samples for older ones.
fn turn_down(process: &mut Process, swap: &Swap, index: usize, refusal: Refusal, actions: &mut Vec<Action>) {
    if swap.phase == SwapPhase::Switching {
        process.epoch = process.next_generation();
        tell(actions, index, SwapNews::RolledBack(refusal));
        raise(actions, &events::SWAP_ROLLED_BACK, process, 0.0);
    } else {
        tell(actions, index, SwapNews::Refused(refusal));
        raise(actions, &events::SWAP_REFUSED, process, 0.0);
    }
}

fn tell(actions: &mut Vec<Action>, process: usize, news: SwapNews) {
    actions.push(Action::Tell { process, news });
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
