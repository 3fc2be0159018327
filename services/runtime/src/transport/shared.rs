//! Between processes: iceoryx2.
//!
//! Quality of service is derived from the topic table. Safe overflow is always on: a reader that does not keep up
//! loses the oldest sample, it never blocks the writer. A dead reader therefore cannot stop a flight.
#![allow(unsafe_code)]

use super::PayloadType;
use super::pool::Pool;
use crate::cleanup;
use crate::instance::Instance;
use crate::open_error::OpenError;
use crate::room;
use iceoryx2::node::{Node, NodeBuilder, NodeDetails, NodeState, NodeView};
use iceoryx2::port::listener::{Listener, ListenerCreateError};
use iceoryx2::port::notifier::{Notifier, NotifierCreateError};
use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::port::subscriber::SubscriberCreateError;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{
    CallbackProgression, FileDescriptorBased, NodeName, ServiceName, SignalHandlingMode, ipc,
};
use iceoryx2::service::Service as _;
use iceoryx2::service::builder::event::{EventCreateError, EventOpenError, EventOpenOrCreateError};
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeCreateError, PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::marker::{CustomHeaderMarker, CustomPayloadMarker};
use iceoryx2::service::messaging_pattern::MessagingPattern;
use iceoryx2::service::port_factory::{PortFactory, event, publish_subscribe};
use iceoryx2::service::static_config::message_type_details::{TypeDetail, TypeVariant};
use iceoryx2::service::static_config::messaging_pattern::MessagingPattern as MessagingPatternConfig;
use jink_shared_types::SampleHeader;
use jink_shared_types::topics::{MAX_BORROWED, MAX_LOANED, MAX_NODES, TopicRow, is_spectator};
use std::any::Any;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fmt;
use std::mem::{ManuallyDrop, MaybeUninit};
use std::os::fd::BorrowedFd;
use std::time::{Duration, Instant};

/// Processes that may be woken by one topic: every one and its shadow by the control record.
const MAX_LISTENERS: usize = 40;
/// Opening may meet a service in the middle of its creation or destruction by somebody else: those answers pass.
const OPEN_ATTEMPTS: u32 = 50;
const OPEN_RETRY: Duration = Duration::from_millis(4);
/// How long places of the dead, and their memory, are looked for where nothing is left. A service that then ends has lived so long
/// that its restarts never are too many for their period.
const ROOM_PATIENCE: Duration = Duration::from_millis(1500);

/// iceoryx2's own type for payloads that are described when they are opened: it sees bytes.
type Bytes = [CustomPayloadMarker];
/// The same for headers; ours is always a [`SampleHeader`].
type Header = CustomHeaderMarker;
type PubSubFactory = publish_subscribe::PortFactory<ipc::Service, Bytes, Header>;
type EventFactory = event::PortFactory<ipc::Service>;

/// A connection to one instance's shared memory.
pub(crate) struct Connection {
    node: ManuallyDrop<Node<ipc::Service>>,
    /// The topics that it has opened: they are closed with it.
    topics: RefCell<BTreeMap<String, Box<dyn Any>>>,
    /// The run of the instance that it belongs to.
    run: Option<u64>,
    instance: Instance,
    /// It only looks on: the places of the services are not for it.
    is_spectator: bool,
}

impl Connection {
    pub(crate) fn open(instance: &Instance, program: &str) -> Result<Self, OpenError> {
        let failed = |cause: String| OpenError::Transport {
            topic: format!("instance {instance}"),
            cause,
        };
        instance
            .make_folder()
            .map_err(|error| failed(error.to_string()))?;
        with_patience(instance, is_spectator(program), || {
            room::has(&format!("instance {instance}"), room::TO_JOIN_BYTES)
        })?;
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
        instance
            .close_to_others()
            .map_err(|error| failed(error.to_string()))?;
        Ok(Self {
            node: ManuallyDrop::new(node),
            topics: RefCell::default(),
            run: instance.run(),
            instance: instance.clone(),
            is_spectator: is_spectator(program),
        })
    }

