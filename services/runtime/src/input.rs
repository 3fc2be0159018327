//! A topic as a reader sees it: the newest sample with its age, or every unread one in order.
//!
//! What a reader gets has been looked at once, here: a sample whose numbers make no sense ([`Layout::is_plausible`]), or whose stamps
//! lie in the future, is refused as if it had never come. It is counted, its producer is named in the log and to the pilot, and
//! a service that needs the input counts as degraded for a second.

use crate::clock::Clock;
use crate::cycle_log::Looks;
use crate::ownership::Ownership;
use crate::transport::{Sample, Subscriber};
use jink_shared_types::layout::Layout;
use jink_shared_types::topics::TopicRow;
use jink_shared_types::{Reading, SampleHeader, Stamped, Timestamp};
use std::cell::Cell;
use std::fmt;
use std::marker::PhantomData;
use std::rc::Rc;

/// A stamp this far ahead of the clock is wrong (s): processes of one board read one clock.
pub const FUTURE_S: f64 = 0.05;
/// A refused sample degrades whoever needs the input for so long (s), and is written to the log once in this time.
const REFUSAL_COUNTS_S: f64 = 1.0;
/// Refused samples of one topic are reported to the pilot this often at most (s).
const REPORT_PERIOD_S: f64 = 10.0;

/// What the loop wants to know of an input without borrowing it.
#[derive(Debug)]
pub(crate) struct InputHealth {
    /// Header of the newest sample; all zero if there is none.
    newest: Cell<SampleHeader>,
    deadline_ms: f64,
    pub(crate) needed: Cell<bool>,
    /// Who may publish it.
    producer: String,
    refused: Cell<u64>,
    refused_at: Cell<Timestamp>,
    /// Refusals that the pilot has been notified of.
    reported: Cell<u64>,
    reported_at: Cell<Timestamp>,
}

impl InputHealth {
    /// Whether anything has ever come.
    pub(crate) fn has_come(&self) -> bool {
        self.newest.get().publish.is_set()
    }

    pub(crate) fn is_fresh(&self, now: Timestamp) -> bool {
        let refused_at = self.refused_at.get();
        let is_refused = refused_at.is_set() && now.seconds_since(refused_at) < REFUSAL_COUNTS_S;
        self.has_come() && !is_refused && self.newest.get().is_fresh(now, self.deadline_ms)
    }

    /// Samples refused so far and whose they were, if that is new: at most once in [`REPORT_PERIOD_S`].
    pub(crate) fn new_refusals(&self, now: Timestamp) -> Option<(u64, &str)> {
        let refused = self.refused.get();
        let reported_at = self.reported_at.get();
        if refused == self.reported.get()
            || reported_at.is_set() && now.seconds_since(reported_at) < REPORT_PERIOD_S
        {
            return None;
        }
        self.reported.set(refused);
        self.reported_at.set(now);
        Some((refused, &self.producer))
    }

    fn refuse(&self, topic: &str, header: &SampleHeader, refusal: Refusal, now: Timestamp) {
        let refused = self.refused.get() + 1;
        self.refused.set(refused);
        let last = self.refused_at.get();
        if !last.is_set() || now.seconds_since(last) >= REFUSAL_COUNTS_S || refused == 1 {
            tracing::warn!(
                "{topic}: sample {} of {} (start {}) refused, {refusal}; {refused} in all",
                header.sequence & u64::from(u32::MAX),
                self.producer,
                header.generation,
            );
        }
        self.refused_at.set(now);
    }
}

/// What is looked at before a reader gets a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Checks {
    /// Stamps and numbers.
    All,
    /// Stamps: the reader has an answer to numbers that make no sense.
    Stamps,
    /// Nothing: for those who show what is there.
    None,
}

/// Why a sample was refused.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Refusal {
    /// A stamp is this far ahead of the clock (s).
    Future { ahead_s: f64 },
    /// It was published and says that it never was.
    Unstamped,
    /// Its numbers make no sense.
    Implausible,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Future { ahead_s } => write!(f, "its stamp is {ahead_s:.3} s in the future"),
            Self::Unstamped => f.write_str("it has no time of publication"),
            Self::Implausible => f.write_str("its numbers make no sense"),
        }
    }
}

impl Refusal {
    fn judge(checks: Checks, subscriber: &Subscriber, sample: &Sample, now: Timestamp) -> Option<Self> {
        if checks == Checks::None {
            return None;
        }
        let header = sample.header();
        let ahead_s = header.publish.max(header.capture).seconds_since(now);
        if ahead_s > FUTURE_S {
            Some(Self::Future { ahead_s })
        } else if !header.publish.is_set() {
            Some(Self::Unstamped)
        } else if checks == Checks::All && !subscriber.is_plausible(sample) {
            Some(Self::Implausible)
        } else {
            None
        }
    }
}

/// A topic opened for reading.
pub struct Input<T> {
    port: InputPort,
    payload: PhantomData<fn() -> T>,
}

impl<T> fmt::Debug for Input<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Input({})", self.port.name)
    }
}

