//! What the autopilot says about itself on its links, and what arrives there: for the judge, without taking part.

use jink_emulated_autopilot::{MissionProgress, SetpointStatistics};
use jink_emulated_ground_station::Make;
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::geo::{GlobalPoint, Projection};
use jink_shared_types::vehicle::NavMode;
use mavlink::MavHeader;
use mavlink::dialect::{
    MISSION_ITEM_INT_DATA, MavCmd, MavFrame, MavLandedState, MavMessage, MavMissionType, MavModeFlag,
};

/// jink's component.
const COMPANION_COMPONENT: u8 = 196;
/// A waypoint counts as flown to when the vehicle has really been this near (m): the acceptance radius of both autopilots.
const REACHED_M: f64 = 2.0;
/// Two places of an item nearer than this are one, rounded by who sent it (m).
const ROUNDING_M: f64 = 0.1;

/// What is known of the autopilot.
#[derive(Clone, Copy, Debug)]
pub struct AutopilotState {
    /// It has been seen.
    pub received: bool,
    /// Mode.
    pub mode: NavMode,
    /// Motors armed.
    pub armed: bool,
    /// On the ground, as its land detector says.
    pub landed: bool,
    /// Mission, judged by the truth: a waypoint is done when the vehicle has been there.
    pub mission: MissionProgress,
    /// Setpoints that went to it.
    pub setpoints: SetpointStatistics,
    /// How often it left a mission for Hold by itself.
    pub hold_count: u32,
}

impl Default for AutopilotState {
    fn default() -> Self {
        Self {
            received: false,
            mode: NavMode::Unknown,
            armed: false,
            landed: true,
            mission: MissionProgress::default(),
            setpoints: SetpointStatistics::default(),
            hold_count: 0,
        }
    }
}

/// A waypoint of the mission that was uploaded.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Place {
    item: u16,
    position: Point<LocalNed>,
}

/// Follows both links of one autopilot.
#[derive(Clone, Debug)]
pub struct AutopilotWatch {
    make: Make,
    origin: Projection,
    state: AutopilotState,
    /// Items of the mission on board, as they were last sent one way or the other.
    items: Vec<Option<Place>>,
    /// The next waypoint to be reached.
    next: usize,
    /// When somebody last asked for a mode, simulated time (s).
    asked_mode_s: f64,
    has_trajectories: bool,
}

/// A change of mode this long after somebody asked for one is not the autopilot's own (s).
const ASKED_S: f64 = 2.0;

impl AutopilotWatch {
    /// For an autopilot of `make` whose local origin is at `origin`.
    pub fn new(make: Make, origin: GlobalPoint) -> Self {
        Self {
            make,
            origin: Projection::new(origin),
            state: AutopilotState::default(),
            items: Vec::new(),
            next: 0,
            asked_mode_s: f64::NEG_INFINITY,
            has_trajectories: false,
        }
    }

    /// What is known.
    pub fn state(&self) -> &AutopilotState {
        &self.state
    }

    /// A message of the autopilot.
    pub fn see_autopilot(&mut self, now_s: f64, header: &MavHeader, message: &MavMessage) {
        if header.component_id != 1 {
            return;
        }
        match message {
            MavMessage::HEARTBEAT(beat) => {
                self.state.received = true;
                self.state.armed = beat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
                self.note_mode(now_s, self.make.mode(beat.custom_mode));
            }
            MavMessage::CURRENT_MODE(current) => self.note_mode(now_s, self.make.mode(current.custom_mode)),
            MavMessage::EXTENDED_SYS_STATE(state) => {
                self.state.landed = matches!(
                    state.landed_state,
                    MavLandedState::MAV_LANDED_STATE_ON_GROUND | MavLandedState::MAV_LANDED_STATE_UNDEFINED
                );
            }
            _ => self.see_mission(message),
        }
    }

    /// A message to the autopilot (deprecated ones included: firmware of their time still uses them), of the companion or of a ground station.
    #[allow(deprecated)]
    pub fn see_companion(&mut self, now_s: f64, header: &MavHeader, message: &MavMessage) {
        let of_companion = header.component_id == COMPANION_COMPONENT;
        if of_companion {
            self.state.setpoints.note_sequence(header.sequence);
        }
        match message {
            MavMessage::TRAJECTORY_REPRESENTATION_BEZIER(_)
            | MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(_) => {
                self.has_trajectories = true;
                self.state.setpoints.note(micros(now_s));
            }
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(_) if of_companion => {
                self.state.setpoints.note(micros(now_s));
            }
            MavMessage::COMMAND_LONG(command) if is_about_modes(command.command) => self.asked_mode_s = now_s,
            MavMessage::COMMAND_INT(command) if is_about_modes(command.command) => self.asked_mode_s = now_s,
            MavMessage::SET_MODE(_) => self.asked_mode_s = now_s,
            _ => self.see_mission(message),
        }
    }

