//! The ring as it is going to be: what moves stands in it where it will be within the time that the vehicle needs to
//! stop, as well as where it is.

use super::PreventionConfig;
use jink_shared_types::moving::MovingObstacle;
use jink_shared_types::ring::{SectorRing, sectors_of_arc};
use nalgebra::Vector2;

/// Time between two predicted moments (s): a walking person moves by half its width.
const STEP_S: f64 = 0.2;
/// Time for a pilot to notice that the vehicle stops, and for what comes to notice the vehicle (s).
const NOTICED_S: f64 = 0.5;
/// The longest time ahead (s): by then a person has turned or not.
const LONGEST_S: f64 = 2.5;
/// Nearer than this (m) nothing is predicted: what is at the vehicle has no direction.
const NEAREST_M: f64 = 0.3;

/// Adds where `moving` is going to be to `ring`, for a vehicle at `speed_mps`. `age_s`: how old the positions are.
pub(crate) fn add_expected(
    ring: &mut SectorRing,
    moving: &[MovingObstacle],
    age_s: f64,
    speed_mps: f64,
    config: &PreventionConfig,
) {
    let stop_s = config.delay_s + speed_mps / config.acceleration_mps2;
    let steps = ((stop_s + NOTICED_S).min(LONGEST_S) / STEP_S).ceil() as u32;
    let band_m = f64::from(ring.band_half_m);
    for obstacle in moving {
        if (obstacle.position.z_m - ring.position.z_m).abs() > obstacle.half_height_m + band_m {
            continue;
        }
        for step in 1..=steps {
            let place = obstacle.after(age_s + f64::from(step) * STEP_S);
            let away = (place - ring.position.vector()).xy();
            // Who has come past the vehicle must not bar its way back.
            let recedes = away.dot(&obstacle.velocity.vector().xy()) >= 0.0;
            if recedes || away.norm() < obstacle.radius_m + NEAREST_M {
                break;
            }
            add_circle(ring, away, obstacle.radius_m);
        }
    }
}

/// Adds a circle of `radius_m` whose centre is `away` (north, east, m) from the vehicle.
fn add_circle(ring: &mut SectorRing, away: Vector2<f64>, radius_m: f64) {
    let centre_m = away.norm();
    let surface_m = (centre_m - radius_m) as f32;
    let half_rad = (radius_m / centre_m).min(1.0).asin();
    let bearing_rad = away.y.atan2(away.x) - ring.attitude.yaw_rad();
    for sector in sectors_of_arc(bearing_rad - half_rad, 2.0 * half_rad) {
        // What is unknown stays so: it is no reason to fly there.
        if surface_m < ring.distance_m[sector] {
            ring.distance_m[sector] = surface_m;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{LONGEST_S, add_expected};
    use crate::prevention::PreventionConfig;
    use jink_shared_types::frames::{Attitude, Point, Velocity};
    use jink_shared_types::moving::MovingObstacle;
    use jink_shared_types::params::ParamSet;
    use jink_shared_types::ring::{SECTORS, SectorRing, sector_of};
    use nalgebra::{UnitQuaternion, Vector3};
    use proptest::prelude::*;

    /// Distance of the walls (m).
    const WALL_M: f32 = 5.0;

    proptest! {
        #[test]
        fn it_only_ever_comes_nearer_and_where_something_comes_it_does(
            yaw_rad in -3.0..3.0f64, bearing_rad in -3.0..3.0f64, away_m in 2.0..8.0f64,
            comes_mps in 0.5..2.0f64, vehicle_mps in 0.0..6.0f64, unknown in 0..SECTORS,
        ) {
            let mut ring = SectorRing {
                position: Point::new(5.0, -3.0, -2.0),
                attitude: Attitude::from_rotation(UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad)),
                // Every other sector has a wall.
                distance_m: std::array::from_fn(|sector| if sector % 2 == 0 { WALL_M } else { f32::INFINITY }),
                range_max_m: [40.0; SECTORS],
                band_half_m: 0.5,
                ..SectorRing::default()
            };
            ring.distance_m[unknown] = f32::NAN;
            let before = ring;
            let towards = Vector3::new((yaw_rad + bearing_rad).cos(), (yaw_rad + bearing_rad).sin(), 0.0);
            let person = MovingObstacle {
                position: Point::from_vector(ring.position.vector() + towards * away_m),
                velocity: Velocity::from_vector(-towards * comes_mps),
                radius_m: 0.3,
                half_height_m: 1.0,
                ..MovingObstacle::default()
            };
            let config = PreventionConfig::from_params(&ParamSet::default());
            add_expected(&mut ring, &[person], 0.0, vehicle_mps, &config);
            for sector in 0..SECTORS {
                let (was_m, is_m) = (before.distance_m[sector], ring.distance_m[sector]);
                prop_assert!(was_m.is_nan() == is_m.is_nan() && (was_m.is_nan() || is_m <= was_m));
            }
            let ahead = sector_of(bearing_rad);
            let there_m = f64::from(ring.distance_m[ahead]);
            if ahead != unknown {
                prop_assert!(there_m < (away_m - 0.3 - 0.5 * comes_mps).max(0.3 + 0.2 * comes_mps) + 0.01);
                let nearest_m = (away_m - 0.3 - comes_mps * (LONGEST_S + 0.2)).max(0.3) - 0.01;
                prop_assert!(there_m >= nearest_m.min(f64::from(before.distance_m[ahead])));
            }
            let behind = sector_of(bearing_rad + std::f64::consts::PI);
            prop_assert!(behind == unknown || ring.distance_m[behind] == before.distance_m[behind]);
        }
    }
}
