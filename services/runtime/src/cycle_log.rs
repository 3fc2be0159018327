//! What the cycles of one service took of its inputs: written down for the recorder, or followed in a replay
//! ([`jink_shared_types::cycles`]).

use crate::output::Output;
use jink_shared_types::coded::Flag;
use jink_shared_types::cycles::{CycleEntries, CycleEntry, topic_id};
use jink_shared_types::{SampleHeader, Timestamp};
use std::cell::{Cell, RefCell};
use std::fmt;
use std::rc::Rc;

/// One service's side of it, shared by its loop and its inputs.
pub(crate) struct CycleLog {
    /// Cycles that have begun, and those that have ended: even between two cycles.
    turns: Cell<u64>,
    mode: Mode,
}

enum Mode {
    Recording {
        /// `None` until the service has settled.
        output: RefCell<Option<Output<CycleEntries>>>,
        /// Full samples and the one that is being filled.
        waiting: RefCell<Vec<CycleEntries>>,
        /// Taken between two cycles: part of the next one.
        between: RefCell<Vec<CycleEntry>>,
        shadow: Flag,
    },
    /// What the next cycle is to take.
    Replaying { due: RefCell<Vec<CycleEntry>> },
}

impl fmt::Debug for CycleLog {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "CycleLog({} turns)", self.turns.get())
    }
}

impl CycleLog {
    /// Of an instance that was started as a shadow, or not.
    pub(crate) fn recording(shadow: bool) -> Self {
        let shadow = if shadow { Flag::YES } else { Flag::NO };
        Self {
            turns: Cell::new(0),
            mode: Mode::Recording {
                output: RefCell::default(),
                waiting: RefCell::default(),
                between: RefCell::default(),
                shadow,
            },
        }
    }

    /// Of an instance that does once more what another one did.
    pub(crate) fn replaying() -> Self {
        Self {
            turns: Cell::new(0),
            mode: Mode::Replaying {
                due: RefCell::default(),
            },
        }
    }

    /// Sets what the next cycle is to take.
    pub(crate) fn follow(&self, entries: Vec<CycleEntry>) {
        if let Mode::Replaying { due } = &self.mode {
            due.replace(entries);
        }
    }

    fn is_in_cycle(&self) -> bool {
        self.turns.get() % 2 == 1
    }

    /// A cycle begins at `now`.
    pub(crate) fn begin(&self, now: Timestamp) {
        self.turns.set(self.turns.get() + 1);
        if let Mode::Recording { between, .. } = &self.mode {
            self.push(CycleEntry {
                time: now,
                topic: 0,
                number: (self.turns.get() / 2 + 1) as u32,
            });
            between.borrow_mut().drain(..).for_each(|taken| self.push(taken));
        }
    }

    /// The cycle is over.
    pub(crate) fn end(&self) {
        self.turns.set(self.turns.get() + 1);
    }

    fn push(&self, entry: CycleEntry) {
        let Mode::Recording { waiting, shadow, .. } = &self.mode else {
            return;
        };
        let mut waiting = waiting.borrow_mut();
        if !waiting.last_mut().is_some_and(|sample| sample.push(entry)) {
            let mut sample = CycleEntries {
                shadow: *shadow,
                ..CycleEntries::default()
            };
            sample.push(entry);
            waiting.push(sample);
        }
    }

    /// Publishes on `output` from now on.
    pub(crate) fn connect(&self, to: Output<CycleEntries>) {
        if let Mode::Recording { output, .. } = &self.mode {
            output.replace(Some(to));
        }
    }

    /// Publishes what there is.
    pub(crate) fn publish(&self, now: Timestamp) {
        let Mode::Recording { output, waiting, .. } = &self.mode else {
            return;
        };
        if let Some(output) = &mut *output.borrow_mut() {
            for sample in waiting.borrow_mut().drain(..) {
                output.send(SampleHeader::at(now), &sample);
            }
        }
    }
}

/// One input's looks at its topic.
#[derive(Debug)]
pub(crate) struct Looks {
    log: Rc<CycleLog>,
    topic: u32,
    /// The turn that `look` is of.
    turn: u64,
    /// How often the topic was looked at before in this turn.
    look: u32,
}

impl Looks {
    /// At the topic called `name`.
    pub(crate) fn at(name: &str, log: &Rc<CycleLog>) -> Self {
        Self {
            log: Rc::clone(log),
            topic: topic_id(name),
            turn: u64::MAX,
            look: 0,
        }
    }

