//! Processes that send no heartbeat: which are suspected, and whether one hangs or only gets no CPU.

use super::stopping::kill_for_replacement;
use super::{Action, ProcessActivity, Supervision, raise};
use crate::process::{Process, RunState};
use jink_shared_types::Timestamp;
use jink_shared_types::events;
use jink_shared_types::health::ReplaceReason;

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

impl Supervision {
    pub(super) fn suspect_silence(&mut self, now: Timestamp, actions: &mut Vec<Action>) {
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

    pub(super) fn inspected(
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
}
