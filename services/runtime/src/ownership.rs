//! Whether what this instance computes is published, and what became of its outputs.
//!
//! A cycle belongs to the publication time of the newest trigger sample it took, or, if it took none, to the time at
//! which it began. The control record says who owns that time ([`jink_shared_types::control`]). An instance the record
//! says nothing about goes by how it was started: a shadow is silent, any other publishes, so that a restart does not
//! have to wait for the record.
//!
//! Where only one instance can have a thing at a time (a socket, a serial port), the service passes it on by itself when
//! the record says so, and declares which cycles are its own ([`crate::ExclusiveOwnership`]).

use jink_shared_types::control::ControlEntry;
use jink_shared_types::health::{Heartbeat, Role};
use jink_shared_types::{Coded, SampleHeader, Stage, Timestamp};
use std::cell::Cell;

/// One instance's duty, shared by its inputs, its outputs and its loop.
#[derive(Debug)]
pub(crate) struct Ownership {
    generation: u32,
    shadow: bool,
    budget_us: u32,
    entry: Cell<Option<ControlEntry>>,
    declared: Cell<Option<bool>>,
    stands_by: Cell<bool>,
    began: Cell<Timestamp>,
    /// When the cycle before this one began.
    began_before: Cell<Timestamp>,
    /// When the cycle before this one was over.
    rested: Cell<Timestamp>,
    newest_trigger: Cell<Timestamp>,
    outputs: Cell<u64>,
    late: Cell<u64>,
    implausible: Cell<u64>,
    latest: Cell<Late>,
}

/// The latest output over the end-to-end budget.
#[derive(Clone, Copy, Debug, Default)]
struct Late {
    us: u32,
    stage: u8,
    stage_us: u32,
}

impl Ownership {
    /// Of an instance started as `generation`, as a shadow or not, whose outputs may be `budget_us` old (0 = any age).
    pub(crate) fn new(generation: u32, shadow: bool, budget_us: u32) -> Self {
        Self {
            generation,
            shadow,
            budget_us,
            entry: Cell::new(None),
            declared: Cell::new(None),
            stands_by: Cell::new(false),
            began: Cell::new(Timestamp::NEVER),
            began_before: Cell::new(Timestamp::NEVER),
            rested: Cell::new(Timestamp::NEVER),
            newest_trigger: Cell::new(Timestamp::NEVER),
            outputs: Cell::new(0),
            late: Cell::new(0),
            implausible: Cell::new(0),
            latest: Cell::new(Late::default()),
        }
    }

    /// Takes what the control record says about this process.
    pub(crate) fn read(&self, entry: Option<&ControlEntry>) {
        if let Some(entry) = entry {
            self.entry.set(Some(*entry));
        }
    }

    /// A cycle begins at `now`.
    pub(crate) fn begin(&self, now: Timestamp) {
        self.began_before.set(self.began.replace(now));
        self.newest_trigger.set(Timestamp::NEVER);
    }

    /// A cycle is over at `now`.
    pub(crate) fn rest(&self, now: Timestamp) {
        self.rested.set(now);
    }

    /// How long (us) what was published at `time` had to wait for this cycle although the process knew of it or was busy: until the end
    /// of the cycle before; until now if that had it already and something is made of it once more.
    pub(crate) fn busy_us(&self, time: Timestamp) -> u32 {
        let (before, rested) = (self.began_before.get(), self.rested.get());
        if !(time.is_set() && rested.is_set()) {
            return 0;
        }
        microseconds(if before >= time { self.began.get() } else { rested }, time)
    }

    /// A trigger sample published at `time` was taken.
    pub(crate) fn took(&self, time: Timestamp) {
        self.newest_trigger.set(self.newest_trigger.get().max(time));
    }

    /// Whether the service says by itself which cycles it owns.
    pub(crate) fn declare(&self, owns: bool) {
        self.declared.set(Some(owns));
    }

    /// Whether the service lacks something that is no topic.
    pub(crate) fn stand_by(&self, stands_by: bool) {
        self.stands_by.set(stands_by);
    }

    /// What it said last.
    pub(crate) fn stands_by(&self) -> bool {
        self.stands_by.get()
    }

    /// When ownership changes, if a change is planned.
    pub(crate) fn changes_at(&self) -> Option<Timestamp> {
        let entry = self.entry.get().filter(|entry| entry.next != 0)?;
        Some(entry.from)
    }

