//! What each received message does.

// The trajectory messages are deprecated for the very reason this emulator exists: current PX4 has dropped them.
#![allow(deprecated)]

use super::Px4;
use super::avoidance::point_of;
use super::bezier::{ControlPoint, Curve, POINTS_MAX};
use super::companion_health::ForeignHeartbeat;
use super::obstacle_messages;
use super::parameters::Parameter;
use super::position_task::Sticks;
use jink_emulated_autopilot::link::{Link, Packet};
use jink_emulated_autopilot::messages;
use jink_emulated_autopilot::mission_protocol::MissionChange;
use mavlink::dialect::{
    MANUAL_CONTROL_DATA, MavMessage, MavSeverity, SET_POSITION_TARGET_LOCAL_NED_DATA, TIMESYNC_DATA,
    TRAJECTORY_REPRESENTATION_BEZIER_DATA, TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA,
};
use nalgebra::Vector3;

impl Px4 {
    /// Whether a packet is one that goes on to the other link at all.
    fn passes_on(&self, packet: &Packet) -> bool {
        let is_stations_heartbeat =
            packet.link == Link::GroundStation && matches!(packet.message, MavMessage::HEARTBEAT(_));
        !is_stations_heartbeat || self.parameters.get(Parameter::MAV_HB_FORW_EN) != 0.0
    }

    /// Forwards a packet to the other link and takes it itself where it is meant.
    pub(super) fn receive(&mut self, packet: &Packet, outbox: &mut Vec<Packet>) {
        self.statistics.note_packet(packet);
        if self.passes_on(packet) {
            outbox.extend(self.wire.forward(packet));
        }
        if !self.wire.is_addressed(&packet.message) {
            return;
        }
        let interface = self.config.firmware.has_trajectory_interface();
        match &packet.message {
            MavMessage::HEARTBEAT(heartbeat) => {
                let heartbeat = ForeignHeartbeat {
                    system_id: packet.header.system_id,
                    component_id: packet.header.component_id,
                    kind: heartbeat.mavtype as u8,
                    state: heartbeat.system_status as u8,
                };
                self.commander
                    .receive_heartbeat(self.now_us, self.config.system_id, &heartbeat);
            }
            MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(message) if interface => {
                self.receive_waypoints(message);
            }
            MavMessage::TRAJECTORY_REPRESENTATION_BEZIER(message) if interface => {
                self.receive_bezier(packet.link, message);
            }
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(message) => self.receive_setpoint(message, outbox),
            MavMessage::TIMESYNC(message) => self.receive_timesync(packet.link, message, outbox),
            MavMessage::OBSTACLE_DISTANCE(message) => {
                self.statistics.obstacle_distances += 1;
                self.collision_prevention
                    .obstacle_distance(obstacle_messages::scan(self.now_us, message));
            }
            MavMessage::DISTANCE_SENSOR(message) => {
                let reading = obstacle_messages::reading(self.now_us, message);
                self.collision_prevention
                    .distance_sensor(packet.link as usize, reading);
            }
            MavMessage::MANUAL_CONTROL(message) => self.receive_sticks(message, outbox),
            MavMessage::COMMAND_LONG(_) | MavMessage::COMMAND_INT(_) => self.execute(packet, outbox),
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

    /// Sender and time stamp are not looked at.
    fn receive_setpoint(&mut self, m: &SET_POSITION_TARGET_LOCAL_NED_DATA, outbox: &mut Vec<Packet>) {
        let yaw_rad = self.estimate.attitude.yaw_rad();
        let result = self.offboard.receive(self.now_us, yaw_rad, m);
        let explains = self.config.firmware.explains_bad_setpoints();
        match result {
            Ok(()) => self.statistics.note(self.now_us),
            Err(error) if explains => {
                let severity = MavSeverity::MAV_SEVERITY_CRITICAL;
                self.wire.say_with(outbox, severity, format_args!("{error}"));
            }
            Err(_) => {}
        }
    }

    fn receive_sticks(&mut self, message: &MANUAL_CONTROL_DATA, outbox: &mut Vec<Packet>) {
        self.sticks = Sticks::from_message(message);
        self.commander.receive_sticks(self.now_us);
        let limit_per_s = self.parameters.get(Parameter::MAN_OVERRIDE_SPD);
        let fast = self.stick_speed.receive(self.now_us, message, limit_per_s);
        if fast && self.commander.take_over(self.is_ready()) {
            let text = "Pilot took over using sticks";
            self.wire.say(outbox, MavSeverity::MAV_SEVERITY_INFO, text);
        }
    }

    fn receive_timesync(&mut self, link: Link, message: &TIMESYNC_DATA, outbox: &mut Vec<Packet>) {
        if message.tc1 == 0 {
            let answer = messages::timesync_answer(self.now_us, message.ts1);
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
            MissionChange::Replaced(_) | MissionChange::Cleared => self.navigator.start_over(),
            MissionChange::JumpTo(item) => self.jump_to_item(item, outbox),
        }
    }
}
