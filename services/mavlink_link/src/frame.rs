//! Bytes to MAVLink frames: whatever arrives, every intact frame comes out and nothing else does.
//!
//! | in | out |
//! |---|---|
//! | bytes of a stream, in pieces of any size ([`Splitter::push`]) | [`MavlinkFrame`]s with a verified checksum |
//! | whole datagrams ([`Splitter::load_datagram`]) | the same; nothing is carried from one datagram to the next |
//!
//! A frame is a start byte (`0xFD` MAVLink 2, `0xFE` MAVLink 1), a header with its length, the payload, and a
//! CRC-16/MCRF4XX that is seeded with a byte per message type. A candidate is accepted only if that checksum fits;
//! otherwise the search goes on one byte further, so that a frame hidden behind a false start is never lost.
//!
//! The message types of another dialect have an unknown seed: they cannot be verified, and count as garbage. A splitter
//! whose frames are passed on ([`Splitter::with_unknown`]) lets them through, marked as not verified, where the bytes
//! around them leave no doubt about their borders: they begin where another frame, or the datagram, has ended or begun;
//! they end where the datagram ends or the next frame begins; and no whole verified frame lies inside. Lengths that fit
//! on both sides by chance are rarer than sixteen bits of checksum; garbage on a line follows and precedes no frame for
//! long.
//!
//! Source: MAVLink developer guide, "Packet Serialization".

use crate::router::Target;
use mavlink::dialect::MavMessage;
use mavlink::error::ParserError;
use mavlink::wire::Wire;
use mavlink::{MAV_STX, MAV_STX_V2, MavHeader, MavlinkVersion, Message, calculate_crc, consts};

/// Bytes kept at most: any UDP datagram that fits an Ethernet frame several times over, and dozens of frames of a
/// stream.
pub const SPLITTER_BYTES: usize = 8192;
/// Frames of unknown types in a row whose borders fit prove each other: no verified one has to follow. Four start
/// bytes, flags and sender ids in the right places are 2^-50 by chance; and four longest frames leave half of the
/// splitter free.
const PROOF_FRAMES: usize = 4;

/// One frame, borrowed from the splitter.
#[derive(Clone, Copy, Debug)]
pub struct MavlinkFrame<'a> {
    /// Sender and sequence number.
    pub header: MavHeader,
    /// Message type.
    pub message_id: u32,
    /// Protocol version.
    pub version: MavlinkVersion,
    /// Payload; trailing zeros may have been cut by the sender.
    pub payload: &'a [u8],
    /// The whole of it, as it was on the wire.
    pub bytes: &'a [u8],
    /// The checksum fits. If not, the type is unknown and only good to be passed on.
    pub is_verified: bool,
}

impl MavlinkFrame<'_> {
    /// The message inside.
    ///
    /// # Errors
    /// [`ParserError`] if a field holds a value that its enumeration does not know.
    pub fn decode(&self) -> Result<MavMessage, ParserError> {
        MavMessage::parse(self.version, self.message_id, self.payload)
    }

    /// The addressee, whether the message is spoken here or not; of an unknown type everybody.
    pub fn target(&self) -> Target {
        let (system_id, component_id) =
            Wire::of(self.message_id).map_or((0, 0), |wire| wire.target(self.payload));
        Target {
            system_id: u32::from(system_id),
            component_id,
        }
    }

    /// Link id, time stamp and signature, if it is signed.
    pub fn signature(&self) -> Option<&[u8; consts::v2::SIGNATURE_SIZE]> {
        let is_signed = self.version == MavlinkVersion::V2
            && self.bytes[consts::v2::INCOMPAT_FLAGS_OFFSET] & consts::v2::IFLAG_SIGNED != 0;
        self.bytes.last_chunk().filter(|_| is_signed)
    }
}

/// Where the parts of a candidate frame lie.
#[derive(Clone, Copy, Debug)]
struct FrameLayout {
    version: MavlinkVersion,
    header_len: usize,
    payload_len: usize,
    frame_len: usize,
    wide_system_id: bool,
}

