//! The topics of a service, and what goes with them: configuration, clock, ownership.

use crate::clock::Clock;
use crate::config::Config;
use crate::events::EventSender;
use crate::input::{Input, InputHealth};
use crate::open_error::OpenError;
use crate::output::{Output, published};
use crate::ownership::Ownership;
use crate::param_store::ParamStore;
use crate::session::Session;
use crate::setup::Setup;
use crate::transport::Wakeup;
use jink_shared_types::health::ServiceState;
use jink_shared_types::layout::Layout;
use jink_shared_types::topics::Topic;
use jink_shared_types::{SampleHeader, Stage, Timestamp, events};
use std::fmt;
use std::rc::Rc;

/// Topics that one service may read; one bit each in its heartbeat.
pub const INPUTS: usize = 32;
/// Topics that may wake one service.
pub const WAKEUPS: usize = 32;

/// Opens the topics of a service.
pub struct Ports {
    pub(crate) session: Session,
    setup: Setup,
    config: Config,
    store: ParamStore,
    inputs: Vec<Rc<InputHealth>>,
    pub(crate) wakeups: Vec<Wakeup>,
    pub(crate) ownership: Rc<Ownership>,
}

impl fmt::Debug for Ports {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Ports({}, {} inputs)", self.setup.process, self.inputs.len())
    }
}

impl Ports {
    pub(crate) fn new(session: Session, setup: Setup, config: Config, store: ParamStore) -> Self {
        Self {
            ownership: Rc::new(Ownership::new(
                setup.generation,
                setup.shadow,
                setup.end_to_end_us,
            )),
            session,
            setup,
            config,
            store,
            inputs: Vec::new(),
            wakeups: Vec::new(),
        }
    }

    /// The clock of this service. It reads no other.
    pub fn clock(&self) -> Clock {
        self.session.clock()
    }

    /// What the supervisor said.
    pub fn setup(&self) -> &Setup {
        &self.setup
    }

    /// The configuration, with the parameters that were in force when the process was started.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Where changed parameters are kept.
    pub fn param_store(&self) -> &ParamStore {
        &self.store
    }

