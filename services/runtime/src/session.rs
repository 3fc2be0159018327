//! One program's connection to its topics, and the only place that opens them.

use crate::clock::Clock;
use crate::config::{Foreign, Grants};
use crate::cycle_log::{CycleLog, Looks};
use crate::input::Input;
use crate::instance::Instance;
use crate::open_error::OpenError;
use crate::output::Output;
use crate::transport::local::LocalBus;
use crate::transport::shared::Connection;
pub use crate::transport::shared::RawInput;
use crate::transport::{PayloadType, Publisher, PublisherPort, Subscriber, SubscriberPort, Wakeup};
use jink_shared_types::layout::Layout;
use jink_shared_types::shape::Shape;
use jink_shared_types::suggestion::{DidYouMean, nearest};
use jink_shared_types::topics::{Topic, TopicRow};
use std::fmt;
use std::rc::Rc;

/// Where a session's topics are.
enum Transport {
    Shared(Connection),
    Local(LocalBus),
}

/// A program's connection to the topics of one instance.
pub struct Session {
    transport: Transport,
    program: String,
    /// What the configuration allows besides the topic table.
    grants: Grants,
    /// What the configuration opens to programs of others.
    foreign: Foreign,
    /// What its inputs take is recorded or replayed.
    pub(crate) cycle_log: Option<Rc<CycleLog>>,
}

impl fmt::Debug for Session {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Session({})", self.program)
    }
}

impl Session {
    /// Connects `program` (a name from the topic table's producers and consumers) to the shared memory of `instance`.
    ///
    /// # Errors
    /// [`OpenError::Transport`] if shared memory cannot be reached.
    pub fn open(instance: &Instance, program: &str) -> Result<Self, OpenError> {
        Ok(Self {
            transport: Transport::Shared(Connection::open(instance, program)?),
            program: program.to_owned(),
            grants: Grants::default(),
            foreign: Foreign::default(),
            cycle_log: None,
        })
    }

    /// Connects `program` to topics within this process.
    pub fn local(bus: &LocalBus, program: &str) -> Self {
        Self {
            transport: Transport::Local(bus.clone()),
            program: program.to_owned(),
            grants: Grants::default(),
            foreign: Foreign::default(),
            cycle_log: bus.replayed(),
        }
    }

    /// What its inputs take from now on is written down for the recorder, if it is a session in shared memory.
    pub(crate) fn record(&mut self, shadow: bool) {
        if matches!(self.transport, Transport::Shared(_)) {
            self.cycle_log = Some(Rc::new(CycleLog::recording(shadow)));
        }
    }

    /// The same with the topics that the configuration declares, and with what it grants to the process that the session is of.
    pub fn with(mut self, foreign: &Foreign) -> Self {
        self.grants = foreign.grants_of(&self.program);
        self.foreign.clone_from(foreign);
        self
    }

    /// The topic of this name that the configuration declares, with payload `T`.
    ///
    /// # Errors
    /// [`OpenError::NotAsDeclared`] if there is none, or `T` is not what its row says.
    pub fn declared<T: Layout>(&self, name: &str) -> Result<Topic<T>, OpenError> {
        let refused = |cause: String| OpenError::NotAsDeclared {
            topic: name.to_owned(),
            cause,
        };
        let row = self.foreign.topics.iter().find(|row| row.name == name);
        let Some(row) = row else {
            let names = self.foreign.topics.iter().map(|row| row.name);
            return Err(refused(match self.foreign.topics.is_empty() {
                true => "services.toml has no [[topic]] at all".to_owned(),
                false => format!(
                    "no [[topic]] of services.toml has this name{}",
                    DidYouMean(nearest(name, names))
                ),
            }));
        };
        let (ours, size) = (payload_name::<T>(), size_of::<T>());
        if (ours, size) != (row.payload, row.payload_bytes) {
            return Err(refused(format!(
                "services.toml says {} of {} bytes, the program has {ours} of {size}",
                row.payload, row.payload_bytes
            )));
        }
        Ok(Topic::of_row(*row))
    }