    /// Keeps a topic until the connection is closed.
    fn keep(&self, name: &str, topic: impl Any) {
        let kept = self.topics.borrow_mut().insert(name.to_owned(), Box::new(topic));
        // The one before, of the same topic, is closed after the new one has been opened: the topic stays.
        drop(kept);
    }

    /// Takes what memory the instance's small files lack; what that takes of large ones, their publishers do.
    pub(crate) fn reserve(&self) -> Result<(), OpenError> {
        with_patience(&self.instance, self.is_spectator, || {
            room::take_small(&self.instance)
        })
    }

    pub(crate) fn publisher(
        &self,
        row: &TopicRow,
        name: &str,
        payload: PayloadType,
    ) -> Result<Publisher, OpenError> {
        let factory = self.pub_sub(row, name, payload)?;
        self.leave_places(&factory, row, name)?;
        with_patience(&self.instance, self.is_spectator, || {
            room::has(name, row.reserved_bytes() as u64)
        })?;
        let make = || {
            factory
                .publisher_builder()
                .max_loaned_samples(MAX_LOANED)
                .create()
        };
        let publisher = self.with_room(make).map_err(|error| refused(name, &error))?;
        let notifier = match row.wakes {
            true => {
                let event = self.event(row, name)?;
                let notifier = self.with_room(|| event.notifier_builder().create());
                self.keep(&event_of(name), event);
                Some(notifier.map_err(|error| refused(name, &error))?)
            }
            false => None,
        };
        let mut publisher = Publisher {
            publisher,
            notifier,
            pool: None,
        };
        if row.reserved_slots() < row.slots() {
            let mut pool = publisher.pool(&self.instance, &factory, row, name)?;
            with_patience(&self.instance, self.is_spectator, || {
                pool.take(row.reserved_slots())
            })?;
            publisher.pool = Some(pool);
        }
        // Connect to the readers that are there already; others are found at the next sample.
        publisher.connect();
        self.keep(name, factory);
        Ok(publisher)
    }

    /// Refuses a spectator for whom there is no place besides those of the services. The dead are no spectators.
    fn leave_places(&self, factory: &PubSubFactory, row: &TopicRow, name: &str) -> Result<(), OpenError> {
        if self.is_spectator && spectators(factory) > row.spectators() {
            cleanup::sweep(&self.instance);
            if spectators(factory) > row.spectators() {
                return Err(OpenError::TooManySpectators {
                    topic: name.to_owned(),
                    most: row.spectators(),
                });
            }
        }
        Ok(())
    }

    pub(crate) fn subscriber(
        &self,
        row: &TopicRow,
        name: &str,
        payload: PayloadType,
    ) -> Result<Subscriber, OpenError> {
        let factory = self.pub_sub(row, name, payload)?;
        let subscriber = self.subscriber_of(&factory, row, name);
        self.keep(name, factory);
        subscriber
    }

    fn subscriber_of(
        &self,
        factory: &PubSubFactory,
        row: &TopicRow,
        name: &str,
    ) -> Result<Subscriber, OpenError> {
        self.leave_places(factory, row, name)?;
        let subscriber = self
            .with_room(|| factory.subscriber_builder().create())
            .map_err(|error| refused(name, &error))?;
        // Without this a publisher that is idle now would not be connected before its next sample.
        let _not_yet = subscriber.update_connections();
        Ok(Subscriber(subscriber))
    }

    /// What `make` makes; where all places are taken, those of the dead are freed first.
    fn with_room<T, E: Place>(&self, mut make: impl FnMut() -> Result<T, E>) -> Result<T, E> {
        let begin = Instant::now();
        loop {
            match make() {
                Err(error) if error.is_taken() && begin.elapsed() < ROOM_PATIENCE => {
                    cleanup::sweep(&self.instance);
                    // Somebody else may be at it.
                    std::thread::sleep(OPEN_RETRY);
                }
                answer => return answer,
            }
        }
    }

