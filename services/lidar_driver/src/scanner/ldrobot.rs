//! LDROBOT LD06, LD19, STL-27L: packets of twelve samples.
//!
//! Source: LDROBOT LD06, LD19 and STL-27L development manuals, "Data protocol".
//!
//! | bytes | hold |
//! |---|---|
//! | 0x54, 0x2C | head; type 1 and twelve samples |
//! | 2 | speed (deg/s) |
//! | 2 | angle of the first sample (0.01 deg) |
//! | 12 x 3 | range (mm), intensity |
//! | 2 | angle of the last sample (0.01 deg) |
//! | 2 | time (ms), up to 30000 |
//! | 1 | CRC-8, polynomial 0x4D |
//!
//! Angles count clockwise. A range of zero is no return. A damaged packet passes its eight bits once in 256 times; what
//! then still contradicts the speed is dropped, too.

use super::{Sample, SampleCounts, SlidingWindow};
use crate::decode::u16_at;
use crc::{Algorithm, Crc};
use jink_shared_types::Timestamp;

/// Length of a packet.
pub const PACKET_BYTES: usize = 47;
const HEAD: [u8; 2] = [0x54, 0x2C];
const SAMPLES: usize = 12;
const TURN_CDEG: u32 = 36_000;
/// Slowest and fastest turn that is accepted (deg/s): 1 to 20 Hz.
const SPEED_DPS: std::ops::RangeInclusive<u16> = 360..=7_200;
/// Most samples that a packet may stretch over (0.01 deg): an LD06 at 15 Hz makes 1.2 deg between two.
const SPAN_CDEG: u32 = 2_000;

static CRC8: Crc<u8> = Crc::<u8>::new(&LDROBOT);

/// Most significant bit first.
const LDROBOT: Algorithm<u8> = Algorithm {
    width: 8,
    poly: 0x4D,
    init: 0,
    refin: false,
    refout: false,
    xorout: 0,
    check: 0xC3,
    residue: 0,
};

/// Byte stream to samples.
#[derive(Clone, Debug)]
pub struct Ldrobot {
    window: SlidingWindow,
    tally: SampleCounts,
}

impl Default for Ldrobot {
    fn default() -> Self {
        Self {
            window: SlidingWindow::EMPTY,
            tally: SampleCounts::default(),
        }
    }
}

impl Ldrobot {
    /// The line was interrupted.
    pub fn interrupted(&mut self) {
        self.window = SlidingWindow::EMPTY;
    }

    /// What has become of the bytes.
    pub fn tally(&self) -> SampleCounts {
        self.tally
    }

    /// Takes a byte that ended at `end`, and hands over the samples of the packet that it completes.
    pub fn push(&mut self, end: Timestamp, byte: u8, sink: &mut dyn FnMut(Sample)) {
        self.window.push(byte);
        loop {
            let bytes = self.window.bytes();
            let begins = bytes.iter().zip(HEAD).all(|(byte, head)| *byte == head);
            if !begins {
                self.window.drop_first(1);
                self.tally.skipped_bytes += 1;
                continue;
            }
            if bytes.len() < PACKET_BYTES {
                return;
            }
            if CRC8.checksum(&bytes[..PACKET_BYTES - 1]) == bytes[PACKET_BYTES - 1]
                && samples(bytes, end, sink)
            {
                self.tally.good += 1;
                self.window.drop_first(PACKET_BYTES);
            } else {
                self.tally.damaged += 1;
                self.window.drop_first(1);
            }
        }
    }
}

/// Passes on the samples of a packet whose checksum agrees; `false` if its numbers cannot be.
fn samples(packet: &[u8], end: Timestamp, sink: &mut dyn FnMut(Sample)) -> bool {
    let speed_dps = u16_at(packet, 2);
    let (first, last) = (u32::from(u16_at(packet, 4)), u32::from(u16_at(packet, 42)));
    let span_cdeg = (last + TURN_CDEG - first % TURN_CDEG) % TURN_CDEG;
    if !SPEED_DPS.contains(&speed_dps) || first >= TURN_CDEG || last >= TURN_CDEG || span_cdeg > SPAN_CDEG {
        return false;
    }
    let step_deg = span_cdeg as f32 * 0.01 / (SAMPLES - 1) as f32;
    let step_s = f64::from(step_deg) / f64::from(speed_dps);
    for index in 0..SAMPLES {
        let behind = (SAMPLES - 1 - index) as f64;
        sink(Sample {
            time: end.plus_seconds(-behind * step_s),
            angle_deg: (first as f32 * 0.01 + index as f32 * step_deg) % 360.0,
            range_m: f32::from(u16_at(packet, 6 + 3 * index)) * 1e-3,
        });
    }
    true
}

#[cfg(test)]
mod tests {
    use super::CRC8;

    #[test]
    fn the_checksum_is_that_of_the_manual() {
        // The example packet of the LD06 manual.
        let packet = [
            0x54, 0x2C, 0x68, 0x08, 0xAB, 0x7E, 0xE0, 0x00, 0xE4, 0xDC, 0x00, 0xE2, 0xD9, 0x00, 0xE5, 0xD5,
            0x00, 0xE3, 0xD3, 0x00, 0xE4, 0xD0, 0x00, 0xE9, 0xCD, 0x00, 0xE4, 0xCA, 0x00, 0xE2, 0xC7, 0x00,
            0xE9, 0xC5, 0x00, 0xE5, 0xC2, 0x00, 0xE5, 0xC0, 0x00, 0xE5, 0xBE, 0x82, 0x3A, 0x1A, 0x50,
        ];
        assert_eq!(CRC8.checksum(&packet[..46]), packet[46]);
    }
}
