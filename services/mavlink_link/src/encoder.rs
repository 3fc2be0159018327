//! Messages to bytes: MAVLink 2 frames in a fixed buffer, numbered per sending component.
//!
//! | in | out |
//! |---|---|
//! | system id, component id, [`Body`] | the bytes of one frame |
//!
//! Receivers count lost packets per system and component, so each of our components numbers its own messages.

use crate::message::Body;
use mavlink::dialect::MavMessage;
use mavlink::{MAV_STX_V2, Message, calculate_crc, consts};

/// Components that can be numbered on one link; more than the gateway sends as.
pub const COMPONENTS: usize = 4;
/// Bytes of the numbering of one link.
pub const SEQUENCES_BYTES: usize = 2 * COMPONENTS;
/// Length of a MAVLink 2 header with its start byte (bytes).
const HEADER_BYTES: usize = consts::STX_SIZE + consts::v2::MIN_HEADER_SIZE;

/// Encodes for one link.
#[derive(Debug)]
pub struct Encoder {
    buffer: [u8; consts::MAX_FRAME_SIZE],
    sequences: [(u8, u8); COMPONENTS],
}

impl Default for Encoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Encoder {
    /// An encoder that starts all sequences at zero.
    pub fn new() -> Self {
        Self {
            buffer: [0; consts::MAX_FRAME_SIZE],
            sequences: [(0, 0); COMPONENTS],
        }
    }

    /// Per component in use: its next number. Component 0 marks a free slot.
    pub fn sequences(&self) -> [(u8, u8); COMPONENTS] {
        self.sequences
    }

    /// Continues the numbers of another encoder.
    pub fn resume_from(&mut self, sequences: [(u8, u8); COMPONENTS]) {
        self.sequences = sequences;
    }

    /// The bytes of `body` as sent by `system_id`/`component_id`, valid until the next call.
    pub fn encode(&mut self, system_id: u8, component_id: u8, body: &Body) -> &[u8] {
        let payload = &mut self.buffer[HEADER_BYTES..HEADER_BYTES + consts::MAX_PAYLOAD_LEN];
        let payload_len = body.write_payload(payload);
        let message_id = body.message_id();
        let seed = MavMessage::extra_crc(message_id);
        let id = message_id.to_le_bytes();
        let sequence = self.next_sequence(component_id);
        self.buffer[..HEADER_BYTES].copy_from_slice(&[
            MAV_STX_V2,
            payload_len as u8,
            0,
            0,
            sequence,
            system_id,
            component_id,
            id[0],
            id[1],
            id[2],
        ]);
        let end = HEADER_BYTES + payload_len;
        let crc = calculate_crc(&self.buffer[consts::STX_SIZE..end], seed);
        self.buffer[end..end + consts::CHECKSUM_SIZE].copy_from_slice(&crc.to_le_bytes());
        &self.buffer[..end + consts::CHECKSUM_SIZE]
    }

    /// The message encoded last does not leave: its number is the next one's.
    pub fn take_back(&mut self, component_id: u8) {
        let slot = self
            .sequences
            .iter_mut()
            .find(|(component, _)| *component == component_id);
        if let Some((_, next)) = slot {
            *next = next.wrapping_sub(1);
        }
    }

    /// Component 0 marks a free slot; it is the broadcast address and never sends.
    fn next_sequence(&mut self, component_id: u8) -> u8 {
        let slot = self
            .sequences
            .iter()
            .position(|(component, _)| *component == component_id || *component == 0)
            .unwrap_or(COMPONENTS - 1);
        let (component, next) = &mut self.sequences[slot];
        *component = component_id;
        let sequence = *next;
        *next = next.wrapping_add(1);
        sequence
    }
}

/// The numbering of one link as bytes: what passes with every link but the first.
pub fn sequences_to_bytes(sequences: [(u8, u8); COMPONENTS]) -> [u8; SEQUENCES_BYTES] {
    let mut bytes = [0; SEQUENCES_BYTES];
    for (pair, (component, sequence)) in bytes.chunks_exact_mut(2).zip(sequences) {
        pair.copy_from_slice(&[component, sequence]);
    }
    bytes
}

/// From those bytes.
pub fn sequences_of_bytes(bytes: &[u8]) -> Option<[(u8, u8); COMPONENTS]> {
    let bytes: &[u8; SEQUENCES_BYTES] = bytes.try_into().ok()?;
    let mut sequences = [(0, 0); COMPONENTS];
    for (pair, to) in bytes.chunks_exact(2).zip(&mut sequences) {
        *to = (pair[0], pair[1]);
    }
    Some(sequences)
}
