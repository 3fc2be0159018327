//! A process that is alive, in time with its heartbeats, and too slow: cycles over budget, graded.
//!
//! One slow cycle is counted and nothing else. What matters is how many there were in the last second; the numbers are
//! in the process table. A process that is slow because it is given no CPU is distinguished from one that needs too
//! much: the first is not replaced, its replacement would wait for the same CPU and would have to start besides.

use jink_shared_types::Timestamp;
use jink_shared_types::health::Heartbeat;
use std::collections::VecDeque;

/// Misses are counted over this time (s).
pub const WINDOW_S: f64 = 1.0;
/// A process that has used less than this share of the window's time as CPU is short of CPU, not slow by itself.
const BUSY_SHARE: f64 = 0.3;
/// Heartbeats kept: those of a window at 20 Hz, and some.
const HEARTBEATS: usize = 32;

/// What so many misses within [`WINDOW_S`] lead to; 0 = never.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlowRule {
    /// It is reported to the pilot.
    pub event: u32,
    /// The process counts as degraded, and the heartbeat to the autopilot reports it.
    pub degrade: u32,
    /// The process is replaced.
    pub replace: u32,
}

impl Default for SlowRule {
    /// A cycle in 30 Hz or 10 Hz that is late now and then is not reported to the pilot; half of all cycles of a
    /// 10 Hz service are; all of them mean that it does not work.
    fn default() -> Self {
        Self {
            event: 3,
            degrade: 5,
            replace: 9,
        }
    }
}

/// How slow a process is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum SlownessLevel {
    /// Not.
    #[default]
    Fine,
    /// To be reported to the pilot.
    Event,
    /// It counts as degraded.
    Degraded,
    /// It is to be replaced.
    Replace,
}

/// The last second of one process.
#[derive(Clone, Debug, Default)]
pub struct Slowness {
    beats: VecDeque<(Timestamp, u64, u32)>,
    grade: SlownessLevel,
}

impl Slowness {
    /// Takes a heartbeat.
    pub fn on_heartbeat(&mut self, heartbeat: &Heartbeat, time: Timestamp) {
        if self.beats.len() == HEARTBEATS {
            self.beats.pop_front();
        }
        while self
            .beats
            .get(1)
            .is_some_and(|(then, _, _)| time.seconds_since(*then) >= WINDOW_S)
        {
            self.beats.pop_front();
        }
        self.beats
            .push_back((time, heartbeat.budget_misses, heartbeat.cpu_ms));
    }

    /// Misses in the window.
    pub fn misses(&self) -> u32 {
        match (self.beats.front(), self.beats.back()) {
            (Some((_, then, _)), Some((_, now, _))) => {
                u32::try_from(now.saturating_sub(*then)).unwrap_or(u32::MAX)
            }
            _ => 0,
        }
    }

    fn is_busy(&self) -> bool {
        match (self.beats.front(), self.beats.back()) {
            (Some((then, _, cpu_then)), Some((now, _, cpu_now))) => {
                let busy_s = f64::from(cpu_now.saturating_sub(*cpu_then)) * 1e-3;
                busy_s >= BUSY_SHARE * now.seconds_since(*then)
            }
            _ => false,
        }
    }

    /// Judges by `rule`; the answer is a grade that is new and higher than before.
    pub fn judge(&mut self, rule: &SlowRule) -> Option<SlownessLevel> {
        let misses = self.misses();
        let reaches = |limit: u32| limit > 0 && misses >= limit;
        let grade = if reaches(rule.replace) && self.is_busy() {
            SlownessLevel::Replace
        } else if reaches(rule.degrade) {
            SlownessLevel::Degraded
        } else if reaches(rule.event) {
            SlownessLevel::Event
        } else {
            SlownessLevel::Fine
        };
        let rises = grade > self.grade;
        self.grade = grade;
        rises.then_some(grade)
    }

    /// Whether it counts as degraded.
    pub fn is_degraded(&self) -> bool {
        self.grade >= SlownessLevel::Degraded
    }
}

#[cfg(test)]
mod tests {
    use super::{SlowRule, Slowness, SlownessLevel};
    use jink_shared_types::Timestamp;
    use jink_shared_types::health::Heartbeat;

    /// Heartbeats every 50 ms, in each of which `misses` more cycles were late and `cpu_ms` more were used.
    fn live(slowness: &mut Slowness, from: u32, beats: u32, misses: f64, cpu_ms: u32) -> Vec<SlownessLevel> {
        let rule = SlowRule::default();
        (from..from + beats)
            .filter_map(|beat| {
                let heartbeat = Heartbeat {
                    budget_misses: (f64::from(beat) * misses) as u64,
                    cpu_ms: beat * cpu_ms,
                    ..Heartbeat::default()
                };
                slowness.on_heartbeat(&heartbeat, Timestamp::from_seconds(10.0 + f64::from(beat) * 0.05));
                slowness.judge(&rule)
            })
            .collect()
    }

    #[test]
    fn a_busy_process_that_misses_all_its_cycles_is_reported_degraded_and_replaced_in_this_order() {
        let mut slowness = Slowness::default();
        let grades = live(&mut slowness, 0, 40, 0.5, 45);
        assert_eq!(
            grades,
            [
                SlownessLevel::Event,
                SlownessLevel::Degraded,
                SlownessLevel::Replace
            ]
        );
        assert!(slowness.is_degraded());
    }

    #[test]
    fn a_process_without_cpu_is_never_replaced_for_being_slow() {
        let mut slowness = Slowness::default();
        assert_eq!(
            live(&mut slowness, 0, 40, 0.5, 5),
            [SlownessLevel::Event, SlownessLevel::Degraded]
        );
    }

    #[test]
    fn a_miss_now_and_then_is_not_reported_and_recovery_is_noticed() {
        let mut slowness = Slowness::default();
        assert_eq!(live(&mut slowness, 0, 400, 0.05, 45), []);
        assert_eq!(live(&mut slowness, 400, 40, 0.5, 45), [SlownessLevel::Replace]);
        live(&mut slowness, 440, 40, 0.0, 45);
        assert!(!slowness.is_degraded());
    }
}
