//! Within one process: topics as slots, time as it is set. Nothing here waits, and nothing depends on the machine.

use super::PayloadType;
use crate::cycle_log::CycleLog;
use crate::open_error::OpenError;
use jink_shared_types::topics::TopicRow;
use jink_shared_types::{SampleHeader, Timestamp};
use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, VecDeque};
use std::fmt;
use std::rc::{Rc, Weak};

/// The topics and the clock that the services of one process share.
#[derive(Clone)]
pub struct LocalBus(Rc<Inner>);

struct Inner {
    now: Cell<Timestamp>,
    topics: RefCell<BTreeMap<String, Rc<Channel>>>,
    publishers: Cell<u64>,
    replayed: RefCell<Option<Rc<CycleLog>>>,
}

impl fmt::Debug for LocalBus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "LocalBus({} topics)", self.0.topics.borrow().len())
    }
}

impl LocalBus {
    /// No topics yet; its clock stands at `now`.
    pub fn new(now: Timestamp) -> Self {
        Self(Rc::new(Inner {
            now: Cell::new(now),
            topics: RefCell::default(),
            publishers: Cell::new(0),
            replayed: RefCell::default(),
        }))
    }

    /// Who opens topics from now on takes what another one took ([`CycleLog::follow`]), however much that is at once.
    pub(crate) fn replay(&self) -> Rc<CycleLog> {
        let log = Rc::new(CycleLog::replaying());
        self.0.replayed.replace(Some(Rc::clone(&log)));
        log
    }

    /// What is followed, if it is a replay.
    pub(crate) fn replayed(&self) -> Option<Rc<CycleLog>> {
        self.0.replayed.borrow().clone()
    }

    /// What its clock says.
    pub fn now(&self) -> Timestamp {
        self.0.now.get()
    }

    /// Sets its clock. It never goes back.
    pub fn set_clock(&self, now: Timestamp) {
        self.0.now.set(self.now().max(now));
    }

    pub(crate) fn publisher(
        &self,
        row: &TopicRow,
        name: &str,
        payload: PayloadType,
    ) -> Result<Publisher, OpenError> {
        Ok(self.publisher_on(self.channel(name, payload)?, row.wakes))
    }

    fn publisher_on(&self, channel: Rc<Channel>, wakes: bool) -> Publisher {
        let last = Rc::new(RefCell::new(None));
        channel.publishers.borrow_mut().push(Rc::downgrade(&last));
        let number = self.0.publishers.get();
        self.0.publishers.set(number + 1);
        Publisher {
            channel,
            number,
            last,
            pool: Vec::new(),
            wakes,
        }
    }

    pub(crate) fn subscriber(
        &self,
        row: &TopicRow,
        name: &str,
        payload: PayloadType,
    ) -> Result<Subscriber, OpenError> {
        let channel = self.channel(name, payload)?;
        let buffer = match self.replayed() {
            Some(_) => usize::MAX,
            None => row.buffer,
        };
        Ok(Self::subscriber_on(&channel, buffer))
    }

    fn subscriber_on(channel: &Channel, buffer: usize) -> Subscriber {
        let queue = Rc::new(Queue {
            buffer,
            slots: RefCell::default(),
        });
        for last in channel.publishers.borrow().iter().filter_map(Weak::upgrade) {
            if let Some((number, slot)) = &*last.borrow() {
                queue.push(*number, slot);
            }
        }
        channel.queues.borrow_mut().push(Rc::downgrade(&queue));
        Subscriber(queue)
    }

    /// A publisher of samples as bytes: of whatever the topic carries already, or of `payload`.
    pub(crate) fn raw_publisher(&self, name: &str, payload: PayloadType) -> Result<Publisher, OpenError> {
        Ok(self.publisher_on(self.channel(name, payload)?, true))
    }

    /// A subscriber to samples as bytes that keeps `buffer` of each publisher.
    pub(crate) fn raw_subscriber(
        &self,
        name: &str,
        payload: PayloadType,
        buffer: usize,
    ) -> Result<Subscriber, OpenError> {
        let channel = self.channel(name, payload)?;
        Ok(Self::subscriber_on(&channel, buffer))
    }

    /// The topics that have come into being.
    pub(crate) fn topics(&self) -> Vec<TopicUse> {
        let topics = self.0.topics.borrow();
        let used = |(name, channel): (&String, &Rc<Channel>)| TopicUse {
            name: name.clone(),
            payload: channel.payload,
            is_read: is_any_alive(&channel.queues),
            wakes: is_any_alive(&channel.flags),
            is_published: is_any_alive(&channel.publishers),
        };
        topics.iter().map(used).collect()
    }

    pub(crate) fn wakeup(&self, name: &str, payload: PayloadType) -> Result<Rc<Cell<bool>>, OpenError> {
        let flag = Rc::new(Cell::new(false));
        let channel = self.channel(name, payload)?;
        channel.flags.borrow_mut().push(Rc::downgrade(&flag));
        Ok(flag)
    }

    fn channel(&self, name: &str, payload: PayloadType) -> Result<Rc<Channel>, OpenError> {
        let mut topics = self.0.topics.borrow_mut();
        if let Some(found) = topics.get(name) {
            return match found.payload.name == payload.name {
                true => Ok(Rc::clone(found)),
                false => Err(OpenError::Layout {
                    topic: name.to_owned(),
                    ours: payload.name,
                }),
            };
        }
        let channel = Rc::new(Channel {
            payload,
            queues: RefCell::default(),
            publishers: RefCell::default(),
            flags: RefCell::default(),
        });
        topics.insert(name.to_owned(), Rc::clone(&channel));
        Ok(channel)
    }
}

