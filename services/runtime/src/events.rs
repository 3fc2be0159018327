//! News for the pilot: one line per change of state, in the log and on the event topic.

use crate::output::Output;
use jink_shared_types::coded::Wire;
use jink_shared_types::events::{Event, EventSample, Severity};
use jink_shared_types::health::Name;
use jink_shared_types::{SampleHeader, Timestamp};

/// One process's side of the event topic.
#[derive(Debug)]
pub struct EventSender {
    output: Output<EventSample>,
    process: Name,
}

impl EventSender {
    pub(crate) fn new(output: Output<EventSample>, process: Name) -> Self {
        Self { output, process }
    }

    /// Tells everybody that `event` happened at `now`, about `name`, with `numbers`.
    pub fn raise(&mut self, now: Timestamp, event: &Event, name: &str, numbers: [f64; 2]) {
        self.publish(now, &EventSample::new(event, name, numbers));
    }

    /// Publishes a finished event, as the pure steps return them.
    pub fn publish(&mut self, now: Timestamp, sample: &EventSample) {
        let text = sample.text();
        match sample.severity.get() {
            Severity::Debug => tracing::debug!(event = sample.id, "{text}"),
            Severity::Info | Severity::Notice => tracing::info!(event = sample.id, "{text}"),
            Severity::Warning => tracing::warn!(event = sample.id, "{text}"),
            severity => tracing::error!(event = sample.id, severity = severity.name(), "{text}"),
        }
        let sample = EventSample {
            process: self.process,
            ..*sample
        };
        self.output.send(SampleHeader::at(now), &sample);
    }
}
