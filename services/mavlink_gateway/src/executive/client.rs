//! The autopilot's mission, read over MAVLink's mission protocol: for the profiles in which jink flies it itself.
//!
//! | in | done |
//! |---|---|
//! | [`MissionClient::begin`], [`MissionClient::refresh`] | MISSION_REQUEST_LIST, then MISSION_REQUEST_INT for each item, MISSION_ACK at the end |
//! | an answer that does not come | the request is repeated, five times, then the whole is tried again later |
//! | MISSION_CURRENT reports another length or identity than before; MISSION_ACK for somebody else; "Flight plan received" | the mission is read anew |
//! | nothing, in flight, from an autopilot that gives missions no identity ([`MissionClient::watch`]) | the mission is read anew again and again: ArduPilot notifies only the uploader of a new one |
//!
//! Source: MAVLink developer guide, "Mission Protocol", with its time-outs.

use crate::note::Note;
use jink_mavlink_link::autopilot_type::AutopilotType;
use jink_shared_types::Timestamp;
use mavlink::dialect::{
    MISSION_ACK_DATA, MISSION_COUNT_DATA, MISSION_CURRENT_DATA, MISSION_ITEM_INT_DATA,
    MISSION_REQUEST_INT_DATA, MISSION_REQUEST_LIST_DATA, MavCmd, MavFrame, MavMessage, MavMissionResult,
    MavMissionType, STATUSTEXT_DATA,
};

/// Items that are kept; a longer mission is not flown.
pub const ITEMS_MAX: usize = 1000;
/// How often a request is repeated before the attempt is given up.
const TRIES: u32 = 5;
/// Time-out for the count (s).
const COUNT_TIMEOUT_S: f64 = 1.5;
/// Time-out for an item (s).
const ITEM_TIMEOUT_S: f64 = 0.25;
/// In flight the mission is read again after this long for each of its items (s): half a kilobyte a second ...
const WATCH_ITEM_S: f64 = 0.1;
/// ... and not more often than this (s).
const WATCH_S: f64 = 2.0;
/// Pause after an attempt that was given up or refused (s): an autopilot is busy with another transfer for about this long.
const REST_S: f64 = 1.0;

/// One item.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Item {
    /// Its number.
    pub sequence: u16,
    /// What is to be done.
    pub command: MavCmd,
    /// What the coordinates refer to.
    pub frame: MavFrame,
    /// The command's first four parameters; NaN = not given.
    pub params: [f32; 4],
    /// Latitude, or x in local frames (1e-7 deg, or 1e-4 m).
    pub x: i32,
    /// Longitude, or y in local frames (1e-7 deg, or 1e-4 m).
    pub y: i32,
    /// Height in the frame's sense (m).
    pub z_m: f32,
    /// The mission goes on by itself after it.
    pub autocontinue: bool,
}

impl Item {
    fn of(data: &MISSION_ITEM_INT_DATA) -> Self {
        Self {
            sequence: data.seq,
            command: data.command,
            frame: data.frame,
            params: [data.param1, data.param2, data.param3, data.param4],
            x: data.x,
            y: data.y,
            z_m: data.z,
            autocontinue: data.autocontinue != 0,
        }
    }
}

/// Where the reading of a mission stands.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// Nothing is wanted.
    Idle,
    /// The number of items has been asked for.
    Counting,
    /// This item has been asked for.
    Reading(u16),
    /// The reading is done and must be acknowledged.
    Acknowledging,
    /// An attempt failed; the next one begins at `due`.
    Resting,
}

/// Reads the mission.
#[derive(Clone, Debug)]
pub struct MissionClient {
    phase: Phase,
    due: Timestamp,
    tries: u32,
    count: u16,
    reading: Vec<Item>,
    items: Vec<Item>,
    is_known: bool,
    /// Counts the missions that were read, each different from the one before.
    version: u32,
    /// When the reading that is under way began.
    begun: Timestamp,
    /// When the last one that was ended began.
    read_at: Timestamp,
    /// Number of items and identity of the mission, as MISSION_CURRENT reported them last; what it counts differs from
    /// make to make.
    reported: (Option<u16>, Option<u32>),
    /// Item 0 is home, and moves by itself.
    has_home: bool,
    note: Option<Note>,
}

