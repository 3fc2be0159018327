//! The second instance of a process: a hot shadow that waits for the death of the first, or the candidate of a swap,
//! or the one that was replaced and still stands by.
//!
//! A swap is make-before-break, and silence never decides it:
//!
//! | phase | ends well when | ends badly when |
//! |---|---|---|
//! | starting | the candidate sends a heartbeat from its loop | it ends, or its start grace is over |
//! | probation | it has run the cycles requested, within budget, with outputs a consumer can use, neither mute beside the owner nor in a flood | it ends, falls silent, or fails the [`Trial`] |
//! | switching | the moment written into the control record has passed | it ends: the owner keeps what it has |
//! | watching | it has run as owner for [`WATCH_S`] | it ends or hangs, or a process that worked lacks what it needs for [`LACK_S`]: the former owner takes back |
//!
//! A process whose row says `shadow = false` has no second instance: a swap ends it and starts the new program, and the former program
//! is started again if that one ends or hangs within [`WATCH_S`].
//!
//! Which service a candidate is, and whether it knows the same topics, it is asked when it is started (`--program`, `--topics` of
//! [`jink_runtime::Setup`]): another one ends before it has opened anything.

use crate::process::Exit;
use jink_runtime::heartbeat::HEARTBEAT_PERIOD_S;
use jink_runtime::service::EXIT_CANNOT_START;
use jink_shared_types::Timestamp;
use jink_shared_types::events::SwapReason;
use jink_shared_types::health::{Heartbeat, Name, ServiceState, SwapPhase};
use std::fmt;

/// Cycles of a probation by default: five seconds at 10 Hz, so that rare cycles occur, too.
pub const PROBATION_CYCLES: u64 = 50;
/// Shortest probation (s): two heartbeats would show too little about outputs.
const PROBATION_MIN_S: f64 = 1.0;
/// Longest probation (s): a candidate that has not run its cycles by then has nothing to do, or is stuck.
const PROBATION_MAX_S: f64 = 60.0;
/// After this time (s) a candidate that would not run its cycles by then at the rate so far has shown it.
const PROBATION_LOOK_S: f64 = 10.0;
/// Share of the probation's cycles that may be over budget, besides as many as the owner's in the same time: what a busy machine causes
/// for any process.
const MISSES_SHARE: f64 = 0.05;
/// A candidate with more than this many times the owner's outputs, and than this many per cycle, floods. An owner that has nothing to say
/// does not keep another from saying something.
const FLOOD_TIMES: u64 = 2;
/// A candidate with less than its inverse of the owner's outputs is mute. Both answer the same inputs, and the second answer has no place
/// where the first one has been acted upon: beside load good candidates had less than half of the owner's (5 of 13 trajectories).
const MUTE_TIMES: u64 = 10;
/// Below this many outputs of the owner no candidate is mute.
const OUTPUTS_MIN: u64 = 10;
/// From the decision to the switch at least (s): the record wakes both instances when it is written; two heartbeat
/// periods leave room for one that is busy.
pub const SWITCH_LEAD_S: f64 = 2.0 * HEARTBEAT_PERIOD_S;
/// From the switch until it counts as done (s): a cycle that began before it has ended by then.
pub const SETTLE_S: f64 = 0.1;
/// How long the former owner stands by (s).
pub const WATCH_S: f64 = 2.0;
/// So long a process that worked at the switch may lack what it needs (s): several deadlines of any topic that is needed.
pub const LACK_S: f64 = 0.5;
/// A shadow that is silent for this many times its heartbeat time-out hangs. More time than for an owner: nothing
/// depends on it yet.
const SILENT_TIMES: f64 = 5.0;

/// Rates at which services publish coincide this often (Hz): 10, 20, 30, 40, 50 Hz at the ticks of 10 Hz.
const MEETING_RATE_HZ: u32 = 10;
/// So long before the rates meet nothing is put out by a timer (s), and what came of the last meeting is done.
const QUIET_BEFORE_S: f64 = 0.01;

/// The first moment from `soonest` on at which a switch falls between the ticks of all services, so that no output is
/// due at the very moment that ownership changes.
pub(crate) fn quiet_moment(soonest: Timestamp) -> Timestamp {
    soonest
        .plus_seconds(QUIET_BEFORE_S)
        .next_beat(MEETING_RATE_HZ)
        .plus_seconds(-QUIET_BEFORE_S)
}

/// What a second instance is for.
// One per process, never in a list: the largest variant may be large.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum ShadowRole {
    /// Takes over when the owner dies.
    Hot,
    /// Of a swap.
    Candidate(Swap),
    /// Was replaced by a swap and takes back if the new one fails.
    Former {
        /// When it may go.
        until: Timestamp,
        /// What came of the switch so far.
        outcome: Outcome,
    },
}

