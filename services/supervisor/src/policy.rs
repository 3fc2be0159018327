//! When a dead process may be started again, and when it is given up.
//!
//! Two independent rules, as in Erlang/OTP with a back-off added: the *delay* grows with every death of a process that
//! had not worked for a while, and the *intensity* bounds the restarts within any period. A process that crashes
//! at once runs into the intensity; one that fails slowly (a device that is unplugged) settles at the longest delay and
//! is tried for as long as the intensity allows for that interval.

use jink_shared_types::Timestamp;
use std::collections::VecDeque;

/// Shortest delay of a second restart: below this, a process that dies while it is being loaded would keep a core busy
/// with loading it.
const SECOND_DELAY_S: f64 = 0.01;

/// A process that ran this long had worked: its next start is not put off (s). A start takes a hundredth of it.
const STEADY_S: f64 = 1.0;

/// How a process is restarted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestartRule {
    /// Delay of the first restart (s).
    pub floor_s: f64,
    /// Longest delay (s).
    pub ceiling_s: f64,
    /// By how much the delay grows from restart to restart, at least 1.
    pub factor: f64,
    /// Most restarts within the period; one more death and the process is given up.
    pub intensity: u32,
    /// The period (s).
    pub period_s: f64,
}

impl Default for RestartRule {
    /// At once, then 10, 20, 40 ms and so on up to 2 s; given up at the ninth death within 10 s. At the ceiling only
    /// five restarts fit into a period, so what fails slowly is retried for ever, and what crashes at once is given up
    /// after about 1.3 s.
    fn default() -> Self {
        Self {
            floor_s: 0.0,
            ceiling_s: 2.0,
            factor: 2.0,
            intensity: 8,
            period_s: 10.0,
        }
    }
}

impl RestartRule {
    /// Delay before the restart that follows `earlier` restarts of the same streak (s).
    pub fn delay_s(&self, earlier: u32) -> f64 {
        if earlier == 0 {
            return self.floor_s.min(self.ceiling_s);
        }
        let second_s = (self.floor_s * self.factor).max(SECOND_DELAY_S);
        let steps = i32::try_from(earlier - 1).unwrap_or(i32::MAX);
        (second_s * self.factor.powi(steps)).min(self.ceiling_s)
    }
}

/// What becomes of a process that has died.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RestartDecision {
    /// Started again after this delay (s).
    RestartAfter(f64),
    /// Died more often than its rule allows.
    GiveUp,
}

/// The restarts of one process so far, as far as they matter.
#[derive(Clone, Debug, Default)]
pub struct RestartHistory {
    restarts: VecDeque<Timestamp>,
    streak: u32,
}

impl RestartHistory {
    /// Judges a death at `now` of a process that had run for `lived_s`. `hopeless`: trying again at once is
    /// known to fail (the process reported that it cannot start): then the longest delay applies.
    pub fn died(
        &mut self,
        rule: &RestartRule,
        now: Timestamp,
        lived_s: f64,
        hopeless: bool,
    ) -> RestartDecision {
        if lived_s >= STEADY_S.min(rule.period_s) {
            self.streak = 0;
        }
        self.restarts
            .retain(|restart| now.seconds_since(*restart) < rule.period_s);
        if self.restarts.len() >= rule.intensity as usize {
            return RestartDecision::GiveUp;
        }
        let delay_s = if hopeless {
            rule.ceiling_s
        } else {
            rule.delay_s(self.streak)
        };
        self.streak = self.streak.saturating_add(1);
        RestartDecision::RestartAfter(delay_s)
    }

    /// The kernel has refused to start a program: no process could be made, no memory was left, or the program is being replaced on
    /// disk. That is no fault of the program, so it counts as no restart, and is tried again for as long as it takes; answers after how
    /// long (s).
    pub fn not_spawned(&mut self, rule: &RestartRule) -> f64 {
        self.restarts.pop_back();
        let delay_s = rule.delay_s(self.streak);
        self.streak = self.streak.saturating_add(1);
        delay_s
    }

