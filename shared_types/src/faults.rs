//! What is wrong with a range sensor, as the map's process has found out in flight.

crate::wire_enum! {
    /// A fault of a range sensor.
    pub enum SensorFault {
        /// None is known.
        Unknown = 0 "unknown",
        /// It repeats the same data, or its time stands still.
        Stuck = 1 "stuck",
        /// Its ranges are right when they are multiplied by a factor.
        WrongScale = 2 "wrong scale",
        /// Left and right are exchanged.
        Mirrored = 3 "mirrored",
        /// Under motion, what stands still does not agree with itself: it is mounted otherwise than configured.
        WrongMounting = 4 "wrong mounting",
        /// More or fewer frames than its table says.
        WrongRate = 5 "wrong rate",
    }
}

impl SensorFault {
    /// Every fault, the gravest first.
    pub const ALL: [SensorFault; 5] = [
        SensorFault::Stuck,
        SensorFault::WrongScale,
        SensorFault::Mirrored,
        SensorFault::WrongMounting,
        SensorFault::WrongRate,
    ];
}

/// Bits of one sensor in [`FaultBits`].
const BITS: usize = 3;

/// The gravest fault of each of [`SENSORS`](crate::ranges::SENSORS) sensors, three bits each, in the order of the configuration, the
/// first in the lowest bits. All zero: no fault is known.
pub type FaultBits = [u8; 6];

/// `bits` with `fault` for `sensor`; one beyond the last is left out.
pub fn with_fault(bits: FaultBits, sensor: usize, fault: SensorFault) -> FaultBits {
    let mut bytes = [0; 8];
    bytes[..bits.len()].copy_from_slice(&bits);
    let shift = BITS * sensor;
    if shift + BITS > 8 * bits.len() {
        return bits;
    }
    let cleared = u64::from_le_bytes(bytes) & !(7 << shift);
    let whole = (cleared | u64::from(crate::coded::Wire::code(fault)) << shift).to_le_bytes();
    [0, 1, 2, 3, 4, 5].map(|byte: usize| whole[byte])
}

/// The fault of `sensor`, if there is one that this build knows.
pub fn fault_of(bits: FaultBits, sensor: usize) -> Option<SensorFault> {
    let mut bytes = [0; 8];
    bytes[..bits.len()].copy_from_slice(&bits);
    let shift = BITS * sensor;
    if shift + BITS > 8 * bits.len() {
        return None;
    }
    let code = (u64::from_le_bytes(bytes) >> shift & 7) as u8;
    let fault = <SensorFault as crate::coded::Wire>::from_code(code)?;
    (fault != SensorFault::Unknown).then_some(fault)
}

#[cfg(test)]
mod tests {
    use super::{SensorFault, fault_of, with_fault};
    use crate::ranges::SENSORS;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_sensor_keeps_its_own_fault(faults in proptest::collection::vec(0..6usize, SENSORS)) {
            let fault = |number: usize| number.checked_sub(1).map(|index| SensorFault::ALL[index]);
            let mut bits = [0; 6];
            for (sensor, number) in faults.iter().enumerate() {
                bits = with_fault(bits, sensor, fault(*number).unwrap_or(SensorFault::Unknown));
            }
            for (sensor, number) in faults.iter().enumerate() {
                prop_assert_eq!(fault_of(bits, sensor), fault(*number));
            }
            prop_assert_eq!(with_fault(bits, SENSORS, SensorFault::Stuck), bits);
            prop_assert_eq!(fault_of(bits, SENSORS), None);
        }
    }
}