/// What the others say since a candidate owns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Outcome {
    /// Processes that worked at the switch, one bit each.
    pub(crate) worked: u32,
    /// Since when one of these works no more.
    lacking_since: Option<Timestamp>,
    /// Why the former owner is to take back.
    pub(crate) failed: Option<SwapRefusal>,
}

impl Outcome {
    /// At the switch, where the processes of the bits of `worked` work.
    pub(crate) fn new(worked: u32) -> Self {
        Self {
            worked,
            lacking_since: None,
            failed: None,
        }
    }

    /// Takes the first process that worked and does not at `now`. Whether the candidate has failed by it.
    pub(crate) fn judge(&mut self, now: Timestamp, lacking: Option<Name>) -> bool {
        let Some(name) = lacking else {
            self.lacking_since = None;
            return false;
        };
        let since = *self.lacking_since.get_or_insert(now);
        let failed = now.seconds_since(since) >= LACK_S;
        if failed {
            self.failed.get_or_insert(SwapRefusal::Lacking(name));
        }
        failed
    }

    /// Whether everybody who worked works.
    pub(crate) fn is_good(&self) -> bool {
        self.lacking_since.is_none()
    }
}

/// A swap under way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Swap {
    pub(crate) phase: SwapPhase,
    pub(crate) cycles: u64,
    pub(crate) dry_run: bool,
    /// When the phase began.
    pub(crate) since: Timestamp,
    /// Of a candidate in probation: heartbeats at its beginning, the candidate's and the owner's.
    pub(crate) begin: Option<(Heartbeat, Heartbeat)>,
    /// The switch is at this moment.
    pub(crate) from: Timestamp,
}

/// A second instance.
#[derive(Clone, Debug)]
pub(crate) struct Shadow {
    pub(crate) role: ShadowRole,
    pub(crate) generation: u32,
    pub(crate) epoch: u32,
    pub(crate) pid: u32,
    pub(crate) started: Timestamp,
    pub(crate) heartbeat: Heartbeat,
    pub(crate) heartbeat_time: Timestamp,
    /// It is to end.
    pub(crate) ending: bool,
}

impl Shadow {
    pub(crate) fn new(role: ShadowRole, generation: u32, now: Timestamp) -> Self {
        Self {
            role,
            generation,
            epoch: generation,
            pid: 0,
            started: now,
            heartbeat: Heartbeat::default(),
            heartbeat_time: Timestamp::NEVER,
            ending: false,
        }
    }

    /// Takes a heartbeat if it is this instance's.
    pub(crate) fn on_heartbeat(&mut self, heartbeat: &Heartbeat, time: Timestamp) -> bool {
        let mine = heartbeat.generation == self.generation;
        if mine {
            self.heartbeat = *heartbeat;
            self.heartbeat_time = time;
        }
        mine
    }

    /// It has sent a heartbeat from within its loop.
    pub(crate) fn in_loop(&self) -> bool {
        matches!(
            self.heartbeat.state.get(),
            ServiceState::Standby | ServiceState::Active | ServiceState::Degraded
        )
    }

    /// It can take over now.
    pub(crate) fn is_ready(&self) -> bool {
        self.in_loop() && !self.ending
    }

    /// It has been silent for so long that it hangs.
    pub(crate) fn is_silent(&self, now: Timestamp, timeout_s: f64) -> bool {
        self.in_loop() && now.seconds_since(self.heartbeat_time) > SILENT_TIMES * timeout_s
    }

    pub(crate) fn phase(&self) -> SwapPhase {
        match self.role {
            ShadowRole::Hot => SwapPhase::Idle,
            ShadowRole::Candidate(swap) => swap.phase,
            ShadowRole::Former { .. } => SwapPhase::Watching,
        }
    }
}

/// What became of a swap, as far as it got.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SwapProgress {
    /// The candidate is in its loop; the probation begins.
    Probation {
        /// Cycles requested.
        cycles: u64,
    },
    /// The probation was passed; ownership changes in so many seconds.
    Switching {
        /// What was seen.
        trial: Trial,
    },
    /// The candidate owns.
    Switched,
    /// The row has `shadow = false`: the old one is ended, and the new one is started behind it.
    Replaced,
    /// The swap is over and good.
    Done,
    /// The probation was passed and nothing was changed.
    DryRunPassed {
        /// What was seen.
        trial: Trial,
    },
    /// The owner was never touched.
    Refused(SwapRefusal),
    /// The candidate failed as owner; the former one owns again.
    RolledBack(SwapRefusal),
}

