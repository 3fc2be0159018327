//! Byte streams to measurements. A decoder takes byte after byte, allocates nothing, and always recovers: bytes that
//! turn out to be no frame are read again from the second one on, so that a false start inside noise does not swallow
//! the frame behind it.
//!
//! | format | frame | redundancy |
//! |---|---|---|
//! | [`sf45`] | 10 bytes | CRC-16 |
//! | [`cm8jl65`] | 6 bytes | CRC-16 |
//! | [`benewake`] | 9 bytes | 8-bit sum |
//! | [`lightware_text`] | 6 to 9 bytes | none but the form of the number |

pub mod benewake;
pub mod cm8jl65;
pub mod lightware_text;
pub mod sf45;

/// Longest frame of a binary format.
const FRAME_BYTES: usize = 16;

/// A device's measurement in one direction, before it is compared with the configured range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RangeReading {
    /// Something is at this distance (m).
    Distance(f32),
    /// The device reports that nothing is within its range.
    Nothing,
    /// The device reports that its measurement is not reliable: weak or saturated signal.
    Unreliable,
}

/// What a frame holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FrameContent {
    /// A measurement.
    Measured {
        /// Direction in the plane of a scanning device (rad), positive clockwise seen from its upper side; 0 for
        /// others.
        yaw_rad: f32,
        /// The measurement.
        answer: RangeReading,
    },
    /// The device has accepted the command with this number.
    Acknowledged(u8),
}

/// A frame that was read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviceFrame {
    /// Its bytes on the wire; the last one is the byte that completed it.
    pub bytes: usize,
    /// What it holds.
    pub item: FrameContent,
}

/// What became of the bytes so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameCounts {
    /// Frames that were read.
    pub good: u64,
    /// Things that looked like a frame and were none: a wrong checksum, a number out of form.
    pub damaged: u64,
    /// Bytes that belong to no frame.
    pub skipped_bytes: u64,
}

/// What the bytes at the front of the buffer are.
pub(crate) enum FrameMatch {
    /// Not yet known.
    More,
    /// No beginning of a frame.
    Skip,
    /// What looks like a frame, with a wrong checksum.
    Damaged,
    /// A frame.
    Frame(DeviceFrame),
}

/// Bytes that are not understood yet.
#[derive(Clone, Debug, Default)]
struct SlidingBuffer {
    bytes: [u8; FRAME_BYTES],
    len: usize,
}

impl SlidingBuffer {
    /// Takes one byte, and reads what it completes.
    fn push(
        &mut self,
        byte: u8,
        judge: impl Fn(&[u8]) -> FrameMatch,
        counts: &mut FrameCounts,
        found: &mut impl FnMut(DeviceFrame),
    ) {
        if self.len == FRAME_BYTES {
            // No format waits for so many bytes; kept as a bound all the same.
            self.forget(1, counts);
        }
        self.bytes[self.len] = byte;
        self.len += 1;
        while self.len > 0 {
            match judge(&self.bytes[..self.len]) {
                FrameMatch::More => return,
                FrameMatch::Skip => self.forget(1, counts),
                FrameMatch::Damaged => {
                    counts.damaged += 1;
                    self.forget(1, counts);
                }
                FrameMatch::Frame(frame) => {
                    counts.good += 1;
                    self.shift(frame.bytes);
                    found(frame);
                }
            }
        }
    }

    fn forget(&mut self, count: usize, counts: &mut FrameCounts) {
        counts.skipped_bytes += count as u64;
        self.shift(count);
    }

    fn shift(&mut self, count: usize) {
        let count = count.clamp(1, self.len);
        self.bytes.copy_within(count..self.len, 0);
        self.len -= count;
    }
}

#[derive(Clone, Debug)]
enum FormatDecoder {
    Sf45(SlidingBuffer),
    Cm8jl65(SlidingBuffer),
    Benewake(SlidingBuffer, benewake::SignalLimits),
    LightwareText(lightware_text::TextLine),
}

/// The format in which a device sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WireFormat {
    /// [`self::sf45`].
    Sf45,
    /// [`self::cm8jl65`].
    Cm8jl65,
    /// [`self::benewake`].
    Benewake(benewake::SignalLimits),
    /// [`self::lightware_text`].
    LightwareText,
}

/// The decoder of one device.
#[derive(Clone, Debug)]
pub struct Decoder {
    format: FormatDecoder,
    counts: FrameCounts,
}

impl Decoder {
    /// For devices that send `format`; nothing read yet.
    pub fn new(format: WireFormat) -> Self {
        let format = match format {
            WireFormat::Sf45 => FormatDecoder::Sf45(SlidingBuffer::default()),
            WireFormat::Cm8jl65 => FormatDecoder::Cm8jl65(SlidingBuffer::default()),
            WireFormat::Benewake(rules) => FormatDecoder::Benewake(SlidingBuffer::default(), rules),
            WireFormat::LightwareText => FormatDecoder::LightwareText(lightware_text::TextLine::default()),
        };
        Self {
            format,
            counts: FrameCounts::default(),
        }
    }

    /// Takes one byte and hands every frame that it completes to `found`: mostly none, sometimes one; two only after
    /// damage.
    pub fn push(&mut self, byte: u8, mut found: impl FnMut(DeviceFrame)) {
        let Self { format, counts } = self;
        match format {
            FormatDecoder::Sf45(buffer) => buffer.push(byte, sf45::judge, counts, &mut found),
            FormatDecoder::Cm8jl65(buffer) => buffer.push(byte, cm8jl65::judge, counts, &mut found),
            FormatDecoder::Benewake(buffer, rules) => {
                buffer.push(byte, |bytes| benewake::judge(bytes, rules), counts, &mut found);
            }
            FormatDecoder::LightwareText(line) => line.push(byte, counts, &mut found),
        }
    }

    /// What became of the bytes so far.
    pub fn counts(&self) -> FrameCounts {
        self.counts
    }

    /// The line was interrupted: what was begun will not be completed.
    pub fn interrupted(&mut self) {
        match &mut self.format {
            FormatDecoder::Sf45(buffer)
            | FormatDecoder::Cm8jl65(buffer)
            | FormatDecoder::Benewake(buffer, _) => {
                *buffer = SlidingBuffer::default();
            }
            FormatDecoder::LightwareText(line) => *line = lightware_text::TextLine::default(),
        }
    }
}
