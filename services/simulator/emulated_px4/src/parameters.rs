//! The parameters the emulator has: PX4's names and the defaults of airframe iris in July 2021.
//!
//! A name of at most 16 characters, an integer or a real, and a value that MAVLink may change in flight. Everything
//! else in PX4's list of a thousand has no effect here and does not exist. A few exist in one firmware only.

use super::firmware::Firmware;
use jink_emulated_autopilot::parameters::ParameterTable;
use mavlink::dialect::{MavParamType, PARAM_SET_DATA, PARAM_VALUE_DATA};

/// How a parameter travels in PARAM_VALUE.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// MAV_PARAM_TYPE_INT32, its bits in the float field.
    Integer,
    /// MAV_PARAM_TYPE_REAL32.
    Real,
}

impl Kind {
    fn wire(self) -> MavParamType {
        match self {
            Kind::Integer => MavParamType::MAV_PARAM_TYPE_INT32,
            Kind::Real => MavParamType::MAV_PARAM_TYPE_REAL32,
        }
    }
}

jink_emulated_autopilot::parameters! {
    /// Time after landing to automatic disarming (s).
    COM_DISARM_LAND: Real = 2.0;
    /// Time after arming without take-off to automatic disarming (s).
    COM_DISARM_PRFLT: Real = 10.0;
    /// Time in Hold before a failsafe acts (s).
    COM_FAIL_ACT_T: Real = 5.0;
    /// What follows the loss of OFFBOARD setpoints: 0 Position, or a return without sticks; 3 return; 4 land; 5 hold.
    COM_OBL_RC_ACT: Integer = 0.0;
    /// Obstacle avoidance by a companion: 0 off, 1 on. PX4's default is 0; the emulator exists for 1.
    COM_OBS_AVOID: Integer = 1.0;
    /// Silence of the onboard controller that counts as its loss (s).
    COM_OBC_LOSS_T: Real = 5.0;
    /// Silence of OFFBOARD setpoints that counts as their loss (s).
    COM_OF_LOSS_T: Real = 1.0;
    /// Time from arming until motors take thrust (s).
    COM_SPOOLUP_TIME: Real = 1.0;
    /// Delay of sensors and vehicle that collision prevention assumes (s).
    CP_DELAY: Real = 0.4;
    /// Collision prevention distance (m); negative = off.
    CP_DIST: Real = -1.0;
    /// Collision prevention lets the vehicle fly where it never had data: 0 no, 1 yes.
    CP_GO_NO_DATA: Integer = 0.0;
    /// Half angle within which collision prevention may turn a setpoint (deg).
    CP_GUIDE_ANG: Real = 30.0;
    /// Velocities and accelerations of a companion are taken in Position and Mission: 0 no, 1 yes.
    EAV_EN: Integer = 0.0;
    /// Silence after which the mode's own setpoint is flown again (s).
    EAV_TIMEOUT: Real = 0.5;
    /// Stick deflection that counts as none. With 0 half a stick comes as near to a wall within 16 s as was observed; with
    /// 0.1, the older firmwares' MPC_HOLD_DZ, it stays 2.6 m short of that.
    MAN_DEADZONE: Real = 0.0;
    /// Stick speed with which a pilot takes over, full deflections a second.
    MAN_OVERRIDE_SPD: Real = 1.0;
    /// A ground station's heartbeats are passed on to the companion: 0 no, 1 yes. PX4's default is 1, where anything is passed on:
    /// in simulation it is, on a board the companion's port takes no part in it (MAV_1_FORWARD is 0).
    MAV_HB_FORW_EN: Integer = 0.0;
    /// The vehicle's MAVLink system id; to be read only: the emulator's own is set when it is made.
    MAV_SYS_ID: Integer = 1.0;
    /// Take-off height of AUTO.TAKEOFF (m).
    MIS_TAKEOFF_ALT: Real = 2.5;
    /// Heading error at which a waypoint's heading counts as reached (deg).
    MIS_YAW_ERR: Real = 12.0;
    /// Downward acceleration (m/s^2).
    MPC_ACC_DOWN_MAX: Real = 3.0;
    /// Horizontal acceleration of automatic modes (m/s^2).
    MPC_ACC_HOR: Real = 3.0;
    /// Horizontal acceleration of Position mode (m/s^2).
    MPC_ACC_HOR_MAX: Real = 5.0;
    /// Upward acceleration (m/s^2).
    MPC_ACC_UP_MAX: Real = 4.0;
    /// Jerk of automatic modes (m/s^3).
    MPC_JERK_AUTO: Real = 4.0;
    /// Jerk of Position mode (m/s^3).
    MPC_JERK_MAX: Real = 8.0;
    /// Height above which a landing descends at full speed (m).
    MPC_LAND_ALT1: Real = 10.0;
    /// Height below which a landing descends at MPC_LAND_SPEED (m).
    MPC_LAND_ALT2: Real = 5.0;
    /// Descent speed near the ground (m/s).
    MPC_LAND_SPEED: Real = 0.7;
    /// Heading rate under sticks (deg/s).
    MPC_MAN_Y_MAX: Real = 150.0;
    /// Largest thrust.
    MPC_THR_MAX: Real = 1.0;
    /// Smallest thrust in the air.
    MPC_THR_MIN: Real = 0.12;
    /// Thrust kept for horizontal control when vertical control saturates.
    MPC_THR_XY_MARG: Real = 0.3;
    /// Tilt limit in the air (deg).
    MPC_TILTMAX_AIR: Real = 45.0;
    /// Tilt limit before the vehicle flies (deg).
    MPC_TILTMAX_LND: Real = 12.0;
    /// Duration of the thrust ramp at take-off (s).
    MPC_TKO_RAMP_T: Real = 3.0;
    /// Climb speed at take-off (m/s).
    MPC_TKO_SPEED: Real = 1.5;
    /// Speed of Position mode at full stick (m/s).
    MPC_VEL_MANUAL: Real = 10.0;
    /// Cut-off of the velocity derivative (Hz).
    MPC_VELD_LP: Real = 5.0;
    /// Speed of automatic modes, and the position controller's limit in them (m/s).
    MPC_XY_CRUISE: Real = 5.0;
    /// Position error at which the trajectory waits for the vehicle (m).
    MPC_XY_ERR_MAX: Real = 2.0;
    /// Horizontal position gain (1/s).
    MPC_XY_P: Real = 0.95;
    /// Share of MPC_ACC_HOR used in the corner of a mission.
    MPC_XY_TRAJ_P: Real = 0.5;
    /// Horizontal velocity derivative gain.
    MPC_XY_VEL_D_ACC: Real = 0.2;
    /// Horizontal velocity integral gain (1/s^2).
    MPC_XY_VEL_I_ACC: Real = 0.4;
    /// Highest horizontal speed setpoint (m/s).
    MPC_XY_VEL_MAX: Real = 12.0;
    /// Horizontal velocity gain (1/s).
    MPC_XY_VEL_P_ACC: Real = 1.8;
    /// Heading rate of automatic modes (deg/s).
    MPC_YAWRAUTO_MAX: Real = 45.0;
    /// Vertical position gain (1/s).
    MPC_Z_P: Real = 1.0;
    /// Vertical velocity derivative gain.
    MPC_Z_VEL_D_ACC: Real = 0.0;
    /// Vertical velocity integral gain (1/s^2).
    MPC_Z_VEL_I_ACC: Real = 2.0;
    /// Descent speed (m/s).
    MPC_Z_VEL_MAX_DN: Real = 1.0;
    /// Climb speed (m/s).
    MPC_Z_VEL_MAX_UP: Real = 3.0;
    /// Vertical velocity gain (1/s).
    MPC_Z_VEL_P_ACC: Real = 4.0;
    /// Acceptance radius of waypoints without their own (m) (2 on multicopters).
    NAV_ACC_RAD: Real = 2.0;
    /// Vertical acceptance radius (m).
    NAV_MC_ALT_RAD: Real = 0.8;
    /// Half angle of the cone within which a return climbs less (deg).
    RTL_CONE_ANG: Integer = 45.0;
    /// Height to which a return descends before landing (m).
    RTL_DESCEND_ALT: Real = 10.0;
    /// Distance below which the cone applies (m).
    RTL_MIN_DIST: Real = 10.0;
    /// Height of a return (m).
    RTL_RETURN_ALT: Real = 30.0;
}

