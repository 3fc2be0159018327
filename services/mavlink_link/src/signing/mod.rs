//! Signatures of MAVLink 2: without the key no sender can command, and its messages are rejected.
//!
//! | in | out |
//! |---|---|
//! | a frame of ours, [`Key`], link id, stamp | the frame with its signature ([`sign`]) |
//! | a frame as received, what the link asks for | whether it is taken, or why not ([`Verifier::verify`]) |
//!
//! A signature is the first 48 bits of SHA-256 over the key, the whole frame with its checksum, the link id and a stamp
//! of 48 bits, 10 us since 2015. Stamps of one sender on one of its links only ever grow, so what was recorded cannot
//! be played back; a new sender may be a minute behind the newest stamp seen, no more. Who is ahead of our own clock
//! by more than a minute is taken, but makes nobody else old. The stamps received outlive a killed process
//! ([`Verifier::remembering`]). RADIO_STATUS comes from the modem itself, which has no key: it is taken without a
//! signature everywhere.
//!
//! The crate `mavlink` can sign as well, but reads the system's clock itself and starts with no memory: its stamps
//! repeat when the clock goes back over a restart. Those of [`stamps::Stamps`] never do.
//!
//! Source: MAVLink guide, "Message Signing".

mod key;
mod senders;
pub mod stamps;

pub use key::{Key, KeyError};

use crate::frame::MavlinkFrame;
use jink_runtime::config::Signing;
use mavlink::dialect::RADIO_STATUS_DATA;
use mavlink::wire::Wire;
use mavlink::{MAV_STX_V2, MessageData, calculate_crc, consts};
use senders::SenderFile;
use sha2::{Digest, Sha256};
use std::io;
use std::path::Path;

/// Bytes that a signature adds to a frame.
pub const SIGNATURE_BYTES: usize = consts::v2::SIGNATURE_SIZE;
/// The longest signed frame.
pub const SIGNED_FRAME_MAX: usize = consts::MAX_FRAME_SIZE;
/// Bytes of it that are the hash; the others are link id and stamp.
const HASH_BYTES: usize = 6;
/// How far a new sender may be behind the newest stamp, and that ahead of our own: a minute.
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

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct SignedStream {
    system_id: u32,
    component_id: u8,
    link_id: u8,
    stamp: u64,
}

impl SignedStream {
    fn is_of_the_sender_of(&self, other: &Self) -> bool {
        (self.system_id, self.component_id, self.link_id)
            == (other.system_id, other.component_id, other.link_id)
    }
}

/// The stamps received so far, on all links together: what was recorded on one cannot be played back on another.
#[derive(Debug)]
pub struct Verifier {
    streams: Vec<SignedStream>,
    newest: u64,
    /// The stream that was received last.
    last: Option<usize>,
    file: Option<SenderFile>,
}

impl Default for Verifier {
    fn default() -> Self {
        Self {
            streams: Vec::with_capacity(STREAMS),
            newest: 0,
            last: None,
            file: None,
        }
    }
}

impl Verifier {
    /// With the stamps that another process has kept in the file at `path`, and in its `copy` on a disk.
    ///
    /// # Errors
    /// The system's error about the file.
    pub fn remembering(path: &Path, copy: Option<&Path>) -> io::Result<Self> {
        let mut streams = Vec::with_capacity(STREAMS);
        let file = SenderFile::open(path, copy, &mut streams)?;
        Ok(Self {
            streams,
            file: Some(file),
            ..Self::default()
        })
    }