    /// The truth after a step of the simulation.
    pub fn see_truth(&mut self, now_s: f64, position: Point<LocalNed>, on_ground: bool) {
        let flies = self.state.armed && !on_ground;
        let leads = match self.state.mode {
            NavMode::Offboard => true,
            mode => self.has_trajectories && mode.is_automatic(),
        };
        self.state.setpoints.step(micros(now_s), flies && leads);
        let route: Vec<Place> = self.items.iter().flatten().copied().collect();
        while flies
            && let Some(place) = route.get(self.next)
            && is_near(place.position, position, REACHED_M)
        {
            self.next += 1;
        }
        self.state.mission = MissionProgress {
            current: route
                .get(self.next)
                .or(route.last())
                .map_or(0, |place| place.item),
            total: self.items.len() as u16,
            done: !route.is_empty() && self.next >= route.len(),
        };
    }

    fn note_mode(&mut self, now_s: f64, mode: NavMode) {
        let flown = matches!(self.state.mode, NavMode::Mission | NavMode::Offboard);
        let fell = flown && mode == NavMode::Hold && self.state.armed && !self.state.mission.done;
        if fell && now_s - self.asked_mode_s > ASKED_S {
            self.state.hold_count += 1;
        }
        self.state.mode = mode;
    }

    fn see_mission(&mut self, message: &MavMessage) {
        match message {
            MavMessage::MISSION_COUNT(count)
                if count.mission_type == MavMissionType::MAV_MISSION_TYPE_MISSION
                    && usize::from(count.count) != self.items.len() =>
            {
                self.items = vec![None; usize::from(count.count)];
                self.next = 0;
            }
            MavMessage::MISSION_ITEM_INT(item)
                if item.mission_type == MavMissionType::MAV_MISSION_TYPE_MISSION =>
            {
                let place = self.place(item);
                let Some(known) = self.items.get_mut(usize::from(item.seq)) else {
                    return;
                };
                // Read back with its rounding it is the same place.
                let is_new = match (&known, &place) {
                    (Some(known), Some(place)) => !is_near(known.position, place.position, ROUNDING_M),
                    (None, None) => false,
                    _ => true,
                };
                if is_new {
                    *known = place;
                    self.next = 0;
                }
            }
            _ => {}
        }
    }

    #[allow(deprecated)]
    /// Where an item leads to, if it leads anywhere; ArduPilot's item 0 is home.
    fn place(&self, item: &MISSION_ITEM_INT_DATA) -> Option<Place> {
        let is_home = self.make == Make::ArduCopter && item.seq == 0;
        let leads = matches!(
            item.command,
            MavCmd::MAV_CMD_NAV_WAYPOINT | MavCmd::MAV_CMD_NAV_SPLINE_WAYPOINT
        );
        let relative = matches!(
            item.frame,
            MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT | MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
        );
        (leads && relative && !is_home).then(|| {
            let there = self.origin.to_local(GlobalPoint::from_e7(item.x, item.y));
            Place {
                item: item.seq,
                position: Point::new(there.x, there.y, -f64::from(item.z)),
            }
        })
    }
}

fn micros(seconds: f64) -> u64 {
    (seconds * 1e6) as u64
}

fn is_about_modes(command: MavCmd) -> bool {
    matches!(
        command,
        MavCmd::MAV_CMD_DO_SET_MODE
            | MavCmd::MAV_CMD_DO_REPOSITION
            | MavCmd::MAV_CMD_DO_PAUSE_CONTINUE
            | MavCmd::MAV_CMD_NAV_LOITER_UNLIM
            | MavCmd::MAV_CMD_OVERRIDE_GOTO
    )
}

fn is_near(a: Point<LocalNed>, b: Point<LocalNed>, distance_m: f64) -> bool {
    (a.vector() - b.vector()).norm() < distance_m
}

#[cfg(test)]
mod tests {
    use super::AutopilotWatch;
    use jink_emulated_ground_station::Make;
    use jink_shared_types::Point;
    use jink_shared_types::geo::{GlobalPoint, Projection};
    use jink_shared_types::vehicle::NavMode;
    use mavlink::MavHeader;
    use mavlink::dialect::{
        COMMAND_LONG_DATA, HEARTBEAT_DATA, MISSION_COUNT_DATA, MISSION_ITEM_INT_DATA, MavCmd, MavFrame,
        MavMessage, MavMissionType, MavModeFlag,
    };
    use nalgebra::Vector2;

