//! A mission: its items as uploaded, and what each of them asks for.

// Ground stations still use the older names of the global frames.
#![allow(deprecated)]

use jink_shared_types::geo::{GlobalPoint, Projection};
use mavlink::dialect::{MISSION_ITEM_INT_DATA, MavCmd, MavFrame, MavMissionResult};
use nalgebra::Vector3;

/// Time of one turn of LOITER_TURNS (s): CIRCLE_RATE, 20 degrees a second.
const TURN_S: f64 = 18.0;
/// Most items of a mission: well above any flight plan of a test, and small enough to keep in memory twice.
pub const ITEMS_MAX: usize = 512;

/// What an item asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Task {
    /// Fly to a place and stay `hold_s`.
    Waypoint {
        /// Stay (s).
        hold_s: f64,
        /// Acceptance radius (m); 0 = NAV_ACC_RAD.
        acceptance_m: f64,
    },
    /// Fly to a place and stay for good.
    LoiterForever,
    /// Take off, then fly to a place.
    Takeoff,
    /// Land at a place.
    Land,
    /// Return to home and land.
    Return,
    /// Another speed (m/s); not positive: PX4's default, and ArduCopter's as it is.
    Speed(f64),
    /// Go on at an item, so many times.
    Jump {
        /// Number of the item.
        to: f32,
        /// How often; -1 for ever.
        times: f32,
    },
}

/// Whose items they are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Dialect {
    /// PX4's.
    #[default]
    Px4,
    /// ArduCopter's: more kinds of items lead somewhere.
    ArduCopter,
}

/// The frame in which items become local.
#[derive(Clone, Copy, Debug)]
pub struct MissionFrame {
    /// About the local origin.
    pub projection: Projection,
    /// Height of the local origin above sea level (m).
    pub origin_altitude_m: f64,
    /// Down coordinate of home (m).
    pub home_down_m: f64,
}

/// What `item` asks for.
///
/// # Errors
/// The result with which the item is refused: unknown command, or a frame it cannot be placed in.
pub fn task_of(dialect: Dialect, item: &MISSION_ITEM_INT_DATA) -> Result<Task, MavMissionResult> {
    let copters = dialect == Dialect::ArduCopter;
    let seconds = |field: f32| f64::from(field).max(0.0);
    let task = match item.command {
        MavCmd::MAV_CMD_NAV_WAYPOINT => Task::Waypoint {
            hold_s: seconds(item.param1),
            acceptance_m: seconds(item.param2),
        },
        MavCmd::MAV_CMD_NAV_LOITER_TIME => Task::Waypoint {
            hold_s: seconds(item.param1),
            acceptance_m: 0.0,
        },
        MavCmd::MAV_CMD_NAV_SPLINE_WAYPOINT if copters => Task::Waypoint {
            hold_s: seconds(item.param1),
            acceptance_m: 0.0,
        },
        MavCmd::MAV_CMD_NAV_LOITER_TURNS if copters => Task::Waypoint {
            hold_s: seconds(item.param1) * TURN_S,
            acceptance_m: 0.0,
        },
        MavCmd::MAV_CMD_NAV_LOITER_UNLIM => Task::LoiterForever,
        MavCmd::MAV_CMD_NAV_TAKEOFF => Task::Takeoff,
        MavCmd::MAV_CMD_NAV_LAND => Task::Land,
        MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH => Task::Return,
        // ArduCopter: 0 and 1 are horizontal speeds, from 0.1 m/s on; PX4 takes every kind for one.
        MavCmd::MAV_CMD_DO_CHANGE_SPEED
            if copters && !((0.0..2.0).contains(&item.param1) && item.param2 >= 0.1) =>
        {
            Task::Speed(-1.0)
        }
        MavCmd::MAV_CMD_DO_CHANGE_SPEED => Task::Speed(f64::from(item.param2)),
        MavCmd::MAV_CMD_DO_JUMP => Task::Jump {
            to: item.param1,
            times: item.param2,
        },
        _ => return Err(MavMissionResult::MAV_MISSION_UNSUPPORTED),
    };
    if task.has_place() && !is_placeable(item.frame) {
        return Err(MavMissionResult::MAV_MISSION_UNSUPPORTED_FRAME);
    }
    Ok(task)
}