/// Who uses a topic.
pub(crate) struct TopicUse {
    pub(crate) name: String,
    pub(crate) payload: PayloadType,
    pub(crate) is_read: bool,
    /// A new sample wakes somebody.
    pub(crate) wakes: bool,
    pub(crate) is_published: bool,
}

fn is_any_alive<T>(users: &RefCell<Vec<Weak<T>>>) -> bool {
    users.borrow().iter().any(|user| user.strong_count() > 0)
}

/// A sample in the memory of this process.
#[derive(Clone)]
pub(crate) struct Slot {
    pub(crate) header: SampleHeader,
    /// The payload, in units of the largest alignment that a payload has.
    pub(crate) payload: Box<[u64]>,
}

impl Slot {
    /// The first `size` bytes of the payload.
    pub(crate) fn bytes(&self, size: usize) -> &[u8] {
        let size = size.min(size_of_val::<[u64]>(&self.payload));
        // SAFETY: the memory belongs to the slot, is initialised, and any byte is a valid u8.
        unsafe { std::slice::from_raw_parts(self.payload.as_ptr().cast(), size) }
    }

    /// The whole payload, to be written to.
    fn bytes_mut(&mut self) -> &mut [u8] {
        let size = size_of_val::<[u64]>(&self.payload);
        // SAFETY: as for reading; any bytes are a valid [u64].
        unsafe { std::slice::from_raw_parts_mut(self.payload.as_mut_ptr().cast(), size) }
    }
}

/// The newest sample of a publisher, with the publisher's number.
type Last = RefCell<Option<(u64, Rc<Slot>)>>;

/// One topic.
struct Channel {
    payload: PayloadType,
    queues: RefCell<Vec<Weak<Queue>>>,
    publishers: RefCell<Vec<Weak<Last>>>,
    flags: RefCell<Vec<Weak<Cell<bool>>>>,
}

/// What one reader has not read yet, with the publishers' numbers.
struct Queue {
    buffer: usize,
    slots: RefCell<VecDeque<(u64, Rc<Slot>)>>,
}

impl Queue {
    /// The oldest unread sample of the same publisher gives way.
    fn push(&self, publisher: u64, slot: &Rc<Slot>) {
        let mut slots = self.slots.borrow_mut();
        let of_the_same = |(number, _): &&(u64, Rc<Slot>)| *number == publisher;
        if slots.iter().filter(of_the_same).count() >= self.buffer
            && let Some(oldest) = slots.iter().position(|(number, _)| *number == publisher)
        {
            slots.remove(oldest);
        }
        slots.push_back((publisher, Rc::clone(slot)));
    }
}

/// A topic opened for publishing.
pub(crate) struct Publisher {
    channel: Rc<Channel>,
    number: u64,
    last: Rc<Last>,
    /// Every sample ever made: those that nobody holds any more are used again.
    pool: Vec<Rc<Slot>>,
    wakes: bool,
}

impl Publisher {
    /// The memory of an older sample that nobody holds any more, or new memory, zeroed.
    pub(crate) fn loan(&mut self) -> Rc<Slot> {
        match self.pool.iter().position(|slot| Rc::strong_count(slot) == 1) {
            Some(free) => self.pool.swap_remove(free),
            None => Rc::new(Slot {
                header: SampleHeader::default(),
                payload: vec![0; self.channel.payload.size.div_ceil(size_of::<u64>())].into_boxed_slice(),
            }),
        }
    }

    /// Sends a loaned sample, or takes its memory back if it has no header.
    pub(crate) fn send(&mut self, mut slot: Rc<Slot>, header: Option<SampleHeader>) {
        if let (Some(loan), Some(header)) = (Rc::get_mut(&mut slot), header) {
            loan.header = header;
            self.deliver(&slot);
        }
        self.pool.push(slot);
    }

    /// Sends a sample made of bytes. Returns whether they are as many as the topic's payload has.
    pub(crate) fn send_bytes(&mut self, header: SampleHeader, payload: &[u8]) -> bool {
        let is_whole = payload.len() == self.channel.payload.size;
        let mut slot = self.loan();
        if let Some(slot) = Rc::get_mut(&mut slot).filter(|_| is_whole) {
            slot.bytes_mut()[..payload.len()].copy_from_slice(payload);
        }
        self.send(slot, is_whole.then_some(header));
        is_whole
    }

    fn deliver(&self, slot: &Rc<Slot>) {
        *self.last.borrow_mut() = Some((self.number, Rc::clone(slot)));
        self.channel.queues.borrow_mut().retain(|queue| {
            let queue = queue.upgrade();
            if let Some(queue) = &queue {
                queue.push(self.number, slot);
            }
            queue.is_some()
        });
        if self.wakes {
            self.channel.flags.borrow_mut().retain(|flag| {
                let flag = flag.upgrade();
                if let Some(flag) = &flag {
                    flag.set(true);
                }
                flag.is_some()
            });
        }
    }
}

/// A topic opened for reading.
pub(crate) struct Subscriber(Rc<Queue>);

impl Subscriber {
    pub(crate) fn is_empty(&self) -> bool {
        self.0.slots.borrow().is_empty()
    }

    pub(crate) fn receive(&mut self) -> Option<Rc<Slot>> {
        self.0.slots.borrow_mut().pop_front().map(|(_, slot)| slot)
    }
}
