//! What one gateway sends to the next when it passes the link on: where its numbering and its beat are.

use crate::gateway::Gateway;
use jink_mavlink_link::encoder::{
    COMPONENTS, Encoder, SEQUENCES_BYTES, sequences_of_bytes, sequences_to_bytes,
};
use jink_mavlink_link::signing::stamps::Stamps;
use jink_shared_types::Timestamp;

/// Bytes of a hand-over state.
const BYTES: usize = 8 + 16 + SEQUENCES_BYTES;

/// The state that only the speaker has: everything else a listener has learned as well.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HandoverState {
    /// When the last setpoint was sent.
    last_setpoint: Timestamp,
    /// Per component: its next sequence number on the first link.
    sequences: [(u8, u8); COMPONENTS],
    /// Stamps of signatures that are used up, and those that may be used.
    stamps: Stamps,
}

impl HandoverState {
    /// Of the gateway that has sent so far.
    pub fn of(gateway: &Gateway, encoder: &Encoder, stamps: Stamps) -> Self {
        Self {
            last_setpoint: gateway.last_setpoint(),
            sequences: encoder.sequences(),
            stamps,
        }
    }

    /// Handed to the gateway that sends from `now` on; the stamps are for its links.
    pub fn hand_to(self, now: Timestamp, gateway: &mut Gateway, encoder: &mut Encoder) -> Stamps {
        // The time of a damaged hand-over state would keep the next one silent until then.
        gateway.resume_from(self.last_setpoint.min(now));
        encoder.resume_from(self.sequences);
        self.stamps
    }

    /// As bytes.
    pub fn to_bytes(self) -> [u8; BYTES] {
        let mut bytes = [0; BYTES];
        bytes[..8].copy_from_slice(&self.last_setpoint.ns.to_le_bytes());
        bytes[8..24].copy_from_slice(&self.stamps.to_bytes());
        bytes[24..].copy_from_slice(&sequences_to_bytes(self.sequences));
        bytes
    }

    /// From the bytes of a gateway of the same version; `None` for others.
    pub fn of_bytes(bytes: &[u8]) -> Option<Self> {
        let (time, rest) = bytes.split_first_chunk::<8>()?;
        let (stamps, rest) = rest.split_first_chunk::<16>()?;
        Some(Self {
            last_setpoint: Timestamp::from_ns(u64::from_le_bytes(*time)),
            stamps: Stamps::of_bytes(stamps),
            sequences: sequences_of_bytes(rest)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::{BYTES, HandoverState};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_baton_survives_its_bytes_and_other_lengths_are_refused(bytes in proptest::collection::vec(any::<u8>(), 0..64)) {
            match HandoverState::of_bytes(&bytes) {
                Some(handover) => prop_assert_eq!(&handover.to_bytes()[..], &bytes[..]),
                None => prop_assert_ne!(bytes.len(), BYTES),
            }
        }
    }
}
