//! What each message of the autopilot changes.

use super::GroundStation;
use super::make::Make;
use super::progress::Phase;
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::geo::GlobalPoint;
use jink_shared_types::vehicle::NavMode;
use mavlink::MavHeader;
use mavlink::dialect::{COMMAND_ACK_DATA, MavAutopilot, MavCmd, MavMessage, MavModeFlag, MavResult};

/// A waypoint on the way, and the last one, counts as reached this near (m) when nobody says so: an autopilot that follows
/// setpoints (OFFBOARD, GUIDED) does not announce the items of its mission.
const REACHED_M: [f64; 2] = [1.0, 0.5];

impl GroundStation {
    pub(super) fn receive(
        &mut self,
        now_s: f64,
        header: &MavHeader,
        message: &MavMessage,
        outbox: &mut Vec<(MavHeader, MavMessage)>,
    ) {
        let from = header.system_id as u8;
        if header.component_id != 1 || self.vehicle.system_id.is_some_and(|id| id != from) {
            return;
        }
        match message {
            MavMessage::HEARTBEAT(beat) if beat.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID => {
                self.vehicle.system_id = Some(from);
                self.vehicle.armed = beat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
                self.vehicle.make = Make::of(beat.autopilot);
                self.note_mode(self.vehicle.make.mode(beat.custom_mode));
            }
            MavMessage::GLOBAL_POSITION_INT(p) => {
                self.vehicle.global = Some(GlobalPoint::from_e7(p.lat, p.lon));
                self.vehicle.altitude_m = f64::from(p.alt) * 1e-3;
            }
            MavMessage::LOCAL_POSITION_NED(p) => {
                let position = Point::new(f64::from(p.x), f64::from(p.y), f64::from(p.z));
                self.vehicle.local = Some(position);
                if let Some(goal) = self.plan.waypoints.last() {
                    self.progress.to_goal_m = (goal.vector() - position.vector()).norm();
                }
                self.note_place(position);
            }
            MavMessage::STATUSTEXT(text) => {
                self.progress.said = text.text.to_str().unwrap_or("").to_owned();
            }
            MavMessage::COMMAND_ACK(ack) if self.is_answer(ack.command) => {
                self.acting.answered |= ack.result == MavResult::MAV_RESULT_ACCEPTED;
            }
            // The autopilot flies it from now on; a heartbeat may report that only a second later.
            MavMessage::COMMAND_ACK(ack) if self.starts_mission(ack) => self.note_mode(NavMode::Mission),
            MavMessage::MISSION_CURRENT(current) if self.is_chosen(current.seq) => {
                self.acting.answered = true;
            }
            MavMessage::MISSION_ACK(_) if self.clears_mission() => self.acting.answered = true,
            MavMessage::COMMAND_ACK(ack)
                if ack.result != MavResult::MAV_RESULT_ACCEPTED && self.progress.said.is_empty() =>
            {
                self.progress.said = format!("{:?} answered {:?}", ack.command, ack.result);
            }
            MavMessage::MISSION_ITEM_REACHED(item) => self.note_reached(item.seq),
            _ => {}
        }
        let answer = self
            .upload
            .as_mut()
            .and_then(|upload| upload.receive(now_s, message));
        if let Some(answer) = answer {
            self.send(outbox, answer);
        }
    }

    /// Whether the request to fly the mission was accepted.
    fn starts_mission(&self, ack: &COMMAND_ACK_DATA) -> bool {
        ack.command == MavCmd::MAV_CMD_DO_SET_MODE
            && ack.result == MavResult::MAV_RESULT_ACCEPTED
            && self.progress.phase == Phase::Mission
            && self.action().is_none()
    }

    fn note_mode(&mut self, mode: NavMode) {
        let flown = matches!(self.progress.mode, NavMode::Mission | NavMode::Offboard);
        let left = flown && mode == NavMode::Hold;
        if self.progress.phase == Phase::Mission && left && !self.is_finished() {
            self.progress.fell_out += 1;
        }
        self.progress.mode = mode;
    }

    fn note_reached(&mut self, sequence: u16) {
        let first = self.plan.items_before_waypoints(self.vehicle.make);
        let reached = (usize::from(sequence) + 1).saturating_sub(first);
        self.progress.reached = self.progress.reached.max(reached.min(self.plan.waypoints.len()));
    }

    /// Waypoints that were flown to by setpoints.
    fn note_place(&mut self, position: Point<LocalNed>) {
        if self.progress.phase != Phase::Mission || self.progress.mode != NavMode::Offboard {
            return;
        }
        let Some(next) = self.plan.waypoints.get(self.progress.reached) else {
            return;
        };
        let [on_the_way_m, last_m] = REACHED_M;
        let is_last = self.progress.reached + 1 == self.plan.waypoints.len();
        let near_m = if is_last { last_m } else { on_the_way_m };
        if (next.vector() - position.vector()).norm() < near_m {
            self.progress.reached += 1;
        }
    }
}
