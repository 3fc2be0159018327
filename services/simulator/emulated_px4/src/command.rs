//! Commands: COMMAND_LONG, COMMAND_INT, SET_MODE, and their acknowledgements.

// Ground stations still send the older ones of the commands below.
#![allow(deprecated)]

use super::Px4;
use super::firmware::Firmware;
use super::navigator::Reposition;
use super::orbit::Orbit;
use super::parameters::Parameter;
use super::refusal::Refusal;
use super::streams::Stream;
use jink_emulated_autopilot::command_place::{CommandPlace, command_of};
use jink_emulated_autopilot::link::{Link, Packet};
use jink_emulated_autopilot::messages;
use jink_emulated_autopilot::modes::px4::{mode_of, mode_of_custom};
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::{
    AUTOPILOT_VERSION_DATA, COMMAND_LONG_DATA, MavCmd, MavMessage, MavProtocolCapability, MavResult,
    MavSeverity,
};
use nalgebra::Vector3;

/// `param2` of MAV_CMD_COMPONENT_ARM_DISARM that forces it.
const FORCE: f32 = 21_196.0;
/// Message id of AUTOPILOT_VERSION.
const AUTOPILOT_VERSION_ID: u32 = 148;

impl Px4 {
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
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM => self.arm_or_disarm(command, outbox),
            MavCmd::MAV_CMD_DO_SET_MODE => match mode_of(command.param2 as u8, command.param3 as u8) {
                Some(mode) => self.change_mode(mode, outbox),
                None => R::MAV_RESULT_DENIED,
            },
            MavCmd::MAV_CMD_NAV_TAKEOFF => self.change_mode(NavMode::Takeoff, outbox),
            MavCmd::MAV_CMD_NAV_LAND => self.change_mode(NavMode::Land, outbox),
            MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH => self.change_mode(NavMode::Return, outbox),
            MavCmd::MAV_CMD_MISSION_START => self.change_mode(NavMode::Mission, outbox),
            MavCmd::MAV_CMD_DO_CHANGE_SPEED => {
                self.navigator.set_speed(f64::from(command.param2));
                R::MAV_RESULT_ACCEPTED
            }
            MavCmd::MAV_CMD_DO_REPOSITION => self.go_to(command, place, outbox),
            MavCmd::MAV_CMD_DO_ORBIT => {
                let here = self.estimate.position.vector();
                self.orbit = Some(Orbit::of(command, place, &self.frame, here));
                self.change_mode(NavMode::Orbit, outbox)
            }
            MavCmd::MAV_CMD_DO_SET_MISSION_CURRENT => {
                let item = command.param1 as usize;
                if item >= self.mission.len() {
                    return R::MAV_RESULT_DENIED;
                }
                self.jump_to_item(item, outbox);
                R::MAV_RESULT_ACCEPTED
            }
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => {
                let (id, interval_us) = (command.param1 as u32, f64::from(command.param2));
                match self.streams.set_interval(self.now_us, link, id, interval_us) {
                    true => R::MAV_RESULT_ACCEPTED,
                    false => R::MAV_RESULT_FAILED,
                }
            }
            MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL => self.report_interval(link, command.param1 as u32, outbox),
            MavCmd::MAV_CMD_REQUEST_MESSAGE => self.send_once(link, command.param1 as u32, outbox),
            MavCmd::MAV_CMD_GET_HOME_POSITION => self.send_once(link, Stream::HomePosition as u32, outbox),
            MavCmd::MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES => {
                self.send_once(link, AUTOPILOT_VERSION_ID, outbox)
            }
            _ => R::MAV_RESULT_UNSUPPORTED,
        }
    }

    fn arm_or_disarm(&mut self, command: &COMMAND_LONG_DATA, outbox: &mut Vec<Packet>) -> MavResult {
        let forced = command.param2 == FORCE;
        let situation = self.situation();
        let result = if command.param1 == 1.0 {
            let was_armed = self.commander.is_armed();
            let armed = self.commander.arm(forced, &self.parameters, &situation);
            if !was_armed && armed.is_ok() {
                self.step_gate.stall(&self.config.pace);
            }
            armed
        } else {
            self.commander.disarm(forced, &situation)
        };
        match result {
            Ok(()) => MavResult::MAV_RESULT_ACCEPTED,
            Err(refusal) => self.refuse(refusal, outbox),
        }
    }

    fn change_mode(&mut self, mode: NavMode, outbox: &mut Vec<Packet>) -> MavResult {
        let situation = self.situation();
        match self.commander.set_mode(mode, &situation) {
            Ok(()) => MavResult::MAV_RESULT_ACCEPTED,
            Err(refusal) => self.refuse(refusal, outbox),
        }
    }

    fn refuse(&mut self, refusal: Refusal, outbox: &mut Vec<Packet>) -> MavResult {
        self.wire.say(
            outbox,
            MavSeverity::MAV_SEVERITY_CRITICAL,
            refusal.text(self.config.firmware),
        );
        MavResult::MAV_RESULT_TEMPORARILY_REJECTED
    }

    /// DO_REPOSITION: a place to hold instead of the present one. The first bit of `param2` asks for Hold.
    fn go_to(
        &mut self,
        command: &COMMAND_LONG_DATA,
        place: CommandPlace,
        outbox: &mut Vec<Packet>,
    ) -> MavResult {
        let asks_for_hold = command.param2 as u32 & 1 != 0;
        let forgets = self.config.firmware.forgets_repositions();
        let holds = self.commander.mode() == NavMode::Hold;
        if asks_for_hold && self.change_mode(NavMode::Hold, outbox) != MavResult::MAV_RESULT_ACCEPTED {
            return MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
        }
        if forgets && !asks_for_hold && !holds {
            return MavResult::MAV_RESULT_DENIED;
        }
        if forgets && !self.commander.is_armed() {
            return MavResult::MAV_RESULT_ACCEPTED;
        }
        let place = place.above_the_sea();
        let here = self.estimate.position.vector();
        let level = place.level(&self.frame).unwrap_or(here.xy());
        let down_m = place.down_m(&self.frame).unwrap_or(here.z);
        let wish = Reposition {
            position: Vector3::new(level.x, level.y, down_m),
            speed_mps: f64::from(command.param1),
            yaw_rad: f64::from(command.param4),
        };
        let acceptance_m = self.parameters.get(Parameter::NAV_ACC_RAD);
        self.navigator.reposition(&wish, acceptance_m);
        MavResult::MAV_RESULT_ACCEPTED
    }

    /// Goes on with the mission at `item`, and says so.
    pub(super) fn jump_to_item(&mut self, item: usize, outbox: &mut Vec<Packet>) {
        self.navigator.jump_to(item);
        self.show_item(outbox);
    }

    fn show_item(&mut self, outbox: &mut Vec<Packet>) {
        self.navigator.show_item();
        if let Some(current) = self.message(Stream::MissionCurrent) {
            self.wire.broadcast(outbox, &current);
        }
    }

    /// SET_MODE: the old way, without acknowledgement.
    pub(super) fn set_mode_message(&mut self, custom_mode: u32, outbox: &mut Vec<Packet>) {
        if let Some(mode) = mode_of_custom(custom_mode) {
            self.change_mode(mode, outbox);
        }
    }

    fn report_interval(&mut self, link: Link, id: u32, outbox: &mut Vec<Packet>) -> MavResult {
        let message = messages::message_interval(id, self.streams.interval_us(link, id));
        self.wire.send(outbox, link, message);
        MavResult::MAV_RESULT_ACCEPTED
    }

    fn send_once(&mut self, link: Link, id: u32, outbox: &mut Vec<Packet>) -> MavResult {
        let message = if id == AUTOPILOT_VERSION_ID {
            Some(version_message(self.config.firmware))
        } else {
            self.streams.find(id).and_then(|stream| self.message(stream))
        };
        match message {
            Some(message) => {
                self.wire.send(outbox, link, message);
                MavResult::MAV_RESULT_ACCEPTED
            }
            None => MavResult::MAV_RESULT_DENIED,
        }
    }
}

fn version_message(firmware: Firmware) -> MavMessage {
    use MavProtocolCapability as C;
    MavMessage::AUTOPILOT_VERSION(AUTOPILOT_VERSION_DATA {
        capabilities: C::MAV_PROTOCOL_CAPABILITY_MISSION_INT
            | C::MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
            | C::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
            | C::MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
            | C::MAV_PROTOCOL_CAPABILITY_MAVLINK2,
        flight_sw_version: firmware.version(),
        ..AUTOPILOT_VERSION_DATA::default()
    })
}
