//! What a gateway that is started again has to know of a pilot who is assisted: part of the
//! [record](crate::executive::record::Record) of the flight.

use super::sticks::{RcAxis, RcCalibration};

/// Bytes of it.
pub const BYTES: usize = 1 + 4 + 1 + 4 * AXIS;
/// Bytes of one stick: channel, its ends and centre, whether it is reversed.
const AXIS: usize = 8;

/// The record of an assisted flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AssistRecord {
    /// The mode that the pilot is given back, by the autopilot's own number.
    pub pilots_mode: u32,
    /// What the autopilot's channels mean, where that had to be read: reading it again takes longer than a pilot's
    /// sticks may be missing.
    pub calibration: Option<RcCalibration>,
}

/// As bytes; `None`: nobody is assisted.
pub fn to_bytes(record: Option<&AssistRecord>) -> [u8; BYTES] {
    let mut bytes = [0; BYTES];
    let Some(record) = record else { return bytes };
    bytes[0] = 1;
    bytes[1..5].copy_from_slice(&record.pilots_mode.to_le_bytes());
    if let Some(calibration) = &record.calibration {
        bytes[5] = 1;
        for (to, axis) in bytes[6..].chunks_exact_mut(AXIS).zip(&calibration.axes) {
            to[0] = axis.channel as u8;
            // Whole microseconds, as the autopilot has them.
            for (to, us) in to[1..7]
                .chunks_exact_mut(2)
                .zip([axis.min_us, axis.trim_us, axis.max_us])
            {
                to.copy_from_slice(&(us as u16).to_le_bytes());
            }
            to[7] = u8::from(axis.is_reversed);
        }
    }
    bytes
}

/// From those bytes.
pub fn of_bytes(bytes: &[u8; BYTES]) -> Option<AssistRecord> {
    if bytes[0] == 0 {
        return None;
    }
    let axis = |stick: usize| {
        let from = &bytes[6 + AXIS * stick..][..AXIS];
        let us = |at: usize| f64::from(u16::from_le_bytes([from[at], from[at + 1]]));
        RcAxis {
            channel: usize::from(from[0]),
            min_us: us(1),
            trim_us: us(3),
            max_us: us(5),
            is_reversed: from[7] != 0,
        }
    };
    Some(AssistRecord {
        pilots_mode: u32::from_le_bytes([bytes[1], bytes[2], bytes[3], bytes[4]]),
        calibration: (bytes[5] != 0).then(|| RcCalibration {
            axes: std::array::from_fn(axis),
        }),
    })
}

#[cfg(test)]
mod tests {
    use super::{AssistRecord, of_bytes, to_bytes};
    use crate::assist::sticks::{RcAxis, RcCalibration};

    #[test]
    fn a_record_survives_its_bytes() {
        let axis = |channel| RcAxis {
            channel,
            min_us: 1094.0,
            trim_us: 1501.0,
            max_us: 1932.0,
            is_reversed: channel == 2,
        };
        let with_channels = AssistRecord {
            pilots_mode: 3 << 16,
            calibration: Some(RcCalibration {
                axes: [1, 2, 3, 16].map(axis),
            }),
        };
        let without = AssistRecord {
            calibration: None,
            ..with_channels
        };
        for record in [None, Some(without), Some(with_channels)] {
            assert_eq!(of_bytes(&to_bytes(record.as_ref())), record);
        }
    }
}