    /// Keeps what was received last for the process that comes after this one. Only the owner of the links writes.
    pub fn store(&mut self, is_owner: bool) {
        if let Some(file) = &mut self.file {
            file.store(&self.streams, self.last.take(), is_owner);
        }
    }

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
        let received = SignedStream {
            system_id: frame.header.system_id,
            component_id: frame.header.component_id,
            link_id: signature[0],
            stamp: u64::from_le_bytes(stamp),
        };
        self.take(received)?;
        // A clock that is far ahead of ours makes no other sender old.
        if received.stamp <= ours.saturating_add(NEW_STREAM_BEHIND) {
            self.newest = self.newest.max(received.stamp);
        }
        Ok(())
    }

    fn take(&mut self, received: SignedStream) -> Result<(), SignatureRefusal> {
        let oldest_new = self.newest.saturating_sub(NEW_STREAM_BEHIND);
        let known = self
            .streams
            .iter()
            .position(|stream| stream.is_of_the_sender_of(&received));
        let place = match known {
            Some(known) if received.stamp <= self.streams[known].stamp => None,
            Some(known) => Some(known),
            None if received.stamp < oldest_new => None,
            None if self.streams.len() < STREAMS => {
                self.streams.push(received);
                Some(self.streams.len() - 1)
            }
            // Whoever is forgotten here is too far behind to be played back.
            None => self.streams.iter().position(|stream| stream.stamp < oldest_new),
        };
        let place = place.ok_or(SignatureRefusal::Replayed)?;
        self.streams[place] = received;
        self.last = Some(place);
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

    /// Our own stamp.
    const NOW: u64 = 1_000 * PER_SECOND;

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
        verify_at(verifier, bytes, signing, key, NOW)
    }

    fn verify_at(
        verifier: &mut Verifier,
        bytes: &[u8],
        signing: Signing,
        key: &Key,
        ours: u64,
    ) -> Option<Result<(), SignatureRefusal>> {
        let mut splitter = Splitter::new();
        splitter.load_datagram(bytes);
        let frame = splitter.next_frame()?;
        Some(verifier.verify(&frame, signing, Some(key), ours))
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
        for (link_id, stamp, taken) in [
            (0, NOW, Ok(())),
            (1, NOW - minute, Ok(())),
            (2, NOW - minute - 1, Err(SignatureRefusal::Replayed)),
            (0, NOW, Err(SignatureRefusal::Replayed)),
            (1, NOW - minute + 1, Ok(())),
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
        let first = signed(&attitude(0), &key, 0, NOW);
        assert_eq!(
            verify(&mut verifier, &first, Signing::Require, &key),
            Some(Ok(()))
        );
        for link_id in 1..=200u8 {
            let stamp = NOW + u64::from(link_id) * 10 * PER_SECOND;
            let bytes = signed(&attitude(1), &key, link_id, stamp);
            assert_eq!(
                verify_at(&mut verifier, &bytes, Signing::Require, &key, stamp),
                Some(Ok(()))
            );
            assert!(verifier.streams.len() <= super::STREAMS);
        }
        assert_eq!(
            verify(&mut verifier, &first, Signing::Require, &key),
            Some(Err(SignatureRefusal::Replayed))
        );
    }

    #[test]
    fn a_clock_that_is_years_ahead_locks_no_other_sender_out() {
        let (key, years) = (key(7), 10 * 365 * 86_400 * PER_SECOND);
        let mut verifier = Verifier::default();
        for (link_id, stamp, taken) in [
            (0, NOW + years, Ok(())),
            (1, NOW, Ok(())),
            (0, NOW + years, Err(SignatureRefusal::Replayed)),
            (2, NOW - 1, Ok(())),
        ] {
            let bytes = signed(&attitude(1), &key, link_id, stamp);
            let verified = verify(&mut verifier, &bytes, Signing::Require, &key);
            assert_eq!(verified, Some(taken), "{link_id}");
        }
    }

    #[test]
    fn what_was_recorded_cannot_be_played_back_to_the_next_process() {
        let path = std::env::temp_dir().join(format!("jink_senders_{}", std::process::id()));
        let _absent = std::fs::remove_file(&path);
        let key = key(7);
        let sent: Vec<_> = (0..300u16)
            .map(|n| signed(&attitude(n.into()), &key, (n % 70) as u8, NOW + u64::from(n)))
            .collect();
        // Each process receives a part, beside one that only listens, and is killed.
        for part in sent.chunks(60) {
            let mut listens = Verifier::remembering(&path, None).unwrap();
            let mut owns = Verifier::remembering(&path, None).unwrap();
            for bytes in part {
                for (verifier, is_owner) in [(&mut listens, false), (&mut owns, true)] {
                    let verified = verify(verifier, bytes, Signing::Require, &key);
                    verifier.store(is_owner);
                    // More senders than are remembered are refused while all of them are new.
                    assert!(verified.is_some());
                }
            }
        }
        let mut next = Verifier::remembering(&path, None).unwrap();
        for bytes in &sent {
            let verified = verify(&mut next, bytes, Signing::Require, &key);
            assert_eq!(verified, Some(Err(SignatureRefusal::Replayed)));
        }
        std::fs::write(&path, [7; 33]).unwrap();
        assert!(
            Verifier::remembering(&path, None).is_ok(),
            "a damaged file is used in part"
        );
        std::fs::remove_file(&path).unwrap();
    }

    #[test]
    fn what_was_recorded_cannot_be_played_back_to_the_next_start() {
        let folder = std::env::temp_dir().join(format!("jink_senders_kept_{}", std::process::id()));
        let (instance, kept) = (folder.join("instance"), folder.join("state"));
        let start = || {
            std::fs::create_dir_all(&instance).unwrap();
            Verifier::remembering(&instance.join("senders"), Some(&kept)).unwrap()
        };
        std::fs::create_dir(&folder).unwrap();
        let key = key(7);
        for n in 0..3 {
            let bytes = signed(&attitude(n), &key, 0, NOW + u64::from(n));
            let (mut listens, mut owns) = (start(), start());
            assert_eq!(verify(&mut owns, &bytes, Signing::Require, &key), Some(Ok(())));
            owns.store(true);
            drop(owns);
            // A process that has received nothing takes nothing back.
            listens.store(false);
            drop(listens);
            std::fs::remove_dir_all(&instance).unwrap();
            let again = verify(&mut start(), &bytes, Signing::Require, &key);
            assert_eq!(again, Some(Err(SignatureRefusal::Replayed)));
        }
        std::fs::remove_dir_all(&folder).unwrap();
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
