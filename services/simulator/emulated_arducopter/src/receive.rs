//! What each received message does.

// Ground stations still send SET_MODE and REQUEST_DATA_STREAM.
#![allow(deprecated)]

use super::auto::State;
use super::parameters::Parameter as P;
use super::setpoint::{NotFinite, read};
use super::{Abort, ArduCopter};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::Link;
use jink_emulated_autopilot::link::Packet;
use jink_emulated_autopilot::messages;
use jink_emulated_autopilot::mission_protocol::MissionChange;
use jink_emulated_autopilot::modes::arducopter::Mode;
use jink_shared_types::geo::GlobalPoint;
use mavlink::Message;
use mavlink::dialect::{
    MavFrame, MavMessage, MavSeverity, SET_POSITION_TARGET_GLOBAL_INT_DATA,
    SET_POSITION_TARGET_LOCAL_NED_DATA, STATUSTEXT_DATA,
};

/// Bit of MAVn_OPTIONS: nothing is forwarded to and from the link.
const NO_FORWARD: u32 = 2;

impl ArduCopter {
    /// Forwards a packet to the other link and takes it itself where it is meant.
    pub(super) fn receive(&mut self, packet: &Packet, outbox: &mut Vec<Packet>) {
        self.statistics.note_packet(packet);
        if self.may_forward(packet) {
            outbox.extend(self.wire.forward(packet));
        }
        match &packet.message {
            // Setpoints: the target system counts, the target component does not.
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(message) if self.is_my_system(packet) => {
                self.receive_setpoint(message);
            }
            MavMessage::SET_POSITION_TARGET_GLOBAL_INT(message) if self.is_my_system(packet) => {
                if let Some(local) = self.to_local(message) {
                    self.receive_setpoint(&local);
                }
            }
            _ if self.wire.is_addressed(&packet.message) => self.receive_own(packet, outbox),
            _ => {}
        }
    }

    /// A link that does not forward (MAVn_OPTIONS) gives nothing on, and takes only what is meant for somebody on it.
    fn may_forward(&self, packet: &Packet) -> bool {
        let keeps_apart = |link: Link| self.link_options[link as usize] & NO_FORWARD != 0;
        let is_for_everybody = packet.message.target_system_id().unwrap_or(0) == 0;
        !(keeps_apart(packet.link) || keeps_apart(packet.link.other()) && is_for_everybody)
    }

    fn is_my_system(&self, packet: &Packet) -> bool {
        let system = packet.message.target_system_id().unwrap_or(0);
        system == 0 || system == self.config.system_id
    }

    fn receive_own(&mut self, packet: &Packet, outbox: &mut Vec<Packet>) {
        match &packet.message {
            MavMessage::HEARTBEAT(_) => {
                let station = self.parameters.get(P::MAV_GCS_SYSID);
                self.station
                    .receive(self.now_us, packet.header.system_id, station);
            }
            MavMessage::TIMESYNC(message) if message.tc1 == 0 => {
                let answer = messages::timesync_answer(self.now_us, message.ts1);
                self.wire.send(outbox, packet.link, answer);
            }
            MavMessage::OBSTACLE_DISTANCE(message) => {
                self.statistics.obstacle_distances += 1;
                self.proximity.receive(self.now_us, message, &self.parameters);
            }
            MavMessage::OBSTACLE_DISTANCE_3D(message) => {
                self.proximity.receive_3d(self.now_us, message, &self.parameters);
            }
            MavMessage::RC_CHANNELS_OVERRIDE(message) => {
                let station = self.parameters.get(P::MAV_GCS_SYSID);
                if f64::from(packet.header.system_id) == station {
                    self.sticks.receive(self.now_us, message);
                }
            }
            MavMessage::COMMAND_LONG(_) | MavMessage::COMMAND_INT(_) => self.execute(packet, outbox),
            MavMessage::SET_MODE(set) => {
                if let Some(mode) = Mode::of_custom(set.custom_mode) {
                    self.change_mode(mode, outbox);
                }
            }
            MavMessage::REQUEST_DATA_STREAM(request) => {
                let rate_hz = match request.start_stop {
                    0 => 0.0,
                    _ => f64::from(request.req_message_rate),
                };
                self.streams.set_all(self.now_us, packet.link, rate_hz);
            }
            MavMessage::PARAM_REQUEST_LIST(_)
            | MavMessage::PARAM_REQUEST_READ(_)
            | MavMessage::PARAM_SET(_) => {
                self.parameter_protocol
                    .receive(packet, &mut self.parameters, &mut self.wire, outbox);
            }
            _ => self.receive_mission(packet, outbox),
        }
    }

