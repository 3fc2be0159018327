//! One process's connection to shared memory, and the only place that opens topics.
//!
//! Quality of service is derived from the topic table. Safe overflow is always on: a reader that does not keep up
//! loses the oldest sample, it never blocks the writer. A dead reader therefore cannot stop a flight.

use crate::input::Input;
use crate::instance::Instance;
use crate::janitor::{self, Swept};
use crate::output::Output;
use iceoryx2::node::{Node, NodeBuilder};
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::{NodeName, ServiceName, SignalHandlingMode, ipc};
use iceoryx2::service::port_factory::{event, publish_subscribe};
use jink_shared_types::SampleHeader;
use jink_shared_types::layout::Layout;
use jink_shared_types::topics::{Topic, TopicRow};
use std::fmt;
use std::time::Duration;

/// Active, shadow, and one dead that has not been cleaned up yet.
const MAX_PUBLISHERS: usize = 3;
/// The same of a topic on which every process speaks.
const MAX_PUBLISHERS_SHARED: usize = 40;
/// Consumers and their shadows, recorder, several command line tools.
const MAX_SUBSCRIBERS: usize = 12;
/// The same of a topic that every process and its shadow may read. Each subscriber that might come costs a publisher room for
/// the samples it might hold, and time at its start.
const MAX_SUBSCRIBERS_ALL: usize = 40;
/// Nodes that may know a topic at once.
const MAX_NODES: usize = 64;
/// The sample being read, the next one, and one spare while the queue is drained.
const MAX_BORROWED: usize = 3;
/// One being filled, one spare.
pub(crate) const MAX_LOANED: usize = 2;
/// Processes that may be woken by one topic: every one and its shadow by the control record.
const MAX_LISTENERS: usize = 40;
/// Opening may meet a service in the middle of its creation or destruction by somebody else: those answers pass.
const OPEN_ATTEMPTS: u32 = 50;
const OPEN_RETRY: Duration = Duration::from_millis(4);

/// Why a topic, or the connection itself, could not be opened.
#[derive(Debug)]
pub enum OpenError {
    /// The topic's row does not allow it.
    NotInTable {
        /// Topic asked for.
        topic: String,
        /// Program that asked.
        program: String,
        /// "publish", "read" or "wait for".
        what: &'static str,
    },
    /// Another build of the same topic is in use: the layouts differ.
    Layout {
        /// Topic asked for.
        topic: String,
        /// This build's type name with its layout hash.
        ours: &'static str,
        /// What iceoryx2 said.
        cause: String,
    },
    /// iceoryx2 refused for another reason.
    Transport {
        /// Topic asked for, or what was being done.
        topic: String,
        /// What iceoryx2 said.
        cause: String,
    },
}

impl fmt::Display for OpenError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotInTable { topic, program, what } => {
                write!(
                    f,
                    "{program} may not {what} {topic}: the topic's row does not allow it"
                )
            }
            Self::Layout { topic, ours, cause } => write!(
                f,
                "{topic}: somebody holds it with another layout than this build's {ours} ({cause}); \
                 stop the other instance or use binaries of one build"
            ),
            Self::Transport { topic, cause } => write!(f, "{topic}: {cause}"),
        }
    }
}
impl std::error::Error for OpenError {}

pub(crate) type PubSubFactory<T> = publish_subscribe::PortFactory<ipc::Service, T, SampleHeader>;
pub(crate) type EventFactory = event::PortFactory<ipc::Service>;

/// A connection to one instance's shared memory.
pub struct Session {
    node: Node<ipc::Service>,
    instance: Instance,
    program: String,
}

impl fmt::Debug for Session {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Session({})", self.program)
    }
}

