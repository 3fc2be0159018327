//! The parameters the emulator has: ArduCopter's names, defaults and units.
//!
//! Everything else in ArduCopter's list of a thousand has no effect here and does not exist: as on the real one, setting an
//! unknown name is ignored without a word. Numbers travel as they are, cast to float, whatever their type.

use jink_emulated_autopilot::parameters::ParameterTable;
use mavlink::dialect::{MavParamType, PARAM_SET_DATA, PARAM_VALUE_DATA};

/// `param_index` of a value that was not asked for by its index.
const BY_NAME: u16 = u16::MAX;

/// How a parameter is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// INT8.
    Byte,
    /// INT16.
    Short,
    /// INT32.
    Integer,
    /// REAL32.
    Real,
}

impl Kind {
    /// Its type on the wire.
    fn wire(self) -> MavParamType {
        match self {
            Kind::Byte => MavParamType::MAV_PARAM_TYPE_INT8,
            Kind::Short => MavParamType::MAV_PARAM_TYPE_INT16,
            Kind::Integer => MavParamType::MAV_PARAM_TYPE_INT32,
            Kind::Real => MavParamType::MAV_PARAM_TYPE_REAL32,
        }
    }
}

jink_emulated_autopilot::parameters! {
    /// Largest lean angle (cdeg).
    ANGLE_MAX: Short = 3_000.0;
    /// Deceleration with which obstacles are avoided (m/s^2).
    AVOID_ACCEL_MAX: Real = 3.0;
    /// Fastest retreat from an obstacle within the margin (m/s).
    AVOID_BACKUP_SPD: Real = 0.75;
    /// Breach of the margin that is tolerated (m).
    AVOID_BACKUP_DZ: Real = 0.1;
    /// What is avoided: bit 1 = proximity.
    AVOID_ENABLE: Byte = 3.0;
    /// Distance kept to obstacles (m).
    AVOID_MARGIN: Real = 2.0;
    /// Time on the ground to automatic disarming (s).
    DISARM_DELAY: Byte = 10.0;
    /// What a lost ground station leads to: 0 = nothing, 1 = RTL.
    FS_GCS_ENABLE: Byte = 0.0;
    /// Silence that counts as its loss (s).
    FS_GCS_TIMEOUT: Real = 5.0;
    /// For how long a setpoint in GUIDED is extrapolated (s).
    GUID_TIMEOUT: Real = 3.0;
    /// Height below which a landing is slow (cm).
    LAND_ALT_LOW: Short = 1_000.0;
    /// Descent speed near the ground (cm/s).
    LAND_SPEED: Short = 50.0;
    /// Acceleration with which LOITER counts before obstacles (cm/s^2).
    LOIT_ACC_MAX: Real = 500.0;
    /// Lean angle of LOITER at full stick (deg); 0 = two thirds of ANGLE_MAX.
    LOIT_ANG_MAX: Real = 0.0;
    /// Braking of LOITER (cm/s^2).
    LOIT_BRK_ACCEL: Real = 250.0;
    /// From centred sticks to braking (s).
    LOIT_BRK_DELAY: Real = 1.0;
    /// Jerk of that braking (cm/s^3).
    LOIT_BRK_JERK: Real = 500.0;
    /// Speed of LOITER at full stick (cm/s).
    LOIT_SPEED: Real = 1_250.0;
    /// Options of the ground station's link: 2 = nothing is forwarded to and from it. Read at start only.
    MAV1_OPTIONS: Short = 0.0;
    /// Options of the companion's link: 2 = nothing is forwarded to and from it. Read at start only.
    MAV2_OPTIONS: Short = 0.0;
    /// System id of the ground station whose heartbeat counts.
    MAV_GCS_SYSID: Short = 255.0;
    /// Where AUTO begins: 0 = at the item it was left at, 1 = at the first.
    MIS_RESTART: Byte = 0.0;
    /// Vertical acceleration under sticks (cm/s^2).
    PILOT_ACCEL_Z: Short = 250.0;
    /// Descent at full stick (cm/s).
    PILOT_SPEED_DN: Short = 150.0;
    /// Climb at full stick (cm/s).
    PILOT_SPEED_UP: Short = 250.0;
    /// Proximity sensor: 0 = none, 2 = MAVLink. Read at start only.
    PRX1_TYPE: Byte = 0.0;
    /// Low-pass on proximity distances (Hz); 0 = none.
    PRX_FILT: Real = 0.25;
    /// Horizontal jerk of shaped targets (m/s^3).
    PSC_JERK_XY: Real = 5.0;
    /// Vertical jerk of shaped targets (m/s^3).
    PSC_JERK_Z: Real = 5.0;
    /// Horizontal position gain (1/s).
    PSC_POSXY_P: Real = 1.0;
    /// Vertical position gain (1/s).
    PSC_POSZ_P: Real = 1.0;
    /// Horizontal velocity derivative gain.
    PSC_VELXY_D: Real = 0.25;
    /// Horizontal velocity integral gain (1/s^2).
    PSC_VELXY_I: Real = 1.0;
    /// Horizontal velocity gain (1/s).
    PSC_VELXY_P: Real = 2.0;
    /// Vertical velocity gain (1/s).
    PSC_VELZ_P: Real = 5.0;
    /// Upper end of channel 1 (us). The simulated sticks do not look at this, the others of their channels, or RCMAP_*.
    RC1_MAX: Short = 2_000.0;
    /// Lower end (us).
    RC1_MIN: Short = 1_000.0;
    /// It counts the other way round.
    RC1_REVERSED: Byte = 0.0;
    /// Centre (us).
    RC1_TRIM: Short = 1_500.0;
    /// Upper end of channel 2 (us). The simulated sticks do not look at this, the others of their channels, or RCMAP_*.
    RC2_MAX: Short = 2_000.0;
    /// Lower end (us).
    RC2_MIN: Short = 1_000.0;
    /// It counts the other way round.
    RC2_REVERSED: Byte = 0.0;
    /// Centre (us).
    RC2_TRIM: Short = 1_500.0;
    /// Upper end of channel 3 (us). The simulated sticks do not look at this, the others of their channels, or RCMAP_*.
    RC3_MAX: Short = 2_000.0;
    /// Lower end (us).
    RC3_MIN: Short = 1_000.0;
    /// It counts the other way round.
    RC3_REVERSED: Byte = 0.0;
    /// Centre (us).
    RC3_TRIM: Short = 1_500.0;
    /// Upper end of channel 4 (us). The simulated sticks do not look at this, the others of their channels, or RCMAP_*.
    RC4_MAX: Short = 2_000.0;
    /// Lower end (us).
    RC4_MIN: Short = 1_000.0;
    /// It counts the other way round.
    RC4_REVERSED: Byte = 0.0;
    /// Centre (us).
    RC4_TRIM: Short = 1_500.0;
    /// Channel of the pitch stick.
    RCMAP_PITCH: Byte = 2.0;
    /// Channel of the roll stick.
    RCMAP_ROLL: Byte = 1.0;
    /// Channel of the throttle stick.
    RCMAP_THROTTLE: Byte = 3.0;
    /// Channel of the yaw stick.
    RCMAP_YAW: Byte = 4.0;
    /// Height of a return (cm).
    RTL_ALT: Integer = 1_500.0;
    /// Slope of the cone about home within which a return climbs less; 0 = none.
    RTL_CONE_SLOPE: Real = 3.0;
    /// Time above home before the descent (ms).
    RTL_LOIT_TIME: Integer = 5_000.0;
    /// Horizontal acceleration of corrections and legs (cm/s^2).
    WPNAV_ACCEL: Real = 250.0;
    /// Vertical acceleration (cm/s^2).
    WPNAV_ACCEL_Z: Real = 100.0;
    /// Distance at which a waypoint counts as reached (cm).
    WPNAV_RADIUS: Real = 200.0;
    /// Horizontal speed (cm/s).
    WPNAV_SPEED: Real = 1_000.0;
    /// Descent speed (cm/s).
    WPNAV_SPEED_DN: Real = 150.0;
    /// Climb speed (cm/s).
    WPNAV_SPEED_UP: Real = 250.0;
    /// Heading of automatic flight: 0 = as it is, 2 = along the track.
    WP_YAW_BEHAVIOR: Byte = 2.0;
}

