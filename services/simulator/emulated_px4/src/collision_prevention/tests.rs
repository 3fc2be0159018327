//! Laws and the oddities that somebody might be tempted to repair.

use super::*;
use proptest::prelude::*;

fn settings(distance_m: f32) -> Settings {
    Settings {
        distance_m,
        ..Settings::default()
    }
}

fn scan(time_us: u64, distance_cm: impl Fn(usize) -> u16) -> ObstacleDistance {
    ObstacleDistance {
        time_us,
        distances_cm: std::array::from_fn(distance_cm),
        ..ObstacleDistance::default()
    }
}

fn written(prevention: &CollisionPrevention) -> Vec<usize> {
    let bins = prevention.map().distance_cm.iter().enumerate();
    bins.filter(|(_, cm)| **cm != UNKNOWN_CM)
        .map(|(bin, _)| bin)
        .collect()
}

/// Which bins a single element of a message reaches.
fn touched(element: usize, increment_deg: f32, offset_deg: f32) -> Vec<usize> {
    let mut prevention = CollisionPrevention::new(settings(2.0));
    prevention.obstacle_distance(ObstacleDistance {
        increment_deg,
        offset_deg,
        ..scan(1_000, |j| if j == element { 300 } else { UNKNOWN_CM })
    });
    prevention.tick(1_000, Vector2::zeros(), Vector2::zeros());
    written(&prevention)
}

fn rangefinder(distance_m: f32, field_of_view_deg: f32) -> DistanceSensor {
    DistanceSensor {
        time_us: 1_000,
        min_m: 0.2,
        max_m: 8.0,
        distance_m,
        quality: -1,
        orientation: 0,
        field_of_view_rad: field_of_view_deg.to_radians(),
        body_q_sensor: [1.0, 0.0, 0.0, 0.0],
    }
}

proptest! {
    #[test]
    fn switched_off_it_changes_nothing_and_reads_nothing(x in -9.0..9.0f32, y in -9.0..9.0f32, distance_m in -1.0..=0.0f32) {
        let mut prevention = CollisionPrevention::new(settings(distance_m));
        prevention.obstacle_distance(scan(1_000, |_| 50));
        let outcome = prevention.tick(1_000, Vector2::new(x, y), Vector2::new(x, y));
        prop_assert!(!outcome.active);
        prop_assert_eq!(outcome.setpoint_mps2, Vector2::new(x, y));
        prop_assert!(written(&prevention).is_empty());
        prevention.set(settings(2.0));
        prevention.tick(2_000, Vector2::zeros(), Vector2::zeros());
        prop_assert_eq!(written(&prevention).len(), BINS, "what was not read comes later");
    }

    #[test]
    fn authority_grows_with_the_distance_from_nothing_at_the_one_to_keep(keep_m in 0.1..15.0f32, a in 0.0..40.0f32, b in 0.0..40.0f32) {
        let settings = Settings::default();
        let (near, far) = (a.min(b), a.max(b));
        prop_assert!(authority(near, keep_m, &settings) <= authority(far, keep_m, &settings));
        prop_assert_eq!(authority(keep_m, keep_m, &settings), 0.0);
        prop_assert!(authority(keep_m + keep_m.max(10.6), keep_m, &settings) > 0.99);
    }

    #[test]
    fn the_speed_to_stop_from_is_stopped_within_its_distance(jerk in 2.0..40.0f32, acceleration in 1.0..10.0f32, way_m in 0.01..40.0f32) {
        let speed = speed_to_stop_mps(jerk, acceleration, way_m, 0.0);
        // Deceleration builds up to its limit and then stays there.
        let build_up_s = acceleration / jerk;
        let needs_m = speed * build_up_s + speed * speed / (2.0 * acceleration);
        prop_assert!(needs_m <= way_m * 1.001, "{speed} m/s needs {needs_m} m of {way_m} m");
    }

    #[test]
    fn aligned_elements_of_a_bins_width_are_bins_whatever_the_heading(element in 0usize..72, quarter in 0u8..4) {
        prop_assert_eq!(touched(element, 5.0, 0.0), vec![element]);
        let half_rad = f32::from(quarter) * std::f32::consts::FRAC_PI_4;
        let mut prevention = CollisionPrevention::new(settings(2.0));
        prevention.attitude([half_rad.cos(), 0.0, 0.0, half_rad.sin()]);
        prevention.obstacle_distance(ObstacleDistance {
            frame: frame::LOCAL_NED,
            // Half a degree off the edges, where single precision decides.
            offset_deg: 0.5,
            ..scan(1_000, |j| if j == element { 300 } else { UNKNOWN_CM })
        });
        prevention.tick(1_000, Vector2::zeros(), Vector2::zeros());
        prop_assert!(written(&prevention).contains(&((element + 72 - 18 * usize::from(quarter)) % 72)));
    }

    #[test]
    fn any_numbers_at_all_are_answered(
        angles in prop::array::uniform4(prop::num::f32::ANY),
        q in prop::array::uniform4(prop::num::f32::ANY),
        setpoint in prop::array::uniform2(prop::num::f32::ANY),
        velocity in prop::array::uniform2(prop::num::f32::ANY),
        parameters in prop::array::uniform8(prop::num::f32::ANY),
    ) {
        let [increment_deg, offset_deg, reading, fov] = angles;
        let [distance_m, delay_s, guide_deg, position_gain_per_s, manual_speed_mps, jerk_mps3, acceleration_mps2, velocity_gain_per_s] =
            parameters;
        let mut prevention = CollisionPrevention::new(Settings {
            distance_m,
            delay_s,
            guide_deg,
            go_without_data: true,
            position_gain_per_s,
            manual_speed_mps,
            jerk_mps3,
            acceleration_mps2,
            velocity_gain_per_s,
        });
        prevention.attitude(q);
        prevention.distance_sensor(3, DistanceSensor {
            body_q_sensor: q,
            orientation: 100,
            ..rangefinder(reading, fov)
        });
        prevention.obstacle_distance(ObstacleDistance { increment_deg, offset_deg, ..scan(1_000, |j| j as u16 * 20) });
        let outcome = prevention.tick(2_000, setpoint.into(), velocity.into());
        prop_assert_eq!(outcome.active, distance_m > 0.0);
    }
}