    /// Whether this cycle's outputs are to be published.
    pub(crate) fn owns_cycle(&self) -> bool {
        if let Some(declared) = self.declared.get() {
            return declared;
        }
        let trigger = self.newest_trigger.get();
        self.owns(if trigger.is_set() {
            trigger
        } else {
            self.began.get()
        })
    }

    /// Whether this instance owns an input of `time`.
    pub(crate) fn owns(&self, time: Timestamp) -> bool {
        match self.entry.get() {
            Some(entry) if entry.next == self.generation || entry.active >= self.generation => {
                entry.owns(self.generation, time)
            }
            // The record is older than this start.
            _ => !self.shadow,
        }
    }

    /// The high half of this instance's sequence numbers.
    pub(crate) fn epoch(&self) -> u32 {
        let reported = self.entry.get().and_then(|entry| entry.epoch_of(self.generation));
        reported.unwrap_or(0).max(self.generation)
    }

    /// Counts an output that is complete at `end`.
    pub(crate) fn count(&self, header: &SampleHeader, end: Timestamp, plausible: bool) {
        self.outputs.set(self.outputs.get() + 1);
        if !plausible {
            self.implausible.set(self.implausible.get() + 1);
        }
        self.judge_age(header, end);
    }

    /// Judges the age of an output that was made from ranges against the end-to-end budget.
    pub(crate) fn judge_age(&self, header: &SampleHeader, end: Timestamp) {
        let of_ranges = header.capture.is_set() && header.stages.iter().any(|stage| stage.end.is_set());
        let us = microseconds(end, header.capture);
        if self.budget_us == 0 || !of_ranges || us <= self.budget_us {
            return;
        }
        let (mut before, mut longest) = (header.capture, (0, 0));
        for (index, stage) in header.stages.iter().enumerate() {
            let stage_end = match (stage.begin.is_set(), stage.end.is_set()) {
                (_, true) => stage.end,
                (true, false) => end,
                (false, false) => continue,
            };
            let took_us = microseconds(stage_end, before);
            if took_us > longest.1 {
                longest = (index as u8, took_us);
            }
            before = stage_end;
        }
        // What comes after the last stage on record belongs to whoever hands the output over.
        let rest_us = microseconds(end, before);
        if rest_us > longest.1 {
            longest = (Stage::Gateway as u8, rest_us);
        }
        self.late.set(self.late.get() + 1);
        self.latest.set(Late {
            us,
            stage: longest.0,
            stage_us: longest.1,
        });
    }

    /// What this instance is at `now`.
    pub(crate) fn role(&self, now: Timestamp) -> Role {
        if self.declared.get().unwrap_or_else(|| self.owns(now)) {
            Role::Owner
        } else {
            Role::Shadow
        }
    }

    /// Completes a heartbeat sent at `now`.
    pub(crate) fn fill(&self, now: Timestamp, heartbeat: &mut Heartbeat) {
        let late = self.latest.get();
        heartbeat.role = Coded::new(self.role(now));
        heartbeat.outputs = self.outputs.get();
        heartbeat.late_outputs = self.late.get();
        heartbeat.implausible_outputs = self.implausible.get();
        heartbeat.late_us = late.us;
        heartbeat.late_stage = late.stage;
        heartbeat.late_stage_us = late.stage_us;
    }
}

