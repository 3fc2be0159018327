//! Gears: how fast to go for how much room. A faster motion is followed less exactly, so it needs a wider tube, so it
//! fits through fewer gaps. The planner takes the highest gear in which there is a way worth its time.
//!
//! The tube of profile `px4_trajectory` follows what was measured on a real PX4, which smooths every curve once more
//! with its own limits (acceleration 3 m/s2, jerk 4 m/s3): with 1.8 m/s2 of lateral acceleration at 3 m/s it cut the
//! corners by up to 0.60 m, on a straight at 2 m/s by 0.02 m; stops from 4.5 m/s ran 0.93 m past their end at
//! 2 m/s2. Corner cutting grows with the acceleration asked for and hardly with the speed alone, hence
//! `tube = BASE + PER_ACCELERATION * a`; below half of PX4's own acceleration limit the linear law holds.

use jink_shared_types::motion::MotionLimits;
use jink_shared_types::params::{self, ParamSet};

/// Number of gears.
pub const GEARS: usize = 3;

/// Wobble on a straight (m): 0.02 to 0.03 m measured, doubled for wind and for other airframes.
const TUBE_BASE_M: f64 = 0.06;
/// Corner cutting per commanded acceleration (m per m/s2): 0.60 m at 1.8 m/s2.
const TUBE_PER_ACCELERATION: f64 = 0.33;
/// Overshoot of a stop per commanded deceleration (m per m/s2): 0.93 m at 2 m/s2, 1.37 m at 3 m/s2.
const OVERSHOOT_PER_DECELERATION: f64 = 0.47;

/// Share of the highest speed, acceleration (m/s2) and jerk (m/s3) of each gear. The highest acceleration stays below
/// half of PX4's MPC_ACC_HOR, the jerk below its MPC_JERK_AUTO: beyond, PX4 flies another path than the one certified.
const TABLE: [(f64, f64, f64); GEARS] = [(1.0, 1.2, 2.5), (0.5, 0.7, 2.0), (0.25, 0.4, 1.5)];

/// The limits of every gear, fastest first.
pub fn gears(params: &ParamSet) -> [MotionLimits; GEARS] {
    let speed_max_mps = params.get(&params::OA_SPD_MAX);
    TABLE.map(|(share, acceleration_mps2, jerk_mps3)| {
        let speed_mps = share * speed_max_mps;
        MotionLimits {
            speed_mps,
            climb_mps: params.get(&params::OA_SPD_CLIMB).min(speed_mps),
            descent_mps: params.get(&params::OA_SPD_DESC).min(speed_mps),
            acceleration_mps2,
            jerk_mps3,
            // PX4's MPC_YAWRAUTO_MAX is 45 deg/s; two thirds of it leave the vehicle room to follow.
            yaw_rate_radps: 0.5,
            tube_m: TUBE_BASE_M + TUBE_PER_ACCELERATION * acceleration_mps2,
            overshoot_m: OVERSHOOT_PER_DECELERATION * acceleration_mps2,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::gears;
    use jink_shared_types::params::ParamSet;

    #[test]
    fn a_slower_gear_needs_less_room() {
        let gears = gears(&ParamSet::default());
        for pair in gears.windows(2) {
            assert!(pair[1].speed_mps < pair[0].speed_mps);
            assert!(pair[1].tube_m < pair[0].tube_m);
            assert!(pair[1].overshoot_m < pair[0].overshoot_m);
        }
    }
}