    /// Counts a restart at `now`.
    pub fn restarted(&mut self, now: Timestamp) {
        self.restarts.push_back(now);
    }
}

#[cfg(test)]
mod tests {
    use super::{RestartDecision, RestartHistory, RestartRule};
    use jink_shared_types::Timestamp;
    use proptest::prelude::*;

    fn rule() -> impl Strategy<Value = RestartRule> {
        (0.0..0.5f64, 0.5..5.0f64, 1.0..4.0f64, 0..12u32, 0.5..20.0f64).prop_map(
            |(floor_s, ceiling_s, factor, intensity, period_s)| RestartRule {
                floor_s,
                ceiling_s,
                factor,
                intensity,
                period_s,
            },
        )
    }

    proptest! {
        #[test]
        fn the_delay_grows_from_the_floor_to_the_ceiling(rule in rule(), earlier in 0..200u32) {
            let (this, next) = (rule.delay_s(earlier), rule.delay_s(earlier + 1));
            prop_assert!(this <= next, "{this} then {next}");
            prop_assert!((rule.floor_s..=rule.ceiling_s).contains(&this));
        }

        /// Whatever the process does, no window of one period ever holds more restarts than the intensity.
        #[test]
        fn the_intensity_holds_in_every_window(rule in rule(), lives in proptest::collection::vec(0.0..3.0f64, 1..80)) {
            let mut history = RestartHistory::default();
            let mut now = Timestamp::from_seconds(100.0);
            let mut restarts = Vec::new();
            for lived_s in lives {
                now = now.plus_seconds(lived_s);
                match history.died(&rule, now, lived_s, false) {
                    RestartDecision::GiveUp => break,
                    RestartDecision::RestartAfter(delay_s) => now = now.plus_seconds(delay_s),
                }
                history.restarted(now);
                restarts.push(now);
                let recent = restarts.iter().filter(|at| now.seconds_since(**at) < rule.period_s).count();
                prop_assert!(recent <= rule.intensity as usize, "{recent} restarts within {} s", rule.period_s);
            }
        }
    }

    #[test]
    fn the_default_gives_up_what_crashes_at_once_and_keeps_trying_what_fails_slowly() {
        let rule = RestartRule::default();
        let crash_loop = |lived_s: f64, hopeless: bool| {
            let mut history = RestartHistory::default();
            let mut now = Timestamp::from_seconds(1.0);
            (0..1000).position(|_| {
                now = now.plus_seconds(lived_s);
                let verdict = history.died(&rule, now, lived_s, hopeless);
                if let RestartDecision::RestartAfter(delay_s) = verdict {
                    now = now.plus_seconds(delay_s);
                    history.restarted(now);
                }
                verdict == RestartDecision::GiveUp
            })
        };
        assert_eq!(crash_loop(0.01, false), Some(8), "given up at the ninth death");
        assert_eq!(crash_loop(0.01, true), None, "a missing device is waited for");
    }

    #[test]
    fn each_early_death_in_a_row_is_followed_by_a_longer_delay() {
        let rule = RestartRule::default();
        let mut history = RestartHistory::default();
        let now = Timestamp::from_seconds(50.0);
        let delays = [0.0, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64];
        for delay_s in delays {
            assert_eq!(
                history.died(&rule, now, 0.1, false),
                RestartDecision::RestartAfter(delay_s)
            );
        }
    }

    #[test]
    fn a_process_that_worked_for_a_second_starts_again_at_once() {
        let rule = RestartRule::default();
        let mut history = RestartHistory::default();
        let now = Timestamp::from_seconds(50.0);
        for _ in 0..3 {
            history.died(&rule, now, 0.1, false);
        }
        assert_eq!(
            history.died(&rule, now, 1.0, false),
            RestartDecision::RestartAfter(0.0)
        );
    }
}