fn microseconds(end: Timestamp, begin: Timestamp) -> u32 {
    u32::try_from(end.ns_since(begin) / 1_000).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::Ownership;
    use jink_shared_types::control::ControlEntry;
    use jink_shared_types::health::{Heartbeat, Name, Role};
    use jink_shared_types::{SampleHeader, Stage, StageTime, Timestamp};
    use proptest::prelude::*;

    fn at(ms: u64) -> Timestamp {
        Timestamp::from_ns(1_000_000_000 + ms * 1_000_000)
    }

    fn entry(active: u32, next: u32, from_ms: u64) -> ControlEntry {
        ControlEntry {
            name: Name::new("planner"),
            active,
            next,
            from: at(from_ms),
            epoch: active,
            next_epoch: next,
        }
    }

    proptest! {
        /// However late either instance wakes up, and however the inputs bunch, each input is answered by at most one
        /// of them, and the last of every bunch by exactly one.
        #[test]
        fn at_a_switch_no_input_is_answered_twice_and_none_is_lost(
            inputs in proptest::collection::btree_set(0..200u64, 1..60),
            old_wakes in proptest::collection::btree_set(0..220u64, 1..60),
            from in 0..200u64,
        ) {
            // The new one wakes at each input, the old one when it likes.
            let record = entry(1, 2, from);
            let (old, new) = (Ownership::new(1, false, 0), Ownership::new(2, true, 0));
            old.read(Some(&record));
            new.read(Some(&record));
            let mut answered: Vec<u64> = Vec::new();
            for input in &inputs {
                new.begin(at(*input + 1));
                new.took(at(*input));
                if new.owns_cycle() {
                    answered.push(*input);
                }
            }
            let mut taken = 0;
            for wake in old_wakes {
                let bunch: Vec<u64> = inputs.iter().copied().filter(|i| (taken..=wake).contains(i)).collect();
                taken = wake + 1;
                old.begin(at(wake));
                bunch.iter().for_each(|input| old.took(at(*input)));
                if let (Some(last), true) = (bunch.last(), old.owns_cycle()) {
                    answered.push(*last);
                }
            }
            let unique: std::collections::BTreeSet<_> = answered.iter().collect();
            prop_assert_eq!(unique.len(), answered.len(), "answered twice: {:?}", answered);
            prop_assert!(inputs.iter().filter(|i| **i >= from).all(|i| answered.contains(i)));
        }
    }

    #[test]
    fn without_a_record_an_instance_goes_by_how_it_was_started() {
        let (speaks, is_silent) = (Ownership::new(3, false, 0), Ownership::new(3, true, 0));
        for ownership in [&speaks, &is_silent] {
            ownership.begin(at(5));
        }
        assert!(speaks.owns_cycle() && !is_silent.owns_cycle());
        // A record of earlier generations says nothing about a restart.
        speaks.read(Some(&entry(2, 0, 0)));
        assert!(speaks.owns_cycle());
        // One of later generations says that this instance has been replaced.
        speaks.read(Some(&entry(4, 0, 0)));
        assert!(!speaks.owns_cycle());
    }

    #[test]
    fn what_is_passed_on_by_hand_is_owned_as_declared() {
        let ownership = Ownership::new(1, false, 0);
        ownership.declare(true);
        ownership.read(Some(&entry(1, 2, 10)));
        ownership.begin(at(20));
        assert!(ownership.owns_cycle() && !ownership.owns(at(20)));
        assert_eq!(ownership.changes_at(), Some(at(10)));
        ownership.declare(false);
        assert!(!ownership.owns_cycle());
    }

    #[test]
    fn who_takes_back_a_failed_switch_speaks_in_a_newer_epoch() {
        let former = Ownership::new(1, false, 0);
        former.read(Some(&entry(2, 0, 0)));
        assert!(!former.owns(at(5)));
        former.read(Some(&ControlEntry {
            epoch: 3,
            ..entry(1, 0, 0)
        }));
        assert!(former.owns(at(6)));
        assert_eq!(former.epoch(), 3);
    }

    #[test]
    fn an_input_waits_for_the_cycle_before_or_is_made_use_of_once_more() {
        let ownership = Ownership::new(1, false, 0);
        ownership.begin(at(10));
        assert_eq!(ownership.busy_us(at(9)), 0, "there was no cycle before");
        ownership.rest(at(14));
        ownership.begin(at(15));
        assert_eq!(
            ownership.busy_us(at(12)),
            2_000,
            "published while the cycle before ran"
        );
        assert_eq!(ownership.busy_us(at(14)), 0, "published while it slept");
        assert_eq!(ownership.busy_us(at(9)), 6_000, "the cycle before had it");
        assert_eq!(ownership.busy_us(Timestamp::NEVER), 0);
    }

    #[test]
    fn a_late_output_names_the_stage_that_took_longest() {
        let ownership = Ownership::new(1, false, 20_000);
        let mut header = SampleHeader {
            capture: at(0),
            ..SampleHeader::default()
        };
        for (stage, begin, end) in [
            (Stage::Sensor, 0, 2),
            (Stage::Fusion, 2, 27),
            (Stage::Planner, 27, 30),
        ] {
            header.stages[stage as usize] = StageTime {
                begin: at(begin),
                end: at(end),
            };
        }
        ownership.count(&header, at(31), true);
        ownership.count(&SampleHeader::at(at(0)), at(90), false);
        let mut beat = Heartbeat::default();
        ownership.fill(at(40), &mut beat);
        assert_eq!(
            (beat.outputs, beat.late_outputs, beat.implausible_outputs),
            (2, 1, 1)
        );
        assert_eq!(
            (beat.late_us, beat.late_stage, beat.late_stage_us),
            (31_000, Stage::Fusion as u8, 25_000)
        );
        assert_eq!(beat.role, Role::Owner);
    }
}