impl Default for MissionClient {
    fn default() -> Self {
        Self {
            phase: Phase::Idle,
            due: Timestamp::NEVER,
            tries: 0,
            count: 0,
            reading: Vec::with_capacity(ITEMS_MAX),
            items: Vec::with_capacity(ITEMS_MAX),
            is_known: false,
            version: 0,
            begun: Timestamp::NEVER,
            read_at: Timestamp::NEVER,
            reported: (None, None),
            has_home: false,
            note: None,
        }
    }
}

impl MissionClient {
    /// Whose mission it is.
    pub fn set_make(&mut self, make: AutopilotType) {
        self.has_home = make == AutopilotType::ArduPilot;
    }

    /// Reads the mission now and forgets what was known of it. A reading that is under way begins anew.
    pub fn begin(&mut self, now: Timestamp) {
        self.is_known = false;
        self.phase = Phase::Counting;
        self.tries = 0;
        self.due = now;
        self.begun = now;
    }

    /// Reads the mission once more, since it may have been changed; what is known of it holds until then.
    pub fn refresh(&mut self, now: Timestamp) {
        let is_known = self.is_known;
        self.begin(now);
        self.is_known = is_known;
    }

    /// Reads it once more, unless that is being done already.
    pub fn read_again(&mut self, now: Timestamp) {
        if matches!(self.phase, Phase::Idle | Phase::Acknowledging) {
            self.refresh(now);
        }
    }

    /// In flight: notices a mission that was changed without a sign of it.
    pub fn watch(&mut self, now: Timestamp) {
        let period_s = (self.items.len() as f64 * WATCH_ITEM_S).max(WATCH_S);
        let has_identity = self.reported.1.is_some();
        if !has_identity && self.phase == Phase::Idle && now.seconds_since(self.begun) >= period_s {
            self.refresh(now);
        }
    }

    /// Counts the missions that were read, each different from the one before; 0 none yet.
    pub fn version(&self) -> u32 {
        self.version
    }

    /// What is to be said in the log, once.
    pub fn take_note(&mut self) -> Option<Note> {
        self.note.take()
    }

    /// Whether it is being read.
    pub fn is_reading(&self) -> bool {
        !matches!(self.phase, Phase::Idle | Phase::Resting)
    }

    /// When the last reading that has come to its end began; [`Timestamp::NEVER`] none yet.
    pub fn read_at(&self) -> Timestamp {
        self.read_at
    }

    /// The items in order, once they have been read whole.
    pub fn items(&self) -> Option<&[Item]> {
        self.is_known.then_some(&self.items)
    }

    /// Takes a message of the autopilot's.
    pub fn take(&mut self, now: Timestamp, message: &MavMessage) {
        match message {
            MavMessage::MISSION_COUNT(count) => self.take_count(now, count),
            MavMessage::MISSION_ITEM_INT(item) => self.take_item(now, item),
            MavMessage::MISSION_CURRENT(current) => self.take_current(now, current),
            MavMessage::MISSION_ACK(ack) => self.take_ack(now, ack),
            MavMessage::STATUSTEXT(text) if is_about_a_new_mission(text) => self.read_again(now),
            _ => {}
        }
    }

    fn take_count(&mut self, now: Timestamp, count: &MISSION_COUNT_DATA) {
        if self.phase != Phase::Counting || count.mission_type != MavMissionType::MAV_MISSION_TYPE_MISSION {
            return;
        }
        if usize::from(count.count) > ITEMS_MAX {
            self.note = Some(Note::MissionTooLong {
                items: count.count,
                most: ITEMS_MAX,
            });
            self.rest(now);
            return;
        }
        self.count = count.count;
        self.reading.clear();
        self.ask_for(now, 0);
    }

