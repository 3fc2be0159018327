//! How strongly a motion toward something is scaled, and how fast it may be.
//!
//! | law | result | source |
//! |---|---|---|
//! | [`scale`] | the share of a demanded acceleration that is left at a distance | PX4, collision prevention as implemented |
//! | [`speed_limit`] | the speed from which the vehicle comes to rest within a distance | PX4, `computeMaxSpeedFromDistance` |

use super::config::PreventionConfig;

/// Share of a demanded acceleration that is left `distance_m` from an obstacle of which `keep_m` are to be kept: 1 far
/// away, falling with the square to 0 at `keep_m`, and below that minus the missing metres, as in PX4: the caller has
/// to bound it. Any distance, NaN included, gives a number that is not above 1.
pub fn scale(config: &PreventionConfig, keep_m: f64, distance_m: f64) -> f64 {
    let beyond_m = distance_m - keep_m;
    if beyond_m <= 0.0 {
        return beyond_m;
    }
    let scale_m = keep_m.max(config.manual_mps / config.position_gain_per_s);
    // A gain of zero makes the scale infinite, and comparisons with NaN are false: the share is 0 for both.
    let share = beyond_m / scale_m;
    if share < 1.0 {
        share * share
    } else if share >= 1.0 {
        1.0
    } else {
        0.0
    }
}

/// Greatest speed (m/s) from which a vehicle comes to rest within `way_m` that changes its acceleration with
/// `jerk_mps3`, brakes with `acceleration_mps2`, and flies on for `delay_s` before it does. Zero for no distance.
///
/// Rest is reached after `v delay + v 2 a / j + v^2 / (2 a)`: PX4's own approximation of jerk-limited braking, solved
/// for `v`.
pub fn speed_limit(way_m: f64, acceleration_mps2: f64, jerk_mps3: f64, delay_s: f64) -> f64 {
    let a = acceleration_mps2;
    let b = 4.0 * a * a / jerk_mps3 + 2.0 * a * delay_s;
    let root = (b * b + 8.0 * a * way_m.max(0.0)).sqrt();
    let speed_mps = 0.5 * (root - b);
    if speed_mps > 0.0 { speed_mps } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::{scale, speed_limit};
    use crate::prevention::tests::config;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_way_to_rest_from_the_limit_is_the_way_there_is(
            way in 0.01..50.0f64, a in 1.0..15.0f64, jerk in 1.0..50.0f64, delay in 0.0..1.0f64,
        ) {
            let v = speed_limit(way, a, jerk, delay);
            let needed = v * delay + v * 2.0 * a / jerk + v * v / (2.0 * a);
            prop_assert!((needed - way).abs() < 1e-9 * (1.0 + way), "{needed} of {way}");
        }

        #[test]
        fn nearer_is_never_more(keep in 0.1..15.0f64, near in -1.0..40.0f64, step in 0.0..5.0f64) {
            let config = config();
            prop_assert!(scale(&config, keep, near) <= scale(&config, keep, near + step));
            prop_assert!(scale(&config, keep, near + step) <= 1.0);
        }
    }

    #[test]
    fn numbers_that_are_none_leave_nothing() {
        assert!(!scale(&config(), 2.0, f64::NAN).is_nan());
        assert_eq!(scale(&config(), 2.0, f64::INFINITY), 1.0);
        assert_eq!(speed_limit(f64::NAN, 3.0, 8.0, 0.1), 0.0);
        assert_eq!(speed_limit(-1.0, 3.0, 8.0, 0.1), 0.0);
        assert_eq!(speed_limit(5.0, 3.0, 0.0, 0.1), 0.0);
    }
}
