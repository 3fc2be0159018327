//! Speed tiers: sets of motion limits, and the tracking tube measured for each. A faster motion is followed less
//! exactly, so it needs a wider tube, so it fits through fewer gaps. The planner takes the highest speed tier in which
//! there is a path worth its time.
//!
//! How hard a tier may accelerate within its tube depends on how closely the autopilot follows ([`Tracking`]). With the loosest,
//! PX4's trajectory interface, accelerations are those of the table, and so are the tubes of the others: narrower only where
//! acceleration has another bound than the tube.

use jink_shared_types::motion::{MotionLimits, REPLANNED_S, stoppable_speed_mps};
use jink_shared_types::params::{self, ParamSet};
use jink_shared_types::tracking::Tracking;

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

/// Share of the highest speed, acceleration (m/s2) and jerk (m/s3) of each speed tier where the autopilot follows
/// loosely. The highest acceleration stays below half of PX4's MPC_ACC_HOR, the jerk below its MPC_JERK_AUTO: beyond,
/// PX4 flies another path than the one certified. The acceleration of a tier decides how much clearance it needs: with
/// these values the third one fits through a gap of 1.3 m, and the last ones take 0.16 and 0.18 m less: half a metre to
/// each side is five half cells. With a tube of 0.51 m in the highest tier two gaps of 2 m out of twelve were not
/// passed, with this one of 0.49 m all 36 that were tried.
const TABLE: [(f64, f64, f64); TIERS] = [
    (1.0, 1.04, 2.5),
    (0.5, 0.6, 2.0),
    (0.25, 0.32, 1.5),
    (0.13, 0.12, 1.0),
    (0.13, 0.095, 1.0),
];

/// The hardest acceleration of a plan that goes on, however closely the autopilot follows, as a share of its hardest braking: what it
/// corrects with comes on top, and what accelerates less has a narrower tube. In the forest of the campaigns (1 tree in 25 m2, a
/// Mid-360, PX4 in OFFBOARD, 12 flights each) the median of the mean speeds was 5.3, 5.5, 5.5 and 4.9 m/s with 0.5, 0.6, 0.7 and 0.8;
/// ArduCopter's 4.0 and 3.8 with the first two.
const SHARE_OF_BRAKING: f64 = 0.5;
/// The jerk of such a plan, as a share of that of the hardest braking.
const SHARE_OF_JERK: f64 = 0.8;

/// An autopilot that speeds up falls behind its setpoints and then catches up, faster than it is sent. Measured when 1, 2
/// and 3 m/s were sent, each time the greatest of 9 flights: 0.19, 0.22 and 0.26 m/s too fast (emulated PX4 and
/// ArduCopter); 0.24 m/s at 2 m/s (current PX4 in SITL). The share of the speed that is sent, and the most of it (m/s).
/// The share covers PX4's 0.14 at 1 m/s; ArduCopter's 0.19 leaves it at 1.04 m/s of 1, where 1.1 is a violation.
const CATCH_UP: (f64, f64) = (0.16, 0.26);
/// Of plans that accelerate harder the most is so much times their acceleration (s): 0.50 m/s when 7.7 m/s were sent with 3.9 m/s2
/// (emulated PX4 in OFFBOARD).
const CATCH_UP_S: f64 = 0.13;

/// Speed (m/s), acceleration (m/s2) and jerk (m/s3) on the way out of a place that is too narrow for a speed tier: by
/// the law above the tracking error is 0.10 m at that acceleration, half of that in [`SLOW_TIER`].
const CREEP: (f64, f64, f64) = (0.4, 0.1, 1.0);

/// The limits on the way out of a place that is too narrow for a speed tier.
pub fn creep(params: &ParamSet, tracking: &Tracking) -> MotionLimits {
    let (speed_mps, acceleration_mps2, jerk_mps3) = CREEP;
    limits(
        params,
        tracking,
        (speed_mps, f64::INFINITY),
        (acceleration_mps2, jerk_mps3),
    )
}