impl FrameLayout {
    /// Reads as much of the header as the length needs; `Ok(None)` = more bytes needed, `Err` = no frame can start so.
    fn of(candidate: &[u8]) -> Result<Option<Self>, NoFrame> {
        let (version, flags) = match candidate.first() {
            Some(&MAV_STX) => (MavlinkVersion::V1, 0),
            Some(&MAV_STX_V2) => match candidate.get(consts::v2::INCOMPAT_FLAGS_OFFSET) {
                Some(flags) if flags & !consts::v2::SUPPORTED_IFLAGS != 0 => return Err(NoFrame),
                Some(flags) => (MavlinkVersion::V2, *flags),
                None => return Ok(None),
            },
            Some(_) => return Err(NoFrame),
            None => return Ok(None),
        };
        let Some(payload_len) = candidate.get(consts::PAYLOAD_LEN_OFFSET).copied() else {
            return Ok(None);
        };
        let payload_len = usize::from(payload_len);
        let wide_system_id = flags & consts::v2::IFLAG_SYSID32 != 0;
        let header_len = consts::STX_SIZE
            + match version {
                MavlinkVersion::V1 => consts::v1::HEADER_SIZE,
                MavlinkVersion::V2 if wide_system_id => consts::v2::MAX_HEADER_SIZE,
                MavlinkVersion::V2 => consts::v2::MIN_HEADER_SIZE,
            };
        let signature_len = if flags & consts::v2::IFLAG_SIGNED != 0 {
            consts::v2::SIGNATURE_SIZE
        } else {
            0
        };
        Ok(Some(Self {
            version,
            header_len,
            payload_len,
            frame_len: header_len + payload_len + consts::CHECKSUM_SIZE + signature_len,
            wide_system_id,
        }))
    }

    /// The message type; `bytes` hold the whole frame.
    fn message_id(&self, bytes: &[u8]) -> u32 {
        match self.version {
            MavlinkVersion::V1 => u32::from(bytes[5]),
            MavlinkVersion::V2 => {
                let at = self.header_len - 3;
                u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], 0])
            }
        }
    }

    fn header(&self, bytes: &[u8]) -> MavHeader {
        let (sequence, system_at) = match self.version {
            MavlinkVersion::V1 => (bytes[2], 3),
            MavlinkVersion::V2 => (bytes[4], 5),
        };
        let (system_id, component_at) = if self.wide_system_id {
            let wide = [bytes[5], bytes[6], bytes[7], bytes[8]];
            (u32::from_le_bytes(wide), system_at + 4)
        } else {
            (u32::from(bytes[system_at]), system_at + 1)
        };
        MavHeader {
            system_id,
            component_id: bytes[component_at],
            sequence,
        }
    }

    /// What the dialect says of the type; `bytes` hold the whole frame.
    fn wire(&self, bytes: &[u8]) -> Option<Wire> {
        Wire::of(self.message_id(bytes))
    }

    /// Whether the checksum fits; `bytes` hold the whole frame.
    fn is_intact(&self, bytes: &[u8]) -> bool {
        self.wire(bytes).is_some_and(|wire| {
            let end = self.header_len + self.payload_len;
            let received = u16::from_le_bytes([bytes[end], bytes[end + 1]]);
            received == calculate_crc(&bytes[consts::STX_SIZE..end], wire.extra_crc)
        })
    }
}

/// No frame starts here.
struct NoFrame;

/// Whether the bytes around a frame of unknown type confirm its borders.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Borders {
    Fit,
    Undecided,
    DoNotFit,
}

/// Splits bytes into frames; holds the unfinished rest of a stream.
#[derive(Debug)]
pub struct Splitter {
    buffer: Box<[u8]>,
    start: usize,
    end: usize,
    /// The buffer holds a datagram: what is incomplete now stays incomplete.
    whole: bool,
    /// Frames of unknown types come out, too.
    with_unknown: bool,
    /// A frame ended, or the datagram begins, where the buffer begins.
    at_border: bool,
    garbage_bytes: u64,
}

impl Default for Splitter {
    fn default() -> Self {
        Self::new()
    }
}

impl Splitter {
    /// An empty splitter.
    pub fn new() -> Self {
        Self {
            buffer: vec![0; SPLITTER_BYTES].into_boxed_slice(),
            start: 0,
            end: 0,
            whole: false,
            with_unknown: false,
            at_border: false,
            garbage_bytes: 0,
        }
    }

    /// Lets frames of unknown types through where their borders are beyond doubt.
    pub fn with_unknown(&mut self) {
        self.with_unknown = true;
    }

    /// Bytes so far that belonged to no frame.
    pub fn garbage_bytes(&self) -> u64 {
        self.garbage_bytes
    }

    /// Bytes that wait for the rest of their frame, or to be taken by [`Self::next_frame`].
    pub fn pending(&self) -> usize {
        self.end - self.start
    }

    /// Those bytes.
    pub fn rest(&self) -> &[u8] {
        &self.buffer[self.start..self.end]
    }