    /// Opens a topic as whoever created it has described it; `None` if there is none.
    pub(crate) fn raw_subscriber(&self, row: &TopicRow, name: &str) -> Result<Option<RawInput>, OpenError> {
        let service = service_name(name)?;
        let found = ipc::Service::details(&service, self.node.config(), MessagingPattern::PublishSubscribe)
            .map_err(|error| transport(name, &error))?;
        let Some(found) = found else {
            return Ok(None);
        };
        let MessagingPatternConfig::PublishSubscribe(quality) = found.static_details.messaging_pattern()
        else {
            return Ok(None);
        };
        let payload = quality.message_type_details().payload;
        let builder = self.node.service_builder(&service).publish_subscribe::<Bytes>();
        let builder = builder.user_header::<Header>();
        // SAFETY: the payload is only looked at as that many bytes.
        let builder = unsafe { builder.__internal_set_payload_type_details(&payload) };
        // SAFETY: a topic with another header does not open.
        let builder = unsafe { builder.__internal_set_user_header_type_details(&header_type()) };
        let factory = builder.open().map_err(|error| transport(name, &error))?;
        let subscriber = self.subscriber_of(&factory, row, name);
        self.keep(name, factory);
        Ok(Some(RawInput {
            subscriber: subscriber?,
            type_name: payload.type_name().to_string(),
            size: payload.size(),
        }))
    }

    pub(crate) fn wakeup(&self, row: &TopicRow, name: &str) -> Result<Wakeup, OpenError> {
        let event = self.event(row, name)?;
        let listener = self.with_room(|| event.listener_builder().create());
        self.keep(&event_of(name), event);
        listener.map(Wakeup).map_err(|error| refused(name, &error))
    }

    /// What keeps the topic there.
    pub(crate) fn hold(
        &self,
        row: &TopicRow,
        name: &str,
        payload: PayloadType,
    ) -> Result<Box<dyn std::any::Any>, OpenError> {
        let samples = self.pub_sub(row, name, payload)?;
        let events = row.wakes.then(|| self.event(row, name)).transpose()?;
        Ok(Box::new((samples, events)))
    }

    fn pub_sub(&self, row: &TopicRow, name: &str, payload: PayloadType) -> Result<PubSubFactory, OpenError> {
        let service = service_name(name)?;
        let payload_type = TypeDetail::__internal_new_from_parts(
            TypeVariant::FixedSize,
            payload.name,
            payload.size,
            payload.align,
        )
        .map_err(|error| transport(name, &error))?;
        let open = || {
            let builder = self.node.service_builder(&service).publish_subscribe::<Bytes>();
            let builder = builder.user_header::<Header>();
            // SAFETY: `Layout` promises that a payload is as `PayloadType` says, and can be exchanged between processes.
            let builder = unsafe { builder.__internal_set_payload_type_details(&payload_type) };
            // SAFETY: `Layout` promises the same of the header.
            let builder = unsafe { builder.__internal_set_user_header_type_details(&header_type()) };
            builder
                .max_publishers(row.max_publishers())
                .max_subscribers(row.max_subscribers())
                .max_nodes(MAX_NODES)
                .history_size(1)
                .subscriber_max_buffer_size(row.buffer)
                .subscriber_max_borrowed_samples(MAX_BORROWED)
                .enable_safe_overflow(true)
                .open_or_create()
        };
        self.with_room(|| retry(open)).map_err(|error| match error {
            PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError(
                PublishSubscribeOpenError::IncompatibleTypes,
            ) => OpenError::Layout {
                topic: name.to_owned(),
                ours: payload.name,
            },
            other => refused(name, &other),
        })
    }

