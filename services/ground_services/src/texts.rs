//! Events as STATUSTEXT: what a pilot needs to know, when it is news, and never a flood. The one place where events become texts.
//!
//! The row of an event says when the pilot is told ([`Told`]):
//!
//! | row | is said |
//! |---|---|
//! | [`Told::Logged`] | never |
//! | [`Told::News`] | when it happens, at most once within [`AGAIN_S`] |
//! | [`Told::Answer`] | whenever it happens, at most once within [`REPEAT_S`] |
//! | [`Told::Until`] | at once, or, if it is not severe, once it has lasted for [`SETTLED_S`]; again every [`AGAIN_S`] while it lasts |
//! | [`Told::End`] | once, when nothing of its state has happened for [`SETTLED_S`], and [`AGAIN_S`] after that was said |
//!
//! So no text is said twice within [`AGAIN_S`], what flickers is said like what lasts, bad news is never late, and who was told
//! that something is over can be told at once when it begins again.
//!
//! Lines leave at [`RATE_HZ`], the most severe first; one longer than [`LINE_BYTES`] leaves in parts that belong together by a number,
//! at once. A part that is not the last must be full, because a zero ends the line: where the cut would fall into a character, blanks
//! stand in front of it. Events happen on change, so this is the one place of the gateway that formats text.

use jink_mavlink_link::ticker::Ticker;
use jink_shared_types::Timestamp;
use jink_shared_types::events::{EventSample, Severity, Told, find};
use jink_shared_types::health::Name;
use mavlink::dialect::{MavMessage, MavSeverity, STATUSTEXT_DATA};
use mavlink::types::CharArray;

/// Length of a message (bytes).
pub const LINE_BYTES: usize = 50;

/// Lines per second (Hz): what a pilot can read.
const RATE_HZ: f64 = 4.0;
/// News that waits at most, and states.
const QUEUE: usize = 16;
const STATES: usize = 32;
/// The same text is not said again within this time (s); ground stations read it aloud.
pub const AGAIN_S: f64 = 30.0;
/// An answer to a person is not repeated within this time (s): several processes may give it.
const REPEAT_S: f64 = 2.0;
/// What lasts no longer (s) comes and goes with the load of the machine and the noise of a sensor.
pub const SETTLED_S: f64 = 1.0;
/// Parts of a line at most; what is longer is cut off.
const PARTS: usize = 4;
/// Texts remembered for the pauses between them: no more are said within [`AGAIN_S`].
const REMEMBERED: usize = (RATE_HZ * AGAIN_S) as usize + 1;

/// What a text is about: of the same row, thing and number it is the same text, whatever else it says.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Kind {
    id: u16,
    name: Name,
    number: i64,
}

impl Kind {
    fn of(event: &EventSample) -> Self {
        // Of an unknown row nobody knows what its text is about.
        let (name, number) = find(event.id).map_or((true, true), |row| row.is_about());
        Self {
            id: event.id,
            name: if name { event.name } else { Name::default() },
            number: if number {
                event.numbers[0].round() as i64
            } else {
                0
            },
        }
    }
}

fn told(event: &EventSample) -> Told {
    find(event.id).map_or(Told::News, |row| row.told)
}

/// Something that lasts until it is over.
#[derive(Clone, Copy, Debug)]
struct State {
    /// Of the event that ends it.
    over: Kind,
    newest: EventSample,
    /// When the newest one began.
    since: Timestamp,
    /// What the pilot was told last.
    said: Option<EventSample>,
}

impl State {
    fn is_over(&self) -> bool {
        self.newest.id == self.over.id
    }

    fn is_told(&self) -> bool {
        self.said.is_some_and(|said| said.id == self.newest.id)
    }
}

/// Lines on their way to the pilot.
#[derive(Clone, Debug)]
pub struct Texts {
    queue: Vec<EventSample>,
    states: Vec<State>,
    said: Vec<(Kind, Timestamp)>,
    ticker: Ticker,
    parts: Parts,
    /// Number of the last line that had parts.
    number: u16,
}

impl Default for Texts {
    fn default() -> Self {
        Self {
            queue: Vec::with_capacity(QUEUE),
            states: Vec::with_capacity(STATES),
            said: Vec::with_capacity(REMEMBERED),
            ticker: Ticker::new(RATE_HZ),
            parts: Parts::default(),
            number: 0,
        }
    }
}

