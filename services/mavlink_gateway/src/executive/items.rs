//! How each kind of mission item is flown, and which one follows on which.
//!
//! | item | flown |
//! |---|---|
//! | WAYPOINT, LOITER_TO_ALT, SPLINE_WAYPOINT | to its place, along straight legs |
//! | WAYPOINT with a hold time, LOITER_TIME, DELAY | the same, and waited at |
//! | LOITER_UNLIM, and whatever does not continue by itself | the same, and stayed at |
//! | LAND with a place | level to above its place; the rest is vertical, and the autopilot's |
//! | RETURN_TO_LAUNCH | level to above home, then the autopilot lands there |
//! | TAKEOFF in the air | up to its height, and on PX4 to its place |
//! | LOITER_TURNS, PAYLOAD_PLACE, a height above terrain, anything else that navigates | not: nobody could guard it |
//! | DO_JUMP, DO_JUMP_TAG | taken as often as it says |
//! | everything else | passed over |

use super::client::Item;
use jink_shared_types::vehicle::{DesiredPath, DesiredPoint, NavMode};
use jink_shared_types::{Coded, Flag, Point};
use mavlink::dialect::{MavCmd, MavFrame};
use nalgebra::Vector3;

/// A waypoint without a radius of its own counts as reached within this (m): a planned path passes nearer than that.
const RADIUS_M: f64 = 1.0;
/// No radius is smaller than what a vehicle holds (m).
const SMALLEST_RADIUS_M: f64 = 0.3;
/// Speeds a mission may ask for (m/s).
const SPEEDS_MPS: std::ops::RangeInclusive<f32> = 0.1..=30.0;
/// Different jumps whose repetitions are counted; one more is not taken.
const JUMPS_MAX: usize = 16;

/// What an item asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Task {
    /// To be at its place for so long (s); infinite: for ever.
    Visit {
        /// How long (s).
        stay_s: f64,
        /// The autopilot would fly a curve there.
        is_spline: bool,
    },
    /// To stay where the vehicle is, for so long (s).
    Wait(f64),
    /// To land at its place.
    Land,
    /// To land at home.
    Return,
    /// To climb.
    TakeOff,
    /// A motion that cannot be guarded, in a word for the pilot.
    Unguarded(&'static str),
}

impl Task {
    /// Of an item that navigates.
    #[allow(deprecated)] // Frames whose names say how a number is sent mean the same as those without.
    pub fn of(item: &Item) -> Self {
        let is_above_terrain = matches!(
            item.frame,
            MavFrame::MAV_FRAME_GLOBAL_TERRAIN_ALT | MavFrame::MAV_FRAME_GLOBAL_TERRAIN_ALT_INT
        );
        let seconds = f64::from(item.params[0]).max(0.0);
        let visit = |stay_s, is_spline| match (is_above_terrain, item.autocontinue) {
            (true, _) => Self::Unguarded("above terrain"),
            (false, true) => Self::Visit { stay_s, is_spline },
            (false, false) => Self::Visit {
                stay_s: f64::INFINITY,
                is_spline,
            },
        };
        match item.command {
            MavCmd::MAV_CMD_NAV_WAYPOINT | MavCmd::MAV_CMD_NAV_LOITER_TIME => visit(seconds, false),
            MavCmd::MAV_CMD_NAV_SPLINE_WAYPOINT => visit(seconds, true),
            MavCmd::MAV_CMD_NAV_LOITER_TO_ALT => visit(0.0, false),
            MavCmd::MAV_CMD_NAV_LOITER_UNLIM => visit(f64::INFINITY, false),
            // A time of day is the autopilot's to know.
            MavCmd::MAV_CMD_NAV_DELAY if item.params[0] >= 0.0 => Self::Wait(seconds),
            MavCmd::MAV_CMD_NAV_DELAY => Self::Unguarded("delay"),
            MavCmd::MAV_CMD_NAV_LAND | MavCmd::MAV_CMD_NAV_VTOL_LAND => Self::Land,
            MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH => Self::Return,
            MavCmd::MAV_CMD_NAV_TAKEOFF | MavCmd::MAV_CMD_NAV_VTOL_TAKEOFF => Self::TakeOff,
            MavCmd::MAV_CMD_NAV_LOITER_TURNS => Self::Unguarded("orbit"),
            MavCmd::MAV_CMD_NAV_ARC_WAYPOINT => Self::Unguarded("arc"),
            MavCmd::MAV_CMD_NAV_PAYLOAD_PLACE => Self::Unguarded("payload place"),
            MavCmd::MAV_CMD_NAV_GUIDED_ENABLE => Self::Unguarded("guided"),
            _ => Self::Unguarded("unknown kind"),
        }
    }
}