    fn event(&self, row: &TopicRow, name: &str) -> Result<EventFactory, OpenError> {
        let service = service_name(name)?;
        let open = || {
            self.node
                .service_builder(&service)
                .event()
                .max_notifiers(row.max_publishers())
                .max_listeners(MAX_LISTENERS)
                .max_nodes(MAX_NODES)
                .open_or_create()
        };
        self.with_room(|| retry(open))
            .map_err(|error| refused(name, &error))
    }
}

impl Drop for Connection {
    /// Whoever closes a topic last removes it by its name. After the end of its run that is a topic of the next one, which nobody could
    /// open any more: then everything is left as it is.
    fn drop(&mut self) {
        let topics = self.topics.take();
        if self.instance.run() == self.run {
            drop(topics);
            // SAFETY: nobody uses it after this.
            unsafe { ManuallyDrop::drop(&mut self.node) };
        } else {
            std::mem::forget(topics);
        }
    }
}

/// The place of a topic's wake-ups among the topics of a connection.
fn event_of(topic: &str) -> String {
    format!("{topic} event")
}

/// How many programs that only look on have opened a topic, the dead among them.
fn spectators(factory: &PubSubFactory) -> usize {
    let mut count = 0;
    let mut look = |details: &Option<NodeDetails>| {
        let name = details.as_ref().map(NodeDetails::name);
        count += usize::from(name.is_some_and(|name| is_spectator(name.as_str())));
    };
    // Who cannot be looked at is none of ours.
    let _incomplete = factory.nodes(|node| {
        match &node {
            NodeState::Alive(node) => look(node.details()),
            NodeState::Dead(node) => look(node.details()),
            NodeState::Inaccessible(_) | NodeState::Undefined(_) => {}
        }
        CallbackProgression::Continue
    });
    count
}

/// What `take` takes of the memory; where none is left, that of the dead is freed first. A spectator does not wait for it.
fn with_patience(
    instance: &Instance,
    is_spectator: bool,
    mut take: impl FnMut() -> Result<(), OpenError>,
) -> Result<(), OpenError> {
    let begin = Instant::now();
    loop {
        match take() {
            Err(OpenError::NoRoom { .. }) if !is_spectator && begin.elapsed() < ROOM_PATIENCE => {
                cleanup::sweep(instance);
                std::thread::sleep(OPEN_RETRY);
            }
            answer => return answer,
        }
    }
}

/// A topic opened for publishing.
pub(crate) struct Publisher {
    publisher: iceoryx2::port::publisher::Publisher<ipc::Service, Bytes, Header>,
    /// Of a topic that wakes its readers.
    notifier: Option<Notifier<ipc::Service>>,
    /// Of large samples, whose memory is not taken all at once.
    pool: Option<Pool>,
}

/// Memory for a sample: mapped shared memory, initialised by the kernel or by an older sample.
pub(crate) struct Loan(
    iceoryx2::sample_mut_uninit::SampleMutUninit<ipc::Service, [MaybeUninit<CustomPayloadMarker>], Header>,
);

impl Loan {
    pub(crate) fn payload(&mut self) -> *mut u8 {
        self.0.payload_mut().as_mut_ptr().cast()
    }
}

impl Publisher {
    pub(crate) fn loan(&mut self) -> Option<Loan> {
        // SAFETY: one element of the payload's fixed size.
        let mut loan = unsafe { self.publisher.loan_custom_payload(1) }.ok().map(Loan)?;
        let payload = loan.payload();
        // To write where no memory is left would end the process.
        let is_there = self.pool.as_mut().is_none_or(|pool| pool.holds(payload));
        is_there.then_some(loan)
    }

