//! Messages received and to be sent, with what the bytes alone do not contain.

use jink_shared_types::{SampleHeader, Timestamp};
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{
    COMMAND_ACK_DATA, COMMAND_INT_DATA, COMMAND_LONG_DATA, MavMessage, MavResult,
};
use mavlink::error::ParserError;
use mavlink::{Message, MessageData, consts};

use crate::frame::MavlinkFrame;
use crate::router::Target;

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
        match frame.decode() {
            Ok(message) => Some(Self::Message(message)),
            Err(ParserError::InvalidEnum { .. }) => Self::unknown_command(frame),
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

    /// Reads the command number and the address from the raw payload. COMMAND_LONG and COMMAND_INT share the offsets:
    /// seven four-byte fields, then command, target system and target component.
    fn unknown_command(frame: &MavlinkFrame<'_>) -> Option<Self> {
        const COMMAND_AT: usize = 28;
        if frame.message_id != COMMAND_LONG_DATA::ID && frame.message_id != COMMAND_INT_DATA::ID {
            return None;
        }
        let mut payload = [0; consts::MAX_PAYLOAD_LEN];
        payload[..frame.payload.len()].copy_from_slice(frame.payload);
        Some(Self::UnknownCommand {
            command: u16::from_le_bytes([payload[COMMAND_AT], payload[COMMAND_AT + 1]]),
            target_system: payload[COMMAND_AT + 2],
            target_component: payload[COMMAND_AT + 3],
        })
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
