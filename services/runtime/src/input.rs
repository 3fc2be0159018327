//! A topic as a reader sees it: the newest sample with its age, or every unread one in order.

use crate::duty::Duty;
use crate::transport::{Sample, Subscriber};
use jink_shared_types::layout::Layout;
use jink_shared_types::{Reading, Stamped, Timestamp};
use std::cell::Cell;
use std::fmt;
use std::rc::Rc;

/// What the loop wants to know of an input without borrowing it.
#[derive(Debug)]
pub(crate) struct InputHealth {
    pub(crate) newest: Cell<Timestamp>,
    pub(crate) deadline_ms: f64,
    pub(crate) needed: Cell<bool>,
}

impl InputHealth {
    pub(crate) fn is_fresh(&self, now: Timestamp) -> bool {
        let newest = self.newest.get();
        newest.is_set() && now.seconds_since(newest) * 1e3 <= self.deadline_ms
    }
}

/// A topic opened for reading.
pub struct Input<T: Layout> {
    subscriber: Subscriber<T>,
    newest: Option<Sample<T>>,
    last_sequence: u64,
    name: String,
    lost: u64,
    health: Rc<InputHealth>,
    /// Of a trigger: learns what was taken.
    duty: Option<Rc<Duty>>,
    /// Samples of all producers are handed out, whichever is the newest.
    of_all: bool,
}

impl<T: Layout> fmt::Debug for Input<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Input({})", self.name)
    }
}

impl<T: Layout> Input<T> {
    pub(crate) fn new(subscriber: Subscriber<T>, name: String, deadline_ms: f64) -> Self {
        Self {
            subscriber,
            newest: None,
            last_sequence: 0,
            name,
            lost: 0,
            health: Rc::new(InputHealth {
                newest: Cell::new(Timestamp::NEVER),
                deadline_ms,
                needed: Cell::new(false),
            }),
            duty: None,
            of_all: false,
        }
    }

    /// Tells `duty` of every sample taken.
    pub(crate) fn with_duty(mut self, duty: &Rc<Duty>) -> Self {
        self.duty = Some(Rc::clone(duty));
        self
    }

    /// Hands out the samples of every producer, not only those of the newest one: for topics on which an instance and
    /// its shadow both speak.
    pub fn of_all_producers(mut self) -> Self {
        self.of_all = true;
        self
    }

    /// Marks the input as one the service cannot work without: while it is stale, the service is degraded.
    pub fn needed(self) -> Self {
        self.health.needed.set(true);
        self
    }

    /// The topic's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Samples that were overwritten before they could be read; not counted where several producers speak at once.
    pub fn lost(&self) -> u64 {
        self.lost
    }

    pub(crate) fn health(&self) -> Rc<InputHealth> {
        Rc::clone(&self.health)
    }

    /// Takes all waiting samples and returns the newest one ever received, judged against the topic's deadline.
    pub fn latest(&mut self, now: Timestamp) -> Reading<'_, T> {
        while self.receive().is_some() {}
        Reading::judge(self.newest(), now, self.health.deadline_ms)
    }

    /// Hands every unread sample to `visit`, oldest first.
    pub fn each(&mut self, mut visit: impl FnMut(Stamped<'_, T>)) {
        while self.receive().is_some() {
            if let Some(stamped) = self.newest() {
                visit(stamped);
            }
        }
    }

    /// The newest sample received so far, however old: for what must outlive its producer.
    pub fn newest(&self) -> Option<Stamped<'_, T>> {
        self.newest.as_ref().map(|sample| Stamped {
            sample: sample.payload(),
            header: sample.header(),
        })
    }

    /// Moves to the next unread sample. Samples of a producer that has been replaced may arrive after those of its
    /// successor: whatever does not advance the sequence is dropped.
    fn receive(&mut self) -> Option<()> {
        loop {
            let sample = self.subscriber.receive()?;
            let sequence = sample.header().sequence;
            if sequence <= self.last_sequence && self.newest.is_some() && !self.of_all {
                continue;
            }
            let same_producer = sequence >> 32 == self.last_sequence >> 32;
            if same_producer && self.newest.is_some() && !self.of_all {
                self.lost += (sequence - self.last_sequence).saturating_sub(1);
            }
            self.last_sequence = sequence;
            if let Some(duty) = &self.duty {
                duty.took(sample.header().publish);
            }
            self.health.newest.set(sample.header().publish);
            self.newest = Some(sample);
            return Some(());
        }
    }
}
