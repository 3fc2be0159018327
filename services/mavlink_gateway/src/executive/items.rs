//! How each kind of mission item is flown, and which one follows on which.
//!
//! | item | flown |
//! |---|---|
//! | WAYPOINT, LOITER_TO_ALT, SPLINE_WAYPOINT | to its place, along straight legs |
//! | WAYPOINT with a hold time, LOITER_TIME, DELAY | the same, and waited at |
//! | LOITER_UNLIM, and whatever does not continue by itself | the same, and stayed at |
//! | LAND | level to above its place; the rest is vertical, and the autopilot's |
//! | RETURN_TO_LAUNCH | level to above home, then the autopilot lands there |
//! | TAKEOFF in the air | up to its height, and on PX4 to its place |
//! | LOITER_TURNS, PAYLOAD_PLACE, a height above terrain, anything else that navigates | not: nobody could guard it |
//! | DO_JUMP, DO_JUMP_TAG | taken as often as it says; one whose target is no item, or that leads in a circle, ends the mission: held before it |
//! | DO_CHANGE_SPEED | a limit from then on |
//! | everything else | passed over |
//!
//! What a number means is the autopilot's to say. Sources: ArduPilot's `AP_Mission` (`get_next_cmd`, `get_index_of_jump_tag`),
//! `ModeAuto::do_change_speed` and `AC_WPNav::set_speed_xy`; PX4's `MissionBase::getNonJumpItem` and its navigator's
//! VEHICLE_CMD_DO_CHANGE_SPEED.

use super::client::Item;
use jink_mavlink_link::autopilot_type::AutopilotType;
use jink_shared_types::vehicle::{DesiredPath, DesiredPoint, NavMode};
use jink_shared_types::{Coded, Flag, Point};
use mavlink::dialect::{MavCmd, MavFrame};
use nalgebra::Vector3;

/// A waypoint without a radius of its own counts as reached within this (m): a planned path passes nearer than that.
const RADIUS_M: f64 = 1.0;
/// No radius is smaller than what a vehicle holds (m).
const SMALLEST_RADIUS_M: f64 = 0.3;
/// Speeds that a mission may ask for (m/s); beyond them the nearer end counts. ArduPilot passes over slower ones (`WPNAV_WP_SPEED_MIN`).
const SPEEDS_MPS: std::ops::RangeInclusive<f32> = 0.1..=30.0;
/// Different jumps whose repetitions are counted; one more is not taken. ArduPilot counts as many on its larger boards.
const JUMPS_MAX: usize = 100;
/// Jumps from one place to the next; more of them are a circle. As many as ArduPilot follows.
const JUMPS_IN_A_ROW: usize = 64;

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
    /// A jump that leads nowhere: here the autopilot's own mission ends.
    Nowhere,
}

