//! Events as STATUSTEXT: one line per change, never a flood.
//!
//! Lines wait in a short queue and leave at [`RATE_HZ`]; one longer than [`LINE_BYTES`] leaves in parts that belong
//! together by a number, at once. A part that is not the last must be full, because a zero ends the line: where the cut
//! would fall into a character, blanks stand in front of it. The same event about the same process is said once within
//! [`REPEAT_S`]; a full queue drops the least severe line. Events happen on change, so this is the one place of the gateway
//! that formats text.
//!
//! An autopilot that passes lines on to a ground station may lose many (PX4 up to 40 %). What a pilot waits for or has to act upon
//! ([`STANDING`]) is therefore said again after [`AGAIN_S`], unless something of the same subject has happened since.

use jink_mavlink_link::ticker::Ticker;
use jink_shared_types::Timestamp;
use jink_shared_types::events::{
    AUTOPILOT_FOUND, AUTOPILOT_LOST, AUTOPILOT_UNFIT, AVOIDANCE_DEGRADED, AVOIDANCE_READY, Event,
    EventSample, INTERFACE_OFF, ITEM_BLOCKED, NO_PATH, PATH_FOUND, PREVENTION_BLIND, PREVENTION_HOLDS,
    PROCESS_FAILED, PROFILE_CHOSEN, PROFILE_UNFIT, PROFILE_UNPROVEN, RANGES_BACK, RANGES_LOST, SENSOR_BACK,
    SENSOR_LOST, SETPOINTS_FOLLOWED, SETPOINTS_IGNORED, Severity, UNGUARDED,
};
use jink_shared_types::health::Name;
use mavlink::dialect::{MavMessage, MavSeverity, STATUSTEXT_DATA};
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

/// When a standing line is said again, after it was said last (s).
const AGAIN_S: [f64; 2] = [3.0, 6.0];
/// Lines that stay true until another of the same row is said.
const STANDING: [&[&Event]; 11] = [
    &[&AVOIDANCE_READY, &AVOIDANCE_DEGRADED],
    &[&RANGES_LOST, &RANGES_BACK],
    &[&NO_PATH, &PATH_FOUND],
    &[&AUTOPILOT_LOST, &AUTOPILOT_FOUND],
    &[&ITEM_BLOCKED],
    &[&UNGUARDED],
    &[&SETPOINTS_IGNORED, &SETPOINTS_FOLLOWED],
    &[&PREVENTION_BLIND, &PREVENTION_HOLDS],
    &[&PROCESS_FAILED],
    &[&SENSOR_LOST, &SENSOR_BACK],
    &[
        &PROFILE_CHOSEN,
        &PROFILE_UNFIT,
        &INTERFACE_OFF,
        &AUTOPILOT_UNFIT,
        &PROFILE_UNPROVEN,
    ],
];

/// The row of an event.
fn subject(id: u16) -> Option<usize> {
    STANDING
        .iter()
        .position(|row| row.iter().any(|event| event.id == id))
}

/// A line that will be said again.
#[derive(Clone, Copy, Debug)]
struct Again {
    event: EventSample,
    due: Timestamp,
    times: usize,
}

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
    /// Per subject.
    again: [Option<Again>; STANDING.len()],
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
            again: [None; STANDING.len()],
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
        if let Some(subject) = subject(event.id) {
            self.again[subject] = None;
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
        if now < self.ticker.due() {
            return None;
        }
        let event = self.take(now)?;
        self.ticker.restart(now);
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

    /// The next line of the queue, or, if that is empty, one that is due to be said again.
    fn take(&mut self, now: Timestamp) -> Option<EventSample> {
        if !self.queue.is_empty() {
            let event = self.queue.remove(0);
            if let Some(subject) = subject(event.id) {
                self.again[subject] = Some(Again {
                    event,
                    due: now.plus_seconds(AGAIN_S[0]),
                    times: 1,
                });
            }
            return Some(event);
        }
        let slot = self
            .again
            .iter_mut()
            .find(|slot| slot.is_some_and(|again| now >= again.due))?;
        let again = (*slot)?;
        *slot = AGAIN_S.get(again.times).map(|pause_s| Again {
            due: now.plus_seconds(*pause_s),
            times: again.times + 1,
            ..again
        });
        Some(again.event)
    }

    /// When the next line may leave; `None` if nothing waits.
    pub fn next_wake(&self) -> Option<Timestamp> {
        let soonest = self.ticker.due();
        if !self.queue.is_empty() {
            return Some(soonest);
        }
        let again = self.again.iter().flatten().map(|again| again.due).min();
        again.map(|due| due.max(soonest))
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
    use mavlink::dialect::{MavMessage, MavSeverity, STATUSTEXT_DATA};
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

    /// The lines of half a minute, with their times (s); these events happen meanwhile.
    fn lines(happens: &[(f64, &events::Event)]) -> Vec<(f64, String)> {
        let mut texts = Texts::default();
        let mut lines = Vec::new();
        for step in 0..300 {
            let time_s = f64::from(step) * 0.1;
            for (_, event) in happens
                .iter()
                .filter(|(when_s, _)| (when_s - time_s).abs() < 0.05)
            {
                texts.push(at(time_s), &EventSample::new(event, "", [0.0; 2]));
            }
            if let Some(line) = next(&mut texts, time_s) {
                lines.push((time_s, line.text.to_str().unwrap().to_owned()));
            }
        }
        lines
    }

    #[test]
    fn what_a_pilot_waits_for_is_reported_three_times_unless_it_is_over() {
        let times = |happens: &[(f64, &events::Event)], text: &str| -> Vec<f64> {
            let lines = lines(happens).into_iter();
            lines
                .filter(|(_, line)| line == text)
                .map(|(time_s, _)| time_s)
                .collect()
        };
        let near = |reported: Vec<f64>, expected: &[f64]| {
            let close = reported.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.11);
            assert!(reported.len() == expected.len() && close, "{reported:?}");
        };
        near(
            times(&[(1.0, &events::AVOIDANCE_READY)], "jink: avoidance ready"),
            &[1.0, 4.0, 10.0],
        );
        let over = [(1.0, &events::RANGES_LOST), (5.0, &events::RANGES_BACK)];
        near(times(&over, "jink: range data lost, stopping"), &[1.0, 4.0]);
        near(times(&over, "jink: range data back"), &[5.0, 8.0, 14.0]);
        near(
            times(&[(1.0, &events::GUARD_RELEASED)], "jink: guard released"),
            &[1.0],
        );
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
        let lines: Vec<_> = (0..QUEUE)
            .filter_map(|i| next(&mut texts, f64::from(i as u32)))
            .collect();
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
