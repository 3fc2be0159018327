//! The two MAVLink links, and what passes from one to the other.

use mavlink::dialect::{MavMessage, MavSeverity, STATUSTEXT_DATA};
use mavlink::{MavHeader, Message};
use std::fmt::Write;

/// Component id of the autopilot.
pub const AUTOPILOT_COMPONENT: u8 = 1;
/// MAV_COMP_ID_OBSTACLE_AVOIDANCE: component id of a companion that avoids obstacles.
pub const COMPONENT_AVOIDANCE: u8 = 196;

/// Who is at the other end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Link {
    /// The companion computer (PX4's "onboard" link, UDP 14580 to 14540).
    Companion,
    /// The ground station (PX4's "normal" link, UDP 18570 to 14550).
    GroundStation,
}

impl Link {
    /// Both.
    pub const ALL: [Link; 2] = [Link::Companion, Link::GroundStation];

    /// The other one.
    pub fn other(self) -> Self {
        match self {
            Link::Companion => Link::GroundStation,
            Link::GroundStation => Link::Companion,
        }
    }
}

/// A decoded message on one of the links, in either direction.
#[derive(Clone, Debug, PartialEq)]
pub struct Packet {
    /// Where it came in, or goes out.
    pub link: Link,
    /// Sender and sequence.
    pub header: MavHeader,
    /// The message.
    pub message: MavMessage,
}

/// Numbers and addresses outgoing messages.
#[derive(Clone, Debug)]
pub struct Wire {
    system_id: u8,
    sequence: [u8; 2],
    chunked_texts: u16,
}

impl Wire {
    /// The wire of system `system_id`.
    pub fn new(system_id: u8) -> Self {
        Self {
            system_id,
            sequence: [0; 2],
            chunked_texts: 0,
        }
    }

    /// Sends on one link.
    pub fn send(&mut self, outbox: &mut Vec<Packet>, link: Link, message: MavMessage) {
        let sequence = &mut self.sequence[link as usize];
        outbox.push(Packet {
            link,
            header: MavHeader {
                system_id: u32::from(self.system_id),
                component_id: AUTOPILOT_COMPONENT,
                sequence: *sequence,
            },
            message,
        });
        *sequence = sequence.wrapping_add(1);
    }

    /// Sends on both links.
    pub fn broadcast(&mut self, outbox: &mut Vec<Packet>, message: &MavMessage) {
        for link in Link::ALL {
            self.send(outbox, link, message.clone());
        }
    }

    /// Sends a text to everybody.
    pub fn say(&mut self, outbox: &mut Vec<Packet>, severity: MavSeverity, text: &str) {
        self.say_with(outbox, severity, format_args!("{text}"));
    }

    /// Sends everybody a text with numbers in it. A text that does not fit one message is sent in chunks with a common
    /// id. Texts are put together on the stack: they are said in flight.
    pub fn say_with(&mut self, outbox: &mut Vec<Packet>, severity: MavSeverity, text: std::fmt::Arguments) {
        let mut buffer = TextBuffer::default();
        // Cannot fail: what does not fit is cut off.
        let _complete = buffer.write_fmt(text);
        let text = &buffer.bytes[..buffer.len];
        let id = if text.len() > CHUNK_LEN {
            self.chunked_texts = self.chunked_texts.wrapping_add(1).max(1);
            self.chunked_texts
        } else {
            0
        };
        for (chunk_seq, chunk) in text.chunks(CHUNK_LEN).enumerate() {
            let mut field = [0; CHUNK_LEN];
            field[..chunk.len()].copy_from_slice(chunk);
            let message = MavMessage::STATUSTEXT(STATUSTEXT_DATA {
                severity,
                text: field.into(),
                id,
                chunk_seq: chunk_seq as u8,
            });
            self.broadcast(outbox, &message);
        }
    }