    /// Appends bytes of a stream and returns how many there was room for: all of them, if [`Self::next_frame`] was
    /// called until it returned `None` and no more than `SPLITTER_BYTES - 293` bytes come at once.
    pub fn push(&mut self, bytes: &[u8]) -> usize {
        self.whole = false;
        if self.start > 0 {
            self.buffer.copy_within(self.start..self.end, 0);
            self.end -= self.start;
            self.start = 0;
        }
        let taken = bytes.len().min(self.buffer.len() - self.end);
        self.buffer[self.end..self.end + taken].copy_from_slice(&bytes[..taken]);
        self.end += taken;
        taken
    }

    /// Replaces the content by one datagram. What was left of the last one is garbage, as is anything beyond
    /// [`SPLITTER_BYTES`].
    pub fn load_datagram(&mut self, datagram: &[u8]) {
        self.garbage_bytes += self.pending() as u64;
        self.start = 0;
        self.end = 0;
        let taken = self.push(datagram);
        self.garbage_bytes += (datagram.len() - taken) as u64;
        self.whole = true;
        self.at_border = true;
    }

    /// Drops the unfinished rest, as garbage: the stream it belonged to is gone.
    pub fn reset(&mut self) {
        self.load_datagram(&[]);
        self.at_border = false;
    }

    /// The next intact frame; `None` when more bytes are needed.
    pub fn next_frame(&mut self) -> Option<MavlinkFrame<'_>> {
        loop {
            let skipped = self.buffer[self.start..self.end]
                .iter()
                .position(|byte| *byte == MAV_STX || *byte == MAV_STX_V2)
                .unwrap_or(self.end - self.start);
            self.discard(skipped);
            let candidate = &self.buffer[self.start..self.end];
            let layout = match FrameLayout::of(candidate) {
                Ok(Some(layout)) if candidate.len() >= layout.frame_len => layout,
                Ok(_) if self.whole && !candidate.is_empty() => {
                    self.discard(1);
                    continue;
                }
                Ok(_) => return None,
                Err(NoFrame) => {
                    self.discard(1);
                    continue;
                }
            };
            let is_verified = layout.is_intact(candidate);
            if !is_verified {
                match self.borders(&layout) {
                    Borders::Fit => {}
                    Borders::Undecided => return None,
                    Borders::DoNotFit => {
                        self.discard(1);
                        continue;
                    }
                }
            }
            self.at_border = true;
            let first = self.start;
            self.start += layout.frame_len;
            let bytes = &self.buffer[first..self.start];
            return Some(MavlinkFrame {
                header: layout.header(bytes),
                message_id: layout.message_id(bytes),
                version: layout.version,
                payload: &bytes[layout.header_len..layout.header_len + layout.payload_len],
                bytes,
                is_verified,
            });
        }
    }

    /// Whether the candidate at the start of the buffer, whose checksum cannot be relied on, may pass as a frame.
    fn borders(&self, layout: &FrameLayout) -> Borders {
        let bytes = &self.buffer[self.start..self.end];
        let sender = layout.header(bytes);
        let has_sender = sender.system_id != 0 && sender.component_id != 0;
        if !self.with_unknown || !self.at_border || !has_sender || layout.wire(bytes).is_some() {
            return Borders::DoNotFit;
        }
        // Only what lies inside as a whole: what reaches beyond may not be all there yet, and must not count once it
        // is.
        if (1..layout.frame_len).any(|at| is_intact_frame(&bytes[at..layout.frame_len])) {
            return Borders::DoNotFit;
        }
        // What is not all there yet: more bytes of a stream may come, a datagram is what it is.
        let (at_the_end, cut) = if self.whole {
            (Borders::Fit, Borders::DoNotFit)
        } else {
            (Borders::Undecided, Borders::Undecided)
        };
        let mut behind = &bytes[layout.frame_len..];
        for _ in 1..PROOF_FRAMES {
            if behind.is_empty() {
                return at_the_end;
            }
            match FrameLayout::of(behind) {
                Err(NoFrame) => return Borders::DoNotFit,
                Ok(Some(next)) if behind.len() >= next.frame_len => {
                    if next.wire(behind).is_some() {
                        return if next.is_intact(behind) {
                            Borders::Fit
                        } else {
                            Borders::DoNotFit
                        };
                    }
                    behind = &behind[next.frame_len..];
                }
                Ok(_) => return cut,
            }
        }
        Borders::Fit
    }

    fn discard(&mut self, count: usize) {
        self.at_border &= count == 0;
        self.start += count;
        self.garbage_bytes += count as u64;
    }
}

/// Whether `bytes` begin with a whole frame whose checksum fits.
fn is_intact_frame(bytes: &[u8]) -> bool {
    match FrameLayout::of(bytes) {
        Ok(Some(layout)) => bytes.len() >= layout.frame_len && layout.is_intact(bytes),
        Ok(None) | Err(NoFrame) => false,
    }
}
