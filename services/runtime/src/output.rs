//! A topic as its producer sees it.

use crate::clock::Clock;
use crate::ownership::Ownership;
use crate::transport::{Loan, Publisher};
use jink_shared_types::layout::Layout;
use jink_shared_types::{SampleHeader, Timestamp};
use std::fmt;
use std::marker::PhantomData;
use std::rc::Rc;

/// A topic opened for publishing.
pub struct Output<T> {
    port: OutputPort,
    payload: PhantomData<fn(T)>,
}

impl<T> fmt::Debug for Output<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "Output(generation {}, {} sent)",
            self.port.generation, self.port.count
        )
    }
}

impl<T: Layout> Output<T> {
    /// `publisher` is one of samples of `T`.
    pub(crate) fn new(publisher: Publisher, clock: Clock, generation: u32) -> Self {
        Self {
            port: OutputPort {
                publisher,
                clock,
                generation,
                count: 0,
                ownership: None,
                deadline_us: 0,
            },
            payload: PhantomData,
        }
    }

    /// Publishes only what `ownership` owns, and counts everything in it.
    pub(crate) fn with_ownership(mut self, ownership: &Rc<Ownership>) -> Self {
        self.port.ownership = Some(Rc::clone(ownership));
        self
    }

    /// Says with every sample that it is stale at this age from its capture (us).
    pub(crate) fn with_deadline_us(mut self, deadline_us: u32) -> Self {
        self.port.deadline_us = deadline_us;
        self
    }

    /// Publishes a copy of `payload` and wakes its readers. For payloads up to some KiB.
    /// Returns whether the sample left: shared memory may be exhausted by readers that hold too much.
    pub fn send(&mut self, header: SampleHeader, payload: &T) -> bool
    where
        T: Copy,
    {
        self.write(header, |slot| *slot = *payload)
    }

    /// Lets `fill` write the payload where the readers will find it, then publishes it and wakes them. The memory
    /// holds an older sample: `fill` must write every field that counts. An instance that does not own the present
    /// cycle does everything but publish.
    pub fn write(&mut self, header: SampleHeader, fill: impl FnOnce(&mut T)) -> bool {
        let Some(mut loan) = self.port.publisher.loan() else {
            return false;
        };
        #[allow(unsafe_code)]
        // SAFETY: the publisher is one of samples of `T`.
        fill(unsafe { loan.payload_mut() });
        self.port.publish(loan, header)
    }

    /// Lets readers that came after the last sample find it.
    pub fn announce(&self) {
        self.port.publisher.connect();
    }
}

/// What is the same for every payload.
struct OutputPort {
    publisher: Publisher,
    clock: Clock,
    generation: u32,
    count: u32,
    ownership: Option<Rc<Ownership>>,
    /// Of a source of measurements.
    deadline_us: u32,
}

impl OutputPort {
    fn publish(&mut self, mut loan: Loan, header: SampleHeader) -> bool {
        let publish = self.clock.now();
        // In the high half of the sequence, so that it only ever grows.
        let mut epoch = self.generation;
        let mut busy_us = 0;
        if let Some(ownership) = &self.ownership {
            ownership.count(&header, publish, self.publisher.is_plausible(&mut loan));
            if !ownership.owns_cycle() {
                return self.publisher.send(loan, None);
            }
            epoch = ownership.epoch();
            busy_us = ownership.busy_us(header.publish);
        }
        self.count = self.count.wrapping_add(1);
        let header = SampleHeader {
            sequence: u64::from(epoch) << 32 | u64::from(self.count),
            generation: self.generation,
            deadline_us: self.deadline_us,
            ..header
        };
        self.publisher
            .send(loan, Some(published(header, publish, busy_us)))
    }
}

/// `header` with its publication, and the end of the stage that made the sample, which was busy with something else for `busy_us` when
/// its input was published.
pub(crate) fn published(mut header: SampleHeader, publish: Timestamp, busy_us: u32) -> SampleHeader {
    header.publish = publish;
    for (stage, busy) in header.stages.iter_mut().zip(&mut header.busy_us) {
        if stage.begin.is_set() && !stage.end.is_set() {
            stage.end = publish;
            *busy = busy_us;
        }
    }
    header
}
