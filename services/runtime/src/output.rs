//! A topic as its producer sees it.

use crate::clock::Clock;
use crate::ownership::Ownership;
use crate::transport::Publisher;
use jink_shared_types::layout::Layout;
use jink_shared_types::{SampleHeader, Timestamp};
use std::fmt;
use std::rc::Rc;

/// A topic opened for publishing.
pub struct Output<T: Layout> {
    publisher: Publisher<T>,
    clock: Clock,
    generation: u32,
    count: u32,
    ownership: Option<Rc<Ownership>>,
    /// Of a source of measurements.
    deadline_us: u32,
}

impl<T: Layout> fmt::Debug for Output<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Output(generation {}, {} sent)", self.generation, self.count)
    }
}

impl<T: Layout> Output<T> {
    pub(crate) fn new(publisher: Publisher<T>, clock: Clock, generation: u32) -> Self {
        Self {
            publisher,
            clock,
            generation,
            count: 0,
            ownership: None,
            deadline_us: 0,
        }
    }

    /// Publishes only what `ownership` owns, and counts everything in it.
    pub(crate) fn with_ownership(mut self, ownership: &Rc<Ownership>) -> Self {
        self.ownership = Some(Rc::clone(ownership));
        self
    }

    /// Says with every sample that it is stale at this age from its capture (us).
    pub(crate) fn with_deadline_us(mut self, deadline_us: u32) -> Self {
        self.deadline_us = deadline_us;
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
        let Self {
            publisher,
            clock,
            generation,
            count,
            ownership,
            deadline_us,
        } = self;
        publisher.write(fill, |payload| {
            let publish = clock.now();
            if let Some(ownership) = ownership {
                ownership.count(&header, publish, payload.is_plausible());
                if !ownership.owns_cycle() {
                    return None;
                }
            }
            *count = count.wrapping_add(1);
            // In the high half of the sequence, so that it only ever grows.
            let epoch = ownership
                .as_ref()
                .map_or(*generation, |ownership| ownership.epoch());
            let busy_us = ownership
                .as_ref()
                .map_or(0, |ownership| ownership.busy_us(header.publish));
            let header = SampleHeader {
                sequence: u64::from(epoch) << 32 | u64::from(*count),
                generation: *generation,
                deadline_us: *deadline_us,
                ..header
            };
            Some(published(header, publish, busy_us))
        })
    }

    /// Lets readers that came after the last sample find it.
    pub fn announce(&self) {
        self.publisher.connect();
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