    fn take_item(&mut self, now: Timestamp, item: &MISSION_ITEM_INT_DATA) {
        if self.phase != Phase::Reading(item.seq)
            || item.mission_type != MavMissionType::MAV_MISSION_TYPE_MISSION
        {
            return;
        }
        self.reading.push(Item::of(item));
        self.ask_for(now, item.seq + 1);
    }

    /// Another length or another identity than was reported before: another mission.
    fn take_current(&mut self, now: Timestamp, current: &MISSION_CURRENT_DATA) {
        // MAVLink: 0 is not supported, the greatest number is no mission.
        let total = match current.total {
            0 => None,
            u16::MAX => Some(0),
            total => Some(total),
        };
        let id = (current.mission_id != 0).then_some(current.mission_id);
        let (total_before, id_before) = self.reported;
        let other_length = total.zip(total_before).is_some_and(|(new, old)| new != old);
        let other_id = id.zip(id_before).is_some_and(|(new, old)| new != old);
        self.reported = (total.or(total_before), id.or(id_before));
        if other_length || other_id {
            self.begin(now);
        }
    }

    /// The autopilot refuses, since it may be busy with a ground station; or it has taken a mission from one.
    fn take_ack(&mut self, now: Timestamp, ack: &MISSION_ACK_DATA) {
        if ack.mission_type != MavMissionType::MAV_MISSION_TYPE_MISSION {
            return;
        }
        let is_idle = matches!(self.phase, Phase::Idle | Phase::Acknowledging);
        if is_idle && ack.mavtype == MavMissionResult::MAV_MISSION_ACCEPTED {
            self.refresh(now);
        }
        let under_way = matches!(self.phase, Phase::Counting | Phase::Reading(_));
        if under_way && ack.mavtype != MavMissionResult::MAV_MISSION_ACCEPTED {
            self.rest(now);
        }
    }

    fn ask_for(&mut self, now: Timestamp, sequence: u16) {
        self.tries = 0;
        self.due = now;
        if sequence < self.count {
            self.phase = Phase::Reading(sequence);
        } else {
            self.phase = Phase::Acknowledging;
            // The last reading counts in any case: home may have moved in it.
            std::mem::swap(&mut self.items, &mut self.reading);
            if self.version == 0 || !is_same(&self.items, &self.reading, self.has_home) {
                self.version = self.version.wrapping_add(1).max(1);
            }
            self.is_known = true;
            self.read_at = self.begun;
        }
    }

    fn rest(&mut self, now: Timestamp) {
        self.phase = Phase::Resting;
        self.due = now.plus_seconds(REST_S);
    }

    /// What is to be said to the autopilot `(system, component)`, if something is due.
    pub fn request(&mut self, now: Timestamp, (system, component): (u8, u8)) -> Option<MavMessage> {
        if self.phase == Phase::Idle || now < self.due {
            return None;
        }
        if self.phase == Phase::Resting {
            self.refresh(now);
        }
        if self.tries >= TRIES {
            self.rest(now);
            return None;
        }
        self.tries += 1;
        let mission_type = MavMissionType::MAV_MISSION_TYPE_MISSION;
        match self.phase {
            Phase::Counting => {
                self.due = now.plus_seconds(COUNT_TIMEOUT_S);
                Some(MavMessage::MISSION_REQUEST_LIST(MISSION_REQUEST_LIST_DATA {
                    target_system: system,
                    target_component: component,
                    mission_type,
                }))
            }
            Phase::Reading(seq) => {
                self.due = now.plus_seconds(ITEM_TIMEOUT_S);
                Some(MavMessage::MISSION_REQUEST_INT(MISSION_REQUEST_INT_DATA {
                    seq,
                    target_system: system,
                    target_component: component,
                    mission_type,
                }))
            }
            Phase::Acknowledging => {
                self.phase = Phase::Idle;
                Some(MavMessage::MISSION_ACK(MISSION_ACK_DATA {
                    target_system: system,
                    target_component: component,
                    mavtype: MavMissionResult::MAV_MISSION_ACCEPTED,
                    mission_type,
                    ..MISSION_ACK_DATA::default()
                }))
            }
            Phase::Idle | Phase::Resting => None,
        }
    }
}

