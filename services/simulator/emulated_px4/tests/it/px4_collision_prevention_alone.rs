//! PX4's collision prevention in a loop of somebody else's: nothing but the public module and a point of mass.

use jink_emulated_px4::collision_prevention::{
    BINS, CollisionPrevention, ObstacleDistance, Settings, UNKNOWN_CM,
};
use nalgebra::Vector2;

/// Between two ticks (s).
const DT_S: f32 = 0.008;

/// Pushed north with 6 m/s^2 against a drag that ends at 10 m/s, a wall 30 m ahead: where it is after 20 s (m).
fn pushed(distance_m: f32, scans: bool) -> f32 {
    let mut prevention = CollisionPrevention::new(Settings {
        distance_m,
        ..Settings::default()
    });
    let (mut position, mut velocity) = (Vector2::<f32>::zeros(), Vector2::<f32>::zeros());
    for tick in 1..=2_500_u64 {
        let time_us = tick * 8_000;
        if scans && tick % 10 == 0 {
            let wall_m = |bin: usize| (30.0 - position.x) / (bin as f32 * 5.0).to_radians().cos();
            prevention.obstacle_distance(ObstacleDistance {
                time_us,
                max_cm: 2_000,
                distances_cm: std::array::from_fn(|bin| {
                    let m = wall_m(bin);
                    if m > 0.0 {
                        (m * 100.0).min(2_001.0) as u16
                    } else {
                        2_001
                    }
                }),
                ..ObstacleDistance::default()
            });
        }
        let outcome = prevention.tick(time_us, Vector2::new(6.0, 0.0), velocity);
        velocity += (outcome.setpoint_mps2 - velocity * 0.6) * DT_S;
        position += velocity * DT_S;
    }
    assert_eq!(
        prevention.published_cm()[0] == UNKNOWN_CM,
        !scans || distance_m < 0.0
    );
    assert_eq!(prevention.published_cm().len(), BINS);
    position.x
}

#[test]
fn a_point_of_mass_in_a_loop_of_its_own_stops_before_the_wall() {
    let rest_m = pushed(3.0, true);
    assert!((26.0..27.2).contains(&rest_m), "{rest_m}");
    assert!(pushed(-1.0, true) > 100.0);
    assert_eq!(pushed(3.0, false), 0.0);
}
