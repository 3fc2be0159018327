//! What one gateway tells the next when it passes the link on: where its numbering and its beat are.

use crate::encoder::{COMPONENTS, Encoder};
use crate::gateway::Gateway;
use jink_shared_types::Timestamp;

/// Bytes of a baton.
const BYTES: usize = 8 + 2 * COMPONENTS;

/// The state that only the speaker has: everything else a listener has learned as well.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Baton {
    /// When the last setpoint was sent.
    last_setpoint: Timestamp,
    /// Per component: its next sequence number.
    sequences: [(u8, u8); COMPONENTS],
}

impl Baton {
    /// Of the gateway that has spoken so far.
    pub fn of(gateway: &Gateway, encoder: &Encoder) -> Self {
        Self {
            last_setpoint: gateway.last_setpoint(),
            sequences: encoder.sequences(),
        }
    }

    /// Handed to the gateway that speaks from now on.
    pub fn hand_to(self, gateway: &mut Gateway, encoder: &mut Encoder) {
        gateway.go_on_from(self.last_setpoint);
        encoder.go_on_from(self.sequences);
    }

    /// As bytes.
    pub fn to_bytes(self) -> [u8; BYTES] {
        let mut bytes = [0; BYTES];
        bytes[..8].copy_from_slice(&self.last_setpoint.ns.to_le_bytes());
        for (pair, (component, sequence)) in bytes[8..].chunks_exact_mut(2).zip(self.sequences) {
            pair.copy_from_slice(&[component, sequence]);
        }
        bytes
    }

    /// From the bytes of a gateway of the same version; `None` for others.
    pub fn of_bytes(bytes: &[u8]) -> Option<Self> {
        let (time, rest) = bytes.split_first_chunk::<8>()?;
        if bytes.len() != BYTES {
            return None;
        }
        let mut sequences = [(0, 0); COMPONENTS];
        for (pair, to) in rest.chunks_exact(2).zip(&mut sequences) {
            *to = (pair[0], pair[1]);
        }
        Some(Self {
            last_setpoint: Timestamp::from_ns(u64::from_le_bytes(*time)),
            sequences,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::{BYTES, Baton};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_baton_survives_its_bytes_and_other_lengths_are_refused(bytes in proptest::collection::vec(any::<u8>(), 0..40)) {
            match Baton::of_bytes(&bytes) {
                Some(baton) => prop_assert_eq!(&baton.to_bytes()[..], &bytes[..]),
                None => prop_assert_ne!(bytes.len(), BYTES),
            }
        }
    }
}
