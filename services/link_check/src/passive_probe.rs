//! What is measured on a link without sending: bytes, protocol versions, signatures, missing sequence numbers.
//!
//! | in | out |
//! |---|---|
//! | every frame of one link ([`FrameFilter`]) | [`Counts`]; frames whose signature is refused go no further |

use jink_mavlink_link::frame::MavlinkFrame;
use jink_mavlink_link::link::{FrameFilter, LinkCounters};
use jink_mavlink_link::links::LinkSetup;
use jink_mavlink_link::message::{COMPONENT_AUTOPILOT, Content};
use jink_mavlink_link::signing::{SignatureRefusal, Verifier, stamps};
use mavlink::MavlinkVersion;

/// Systems whose autopilots are counted separately on one link.
const AUTOPILOTS: usize = 4;

/// What was counted on one link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Bytes of intact frames.
    pub frame_bytes: u64,
    /// Bytes that belonged to none.
    pub garbage_bytes: u64,
    /// Intact frames, those of unknown types included.
    pub frames: u64,
    /// Frames of autopilots in MAVLink 1.
    pub version_1: u64,
    /// The same in MAVLink 2.
    pub version_2: u64,
    /// The same with a signature, whether or not it is verified.
    pub signed: u64,
    /// Frames refused because they are not signed.
    pub unsigned_refused: u64,
    /// Frames refused because the signature does not fit the key.
    pub signature_refused: u64,
    /// Frames rejected because they are not newer than what was received.
    pub replayed: u64,
    /// Messages of autopilots that never came: their sequence numbers are missing.
    pub lost: u64,
    /// Datagrams and connections from addresses that are not among the peers.
    pub unknown_peers: u64,
}

impl Counts {
    /// All bytes received.
    pub fn bytes(&self) -> u64 {
        self.frame_bytes + self.garbage_bytes
    }

    /// With what the link counts itself.
    #[must_use]
    pub fn with_link(self, link: LinkCounters) -> Self {
        Self {
            garbage_bytes: link.garbage_bytes,
            unknown_peers: link.unknown_peers,
            ..self
        }
    }
}

/// Listens to one link.
#[derive(Debug)]
pub struct PassiveProbe {
    setup: LinkSetup,
    verifier: Verifier,
    counts: Counts,
    /// System and last number of each autopilot; system 0 marks a free place.
    numbers: [(u32, u8); AUTOPILOTS],
}

impl PassiveProbe {
    /// On the link of `setup`.
    pub fn new(setup: LinkSetup) -> Self {
        Self {
            setup,
            verifier: Verifier::default(),
            counts: Counts::default(),
            numbers: [(0, 0); AUTOPILOTS],
        }
    }

    /// What was counted so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    fn count_autopilot(&mut self, frame: &MavlinkFrame<'_>) {
        match frame.version {
            MavlinkVersion::V1 => self.counts.version_1 += 1,
            MavlinkVersion::V2 => self.counts.version_2 += 1,
        }
        self.counts.signed += u64::from(frame.signature().is_some());
        let system_id = frame.header.system_id;
        let place = self
            .numbers
            .iter_mut()
            .find(|(known, _)| *known == system_id || *known == 0);
        if let Some((known, last)) = place {
            let missing = frame.header.sequence.wrapping_sub(*last).wrapping_sub(1);
            // A number that goes back was overtaken, or its sender has restarted.
            if *known == system_id && missing < u8::MAX / 2 {
                self.counts.lost += u64::from(missing);
            }
            *known = system_id;
            *last = frame.header.sequence;
        }
    }
}

impl FrameFilter for PassiveProbe {
    fn admits(&mut self, frame: &MavlinkFrame<'_>) -> bool {
        self.counts.frames += 1;
        self.counts.frame_bytes += frame.bytes.len() as u64;
        if frame.header.component_id == COMPONENT_AUTOPILOT {
            self.count_autopilot(frame);
        }
        let key = self.setup.key.as_ref();
        let verified = self
            .verifier
            .verify(frame, self.setup.signing, key, stamps::wall());
        match verified {
            Ok(()) => return true,
            Err(SignatureRefusal::Unsigned) => self.counts.unsigned_refused += 1,
            Err(SignatureRefusal::Signature) => self.counts.signature_refused += 1,
            Err(SignatureRefusal::Replayed) => self.counts.replayed += 1,
        }
        false
    }

    fn wants(&mut self, _: &MavlinkFrame<'_>, content: Option<&Content>) -> bool {
        content.is_some()
    }
}
