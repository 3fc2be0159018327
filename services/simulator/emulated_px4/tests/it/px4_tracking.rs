//! The emulator follows and stops as the real PX4 was measured to.

use crate::support::tracking;

/// Share by which the emulator may differ from the measurement.
const SHARE: f64 = 0.3;
/// Errors of this size are noise of the measurement, which was one run per row (m).
const NOISE_M: f64 = 0.03;

fn agree(observed: f64, emulated: f64) -> bool {
    (emulated - observed).abs() <= SHARE * observed.abs() + NOISE_M
}

#[test]
fn tracking_errors_are_those_measured_within_three_tenths() {
    for row in tracking::rows() {
        let emulated = tracking::tracking(&row);
        for (observed, emulated) in row.observed.iter().zip(emulated) {
            assert!(
                agree(*observed, emulated),
                "{} at {} m/s: {observed} measured, {emulated:.2} emulated",
                row.name,
                row.reference.speed
            );
        }
    }
}

#[test]
fn stops_overshoot_as_measured_within_three_tenths() {
    for stop in tracking::stops() {
        let emulated = tracking::overshoot(&stop);
        assert!(
            agree(stop.observed, emulated),
            "{} at {} m/s: {} measured, {emulated:.2} emulated",
            stop.name,
            stop.reference.speed,
            stop.observed
        );
    }
}
