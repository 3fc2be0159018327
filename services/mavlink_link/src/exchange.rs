//! Messages as samples, on their way between the gateway and the ground services.
//!
//! | | sample |
//! |---|---|
//! | a message of the dialect | its payload, as a MAVLink 2 frame has it |
//! | a command with a number that the dialect does not know | COMMAND_LONG with this number, everything but its addressees zero |
//! | an answer to such a command | COMMAND_ACK with this number |

use crate::message::{Body, COMMAND_AT, CommandAck, Content};
use jink_shared_types::ground::MavlinkMessage;
use mavlink::dialect::{COMMAND_ACK_DATA, COMMAND_LONG_DATA, MavCmd, MavMessage};
use mavlink::{MavlinkVersion, Message, MessageData};

/// Bytes of COMMAND_ACK.
const COMMAND_ACK_BYTES: usize = 10;

/// What was received, as a sample.
pub fn of_content(content: &Content) -> MavlinkMessage {
    let mut sample = MavlinkMessage::default();
    match content {
        Content::Message(message) => {
            sample.id = message.message_id();
            sample.len = message.ser(MavlinkVersion::V2, &mut sample.payload) as u8;
        }
        Content::UnknownCommand {
            command,
            target_system,
            target_component,
        } => {
            let [low, high] = command.to_le_bytes();
            let fields = [low, high, *target_system, *target_component];
            let end = COMMAND_AT + fields.len();
            sample.payload[COMMAND_AT..end].copy_from_slice(&fields);
            sample.id = COMMAND_LONG_DATA::ID;
            sample.len = end as u8;
        }
    }
    sample
}

/// What was received; `None` if the dialect does not know it.
pub fn to_content(sample: &MavlinkMessage) -> Option<Content> {
    Content::of_payload(MavlinkVersion::V2, sample.id, sample.bytes())
}

/// What is to be sent, as a sample.
pub fn of_body(body: &Body) -> MavlinkMessage {
    let mut sample = MavlinkMessage {
        id: body.message_id(),
        ..MavlinkMessage::default()
    };
    sample.len = body.write_payload(&mut sample.payload) as u8;
    sample
}

/// What is to be sent; `None` if the dialect does not know it.
pub fn to_body(sample: &MavlinkMessage) -> Option<Body> {
    if sample.id != COMMAND_ACK_DATA::ID {
        return MavMessage::parse(MavlinkVersion::V2, sample.id, sample.bytes())
            .ok()
            .map(Body::Message);
    }
    let mut payload: [u8; COMMAND_ACK_BYTES] = *sample.payload.first_chunk()?;
    payload
        .iter_mut()
        .skip(usize::from(sample.len))
        .for_each(|byte| *byte = 0);
    let command = u16::from_le_bytes([payload[0], payload[1]]);
    // Any number that the dialect knows, so that it reads the rest.
    let known = (MavCmd::MAV_CMD_REQUEST_MESSAGE as u16).to_le_bytes();
    payload[..known.len()].copy_from_slice(&known);
    match MavMessage::parse(MavlinkVersion::V2, sample.id, &payload) {
        Ok(MavMessage::COMMAND_ACK(ack)) => Some(Body::CommandAck(CommandAck {
            command,
            result: ack.result,
            target_system: ack.target_system,
            target_component: ack.target_component,
        })),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::{of_body, of_content, to_body, to_content};
    use crate::message::{Body, CommandAck, Content};
    use jink_shared_types::ground::MavlinkMessage;
    use mavlink::dialect::{FILE_TRANSFER_PROTOCOL_DATA, MavMessage, MavResult, PARAM_VALUE_DATA};
    use proptest::prelude::*;

    fn text(content: &Content) -> String {
        format!("{content:?}")
    }

    #[test]
    fn the_longest_message_arrives_whole() {
        let mut payload = [0x5a; 251];
        payload[250] = 1;
        let content = Content::Message(MavMessage::FILE_TRANSFER_PROTOCOL(FILE_TRANSFER_PROTOCOL_DATA {
            target_network: 0,
            target_system: 1,
            target_component: 196,
            payload,
        }));
        let sample = of_content(&content);
        assert_eq!(sample.len, 254);
        assert_eq!(text(&to_content(&sample).unwrap()), text(&content));
    }

    #[test]
    fn what_ends_in_zeros_arrives_whole() {
        let content = Content::Message(MavMessage::PARAM_VALUE(PARAM_VALUE_DATA::default()));
        assert_eq!(text(&to_content(&of_content(&content)).unwrap()), text(&content));
    }

    proptest! {
        #[test]
        fn a_command_of_any_number_and_its_answer_arrive_as_they_were(
            command: u16, target_system: u8, target_component: u8,
            result in prop_oneof![Just(MavResult::MAV_RESULT_ACCEPTED), Just(MavResult::MAV_RESULT_UNSUPPORTED)],
        ) {
            let unknown = Content::UnknownCommand { command, target_system, target_component };
            let arrived = to_content(&of_content(&unknown)).unwrap();
            let arrived = crate::message::Command::of(&arrived).unwrap();
            prop_assert_eq!(
                (arrived.command, arrived.target_system, arrived.target_component),
                (command, target_system, target_component)
            );
            let ack = CommandAck { command, result, target_system, target_component };
            match to_body(&of_body(&Body::CommandAck(ack))) {
                Some(Body::CommandAck(arrived)) => prop_assert_eq!(arrived, ack),
                other => prop_assert!(false, "{:?}", other),
            }
        }

        #[test]
        fn any_bytes_are_read_or_refused(
            id in prop_oneof![0u32..500, any::<u32>()], len: u8, bytes in proptest::collection::vec(any::<u8>(), 255),
        ) {
            let sample = MavlinkMessage { id, len, payload: bytes.try_into().unwrap() };
            let _read = (to_content(&sample), to_body(&sample));
        }
    }
}
