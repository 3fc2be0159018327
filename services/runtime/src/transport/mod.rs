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

//! Neither knows the type of a payload, only its [`PayloadType`]: so they are compiled once, not for each payload in each program.
#![allow(unsafe_code)]

pub(crate) mod local;
mod pool;
pub(crate) mod shared;

use jink_shared_types::SampleHeader;
use jink_shared_types::layout::{Layout, type_name};
use std::cell::Cell;
use std::os::fd::BorrowedFd;
use std::rc::Rc;

/// What a topic carries, as the transport sees it.
#[derive(Clone, Copy)]
pub(crate) struct PayloadType {
    /// With its layout hash.
    pub(crate) name: &'static str,
    /// Bytes.
    pub(crate) size: usize,
    pub(crate) align: usize,
    is_plausible: fn(&Sealed) -> bool,
}

/// A payload of the type that its [`PayloadType`] names.
pub(crate) struct Sealed(*const u8);

impl PayloadType {
    pub(crate) fn of<T: Layout>() -> Self {
        const {
            assert!(
                align_of::<T>() <= align_of::<u64>(),
                "slots have the alignment of u64"
            );
        };
        Self {
            name: type_name::<T>(),
            size: size_of::<T>(),
            align: align_of::<T>(),
            // SAFETY: only a payload of this type is sealed with it.
            is_plausible: |payload| unsafe { &*payload.0.cast::<T>() }.is_plausible(),
        }
    }

    /// A payload that this program knows by name and size only. The name is kept for as long as the program runs.
    pub(crate) fn raw(name: &str, size: usize) -> Self {
        Self {
            name: Box::leak(name.to_owned().into_boxed_str()),
            size,
            align: align_of::<u64>(),
            is_plausible: |_| true,
        }
    }
}

/// The user header in `bytes`: as many as it has, or zeros.
pub(crate) fn header_of(bytes: &[u8]) -> SampleHeader {
    if bytes.len() != size_of::<SampleHeader>() {
        return SampleHeader::default();
    }
    // SAFETY: there are as many bytes as a header has, and `Layout` promises that every bit pattern is a valid one.
    unsafe { bytes.as_ptr().cast::<SampleHeader>().read_unaligned() }
}

/// One topic's samples, as they are sent.
pub(crate) struct Publisher {
    payload: PayloadType,
    port: PublisherPort,
}

pub(crate) enum PublisherPort {
    Shared(Box<shared::Publisher>),
    Local(local::Publisher),
}

impl Publisher {
    pub(crate) fn new(payload: PayloadType, port: PublisherPort) -> Self {
        Self { payload, port }
    }

    /// Memory for a sample: that of an older one, or zeros. `None` if there is none left.
    pub(crate) fn loan(&mut self) -> Option<Loan> {
        match &mut self.port {
            PublisherPort::Shared(publisher) => publisher.loan().map(Loan::Shared),
            PublisherPort::Local(publisher) => Some(Loan::Local(publisher.loan())),
        }
    }

    /// Whether a loaned sample can be used ([`Layout::is_plausible`]).
    pub(crate) fn is_plausible(&self, loan: &mut Loan) -> bool {
        (self.payload.is_plausible)(&Sealed(loan.payload()))
    }

    /// Sends a loaned sample and wakes its readers, or drops it if it has no header. Returns whether that has worked.
    pub(crate) fn send(&mut self, loan: Loan, header: Option<SampleHeader>) -> bool {
        match (&mut self.port, loan) {
            (PublisherPort::Shared(publisher), Loan::Shared(loan)) => {
                header.is_none_or(|header| publisher.send(loan, header))
            }
            (PublisherPort::Local(publisher), Loan::Local(slot)) => {
                publisher.send(slot, header);
                true
            }
            _ => false,
        }
    }

    /// Connects to readers that have come since the last sample.
    pub(crate) fn connect(&self) {
        if let PublisherPort::Shared(publisher) = &self.port {
            publisher.connect();
        }
    }
}

/// Memory for a sample.
pub(crate) enum Loan {
    Shared(shared::Loan),
    Local(Rc<local::Slot>),
}

impl Loan {
    fn payload(&mut self) -> *mut u8 {
        match self {
            Self::Shared(loan) => loan.payload(),
            // Nobody else holds a slot that is loaned: nothing is copied.
            Self::Local(slot) => Rc::make_mut(slot).payload.as_mut_ptr().cast(),
        }
    }

    /// # Safety
    /// It is a loan of a publisher of `T`.
    pub(crate) unsafe fn payload_mut<T: Layout>(&mut self) -> &mut T {
        // SAFETY: the memory has size and alignment of a `T`, it was initialised by zeros or by an older sample, and `Layout`
        // promises that every bit pattern is a valid `T`.
        unsafe { &mut *self.payload().cast::<T>() }
    }
}

/// One topic's samples, as they are received.
pub(crate) struct Subscriber {
    payload: PayloadType,
    port: SubscriberPort,
}

pub(crate) enum SubscriberPort {
    Shared(shared::Subscriber),
    Local(local::Subscriber),
}

impl Subscriber {
    pub(crate) fn new(payload: PayloadType, port: SubscriberPort) -> Self {
        Self { payload, port }
    }

    /// The next unread sample.
    pub(crate) fn receive(&mut self) -> Option<Sample> {
        match &mut self.port {
            SubscriberPort::Shared(subscriber) => subscriber.receive().map(Sample::Shared),
            SubscriberPort::Local(subscriber) => subscriber.receive().map(Sample::Local),
        }
    }

    /// Whether a received sample can be used ([`Layout::is_plausible`]).
    pub(crate) fn is_plausible(&self, sample: &Sample) -> bool {
        (self.payload.is_plausible)(&Sealed(sample.bytes()))
    }
}

/// A sample that was received and stays as it is while this lives.
pub(crate) enum Sample {
    Shared(shared::Sample),
    Local(Rc<local::Slot>),
}

impl Sample {
    pub(crate) fn header(&self) -> &SampleHeader {
        match self {
            Self::Shared(sample) => sample.header(),
            Self::Local(slot) => &slot.header,
        }
    }

    fn bytes(&self) -> *const u8 {
        match self {
            Self::Shared(sample) => sample.bytes(),
            Self::Local(slot) => slot.payload.as_ptr().cast(),
        }
    }

    /// # Safety
    /// It was received by a subscriber of `T`.
    pub(crate) unsafe fn payload<T: Layout>(&self) -> &T {
        // SAFETY: a topic opens only for a `T` of the same name, size and alignment, the sample keeps the memory, and `Layout`
        // promises that every bit pattern is a valid `T`.
        unsafe { &*self.bytes().cast::<T>() }
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
