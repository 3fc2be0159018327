//! Byte streams to answers. A decoder is fed byte by byte, allocates nothing, and is never lost: bytes that turn out to be no
//! frame are looked at again from the second one on, so that a false start inside noise does not swallow the frame behind it.
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

use crate::devices::Protocol;

/// Longest frame of a binary format.
const FRAME_BYTES: usize = 16;

/// What a device says about one direction, before its range is looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Answer {
    /// Something is at this distance (m).
    Distance(f32),
    /// The device says that nothing answers within its range.
    Nothing,
    /// The device says that its number is not to be believed: weak or saturated signal.
    Unreliable,
}

/// What a frame holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Item {
    /// A measurement.
    Measured {
        /// Direction in the plane of a scanning device (rad), positive clockwise seen from its upper side; 0 for others.
        yaw_rad: f32,
        /// What it says.
        answer: Answer,
    },
    /// The device has taken the command with this number.
    Acknowledged(u8),
}

/// A frame that was read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Its bytes on the wire; the last one is the byte that completed it.
    pub bytes: usize,
    /// What it holds.
    pub item: Item,
}

/// What became of the bytes so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Frames that were read.
    pub good: u64,
    /// Things that looked like a frame and were none: a wrong checksum, a number out of form.
    pub damaged: u64,
    /// Bytes that belong to no frame.
    pub skipped_bytes: u64,
}

/// What the bytes at the front of the buffer are.
pub(crate) enum Verdict {
    /// Not yet known.
    More,
    /// No beginning of a frame.
    Skip,
    /// A frame by its looks, with a wrong checksum.
    Damaged,
    /// A frame.
    Frame(Frame),
}

/// Bytes that are not understood yet.
#[derive(Clone, Debug, Default)]
struct Slider {
    bytes: [u8; FRAME_BYTES],
    len: usize,
}

impl Slider {
    /// Takes one byte, and reads what it completes.
    fn push(
        &mut self,
        byte: u8,
        judge: impl Fn(&[u8]) -> Verdict,
        tally: &mut Tally,
        found: &mut impl FnMut(Frame),
    ) {
        if self.len == FRAME_BYTES {
            // No format waits for so many bytes; kept as a bound all the same.
            self.forget(1, tally);
        }
        self.bytes[self.len] = byte;
        self.len += 1;
        while self.len > 0 {
            match judge(&self.bytes[..self.len]) {
                Verdict::More => return,
                Verdict::Skip => self.forget(1, tally),
                Verdict::Damaged => {
                    tally.damaged += 1;
                    self.forget(1, tally);
                }
                Verdict::Frame(frame) => {
                    tally.good += 1;
                    self.shift(frame.bytes);
                    found(frame);
                }
            }
        }
    }

    fn forget(&mut self, count: usize, tally: &mut Tally) {
        tally.skipped_bytes += count as u64;
        self.shift(count);
    }

    fn shift(&mut self, count: usize) {
        let count = count.clamp(1, self.len);
        self.bytes.copy_within(count..self.len, 0);
        self.len -= count;
    }
}

#[derive(Clone, Debug)]
enum Format {
    Sf45(Slider),
    Cm8jl65(Slider),
    Benewake(Slider, benewake::Rules),
    LightwareText(lightware_text::Line),
}

/// The decoder of one device.
#[derive(Clone, Debug)]
pub struct Decoder {
    format: Format,
    tally: Tally,
}

impl Decoder {
    /// For devices that speak `protocol`; nothing read yet.
    pub fn new(protocol: Protocol) -> Self {
        let format = match protocol {
            Protocol::Sf45 => Format::Sf45(Slider::default()),
            Protocol::Cm8jl65 => Format::Cm8jl65(Slider::default()),
            Protocol::Benewake(rules) => Format::Benewake(Slider::default(), rules),
            Protocol::LightwareText => Format::LightwareText(lightware_text::Line::default()),
        };
        Self {
            format,
            tally: Tally::default(),
        }
    }

    /// Takes one byte and hands every frame that it completes to `found`: mostly none, sometimes one; two only after damage.
    pub fn push(&mut self, byte: u8, mut found: impl FnMut(Frame)) {
        let Self { format, tally } = self;
        match format {
            Format::Sf45(slider) => slider.push(byte, sf45::judge, tally, &mut found),
            Format::Cm8jl65(slider) => slider.push(byte, cm8jl65::judge, tally, &mut found),
            Format::Benewake(slider, rules) => {
                slider.push(byte, |bytes| benewake::judge(bytes, rules), tally, &mut found);
            }
            Format::LightwareText(line) => line.push(byte, tally, &mut found),
        }
    }

    /// What became of the bytes so far.
    pub fn tally(&self) -> Tally {
        self.tally
    }

    /// The line was interrupted: what was begun will not be completed.
    pub fn interrupted(&mut self) {
        match &mut self.format {
            Format::Sf45(slider) | Format::Cm8jl65(slider) | Format::Benewake(slider, _) => {
                *slider = Slider::default();
            }
            Format::LightwareText(line) => *line = lightware_text::Line::default(),
        }
    }
}