/// The limits of every speed tier, fastest first, of an autopilot that follows as `tracking` says.
pub fn speed_tiers(params: &ParamSet, tracking: &Tracking) -> [MotionLimits; TIERS] {
    let speed_max_mps = params.get(&params::OA_SPD_MAX);
    TABLE.map(|(share, acceleration_mps2, jerk_mps3)| {
        limits(
            params,
            tracking,
            (share * speed_max_mps, speed_max_mps),
            (acceleration_mps2, jerk_mps3),
        )
    })
}

/// The greatest speed (m/s) of a plan that accelerates by `acceleration_mps2` (m/s2) at most, for a vehicle that may fly
/// `allowed_mps` (m/s): with it, the vehicle stays below that while it catches up with its setpoints.
pub fn planned_mps(allowed_mps: f64, acceleration_mps2: f64) -> f64 {
    let (share, most_mps) = CATCH_UP;
    let most_mps = most_mps.max(CATCH_UP_S * acceleration_mps2);
    (allowed_mps / (1.0 + share)).max(allowed_mps - most_mps)
}

/// The speed (m/s) that plans of `length_m` (m) within `limits` reach. Each ends at rest, its overshoot included, and
/// before the next one is flown the vehicle has moved on for a fifth of a second.
pub fn reached_mps(limits: &MotionLimits, length_m: f64) -> f64 {
    let path_m = length_m - limits.overshoot_m;
    let speed_mps = stoppable_speed_mps(path_m, REPLANNED_S, limits.braking_mps2, limits.braking_jerk_mps3);
    speed_mps.min(limits.speed_mps)
}

/// The limits within the tube that the loosest autopilot needs for `loose`: acceleration (m/s2) and jerk (m/s3); of plans with the first
/// of two speeds (m/s), for a vehicle that may fly the second.
fn limits(
    params: &ParamSet,
    tracking: &Tracking,
    (speed_mps, allowed_mps): (f64, f64),
    (loose_mps2, loose_mps3): (f64, f64),
) -> MotionLimits {
    // Who brakes no harder than the table accelerates is the one that it was measured with.
    let hardest_mps2 = (SHARE_OF_BRAKING * tracking.braking_mps2).max(loose_mps2);
    let tube_m = Tracking::PX4_TRAJECTORY.tube_m(loose_mps2);
    let tube_m = tube_m.min(tracking.tube_m(hardest_mps2));
    let acceleration_mps2 = tracking.acceleration_mps2(tube_m).min(hardest_mps2);
    let jerk_mps3 =
        (loose_mps3 * acceleration_mps2 / loose_mps2).min(SHARE_OF_JERK * tracking.braking_jerk_mps3);
    let speed_mps = speed_mps.min(planned_mps(allowed_mps, acceleration_mps2));
    let (braking_mps2, braking_jerk_mps3) = tracking.shortest_stop(speed_mps, (acceleration_mps2, jerk_mps3));
    MotionLimits {
        speed_mps,
        climb_mps: params.get(&params::OA_SPD_CLIMB).min(speed_mps),
        descent_mps: params.get(&params::OA_SPD_DESC).min(speed_mps),
        acceleration_mps2,
        jerk_mps3,
        // PX4's MPC_YAWRAUTO_MAX is 45 deg/s; two thirds of it leave the vehicle a margin to follow.
        yaw_rate_radps: 0.5,
        tube_m,
        overshoot_m: tracking.overshoot_m(braking_mps2),
        braking_mps2,
        braking_jerk_mps3,
    }
}

#[cfg(test)]
mod tests {
    use super::{CATCH_UP, CATCH_UP_S, SHARE_OF_JERK, TABLE, planned_mps, reached_mps, speed_tiers};
    use jink_shared_types::motion::{REPLANNED_S, stopping_distance_m};
    use jink_shared_types::params::ParamSet;
    use jink_shared_types::tracking::Tracking;

    const ALL: [Tracking; 3] = [
        Tracking::PX4_TRAJECTORY,
        Tracking::PX4_OFFBOARD,
        Tracking::ARDUPILOT_GUIDED,
    ];

