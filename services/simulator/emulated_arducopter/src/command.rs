//! Commands and their acknowledgements.

// Some commands have newer names that nobody sends yet.
#![allow(deprecated)]

use super::ArduCopter;
use super::guided::Submode;
use super::setpoint::{Request, YawRequest};
use super::streams::Stream;
use jink_emulated_autopilot::command_place::{CommandPlace, command_of};
use jink_emulated_autopilot::link::{Link, Packet};
use jink_emulated_autopilot::messages;
use jink_emulated_autopilot::modes::arducopter::Mode;
use mavlink::dialect::{
    AUTOPILOT_VERSION_DATA, COMMAND_LONG_DATA, MavCmd, MavMessage, MavModeFlag, MavProtocolCapability,
    MavResult, MavSeverity,
};
use nalgebra::Vector3;

/// 4.7.0, development.
const FLIGHT_SOFTWARE_VERSION: u32 = 4 << 24 | 7 << 16;

impl ArduCopter {
    /// Executes the command in `packet` and acknowledges it to its sender.
    pub(super) fn execute(&mut self, packet: &Packet, outbox: &mut Vec<Packet>) {
        let Some((command, place)) = command_of(&packet.message) else {
            return;
        };
        let result = self.result_of(packet.link, &command, place, outbox);
        let ack = messages::acknowledgement(&packet.header, command.command, result);
        self.wire.send(outbox, packet.link, ack);
    }

    /// `place`: where the command leads.
    fn result_of(
        &mut self,
        link: Link,
        command: &COMMAND_LONG_DATA,
        place: CommandPlace,
        outbox: &mut Vec<Packet>,
    ) -> MavResult {
        use MavResult as R;
        match command.command {
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM => {
                self.arm_or_disarm(command.param1 == 1.0, command.param2, outbox)
            }
            MavCmd::MAV_CMD_DO_SET_MODE => {
                let custom = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED.bits();
                match Mode::of_custom(command.param2 as u32) {
                    _ if command.param1 as u8 & custom == 0 => R::MAV_RESULT_DENIED,
                    Some(mode) => self.change_mode(mode, outbox),
                    None => R::MAV_RESULT_FAILED,
                }
            }
            MavCmd::MAV_CMD_NAV_TAKEOFF => self.take_off(f64::from(command.param7)),
            MavCmd::MAV_CMD_NAV_LAND => self.change_mode(Mode::Land, outbox),
            MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH => self.change_mode(Mode::Rtl, outbox),
            MavCmd::MAV_CMD_NAV_LOITER_UNLIM => self.change_mode(Mode::Loiter, outbox),
            MavCmd::MAV_CMD_MISSION_START => self.start_mission(outbox),
            MavCmd::MAV_CMD_DO_CHANGE_SPEED => self.change_speed(command.param1, f64::from(command.param2)),
            MavCmd::MAV_CMD_DO_SET_MISSION_CURRENT => {
                let item = command.param1 as usize;
                if item >= self.mission.len() {
                    return R::MAV_RESULT_DENIED;
                }
                if !self.auto.jump_to(item, &self.mission) {
                    return R::MAV_RESULT_FAILED;
                }
                self.send_stream(link, Stream::MissionCurrent, outbox);
                R::MAV_RESULT_ACCEPTED
            }
            MavCmd::MAV_CMD_DO_REPOSITION => self.go_to(command.param2, place, outbox),
            MavCmd::MAV_CMD_DO_PAUSE_CONTINUE => self.pause(command.param1),
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => {
                self.set_interval(link, command.param1 as u32, f64::from(command.param2), outbox)
            }
            MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL => self.report_interval(link, command.param1 as u32, outbox),
            MavCmd::MAV_CMD_REQUEST_MESSAGE => self.send_once(link, command.param1 as u32, outbox),
            MavCmd::MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES => {
                self.send_once(link, Stream::AutopilotVersion as u32, outbox)
            }
            _ => R::MAV_RESULT_UNSUPPORTED,
        }
    }

    /// Anybody may change the mode. The heartbeat that reports it goes out at once.
    pub(super) fn change_mode(&mut self, mode: Mode, outbox: &mut Vec<Packet>) -> MavResult {
        if mode == self.mode {
            return MavResult::MAV_RESULT_ACCEPTED;
        }
        let on_ground = self.land_detector.is_landed();
        let reason = if mode.needs_position() && !self.is_ready() {
            Some("requires position")
        } else if mode == Mode::Auto && self.mission.len() < 2 {
            Some("init failed")
        } else if mode == Mode::Auto && on_ground && self.armed && !self.begins_with_takeoff() {
            Some("Missing Takeoff Cmd")
        } else {
            None
        };
        if let Some(reason) = reason {
            let (severity, name) = (MavSeverity::MAV_SEVERITY_WARNING, mode.name());
            let text = format_args!("Mode change to {name} failed: {reason}");
            self.wire.say_with(outbox, severity, text);
            return MavResult::MAV_RESULT_FAILED;
        }
        self.enter(mode);
        let heartbeat = self.heartbeat();
        self.wire.broadcast(outbox, &heartbeat);
        MavResult::MAV_RESULT_ACCEPTED
    }

    fn begins_with_takeoff(&self) -> bool {
        use jink_emulated_autopilot::mission::Task;
        let first = self.mission.next_place(1);
        first.and_then(|item| self.mission.task(item)) == Some(Task::Takeoff)
    }

