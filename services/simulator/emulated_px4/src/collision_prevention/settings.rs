//! The nine parameters, by what they mean.

/// PX4's parameters of collision prevention, and those of Position mode that it uses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// CP_DIST: distance to keep (m); off unless positive.
    pub distance_m: f32,
    /// CP_DELAY: delay of sensors and vehicle (s).
    pub delay_s: f32,
    /// CP_GUIDE_ANG: half angle in which guidance may turn the setpoint (deg).
    pub guide_deg: f32,
    /// CP_GO_NO_DATA: bins that were never seen may be flown into.
    pub go_without_data: bool,
    /// MPC_XY_P (1/s).
    pub position_gain_per_s: f32,
    /// MPC_VEL_MANUAL (m/s).
    pub manual_speed_mps: f32,
    /// MPC_JERK_MAX (m/s^3).
    pub jerk_mps3: f32,
    /// MPC_ACC_HOR (m/s^2).
    pub acceleration_mps2: f32,
    /// MPC_XY_VEL_P_ACC (1/s).
    pub velocity_gain_per_s: f32,
}

impl Default for Settings {
    /// PX4's own: off.
    fn default() -> Self {
        Self {
            distance_m: -1.0,
            delay_s: 0.4,
            guide_deg: 30.0,
            go_without_data: false,
            position_gain_per_s: 0.95,
            manual_speed_mps: 10.0,
            jerk_mps3: 8.0,
            acceleration_mps2: 3.0,
            velocity_gain_per_s: 1.8,
        }
    }
}

impl Settings {
    /// Whether anything is prevented at all.
    pub fn is_active(&self) -> bool {
        self.distance_m > 0.0
    }
}
