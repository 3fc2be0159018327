//! Processes that run and miss their deadlines: cycles over budget, and outputs over their end-to-end budget.

use super::stopping::kill_for_replacement;
use super::{Action, Supervision, raise};
use crate::process::RunState;
use crate::slowness::{SlownessLevel, WINDOW_S};
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::health::ReplaceReason;
use jink_shared_types::{STAGE_NAMES, Timestamp};

/// Late outputs are reported when so many are over their end-to-end budget since the last report.
const LATE_MIN: u64 = 3;
/// Least time between two reports of late outputs of one process (s).
const LATE_REPORTED_AGAIN_S: f64 = 5.0;
/// A process that is slow again within this time (s) after it was replaced for that is slow because of what it has to do, or of the
/// board: it stays, degraded. Another replacement would be as slow, and the last one would be given up.
const SLOW_REPLACED_AGAIN_S: f64 = 60.0;

impl Supervision {
    /// Cycles over budget, graded by the process's own rule.
    pub(super) fn judge_slowness(&mut self, now: Timestamp, actions: &mut Vec<Action>) {
        for (index, process) in self.processes.iter_mut().enumerate() {
            if process.run_state != RunState::Running || !process.in_loop() {
                continue;
            }
            let misses = process.slowness.misses();
            let Some(grade) = process.slowness.judge(&process.rules.slow) else {
                continue;
            };
            let numbers = [f64::from(misses), WINDOW_S];
            let was_replaced = process.slow_replaced.is_set()
                && now.seconds_since(process.slow_replaced) < SLOW_REPLACED_AGAIN_S;
            match grade {
                SlownessLevel::Fine => {}
                SlownessLevel::Replace if !was_replaced => {
                    process.slow_replaced = now;
                    raise(actions, &events::PROCESS_TOO_SLOW, process, 0.0);
                    kill_for_replacement(now, index, process, ReplaceReason::Slow, actions);
                }
                SlownessLevel::Event | SlownessLevel::Degraded | SlownessLevel::Replace => {
                    actions.push(Action::PublishEvent(EventSample::new(
                        &events::PROCESS_SLOW,
                        &process.rules.name,
                        numbers,
                    )));
                }
            }
        }
    }

    /// Outputs older than their end-to-end budget: reported with the stage that took most, at most once in a while.
    pub(super) fn judge_lateness(&mut self, now: Timestamp, actions: &mut Vec<Action>) {
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
}
