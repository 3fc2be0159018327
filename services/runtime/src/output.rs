//! A topic as its producer sees it.

use crate::duty::Duty;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::ipc;
use jink_shared_types::layout::Layout;
use jink_shared_types::{SampleHeader, Timestamp};
use std::fmt;
use std::rc::Rc;

/// A topic opened for publishing.
pub struct Output<T: Layout> {
    publisher: Publisher<ipc::Service, T, SampleHeader>,
    /// Of a topic that wakes its readers.
    notifier: Option<Notifier<ipc::Service>>,
    generation: u32,
    count: u32,
    duty: Option<Rc<Duty>>,
}

impl<T: Layout> fmt::Debug for Output<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Output(generation {}, {} sent)", self.generation, self.count)
    }
}

impl<T: Layout> Output<T> {
    pub(crate) fn new(
        publisher: Publisher<ipc::Service, T, SampleHeader>,
        notifier: Option<Notifier<ipc::Service>>,
        generation: u32,
    ) -> Self {
        // Connect to the readers that are there already; others are found at the next sample.
        let _not_yet = publisher.update_connections();
        Self {
            publisher,
            notifier,
            generation,
            count: 0,
            duty: None,
        }
    }

    /// Publishes only what `duty` owns, and counts everything in it.
    pub(crate) fn with_duty(mut self, duty: &Rc<Duty>) -> Self {
        self.duty = Some(Rc::clone(duty));
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
        let Ok(mut loan) = self.publisher.loan_uninit() else {
            return false;
        };
        #[allow(unsafe_code)]
        // SAFETY: the memory is mapped shared memory, initialised by the kernel or by an older sample, and `Layout`
        // promises that every bit pattern is a valid `T`.
        fill(unsafe { loan.payload_mut().assume_init_mut() });
        let publish = crate::now();
        #[allow(unsafe_code)]
        // SAFETY: as above.
        let mut sample = unsafe { loan.assume_init() };
        if let Some(duty) = &self.duty {
            duty.count(&header, publish, sample.payload().is_plausible());
            if !duty.owns_cycle() {
                return true;
            }
        }
        self.count = self.count.wrapping_add(1);
        *sample.user_header_mut() = self.stamp(header, publish);
        let sent = sample.send().is_ok();
        if let Some(notifier) = &self.notifier {
            // A reader that is busy has not fetched its last wake-up yet: it will look anyway.
            let _already_awake = notifier.notify();
        }
        sent
    }

    /// Lets readers that came after the last sample find it.
    pub fn greet(&self) {
        let _not_yet = self.publisher.update_connections();
    }

    /// Completes the header: sequence (the epoch in the high half, so that it only ever grows), publication, and the
    /// end of the stage that made it.
    fn stamp(&self, mut header: SampleHeader, publish: Timestamp) -> SampleHeader {
        let epoch = self.duty.as_ref().map_or(self.generation, |duty| duty.epoch());
        header.sequence = u64::from(epoch) << 32 | u64::from(self.count);
        header.generation = self.generation;
        header.publish = publish;
        for stage in &mut header.stages {
            if stage.begin.is_set() && !stage.end.is_set() {
                stage.end = publish;
            }
        }
        header
    }
}
