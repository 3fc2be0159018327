//! The text of LightWare's SF11/C and LW20/C (SF20/C): on the request `d` the distance in metres with two decimals,
//! then carriage return and line feed, e.g. `98.67`. Both manuals list it as the legacy command of the serial port, and
//! both autopilots have used it for years. The LW20's own command set (`?LD`, `ld,0:98.67`) is not used.
//!
//! A lost signal is shown as a distance out of range (130.00 on the SF11/C, 160, 230 and 250 in other firmware) or as a
//! negative number.
//!
//! There is no checksum. A line counts only whole and in this form, between two line feeds; the rest is up to
//! [`crate::beam_filter`], which accepts no value that came only once.
//!
//! Sources: LightWare, "SF11 product manual" (menu item n, appendix E), "LW20/SF20 product manual" (appendix C); PX4,
//! `lightware_laser_serial`; ArduPilot, `AP_RangeFinder_LightWareSerial`, for the numbers that mean a lost signal.

use super::{DeviceFrame, FrameContent, FrameCounts, RangeReading};

/// `-123.45` and the carriage return.
const LINE_BYTES: usize = 8;
/// Distances that mean a lost signal (cm).
const LOST_CM: [i32; 4] = [13_000, 16_000, 23_000, 25_000];

/// The line that is being read.
#[derive(Clone, Debug, Default)]
pub(super) struct TextLine {
    bytes: [u8; LINE_BYTES],
    /// Bytes of the line so far, those beyond its longest form included.
    len: usize,
    /// Its beginning was seen.
    whole: bool,
}

impl TextLine {
    /// Takes one byte, and reads the line that it ends.
    pub fn push(&mut self, byte: u8, counts: &mut FrameCounts, found: &mut impl FnMut(DeviceFrame)) {
        if byte != b'\n' {
            if let Some(place) = self.bytes.get_mut(self.len) {
                *place = byte;
            }
            self.len = self.len.saturating_add(1);
            return;
        }
        let text = self.bytes.get(..self.len).filter(|_| self.whole);
        match text.and_then(distance_cm) {
            Some(distance_cm) => {
                counts.good += 1;
                found(DeviceFrame {
                    bytes: self.len + 1,
                    item: FrameContent::Measured {
                        yaw_rad: 0.0,
                        answer: answer(distance_cm),
                    },
                });
            }
            None => {
                counts.damaged += u64::from(self.whole);
                counts.skipped_bytes += self.len as u64 + 1;
            }
        }
        *self = Self {
            whole: true,
            ..Self::default()
        };
    }
}

fn answer(distance_cm: i32) -> RangeReading {
    if distance_cm < 0 || LOST_CM.contains(&distance_cm) {
        RangeReading::Nothing
    } else {
        RangeReading::Distance(distance_cm as f32 * 0.01)
    }
}

/// A line without its line feed as centimetres, if it has the one form that counts.
fn distance_cm(line: &[u8]) -> Option<i32> {
    let number = line.strip_suffix(b"\r")?;
    let (sign, digits) = match number.strip_prefix(b"-") {
        Some(digits) => (-1, digits),
        None => (1, number),
    };
    let (metres, hundredths) = digits.split_last_chunk::<3>()?;
    let [b'.', tens, ones] = hundredths else {
        return None;
    };
    if !(1..=3).contains(&metres.len()) {
        return None;
    }
    let mut cm = 0;
    for digit in metres.iter().chain([tens, ones]) {
        if !digit.is_ascii_digit() {
            return None;
        }
        cm = cm * 10 + i32::from(digit - b'0');
    }
    Some(sign * cm)
}