/// Whether two readings are of the same mission; a number that is not given (NaN) equals itself, and home may move.
fn is_same(a: &[Item], b: &[Item], has_home: bool) -> bool {
    let bits = |item: &Item| (item.params.map(f32::to_bits), item.z_m.to_bits());
    let same = |(a, b): (&Item, &Item)| {
        let numbers = bits(a) == bits(b) && (a.x, a.y) == (b.x, b.y);
        let is_home = has_home && a.sequence == 0;
        a.command == b.command
            && (is_home || numbers)
            && (a.frame, a.autocontinue) == (b.frame, b.autocontinue)
    };
    a.len() == b.len() && a.iter().zip(b).all(same)
}

/// ArduPilot's text at the end of an upload.
fn is_about_a_new_mission(text: &STATUSTEXT_DATA) -> bool {
    text.text
        .to_str()
        .is_ok_and(|text| text.starts_with("Flight plan received"))
}

#[cfg(test)]
mod tests {
    use super::{ITEMS_MAX, MissionClient, Phase, TRIES};
    use crate::note::Note;
    use jink_mavlink_link::autopilot_type::AutopilotType;
    use jink_shared_types::Timestamp;
    use mavlink::dialect::{
        MISSION_ACK_DATA, MISSION_COUNT_DATA, MISSION_CURRENT_DATA, MISSION_ITEM_INT_DATA, MavMessage,
        MavMissionResult,
    };
    use proptest::prelude::*;