/// Whether an item means a place or a task: what the protocol counts as a navigation command.
pub fn navigates(item: &Item) -> bool {
    (item.command as u32) < MavCmd::MAV_CMD_NAV_LAST as u32
        || matches!(
            item.command,
            MavCmd::MAV_CMD_NAV_SCRIPT_TIME | MavCmd::MAV_CMD_NAV_ATTITUDE_TIME
        )
}

/// How often each jump has been taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Jumps {
    taken: [(u16, u16); JUMPS_MAX],
    count: usize,
}

impl Jumps {
    /// The first item from `from` on that navigates, with all jumps before it taken; `None`: the mission ends.
    pub fn follow(&mut self, items: &[Item], from: usize) -> Option<usize> {
        let mut index = from;
        // A circle of jumps without a place in it ends nowhere.
        for _ in 0..=2 * items.len() {
            let item = items.get(index)?;
            if navigates(item) {
                return Some(index);
            }
            index = self.jump(items, index).unwrap_or(index + 1);
        }
        None
    }

    /// The same without taking them: what will follow.
    pub fn foresee(mut self, items: &[Item], from: usize) -> Option<usize> {
        self.follow(items, from)
    }

    /// Where the item at `index` leads, if it is a jump that is to be taken now.
    fn jump(&mut self, items: &[Item], index: usize) -> Option<usize> {
        let item = &items[index];
        let target = match item.command {
            MavCmd::MAV_CMD_DO_JUMP => Some(item.params[0] as usize).filter(|to| *to < items.len()),
            MavCmd::MAV_CMD_DO_JUMP_TAG => items.iter().position(|other| {
                other.command == MavCmd::MAV_CMD_JUMP_TAG && other.params[0] == item.params[0]
            }),
            _ => None,
        }?;
        let times = item.params[1];
        let known = self.taken[..self.count]
            .iter()
            .position(|(at, _)| usize::from(*at) == index);
        let slot = match known {
            Some(slot) => slot,
            None if self.count < JUMPS_MAX => {
                self.taken[self.count] = (index as u16, 0);
                self.count += 1;
                self.count - 1
            }
            None => return None,
        };
        let taken = &mut self.taken[slot].1;
        // Negative: for ever.
        let is_due = times < 0.0 || f32::from(*taken) < times;
        *taken = taken.saturating_add(u16::from(is_due && times >= 0.0));
        is_due.then_some(target)
    }

    /// As pairs of an item and how often it was taken.
    pub fn pairs(&self) -> &[(u16, u16)] {
        &self.taken[..self.count]
    }

    /// From those pairs; what does not fit is left out.
    pub fn of_pairs(pairs: impl Iterator<Item = (u16, u16)>) -> Self {
        let mut jumps = Self::default();
        for (pair, slot) in pairs.zip(&mut jumps.taken) {
            *slot = pair;
            jumps.count += 1;
        }
        jumps
    }
}

/// Within which distance of its place an item counts as reached (m).
pub fn radius_m(item: &Item) -> f64 {
    let has_radius = item.command == MavCmd::MAV_CMD_NAV_WAYPOINT;
    match f64::from(item.params[1]) {
        radius if has_radius && radius > 0.0 => radius.max(SMALLEST_RADIUS_M),
        _ => RADIUS_M,
    }
}

/// The speed that the mission asks for at `index`: the last DO_CHANGE_SPEED of a ground speed before it (m/s); NaN none.
fn speed_mps(items: &[Item], index: usize) -> f64 {
    let changes = items[..index].iter().rev();
    let mut speeds = changes
        .filter(|item| item.command == MavCmd::MAV_CMD_DO_CHANGE_SPEED && item.params[0] == 1.0)
        .map(|item| item.params[1]);
    speeds
        .find(|speed| SPEEDS_MPS.contains(speed))
        .map_or(f64::NAN, f64::from)
}

/// The wish to be at `target`, and at `next` after it, on the way to the item at `index`.
pub fn path_to_item(
    items: &[Item],
    index: usize,
    target: Vector3<f64>,
    next: Option<Vector3<f64>>,
) -> DesiredPath {
    let yaw_rad = match items[index].command {
        MavCmd::MAV_CMD_NAV_WAYPOINT => items[index].params[3].to_radians(),
        _ => f32::NAN,
    };
    DesiredPath {
        mission_speed_mps: speed_mps(items, index),
        ..path(target, yaw_rad, next)
    }
}

/// The wish to be at `target`, and at `next` after it.
pub fn path(target: Vector3<f64>, yaw_rad: f32, next: Option<Vector3<f64>>) -> DesiredPath {
    let point = |place: Vector3<f64>, yaw_rad: f32| DesiredPoint {
        position: Point::from_vector(place),
        yaw_rad,
        valid: Flag::YES,
        ..DesiredPoint::default()
    };
    DesiredPath {
        points: [
            point(target, f32::NAN),
            point(target, yaw_rad),
            point(next.unwrap_or(target), f32::NAN),
        ],
        mode: Coded::new(NavMode::Offboard),
        ..DesiredPath::default()
    }
}