impl Task {
    /// Whether the item leads somewhere; the others are done as soon as they come up.
    pub fn has_place(&self) -> bool {
        !matches!(self, Task::Return | Task::Speed(_) | Task::Jump { .. })
    }
}

/// PX4 takes global frames only; LOCAL_NED (x and y in 1e-4 m) is taken here besides, for plans without a globe.
fn is_placeable(frame: MavFrame) -> bool {
    use MavFrame as F;
    matches!(
        frame,
        F::MAV_FRAME_GLOBAL
            | F::MAV_FRAME_GLOBAL_INT
            | F::MAV_FRAME_GLOBAL_RELATIVE_ALT
            | F::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
            | F::MAV_FRAME_LOCAL_NED
    )
}

/// Where ArduCopter flies to for `item` from `here`, local NED (m): a latitude and longitude of zero are those of `here`, and a height
/// of zero, in its centimetres, is that of `here` (`loc_from_cmd`).
pub fn place_from(item: &MISSION_ITEM_INT_DATA, frame: &MissionFrame, here: Vector3<f64>) -> Vector3<f64> {
    let place = place_of(item, frame);
    if item.frame == MavFrame::MAV_FRAME_LOCAL_NED {
        return place;
    }
    let level = if (item.x, item.y) == (0, 0) { here } else { place };
    let height = if (item.z * 100.0).trunc() == 0.0 {
        here
    } else {
        place
    };
    Vector3::new(level.x, level.y, height.z)
}

/// How often the jumps of a mission were taken.
#[derive(Clone, Debug)]
pub struct Jumps {
    taken: Vec<u16>,
}

impl Default for Jumps {
    fn default() -> Self {
        Self {
            taken: vec![0; ITEMS_MAX],
        }
    }
}

impl Jumps {
    /// None was taken.
    pub fn reset(&mut self) {
        self.taken.fill(0);
    }

    /// The first item from `from` on that is no jump, with all jumps before it taken; `None`: the mission ends, also at a jump to no
    /// item, or in a circle.
    pub fn follow(&mut self, mission: &Mission, from: usize) -> Option<usize> {
        /// ArduPilot's.
        const JUMPS_IN_A_ROW: usize = 64;
        let first = f32::from(u8::from(mission.dialect == Dialect::ArduCopter));
        let mut index = from;
        for _ in 0..=JUMPS_IN_A_ROW {
            let Task::Jump { to, times } = mission.task(index)? else {
                return Some(index);
            };
            if !(first..mission.len() as f32).contains(&to) {
                return None;
            }
            let taken = self.taken.get_mut(index)?;
            let is_due = times == -1.0 || f32::from(*taken) < times;
            *taken = taken.saturating_add(u16::from(is_due));
            index = if is_due { to as usize } else { index + 1 };
        }
        None
    }
}

/// Where `item` lies, local NED (m), in single precision.
pub fn place_of(item: &MISSION_ITEM_INT_DATA, frame: &MissionFrame) -> Vector3<f64> {
    let z = f64::from(item.z);
    if item.frame == MavFrame::MAV_FRAME_LOCAL_NED {
        return single(Vector3::new(
            f64::from(item.x) * 1e-4,
            f64::from(item.y) * 1e-4,
            z,
        ));
    }
    let xy = frame.projection.to_local(GlobalPoint::from_e7(item.x, item.y));
    let relative = matches!(
        item.frame,
        MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT | MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
    );
    let down = if relative {
        frame.home_down_m - z
    } else {
        frame.origin_altitude_m - z
    };
    single(Vector3::new(xy.x, xy.y, down))
}

/// The items in force.
#[derive(Clone, Debug)]
pub struct Mission {
    dialect: Dialect,
    items: Vec<MISSION_ITEM_INT_DATA>,
    identity: u32,
}

impl Mission {
    /// None, whose items will be those of `dialect`.
    pub fn new(dialect: Dialect) -> Self {
        Self {
            dialect,
            items: Vec::with_capacity(ITEMS_MAX),
            identity: 0,
        }
    }

    /// Whether an item can be part of it.
    ///
    /// # Errors
    /// The result with which it is refused.
    pub fn check(&self, item: &MISSION_ITEM_INT_DATA) -> Result<(), MavMissionResult> {
        task_of(self.dialect, item).map(|_| ())
    }