    /// The file behind the samples. Nothing is loaned yet, so the first loan is the first slot.
    fn pool(
        &mut self,
        instance: &Instance,
        factory: &PubSubFactory,
        row: &TopicRow,
        name: &str,
    ) -> Result<Pool, OpenError> {
        let first = self.loan().map(|mut loan| loan.payload().addr());
        let quality = factory.static_config();
        // Whoever has created the topic may have made room for more.
        let readers = quality.subscriber_max_buffer_size() + quality.subscriber_max_borrowed_samples();
        let slots = quality.max_subscribers() * readers + quality.history_size() + MAX_LOANED;
        let id = self.publisher.id().value();
        first
            .and_then(|first| Pool::find(instance, id, name, first, row.payload_bytes, slots))
            .ok_or_else(|| transport(name, &"the file behind its samples is not found"))
    }

    pub(crate) fn send(&mut self, loan: Loan, header: SampleHeader) -> bool {
        // SAFETY: see `Loan`.
        let mut sample = unsafe { loan.0.assume_init() };
        let place = std::ptr::from_mut(sample.user_header_mut()).cast::<SampleHeader>();
        // SAFETY: the topic was opened with this type of its header.
        unsafe { place.write(header) };
        let sent = sample.send().is_ok();
        if let Some(notifier) = &self.notifier {
            // A reader that is busy has not fetched its last wake-up yet: it will look anyway.
            let _already_awake = notifier.notify();
        }
        sent
    }

    pub(crate) fn connect(&self) {
        let _not_yet = self.publisher.update_connections();
    }
}

/// A received sample.
pub(crate) struct Sample(iceoryx2::sample::Sample<ipc::Service, Bytes, Header>);

impl Sample {
    pub(crate) fn header(&self) -> &SampleHeader {
        // SAFETY: the topic was opened with this type of its header, which the sample keeps mapped.
        unsafe { &*std::ptr::from_ref(self.0.user_header()).cast() }
    }

    pub(crate) fn bytes(&self) -> *const u8 {
        self.0.payload().as_ptr().cast()
    }
}

/// A topic opened for reading.
pub(crate) struct Subscriber(iceoryx2::port::subscriber::Subscriber<ipc::Service, Bytes, Header>);

impl Subscriber {
    pub(crate) fn receive(&mut self) -> Option<Sample> {
        self.0.receive().ok().flatten().map(Sample)
    }
}

/// A topic opened for reading by a program that does not know its payload.
pub struct RawInput {
    subscriber: Subscriber,
    type_name: String,
    size: usize,
}

impl fmt::Debug for RawInput {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "RawInput({}, {} bytes)", self.type_name, self.size)
    }
}

impl RawInput {
    /// The type name of its payload, as the programs that use it have it.
    pub fn type_name(&self) -> &str {
        &self.type_name
    }

    /// Size of its payload (bytes).
    pub fn size(&self) -> usize {
        self.size
    }

    /// Hands every unread sample to `visit`, oldest first.
    pub fn each(&mut self, mut visit: impl FnMut(&SampleHeader, &[u8])) {
        while let Some(sample) = self.subscriber.receive() {
            // SAFETY: the service was opened with this size of its payload, and the sample keeps the memory mapped. Whoever opens
            // a service with another size is refused.
            let bytes = unsafe { std::slice::from_raw_parts(sample.bytes(), self.size) };
            visit(sample.header(), bytes);
        }
    }
}

/// The wake-ups of a topic: a file descriptor, next to sockets and serial ports.
pub(crate) struct Wakeup(Listener<ipc::Service>);

impl Wakeup {
    pub(crate) fn fd(&self) -> BorrowedFd<'_> {
        // SAFETY: the listener owns the descriptor and keeps it open as long as it lives, which the borrow enforces.
        unsafe { BorrowedFd::borrow_raw(self.0.file_descriptor().native_handle()) }
    }

    pub(crate) fn clear(&self) {
        // An error here means a wake-up less, not data lost: samples are fetched from their own queue.
        let _signals = self.0.try_wait(|_| {});
    }
}

fn header_type() -> TypeDetail {
    TypeDetail::new::<SampleHeader>(TypeVariant::FixedSize)
}

fn service_name(name: &str) -> Result<ServiceName, OpenError> {
    ServiceName::new(name).map_err(|error| transport(name, &error))
}

