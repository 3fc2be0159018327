//! Serial scanners: bytes in, samples out, and what is to be written so that they come.
//!
//! | module | holds |
//! |---|---|
//! | [`ldrobot`] | packets of LD06, LD19, STL-27L, which stream by themselves |
//! | [`rplidar`] | answers and set-up of the RPLIDAR family |
//! | [`turn`] | samples of one turn become one scan |
//! | [`driver`] | all of it together: the step |

pub mod driver;
pub mod ldrobot;
pub mod rplidar;
pub mod turn;

use jink_shared_types::Timestamp;

/// One measured direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// When it was measured.
    pub time: Timestamp,
    /// Direction (deg), clockwise seen from above, from the scanner's front.
    pub angle_deg: f32,
    /// Range (m); zero where nothing answered.
    pub range_m: f32,
}

/// What has become of the bytes of a line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SampleCounts {
    /// Frames that were read.
    pub good: u64,
    /// What looked like a frame and was none.
    pub damaged: u64,
    /// Bytes that belong to no frame.
    pub skipped_bytes: u64,
}

/// Longest frame of a scanner (bytes).
const FRAME_BYTES: usize = 96;

/// Bytes that may become a frame.
#[derive(Clone, Copy, Debug)]
struct SlidingWindow {
    bytes: [u8; FRAME_BYTES],
    length: usize,
}

impl SlidingWindow {
    const EMPTY: Self = Self {
        bytes: [0; FRAME_BYTES],
        length: 0,
    };

    fn push(&mut self, byte: u8) {
        if self.length == FRAME_BYTES {
            self.drop_first(1);
        }
        self.bytes[self.length] = byte;
        self.length += 1;
    }

    fn bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }

    fn drop_first(&mut self, count: usize) {
        let count = count.min(self.length);
        self.bytes.copy_within(count..self.length, 0);
        self.length -= count;
    }
}
