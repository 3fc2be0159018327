//! Events for the pilot: one line per change of state, in the log and on the event topic.

use crate::output::Output;
use jink_shared_types::coded::Wire;
use jink_shared_types::events::{Event, EventSample, Severity};
use jink_shared_types::health::Name;
use jink_shared_types::{SampleHeader, Timestamp};

/// Events of a first cycle that are kept until the topic is open.
const WAITING_MAX: usize = 16;

/// One process's side of the event topic. Until it is connected, events wait.
#[derive(Debug)]
pub struct EventSender {
    output: Option<Output<EventSample>>,
    waiting: Vec<(Timestamp, EventSample)>,
    process: Name,
}

impl EventSender {
    /// Of `process`, not connected.
    pub(crate) fn new(process: &str) -> Self {
        Self {
            output: None,
            waiting: Vec::with_capacity(WAITING_MAX),
            process: Name::new(process),
        }
    }

    /// Publishes on `output` from now on, first what has waited.
    pub(crate) fn connect(&mut self, output: Output<EventSample>) {
        let output = self.output.insert(output);
        for (time, sample) in self.waiting.drain(..) {
            output.send(SampleHeader::at(time), &sample);
        }
    }

    /// Publishes that `event` happened at `now`, about `name`, with `numbers`.
    pub fn raise(&mut self, now: Timestamp, event: &Event, name: &str, numbers: [f64; 2]) {
        self.publish(now, &EventSample::new(event, name, numbers));
    }

    /// Publishes a finished event, as the pure steps return them.
    pub fn publish(&mut self, now: Timestamp, sample: &EventSample) {
        let text = sample.text();
        let (event, numbers) = (sample.id, sample.unsaid_numbers().map(tracing::field::debug));
        match sample.severity.get() {
            Severity::Debug => tracing::debug!(event, numbers, "{text}"),
            Severity::Info | Severity::Notice => tracing::info!(event, numbers, "{text}"),
            Severity::Warning => tracing::warn!(event, numbers, "{text}"),
            severity => tracing::error!(event, numbers, severity = severity.name(), "{text}"),
        }
        let sample = EventSample {
            process: self.process,
            ..*sample
        };
        match &mut self.output {
            Some(output) => {
                output.send(SampleHeader::at(now), &sample);
            }
            None if self.waiting.len() < WAITING_MAX => self.waiting.push((now, sample)),
            // It is in the log.
            None => {}
        }
    }
}
