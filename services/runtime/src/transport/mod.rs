//! How samples travel: through iceoryx2's shared memory between processes, or through slots within one process.
//!
//! Ports ([`crate::Input`], [`crate::Output`]) and the loop know only this module, so a service runs unchanged in both.
//!
//! | | between processes ([`shared`]) | within one process ([`local`]) |
//! |---|---|---|
//! | memory | loaned from a segment of the publisher's | reference-counted, used again |
//! | queue | per connection, the oldest sample is overwritten | the same |
//! | a late reader | finds the last sample of each live publisher | the same |
//! | wake-up | file descriptor | flag |
//! | another layout under the same name | refused | refused |
//! | clock | CLOCK_MONOTONIC | as it is set |

pub(crate) mod local;
pub(crate) mod shared;

use jink_shared_types::SampleHeader;
use jink_shared_types::layout::Layout;
use std::cell::Cell;
use std::os::fd::BorrowedFd;
use std::rc::Rc;

/// One topic's samples, as they are sent.
pub(crate) enum Publisher<T: Layout> {
    Shared(Box<shared::Publisher<T>>),
    Local(local::Publisher<T>),
}

impl<T: Layout> Publisher<T> {
    /// Lets `fill` write the payload over that of an older sample. If `seal` then answers with a header, the sample is sent
    /// and its readers are woken. Returns whether there was memory for it.
    pub(crate) fn write(
        &mut self,
        fill: impl FnOnce(&mut T),
        seal: impl FnOnce(&T) -> Option<SampleHeader>,
    ) -> bool {
        match self {
            Self::Shared(publisher) => publisher.write(fill, seal),
            Self::Local(publisher) => publisher.write(fill, seal),
        }
    }

    /// Connects to readers that have come since the last sample.
    pub(crate) fn connect(&self) {
        if let Self::Shared(publisher) = self {
            publisher.connect();
        }
    }
}

/// One topic's samples, as they are received.
pub(crate) enum Subscriber<T: Layout> {
    Shared(shared::Subscriber<T>),
    Local(local::Subscriber<T>),
}

impl<T: Layout> Subscriber<T> {
    /// The next unread sample.
    pub(crate) fn receive(&mut self) -> Option<Sample<T>> {
        match self {
            Self::Shared(subscriber) => subscriber.receive().map(Sample::Shared),
            Self::Local(subscriber) => subscriber.receive().map(Sample::Local),
        }
    }
}

/// A sample that was received and stays as it is while this lives.
pub(crate) enum Sample<T: Layout> {
    Shared(shared::Sample<T>),
    Local(Rc<local::Slot<T>>),
}

impl<T: Layout> Sample<T> {
    pub(crate) fn header(&self) -> &SampleHeader {
        match self {
            Self::Shared(sample) => sample.user_header(),
            Self::Local(slot) => &slot.header,
        }
    }

    pub(crate) fn payload(&self) -> &T {
        match self {
            Self::Shared(sample) => sample.payload(),
            Self::Local(slot) => &slot.payload,
        }
    }
}

/// Says that a topic has a new sample.
pub(crate) enum Wakeup {
    Shared(Box<shared::Wakeup>),
    Local(Rc<Cell<bool>>),
}

impl Wakeup {
    /// Readable when there is something new; `None` within one process.
    pub(crate) fn fd(&self) -> Option<BorrowedFd<'_>> {
        match self {
            Self::Shared(wakeup) => Some(wakeup.fd()),
            Self::Local(_) => None,
        }
    }

    /// Whether something is new, within one process.
    pub(crate) fn is_set(&self) -> bool {
        matches!(self, Self::Local(flag) if flag.get())
    }

    /// Takes what has been signalled, so that the next sample wakes again.
    pub(crate) fn clear(&self) {
        match self {
            Self::Shared(wakeup) => wakeup.clear(),
            Self::Local(flag) => flag.set(false),
        }
    }
}