impl Task {
    /// Of an item at which [`Course::follow`] has stopped.
    #[allow(deprecated)] // Frames whose names say how a number is sent mean the same as those without.
    pub fn of(make: AutopilotType, item: &Item) -> Self {
        let is_above_terrain = matches!(
            item.frame,
            MavFrame::MAV_FRAME_GLOBAL_TERRAIN_ALT | MavFrame::MAV_FRAME_GLOBAL_TERRAIN_ALT_INT
        );
        let seconds = f64::from(item.params[0]).max(0.0);
        // PX4 flies to the place in the sea off Africa; to ArduPilot it means "here".
        let is_far_away = make == AutopilotType::Px4
            && (item.x, item.y) == (0, 0)
            && item.frame != MavFrame::MAV_FRAME_LOCAL_NED;
        let visit = |stay_s, is_spline| match item.autocontinue {
            _ if is_above_terrain => Self::Unguarded("above terrain"),
            _ if is_far_away => Self::Unguarded("without place"),
            true => Self::Visit { stay_s, is_spline },
            false => Self::Visit {
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
            MavCmd::MAV_CMD_NAV_LAND | MavCmd::MAV_CMD_NAV_VTOL_LAND if is_far_away => {
                Self::Unguarded("without place")
            }
            MavCmd::MAV_CMD_NAV_LAND | MavCmd::MAV_CMD_NAV_VTOL_LAND => Self::Land,
            MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH => Self::Return,
            MavCmd::MAV_CMD_NAV_TAKEOFF | MavCmd::MAV_CMD_NAV_VTOL_TAKEOFF => Self::TakeOff,
            MavCmd::MAV_CMD_NAV_LOITER_TURNS => Self::Unguarded("orbit"),
            MavCmd::MAV_CMD_NAV_ARC_WAYPOINT => Self::Unguarded("arc"),
            MavCmd::MAV_CMD_NAV_PAYLOAD_PLACE => Self::Unguarded("payload place"),
            MavCmd::MAV_CMD_NAV_GUIDED_ENABLE => Self::Unguarded("guided"),
            MavCmd::MAV_CMD_DO_JUMP | MavCmd::MAV_CMD_DO_JUMP_TAG => Self::Nowhere,
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

/// What the items that were passed have left: how often each jump was taken, and the speed in force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Course {
    taken: [(u16, u16); JUMPS_MAX],
    count: usize,
    /// Speed that is asked for (m/s); `None`: the vehicle's own.
    pub speed_mps: Option<f32>,
}

impl Default for Course {
    fn default() -> Self {
        Self {
            taken: [(0, 0); JUMPS_MAX],
            count: 0,
            speed_mps: None,
        }
    }
}

impl Course {
    /// As if the items before `start` had been passed in order, none of them a jump.
    pub fn begun_at(make: AutopilotType, items: &[Item], start: usize) -> Self {
        let mut course = Self::default();
        for item in items.iter().take(start) {
            course.pass(make, item);
        }
        course
    }

    /// The first item from `from` on that navigates, with all jumps before it taken, or the jump there that leads nowhere; `None`:
    /// the mission ends.
    pub fn follow(&mut self, make: AutopilotType, items: &[Item], from: usize) -> Option<usize> {
        let before = *self;
        let (mut index, mut jumps) = (from, 0);
        loop {
            let item = items.get(index)?;
            if navigates(item) {
                return Some(index);
            }
            if !matches!(
                item.command,
                MavCmd::MAV_CMD_DO_JUMP | MavCmd::MAV_CMD_DO_JUMP_TAG
            ) {
                self.pass(make, item);
                index += 1;
                continue;
            }
            jumps += 1;
            let Some(target) = target(make, items, item).filter(|_| jumps <= JUMPS_IN_A_ROW) else {
                *self = before;
                return Some(index);
            };
            index = if self.takes(make, index, item) {
                target
            } else {
                index + 1
            };
        }
    }

    /// The same without taking them: what will follow.
    pub fn foresee(mut self, make: AutopilotType, items: &[Item], from: usize) -> Option<usize> {
        self.follow(make, items, from)
    }

    /// Whether the jump at `index` is to be taken now; then that is counted.
    fn takes(&mut self, make: AutopilotType, index: usize, jump: &Item) -> bool {
        let times = jump.params[1];
        // PX4 stores a number without a sign.
        if times == -1.0 || make == AutopilotType::Px4 && times < 0.0 {
            return true;
        }
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
            None => return false,
        };
        let taken = &mut self.taken[slot].1;
        let is_due = f32::from(*taken) < times.trunc();
        *taken = taken.saturating_add(u16::from(is_due));
        is_due
    }

    /// What an item that does not navigate leaves.
    fn pass(&mut self, make: AutopilotType, item: &Item) {
        if item.command == MavCmd::MAV_CMD_DO_CHANGE_SPEED {
            self.speed_mps = speed_after(make, self.speed_mps, item.params[0], item.params[1]);
        }
    }

    /// As pairs of an item and how often it was taken.
    pub fn pairs(&self) -> &[(u16, u16)] {
        &self.taken[..self.count]
    }

    /// From those pairs and the speed; what does not fit is left out.
    pub fn of_pairs(pairs: impl Iterator<Item = (u16, u16)>, speed_mps: Option<f32>) -> Self {
        let mut course = Self {
            speed_mps,
            ..Self::default()
        };
        for (pair, slot) in pairs.zip(&mut course.taken) {
            *slot = pair;
            course.count += 1;
        }
        course
    }
}

/// The speed in force (m/s) after a DO_CHANGE_SPEED of `kind` and `speed_mps`, in a mission or as a command; `None`: the vehicle's own.
/// ArduPilot takes 0 and 1 for a horizontal speed and leaves everything as it is for what is none; PX4 takes every kind for the
/// same, and its own speed for what is none.
pub fn speed_after(make: AutopilotType, before: Option<f32>, kind: f32, speed_mps: f32) -> Option<f32> {
    let speed = (speed_mps > 0.0).then_some(speed_mps.clamp(*SPEEDS_MPS.start(), *SPEEDS_MPS.end()));
    let counts = (0.0..2.0).contains(&kind) && speed_mps >= *SPEEDS_MPS.start();
    match make {
        AutopilotType::Px4 => speed,
        AutopilotType::ArduPilot => speed.filter(|_| counts).or(before),
    }
}

/// The first item before which the vehicle will hold, and why in a word for the pilot.
pub fn first_held(
    make: AutopilotType,
    items: &[Item],
    lets_fly_unguarded: bool,
) -> Option<(u16, &'static str)> {
    let is_jump = |item: &Item| {
        matches!(
            item.command,
            MavCmd::MAV_CMD_DO_JUMP | MavCmd::MAV_CMD_DO_JUMP_TAG
        )
    };
    let stops = |item: &&Item| navigates(item) || is_jump(item) && target(make, items, item).is_none();
    let mut held = items
        .iter()
        .skip(usize::from(first_item(make)))
        .filter(stops)
        .filter_map(|item| match Task::of(make, item) {
            Task::Unguarded(name) if !lets_fly_unguarded => Some((item.sequence, name)),
            Task::Nowhere => Some((item.sequence, "jumps nowhere")),
            _ => None,
        });
    held.next()
}

/// The first item that is part of a mission: ArduPilot's item 0 is home.
pub fn first_item(make: AutopilotType) -> u16 {
    u16::from(make == AutopilotType::ArduPilot)
}

/// Where a jump leads; `None`: nowhere.
fn target(make: AutopilotType, items: &[Item], jump: &Item) -> Option<usize> {
    let first = usize::from(first_item(make));
    match jump.command {
        MavCmd::MAV_CMD_DO_JUMP => {
            let number = jump.params[0];
            (number >= 0.0)
                .then_some(number as usize)
                .filter(|to| (first..items.len()).contains(to))
        }
        _ => items
            .iter()
            .position(|other| other.command == MavCmd::MAV_CMD_JUMP_TAG && other.params[0] == jump.params[0]),
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

/// The heading on the way to an item (rad); NaN: along the way. ArduPilot stores none (`AP_Mission::mavlink_int_to_mission_cmd`), and
/// reads it back as zero.
pub fn yaw_rad(make: AutopilotType, item: &Item) -> f32 {
    match (make, item.command) {
        (AutopilotType::Px4, MavCmd::MAV_CMD_NAV_WAYPOINT | MavCmd::MAV_CMD_NAV_LOITER_UNLIM) => {
            item.params[3].to_radians()
        }
        _ => f32::NAN,
    }
}

/// The wish to be at `target`, and at `next` after it, no faster than `speed_mps`.
pub fn path(
    target: Vector3<f64>,
    yaw_rad: f32,
    next: Option<Vector3<f64>>,
    speed_mps: Option<f32>,
) -> DesiredPath {
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
        mission_speed_mps: speed_mps.map_or(f64::NAN, f64::from),
        ..DesiredPath::default()
    }
}
