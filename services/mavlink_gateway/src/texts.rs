//! Events as STATUSTEXT: one line per change, never a flood.
//!
//! Lines wait in a short queue and leave at [`RATE_HZ`]; one longer than [`LINE_BYTES`] leaves in parts that belong
//! together by a number, at once. A part that is not the last must be full, because a zero ends the line: where the cut
//! would fall into a character, blanks stand in front of it. The same event about the same process is said once within
//! [`REPEAT_S`]; a full queue drops the least severe line. Events happen on change, so this is the one place of the gateway
//! that formats text.

use crate::ticker::Ticker;
use jink_shared_types::Timestamp;
use jink_shared_types::events::{EventSample, Severity};
use jink_shared_types::health::Name;
use mavlink::dialects::ardupilotmega::{MavMessage, MavSeverity, STATUSTEXT_DATA};
use mavlink::types::CharArray;

/// Length of a message (bytes).
pub const LINE_BYTES: usize = 50;

/// Lines per second (Hz): what a pilot can read.
const RATE_HZ: f64 = 4.0;
/// Lines that wait at most.
const QUEUE: usize = 16;
/// The same line is not said again within this time (s).
const REPEAT_S: f64 = 2.0;
/// Parts of a line at most; what is longer is cut off.
const PARTS: usize = 4;
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
    parts: Parts,
    /// Number of the last line that had parts.
    number: u16,
}