impl Parameter {
    /// Whether `firmware` has it.
    pub const fn exists_in(self, firmware: Firmware) -> bool {
        let current = matches!(firmware, Firmware::Current);
        match self {
            Parameter::COM_OBS_AVOID | Parameter::COM_OBC_LOSS_T => !current,
            Parameter::COM_FAIL_ACT_T | Parameter::COM_OBL_RC_ACT => current,
            Parameter::MAN_DEADZONE | Parameter::MAN_OVERRIDE_SPD => current,
            Parameter::EAV_EN | Parameter::EAV_TIMEOUT => current,
            _ => true,
        }
    }
}

/// The values in force.
#[derive(Clone, Debug)]
pub struct Parameters {
    values: Vec<f64>,
    /// Those that exist, in the order of their MAVLink index.
    listed: Vec<Parameter>,
}

impl Default for Parameters {
    fn default() -> Self {
        Self::new(Firmware::default())
    }
}

impl Parameters {
    /// The defaults of `firmware`; what it does not have is 0, which switches it off.
    pub fn new(firmware: Firmware) -> Self {
        let exists = |p: &Parameter| p.exists_in(firmware);
        let value = |p: &Parameter| if exists(p) { p.default() } else { 0.0 };
        Self {
            values: Parameter::ALL.iter().map(value).collect(),
            listed: Parameter::ALL.iter().copied().filter(exists).collect(),
        }
    }

