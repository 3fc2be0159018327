//! Benewake TFmini, TFmini-S, TFmini Plus, TF-Luna: nine bytes, as all of them send by default.
//!
//! | byte | holds |
//! |---|---|
//! | 0, 1 | 0x59, 0x59 |
//! | 2, 3 | distance (cm), low byte first |
//! | 4, 5 | strength of the signal, low byte first |
//! | 6, 7 | temperature; TFmini: distance mode, spare |
//! | 8 | sum of bytes 0 to 7, its low 8 bits |
//!
//! | model | unreliable | nothing in range |
//! |---|---|---|
//! | TFmini | strength below 20 (distance 0xFFFF) or above 2000 | distance 1200 at a good strength: "actual distance > 12 m" |
//! | TFmini-S, TFmini Plus | strength up to 100 (distance -1), signal saturated (-2, strength 65535), ambient light (-4) | - |
//! | TF-Luna | strength below 100 (distance 0) or 65535 | - |
//!
//! A weak signal is no statement that nothing is there: a dark thing gives one, too.
//!
//! Sources: Benewake, product manuals SJ-PM-TFmini-T-01 A03 section 5.4, SJ-PM-TFmini-S A00 section 5.4 and table 8,
//! SJ-PM-TF-Luna A05 sections 5.4, 6.8 and appendix I, data sheet SJ-GU-TFmini Plus-01 A04.

use super::{DeviceFrame, FrameContent, FrameMatch, RangeReading};

const START: u8 = 0x59;
const FRAME_BYTES: usize = 9;

/// How a model's distance and strength are to be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SignalLimits {
    /// Weakest signal that is reliable.
    pub strength_min: u16,
    /// Strongest signal that is reliable.
    pub strength_max: u16,
    /// Distance that means "farther than this" (cm).
    pub beyond_cm: Option<i16>,
}

/// What `bytes`, at least one, begin with.
pub(super) fn judge(bytes: &[u8], rules: &SignalLimits) -> FrameMatch {
    if bytes.iter().take(2).any(|byte| *byte != START) {
        return FrameMatch::Skip;
    }
    if bytes.len() < FRAME_BYTES {
        return FrameMatch::More;
    }
    let sum = bytes[..FRAME_BYTES - 1]
        .iter()
        .fold(0u8, |sum, byte| sum.wrapping_add(*byte));
    if sum != bytes[FRAME_BYTES - 1] {
        return FrameMatch::Damaged;
    }
    let distance_cm = i16::from_le_bytes([bytes[2], bytes[3]]);
    let strength = u16::from_le_bytes([bytes[4], bytes[5]]);
    FrameMatch::Frame(DeviceFrame {
        bytes: FRAME_BYTES,
        item: FrameContent::Measured {
            yaw_rad: 0.0,
            answer: rules.answer(distance_cm, strength),
        },
    })
}

impl SignalLimits {
    fn answer(&self, distance_cm: i16, strength: u16) -> RangeReading {
        let reliable = (self.strength_min..=self.strength_max).contains(&strength);
        if !reliable || distance_cm < 0 {
            RangeReading::Unreliable
        } else if Some(distance_cm) == self.beyond_cm {
            RangeReading::Nothing
        } else {
            RangeReading::Distance(f32::from(distance_cm) * 0.01)
        }
    }
}