    /// A look begins.
    pub(crate) fn begin(&mut self) {
        let turn = self.log.turns.get();
        self.look = match self.turn == turn && self.log.is_in_cycle() {
            true => self.look + 1,
            false => 0,
        };
        self.turn = turn;
    }

    /// Whether the next sample is for this look.
    pub(crate) fn may_take(&self) -> bool {
        let Mode::Replaying { due } = &self.log.mode else {
            return true;
        };
        let mut due = due.borrow_mut();
        let next = due.iter().position(|entry| entry.topic == self.topic);
        match next.filter(|next| due[*next].number <= self.look) {
            Some(next) => {
                due.remove(next);
                true
            }
            None => false,
        }
    }

    /// A sample published at `publish` was taken.
    pub(crate) fn took(&self, publish: Timestamp) {
        let entry = CycleEntry {
            time: publish,
            topic: self.topic,
            number: self.look,
        };
        match &self.log.mode {
            Mode::Recording { between, .. } if !self.log.is_in_cycle() => between.borrow_mut().push(entry),
            Mode::Recording { .. } => self.log.push(entry),
            Mode::Replaying { .. } => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{CycleLog, Looks};
    use crate::lockstep::LocalBus;
    use crate::session::Session;
    use jink_shared_types::Timestamp;
    use jink_shared_types::cycles::CycleEntry;
    use jink_shared_types::topics;
    use proptest::prelude::*;
    use std::rc::Rc;

    const TOPICS: [&str; 3] = ["map/local", "vehicle/state", "system/control"];

    /// A look at one of [`TOPICS`] that takes so many samples.
    type Look = (usize, usize);

    /// Everything that a service with these cycles writes down; `between` is looked at before each cycle.
    fn recorded(cycles: &[(Vec<Look>, Vec<Look>)]) -> Vec<CycleEntry> {
        let bus = LocalBus::new(Timestamp::from_ns(1));
        let session = Session::local(&bus, "planner");
        let log = Rc::new(CycleLog::recording(false));
        let mut looks = TOPICS.map(|topic| Looks::at(topic, &log));
        let mut published = 0;
        let mut look = |&(topic, taken): &Look| {
            looks[topic].begin();
            for _ in 0..taken {
                published += 1;
                looks[topic].took(Timestamp::from_ns(published));
            }
        };
        for (number, (between, within)) in (1..).zip(cycles) {
            between.iter().for_each(&mut look);
            log.begin(Timestamp::from_ns(1_000 * number));
            within.iter().for_each(&mut look);
            log.end();
        }
        let cli = Session::local(&bus, "cli");
        let mut input = cli.input(topics::CYCLES, "planner").unwrap().of_all_producers();
        log.connect(session.output(topics::CYCLES, "planner", 1).unwrap());
        let mut entries = Vec::new();
        log.publish(Timestamp::from_ns(2));
        input.each(|sample| entries.extend_from_slice(sample.sample.entries()));
        entries
    }

    fn looks() -> impl Strategy<Value = Vec<Look>> {
        proptest::collection::vec((0..TOPICS.len(), 0..4usize), 0..5)
    }

    proptest! {
        /// Each look of a replay takes what it took, and what was taken between two cycles the first look of the next one takes.
        #[test]
        fn what_was_taken_is_taken_again_look_by_look(cycles in proptest::collection::vec((looks(), looks()), 1..6)) {
            let entries = recorded(&cycles);
            let begins = entries.iter().filter(|entry| entry.topic == 0).count();
            prop_assert_eq!(begins, cycles.len());
            let mut of_cycles = entries.split(|entry| entry.topic == 0);
            prop_assert!(of_cycles.next().unwrap().is_empty(), "taken before the first cycle began");
            let log = Rc::new(CycleLog::replaying());
            let mut looks = TOPICS.map(|topic| Looks::at(topic, &log));
            for ((between, within), taken) in cycles.iter().zip(of_cycles) {
                log.follow(taken.to_vec());
                log.begin(Timestamp::from_ns(1));
                let mut before = [0; TOPICS.len()];
                between.iter().for_each(|(topic, taken)| before[*topic] += taken);
                for (topic, taken) in within {
                    looks[*topic].begin();
                    let again = std::iter::from_fn(|| looks[*topic].may_take().then_some(())).count();
                    prop_assert_eq!(again, taken + std::mem::take(&mut before[*topic]));
                }
                log.end();
            }
        }
    }
}
