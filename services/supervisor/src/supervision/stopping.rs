//! How processes are ended: one of them, the outputs, or the whole system in reverse order; SIGTERM first, SIGKILL when
//! that does not suffice.

use super::{Action, End, Supervision};
use crate::process::{Process, RunState};
use jink_shared_types::Timestamp;
use jink_shared_types::health::ReplaceReason;

/// From SIGTERM to SIGKILL (s): a service leaves its loop within a cycle, which is two orders of magnitude less.
const PATIENCE_S: f64 = 1.0;

impl Supervision {
    pub(super) fn begin_stop(&mut self, end: End) {
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

    pub(super) fn stop_output(&mut self, now: Timestamp, actions: &mut Vec<Action>) {
        for index in 0..self.processes.len() {
            let process = &mut self.processes[index];
            if process.rules.is_output {
                end_for_good(process, index, now, actions);
            }
        }
    }

    pub(super) fn kill_unresponsive(&mut self, now: Timestamp, actions: &mut Vec<Action>) {
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
    pub(super) fn stop_next(&mut self, now: Timestamp, actions: &mut Vec<Action>) {
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
}

pub(super) fn terminate(process: &mut Process, index: usize, now: Timestamp, actions: &mut Vec<Action>) {
    process.run_state = RunState::Ending {
        kill_at: Some(now.plus_seconds(PATIENCE_S)),
        for_good: true,
    };
    actions.push(Action::Terminate { process: index });
}

/// Asks a process to end, and starts it again at once when it has.
pub(super) fn end_to_start_again(
    process: &mut Process,
    index: usize,
    now: Timestamp,
    actions: &mut Vec<Action>,
) {
    process.run_state = RunState::Ending {
        kill_at: Some(now.plus_seconds(PATIENCE_S)),
        for_good: false,
    };
    actions.push(Action::Terminate { process: index });
}

/// Kills a process so that it is started anew when its death is seen; what it does not do counts as missing from now.
/// Ends `process`, and starts it no more.
pub(super) fn end_for_good(process: &mut Process, index: usize, now: Timestamp, actions: &mut Vec<Action>) {
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

pub(super) fn kill_for_replacement(
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
