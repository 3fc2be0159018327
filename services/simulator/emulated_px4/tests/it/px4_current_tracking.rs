//! The emulator of current PX4 follows, stops and goes on after a loss as the real one was measured to.

use crate::support::{tracking_current, travel};

/// Share by which the emulator may differ from the measurement, which was one run per row.
const SHARE: f64 = 0.3;
/// Differences up to this size do not count (m).
const NOISE_M: f64 = 0.05;

fn assert_agree(what: &str, observed: &[f64], emulated: &[f64]) {
    for (o, e) in observed.iter().zip(emulated) {
        let allowed = (SHARE * o.abs()).max(NOISE_M);
        assert!((e - o).abs() <= allowed, "{what}: {o} measured, {e:.3} emulated");
    }
}

#[test]
fn offboard_tracks_as_measured_within_three_tenths_with_light_and_heavy_drag() {
    for row in tracking_current::rows() {
        let emulated = tracking_current::tracking(&row);
        let what = format!("drag {} at {} m/s", row.drag, row.reference.speed);
        assert_agree(&what, &row.observed.list(), &emulated.list());
    }
}

#[test]
fn offboard_stops_as_measured_within_three_tenths_with_light_and_heavy_drag() {
    for stop in tracking_current::stops() {
        let emulated = tracking_current::stopping(&stop);
        let what = format!("drag {} at {} m/s", stop.drag, stop.reference.speed);
        assert_agree(&what, &stop.observed.list(), &emulated.list());
    }
}

#[test]
fn the_last_setpoint_is_flown_on_and_the_way_after_it_is_as_measured_within_three_tenths() {
    for case in travel::cases() {
        assert_agree(case.name, &[case.observed], &[travel::travel(&case)]);
    }
}

#[test]
fn a_shorter_loss_time_makes_the_way_longer_because_loiter_brakes_gently() {
    let cases = travel::cases();
    let way = |name: &str| travel::travel(cases.iter().find(|c| c.name == name).unwrap());
    assert!(way("LOITER after 0.3 s from 4.5 m/s") > way("LOITER from 4.5 m/s"));
    assert!(way("LOITER after 0.3 s from 8 m/s") > way("LOITER from 8 m/s"));
}