impl Default for Texts {
    fn default() -> Self {
        Self {
            queue: Vec::with_capacity(QUEUE),
            said: Vec::with_capacity(REMEMBERED),
            ticker: Ticker::new(RATE_HZ),
            parts: Parts::default(),
            number: 0,
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

    /// The next message, if the rest of a line waits, or the next line does and the rate allows it.
    pub fn next(&mut self, now: Timestamp) -> Option<MavMessage> {
        if let Some(rest) = self.parts.next() {
            return Some(rest);
        }
        if self.queue.is_empty() || now < self.ticker.due() {
            return None;
        }
        self.ticker.restart(now);
        let event = self.queue.remove(0);
        let text = event.text();
        let mut number = 0;
        if text.len() > LINE_BYTES {
            // 0 says that there is only one part.
            self.number = self.number.checked_add(1).unwrap_or(1);
            number = self.number;
        }
        self.parts = Parts::of(&text, severity(&event), number);
        self.parts.next()
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

fn severity(event: &EventSample) -> MavSeverity {
    match event.severity.get() {
        Severity::Emergency => MavSeverity::MAV_SEVERITY_EMERGENCY,
        Severity::Alert => MavSeverity::MAV_SEVERITY_ALERT,
        Severity::Critical => MavSeverity::MAV_SEVERITY_CRITICAL,
        Severity::Error => MavSeverity::MAV_SEVERITY_ERROR,
        Severity::Warning => MavSeverity::MAV_SEVERITY_WARNING,
        Severity::Notice => MavSeverity::MAV_SEVERITY_NOTICE,
        Severity::Info => MavSeverity::MAV_SEVERITY_INFO,
        Severity::Debug => MavSeverity::MAV_SEVERITY_DEBUG,
    }
}

/// One line on its way, cut into messages.
#[derive(Clone, Copy, Debug)]
struct Parts {
    bytes: [[u8; LINE_BYTES]; PARTS],
    len: usize,
    said: usize,
    severity: MavSeverity,
    number: u16,
}

impl Default for Parts {
    fn default() -> Self {
        Self {
            bytes: [[0; LINE_BYTES]; PARTS],
            len: 0,
            said: 0,
            severity: MavSeverity::MAV_SEVERITY_DEBUG,
            number: 0,
        }
    }
}

impl Parts {
    fn of(text: &str, severity: MavSeverity, number: u16) -> Self {
        let mut parts = Self {
            severity,
            number,
            ..Self::default()
        };
        let mut rest = text;
        // A single line may fill its message; of several parts the last one must hold a zero, else more is waited for.
        while parts.len < PARTS && (!rest.is_empty() || number != 0) {
            let is_last = rest.len() < LINE_BYTES || number == 0 || parts.len + 1 == PARTS;
            let room = LINE_BYTES - usize::from(is_last && number != 0);
            let end = rest.floor_char_boundary(room);
            let part = &mut parts.bytes[parts.len];
            part[..end].copy_from_slice(&rest.as_bytes()[..end]);
            if !is_last {
                part[end..].fill(b' ');
            }
            parts.len += 1;
            rest = &rest[end..];
            if is_last {
                break;
            }
        }
        parts
    }

    fn next(&mut self) -> Option<MavMessage> {
        if self.said == self.len {
            return None;
        }
        self.said += 1;
        Some(MavMessage::STATUSTEXT(STATUSTEXT_DATA {
            severity: self.severity,
            text: CharArray::new(self.bytes[self.said - 1]),
            id: self.number,
            chunk_seq: (self.said - 1) as u8,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::{LINE_BYTES, PARTS, Parts, QUEUE, Texts};
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

    /// What a ground station puts together: it waits for a part with a zero in it.
    fn put_together(text: &str) -> (String, usize) {
        let mut parts = Parts::of(text, MavSeverity::MAV_SEVERITY_INFO, 7);
        let (mut whole, mut count) = (Vec::new(), 0);
        while let Some(MavMessage::STATUSTEXT(part)) = parts.next() {
            assert_eq!((part.id, usize::from(part.chunk_seq)), (7, count));
            count += 1;
            let end = part.text.iter().position(|byte| *byte == 0);
            whole.extend(&part.text[..end.unwrap_or(LINE_BYTES)]);
            assert_eq!(end.is_some(), parts.said == parts.len, "part {count} of {text:?}");
            assert!(std::str::from_utf8(&whole).is_ok(), "a character was torn");
        }
        (String::from_utf8(whole).unwrap(), count)
    }

    #[test]
    fn a_long_line_leaves_in_parts_that_end_with_a_zero() {
        let long = "x".repeat(3 * LINE_BYTES + 7);
        assert_eq!(put_together(&long), (long, 4));
        let exact = "y".repeat(2 * LINE_BYTES);
        assert_eq!(put_together(&exact), (exact, 3));
        let umlaut = format!("{}ä tree", "z".repeat(LINE_BYTES - 1));
        assert_eq!(
            put_together(&umlaut).0,
            format!("{} ä tree", "z".repeat(LINE_BYTES - 1))
        );
        let mut single = Parts::of(&"w".repeat(LINE_BYTES), MavSeverity::MAV_SEVERITY_INFO, 0);
        assert!(single.next().is_some() && single.next().is_none());
    }

    proptest! {
        #[test]
        fn no_text_is_torn_and_none_is_longer_than_its_parts(text in "\\PC{0,300}") {
            let (whole, count) = put_together(&text);
            prop_assert!(count <= PARTS);
            let without_blanks = |text: &str| text.replace(' ', "");
            prop_assert!(without_blanks(&text).starts_with(&without_blanks(&whole)));
            prop_assert!(text.len() > PARTS * (LINE_BYTES - 4) || without_blanks(&text) == without_blanks(&whole));
        }

        #[test]
        fn lines_fit_and_never_flood(
            ids in proptest::collection::vec((any::<u16>(), "\\PC{0,24}", any::<f64>()), 1..100),
        ) {
            let mut texts = Texts::default();
            let mut lines = 0;
            for (i, (id, name, number)) in ids.iter().enumerate() {
                let row = &events::TABLE[usize::from(*id) % events::TABLE.len()];
                texts.push(at(i as f64 * 0.01), &EventSample::new(row, name, [*number; 2]));
                while let Some(line) = next(&mut texts, i as f64 * 0.01) {
                    lines += usize::from(line.chunk_seq == 0);
                    prop_assert!(line.text.to_str().is_ok_and(|text| text.len() <= LINE_BYTES));
                }
            }
            prop_assert!(lines <= 1 + ids.len() / 25);
        }
    }
}