    const HOME: GlobalPoint = GlobalPoint {
        latitude_deg: 47.4,
        longitude_deg: 8.5,
    };
    const AUTOPILOT: MavHeader = MavHeader {
        system_id: 1,
        component_id: 1,
        sequence: 0,
    };
    const STATION: MavHeader = MavHeader {
        system_id: 255,
        component_id: 190,
        sequence: 0,
    };

    fn heartbeat(custom_mode: u32) -> MavMessage {
        MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode,
            base_mode: MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED,
            ..HEARTBEAT_DATA::DEFAULT
        })
    }

    fn upload(watch: &mut AutopilotWatch, places: &[(f64, f64)]) {
        let mission_type = MavMissionType::MAV_MISSION_TYPE_MISSION;
        let count = MISSION_COUNT_DATA {
            count: places.len() as u16,
            mission_type,
            ..MISSION_COUNT_DATA::DEFAULT
        };
        watch.see_companion(0.0, &STATION, &MavMessage::MISSION_COUNT(count));
        for (seq, (north, east)) in (0..).zip(places) {
            let (x, y) = Projection::new(HOME)
                .to_global(Vector2::new(*north, *east))
                .to_e7();
            let item = MISSION_ITEM_INT_DATA {
                seq,
                command: MavCmd::MAV_CMD_NAV_WAYPOINT,
                frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT,
                x,
                y,
                z: 2.5,
                mission_type,
                ..MISSION_ITEM_INT_DATA::DEFAULT
            };
            watch.see_companion(0.0, &STATION, &MavMessage::MISSION_ITEM_INT(item));
        }
    }

    fn fly_to(watch: &mut AutopilotWatch, north: f64, east: f64) -> (u16, bool) {
        watch.see_truth(1.0, Point::new(north, east, -2.5), false);
        let mission = watch.state().mission;
        (mission.current, mission.done)
    }

    #[test]
    fn a_mission_is_done_when_the_vehicle_has_been_everywhere_in_order() {
        let mut watch = AutopilotWatch::new(Make::Px4, HOME);
        watch.see_autopilot(0.0, &AUTOPILOT, &heartbeat(4 << 16 | 4 << 24));
        assert_eq!(watch.state().mode, NavMode::Mission);
        upload(&mut watch, &[(20.0, 0.0), (20.0, 20.0), (20.0, 0.0)]);
        assert_eq!(fly_to(&mut watch, 0.0, 0.0), (0, false));
        assert_eq!(fly_to(&mut watch, 20.0, 19.0), (0, false));
        assert_eq!(fly_to(&mut watch, 19.0, 0.5), (1, false));
        assert_eq!(fly_to(&mut watch, 20.0, 19.0), (2, false));
        assert_eq!(fly_to(&mut watch, 20.0, 1.0), (2, true));
        // The companion reads it back: nothing begins anew.
        upload(&mut watch, &[(20.0, 0.0), (20.0, 20.0), (20.0, 0.0)]);
        assert!(fly_to(&mut watch, 20.0, 1.0).1);
        upload(&mut watch, &[(20.0, 0.0), (30.0, 20.0), (20.0, 0.0)]);
        assert_eq!(fly_to(&mut watch, 10.0, 1.0), (0, false));
    }

    #[test]
    fn home_is_no_waypoint_of_arducopter() {
        let mut watch = AutopilotWatch::new(Make::ArduCopter, HOME);
        watch.see_autopilot(0.0, &AUTOPILOT, &heartbeat(4));
        assert_eq!(watch.state().mode, NavMode::Offboard);
        upload(&mut watch, &[(0.0, 0.0), (20.0, 0.0)]);
        assert_eq!(fly_to(&mut watch, 0.0, 0.0), (1, false));
        assert!(fly_to(&mut watch, 20.0, 0.0).1);
    }

    #[test]
    fn only_a_hold_that_nobody_asked_for_is_counted() {
        let (mission, hold) = (4 << 16 | 4 << 24, 4 << 16 | 3 << 24);
        let mut watch = AutopilotWatch::new(Make::Px4, HOME);
        for (asked, falls) in [(false, 1), (true, 1), (false, 2)] {
            watch.see_autopilot(10.0, &AUTOPILOT, &heartbeat(mission));
            if asked {
                let command = COMMAND_LONG_DATA {
                    command: MavCmd::MAV_CMD_DO_SET_MODE,
                    ..COMMAND_LONG_DATA::DEFAULT
                };
                watch.see_companion(10.5, &STATION, &MavMessage::COMMAND_LONG(command));
            }
            watch.see_autopilot(if asked { 11.0 } else { 20.0 }, &AUTOPILOT, &heartbeat(hold));
            assert_eq!(watch.state().hold_count, falls);
        }
    }
}
