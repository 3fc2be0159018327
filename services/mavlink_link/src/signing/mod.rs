//! Signatures of MAVLink 2: without the key no sender can command, and its messages are rejected.
//!
//! | in | out |
//! |---|---|
//! | a frame of ours, [`Key`], link id, stamp | the frame with its signature ([`sign`]) |
//! | a frame as received, what the link asks for | whether it is taken, or why not ([`Verifier::verify`]) |
//!
//! A signature is the first 48 bits of SHA-256 over the key, the whole frame with its checksum, the link id and a stamp
//! of 48 bits, 10 us since 2015. Stamps of one sender on one of its links only ever grow, so what was recorded cannot
//! be played back; a new sender may be a minute behind the newest stamp seen, no more. RADIO_STATUS comes from the
//! modem itself, which has no key: it is taken without a signature everywhere.
//!
//! The crate `mavlink` can sign as well, but reads the system's clock itself and starts with no memory: its stamps
//! repeat when the clock goes back over a restart. Those of [`stamps::Stamps`] never do.
//!
//! Source: MAVLink guide, "Message Signing".

mod key;
pub mod stamps;

pub use key::{Key, KeyError};

use crate::frame::MavlinkFrame;
use jink_runtime::config::Signing;
use mavlink::dialect::RADIO_STATUS_DATA;
use mavlink::wire::Wire;
use mavlink::{MAV_STX_V2, MessageData, calculate_crc, consts};
use sha2::{Digest, Sha256};

/// Bytes that a signature adds to a frame.
pub const SIGNATURE_BYTES: usize = consts::v2::SIGNATURE_SIZE;
/// The longest signed frame.
pub const SIGNED_FRAME_MAX: usize = consts::MAX_FRAME_SIZE;
/// Bytes of it that are the hash; the others are link id and stamp.
const HASH_BYTES: usize = 6;
/// How far a new sender may be behind the newest stamp: a minute.
const NEW_STREAM_BEHIND: u64 = 60 * stamps::PER_SECOND;
/// Senders remembered, each link of theirs by itself.
const STREAMS: usize = 64;

/// Why a frame is not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SignatureRefusal {
    /// The signature does not fit the key.
    Signature,
    /// Signed, but its stamp is not newer than the last one received.
    Replayed,
    /// Not signed.
    Unsigned,
}

/// Signs `frame` (MAVLink 2, not signed yet) into `signed`; `None` if it is no such frame, or too long.
pub fn sign<'a>(
    frame: &[u8],
    key: &Key,
    link_id: u8,
    stamp: u64,
    signed: &'a mut [u8; SIGNED_FRAME_MAX],
) -> Option<&'a [u8]> {
    let is_unsigned_v2 = frame.first() == Some(&MAV_STX_V2)
        && frame.get(consts::v2::INCOMPAT_FLAGS_OFFSET) == Some(&0)
        && frame.len() >= consts::STX_SIZE + consts::v2::MIN_HEADER_SIZE + consts::CHECKSUM_SIZE;
    let end = frame.len() + SIGNATURE_BYTES;
    if !is_unsigned_v2 || end > signed.len() {
        return None;
    }
    signed[..frame.len()].copy_from_slice(frame);
    signed[consts::v2::INCOMPAT_FLAGS_OFFSET] = consts::v2::IFLAG_SIGNED;
    let message_id = u32::from_le_bytes([frame[7], frame[8], frame[9], 0]);
    let seed = Wire::of(message_id).map_or(0, |wire| wire.extra_crc);
    let crc_at = frame.len() - consts::CHECKSUM_SIZE;
    let crc = calculate_crc(&signed[consts::STX_SIZE..crc_at], seed);
    signed[crc_at..frame.len()].copy_from_slice(&crc.to_le_bytes());
    signed[frame.len()] = link_id;
    signed[frame.len() + 1..end - HASH_BYTES].copy_from_slice(&stamp.to_le_bytes()[..6]);
    let hash = hash(key, &signed[..end - HASH_BYTES]);
    signed[end - HASH_BYTES..end].copy_from_slice(&hash);
    Some(&signed[..end])
}

fn hash(key: &Key, signed_part: &[u8]) -> [u8; HASH_BYTES] {
    let digest = Sha256::new()
        .chain_update(key.bytes())
        .chain_update(signed_part)
        .finalize();
    std::array::from_fn(|i| digest[i])
}

