//! Within one process: topics as slots, time as it is set. Nothing here waits, and nothing depends on the machine.

use crate::open_error::OpenError;
use jink_shared_types::layout::{Layout, type_name};
use jink_shared_types::sample::zeroed_box;
use jink_shared_types::topics::Topic;
use jink_shared_types::{SampleHeader, Timestamp};
use std::any::Any;
use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, VecDeque};
use std::fmt;
use std::rc::{Rc, Weak};

/// The topics and the clock that the services of one process share.
#[derive(Clone)]
pub struct LocalBus(Rc<Inner>);

struct Inner {
    now: Cell<Timestamp>,
    topics: RefCell<BTreeMap<String, Box<dyn Any>>>,
    publishers: Cell<u64>,
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
        }))
    }

    /// What its clock says.
    pub fn now(&self) -> Timestamp {
        self.0.now.get()
    }

    /// Sets its clock. It never goes back.
    pub fn set_clock(&self, now: Timestamp) {
        self.0.now.set(self.now().max(now));
    }

    pub(crate) fn publisher<T: Layout>(
        &self,
        topic: &Topic<T>,
        name: &str,
    ) -> Result<Publisher<T>, OpenError> {
        let channel = self.channel::<T>(name)?;
        let last = Rc::new(RefCell::new(None));
        channel.publishers.borrow_mut().push(Rc::downgrade(&last));
        let number = self.0.publishers.get();
        self.0.publishers.set(number + 1);
        Ok(Publisher {
            channel,
            number,
            last,
            pool: Vec::new(),
            wakes: topic.row.wakes,
        })
    }

    pub(crate) fn subscriber<T: Layout>(
        &self,
        topic: &Topic<T>,
        name: &str,
    ) -> Result<Subscriber<T>, OpenError> {
        let channel = self.channel::<T>(name)?;
        let queue = Rc::new(Queue {
            buffer: topic.row.buffer,
            slots: RefCell::default(),
        });
        for last in channel.publishers.borrow().iter().filter_map(Weak::upgrade) {
            if let Some((number, slot)) = &*last.borrow() {
                queue.push(*number, slot);
            }
        }
        channel.queues.borrow_mut().push(Rc::downgrade(&queue));
        Ok(Subscriber(queue))
    }

    pub(crate) fn wakeup<T: Layout>(&self, name: &str) -> Result<Rc<Cell<bool>>, OpenError> {
        let flag = Rc::new(Cell::new(false));
        let channel = self.channel::<T>(name)?;
        channel.flags.borrow_mut().push(Rc::downgrade(&flag));
        Ok(flag)
    }

    fn channel<T: Layout>(&self, name: &str) -> Result<Rc<Channel<T>>, OpenError> {
        let mut topics = self.0.topics.borrow_mut();
        if let Some(found) = topics.get(name) {
            return found
                .downcast_ref::<Rc<Channel<T>>>()
                .cloned()
                .ok_or_else(|| OpenError::Layout {
                    topic: name.to_owned(),
                    ours: type_name::<T>(),
                });
        }
        let channel = Rc::new(Channel::<T> {
            queues: RefCell::default(),
            publishers: RefCell::default(),
            flags: RefCell::default(),
        });
        topics.insert(name.to_owned(), Box::new(Rc::clone(&channel)));
        Ok(channel)
    }
}

/// A sample in the memory of this process.
pub(crate) struct Slot<T> {
    pub(crate) header: SampleHeader,
    pub(crate) payload: Box<T>,
}

/// The newest sample of a publisher, with the publisher's number.
type Last<T> = RefCell<Option<(u64, Rc<Slot<T>>)>>;

/// One topic.
struct Channel<T> {
    queues: RefCell<Vec<Weak<Queue<T>>>>,
    publishers: RefCell<Vec<Weak<Last<T>>>>,
    flags: RefCell<Vec<Weak<Cell<bool>>>>,
}

/// What one reader has not read yet, with the publishers' numbers.
struct Queue<T> {
    buffer: usize,
    slots: RefCell<VecDeque<(u64, Rc<Slot<T>>)>>,
}

impl<T> Queue<T> {
    /// The oldest unread sample of the same publisher gives way.
    fn push(&self, publisher: u64, slot: &Rc<Slot<T>>) {
        let mut slots = self.slots.borrow_mut();
        let of_the_same = |(number, _): &&(u64, Rc<Slot<T>>)| *number == publisher;
        if slots.iter().filter(of_the_same).count() >= self.buffer
            && let Some(oldest) = slots.iter().position(|(number, _)| *number == publisher)
        {
            slots.remove(oldest);
        }
        slots.push_back((publisher, Rc::clone(slot)));
    }
}

/// A topic opened for publishing.
pub(crate) struct Publisher<T> {
    channel: Rc<Channel<T>>,
    number: u64,
    last: Rc<Last<T>>,
    /// Every sample ever made: those that nobody holds any more are used again.
    pool: Vec<Rc<Slot<T>>>,
    wakes: bool,
}

impl<T: Layout> Publisher<T> {
    pub(crate) fn write(
        &mut self,
        fill: impl FnOnce(&mut T),
        seal: impl FnOnce(&T) -> Option<SampleHeader>,
    ) -> bool {
        let mut slot = match self.pool.iter().position(|slot| Rc::strong_count(slot) == 1) {
            Some(free) => self.pool.swap_remove(free),
            None => Rc::new(Slot {
                header: SampleHeader::default(),
                payload: zeroed_box(),
            }),
        };
        let header = Rc::get_mut(&mut slot).and_then(|slot| {
            fill(&mut slot.payload);
            slot.header = seal(&slot.payload)?;
            Some(slot.header)
        });
        if header.is_some() {
            self.send(&slot);
        }
        self.pool.push(slot);
        true
    }

    fn send(&self, slot: &Rc<Slot<T>>) {
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
pub(crate) struct Subscriber<T>(Rc<Queue<T>>);

impl<T> Subscriber<T> {
    pub(crate) fn receive(&mut self) -> Option<Rc<Slot<T>>> {
        self.0.slots.borrow_mut().pop_front().map(|(_, slot)| slot)
    }
}
