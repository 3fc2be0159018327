//! Carries out the actions of a plan in flight: what is sent for each, and which answer ends it.

use super::GroundStation;
use super::in_flight::Action;
use super::item::PlanItem;
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::geo::Projection;
use mavlink::MavHeader;
use mavlink::dialect::{
    COMMAND_INT_DATA, MISSION_CLEAR_ALL_DATA, MavCmd, MavFrame, MavMessage, MavMissionType,
};

/// A message without an answer is said so often.
const SAID_ENOUGH: u32 = 3;

impl GroundStation {
    /// What the plan wants done in flight. Returns whether something is under way.
    pub(super) fn act_in_flight(&mut self, now_s: f64, outbox: &mut Vec<(MavHeader, MavMessage)>) -> bool {
        self.acting.since_s.get_or_insert(now_s);
        let Some(step) = self.plan.in_flight.get(self.acting.index).cloned() else {
            return false;
        };
        if !self.acting.begun {
            let north_m = self.vehicle.local.map(|local| local.x_m);
            if !self.acting.is_due(step.when, now_s, north_m) {
                return false;
            }
            self.acting.begun = true;
            self.asked_s = f64::NEG_INFINITY;
        }
        let done = match &step.action {
            Action::Upload { waypoints, tail } => self.upload_in_flight(now_s, waypoints, tail, outbox),
            _ => self.say_in_flight(now_s, &step.action, outbox),
        };
        if done {
            self.acting.finish(now_s, step.action.wants_mission());
        }
        !done
    }

    fn upload_in_flight(
        &mut self,
        now_s: f64,
        waypoints: &[Point<LocalNed>],
        tail: &[PlanItem],
        outbox: &mut Vec<(MavHeader, MavMessage)>,
    ) -> bool {
        if self.upload.is_none() {
            self.plan.waypoints = waypoints.to_vec();
            self.plan.tail = tail.to_vec();
            self.progress.waypoints = waypoints.len();
            self.progress.reached = 0;
        }
        self.upload_plan(now_s, outbox)
    }

    fn say_in_flight(
        &mut self,
        now_s: f64,
        action: &Action,
        outbox: &mut Vec<(MavHeader, MavMessage)>,
    ) -> bool {
        if self.acting.answered || self.acting.said >= SAID_ENOUGH {
            return true;
        }
        if self.may_ask(now_s)
            && let Some(message) = self.message_for(action)
        {
            self.acting.said += 1;
            self.send(outbox, message);
        }
        false
    }

    /// What says it; `None` while the vehicle's place is not known, or for a mode that the make has not.
    fn message_for(&self, action: &Action) -> Option<MavMessage> {
        let target_system = self.target();
        let message = match action {
            Action::Upload { .. } => return None,
            Action::ClearMission => MavMessage::MISSION_CLEAR_ALL(MISSION_CLEAR_ALL_DATA {
                target_system,
                target_component: 1,
                mission_type: MavMissionType::MAV_MISSION_TYPE_MISSION,
            }),
            Action::SetCurrent { item } => set_current(*item, target_system),
            Action::Mode(mode) => return self.vehicle.make.mode_command(*mode, target_system),
            Action::GoTo(place) | Action::Orbit(place) => {
                // Its own speed, and the mode that goes there; radius and speed of the circle.
                let (command, param1, param2) = match action {
                    Action::Orbit(_) => (MavCmd::MAV_CMD_DO_ORBIT, 5.0, 2.0),
                    _ => (MavCmd::MAV_CMD_DO_REPOSITION, -1.0, 1.0),
                };
                let (global, local) = self.vehicle.global.zip(self.vehicle.local)?;
                let offset = (place.vector() - local.vector()).xy();
                let (x, y) = Projection::new(global).to_global(offset).to_e7();
                MavMessage::COMMAND_INT(COMMAND_INT_DATA {
                    target_system,
                    target_component: 1,
                    frame: MavFrame::MAV_FRAME_GLOBAL,
                    command,
                    param1,
                    param2,
                    param4: f32::NAN,
                    x,
                    y,
                    z: (self.vehicle.altitude_m + local.z_m - place.z_m) as f32,
                    ..COMMAND_INT_DATA::default()
                })
            }
        };
        Some(message)
    }

    /// The action under way, if there is one.
    pub(super) fn action(&self) -> Option<&Action> {
        let action = self.plan.in_flight.get(self.acting.index);
        action.filter(|_| self.acting.begun).map(|step| &step.action)
    }

    pub(super) fn is_answer(&self, to: MavCmd) -> bool {
        match self.action() {
            Some(Action::GoTo(_)) => to == MavCmd::MAV_CMD_DO_REPOSITION,
            Some(Action::Orbit(_)) => to == MavCmd::MAV_CMD_DO_ORBIT,
            Some(Action::Mode(_)) => to == MavCmd::MAV_CMD_DO_SET_MODE,
            _ => false,
        }
    }

    pub(super) fn is_chosen(&self, sequence: u16) -> bool {
        matches!(self.action(), Some(Action::SetCurrent { item }) if *item == sequence)
    }

    pub(super) fn clears_mission(&self) -> bool {
        matches!(self.action(), Some(Action::ClearMission))
    }
}

// PX4 before July 2026 has no command for it.
#[allow(deprecated)]
fn set_current(seq: u16, target_system: u8) -> MavMessage {
    MavMessage::MISSION_SET_CURRENT(mavlink::dialect::MISSION_SET_CURRENT_DATA {
        seq,
        target_system,
        target_component: 1,
    })
}
