//! LightWare's binary protocol as the SF45/B uses it.
//!
//! | byte | holds |
//! |---|---|
//! | 0 | 0xAA |
//! | 1, 2 | little endian: bits 6 to 15 the length of the payload (number of the command included), bit 0 set in a write |
//! | 3 | number of the command: the first byte of the payload |
//! | 4 .. | data, little endian |
//! | last two | CRC-16/XMODEM of everything before, low byte first |
//!
//! Command 44, "distance data in cm", holds one `int16` for each bit that is set in command 27 ("distance output"), in
//! the order of the bits. The driver asks for bit 0 (first return, unfiltered, cm) and bit 8 (yaw, hundredths of a
//! degree). The yaw is positive clockwise seen from above while the device stands upright. A distance below zero is a
//! lost signal: no light came back.
//!
//! Sources: LightWare, "SF000 product guide", commands 27, 30, 44, and the ROS driver `lightwarelidar` (commands of the
//! SF45/B); PX4, `lightware_sf45_serial`, and ArduPilot, `AP_Proximity_LightWareSF45B`, for the sign of the yaw and the
//! meaning of a lost signal.

use super::{DeviceFrame, FrameContent, FrameMatch, RangeReading};
use crate::crc::xmodem;

const START: u8 = 0xAA;
const HEAD_BYTES: usize = 3;
const CRC_BYTES: usize = 2;
const DISTANCE_DATA_CM: u8 = 44;
/// Number, distance, yaw.
const DISTANCE_PAYLOAD: usize = 5;
/// Longest answer to a command of [`crate::device_protocol`]: its number and four bytes. Nothing longer is waited for,
/// so that a false start ends within ten bytes, and a text of the device is skipped byte by byte.
const PAYLOAD_MAX: usize = 5;

/// What `bytes`, at least one, begin with.
pub(super) fn judge(bytes: &[u8]) -> FrameMatch {
    if bytes[0] != START {
        return FrameMatch::Skip;
    }
    let &[_, low, high, ..] = bytes else {
        return FrameMatch::More;
    };
    let payload = usize::from(u16::from_le_bytes([low, high]) >> 6);
    if !(1..=PAYLOAD_MAX).contains(&payload) {
        return FrameMatch::Skip;
    }
    let len = HEAD_BYTES + payload + CRC_BYTES;
    if bytes.len() < len {
        return FrameMatch::More;
    }
    let (covered, crc) = bytes[..len].split_at(len - CRC_BYTES);
    if xmodem(covered).to_le_bytes() != crc {
        return FrameMatch::Damaged;
    }
    match covered[HEAD_BYTES..] {
        [DISTANCE_DATA_CM, d0, d1, y0, y1] => FrameMatch::Frame(DeviceFrame {
            bytes: len,
            item: measured(i16::from_le_bytes([d0, d1]), i16::from_le_bytes([y0, y1])),
        }),
        // Distances in another composition: the set-up has not been taken yet.
        [DISTANCE_DATA_CM, ..] => FrameMatch::Skip,
        [command, ..] => FrameMatch::Frame(DeviceFrame {
            bytes: len,
            item: FrameContent::Acknowledged(command),
        }),
        [] => FrameMatch::Skip,
    }
}

fn measured(distance_cm: i16, yaw_cdeg: i16) -> FrameContent {
    let answer = if distance_cm < 0 {
        RangeReading::Nothing
    } else {
        RangeReading::Distance(f32::from(distance_cm) * 0.01)
    };
    FrameContent::Measured {
        yaw_rad: (f32::from(yaw_cdeg) * 0.01).to_radians(),
        answer,
    }
}

/// Shortest time (s) that a measurement takes on a line of `baud` bit/s.
pub fn frame_s(baud: u32) -> f64 {
    let bits = 10 * (HEAD_BYTES + DISTANCE_PAYLOAD + CRC_BYTES);
    bits as f64 / f64::from(baud)
}