fn refused<E: Place + fmt::Debug>(topic: &str, error: &E) -> OpenError {
    match error.is_taken() {
        true => OpenError::Taken {
            topic: topic.to_owned(),
            cause: format!("{error:?}"),
        },
        false => transport(topic, error),
    }
}

fn transport(topic: &str, error: &impl fmt::Debug) -> OpenError {
    OpenError::Transport {
        topic: topic.to_owned(),
        cause: format!("{error:?}"),
    }
}

/// Tries `open` again while the answer is one that passes by itself.
fn retry<T, E: Passing>(mut open: impl FnMut() -> Result<T, E>) -> Result<T, E> {
    let mut attempt = 0;
    loop {
        match open() {
            Err(error) if attempt < OPEN_ATTEMPTS && error.passes_by_itself() => {
                attempt += 1;
                std::thread::sleep(OPEN_RETRY);
            }
            answer => return answer,
        }
    }
}

/// An answer to an attempt to get a place in a topic.
trait Place {
    /// Whether all are taken.
    fn is_taken(&self) -> bool;
}

impl Place for PublisherCreateError {
    fn is_taken(&self) -> bool {
        matches!(self, Self::ExceedsMaxSupportedPublishers)
    }
}

impl Place for SubscriberCreateError {
    fn is_taken(&self) -> bool {
        matches!(self, Self::ExceedsMaxSupportedSubscribers)
    }
}

impl Place for NotifierCreateError {
    fn is_taken(&self) -> bool {
        matches!(self, Self::ExceedsMaxSupportedNotifiers)
    }
}

impl Place for ListenerCreateError {
    fn is_taken(&self) -> bool {
        matches!(self, Self::ExceedsMaxSupportedListeners)
    }
}

impl Place for PublishSubscribeOpenOrCreateError {
    fn is_taken(&self) -> bool {
        use PublishSubscribeOpenError::ExceedsMaxNumberOfNodes;
        matches!(self, Self::PublishSubscribeOpenError(ExceedsMaxNumberOfNodes))
    }
}

impl Place for EventOpenOrCreateError {
    fn is_taken(&self) -> bool {
        matches!(
            self,
            Self::EventOpenError(EventOpenError::ExceedsMaxNumberOfNodes)
        )
    }
}

/// An answer to an attempt to open a topic.
trait Passing {
    /// Whether it is due to somebody who is creating or removing the topic at this moment.
    fn passes_by_itself(&self) -> bool;
}

impl Passing for PublishSubscribeOpenOrCreateError {
    fn passes_by_itself(&self) -> bool {
        use PublishSubscribeCreateError as Create;
        use PublishSubscribeOpenError as Open;
        match self {
            Self::PublishSubscribeOpenError(open) => matches!(
                open,
                Open::DoesNotExist
                    | Open::HangsInCreation
                    | Open::ServiceInCorruptedState
                    | Open::IsMarkedForDestruction
            ),
            Self::PublishSubscribeCreateError(create) => matches!(
                create,
                Create::AlreadyExists
                    | Create::IsBeingCreatedByAnotherInstance
                    | Create::HangsInCreation
                    | Create::ServiceInCorruptedState
            ),
            Self::SystemInFlux => true,
        }
    }
}

impl Passing for EventOpenOrCreateError {
    fn passes_by_itself(&self) -> bool {
        use EventCreateError as Create;
        use EventOpenError as Open;
        match self {
            Self::EventOpenError(open) => matches!(
                open,
                Open::DoesNotExist
                    | Open::HangsInCreation
                    | Open::ServiceInCorruptedState
                    | Open::IsMarkedForDestruction
            ),
            Self::EventCreateError(create) => matches!(
                create,
                Create::AlreadyExists
                    | Create::IsBeingCreatedByAnotherInstance
                    | Create::ServiceInCorruptedState
            ),
            Self::SystemInFlux => true,
        }
    }
}
