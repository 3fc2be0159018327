//! Events as STATUSTEXT: one line per change, never a flood.
//!
//! Lines wait in a short queue and leave at [`RATE_HZ`]; the same event about the same process is said once within
//! [`REPEAT_S`]; a full queue drops the least severe line. Events happen on change, so this is the one place of the gateway
//! that formats text.

use crate::ticker::Ticker;
use jink_shared_types::Timestamp;
use jink_shared_types::events::{EventSample, Severity};
use jink_shared_types::health::Name;
use mavlink::dialects::ardupilotmega::{MavMessage, MavSeverity, STATUSTEXT_DATA};
use mavlink::types::CharArray;

/// Length of a line (bytes); longer texts would need chunks, which not every ground station puts together.
pub const LINE_BYTES: usize = 50;

/// Lines per second (Hz): what a pilot can read.
const RATE_HZ: f64 = 4.0;
/// Lines that wait at most.
const QUEUE: usize = 16;
/// The same line is not said again within this time (s).
const REPEAT_S: f64 = 2.0;
/// Lines remembered for that.
const REMEMBERED: usize = 16;

#[derive(Clone, Copy, Debug)]
struct Said {
    id: u16,
    name: Name,
    time: Timestamp,
}

/// Lines on their way to the pilot.
#[derive(Clone, Debug)]
pub struct Texts {
    queue: Vec<EventSample>,
    said: Vec<Said>,
    ticker: Ticker,
}

impl Default for Texts {
    fn default() -> Self {
        Self {
            queue: Vec::with_capacity(QUEUE),
            said: Vec::with_capacity(REMEMBERED),
            ticker: Ticker::new(RATE_HZ),
        }
    }
}

impl Texts {
    /// Queues an event, unless the same was queued a moment ago or it is for logs only.
    pub fn push(&mut self, now: Timestamp, event: &EventSample) {
        if event.severity == Severity::Debug || self.was_said(now, event) {
            return;
        }
        if self.queue.len() == QUEUE {
            let least = (0..QUEUE).rev().max_by_key(|i| urgency(&self.queue[*i]));
            match least {
                Some(least) if urgency(&self.queue[least]) > urgency(event) => {
                    self.queue.remove(least);
                }
                _ => return,
            }
        }
        self.queue.push(*event);
        if self.said.len() == REMEMBERED {
            self.said.remove(0);
        }
        self.said.push(Said {
            id: event.id,
            name: event.name,
            time: now,
        });
    }

    fn was_said(&self, now: Timestamp, event: &EventSample) -> bool {
        self.said.iter().any(|said| {
            said.id == event.id && said.name == event.name && now.seconds_since(said.time) < REPEAT_S
        })
    }

    /// The next line, if one waits and the rate allows it.
    pub fn next(&mut self, now: Timestamp) -> Option<MavMessage> {
        if self.queue.is_empty() || now < self.ticker.due() {
            return None;
        }
        self.ticker.restart(now);
        Some(line(&self.queue.remove(0)))
    }

    /// When the next line may leave; `None` if nothing waits.
    pub fn next_wake(&self) -> Option<Timestamp> {
        (!self.queue.is_empty()).then(|| self.ticker.due())
    }
}

/// MAV_SEVERITY as a number: smaller is more urgent.
fn urgency(event: &EventSample) -> u8 {
    event.severity.get() as u8
}

fn line(event: &EventSample) -> MavMessage {
    let text = event.text();
    let mut end = text.len().min(LINE_BYTES);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    let mut bytes = [0; LINE_BYTES];
    bytes[..end].copy_from_slice(&text.as_bytes()[..end]);
    MavMessage::STATUSTEXT(STATUSTEXT_DATA {
        severity: match event.severity.get() {
            Severity::Emergency => MavSeverity::MAV_SEVERITY_EMERGENCY,
            Severity::Alert => MavSeverity::MAV_SEVERITY_ALERT,
            Severity::Critical => MavSeverity::MAV_SEVERITY_CRITICAL,
            Severity::Error => MavSeverity::MAV_SEVERITY_ERROR,
            Severity::Warning => MavSeverity::MAV_SEVERITY_WARNING,
            Severity::Notice => MavSeverity::MAV_SEVERITY_NOTICE,
            Severity::Info => MavSeverity::MAV_SEVERITY_INFO,
            Severity::Debug => MavSeverity::MAV_SEVERITY_DEBUG,
        },
        text: CharArray::new(bytes),
        id: 0,
        chunk_seq: 0,
    })
}

#[cfg(test)]
mod tests {
    use super::{LINE_BYTES, QUEUE, Texts};
    use jink_shared_types::Timestamp;
    use jink_shared_types::events::{self, EventSample};
    use mavlink::dialects::ardupilotmega::{MavMessage, MavSeverity, STATUSTEXT_DATA};
    use proptest::prelude::*;

    fn at(s: f64) -> Timestamp {
        Timestamp::from_seconds(100.0 + s)
    }

    fn next(texts: &mut Texts, s: f64) -> Option<STATUSTEXT_DATA> {
        match texts.next(at(s)) {
            Some(MavMessage::STATUSTEXT(line)) => Some(line),
            Some(other) => panic!("{other:?}"),
            None => None,
        }
    }

    #[test]
    fn an_event_becomes_one_line_with_its_severity() {
        let mut texts = Texts::default();
        let event = EventSample::new(&events::GUARD_BRAKED, "front", [2.5, 0.0]);
        texts.push(at(0.0), &event);
        texts.push(at(0.1), &event);
        let line = next(&mut texts, 0.1).unwrap();
        assert_eq!(
            line.text.to_str().unwrap(),
            "jink: guard brakes, front 2.5 m ahead"
        );
        assert_eq!(line.severity, MavSeverity::MAV_SEVERITY_ERROR);
        assert!(next(&mut texts, 5.0).is_none(), "the repetition was not dropped");
        texts.push(at(6.0), &event);
        assert!(next(&mut texts, 6.0).is_some(), "a later change was swallowed");
    }

    #[test]
    fn a_full_queue_keeps_what_is_severe() {
        let mut texts = Texts::default();
        for i in 0..2 * QUEUE {
            texts.push(
                at(0.0),
                &EventSample::new(&events::PATH_FOUND, &format!("p{i}"), [0.0; 2]),
            );
        }
        texts.push(
            at(0.0),
            &EventSample::new(&events::CERTIFICATE_LOST, "", [0.0; 2]),
        );
        let lines: Vec<_> = (0..60).filter_map(|i| next(&mut texts, f64::from(i))).collect();
        assert_eq!(lines.len(), QUEUE);
        assert!(
            lines
                .iter()
                .any(|line| line.severity == MavSeverity::MAV_SEVERITY_ALERT)
        );
    }

    proptest! {
        #[test]
        fn lines_fit_and_never_flood(
            ids in proptest::collection::vec((any::<u16>(), "\\PC{0,24}", any::<f64>()), 1..100),
        ) {
            let mut texts = Texts::default();
            let mut lines = 0;
            for (i, (id, name, number)) in ids.iter().enumerate() {
                let row = &events::TABLE[usize::from(*id) % events::TABLE.len()];
                texts.push(at(i as f64 * 0.01), &EventSample::new(row, name, [*number; 2]));
                if let Some(line) = next(&mut texts, i as f64 * 0.01) {
                    lines += 1;
                    prop_assert!(line.text.to_str().is_ok_and(|text| text.len() <= LINE_BYTES));
                }
            }
            prop_assert!(lines <= 1 + ids.len() / 25);
        }
    }
}
