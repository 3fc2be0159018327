//! Numbers in the one float field of the parameter protocol.
//!
//! | encoding | an integer 5 travels as | ground stations expect it of |
//! |---|---|---|
//! | byte-wise | the float whose bits are those of the integer | systems with a PX4 |
//! | C cast | 5.0 | systems with an ArduPilot |
//!
//! Ground stations choose by the *autopilot* of the system, not by what a component announces: QGroundControl and
//! MAVSDK by the vehicle's firmware; MAVProxy means to, but knows the type only where component 1 is addressed, and
//! takes all others for C casts. A companion with one fixed encoding would be misread beside the other autopilot, so
//! ours follows the autopilot it flies with, and announces what it does in AUTOPILOT_VERSION. Floats travel the same in
//! both.
//!
//! Source: MAVLink developer guide, "Parameter Protocol", section "Parameter Encoding".

use jink_shared_types::Flag;
use jink_shared_types::params::ParamType;
use mavlink::dialect::{MavAutopilot, MavParamType, MavProtocolCapability};

/// How integers travel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Encoding {
    /// Their bytes.
    #[default]
    Bytewise,
    /// Their value.
    CCast,
}

/// A type that has no room in the field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooWide;

impl Encoding {
    /// What is expected of a system with this autopilot.
    pub fn of(autopilot: MavAutopilot) -> Self {
        match autopilot {
            MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA => Self::CCast,
            _ => Self::Bytewise,
        }
    }

    /// As samples say it.
    pub fn of_flag(c_cast: Flag) -> Self {
        match c_cast.is_set() {
            true => Self::CCast,
            false => Self::Bytewise,
        }
    }

    /// As samples say it.
    pub fn flag(self) -> Flag {
        Flag::from(self == Self::CCast)
    }

    /// The flag that announces it.
    pub fn capability(self) -> MavProtocolCapability {
        match self {
            Self::Bytewise => MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE,
            Self::CCast => MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST,
        }
    }

    /// The field for `value` of a row of type `kind`.
    pub fn put(self, kind: ParamType, value: f64) -> f32 {
        match (self, kind) {
            (Self::CCast, _) | (_, ParamType::Float) => value as f32,
            (Self::Bytewise, ParamType::Integer) => f32::from_bits(value as i32 as u32),
            (Self::Bytewise, ParamType::Boolean) => f32::from_bits(u32::from(value as u8)),
        }
    }

    /// The number in the field `raw` that was sent as `kind`. NaN stays NaN: no row takes it.
    ///
    /// # Errors
    /// [`TooWide`] for types of 64 bits.
    pub fn take(self, kind: MavParamType, raw: f32) -> Result<f64, TooWide> {
        use MavParamType::{
            MAV_PARAM_TYPE_INT8, MAV_PARAM_TYPE_INT16, MAV_PARAM_TYPE_INT32, MAV_PARAM_TYPE_INT64,
            MAV_PARAM_TYPE_REAL32, MAV_PARAM_TYPE_REAL64, MAV_PARAM_TYPE_UINT8, MAV_PARAM_TYPE_UINT16,
            MAV_PARAM_TYPE_UINT32, MAV_PARAM_TYPE_UINT64,
        };
        let bits = raw.to_bits();
        match kind {
            MAV_PARAM_TYPE_INT64 | MAV_PARAM_TYPE_UINT64 | MAV_PARAM_TYPE_REAL64 => Err(TooWide),
            MAV_PARAM_TYPE_REAL32 => Ok(as_written(raw)),
            _ if self == Self::CCast => Ok(as_written(raw)),
            MAV_PARAM_TYPE_UINT8 => Ok(f64::from(bits as u8)),
            MAV_PARAM_TYPE_INT8 => Ok(f64::from(bits as i8)),
            MAV_PARAM_TYPE_UINT16 => Ok(f64::from(bits as u16)),
            MAV_PARAM_TYPE_INT16 => Ok(f64::from(bits as i16)),
            MAV_PARAM_TYPE_UINT32 => Ok(f64::from(bits)),
            MAV_PARAM_TYPE_INT32 => Ok(f64::from(bits as i32)),
        }
    }
}

/// The type under which rows of type `kind` are listed.
pub fn wire_type(kind: ParamType) -> MavParamType {
    match kind {
        ParamType::Float => MavParamType::MAV_PARAM_TYPE_REAL32,
        ParamType::Integer => MavParamType::MAV_PARAM_TYPE_INT32,
        ParamType::Boolean => MavParamType::MAV_PARAM_TYPE_UINT8,
    }
}

/// The number that a person has typed to get this float: 0.3, not 0.30000001192092896, which a row up to 0.3 would
/// refuse.
fn as_written(raw: f32) -> f64 {
    raw.to_string().parse().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::{Encoding, TooWide, wire_type};
    use jink_shared_types::params::ParamType;
    use mavlink::dialect::{MavAutopilot, MavParamType};
    use proptest::prelude::*;

    #[test]
    fn each_autopilots_ground_stations_read_what_is_meant() {
        let px4 = Encoding::of(MavAutopilot::MAV_AUTOPILOT_PX4);
        let ardupilot = Encoding::of(MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA);
        assert_eq!(px4.put(ParamType::Integer, 5.0).to_bits(), 5);
        assert_eq!(px4.put(ParamType::Integer, -2.0).to_bits(), u32::MAX - 1);
        assert_eq!(px4.put(ParamType::Boolean, 1.0).to_bits(), 1);
        assert_eq!(ardupilot.put(ParamType::Integer, -2.0), -2.0);
        for encoding in [px4, ardupilot] {
            assert_eq!(encoding.put(ParamType::Float, 0.3), 0.3);
            assert_eq!(
                encoding.take(MavParamType::MAV_PARAM_TYPE_REAL64, 1.0),
                Err(TooWide)
            );
        }
    }

    proptest! {
        #[test]
        fn what_is_put_is_taken(whole in any::<i32>(), float in -1e6..1e6f32, is_set in any::<bool>()) {
            for (encoding, whole) in [(Encoding::Bytewise, whole), (Encoding::CCast, whole % (1 << 24))] {
                for (kind, value) in [
                    (ParamType::Integer, f64::from(whole)),
                    (ParamType::Boolean, f64::from(u8::from(is_set))),
                ] {
                    prop_assert_eq!(encoding.take(wire_type(kind), encoding.put(kind, value)), Ok(value));
                }
                let back = encoding.take(MavParamType::MAV_PARAM_TYPE_REAL32, encoding.put(ParamType::Float, f64::from(float)));
                prop_assert_eq!(back.map(|back| back as f32), Ok(float));
            }
        }

        #[test]
        fn a_decimal_number_arrives_as_it_was_typed(thousandths in -100_000..100_000i32) {
            let typed = f64::from(thousandths) / 1e3;
            let taken = Encoding::CCast.take(MavParamType::MAV_PARAM_TYPE_REAL32, typed as f32);
            prop_assert_eq!(taken, Ok(typed));
        }
    }
}
