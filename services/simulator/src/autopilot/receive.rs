//! What each received message does.

// The trajectory messages are deprecated for the very reason this emulator exists: current PX4 has dropped them.
#![allow(deprecated)]

use super::Autopilot;
use super::avoidance::point_of;
use super::bezier::{ControlPoint, Curve, POINTS_MAX};
use super::companion_health::{COMPONENT_AVOIDANCE, ForeignHeartbeat};
use super::link::{Link, Packet};
use super::mission_protocol::MissionChange;
use super::position_task::Sticks;
use mavlink::dialects::ardupilotmega::{
    MavMessage, MavSeverity, TIMESYNC_DATA, TRAJECTORY_REPRESENTATION_BEZIER_DATA,
    TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA,
};
use nalgebra::Vector3;

impl Autopilot {
    /// Forwards a packet to the other link and takes it itself where it is meant.
    pub(super) fn receive(&mut self, packet: &Packet, outbox: &mut Vec<Packet>) {
        if packet.link == Link::Companion && packet.header.component_id == COMPONENT_AVOIDANCE {
            self.statistics.note_sequence(packet.header.sequence);
        }
        if let Some(forwarded) = self.wire.forward(packet) {
            outbox.push(forwarded);
        }
        if !self.wire.is_addressed(&packet.message) {
            return;
        }
        match &packet.message {
            MavMessage::HEARTBEAT(heartbeat) => {
                let heartbeat = ForeignHeartbeat {
                    system_id: packet.header.system_id,
                    component_id: packet.header.component_id,
                    kind: heartbeat.mavtype as u8,
                    state: heartbeat.system_status as u8,
                };
                self.commander
                    .hear_heartbeat(self.now_us, self.config.system_id, &heartbeat);
            }
            MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(message) => self.receive_waypoints(message),
            MavMessage::TRAJECTORY_REPRESENTATION_BEZIER(message) => {
                self.receive_bezier(packet.link, message);
            }
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(message) => {
                let yaw_rad = self.estimate.attitude.yaw_rad();
                if self.offboard.receive(self.now_us, yaw_rad, message) {
                    self.statistics.note(self.now_us);
                }
            }
            MavMessage::TIMESYNC(message) => self.receive_timesync(packet.link, message, outbox),
            MavMessage::OBSTACLE_DISTANCE(_) => self.statistics.obstacle_distances += 1,
            MavMessage::MANUAL_CONTROL(message) => {
                self.sticks = Sticks::from_message(message);
                self.commander.hear_sticks(self.now_us);
            }
            MavMessage::COMMAND_LONG(command) => {
                self.execute(packet.link, &packet.header, command, outbox);
            }
            MavMessage::SET_MODE(set) => self.set_mode_message(set.custom_mode, outbox),
            MavMessage::PARAM_REQUEST_LIST(_)
            | MavMessage::PARAM_REQUEST_READ(_)
            | MavMessage::PARAM_SET(_) => {
                self.parameter_protocol
                    .receive(packet, &mut self.parameters, &mut self.wire, outbox);
            }
            _ => self.receive_mission(packet, outbox),
        }
    }

    /// Point 0 only; sender, time stamp and the other points are not looked at, and nothing is checked.
    fn receive_waypoints(&mut self, m: &TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA) {
        let point = point_of(
            [m.pos_x[0], m.pos_y[0], m.pos_z[0]],
            [m.vel_x[0], m.vel_y[0], m.vel_z[0]],
            m.pos_yaw[0],
            m.vel_yaw[0],
        );
        self.avoidance
            .receive_waypoint(self.now_us, m.valid_points > 0, &point);
        self.statistics.note(self.now_us);
    }

    fn receive_bezier(&mut self, link: Link, m: &TRAJECTORY_REPRESENTATION_BEZIER_DATA) {
        let len = usize::from(m.valid_points).min(POINTS_MAX);
        let points = std::array::from_fn(|i| ControlPoint {
            position: Vector3::new(m.pos_x[i], m.pos_y[i], m.pos_z[i]).map(f64::from),
            yaw_rad: f64::from(m.pos_yaw[i]),
        });
        self.avoidance.receive_curve(Curve {
            points,
            len,
            start_us: self.timesync[link as usize].to_boot_us(self.now_us, m.time_usec),
            duration_s: f64::from(m.delta[len.saturating_sub(1)]),
        });
        self.statistics.note(self.now_us);
    }

    fn receive_timesync(&mut self, link: Link, message: &TIMESYNC_DATA, outbox: &mut Vec<Packet>) {
        if message.tc1 == 0 {
            let answer = MavMessage::TIMESYNC(TIMESYNC_DATA {
                tc1: self.now_us as i64 * 1_000,
                ts1: message.ts1,
                ..TIMESYNC_DATA::default()
            });
            self.wire.send(outbox, link, answer);
        } else if self.timesync[link as usize].receive(self.now_us, message.ts1, message.tc1) {
            let text = "Time jump detected. Resetting time synchroniser.";
            self.wire.say(outbox, MavSeverity::MAV_SEVERITY_ERROR, text);
        }
    }

    fn receive_mission(&mut self, packet: &Packet, outbox: &mut Vec<Packet>) {
        let change =
            self.mission_protocol
                .receive(self.now_us, packet, &mut self.mission, &mut self.wire, outbox);
        match change {
            MissionChange::None => {}
            MissionChange::Replaced => self.navigator.jump_to(0),
            MissionChange::JumpTo(item) => self.navigator.jump_to(item),
        }
    }
}