impl<T: Layout> Input<T> {
    /// `subscriber` is one of samples of `T`.
    pub(crate) fn new(
        subscriber: Subscriber,
        clock: Clock,
        name: String,
        row: &TopicRow,
        producer: String,
    ) -> Self {
        Self {
            port: InputPort {
                subscriber,
                clock,
                checks: Checks::All,
                newest: None,
                last_sequence: 0,
                name,
                lost: 0,
                health: Rc::new(InputHealth {
                    newest: Cell::default(),
                    deadline_ms: row.deadline_ms,
                    needed: Cell::new(false),
                    producer,
                    refused: Cell::new(0),
                    refused_at: Cell::new(Timestamp::NEVER),
                    reported: Cell::new(0),
                    reported_at: Cell::new(Timestamp::NEVER),
                }),
                ownership: None,
                of_all: row.is_shared(),
                waiting_max: row.buffer * row.max_publishers(),
                looks: None,
            },
            payload: PhantomData,
        }
    }

    /// Reports every sample taken to `ownership`.
    pub(crate) fn with_ownership(mut self, ownership: &Rc<Ownership>) -> Self {
        self.port.ownership = Some(Rc::clone(ownership));
        self
    }

    /// What is taken is written down, or as it was written down ([`crate::cycle_log`]).
    pub(crate) fn with_looks(mut self, looks: Option<Looks>) -> Self {
        self.port.looks = looks;
        self
    }

    /// Hands out the samples of every producer, not only those of the newest one: for topics on which an instance and
    /// its shadow both publish.
    pub fn of_all_producers(mut self) -> Self {
        self.port.of_all = true;
        self
    }

    /// Looks at less before a sample is handed out.
    pub fn with_checks(mut self, checks: Checks) -> Self {
        self.port.checks = checks;
        self
    }

    /// Marks the input as one the service cannot work without: while it is stale, the service is degraded.
    pub fn needed(self) -> Self {
        self.port.health.needed.set(true);
        self
    }

    /// Samples that were overwritten before they could be read; not counted where several producers publish at once.
    pub fn lost(&self) -> u64 {
        self.port.lost
    }

    /// Samples that were refused: stamps in the future, numbers that make no sense.
    pub fn refused(&self) -> u64 {
        self.port.health.refused.get()
    }

    pub(crate) fn health(&self) -> Rc<InputHealth> {
        Rc::clone(&self.port.health)
    }

    /// Takes all waiting samples and returns the newest one ever received, judged against the topic's deadline.
    pub fn latest(&mut self, now: Timestamp) -> Reading<'_, T> {
        let mut left = self.port.begin_look();
        while self.port.receive(&mut left).is_some() {}
        Reading::judge(self.newest(), now, self.port.health.deadline_ms)
    }

    /// Hands every sample that waits to `visit`, oldest first. What is published meanwhile is for the next call.
    pub fn each(&mut self, mut visit: impl FnMut(Stamped<'_, T>)) {
        let mut left = self.port.begin_look();
        while self.port.receive(&mut left).is_some() {
            if let Some(stamped) = self.newest() {
                visit(stamped);
            }
        }
    }

    /// The newest sample received so far, however old: for what must outlive its producer.
    pub fn newest(&self) -> Option<Stamped<'_, T>> {
        self.port.newest.as_ref().map(|sample| Stamped {
            #[allow(unsafe_code)]
            // SAFETY: the subscriber is one of samples of `T`.
            sample: unsafe { sample.payload() },
            header: sample.header(),
        })
    }
}

/// What is the same for every payload.
struct InputPort {
    subscriber: Subscriber,
    clock: Clock,
    checks: Checks,
    newest: Option<Sample>,
    last_sequence: u64,
    name: String,
    lost: u64,
    health: Rc<InputHealth>,
    /// Of a trigger: learns what was taken.
    ownership: Option<Rc<Ownership>>,
    /// Samples of all producers are handed out, whichever is the newest.
    of_all: bool,
    /// Samples that can be waiting: no more are taken at once, so that a producer without end keeps no reader from its cycle.
    waiting_max: usize,
    /// Of a service whose cycles are recorded or replayed.
    looks: Option<Looks>,
}

impl InputPort {
    /// Returns how many samples may be taken.
    fn begin_look(&mut self) -> usize {
        if let Some(looks) = &mut self.looks {
            looks.begin();
        }
        self.waiting_max
    }

    /// Moves to the next unread sample that can be used, of `left` that may be taken. Samples of a producer that has been replaced
    /// may arrive after those of its successor: what does not advance the sequence is dropped, as long as the newest sample is
    /// fresh. After that whoever publishes counts, so that a sequence number from nowhere silences nobody for longer.
    fn receive(&mut self, left: &mut usize) -> Option<()> {
        loop {
            *left = left.checked_sub(1)?;
            if self.looks.as_ref().is_some_and(|looks| !looks.may_take()) {
                return None;
            }
            let sample = self.subscriber.receive()?;
            if let Some(looks) = &self.looks {
                looks.took(sample.header().publish);
            }
            let now = self.clock.now();
            let header = sample.header();
            if let Some(refusal) = Refusal::judge(self.checks, &self.subscriber, &sample, now) {
                self.health.refuse(&self.name, header, refusal, now);
                continue;
            }
            let sequence = header.sequence;
            if self.newest.is_some() && !self.of_all {
                let is_fresh = self.health.newest.get().is_fresh(now, self.health.deadline_ms);
                if sequence <= self.last_sequence && is_fresh {
                    continue;
                }
                if sequence >> 32 == self.last_sequence >> 32 {
                    let skipped = sequence.saturating_sub(self.last_sequence).saturating_sub(1);
                    self.lost = self.lost.saturating_add(skipped);
                }
            }
            self.last_sequence = sequence;
            if let Some(ownership) = &self.ownership {
                ownership.took(header.publish);
            }
            self.health.newest.set(*header);
            self.newest = Some(sample);
            return Some(());
        }
    }
}
