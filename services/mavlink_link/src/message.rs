//! Messages received and to be sent, with what the bytes alone do not contain.

use jink_shared_types::{SampleHeader, Timestamp};
use mavlink::MavHeader;
use mavlink::dialect::{COMMAND_ACK_DATA, COMMAND_INT_DATA, COMMAND_LONG_DATA, MavMessage, MavResult};
use mavlink::error::ParserError;
use mavlink::{MavlinkVersion, Message, MessageData, consts};

use crate::frame::MavlinkFrame;
use crate::router::Target;

/// Where the command's number is in COMMAND_LONG and COMMAND_INT: behind seven four-byte fields; then come its addressees.
pub(crate) const COMMAND_AT: usize = 28;
/// MAV_COMP_ID_AUTOPILOT1.
pub const COMPONENT_AUTOPILOT: u8 = 1;
/// MAV_COMP_ID_ONBOARD_COMPUTER.
pub const COMPONENT_ONBOARD_COMPUTER: u8 = 191;
/// MAV_COMP_ID_OBSTACLE_AVOIDANCE.
pub const COMPONENT_AVOIDANCE: u8 = 196;

/// A message as received.
#[derive(Clone, Debug)]
pub struct Received {
    /// Who sent it.
    pub header: MavHeader,
    /// Its content.
    pub content: Content,
    /// When its bytes were read.
    pub time: Timestamp,
    /// The link it came in on: its place in the configuration, the autopilot's first.
    pub link: u8,
}

/// What a received frame holds.
// The small variant is rare and the large one is never moved on the hot path.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Debug)]
pub enum Content {
    /// A message of the dialect.
    Message(MavMessage),
    /// A COMMAND_LONG or COMMAND_INT with a command number that the dialect does not know: it still needs an answer.
    UnknownCommand {
        /// The command's number.
        command: u16,
        /// Addressed system, 0 = all.
        target_system: u8,
        /// Addressed component, 0 = all.
        target_component: u8,
    },
}

impl Content {
    /// The content of `frame`; `None` if it cannot be decoded.
    pub fn of(frame: &MavlinkFrame<'_>) -> Option<Self> {
        Self::of_payload(frame.version, frame.message_id, frame.payload)
    }

    /// The content of a frame with this payload; `None` if it cannot be decoded.
    pub fn of_payload(version: MavlinkVersion, message_id: u32, payload: &[u8]) -> Option<Self> {
        match MavMessage::parse(version, message_id, payload) {
            Ok(message) => Some(Self::Message(message)),
            Err(ParserError::InvalidEnum { .. }) => Self::unknown_command(message_id, payload),
            Err(_) => None,
        }
    }

    /// The addressee.
    pub fn target(&self) -> Target {
        let (system_id, component_id) = match self {
            Self::Message(message) => (message.target_system_id(), message.target_component_id()),
            Self::UnknownCommand {
                target_system,
                target_component,
                ..
            } => (Some(*target_system), Some(*target_component)),
        };
        Target {
            system_id: u32::from(system_id.unwrap_or(0)),
            component_id: component_id.unwrap_or(0),
        }
    }

    /// Reads the command number and the address from the raw payload.
    fn unknown_command(message_id: u32, bytes: &[u8]) -> Option<Self> {
        if message_id != COMMAND_LONG_DATA::ID && message_id != COMMAND_INT_DATA::ID {
            return None;
        }
        let mut payload = [0; consts::MAX_PAYLOAD_LEN];
        payload.get_mut(..bytes.len())?.copy_from_slice(bytes);
        Some(Self::UnknownCommand {
            command: u16::from_le_bytes([payload[COMMAND_AT], payload[COMMAND_AT + 1]]),
            target_system: payload[COMMAND_AT + 2],
            target_component: payload[COMMAND_AT + 3],
        })
    }
}

/// A command, in whichever message it came.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command {
    /// Number.
    pub command: u16,
    /// First and second parameter; NaN if they could not be read.
    pub params: [f32; 2],
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
                params: [data.param1, data.param2],
                target_system: data.target_system,
                target_component: data.target_component,
            }),
            Content::Message(MavMessage::COMMAND_INT(data)) => Some(Self {
                command: data.command as u16,
                params: [data.param1, data.param2],
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
                params: [f32::NAN; 2],
                target_system: *target_system,
                target_component: *target_component,
            }),
        }
    }
}

/// An answer to a command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CommandAck {
    /// Number of the command.
    pub command: u16,
    /// What became of it.
    pub result: MavResult,
    /// Who asked: system.
    pub target_system: u8,
    /// Who asked: component.
    pub target_component: u8,
}

/// The content of a message to be sent.
// As for `Content`: the outbox is preallocated, nothing is gained by a smaller variant.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Debug)]
pub enum Body {
    /// A message of the dialect.
    Message(MavMessage),
    /// An answer to a command, whatever its number.
    CommandAck(CommandAck),
}

impl Body {
    /// Message type.
    pub fn message_id(&self) -> u32 {
        match self {
            Self::Message(message) => message.message_id(),
            Self::CommandAck(_) => COMMAND_ACK_DATA::ID,
        }
    }

    /// Writes the payload of a MAVLink 2 frame, which fits into `payload`; its length (bytes).
    pub fn write_payload(&self, payload: &mut [u8]) -> usize {
        match self {
            Self::Message(message) => message.ser(MavlinkVersion::V2, payload),
            Self::CommandAck(ack) => write_command_ack(ack, payload),
        }
    }

    /// The addressee.
    pub fn target(&self) -> Target {
        match self {
            Self::Message(message) => Target {
                system_id: u32::from(message.target_system_id().unwrap_or(0)),
                component_id: message.target_component_id().unwrap_or(0),
            },
            Self::CommandAck(ack) => Target {
                system_id: u32::from(ack.target_system),
                component_id: ack.target_component,
            },
        }
    }
}

/// COMMAND_ACK by hand: the crate's type cannot carry the number of a command that its dialect does not know.
fn write_command_ack(ack: &CommandAck, payload: &mut [u8]) -> usize {
    let command = ack.command.to_le_bytes();
    let fields = [
        command[0],
        command[1],
        ack.result as u8,
        0,
        0,
        0,
        0,
        0,
        ack.target_system,
        ack.target_component,
    ];
    payload[..fields.len()].copy_from_slice(&fields);
    mavlink::utils::remove_trailing_zeroes(&fields)
}

/// Over which links a message leaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Destination {
    /// All of them, or, if it names an addressee, those on which that was received.
    Everyone,
    /// One of them: that of the autopilot, or of the sender of a request.
    Link(u8),
}

/// What the gateway is notified of once the bytes were handed to the kernel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Receipt {
    /// Nothing but that it was sent.
    Plain,
    /// An obstacle map.
    Obstacles,
    /// A setpoint.
    Setpoint {
        /// Of the approved trajectory, if this is the first setpoint cut from it.
        first_of: Option<SampleHeader>,
    },
}

/// A message to be sent.
#[derive(Clone, Debug)]
pub struct Outgoing {
    /// Sending system.
    pub system_id: u8,
    /// Sending component.
    pub component_id: u8,
    /// Its content.
    pub body: Body,
    /// Over which links it leaves.
    pub to: Destination,
    /// The notification once its bytes were handed to the kernel.
    pub receipt: Receipt,
}