impl Texts {
    /// Takes an event; whether and when the pilot is told, its row says.
    pub fn push(&mut self, now: Timestamp, event: &EventSample) {
        if event.severity == Severity::Debug {
            return;
        }
        let pause_s = match told(event) {
            Told::Logged => return,
            Told::Until(end) => return self.change(now, event, end),
            Told::End => return self.change(now, event, event.id),
            Told::News => AGAIN_S,
            Told::Answer => REPEAT_S,
        };
        let kind = Kind::of(event);
        let is_waiting = self.queue.iter().any(|other| Kind::of(other) == kind);
        if is_waiting || now < self.said_before(kind, pause_s) {
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
    }

    /// Something of the state that the event `end` ends has happened.
    fn change(&mut self, now: Timestamp, event: &EventSample, end: u16) {
        let over = Kind::of(&EventSample { id: end, ..*event });
        if let Some(index) = self.states.iter().position(|state| state.over == over) {
            let state = &mut self.states[index];
            if event.id == over.id && state.said.is_none() && !state.is_over() {
                // It was over before it was worth a text.
                self.states.remove(index);
                return;
            }
            if state.newest.id != event.id {
                state.since = now;
            }
            state.newest = *event;
            return;
        }
        if self.states.len() == STATES {
            // What is over and told is remembered only so that it is not told again.
            let rank = |i: &usize| {
                let state = &self.states[*i];
                (state.is_over() && state.is_told(), urgency(&state.newest))
            };
            if let Some(least) = (0..STATES).max_by_key(rank) {
                self.states.remove(least);
            }
        }
        self.states.push(State {
            over,
            newest: *event,
            since: now,
            said: None,
        });
    }

    /// Until when a text of this kind is not said again.
    fn said_before(&self, kind: Kind, pause_s: f64) -> Timestamp {
        let said = self.said.iter().rfind(|(said, _)| *said == kind);
        said.map_or(Timestamp::NEVER, |(_, time)| time.plus_seconds(pause_s))
    }

    /// When the pilot is to be told of a state; `None`: there is nothing to tell.
    fn due(&self, state: &State) -> Option<Timestamp> {
        let again = |event: &EventSample| self.said_before(Kind::of(event), AGAIN_S);
        let settled = state.since.plus_seconds(SETTLED_S);
        let due = if state.is_over() {
            if state.is_told() {
                return None;
            }
            state.said.map_or(settled, |said| settled.max(again(&said)))
        } else if urgency(&state.newest) <= Severity::Error as u8 {
            state.since
        } else {
            settled
        };
        Some(due.max(again(&state.newest)))
    }

    /// The next message, if the rest of a line waits, or there is a line to be said and the rate allows it.
    pub fn next(&mut self, now: Timestamp) -> Option<MavMessage> {
        if let Some(rest) = self.parts.next() {
            return Some(rest);
        }
        if now < self.ticker.due() {
            return None;
        }
        let event = self.take(now)?;
        self.ticker.restart(now);
        if self.said.len() == REMEMBERED {
            self.said.remove(0);
        }
        self.said.push((Kind::of(&event), now));
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

    /// The most severe of what is to be said.
    fn take(&mut self, now: Timestamp) -> Option<EventSample> {
        let is_due = |i: &usize| self.due(&self.states[*i]).is_some_and(|due| now >= due);
        let state = (0..self.states.len())
            .filter(is_due)
            .min_by_key(|i| urgency(&self.states[*i].newest));
        let news = (0..self.queue.len()).min_by_key(|i| urgency(&self.queue[*i]));
        let is_worse =
            |i: &usize| news.is_none_or(|news| urgency(&self.states[*i].newest) < urgency(&self.queue[news]));
        if let Some(index) = state.filter(is_worse) {
            let state = &mut self.states[index];
            state.said = Some(state.newest);
            return state.said;
        }
        news.map(|news| self.queue.remove(news))
    }

    /// When the next line may leave; `None` if nothing waits.
    pub fn next_wake(&self) -> Option<Timestamp> {
        let soonest = self.ticker.due();
        if !self.queue.is_empty() {
            return Some(soonest);
        }
        let states = self.states.iter().filter_map(|state| self.due(state)).min();
        states.map(|due| due.max(soonest))
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
    use super::{AGAIN_S, Kind, LINE_BYTES, PARTS, Parts, QUEUE, REPEAT_S, Texts};
    use jink_shared_types::Timestamp;
    use jink_shared_types::events::{self, EventSample, Told, find};
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
        texts.push(
            at(0.0),
            &EventSample::new(&events::GUARD_BRAKED, "front", [2.5, 0.0]),
        );
        let line = next(&mut texts, 0.1).unwrap();
        assert_eq!(
            line.text.to_str().unwrap(),
            "jink: guard brakes, front 2.5 m ahead"
        );
        assert_eq!(line.severity, MavSeverity::MAV_SEVERITY_ERROR);
    }

    /// The texts of two minutes and their times (s), with what `happens` at each tenth of a second.
    fn said(happens: impl Fn(u32) -> Vec<EventSample>) -> Vec<(f64, String)> {
        let mut texts = Texts::default();
        let mut lines = Vec::new();
        for tick in 0..1200 {
            let time_s = f64::from(tick) * 0.1;
            for event in happens(tick) {
                texts.push(at(time_s), &event);
            }
            while let Some(line) = next(&mut texts, time_s) {
                assert!(texts.next_wake().is_none_or(|wake| wake > at(time_s)));
                lines.push((time_s, line.text.to_str().unwrap().to_owned()));
            }
        }
        lines
    }

    fn plain(event: &events::Event) -> EventSample {
        EventSample::new(event, "", [0.0; 2])
    }

    #[test]
    fn good_news_is_said_once_however_often_it_happens() {
        for event in [
            &events::AVOIDANCE_READY,
            &events::AUTOPILOT_FOUND,
            &events::SENSOR_BACK,
        ] {
            let lines = said(|tick| if tick % 7 == 0 { vec![plain(event)] } else { vec![] });
            assert_eq!(lines.len(), 1, "{lines:?}");
        }
    }

    #[test]
    fn what_needs_action_is_repeated_every_half_minute_while_it_lasts_and_its_end_is_said_once() {
        let lines = said(|tick| match tick {
            10 => vec![plain(&events::RANGES_LOST)],
            500 => vec![plain(&events::RANGES_BACK)],
            _ => vec![],
        });
        let (times, texts): (Vec<f64>, Vec<String>) = lines.into_iter().unzip();
        assert_eq!(
            texts,
            [
                "jink: range data lost, stopping",
                "jink: range data lost, stopping",
                "jink: range data back"
            ]
        );
        let near = |time: f64, expected: f64| (time - expected).abs() < 0.3;
        assert!(
            near(times[0], 1.0) && near(times[1], 31.0) && near(times[2], 61.0),
            "{times:?}"
        );
    }

    #[test]
    fn what_flickers_is_said_like_what_lasts() {
        let lost = EventSample::new(&events::SENSOR_LOST, "planner", [1.0, 2.0]);
        let lines = said(|tick| match (tick % 20, tick < 900) {
            (0, true) => vec![lost],
            (15, true) => vec![plain(&events::SENSOR_BACK)],
            _ => vec![],
        });
        let backs: Vec<_> = lines.iter().filter(|(_, line)| line.contains("back")).collect();
        assert!(lines.len() <= 5 && backs.len() <= 1, "{lines:?}");
        // What is over within a second is worth no text, and neither is its end.
        let lines = said(|tick| match tick % 20 {
            0 => vec![lost],
            5 => vec![plain(&events::SENSOR_BACK)],
            _ => vec![],
        });
        assert!(lines.is_empty(), "{lines:?}");
    }

    #[test]
    fn lateness_is_for_the_log_and_a_persons_acts_are_answered_each_time() {
        let late = EventSample::new(&events::OUTPUT_LATE, "planner", [97.0, 109.0]);
        let slow = EventSample::new(&events::PROCESS_SLOW, "obstacle_fusion", [3.0, 1.0]);
        assert!(said(|_| vec![late, slow]).is_empty());
        let on = |tick: u32| {
            if tick.is_multiple_of(50) {
                vec![plain(&events::ASSIST_ON)]
            } else {
                vec![]
            }
        };
        assert_eq!(said(on).len(), 24);
    }

    #[test]
    fn of_two_things_both_are_said_and_of_one_thing_it_is_said_when_it_ends() {
        let event = |event, name| EventSample::new(event, name, [0.0; 2]);
        let lines = said(|tick| match tick {
            0 => vec![
                event(&events::LIDAR_LOST, "left"),
                event(&events::LIDAR_LOST, "right"),
            ],
            100 => vec![event(&events::LIDAR_BACK, "left")],
            _ => vec![],
        });
        let of = |name: &str| lines.iter().filter(|(_, line)| line.contains(name)).count();
        assert_eq!(
            (
                of("left lost"),
                of("left back"),
                of("right lost"),
                of("right back")
            ),
            (1, 1, 4, 0)
        );
    }

    #[test]
    fn a_full_queue_keeps_what_is_severe() {
        let mut texts = Texts::default();
        for i in 0..2 * QUEUE {
            texts.push(
                at(0.0),
                &EventSample::new(&events::PROCESS_SWAPPED, &format!("p{i}"), [0.0; 2]),
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
        fn lines_fit_never_flood_and_none_is_said_twice_within_half_a_minute(
            happens in proptest::collection::vec((any::<u16>(), 0..3_u8, any::<f64>(), 0..5000_u32), 1..300),
        ) {
            let mut texts = Texts::default();
            let mut said: Vec<(Kind, f64)> = Vec::new();
            let mut time_s = 0.0;
            for (id, name, number, pause_ms) in &happens {
                let row = &events::TABLE[usize::from(*id) % events::TABLE.len()];
                texts.push(at(time_s), &EventSample::new(row, &format!("thing{name}"), [*number; 2]));
                let end_s = time_s + f64::from(*pause_ms) * 1e-3;
                while time_s < end_s {
                    let before = texts.said.clone();
                    let mut lines = 0;
                    while let Some(line) = next(&mut texts, time_s) {
                        lines += usize::from(line.chunk_seq == 0);
                        prop_assert!(line.text.to_str().is_ok_and(|text| text.len() <= LINE_BYTES));
                    }
                    prop_assert!(lines <= 1);
                    if let Some((kind, _)) = texts.said.last().filter(|_| before != texts.said) {
                        let pause_s = match find(kind.id).unwrap().told {
                            Told::Answer => REPEAT_S,
                            _ => AGAIN_S,
                        };
                        let is_early = |(other, then_s): &(Kind, f64)| other == kind && time_s - then_s < pause_s - 1e-6;
                        prop_assert!(!said.iter().any(is_early), "{kind:?}");
                        said.push((*kind, time_s));
                    }
                    time_s += 0.25;
                }
            }
        }
    }
}