    /// A topic to publish.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn output<T: Layout>(&mut self, topic: Topic<T>) -> Result<Output<T>, OpenError> {
        self.output_of(topic, "")
    }

    /// One topic of a family to publish.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn output_of<T: Layout>(&mut self, topic: Topic<T>, member: &str) -> Result<Output<T>, OpenError> {
        let output = self.session.output(topic, member, self.setup.generation)?;
        Ok(output.with_ownership(&self.ownership))
    }

    /// The topic of one range sensor, named as in its table, to publish: its samples say when they are stale. `rate_hz` is what the
    /// driver knows of its rate, zero for nothing; the table's own `rate_hz` counts before that.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn range_output<T: Layout>(
        &mut self,
        topic: Topic<T>,
        sensor: &str,
        rate_hz: f64,
    ) -> Result<Output<T>, OpenError> {
        let row = self.config.sensors.iter().find(|row| row.name == sensor);
        let deadline_us = row.map_or(0, |row| row.deadline_us(topic.row.deadline_ms, rate_hz));
        Ok(self.output_of(topic, sensor)?.with_deadline_us(deadline_us))
    }

    /// Judges the age of what leaves shared memory; see [`Latency::left`].
    pub fn latency(&self) -> Latency {
        Latency {
            ownership: Rc::clone(&self.ownership),
        }
    }

    /// A topic to look at in every cycle.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn input<T: Layout>(&mut self, topic: Topic<T>) -> Result<Input<T>, OpenError> {
        self.input_of(topic, "")
    }

    /// One topic of a family to look at in every cycle.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn input_of<T: Layout>(&mut self, topic: Topic<T>, member: &str) -> Result<Input<T>, OpenError> {
        let name = topic.row.topic_name(member);
        has_room(&name, "topics to read", self.inputs.len(), INPUTS)?;
        let input = self.session.input(topic, member)?;
        self.inputs.push(input.health());
        Ok(input)
    }

    /// A topic whose samples start a cycle.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn trigger<T: Layout>(&mut self, topic: Topic<T>) -> Result<Input<T>, OpenError> {
        self.trigger_of(topic, "")
    }

    /// One topic of a family whose samples start a cycle.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn trigger_of<T: Layout>(&mut self, topic: Topic<T>, member: &str) -> Result<Input<T>, OpenError> {
        let name = topic.row.topic_name(member);
        has_room(&name, "topics to be woken by", self.wakeups.len(), WAKEUPS)?;
        self.wakeups.push(self.session.wakeup(topic, member)?);
        Ok(self.input_of(topic, member)?.with_ownership(&self.ownership))
    }

    /// A topic to publish that the configuration declares, for example `user/wind`.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn user_output<T: Layout>(&mut self, name: &str) -> Result<Output<T>, OpenError> {
        let topic = self.session.declared(name)?;
        self.output(topic)
    }

    /// A topic to look at in every cycle that the configuration declares.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn user_input<T: Layout>(&mut self, name: &str) -> Result<Input<T>, OpenError> {
        let topic = self.session.declared(name)?;
        self.input(topic)
    }

    /// A topic that the configuration declares and whose samples start a cycle: its row says `wakes = true`.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn user_trigger<T: Layout>(&mut self, name: &str) -> Result<Input<T>, OpenError> {
        let topic = self.session.declared(name)?;
        self.trigger(topic)
    }

    /// For a service with a thing that only one instance can have: it declares itself which cycles it owns.
    pub fn exclusive_ownership(&self) -> ExclusiveOwnership {
        let exclusive_ownership = ExclusiveOwnership {
            ownership: Rc::clone(&self.ownership),
        };
        exclusive_ownership.declare(!self.setup.shadow);
        exclusive_ownership
    }

    /// Which inputs are fresh, and which are needed, one bit each in the order in which they were opened.
    pub(crate) fn masks(&self, now: Timestamp) -> (u32, u32) {
        let mut fresh = 0;
        let mut needed = 0;
        for (index, input) in self.inputs.iter().enumerate() {
            fresh |= u32::from(input.is_fresh(now)) << index;
            needed |= u32::from(input.needed.get()) << index;
        }
        (fresh, needed)
    }

    /// Raises an event for each input whose producer sends what cannot be used; each at most once in ten seconds.
    pub(crate) fn report_refusals(&self, now: Timestamp, events: &mut EventSender) {
        for input in &self.inputs {
            if let Some((refused, producer)) = input.new_refusals(now) {
                events.raise(now, &events::SAMPLE_REFUSED, producer, [refused as f64, 0.0]);
            }
        }
    }

    /// Alive and blind is distinguished from alive and well: a needed input that is stale degrades, one that never came
    /// is a reason to stand by, and so is what the service lacks besides.
    pub(crate) fn state(&self, now: Timestamp) -> ServiceState {
        let needed = || self.inputs.iter().filter(|input| input.needed.get());
        if self.ownership.stands_by() || needed().any(|input| !input.has_come()) {
            ServiceState::Standby
        } else if needed().all(|input| input.is_fresh(now)) {
            ServiceState::Active
        } else {
            ServiceState::Degraded
        }
    }
}

fn has_room(topic: &str, what: &'static str, opened: usize, most: usize) -> Result<(), OpenError> {
    if opened < most {
        return Ok(());
    }
    Err(OpenError::TooMany {
        topic: topic.to_owned(),
        what,
        most,
    })
}

/// Judges the age of outputs that do not leave through a topic against the process's end-to-end budget.
#[derive(Clone, Debug)]
pub struct Latency {
    ownership: Rc<Ownership>,
}

impl Latency {
    /// Something that `stage` began to make at `begin` from the sample with this header left at `time`; that sample's history, with
    /// this stage in it.
    pub fn left(
        &self,
        header: &SampleHeader,
        stage: Stage,
        begin: Timestamp,
        time: Timestamp,
    ) -> SampleHeader {
        self.ownership.judge_age(header, time);
        let busy_us = self.ownership.busy_us(header.publish);
        published(header.derived(stage, begin), time, busy_us)
    }
}

/// Ownership that a service passes on by itself, when the control record says so.
#[derive(Clone, Debug)]
pub struct ExclusiveOwnership {
    ownership: Rc<Ownership>,
}

impl ExclusiveOwnership {
    /// Whether the record says that this instance is the owner at `time`.
    pub fn is_due(&self, time: Timestamp) -> bool {
        self.ownership.owns(time)
    }

    /// When that changes, if a change is planned; may be past.
    pub fn changes_at(&self) -> Option<Timestamp> {
        self.ownership.changes_at()
    }

    /// What is put out from now on is published, or not.
    pub fn declare(&self, owns: bool) {
        self.ownership.declare(owns);
    }

    /// Something that the service needs besides its inputs is not there, or is there again: meanwhile it stands by.
    pub fn stand_by(&self, stands_by: bool) {
        self.ownership.stand_by(stands_by);
    }
}
