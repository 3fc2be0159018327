//! Commands addressed to us: each gets exactly one COMMAND_ACK, and the few that mean something here get their answer.
//!
//! | command | answer |
//! |---|---|
//! | MAV_CMD_REQUEST_MESSAGE for AUTOPILOT_VERSION (148) | ACCEPTED, AUTOPILOT_VERSION |
//! | everything else, known to the dialect or not | UNSUPPORTED |
//!
//! Commands to all components (target 0) are not ours to refuse: the autopilot answers them.

use crate::message::{Body, CommandAck, Content};
use mavlink::MessageData;
use mavlink::dialects::ardupilotmega::{
    AUTOPILOT_VERSION_DATA, MavCmd, MavMessage, MavProtocolCapability, MavResult,
};

/// A command, in whichever message it came.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command {
    /// Number.
    pub command: u16,
    /// First parameter; NaN if it could not be read.
    pub param1: f32,
    /// Addressed system, 0 = all.
    pub target_system: u8,
    /// Addressed component, 0 = all.
    pub target_component: u8,
}

impl Command {
    /// The command in `content`, if it is one.
    pub fn of(content: &Content) -> Option<Self> {
        match content {
            Content::Message(MavMessage::COMMAND_LONG(data)) => Some(Self {
                command: data.command as u16,
                param1: data.param1,
                target_system: data.target_system,
                target_component: data.target_component,
            }),
            Content::Message(MavMessage::COMMAND_INT(data)) => Some(Self {
                command: data.command as u16,
                param1: data.param1,
                target_system: data.target_system,
                target_component: data.target_component,
            }),
            Content::Message(_) => None,
            Content::UnknownCommand {
                command,
                target_system,
                target_component,
            } => Some(Self {
                command: *command,
                param1: f32::NAN,
                target_system: *target_system,
                target_component: *target_component,
            }),
        }
    }

    /// The acknowledgement to `(system, component)`, and the message that was asked for, if there is one.
    pub fn answer(&self, (system, component): (u8, u8)) -> (Body, Option<MavMessage>) {
        let asks_for_version = self.command == MavCmd::MAV_CMD_REQUEST_MESSAGE as u16
            && self.param1 == AUTOPILOT_VERSION_DATA::ID as f32;
        let ack = CommandAck {
            command: self.command,
            result: if asks_for_version {
                MavResult::MAV_RESULT_ACCEPTED
            } else {
                MavResult::MAV_RESULT_UNSUPPORTED
            },
            target_system: system,
            target_component: component,
        };
        (Body::CommandAck(ack), asks_for_version.then(version))
    }
}

fn version() -> MavMessage {
    MavMessage::AUTOPILOT_VERSION(AUTOPILOT_VERSION_DATA {
        capabilities: MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_MAVLINK2,
        flight_sw_version: software_version(),
        ..AUTOPILOT_VERSION_DATA::default()
    })
}

/// Major, minor and patch in the upper three bytes; the lowest is the release type, 255 = official.
fn software_version() -> u32 {
    let mut version = 255;
    for (i, number) in env!("CARGO_PKG_VERSION").split('.').take(3).enumerate() {
        version |= u32::from(number.parse::<u8>().unwrap_or(0)) << (24 - 8 * i);
    }
    version
}