impl SwapProgress {
    /// Whether nothing comes after it.
    pub fn is_last(&self) -> bool {
        matches!(
            self,
            Self::Done | Self::DryRunPassed { .. } | Self::Refused(_) | Self::RolledBack(_)
        )
    }

    /// Whether the swap is going well.
    pub fn is_good(&self) -> bool {
        !matches!(self, Self::Refused(_) | Self::RolledBack(_))
    }
}

impl fmt::Display for SwapProgress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Probation { cycles } => write!(
                f,
                "the candidate runs beside the owner: probation of {cycles} cycles"
            ),
            Self::Switching { trial } => write!(f, "probation passed ({trial}); switching"),
            Self::Switched => write!(
                f,
                "the candidate owns; the former owner stands by for {WATCH_S} s"
            ),
            Self::Replaced => f.write_str(
                "its row says `shadow = false`: the old one ends, the new program is started, and the old one again if that fails",
            ),
            Self::Done => f.write_str("swapped"),
            Self::DryRunPassed { trial } => write!(f, "probation passed ({trial}); nothing was changed"),
            Self::Refused(refusal) => write!(f, "refused, the owner was never touched: {refusal}"),
            Self::RolledBack(refusal) => write!(f, "rolled back, the former owner owns again: {refusal}"),
        }
    }
}

/// Why a swap failed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SwapRefusal {
    /// Another swap of this process is under way.
    Busy,
    /// The process does not run.
    NotRunning,
    /// A trial was requested, and the process cannot have a second instance.
    NoShadow,
    /// The candidate ended.
    Ended(Exit),
    /// The candidate did not reach its loop in time.
    NeverUp,
    /// The candidate fell silent.
    Silent,
    /// Too many cycles over budget.
    OverBudget(Trial),
    /// Outputs that no consumer could use.
    Implausible(Trial),
    /// Too few or too many outputs.
    Outputs(Trial),
    /// The candidate had nothing to do, or too little.
    TooFewCycles(Trial),
    /// A process that worked before the candidate owned lacks what it needs.
    Lacking(Name),
    /// The owner died meanwhile and is being restarted.
    OwnerDied,
    /// The system stops.
    Stopping,
}

impl fmt::Display for SwapRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Busy => f.write_str("another swap of this process is under way"),
            Self::NotRunning => f.write_str("the process does not run; `jink restart` starts it"),
            Self::NoShadow => {
                f.write_str("its row says `shadow = false`: there is no trial beside the owner")
            }
            Self::Ended(exit) => write!(f, "the candidate ended with {exit}"),
            Self::NeverUp => f.write_str("the candidate did not reach its loop within its start grace"),
            Self::Silent => f.write_str("the candidate fell silent"),
            Self::OverBudget(trial) => write!(f, "the candidate is too slow: {trial}"),
            Self::Implausible(trial) => write!(f, "the candidate's outputs cannot be used: {trial}"),
            Self::Outputs(trial) => write!(
                f,
                "the candidate's outputs differ in number from the owner's: {trial}"
            ),
            Self::TooFewCycles(trial) => write!(f, "the candidate had too little to do: {trial}"),
            Self::Lacking(name) => write!(
                f,
                "since the candidate owned, {} has not had what it needs",
                name.as_str()
            ),
            Self::OwnerDied => f.write_str("the owner died meanwhile and is restarted"),
            Self::Stopping => f.write_str("the system stops"),
        }
    }
}

impl SwapRefusal {
    /// The same for the pilot.
    pub(crate) fn reason(&self) -> SwapReason {
        match self {
            Self::Ended(Exit::Code(0)) => SwapReason::WrongProgram,
            Self::Ended(Exit::Code(EXIT_CANNOT_START) | Exit::NotSpawned) => SwapReason::CannotStart,
            Self::Ended(_) => SwapReason::Died,
            Self::NeverUp | Self::Silent => SwapReason::Silent,
            Self::OverBudget(_) => SwapReason::TooSlow,
            Self::Implausible(_) => SwapReason::Implausible,
            Self::Outputs(_) => SwapReason::Outputs,
            Self::TooFewCycles(_) => SwapReason::Idle,
            Self::OwnerDied => SwapReason::OwnerDied,
            Self::Stopping => SwapReason::Stopping,
            // There is no candidate, or it has owned.
            Self::Busy | Self::NotRunning | Self::NoShadow | Self::Lacking(_) => SwapReason::Unknown,
        }
    }
}