    /// Whether the autopilot itself is meant.
    pub fn is_addressed(&self, message: &MavMessage) -> bool {
        let system = message.target_system_id().unwrap_or(0);
        let component = message.target_component_id().unwrap_or(0);
        (system == 0 || system == self.system_id) && (component == 0 || component == AUTOPILOT_COMPONENT)
    }

    /// The packet as it goes on to the other link; `None` if it is for the autopilot alone.
    pub fn forward(&self, packet: &Packet) -> Option<Packet> {
        let component = packet.message.target_component_id().unwrap_or(0);
        (component != AUTOPILOT_COMPONENT).then(|| Packet {
            link: packet.link.other(),
            ..packet.clone()
        })
    }
}

/// Characters of one STATUSTEXT.
const CHUNK_LEN: usize = 50;

/// A text under construction, at most as long as PX4's own.
struct TextBuffer {
    bytes: [u8; 127],
    len: usize,
}

impl Default for TextBuffer {
    fn default() -> Self {
        Self {
            bytes: [0; 127],
            len: 0,
        }
    }
}

impl std::fmt::Write for TextBuffer {
    fn write_str(&mut self, text: &str) -> std::fmt::Result {
        let taken = text.len().min(self.bytes.len() - self.len);
        self.bytes[self.len..self.len + taken].copy_from_slice(&text.as_bytes()[..taken]);
        self.len += taken;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialect::{COMMAND_LONG_DATA, HEARTBEAT_DATA};

    fn packet(message: MavMessage) -> Packet {
        Packet {
            link: Link::GroundStation,
            header: MavHeader {
                system_id: 255,
                component_id: 190,
                sequence: 3,
            },
            message,
        }
    }

    #[test]
    fn the_links_forward_what_is_not_for_the_autopilot_alone() {
        let wire = Wire::new(1);
        let heartbeat = packet(MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()));
        let forwarded = wire.forward(&heartbeat).unwrap();
        assert_eq!(forwarded.link, Link::Companion);
        assert_eq!(forwarded.header, heartbeat.header);
        let command = |component| {
            MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
                target_system: 1,
                target_component: component,
                ..COMMAND_LONG_DATA::default()
            })
        };
        assert!(wire.forward(&packet(command(1))).is_none());
        assert!(wire.forward(&packet(command(196))).is_some());
        assert!(wire.is_addressed(&command(0)) && !wire.is_addressed(&command(196)));
    }

    #[test]
    fn a_text_longer_than_a_message_is_sent_in_chunks_with_one_id() {
        let mut wire = Wire::new(1);
        let mut outbox = Vec::new();
        let long = "Arming denied: Resolve system health failures first";
        wire.say(&mut outbox, MavSeverity::MAV_SEVERITY_CRITICAL, long);
        wire.say(&mut outbox, MavSeverity::MAV_SEVERITY_INFO, "short");
        let texts: Vec<_> = outbox
            .iter()
            .filter(|p| p.link == Link::Companion)
            .map(|p| match &p.message {
                MavMessage::STATUSTEXT(t) => (t.text.to_str().unwrap().to_owned(), t.id, t.chunk_seq),
                other => panic!("{other:?}"),
            })
            .collect();
        let expected = [(&long[..50], 1, 0), (&long[50..], 1, 1), ("short", 0, 0)];
        assert_eq!(texts, expected.map(|(text, id, seq)| (text.to_owned(), id, seq)));
    }

    #[test]
    fn every_link_counts_its_own_messages() {
        let mut wire = Wire::new(7);
        let mut outbox = Vec::new();
        wire.say(&mut outbox, MavSeverity::MAV_SEVERITY_INFO, "one");
        wire.send(
            &mut outbox,
            Link::Companion,
            MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()),
        );
        let sequences: Vec<u8> = outbox.iter().map(|p| p.header.sequence).collect();
        assert_eq!(sequences, [0, 0, 1]);
        assert!(outbox.iter().all(|p| p.header.system_id == 7));
    }
}