#[test]
fn a_field_of_view_touches_the_bins_of_its_edges() {
    let bins = |field_of_view_deg| {
        let mut prevention = CollisionPrevention::new(settings(2.0));
        prevention.distance_sensor(0, rangefinder(3.0, field_of_view_deg));
        prevention.tick(1_000, Vector2::zeros(), Vector2::zeros());
        written(&prevention)
    };
    assert_eq!(bins(5.5), [0, 1, 71]);
    assert_eq!(bins(0.0), [0]);
    assert_eq!(bins(360.0).len(), BINS);
}

#[test]
fn an_element_across_the_zero_is_blind_to_the_bins_on_its_left() {
    assert_eq!(touched(0, 10.0, 0.0), [0, 1]);
    assert_eq!(touched(0, 30.0, 0.0), [0, 1, 2, 3]);
    assert_eq!(touched(0, 360.0, 0.0), [36]);
    assert_eq!(touched(1, 10.0, 0.0), [1, 2, 3]);
}

#[test]
fn an_increment_beyond_a_circle_writes_nothing_and_ends_nothing() {
    assert!(touched(0, 361.0, 0.0).is_empty());
}

#[test]
fn the_newest_of_equal_sensors_wins_and_not_the_nearest() {
    let mut prevention = CollisionPrevention::new(settings(2.0));
    for (time_us, distance_cm) in [(1_000, 100), (2_000, 500)] {
        prevention.obstacle_distance(scan(time_us, |_| distance_cm));
        prevention.tick(time_us, Vector2::zeros(), Vector2::zeros());
    }
    assert_eq!(prevention.map().distance_cm, [500; BINS]);
}

#[test]
fn a_bin_is_published_once_more_in_the_tick_in_which_it_is_forgotten() {
    let mut prevention = CollisionPrevention::new(settings(2.0));
    prevention.obstacle_distance(scan(1_000, |_| 300));
    prevention.tick(1_000, Vector2::zeros(), Vector2::zeros());
    prevention.tick(501_000, Vector2::zeros(), Vector2::zeros());
    assert_eq!(
        prevention.map().distance_cm,
        [300; BINS],
        "half a second is not old"
    );
    let outcome = prevention.tick(501_001, Vector2::new(3.0, 0.0), Vector2::zeros());
    assert_eq!(prevention.published_cm(), &[300; BINS]);
    assert_eq!(prevention.map().distance_cm, [UNKNOWN_CM; BINS]);
    assert_eq!(outcome.setpoint_mps2, Vector2::zeros());
}

#[test]
fn with_nothing_but_what_is_too_near_the_setpoint_is_no_number() {
    let mut prevention = CollisionPrevention::new(settings(2.0));
    prevention.obstacle_distance(scan(1_000, |j| if j == 0 { 15 } else { UNKNOWN_CM }));
    let outcome = prevention.tick(1_000, Vector2::new(3.0, 0.0), Vector2::zeros());
    assert!(outcome.setpoint_mps2.x.is_nan() && outcome.setpoint_mps2.y.is_nan());
}

#[test]
fn a_stick_at_rest_brakes_nothing() {
    let mut prevention = CollisionPrevention::new(settings(4.0));
    prevention.obstacle_distance(scan(1_000, |_| 410));
    let outcome = prevention.tick(1_000, Vector2::zeros(), Vector2::new(8.0, 0.0));
    assert_eq!(outcome.setpoint_mps2, Vector2::zeros());
    assert!(outcome.data_present && outcome.steering.is_none());
}

#[test]
fn silence_is_a_warning_a_second_and_hold_after_five() {
    let mut prevention = CollisionPrevention::new(settings(4.0));
    let start_us = 60_000_000;
    let mut warned_ms = Vec::new();
    let mut held_ms = Vec::new();
    for ms in 0..7_000 {
        let outcome = prevention.tick(start_us + ms * 1_000, Vector2::new(1.0, 0.0), Vector2::zeros());
        assert_eq!(outcome.setpoint_mps2, Vector2::zeros());
        if outcome.warns_of_no_data {
            warned_ms.push(ms);
        }
        if outcome.wants_hold {
            held_ms.push(ms);
        }
    }
    assert_eq!(warned_ms, [1_001, 2_002, 3_003, 4_004, 5_005, 6_006]);
    assert_eq!(held_ms, [5_005, 6_006]);
}

#[test]
fn a_restart_forgets_what_was_seen_but_not_what_is_unread() {
    let mut prevention = CollisionPrevention::new(settings(4.0));
    prevention.obstacle_distance(scan(1_000, |_| 700));
    prevention.tick(1_000, Vector2::zeros(), Vector2::zeros());
    prevention.obstacle_distance(scan(2_000, |j| if j == 7 { 700 } else { UNKNOWN_CM }));
    prevention.restart();
    assert!(!prevention.map().seen[0]);
    prevention.tick(3_000, Vector2::zeros(), Vector2::zeros());
    assert_eq!(written(&prevention), [7]);
}