    /// Opens the topic `name` of a row for reading whose payload this program does not know: what it gets is bytes. `None` as long as nobody
    /// else has opened it.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn raw_input(&self, row: &TopicRow, name: &str) -> Result<Option<RawInput>, OpenError> {
        self.check(
            row,
            row.may_read(&self.program) || self.grants.may_read(name),
            "read",
        )?;
        match &self.transport {
            Transport::Shared(connection) => connection.raw_subscriber(row, name),
            Transport::Local(_) => Ok(None),
        }
    }

    /// Takes the memory that everything opened so far may need, before somebody else has it: a process that writes where none is left
    /// is ended by a signal.
    ///
    /// # Errors
    /// [`OpenError::NoRoom`].
    pub fn reserve(&self) -> Result<(), OpenError> {
        match &self.transport {
            Transport::Shared(connection) => connection.reserve(),
            Transport::Local(_) => Ok(()),
        }
    }

    /// The clock of all samples of this connection.
    pub fn clock(&self) -> Clock {
        match &self.transport {
            Transport::Shared(_) => Clock::monotonic(),
            Transport::Local(bus) => Clock::of(bus),
        }
    }

    /// Opens `topic` (member `member` of a family, ignored otherwise) for publishing.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn output<T: Layout>(
        &self,
        topic: Topic<T>,
        member: &str,
        generation: u32,
    ) -> Result<Output<T>, OpenError> {
        let name = topic.row.topic_name(member);
        let allowed = topic.row.may_publish(&self.program) || self.grants.may_publish(&name);
        self.check(&topic.row, allowed, "publish")?;
        let payload = PayloadType::of::<T>();
        let port = match &self.transport {
            Transport::Shared(connection) => {
                PublisherPort::Shared(Box::new(connection.publisher(&topic.row, &name, payload)?))
            }
            Transport::Local(bus) => PublisherPort::Local(bus.publisher(&topic.row, &name, payload)?),
        };
        Ok(Output::new(
            Publisher::new(payload, port),
            self.clock(),
            generation,
        ))
    }

    /// Opens `topic` for reading.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn input<T: Layout>(&self, topic: Topic<T>, member: &str) -> Result<Input<T>, OpenError> {
        let name = topic.row.topic_name(member);
        let allowed = topic.row.may_read(&self.program) || self.grants.may_read(&name);
        self.check(&topic.row, allowed, "read")?;
        let payload = PayloadType::of::<T>();
        let port = match &self.transport {
            Transport::Shared(connection) => {
                SubscriberPort::Shared(connection.subscriber(&topic.row, &name, payload)?)
            }
            Transport::Local(bus) => SubscriberPort::Local(bus.subscriber(&topic.row, &name, payload)?),
        };
        let subscriber = Subscriber::new(payload, port);
        let producer = match topic.row.producers {
            [only] if *only != "*" => (*only).to_owned(),
            _ => name.clone(),
        };
        let looks = self.cycle_log.as_ref().map(|log| Looks::at(&name, log));
        Ok(Input::new(subscriber, self.clock(), name, &topic.row, producer).with_looks(looks))
    }

    /// Opens the wake-ups of a topic. The table says which have any.
    pub(crate) fn wakeup<T: Layout>(&self, topic: Topic<T>, member: &str) -> Result<Wakeup, OpenError> {
        self.check(&topic.row, topic.row.wakes, "wait for")?;
        let name = topic.row.topic_name(member);
        Ok(match &self.transport {
            Transport::Shared(connection) => Wakeup::Shared(Box::new(connection.wakeup(&topic.row, &name)?)),
            Transport::Local(bus) => Wakeup::Local(bus.wakeup(&name, PayloadType::of::<T>())?),
        })
    }

    /// Creates (or joins) a topic and holds it open, so that its quality of service outlives its users.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn hold<T: Layout>(&self, topic: Topic<T>, member: &str) -> Result<HeldTopic, OpenError> {
        let name = topic.row.topic_name(member);
        let row = self.foreign.with_readers(topic.row, &name);
        Ok(HeldTopic {
            _held: match &self.transport {
                Transport::Shared(connection) => {
                    Some(connection.hold(&row, &name, PayloadType::of::<T>())?)
                }
                // A topic is there as long as its bus.
                Transport::Local(_) => None,
            },
        })
    }

    fn check(&self, row: &TopicRow, allowed: bool, what: &'static str) -> Result<(), OpenError> {
        if allowed {
            Ok(())
        } else {
            Err(OpenError::NotInTable {
                topic: row.name.to_owned(),
                program: self.program.clone(),
                what,
            })
        }
    }
}

/// The name of a payload without its hash.
fn payload_name<T: Layout>() -> &'static str {
    match T::SHAPE {
        Shape::Struct(shape) => shape.name,
        _ => "",
    }
}

/// A topic that exists as long as this lives.
pub struct HeldTopic {
    _held: Option<Box<dyn std::any::Any>>,
}

impl fmt::Debug for HeldTopic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("HeldTopic")
    }
}