#[derive(Clone, Copy, Debug)]
struct SignedStream {
    system_id: u32,
    component_id: u8,
    link_id: u8,
    stamp: u64,
}

/// The stamps received so far, on all links together: what was recorded on one cannot be played back on another.
#[derive(Clone, Debug)]
pub struct Verifier {
    streams: Vec<SignedStream>,
    newest: u64,
}

impl Default for Verifier {
    fn default() -> Self {
        Self {
            streams: Vec::with_capacity(STREAMS),
            newest: 0,
        }
    }
}

impl Verifier {
    /// Whether `frame` is accepted on a link that asks for `signing` with `key`. `ours` is our own next stamp.
    ///
    /// # Errors
    /// [`SignatureRefusal`].
    pub fn verify(
        &mut self,
        frame: &MavlinkFrame<'_>,
        signing: Signing,
        key: Option<&Key>,
        ours: u64,
    ) -> Result<(), SignatureRefusal> {
        if signing == Signing::Off || frame.message_id == RADIO_STATUS_DATA::ID && frame.is_verified {
            return Ok(());
        }
        let (Some(signature), Some(key)) = (frame.signature(), key) else {
            return match signing {
                Signing::Require => Err(SignatureRefusal::Unsigned),
                Signing::Accept | Signing::Off => Ok(()),
            };
        };
        let (received, signed_part) = (
            &signature[SIGNATURE_BYTES - HASH_BYTES..],
            &frame.bytes[..frame.bytes.len() - HASH_BYTES],
        );
        // All bytes are compared, so that the time it takes reveals nothing about how many fit.
        let differences = hash(key, signed_part)
            .iter()
            .zip(received)
            .fold(0, |sum, (ours, received)| sum | (ours ^ received));
        if differences != 0 {
            return Err(SignatureRefusal::Signature);
        }
        let mut stamp = [0; 8];
        stamp[..6].copy_from_slice(&signature[1..7]);
        self.newest = self.newest.max(ours);
        self.take(SignedStream {
            system_id: frame.header.system_id,
            component_id: frame.header.component_id,
            link_id: signature[0],
            stamp: u64::from_le_bytes(stamp),
        })
    }

