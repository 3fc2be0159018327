//! What a gateway that is started again in flight needs to know of its predecessor: which vehicle it is, what is flown, and whether
//! it is in the air.
//! It is written whenever it changes, and read once.

use super::items::Course;
use super::{Executive, FlightGoal};
use crate::assist::record::{self as assist, AssistRecord, BYTES as ASSIST_BYTES};
use crate::landed_state::LandedState;
use jink_shared_types::Timestamp;
use jink_shared_types::coded::Wire;
use jink_shared_types::vehicle::NavMode;
use nalgebra::Vector3;

/// A record that is older than this (s) belongs to another flight: it is written every second at least.
const VALID_S: f64 = 5.0;
/// First byte: the layout.
const LAYOUT: u8 = 4;
/// Bytes in front of the jumps.
const HEAD: usize = SPEED_AT + 4 + 1;
/// Where the speed in force begins; not a number: none.
const SPEED_AT: usize = ASSIST_AT + ASSIST_BYTES;
/// Where that of an assisted pilot begins.
const ASSIST_AT: usize = 1 + 8 + 1 + 1 + 1 + 1 + 24 + 2 + 2;
/// Flag in the flight_goal's byte: armed.
const ARMED: u8 = 0x80;

/// The record.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Record {
    /// When it was written.
    pub written: Timestamp,
    /// System id of the vehicle, and the link on which it is received; `None`: the executive does not know.
    pub vehicle: Option<(u8, u8)>,
    /// Mode in force.
    pub mode: NavMode,
    /// Motors armed.
    pub armed: bool,
    /// On the ground or not.
    pub landed_state: LandedState,
    /// What is flown.
    pub flight_goal: FlightGoal,
    /// The go-to ends with the autopilot's own hold.
    pub returns_to_hold: bool,
    /// The item that is flown to.
    pub index: Option<u16>,
    /// What the items that were passed have left.
    pub course: Course,
    /// A pilot who is assisted.
    pub assist: Option<AssistRecord>,
}

impl Record {
    /// Of a vehicle whose mission is none of jink's business.
    pub fn without_mission(now: Timestamp, mode: NavMode, armed: bool, landed_state: LandedState) -> Self {
        Self {
            written: now,
            vehicle: None,
            mode,
            armed,
            landed_state,
            flight_goal: FlightGoal::None,
            returns_to_hold: false,
            index: None,
            course: Course::default(),
            assist: None,
        }
    }

    /// Whether it belongs to the flight that is going on.
    pub fn is_valid(&self, now: Timestamp) -> bool {
        self.written <= now && now.seconds_since(self.written) <= VALID_S
    }

    /// Whether it says the same as another one.
    pub fn says_the_same(&self, other: &Self) -> bool {
        *self
            == Self {
                written: self.written,
                ..*other
            }
    }

    /// As bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        let (flight_goal, place) = match self.flight_goal {
            FlightGoal::None => (0, Vector3::zeros()),
            FlightGoal::Mission => (1, Vector3::zeros()),
            FlightGoal::GoTo(place) => (2, place),
        };
        let pairs = self.course.pairs();
        let mut bytes = vec![LAYOUT];
        bytes.extend(self.written.ns.to_le_bytes());
        let flight_goal = flight_goal | if self.armed { ARMED } else { 0 };
        bytes.extend([
            self.mode as u8,
            self.landed_state as u8,
            flight_goal,
            u8::from(self.returns_to_hold),
        ]);
        for coordinate in &place {
            bytes.extend(coordinate.to_le_bytes());
        }
        bytes.extend(self.index.map_or(u16::MAX, |index| index).to_le_bytes());
        let (system_id, link) = self.vehicle.unwrap_or((0, 0));
        bytes.extend([system_id, link]);
        bytes.extend(assist::to_bytes(self.assist.as_ref()));
        bytes.extend(self.course.speed_mps.unwrap_or(f32::NAN).to_le_bytes());
        bytes.push(pairs.len() as u8);
        for (at, taken) in pairs {
            bytes.extend(at.to_le_bytes());
            bytes.extend(taken.to_le_bytes());
        }
        bytes
    }

    /// From those bytes; `None` if they are damaged, or of another version.
    pub fn of_bytes(bytes: &[u8]) -> Option<Self> {
        let (head, pairs) = bytes.split_first_chunk::<HEAD>()?;
        let number = |from: usize| {
            let mut eight = [0; 8];
            eight.copy_from_slice(&head[from..from + 8]);
            eight
        };
        let place = Vector3::from_fn(|axis, _| f64::from_le_bytes(number(13 + 8 * axis)));
        let is_whole = pairs.len() == 4 * usize::from(head[HEAD - 1]);
        if head[0] != LAYOUT || !is_whole || !place.iter().all(|c| c.is_finite()) {
            return None;
        }
        let index = u16::from_le_bytes([head[37], head[38]]);
        Some(Self {
            written: Timestamp::from_ns(u64::from_le_bytes(number(1))),
            vehicle: (head[39] != 0).then_some((head[39], head[40])),
            mode: NavMode::from_code(head[9])?,
            armed: head[11] & ARMED != 0,
            landed_state: *LandedState::ALL.get(usize::from(head[10]))?,
            flight_goal: match head[11] & !ARMED {
                0 => FlightGoal::None,
                1 => FlightGoal::Mission,
                2 => FlightGoal::GoTo(place),
                _ => return None,
            },
            returns_to_hold: head[12] != 0,
            index: (index != u16::MAX).then_some(index),
            assist: assist::of_bytes(head[ASSIST_AT..SPEED_AT].try_into().ok()?),
            course: Course::of_pairs(
                pairs.chunks_exact(4).map(|pair| {
                    (
                        u16::from_le_bytes([pair[0], pair[1]]),
                        u16::from_le_bytes([pair[2], pair[3]]),
                    )
                }),
                Some(f32::from_le_bytes(head[SPEED_AT..HEAD - 1].try_into().ok()?))
                    .filter(|speed| speed.is_finite()),
            ),
        })
    }
}

impl Executive {
    /// What is to be known of it.
    pub fn record(&self, now: Timestamp, landed_state: LandedState) -> Record {
        Record {
            flight_goal: self.flight_goal,
            returns_to_hold: self.returns_to_hold,
            index: self.index.and_then(|index| u16::try_from(index).ok()),
            course: self.course,
            ..Record::without_mission(now, self.before, self.was_armed, landed_state)
        }
    }

    /// Goes on where the one before has stopped.
    pub fn resume(&mut self, record: &Record) {
        self.before = record.mode;
        self.flight_goal = record.flight_goal;
        self.returns_to_hold = record.returns_to_hold;
        self.index = record.index.map(usize::from);
        self.course = record.course;
        self.was_armed = record.armed;
        // The gateway before has told it.
        (self.is_told, self.was_taken) = (true, true);
    }
}