/// The values in force.
#[derive(Clone, Debug)]
pub struct Parameters {
    values: Vec<f64>,
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            values: Parameter::ALL.iter().map(|p| p.default()).collect(),
        }
    }
}

impl Parameters {
    /// The value of `parameter`, in its unit.
    pub fn get(&self, parameter: Parameter) -> f64 {
        self.values[parameter as usize]
    }

    /// The value of `parameter`, centimetres turned into metres (or hundredths of a degree into degrees).
    pub fn hundredth(&self, parameter: Parameter) -> f64 {
        self.get(parameter) * 0.01
    }

    /// Sets `parameter` as its kind stores it: whole numbers are rounded and held within their range.
    pub fn set(&mut self, parameter: Parameter, value: f64) {
        let whole = |lowest: f64, highest: f64| value.round().clamp(lowest, highest);
        self.values[parameter as usize] = match parameter.kind() {
            Kind::Byte => whole(f64::from(i8::MIN), f64::from(i8::MAX)),
            Kind::Short => whole(f64::from(i16::MIN), f64::from(i16::MAX)),
            Kind::Integer => whole(f64::from(i32::MIN), f64::from(i32::MAX)),
            Kind::Real => f64::from(value as f32),
        };
    }
}

/// The parameter called `name`.
pub fn find(name: &str) -> Option<Parameter> {
    Parameter::ALL.iter().copied().find(|p| p.name() == name)
}

impl ParameterTable for Parameters {
    fn count(&self) -> usize {
        Parameter::ALL.len()
    }

    fn at(&self, index: usize) -> Option<PARAM_VALUE_DATA> {
        let parameter = *Parameter::ALL.get(index)?;
        Some(PARAM_VALUE_DATA {
            param_value: self.get(parameter) as f32,
            param_count: Parameter::ALL.len() as u16,
            param_index: index as u16,
            param_id: parameter.name().into(),
            param_type: parameter.kind().wire(),
        })
    }

    fn named(&self, name: &str) -> Option<PARAM_VALUE_DATA> {
        let value = self.at(find(name)? as usize)?;
        Some(PARAM_VALUE_DATA {
            param_index: BY_NAME,
            ..value
        })
    }

    fn take(&mut self, name: &str, set: &PARAM_SET_DATA) -> Result<(), &'static str> {
        if let Some(parameter) = find(name).filter(|_| set.param_value.is_finite()) {
            self.set(parameter, f64::from(set.param_value));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_fit_mavlink_and_are_found() {
        for parameter in Parameter::ALL.iter().copied() {
            assert!(parameter.name().len() <= 16);
            assert_eq!(find(parameter.name()), Some(parameter));
        }
        assert_eq!(find("ATC_ANGLE_MAX"), None);
    }

    #[test]
    fn whole_numbers_stay_in_their_range() {
        let mut parameters = Parameters::default();
        parameters.set(Parameter::AVOID_ENABLE, 300.4);
        assert_eq!(parameters.get(Parameter::AVOID_ENABLE), 127.0);
        parameters.set(Parameter::GUID_TIMEOUT, 0.5);
        assert_eq!(parameters.get(Parameter::GUID_TIMEOUT), 0.5);
    }
}