impl Session {
    /// Connects `program` (a name from the topic table's producers and consumers) to `instance`.
    ///
    /// # Errors
    /// [`OpenError::Transport`] if shared memory cannot be reached.
    pub fn open(instance: &Instance, program: &str) -> Result<Self, OpenError> {
        let failed = |cause: String| OpenError::Transport {
            topic: format!("instance {instance}"),
            cause,
        };
        let config = instance
            .iceoryx_config()
            .ok_or_else(|| failed("its folder is no valid path".to_owned()))?;
        let name = NodeName::new(program).map_err(|error| failed(format!("{error:?}")))?;
        let node = NodeBuilder::new()
            .name(&name)
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|error| failed(format!("{error:?}")))?;
        Ok(Self {
            node,
            instance: instance.clone(),
            program: program.to_owned(),
        })
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
        self.check(&topic.row, topic.row.may_publish(&self.program), "publish")?;
        let name = topic.row.topic_name(member);
        let factory = self.pub_sub(&topic, &name)?;
        let transport = |cause: String| OpenError::Transport {
            topic: name.clone(),
            cause,
        };
        let publisher = factory
            .publisher_builder()
            .max_loaned_samples(MAX_LOANED)
            .create()
            .map_err(|error| transport(format!("{error:?}")))?;
        let notifier: Option<Notifier<ipc::Service>> = match topic.row.wakes {
            true => {
                let notifier = self.event(&name)?.notifier_builder().create();
                Some(notifier.map_err(|error| transport(format!("{error:?}")))?)
            }
            false => None,
        };
        Ok(Output::new(publisher, notifier, generation))
    }

    /// Opens `topic` for reading.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn input<T: Layout>(&self, topic: Topic<T>, member: &str) -> Result<Input<T>, OpenError> {
        self.check(&topic.row, topic.row.may_read(&self.program), "read")?;
        let name = topic.row.topic_name(member);
        let factory = self.pub_sub(&topic, &name)?;
        let subscriber = factory
            .subscriber_builder()
            .create()
            .map_err(|error| OpenError::Transport {
                topic: name.clone(),
                cause: format!("{error:?}"),
            })?;
        let input = Input::new(subscriber, name, topic.row.deadline_ms);
        Ok(if topic.row.is_shared() {
            input.of_all_producers()
        } else {
            input
        })
    }

    /// Opens the wake-ups of a topic. The table says which have any.
    pub(crate) fn listener<T>(
        &self,
        topic: Topic<T>,
        member: &str,
    ) -> Result<Listener<ipc::Service>, OpenError> {
        self.check(&topic.row, topic.row.wakes, "wait for")?;
        let name = topic.row.topic_name(member);
        self.event(&name)?
            .listener_builder()
            .create()
            .map_err(|error| OpenError::Transport {
                topic: name,
                cause: format!("{error:?}"),
            })
    }

    /// Creates (or joins) a topic and holds it open, so that its quality of service outlives its users.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn hold<T: Layout>(&self, topic: Topic<T>, member: &str) -> Result<HeldTopic, OpenError> {
        let name = topic.row.topic_name(member);
        let samples = self.pub_sub(&topic, &name)?;
        let events = topic.row.wakes.then(|| self.event(&name)).transpose()?;
        Ok(HeldTopic {
            _held: Box::new((samples, events)),
        })
    }

    /// Removes what dead processes left behind. Takes milliseconds and allocates: for the supervisor only, after
    /// control has moved.
    pub fn clean_up_dead(&self) -> Swept {
        janitor::sweep(&self.instance, self.node.config())
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

    fn service_name(name: &str) -> Result<ServiceName, OpenError> {
        ServiceName::new(name).map_err(|error| OpenError::Transport {
            topic: name.to_owned(),
            cause: format!("{error:?}"),
        })
    }

    fn pub_sub<T: Layout>(&self, topic: &Topic<T>, name: &str) -> Result<PubSubFactory<T>, OpenError> {
        let service = Self::service_name(name)?;
        let subscribers = if topic.row.consumers.contains(&"*") {
            MAX_SUBSCRIBERS_ALL
        } else {
            MAX_SUBSCRIBERS
        };
        let publishers = if topic.row.is_shared() {
            MAX_PUBLISHERS_SHARED
        } else {
            MAX_PUBLISHERS
        };
        retry(|| {
            self.node
                .service_builder(&service)
                .publish_subscribe::<T>()
                .user_header::<SampleHeader>()
                .max_publishers(publishers)
                .max_subscribers(subscribers)
                .max_nodes(MAX_NODES)
                .history_size(1)
                .subscriber_max_buffer_size(topic.row.buffer)
                .subscriber_max_borrowed_samples(MAX_BORROWED)
                .enable_safe_overflow(true)
                .open_or_create()
        })
        .map_err(|error| {
            let cause = format!("{error:?}");
            if cause.contains("IncompatibleTypes") {
                OpenError::Layout {
                    topic: name.to_owned(),
                    ours: jink_shared_types::layout::type_name::<T>(),
                    cause,
                }
            } else {
                OpenError::Transport {
                    topic: name.to_owned(),
                    cause,
                }
            }
        })
    }

    fn event(&self, name: &str) -> Result<EventFactory, OpenError> {
        let service = Self::service_name(name)?;
        retry(|| {
            self.node
                .service_builder(&service)
                .event()
                .max_notifiers(MAX_PUBLISHERS)
                .max_listeners(MAX_LISTENERS)
                .max_nodes(MAX_NODES)
                .open_or_create()
        })
        .map_err(|error| OpenError::Transport {
            topic: name.to_owned(),
            cause: format!("{error:?}"),
        })
    }
}

/// A topic that exists as long as this lives.
pub struct HeldTopic {
    _held: Box<dyn std::any::Any>,
}

impl fmt::Debug for HeldTopic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("HeldTopic")
    }
}

/// Tries `open` again while the answer is one that passes by itself.
fn retry<T, E: fmt::Debug>(mut open: impl FnMut() -> Result<T, E>) -> Result<T, E> {
    let mut attempt = 0;
    loop {
        match open() {
            Err(error) if attempt < OPEN_ATTEMPTS && passes_by_itself(&error) => {
                attempt += 1;
                std::thread::sleep(OPEN_RETRY);
            }
            answer => return answer,
        }
    }
}

fn passes_by_itself<E: fmt::Debug>(error: &E) -> bool {
    let text = format!("{error:?}");
    [
        "HangsInCreation",
        "ServiceInCorruptedState",
        "IsMarkedForDestruction",
        "SystemInFlux",
        "AlreadyExists",
    ]
    .iter()
    .any(|passing| text.contains(passing))
}
