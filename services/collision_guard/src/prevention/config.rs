//! The parameters, under PX4's names.

use jink_shared_types::params::{self, ParamSet};

/// Parameters of collision prevention, as in PX4.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PreventionConfig {
    /// `CP_DIST`: distance kept from all obstacles (m); zero and below switch it off.
    pub distance_m: f64,
    /// `CP_DELAY`: time for which the vehicle goes on as it was before a setpoint takes effect (s).
    pub delay_s: f64,
    /// `CP_GUIDE_ANG`: how far to either side a better direction is looked for (rad).
    pub guide_rad: f64,
    /// `CP_GO_NO_DATA`: motion into sectors that were never seen is allowed.
    pub goes_unseen: bool,
    /// `MPC_XY_P`: gain of the position controller (1/s).
    pub position_gain_per_s: f64,
    /// `MPC_VEL_MANUAL`: speed of a full stick (m/s).
    pub manual_mps: f64,
    /// `MPC_JERK_MAX` (m/s3).
    pub jerk_mps3: f64,
    /// `MPC_ACC_HOR` (m/s2).
    pub acceleration_mps2: f64,
    /// `MPC_XY_VEL_P_ACC`: acceleration for each m/s of velocity error (1/s).
    pub velocity_gain_per_s: f64,
}

impl PreventionConfig {
    /// The values in force.
    pub fn from_params(params: &ParamSet) -> Self {
        Self {
            distance_m: params.get(&params::CP_DIST),
            delay_s: params.get(&params::CP_DELAY),
            guide_rad: params.get(&params::CP_GUIDE_ANG).to_radians(),
            goes_unseen: params.get(&params::CP_GO_NO_DATA) != 0.0,
            position_gain_per_s: params.get(&params::MPC_XY_P),
            manual_mps: params.get(&params::MPC_VEL_MANUAL),
            jerk_mps3: params.get(&params::MPC_JERK_MAX),
            acceleration_mps2: params.get(&params::MPC_ACC_HOR),
            velocity_gain_per_s: params.get(&params::MPC_XY_VEL_P_ACC),
        }
    }

    /// Whether it acts at all.
    pub fn is_active(&self) -> bool {
        self.distance_m > 0.0
    }
}