    fn take(&mut self, received: SignedStream) -> Result<(), SignatureRefusal> {
        let is_it = |stream: &SignedStream| {
            (stream.system_id, stream.component_id, stream.link_id)
                == (received.system_id, received.component_id, received.link_id)
        };
        let oldest_new = self.newest.saturating_sub(NEW_STREAM_BEHIND);
        match self.streams.iter_mut().find(|stream| is_it(stream)) {
            Some(known) if received.stamp <= known.stamp => return Err(SignatureRefusal::Replayed),
            Some(known) => known.stamp = received.stamp,
            None if received.stamp < oldest_new => return Err(SignatureRefusal::Replayed),
            None => {
                if self.streams.len() == STREAMS {
                    // Whoever is forgotten here is too far behind to be played back.
                    self.streams.retain(|stream| stream.stamp >= oldest_new);
                }
                if self.streams.len() == STREAMS {
                    return Err(SignatureRefusal::Replayed);
                }
                self.streams.push(received);
            }
        }
        self.newest = self.newest.max(received.stamp);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::stamps::PER_SECOND;
    use super::{Key, SIGNED_FRAME_MAX, SignatureRefusal, Verifier, sign};
    use crate::encoder::Encoder;
    use crate::frame::Splitter;
    use crate::message::Body;
    use jink_runtime::config::Signing;
    use mavlink::dialect::{ATTITUDE_QUATERNION_DATA, MavMessage, RADIO_STATUS_DATA};
    use proptest::prelude::*;

    fn frame(message: MavMessage) -> Vec<u8> {
        Encoder::new().encode(1, 196, &Body::Message(message)).to_vec()
    }

    fn attitude(time_boot_ms: u32) -> Vec<u8> {
        frame(MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
            time_boot_ms,
            ..ATTITUDE_QUATERNION_DATA::default()
        }))
    }

    fn key(byte: u8) -> Key {
        Key::of_bytes(&[byte; 32]).unwrap()
    }

    fn signed(frame: &[u8], key: &Key, link_id: u8, stamp: u64) -> Vec<u8> {
        let mut into = [0; SIGNED_FRAME_MAX];
        sign(frame, key, link_id, stamp, &mut into).unwrap().to_vec()
    }

    /// `None` = the bytes are no frame at all.
    fn verify(
        verifier: &mut Verifier,
        bytes: &[u8],
        signing: Signing,
        key: &Key,
    ) -> Option<Result<(), SignatureRefusal>> {
        let mut splitter = Splitter::new();
        splitter.load_datagram(bytes);
        let frame = splitter.next_frame()?;
        Some(verifier.verify(&frame, signing, Some(key), 0))
    }

    #[test]
    fn what_is_not_signed_is_taken_or_refused_as_the_link_asks() {
        let (key, radio) = (
            key(7),
            frame(MavMessage::RADIO_STATUS(RADIO_STATUS_DATA::default())),
        );
        let mut verifier = Verifier::default();
        for (bytes, signing, taken) in [
            (&attitude(1), Signing::Off, Ok(())),
            (&attitude(1), Signing::Accept, Ok(())),
            (&attitude(1), Signing::Require, Err(SignatureRefusal::Unsigned)),
            (&radio, Signing::Require, Ok(())),
        ] {
            assert_eq!(
                verify(&mut verifier, bytes, signing, &key),
                Some(taken),
                "{signing:?}"
            );
        }
    }

    #[test]
    fn a_new_sender_may_be_a_minute_behind_and_no_more() {
        let (key, minute) = (key(7), 60 * PER_SECOND);
        let mut verifier = Verifier::default();
        let now = 1_000 * PER_SECOND;
        for (link_id, stamp, taken) in [
            (0, now, Ok(())),
            (1, now - minute, Ok(())),
            (2, now - minute - 1, Err(SignatureRefusal::Replayed)),
            (0, now, Err(SignatureRefusal::Replayed)),
            (1, now - minute + 1, Ok(())),
        ] {
            let bytes = signed(&attitude(1), &key, link_id, stamp);
            assert_eq!(
                verify(&mut verifier, &bytes, Signing::Accept, &key),
                Some(taken),
                "{link_id}"
            );
        }
    }

    #[test]
    fn senders_without_number_neither_fill_the_memory_nor_open_it_to_replays() {
        let key = key(7);
        let mut verifier = Verifier::default();
        let first = signed(&attitude(0), &key, 0, 0);
        assert_eq!(
            verify(&mut verifier, &first, Signing::Require, &key),
            Some(Ok(()))
        );
        for link_id in 1..=200u8 {
            let stamp = u64::from(link_id) * 10 * PER_SECOND;
            let bytes = signed(&attitude(1), &key, link_id, stamp);
            assert_eq!(
                verify(&mut verifier, &bytes, Signing::Require, &key),
                Some(Ok(()))
            );
            assert!(verifier.streams.len() <= super::STREAMS);
        }
        assert_eq!(
            verify(&mut verifier, &first, Signing::Require, &key),
            Some(Err(SignatureRefusal::Replayed))
        );
    }

    proptest! {
        #[test]
        fn a_signed_frame_is_taken_with_its_key_only_and_only_once(
            time in any::<u32>(), right in any::<[u8; 32]>(), wrong in any::<[u8; 32]>(),
            link_id in any::<u8>(), stamp in 0..1u64 << 48,
        ) {
            prop_assume!(right != wrong);
            let (right, wrong) = (Key::of_bytes(&right).unwrap(), Key::of_bytes(&wrong).unwrap());
            let bytes = signed(&attitude(time), &right, link_id, stamp);
            for signing in [Signing::Accept, Signing::Require] {
                let mut verifier = Verifier::default();
                prop_assert_eq!(verify(&mut verifier, &bytes, signing, &wrong), Some(Err(SignatureRefusal::Signature)));
                prop_assert_eq!(verify(&mut verifier, &bytes, signing, &right), Some(Ok(())));
                prop_assert_eq!(verify(&mut verifier, &bytes, signing, &right), Some(Err(SignatureRefusal::Replayed)));
            }
        }

        #[test]
        fn one_bit_that_is_not_as_it_was_sent_is_refused(
            time in any::<u32>(), at in any::<prop::sample::Index>(), bit in 0..8u8,
        ) {
            let key = key(9);
            let mut bytes = signed(&attitude(time), &key, 3, 77);
            let at = at.index(bytes.len());
            bytes[at] ^= 1 << bit;
            let verified = verify(&mut Verifier::default(), &bytes, Signing::Require, &key);
            prop_assert!(matches!(verified, None | Some(Err(_))), "{:?}", verified);
        }
    }
}