    /// The parameter called `name`.
    pub fn find(&self, name: &str) -> Option<Parameter> {
        self.listed.iter().copied().find(|p| p.name() == name)
    }

    /// The value of `parameter`, in its unit.
    pub fn get(&self, parameter: Parameter) -> f64 {
        self.values[parameter as usize]
    }

    /// The value of `parameter`, degrees turned into radians.
    pub fn radians(&self, parameter: Parameter) -> f64 {
        self.get(parameter).to_radians()
    }

    /// Sets `parameter`; integers are rounded, reals take the precision of the wire.
    pub fn set(&mut self, parameter: Parameter, value: f64) {
        self.values[parameter as usize] = match parameter.kind() {
            Kind::Integer => value.round(),
            Kind::Real => f64::from(value as f32),
        };
    }

    /// Whether the companion's setpoints are wanted.
    pub fn avoidance_enabled(&self) -> bool {
        self.get(Parameter::COM_OBS_AVOID) != 0.0
    }
}

/// The value of `parameter` as the float field of PARAM_VALUE carries it: PX4 puts an integer's bits there.
fn to_wire(parameter: Parameter, value: f64) -> f32 {
    match parameter.kind() {
        Kind::Integer => f32::from_bits((value as i32).cast_unsigned()),
        Kind::Real => value as f32,
    }
}

/// The value in the float field of PARAM_SET for a parameter of this kind.
fn from_wire(kind: Kind, field: f32) -> f64 {
    match kind {
        Kind::Integer => f64::from(field.to_bits().cast_signed()),
        Kind::Real => f64::from(field),
    }
}

impl ParameterTable for Parameters {
    fn count(&self) -> usize {
        self.listed.len()
    }

    fn at(&self, index: usize) -> Option<PARAM_VALUE_DATA> {
        let parameter = *self.listed.get(index)?;
        Some(PARAM_VALUE_DATA {
            param_value: to_wire(parameter, self.get(parameter)),
            param_count: self.listed.len() as u16,
            param_index: index as u16,
            param_id: parameter.name().into(),
            param_type: parameter.kind().wire(),
        })
    }

    fn named(&self, name: &str) -> Option<PARAM_VALUE_DATA> {
        self.at(self.listed.iter().position(|p| p.name() == name)?)
    }

    fn take(&mut self, name: &str, set: &PARAM_SET_DATA) -> Result<(), &'static str> {
        let parameter = self.find(name).filter(|p| p.kind().wire() == set.param_type);
        let parameter = parameter.ok_or("param types mismatch, not set")?;
        let value = from_wire(parameter.kind(), set.param_value);
        if value.is_finite() {
            self.set(parameter, value);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_fit_mavlink_and_values_survive_the_wire() {
        for firmware in [Firmware::default(), Firmware::Current] {
            let parameters = Parameters::new(firmware);
            for parameter in parameters.listed.iter().copied() {
                assert!(parameter.name().len() <= 16);
                assert_eq!(parameters.find(parameter.name()), Some(parameter));
                let value = parameters.get(parameter);
                let back = from_wire(parameter.kind(), to_wire(parameter, value));
                assert!((back - value).abs() < 1e-6, "{}", parameter.name());
            }
        }
    }

    #[test]
    fn what_a_firmware_does_not_have_is_off_and_cannot_be_found() {
        let parameters = Parameters::new(Firmware::Current);
        assert!(!parameters.avoidance_enabled());
        assert_eq!(parameters.find("COM_OBS_AVOID"), None);
        assert_eq!(Parameters::default().find("COM_OBL_RC_ACT"), None);
    }
}
