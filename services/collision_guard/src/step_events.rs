//! The events of one step for the pilot.

use jink_shared_types::events::EventSample;

/// Most events of one step: ranges, a brake, a release.
const EVENTS: usize = 4;

/// The events of one step, in the order in which they happened.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepEvents {
    events: [EventSample; EVENTS],
    len: usize,
}

impl StepEvents {
    pub(crate) fn add(&mut self, event: EventSample) {
        if let Some(slot) = self.events.get_mut(self.len) {
            *slot = event;
            self.len += 1;
        }
    }

    /// The events.
    pub fn events(&self) -> &[EventSample] {
        &self.events[..self.len.min(EVENTS)]
    }
}