    /// NAV_TAKEOFF: in GUIDED, armed, on the ground, to a height above home.
    fn take_off(&mut self, height_m: f64) -> MavResult {
        let possible = self.mode == Mode::Guided
            && self.armed
            && self.land_detector.is_landed()
            && self.home.z - height_m < self.estimate.position.z_m;
        if !possible {
            return MavResult::MAV_RESULT_FAILED;
        }
        self.may_take_off = true;
        let down_m = self.home.z - height_m;
        self.guided
            .take_off(self.now_us, down_m, &self.estimate, &mut self.yaw);
        MavResult::MAV_RESULT_ACCEPTED
    }

    fn start_mission(&mut self, outbox: &mut Vec<Packet>) -> MavResult {
        if !self.armed {
            return MavResult::MAV_RESULT_FAILED;
        }
        let result = self.change_mode(Mode::Auto, outbox);
        self.may_take_off |= result == MavResult::MAV_RESULT_ACCEPTED;
        result
    }

    /// DO_REPOSITION: in GUIDED a position like a setpoint's. The first bit of `flags` asks for that mode.
    fn go_to(&mut self, flags: f32, place: CommandPlace, outbox: &mut Vec<Packet>) -> MavResult {
        if self.mode != Mode::Guided && flags as u32 & 1 == 0 {
            return MavResult::MAV_RESULT_DENIED;
        }
        let Some((level, down_m)) = place.level(&self.frame).zip(place.down_m(&self.frame)) else {
            return MavResult::MAV_RESULT_DENIED;
        };
        if self.change_mode(Mode::Guided, outbox) != MavResult::MAV_RESULT_ACCEPTED {
            return MavResult::MAV_RESULT_FAILED;
        }
        let to = Vector3::new(level.x, level.y, down_m);
        self.guided.receive(
            &Request::Place(to, YawRequest::Default),
            self.now_us,
            &self.estimate,
            &self.parameters,
            &mut self.control,
            &mut self.yaw,
        );
        MavResult::MAV_RESULT_ACCEPTED
    }

    /// DO_CHANGE_SPEED: 0 and 1 horizontal, 2 up, 3 down; until the mode or GUIDED's submode begins anew.
    fn change_speed(&mut self, kind: f32, speed_mps: f64) -> MavResult {
        if speed_mps.is_nan() || speed_mps <= 0.0 {
            return MavResult::MAV_RESULT_FAILED;
        }
        let limits = &mut self.control.limits;
        match kind as i32 {
            0 | 1 => limits.speed_mps = speed_mps,
            2 => limits.up_mps = speed_mps,
            3 => limits.down_mps = speed_mps,
            _ => return MavResult::MAV_RESULT_FAILED,
        }
        MavResult::MAV_RESULT_ACCEPTED
    }

    /// DO_PAUSE_CONTINUE: 0 pauses, 1 goes on.
    fn pause(&mut self, wish: f32) -> MavResult {
        let paused = match wish as i32 {
            0 => true,
            1 => false,
            _ => return MavResult::MAV_RESULT_DENIED,
        };
        let possible = match self.mode {
            Mode::Guided if self.guided.submode() != Submode::TakeOff => {
                self.guided.pause(paused);
                true
            }
            Mode::Auto => self.auto.pause(paused, &self.control),
            _ => false,
        };
        match possible {
            true => MavResult::MAV_RESULT_ACCEPTED,
            false => MavResult::MAV_RESULT_FAILED,
        }
    }

    fn set_interval(&mut self, link: Link, id: u32, interval_us: f64, outbox: &mut Vec<Packet>) -> MavResult {
        if self.streams.set_interval(self.now_us, link, id, interval_us) {
            return MavResult::MAV_RESULT_ACCEPTED;
        }
        let text = format_args!("No ap_message for mavlink id ({id})");
        self.wire.say_with(outbox, MavSeverity::MAV_SEVERITY_INFO, text);
        MavResult::MAV_RESULT_DENIED
    }

    fn report_interval(&mut self, link: Link, id: u32, outbox: &mut Vec<Packet>) -> MavResult {
        let message = messages::message_interval(id, self.streams.interval_us(link, id));
        self.wire.send(outbox, link, message);
        MavResult::MAV_RESULT_ACCEPTED
    }

    fn send_once(&mut self, link: Link, id: u32, outbox: &mut Vec<Packet>) -> MavResult {
        let Some(stream) = Stream::of_id(id) else {
            return MavResult::MAV_RESULT_FAILED;
        };
        self.send_stream(link, stream, outbox);
        MavResult::MAV_RESULT_ACCEPTED
    }
}

/// AUTOPILOT_VERSION.
pub(super) fn version_message() -> MavMessage {
    use MavProtocolCapability as C;
    MavMessage::AUTOPILOT_VERSION(AUTOPILOT_VERSION_DATA {
        capabilities: C::MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT
            | C::MAV_PROTOCOL_CAPABILITY_MISSION_INT
            | C::MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
            | C::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
            | C::MAV_PROTOCOL_CAPABILITY_COMMAND_INT
            | C::MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
            | C::MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
            | C::MAV_PROTOCOL_CAPABILITY_MAVLINK2,
        flight_sw_version: FLIGHT_SOFTWARE_VERSION,
        ..AUTOPILOT_VERSION_DATA::default()
    })
}
