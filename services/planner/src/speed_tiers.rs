//! Speed tiers: sets of motion limits, and the tracking tube measured for each. A faster motion is followed less
//! exactly, so it needs a wider tube, so it fits through fewer gaps. The planner takes the highest speed tier in which
//! there is a path worth its time.
//!
//! The tube follows what was measured on a real PX4 with its trajectory interface, which smooths every curve once more
//! with its own limits (acceleration 3 m/s2, jerk 4 m/s3) and has the largest tracking error of all autopilots: in
//! waves with 1.8 m/s2 of lateral acceleration at 3 m/s it cut the corners by up to 0.60 m, in jink's own turns in a
//! forest, planned with 1.2 m/s2 at 2 m/s, by 0.50 m; on a straight at 2 m/s by 0.02 m. In OFFBOARD it was 0.16 m.
//! Stops from 4.5 m/s ran 0.93 m past their end at 2 m/s2. Corner cutting grows with the commanded acceleration and
//! hardly with the speed alone, hence `tube = BASE + PER_ACCELERATION * a`, not smaller than any of these; below half
//! of PX4's own acceleration limit the linear law holds.

use jink_shared_types::motion::MotionLimits;
use jink_shared_types::params::{self, ParamSet};

/// Number of speed tiers.
pub const TIERS: usize = 5;
/// The lowest speed tier: for the narrowest places. It is planned on half cells, and no farther than those reach.
pub const LAST_TIER: usize = TIERS - 1;
/// The first of the two lowest speed tiers. They are used where no other has a path, or only a much longer one, and
/// take twice the time of the tier before them.
pub const CRAWL_TIER: usize = TIERS - 2;
/// The lowest speed tier that paths are planned in before those. A vehicle that rests without clearance for it first
/// moves to where it has that.
pub const SLOW_TIER: usize = TIERS - 3;
/// Highest speed tier while a range sensor is silent: half the speed.
pub(crate) const DEGRADED_TIER: usize = 1;

/// Tracking error on a straight (m): 0.02 to 0.03 m measured, doubled for wind and for other airframes.
const TUBE_BASE_M: f64 = 0.06;
/// Corner cutting per commanded acceleration (m per m/s2): 0.50 m at 1.2 m/s2, and a tenth for airframes that follow
/// less well.
const TUBE_PER_ACCELERATION: f64 = 0.41;
/// Overshoot of a stop per commanded deceleration (m per m/s2): 0.93 m at 2 m/s2, 1.37 m at 3 m/s2.
pub const OVERSHOOT_PER_DECELERATION: f64 = 0.47;

/// Share of the highest speed, acceleration (m/s2) and jerk (m/s3) of each speed tier. The highest acceleration stays
/// below half of PX4's MPC_ACC_HOR, the jerk below its MPC_JERK_AUTO: beyond, PX4 flies another path than the one
/// certified. The acceleration of a tier decides how much clearance it needs: with these values the third one fits
/// through a gap of 1.3 m, and the last ones take 0.16 and 0.18 m less: half a metre to each side is five half cells.
/// With a tube of 0.51 m in the highest tier two gaps of 2 m out of twelve were not passed, with this one of 0.49 m all
/// 36 that were tried.
const TABLE: [(f64, f64, f64); TIERS] = [
    (1.0, 1.04, 2.5),
    (0.5, 0.6, 2.0),
    (0.25, 0.32, 1.5),
    (0.13, 0.12, 1.0),
    (0.13, 0.095, 1.0),
];

/// Speed (m/s), acceleration (m/s2) and jerk (m/s3) on the way out of a place that is too narrow for a speed tier: by
/// the law above the tracking error is 0.10 m at that acceleration, half of that in [`SLOW_TIER`].
const CREEP: (f64, f64, f64) = (0.4, 0.1, 1.0);

/// The limits on the way out of a place that is too narrow for a speed tier.
pub fn creep(params: &ParamSet) -> MotionLimits {
    let (speed_mps, acceleration_mps2, jerk_mps3) = CREEP;
    limits(params, speed_mps, acceleration_mps2, jerk_mps3)
}

/// The limits of every speed tier, fastest first.
pub fn speed_tiers(params: &ParamSet) -> [MotionLimits; TIERS] {
    let speed_max_mps = params.get(&params::OA_SPD_MAX);
    TABLE.map(|(share, acceleration_mps2, jerk_mps3)| {
        limits(params, share * speed_max_mps, acceleration_mps2, jerk_mps3)
    })
}

fn limits(params: &ParamSet, speed_mps: f64, acceleration_mps2: f64, jerk_mps3: f64) -> MotionLimits {
    MotionLimits {
        speed_mps,
        climb_mps: params.get(&params::OA_SPD_CLIMB).min(speed_mps),
        descent_mps: params.get(&params::OA_SPD_DESC).min(speed_mps),
        acceleration_mps2,
        jerk_mps3,
        // PX4's MPC_YAWRAUTO_MAX is 45 deg/s; two thirds of it leave the vehicle a margin to follow.
        yaw_rate_radps: 0.5,
        tube_m: TUBE_BASE_M + TUBE_PER_ACCELERATION * acceleration_mps2,
        overshoot_m: OVERSHOOT_PER_DECELERATION * acceleration_mps2,
    }
}

#[cfg(test)]
mod tests {
    use super::speed_tiers;
    use jink_shared_types::params::ParamSet;

    #[test]
    fn no_tube_is_smaller_than_what_was_measured() {
        for limits in speed_tiers(&ParamSet::default()) {
            // Acceleration asked for (m/s2) and corner cut (m), real PX4, trajectory interface.
            for (acceleration_mps2, cut_m) in [(1.2, 0.50), (1.8, 0.60), (0.0, 0.03)] {
                let scaled_m = cut_m * (limits.acceleration_mps2 / acceleration_mps2).min(1.0);
                assert!(
                    limits.tube_m > scaled_m,
                    "{limits:?}: {cut_m} m at {acceleration_mps2} m/s2"
                );
            }
        }
    }

    #[test]
    fn a_slower_tier_needs_less_clearance() {
        let speed_tiers = speed_tiers(&ParamSet::default());
        for pair in speed_tiers.windows(2) {
            assert!(pair[1].speed_mps <= pair[0].speed_mps);
            assert!(pair[1].tube_m < pair[0].tube_m);
            assert!(pair[1].overshoot_m < pair[0].overshoot_m);
        }
    }
}