/// What a probation has shown so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Trial {
    /// Cycles the candidate has run.
    pub cycles: u64,
    /// Of those, over budget.
    pub misses: u64,
    /// Its longest cycle (us).
    pub worst_us: u32,
    /// Its outputs.
    pub outputs: u64,
    /// Of those, unusable.
    pub implausible: u64,
    /// The owner's outputs in the same time.
    pub owner_outputs: u64,
    /// The owner's cycles over budget in the same time.
    pub owner_misses: u64,
}

impl fmt::Display for Trial {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} cycles, {} over budget beside {} of the owner, longest {:.1} ms; {} outputs ({} unusable) beside {} of the owner",
            self.cycles,
            self.misses,
            self.owner_misses,
            f64::from(self.worst_us) * 1e-3,
            self.outputs,
            self.implausible,
            self.owner_outputs
        )
    }
}

/// The result of a probation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum TrialVerdict {
    Goes,
    Passed(Trial),
    Failed(SwapRefusal),
}

impl Trial {
    fn between(begin: &(Heartbeat, Heartbeat), candidate: &Heartbeat, owner: &Heartbeat) -> Self {
        let (candidate_then, owner_then) = begin;
        Self {
            cycles: candidate.cycles.saturating_sub(candidate_then.cycles),
            misses: candidate
                .budget_misses
                .saturating_sub(candidate_then.budget_misses),
            worst_us: candidate.cycle_max_us,
            outputs: candidate.outputs.saturating_sub(candidate_then.outputs),
            implausible: candidate
                .implausible_outputs
                .saturating_sub(candidate_then.implausible_outputs),
            owner_outputs: owner.outputs.saturating_sub(owner_then.outputs),
            owner_misses: owner.budget_misses.saturating_sub(owner_then.budget_misses),
        }
    }

    fn outputs_agree(&self) -> bool {
        let is_mute = self.owner_outputs >= OUTPUTS_MIN && MUTE_TIMES * self.outputs < self.owner_outputs;
        let floods = self.outputs > FLOOD_TIMES * self.owner_outputs.max(self.cycles);
        !is_mute && !floods
    }
}

