//! The emulated ArduCopter follows, stops and overshoots as the real one was measured to.

use crate::support::copter_tracking as tracking;

/// Share by which the emulator may differ from the measurement, which was one run per row.
const SHARE: f64 = 0.3;
/// Errors of this size are noise (m).
const NOISE_M: f64 = 0.05;

fn check(name: &str, observed: f64, emulated: f64) {
    if observed.is_nan() {
        return;
    }
    let allowed = (SHARE * observed.abs()).max(NOISE_M);
    assert!(
        (emulated - observed).abs() <= allowed,
        "{name}: {observed} measured, {emulated:.2} emulated"
    );
}

#[test]
fn tracking_errors_are_those_measured_within_three_tenths() {
    for row in tracking::rows().iter().filter(|row| row.apart.is_empty()) {
        let emulated = tracking::tracking(row);
        let name = format!("{} at {} m/s", row.name, row.reference.speed);
        check(&name, row.observed.p50, emulated.p50);
        check(&name, row.observed.max, emulated.max);
        check(&name, row.observed.cross_max, emulated.cross_max);
    }
}

#[test]
fn beyond_the_limits_of_jerk_and_lean_the_weave_is_lost_by_metres_and_wider_limits_save_it() {
    let rows = tracking::rows();
    let at_8 = |name| {
        let row = rows
            .iter()
            .find(|row| row.name == name && row.reference.speed == 8.0);
        tracking::tracking(row.unwrap()).max
    };
    assert!(at_8("pva") > 6.0 && at_8("pos+vel") > 6.0);
    assert!(at_8("pva, wide") < 1.5);
}

#[test]
fn stops_overshoot_as_measured_within_three_tenths() {
    for stop in tracking::stops() {
        let name = format!("{} at {} m/s", stop.name, stop.reference.speed);
        check(&name, stop.observed, tracking::overshoot(&stop));
    }
}

#[test]
fn halts_take_the_way_and_the_time_measured_within_three_tenths() {
    for halt in tracking::halts() {
        let after = tracking::come_to_rest(&halt);
        let [travel, end, time_s] = halt.observed;
        check(halt.name, travel, after.max);
        check(halt.name, time_s, after.stopped_s);
        // "Here" is where the script believed the vehicle to be: 0.1 m off.
        assert!(
            (after.last - end).abs() < (SHARE * end).max(0.15),
            "{}",
            halt.name
        );
    }
}

#[test]
fn a_stream_that_stops_carries_the_vehicle_as_far_as_measured_within_three_tenths() {
    for silence in tracking::silences() {
        let after = tracking::fall_silent(&silence);
        let [one_s, three_s, max, last] = silence.observed;
        check(silence.name, one_s, after.one_s);
        check(silence.name, three_s, after.three_s);
        check(silence.name, max, after.max);
        // With an acceleration in it the way back was still being flown when the measurement ended.
        match silence.name.contains("a = +1") {
            true => assert!(after.last < last, "{}: {}", silence.name, after.last),
            false => check(silence.name, last, after.last),
        }
    }
}