    /// An autopilot with a mission of `count` items over a link on which `lost` says which messages get lost.
    fn read(client: &mut MissionClient, count: u16, seconds: f64, mut lost: impl FnMut() -> bool) -> u32 {
        let mut said = 0;
        for step in 0..(seconds * 100.0) as u32 {
            let now = Timestamp::from_seconds(100.0 + f64::from(step) * 0.01);
            let Some(request) = client.request(now, (1, 1)) else {
                continue;
            };
            said += 1;
            if lost() {
                continue;
            }
            let answer = match request {
                MavMessage::MISSION_REQUEST_LIST(_) => MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
                    count,
                    ..MISSION_COUNT_DATA::default()
                }),
                MavMessage::MISSION_REQUEST_INT(request) => {
                    MavMessage::MISSION_ITEM_INT(MISSION_ITEM_INT_DATA {
                        seq: request.seq,
                        x: i32::from(request.seq) * 7,
                        ..MISSION_ITEM_INT_DATA::default()
                    })
                }
                _ => continue,
            };
            if !lost() {
                client.take(now, &answer);
                // Doubled on its way: nothing happens.
                client.take(now, &answer);
            }
        }
        said
    }

    fn started() -> MissionClient {
        let mut client = MissionClient::default();
        client.begin(Timestamp::from_seconds(100.0));
        client
    }

    #[test]
    fn a_mission_that_is_too_long_is_not_read_and_said_in_the_log_once() {
        let mut client = started();
        let too_many = ITEMS_MAX as u16 + 1;
        read(&mut client, too_many, 1.0, || false);
        assert_eq!(client.items(), None);
        let note = Note::MissionTooLong {
            items: too_many,
            most: ITEMS_MAX,
        };
        assert_eq!((client.take_note(), client.take_note()), (Some(note), None));
    }

    proptest! {
        /// A fifth of all messages lost: the mission is read whole and in order all the same.
        #[test]
        fn a_mission_is_read_over_a_lossy_link(count in 0..40u16, seed in any::<u64>()) {
            let mut client = started();
            let mut random = seed | 1;
            read(&mut client, count, 200.0, || {
                random ^= random << 13;
                random ^= random >> 7;
                random ^= random << 17;
                random.is_multiple_of(5)
            });
            let items = client.items().unwrap();
            prop_assert_eq!(items.len(), usize::from(count));
            for (number, item) in items.iter().enumerate() {
                prop_assert_eq!((usize::from(item.sequence), item.x), (number, number as i32 * 7));
            }
        }
    }

    #[test]
    fn a_silent_autopilot_is_asked_again_and_not_flooded() {
        let mut client = started();
        let said = read(&mut client, 3, 60.0, || true);
        assert!(client.items().is_none());
        // Five requests 1.5 s apart, 1 s of rest: within 60 s not more than eight rounds.
        assert!((TRIES..=8 * TRIES).contains(&said), "{said}");
    }

    #[test]
    fn after_the_last_item_there_is_silence_until_the_mission_changes() {
        let mut client = started();
        assert_eq!(read(&mut client, 3, 5.0, || false), 1 + 3 + 1);
        assert_eq!(read(&mut client, 3, 5.0, || false), 0);
        let now = Timestamp::from_seconds(200.0);
        let current = |total, mission_id| {
            MavMessage::MISSION_CURRENT(MISSION_CURRENT_DATA {
                total,
                mission_id,
                ..MISSION_CURRENT_DATA::default()
            })
        };
        client.take(now, &current(3, 77));
        client.take(now, &current(0, 77));
        assert_eq!(client.phase, Phase::Idle, "the same mission");
        let mut emptied = client.clone();
        emptied.take(now, &current(u16::MAX, 0));
        assert_eq!(
            (emptied.phase != Phase::Idle, emptied.due),
            (true, now),
            "none any more"
        );
        client.take(now, &current(3, 78));
        assert_eq!(
            (client.phase != Phase::Idle, client.due),
            (true, now),
            "another of the same length"
        );
    }

    /// Reads a mission whose item 0 lies there.
    fn read_with_item_0_at(client: &mut MissionClient, x: i32) {
        client.refresh(Timestamp::from_seconds(100.0));
        for tick in 0..50 {
            let now = Timestamp::from_seconds(100.0 + f64::from(tick) * 0.01);
            let answer = match client.request(now, (1, 1)) {
                Some(MavMessage::MISSION_REQUEST_LIST(_)) => MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
                    count: 2,
                    ..MISSION_COUNT_DATA::default()
                }),
                Some(MavMessage::MISSION_REQUEST_INT(request)) => {
                    MavMessage::MISSION_ITEM_INT(MISSION_ITEM_INT_DATA {
                        seq: request.seq,
                        x: if request.seq == 0 { x } else { 5 },
                        ..MISSION_ITEM_INT_DATA::default()
                    })
                }
                _ => continue,
            };
            client.take(now, &answer);
        }
    }

    #[test]
    fn home_that_has_moved_is_no_other_mission_and_counts_at_once_and_px4s_item_0_is_one() {
        for (make, versions) in [(AutopilotType::ArduPilot, 1), (AutopilotType::Px4, 2)] {
            let mut client = MissionClient::default();
            client.set_make(make);
            for x in [7, 9] {
                read_with_item_0_at(&mut client, x);
                assert_eq!(client.items().unwrap()[0].x, x, "{make:?}");
            }
            assert_eq!(client.version(), versions, "{make:?}");
        }
    }

    #[test]
    fn a_refusal_is_waited_out() {
        let mut client = started();
        let now = Timestamp::from_seconds(100.0);
        assert!(client.request(now, (1, 1)).is_some());
        let busy = MavMessage::MISSION_ACK(MISSION_ACK_DATA {
            mavtype: MavMissionResult::MAV_MISSION_ERROR,
            ..MISSION_ACK_DATA::default()
        });
        client.take(now, &busy);
        assert!(client.request(now.plus_seconds(0.9), (1, 1)).is_none());
        assert!(client.request(now.plus_seconds(6.0), (1, 1)).is_some());
    }
}