    /// In GUIDED only; elsewhere setpoints are ignored without a trace.
    fn receive_setpoint(&mut self, message: &SET_POSITION_TARGET_LOCAL_NED_DATA) {
        if self.mode != Mode::Guided {
            return;
        }
        match read(message, &self.estimate) {
            Ok(request) => {
                self.statistics.note(self.now_us);
                self.guided.receive(
                    &request,
                    self.now_us,
                    &self.estimate,
                    &self.parameters,
                    &mut self.control,
                    &mut self.yaw,
                );
            }
            Err(NotFinite { group }) => {
                self.aborted = Some(Abort {
                    time_s: self.time_s(),
                    group,
                });
            }
        }
    }

    /// A global setpoint as a local one; `None` in a frame it cannot be in.
    fn to_local(
        &self,
        m: &SET_POSITION_TARGET_GLOBAL_INT_DATA,
    ) -> Option<SET_POSITION_TARGET_LOCAL_NED_DATA> {
        let up_m = f64::from(m.alt);
        let down_m = match m.coordinate_frame {
            MavFrame::MAV_FRAME_GLOBAL | MavFrame::MAV_FRAME_GLOBAL_INT => {
                self.frame.origin_altitude_m - up_m
            }
            MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT | MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT => {
                self.frame.home_down_m - up_m
            }
            _ => return None,
        };
        let at = GlobalPoint::from_e7(m.lat_int, m.lon_int);
        let level = self.frame.projection.to_local(at);
        Some(SET_POSITION_TARGET_LOCAL_NED_DATA {
            time_boot_ms: m.time_boot_ms,
            x: level.x as f32,
            y: level.y as f32,
            z: down_m as f32,
            vx: m.vx,
            vy: m.vy,
            vz: m.vz,
            afx: m.afx,
            afy: m.afy,
            afz: m.afz,
            yaw: m.yaw,
            yaw_rate: m.yaw_rate,
            type_mask: m.type_mask,
            target_system: m.target_system,
            target_component: m.target_component,
            coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
        })
    }

    fn receive_mission(&mut self, packet: &Packet, outbox: &mut Vec<Packet>) {
        self.mission_protocol.keeps_mission = self.armed && self.auto.state() == State::Running;
        let change =
            self.mission_protocol
                .receive(self.now_us, packet, &mut self.mission, &mut self.wire, outbox);
        match change {
            MissionChange::None => {}
            MissionChange::Replaced(link) => {
                self.store_mission();
                // Only whoever has sent it is notified.
                let text = MavMessage::STATUSTEXT(STATUSTEXT_DATA {
                    severity: MavSeverity::MAV_SEVERITY_INFO,
                    text: "Flight plan received".into(),
                    ..STATUSTEXT_DATA::default()
                });
                self.wire.send(outbox, link, text);
                if self.auto.take_change() {
                    let text = "Auto mission changed, restarted command";
                    self.wire.say(outbox, MavSeverity::MAV_SEVERITY_CRITICAL, text);
                }
            }
            MissionChange::Cleared => self.auto.forget(),
            MissionChange::JumpTo(item) => {
                if self.auto.jump_to(item, &self.mission) {
                    let mut current = self.mission_current();
                    current.seq = item as u16;
                    self.wire
                        .send(outbox, packet.link, MavMessage::MISSION_CURRENT(current));
                }
            }
        }
    }

    /// As ArduCopter keeps items: the first is home, and frames of the integer protocol lose their name.
    fn store_mission(&mut self) {
        for index in 0..self.mission.len() {
            if let Some(item) = self.mission.get_mut(index) {
                item.frame = match item.frame {
                    MavFrame::MAV_FRAME_GLOBAL_INT => MavFrame::MAV_FRAME_GLOBAL,
                    MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT => MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT,
                    frame => frame,
                };
            }
        }
        self.store_home_item();
    }

    /// Item 0 is home.
    pub(super) fn store_home_item(&mut self) {
        let (x, y) = self.frame.projection.to_global(self.home.xy()).to_e7();
        if let Some(item) = self.mission.get_mut(0) {
            item.frame = MavFrame::MAV_FRAME_GLOBAL;
            item.command = mavlink::dialect::MavCmd::MAV_CMD_NAV_WAYPOINT;
            (item.x, item.y) = (x, y);
            item.z = (self.frame.origin_altitude_m - self.home.z) as f32;
        }
    }
}
