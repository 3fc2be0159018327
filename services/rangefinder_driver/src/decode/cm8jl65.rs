//! Lanbao PSK-CM8JL65-CC5.
//!
//! | byte | holds |
//! |---|---|
//! | 0, 1 | 0xA5, 0x5A |
//! | 2, 3 | distance (mm), high byte first |
//! | 4, 5 | CRC-16/MODBUS of bytes 0 to 3, low byte first |
//!
//! The device has no value for "nothing in range": towards the sky it reports 7 to 8 m, as ArduPilot's driver notes. So
//! what is beyond the range given in [`crate::devices`] is unknown.
//!
//! Sources: PX4, `cm8jl65`, and ArduPilot, `AP_RangeFinder_Lanbao`.

use super::{DeviceFrame, FrameContent, FrameMatch, RangeReading};
use crate::crc::modbus;

const START: [u8; 2] = [0xA5, 0x5A];

/// What `bytes`, at least one, begin with.
pub(super) fn judge(bytes: &[u8]) -> FrameMatch {
    let known = bytes.len().min(START.len());
    if bytes[..known] != START[..known] {
        return FrameMatch::Skip;
    }
    let &[s0, s1, high, low, c0, c1, ..] = bytes else {
        return FrameMatch::More;
    };
    if modbus(&[s0, s1, high, low]) != u16::from_le_bytes([c0, c1]) {
        return FrameMatch::Damaged;
    }
    FrameMatch::Frame(DeviceFrame {
        bytes: 6,
        item: FrameContent::Measured {
            yaw_rad: 0.0,
            answer: RangeReading::Distance(f32::from(u16::from_be_bytes([high, low])) * 0.001),
        },
    })
}