    #[test]
    fn every_tier_stays_in_its_tube_whoever_follows() {
        for tracking in ALL {
            for limits in speed_tiers(&ParamSet::default(), &tracking) {
                assert!(limits.tube_m >= tracking.tube_m(limits.acceleration_mps2) - 1e-9);
                assert!(limits.overshoot_m >= tracking.overshoot_m(limits.braking_mps2) - 1e-9);
                assert!(limits.braking_mps2 <= tracking.braking_mps2);
                assert!(limits.jerk_mps3 <= SHARE_OF_JERK * tracking.braking_jerk_mps3);
            }
        }
    }

    #[test]
    fn who_follows_closely_may_accelerate_harder_in_no_wider_a_tube() {
        let [loose, offboard, guided] = ALL.map(|tracking| speed_tiers(&ParamSet::default(), &tracking));
        for tier in 0..TABLE.len() {
            let (_, acceleration_mps2, jerk_mps3) = TABLE[tier];
            assert!((loose[tier].acceleration_mps2 - acceleration_mps2).abs() < 1e-9);
            assert!((loose[tier].jerk_mps3 - jerk_mps3).abs() < 1e-9);
            assert!(offboard[tier].acceleration_mps2 > 1.9 * acceleration_mps2);
            assert!(guided[tier].acceleration_mps2 > 1.4 * acceleration_mps2);
            assert!(offboard[tier].tube_m <= loose[tier].tube_m);
            assert!(guided[tier].tube_m <= loose[tier].tube_m);
        }
    }

    #[test]
    fn the_speed_that_plans_reach_is_the_one_from_which_they_stop_in_time() {
        let mut params = ParamSet::default();
        params.set("OA_SPD_MAX", 12.0).unwrap();
        let [loose, offboard, guided] = ALL.map(|tracking| {
            let limits = speed_tiers(&params, &tracking)[0];
            let speed_mps = reached_mps(&limits, 11.0);
            let (a, j) = (limits.braking_mps2, limits.braking_jerk_mps3);
            let stop_m = stopping_distance_m(speed_mps, REPLANNED_S, a, j);
            assert!((stop_m + limits.overshoot_m - 11.0).abs() < 1e-9, "{speed_mps}");
            speed_mps
        });
        assert!(loose < guided && guided < offboard, "{loose} {offboard} {guided}");
        assert_eq!(reached_mps(&speed_tiers(&params, &ALL[0])[3], 11.0), 0.13 * 12.0);
    }

    #[test]
    fn a_vehicle_that_catches_up_with_its_plan_stays_below_what_is_allowed() {
        let (share, most_mps) = CATCH_UP;
        for allowed_mps in [0.3, 0.5, 1.0, 1.88, 2.0, 3.0, 8.0, 20.0] {
            let mut params = ParamSet::default();
            params.set("OA_SPD_MAX", allowed_mps).unwrap();
            for tracking in ALL {
                let tiers = speed_tiers(&params, &tracking);
                let acceleration_mps2 = tiers[0].acceleration_mps2;
                let planned = planned_mps(allowed_mps, acceleration_mps2);
                assert!(
                    planned > 0.8 * allowed_mps && planned < allowed_mps,
                    "{allowed_mps}"
                );
                let most_mps = most_mps.max(CATCH_UP_S * acceleration_mps2);
                let caught_up_mps = planned + (share * planned).min(most_mps);
                assert!((caught_up_mps - allowed_mps).abs() < 1e-9, "{allowed_mps}");
                for limits in tiers {
                    assert!(limits.speed_mps <= planned + 1e-9);
                }
            }
        }
    }

    #[test]
    fn a_slower_tier_needs_less_clearance() {
        for tracking in ALL {
            let speed_tiers = speed_tiers(&ParamSet::default(), &tracking);
            for pair in speed_tiers.windows(2) {
                assert!(pair[1].speed_mps <= pair[0].speed_mps);
                assert!(pair[1].tube_m <= pair[0].tube_m);
                assert!(pair[1].overshoot_m <= pair[0].overshoot_m);
            }
        }
    }
}