    /// Items.
    pub fn len(&self) -> usize {
        self.items.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    /// Item `index`.
    pub fn get(&self, index: usize) -> Option<&MISSION_ITEM_INT_DATA> {
        self.items.get(index)
    }

    /// What item `index` asks for.
    pub fn task(&self, index: usize) -> Option<Task> {
        self.get(index).and_then(|item| task_of(self.dialect, item).ok())
    }

    /// Replaces all items, without allocating.
    pub fn replace(&mut self, items: &[MISSION_ITEM_INT_DATA]) {
        self.items.clear();
        self.items.extend(items.iter().take(ITEMS_MAX).cloned());
        self.identity = match self.items.is_empty() {
            true => 0,
            false => self.items.iter().fold(FNV_OFFSET, identity_with),
        };
    }

    /// A number that another mission does not have; 0 without one. PX4 sends a checksum of its own.
    pub fn identity(&self) -> u32 {
        self.identity
    }

    /// Item `index`, to be rewritten as an autopilot stores it.
    pub fn get_mut(&mut self, index: usize) -> Option<&mut MISSION_ITEM_INT_DATA> {
        self.items.get_mut(index)
    }

    /// The first item at or after `from` that leads somewhere. A return ends the search: nothing comes after it; so does a jump.
    pub fn next_place(&self, from: usize) -> Option<usize> {
        for index in from..self.len() {
            match self.task(index) {
                Some(Task::Return | Task::Jump { .. }) => return None,
                Some(task) if task.has_place() => return Some(index),
                _ => {}
            }
        }
        None
    }
}

/// Where FNV-1a begins.
const FNV_OFFSET: u32 = 0x811c_9dc5;

/// FNV-1a over what an item says.
fn identity_with(identity: u32, item: &MISSION_ITEM_INT_DATA) -> u32 {
    let words = [
        item.command as u32,
        item.frame as u32,
        item.param1.to_bits(),
        item.param2.to_bits(),
        item.param3.to_bits(),
        item.param4.to_bits(),
        item.x.cast_unsigned(),
        item.y.cast_unsigned(),
        item.z.to_bits(),
    ];
    let add = |hash: u32, word: &u32| (hash ^ word).wrapping_mul(0x0100_0193);
    words.iter().fold(identity, add)
}

/// Rounded to single precision, the precision in which PX4 keeps and sends waypoints. A companion that mirrors a
/// waypoint gives back exactly what it received; only then does PX4 take it for its own.
pub fn single(v: Vector3<f64>) -> Vector3<f64> {
    v.map(|c| f64::from(c as f32))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame() -> MissionFrame {
        MissionFrame {
            projection: Projection::new(GlobalPoint {
                latitude_deg: 47.397742,
                longitude_deg: 8.545594,
            }),
            origin_altitude_m: 488.0,
            home_down_m: -1.0,
        }
    }

    fn item(command: MavCmd, frame: MavFrame) -> MISSION_ITEM_INT_DATA {
        MISSION_ITEM_INT_DATA {
            command,
            frame,
            x: 473_977_420,
            y: 85_455_940,
            z: 5.0,
            ..MISSION_ITEM_INT_DATA::default()
        }
    }

    #[test]
    fn heights_are_above_home_or_above_the_sea() {
        let relative = item(
            MavCmd::MAV_CMD_NAV_WAYPOINT,
            MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        );
        let at = place_of(&relative, &frame());
        assert!(at.xy().norm() < 0.01);
        assert_eq!(at.z, -6.0);
        let mut absolute = item(MavCmd::MAV_CMD_NAV_WAYPOINT, MavFrame::MAV_FRAME_GLOBAL_INT);
        absolute.z = 493.0;
        assert_eq!(place_of(&absolute, &frame()).z, -5.0);
        let mut local = item(MavCmd::MAV_CMD_NAV_WAYPOINT, MavFrame::MAV_FRAME_LOCAL_NED);
        (local.x, local.y, local.z) = (300_000, -5_000, -5.0);
        assert_eq!(place_of(&local, &frame()), Vector3::new(30.0, -0.5, -5.0));
    }

    #[test]
    fn what_cannot_be_flown_is_refused_with_the_reason() {
        let unknown = item(
            MavCmd::MAV_CMD_NAV_SPLINE_WAYPOINT,
            MavFrame::MAV_FRAME_GLOBAL_INT,
        );
        assert_eq!(
            task_of(Dialect::Px4, &unknown),
            Err(MavMissionResult::MAV_MISSION_UNSUPPORTED)
        );
        let nowhere = item(MavCmd::MAV_CMD_NAV_WAYPOINT, MavFrame::MAV_FRAME_BODY_NED);
        assert_eq!(
            task_of(Dialect::Px4, &nowhere),
            Err(MavMissionResult::MAV_MISSION_UNSUPPORTED_FRAME)
        );
        assert!(task_of(Dialect::ArduCopter, &unknown).is_ok());
    }

    fn numbers(command: MavCmd, param1: f32, param2: f32) -> MISSION_ITEM_INT_DATA {
        MISSION_ITEM_INT_DATA {
            param1,
            param2,
            ..item(command, MavFrame::MAV_FRAME_MISSION)
        }
    }

    #[test]
    fn jumps_are_followed_as_each_autopilot_follows_them() {
        let waypoint = item(MavCmd::MAV_CMD_NAV_WAYPOINT, MavFrame::MAV_FRAME_GLOBAL_INT);
        for (to, times, copter, px4) in [
            (0.0, 1.0, None, Some(0)),
            (-1.0, 1.0, None, None),
            (4.0, 1.0, None, None),
            (1.0, 0.0, Some(3), Some(3)),
            (1.0, 1.0, Some(1), Some(1)),
            (2.0, 5.0, Some(3), Some(3)),
            (2.0, -1.0, None, None),
        ] {
            let jump = numbers(MavCmd::MAV_CMD_DO_JUMP, to, times);
            let items = [waypoint.clone(), waypoint.clone(), jump, waypoint.clone()];
            for (dialect, wanted) in [(Dialect::ArduCopter, copter), (Dialect::Px4, px4)] {
                let mut mission = Mission::new(dialect);
                mission.replace(&items);
                assert_eq!(
                    Jumps::default().follow(&mission, 2),
                    wanted,
                    "{dialect:?} to {to}, {times} times"
                );
            }
        }
    }

    #[test]
    fn zeros_are_here_to_arducopter() {
        let here = Vector3::new(30.0, -7.0, -12.0);
        let mut zeros = item(
            MavCmd::MAV_CMD_NAV_WAYPOINT,
            MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        );
        assert_eq!(place_from(&zeros, &frame(), here), place_of(&zeros, &frame()));
        zeros.z = 0.0;
        assert_eq!(place_from(&zeros, &frame(), here).z, -12.0);
        (zeros.x, zeros.y) = (0, 0);
        assert_eq!(place_from(&zeros, &frame(), here), here);
    }

    #[test]
    fn arducopter_passes_over_speeds_that_are_none() {
        for (kind, mps, copter, px4) in [
            (0.0, 2.0, 2.0, 2.0),
            (1.0, 2.0, 2.0, 2.0),
            (2.0, 2.0, -1.0, 2.0),
            (1.0, -2.0, -1.0, -2.0),
            (1.0, 0.05, -1.0, f64::from(0.05_f32)),
        ] {
            let speed = numbers(MavCmd::MAV_CMD_DO_CHANGE_SPEED, kind, mps);
            assert_eq!(task_of(Dialect::ArduCopter, &speed), Ok(Task::Speed(copter)));
            assert_eq!(task_of(Dialect::Px4, &speed), Ok(Task::Speed(px4)));
        }
    }

    #[test]
    fn speed_items_are_passed_over_and_a_return_ends_the_search() {
        let mut mission = Mission::new(Dialect::Px4);
        let waypoint = item(MavCmd::MAV_CMD_NAV_WAYPOINT, MavFrame::MAV_FRAME_GLOBAL_INT);
        let speed = item(MavCmd::MAV_CMD_DO_CHANGE_SPEED, MavFrame::MAV_FRAME_MISSION);
        let back = item(MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH, MavFrame::MAV_FRAME_MISSION);
        mission.replace(&[speed.clone(), waypoint.clone(), speed, back, waypoint]);
        assert_eq!(mission.next_place(0), Some(1));
        assert_eq!(mission.next_place(2), None);
        assert_eq!(mission.next_place(4), Some(4));
    }
}