impl Swap {
    /// Judges a probation at `now`.
    pub(crate) fn judge(&self, now: Timestamp, candidate: &Heartbeat, owner: &Heartbeat) -> TrialVerdict {
        let Some(begin) = &self.begin else {
            return TrialVerdict::Goes;
        };
        let trial = Trial::between(begin, candidate, owner);
        let elapsed_s = now.seconds_since(self.since);
        let misses_max =
            1 + (self.cycles.max(trial.cycles) as f64 * MISSES_SHARE) as u64 + trial.owner_misses;
        let cycles_by_the_end = trial.cycles as f64 * PROBATION_MAX_S / elapsed_s;
        if trial.implausible > 0 {
            TrialVerdict::Failed(SwapRefusal::Implausible(trial))
        } else if trial.misses > misses_max {
            TrialVerdict::Failed(SwapRefusal::OverBudget(trial))
        } else if trial.cycles >= self.cycles && elapsed_s >= PROBATION_MIN_S {
            if trial.outputs_agree() {
                TrialVerdict::Passed(trial)
            } else {
                TrialVerdict::Failed(SwapRefusal::Outputs(trial))
            }
        } else if elapsed_s > PROBATION_LOOK_S && cycles_by_the_end < self.cycles as f64 {
            TrialVerdict::Failed(SwapRefusal::TooFewCycles(trial))
        } else {
            TrialVerdict::Goes
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{PROBATION_CYCLES, Swap, SwapRefusal, TrialVerdict, quiet_moment};
    use jink_shared_types::Timestamp;
    use jink_shared_types::health::{Heartbeat, SwapPhase};

    #[test]
    fn a_switch_falls_between_the_beats_of_all_rates() {
        for ms in (0..400).step_by(7) {
            let soonest = Timestamp::from_ns(3_600_000_000_000 + ms * 1_000_000);
            let moment = quiet_moment(soonest);
            assert!(moment >= soonest && moment.seconds_since(soonest) < 0.101);
            for rate_hz in [1, 2, 5, 10, 15, 20, 30, 50] {
                let to_next_s = moment.next_beat(rate_hz).seconds_since(moment);
                let since_last_s = 1.0 / f64::from(rate_hz) - to_next_s;
                assert!(to_next_s > 0.0099 && since_last_s > 0.0099, "{rate_hz} Hz");
            }
        }
    }

    fn beat(cycles: u64, misses: u64, outputs: u64, implausible: u64) -> Heartbeat {
        Heartbeat {
            cycles,
            budget_misses: misses,
            outputs,
            implausible_outputs: implausible,
            ..Heartbeat::default()
        }
    }

    fn judge(after_s: f64, candidate: Heartbeat, owner_outputs: u64) -> TrialVerdict {
        judge_beside(after_s, candidate, owner_outputs, 0)
    }

    fn judge_beside(
        after_s: f64,
        candidate: Heartbeat,
        owner_outputs: u64,
        owner_misses: u64,
    ) -> TrialVerdict {
        let since = Timestamp::from_seconds(10.0);
        let swap = Swap {
            phase: SwapPhase::Probation,
            cycles: PROBATION_CYCLES,
            dry_run: false,
            since,
            begin: Some((beat(100, 7, 90, 0), beat(9_000, 0, 8_000, 0))),
            from: Timestamp::NEVER,
        };
        let owner = beat(9_100, owner_misses, 8_000 + owner_outputs, 0);
        swap.judge(since.plus_seconds(after_s), &candidate, &owner)
    }

    #[test]
    fn a_busy_machine_makes_owner_and_candidate_late_and_refuses_nobody() {
        let late = beat(150, 27, 140, 0);
        assert!(matches!(
            judge_beside(5.0, late, 50, 17),
            TrialVerdict::Passed(trial) if trial.misses == 20 && trial.owner_misses == 17
        ));
        assert!(matches!(
            judge_beside(5.0, late, 50, 16),
            TrialVerdict::Failed(SwapRefusal::OverBudget(_))
        ));
    }

    #[test]
    fn whoever_has_nothing_to_do_is_refused_soon_and_whoever_is_slow_has_a_minute() {
        assert_eq!(judge(9.9, beat(100, 7, 90, 0), 0), TrialVerdict::Goes);
        assert!(matches!(
            judge(10.1, beat(100, 7, 90, 0), 0),
            TrialVerdict::Failed(SwapRefusal::TooFewCycles(_))
        ));
        assert_eq!(
            judge(30.0, beat(126, 7, 116, 0), 26),
            TrialVerdict::Goes,
            "of a sensor at 1 Hz"
        );
        assert!(matches!(
            judge(58.0, beat(150, 7, 140, 0), 50),
            TrialVerdict::Passed(_)
        ));
    }

    #[test]
    fn a_good_candidate_passes_after_its_cycles_and_not_before() {
        assert_eq!(judge(5.0, beat(149, 7, 139, 0), 50), TrialVerdict::Goes);
        assert_eq!(judge(0.5, beat(160, 7, 150, 0), 60), TrialVerdict::Goes);
        assert!(
            matches!(judge(5.0, beat(150, 8, 140, 0), 50), TrialVerdict::Passed(trial) if trial.misses == 1)
        );
    }

    #[test]
    fn a_candidate_whose_answers_come_second_is_not_mute() {
        assert!(matches!(
            judge(5.0, beat(150, 7, 95, 0), 13),
            TrialVerdict::Passed(_)
        ));
    }

    #[test]
    fn a_candidate_speaks_where_the_owner_has_nothing_to_say() {
        for owner_outputs in [0, 9, 20, 100] {
            let verdict = judge(5.0, beat(150, 7, 140, 0), owner_outputs);
            assert!(
                matches!(verdict, TrialVerdict::Passed(_)),
                "{owner_outputs}: {verdict:?}"
            );
        }
    }

    #[test]
    fn a_slow_a_garbled_a_mute_a_flooding_and_an_idle_candidate_fail_for_their_own_reasons() {
        let slow = judge(2.0, beat(120, 11, 110, 0), 20);
        assert!(
            matches!(slow, TrialVerdict::Failed(SwapRefusal::OverBudget(_))),
            "{slow:?}"
        );
        let garbled = judge(0.2, beat(103, 7, 93, 1), 3);
        assert!(
            matches!(garbled, TrialVerdict::Failed(SwapRefusal::Implausible(_))),
            "{garbled:?}"
        );
        let mute = judge(5.0, beat(160, 7, 91, 0), 60);
        assert!(
            matches!(mute, TrialVerdict::Failed(SwapRefusal::Outputs(_))),
            "{mute:?}"
        );
        let flood = judge(5.0, beat(150, 7, 191, 0), 20);
        assert!(
            matches!(flood, TrialVerdict::Failed(SwapRefusal::Outputs(_))),
            "{flood:?}"
        );
        let idle = judge(20.0, beat(110, 7, 100, 0), 600);
        assert!(
            matches!(idle, TrialVerdict::Failed(SwapRefusal::TooFewCycles(_))),
            "{idle:?}"
        );
    }
}
