//! What moves is reported with its place and its velocity, and nothing else is, whatever the vehicle does itself.

use crate::world::{Lidar, VehicleMotion, WorldShape, forest, header};
use jink_obstacle_fusion::{Fusion, FusionConfig};
use jink_shared_types::moving::MovingObstacles;
use jink_shared_types::params::ParamSet;
use jink_shared_types::ranges::PointCloud;
use nalgebra::{UnitQuaternion, Vector3};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::SplitMix64;

const RATE_HZ: f64 = 15.0;
const RADIUS_M: f64 = 0.3;

/// A person who passes the origin.
#[derive(Clone, Copy, Debug)]
struct Walker {
    velocity_mps: Vector3<f64>,
    /// Where it is at `middle_s`.
    place_m: Vector3<f64>,
    middle_s: f64,
}

impl Walker {
    fn at(&self, t_s: f64) -> Vector3<f64> {
        self.place_m + self.velocity_mps * (t_s - self.middle_s)
    }
}

/// Rays all around, and few; rings, few and many; what the other laws see with.
fn lidars() -> impl Strategy<Value = Lidar> {
    let lidar = |rays: usize, rings: usize, elevation_rad: f64, range_max_m: f64| Lidar {
        rays,
        rings,
        elevation_rad: (-elevation_rad, elevation_rad),
        range_max_m,
        sweep_s: 1.0 / RATE_HZ,
        ..Lidar::default()
    };
    prop_oneof![
        Just(lidar(12_000, 0, 0.9, 40.0)),
        Just(lidar(6_000, 0, std::f64::consts::FRAC_PI_2, 8.0)),
        Just(lidar(14_400, 16, 0.26, 40.0)),
        Just(lidar(32_768, 64, 0.79, 40.0)),
    ]
}

/// Flies at `speed_mps` through a forest for `duration_s` with noise in ranges and poses; what moves, with the time, after each frame.
fn fly(
    seed: u64,
    lidar: &Lidar,
    speed_mps: f64,
    walker: Option<Walker>,
    duration_s: f64,
) -> Vec<(f64, MovingObstacles)> {
    let forest = forest(40.0, seed);
    let mut random = SplitMix64::seed_from_u64(seed);
    let motion = |t_s: f64| VehicleMotion {
        position_m: Vector3::new(speed_mps * t_s, 0.2 * t_s.sin(), -2.0),
        velocity_mps: Vector3::new(speed_mps, 0.2 * t_s.cos(), 0.0),
        attitude: UnitQuaternion::from_euler_angles(0.05 * t_s.sin(), -0.05, 0.1 * t_s),
        rates_radps: Vector3::new(0.05 * t_s.cos(), 0.0, 0.1),
    };
    let mut fusion = Fusion::new(FusionConfig::from_params(&ParamSet::default(), 1));
    let mut cloud = PointCloud::boxed();
    let mut seen = Vec::new();
    for sweep in 1..=(duration_s * RATE_HZ) as usize {
        let t_s = sweep as f64 / RATE_HZ;
        for i in (0..3).rev() {
            let state_s = t_s - 0.02 * f64::from(i);
            let mut state = motion(state_s);
            state.position_m += Vector3::from_fn(|_, _| random.random_range(-0.03..0.03));
            let tilt_rad = Vector3::from_fn(|_, _| random.random_range(-0.01..0.01));
            state.attitude *= UnitQuaternion::from_scaled_axis(tilt_rad);
            fusion.vehicle(&state.state(), &header(state_s));
        }
        let mut world = forest.clone();
        world.extend(walker.map(|walker| {
            let place_m = walker.at(t_s);
            WorldShape::Block {
                center_m: Vector3::new(place_m.x, place_m.y, -1.0),
                half_m: Vector3::new(RADIUS_M, RADIUS_M, 2.0),
            }
        }));
        lidar.sweep(&world, motion, t_s, sweep, &mut cloud);
        let rays = cloud.len as usize;
        for point in &mut cloud.points[..rays] {
            point.forward_m += random.random_range(-0.04..0.04) as f32;
        }
        fusion.cloud(0, &cloud, &header(t_s));
        let mut moving = MovingObstacles::default();
        fusion.write_moving(&mut moving);
        assert!(moving.is_consistent());
        seen.push((t_s, moving));
    }
    seen
}

/// A vehicle that gusts of about 2 m/s carry to and fro, and that tilts against them.
fn gusty(t_s: f64, phase: f64) -> VehicleMotion {
    const GRAVITY_MPS2: f64 = 9.8;
    // Speed (m/s), its circular frequency (rad/s), where it begins.
    let gusts = [(1.1, 1.1, 0.0), (0.8, 2.3, 1.0), (0.5, 4.1, 2.0)];
    // Place, speed, acceleration and jerk on an axis.
    let along = |axis: f64| {
        gusts
            .iter()
            .fold([0.0; 4], |[place, speed, pull, jerk], (mps, radps, turn)| {
                let (sin, cos) = (radps * t_s + turn * (1.0 + axis) + phase + axis).sin_cos();
                [
                    place + mps / radps * sin,
                    speed + mps * cos,
                    pull - mps * radps * sin,
                    jerk - mps * radps * radps * cos,
                ]
            })
    };
    let ([north_m, north_mps, north, north_jerk], [east_m, east_mps, east, east_jerk]) =
        (along(0.0), along(2.0));
    VehicleMotion {
        position_m: Vector3::new(1.0 + north_m, 0.5 * east_m, -2.0),
        velocity_mps: Vector3::new(north_mps, 0.5 * east_mps, 0.0),
        attitude: UnitQuaternion::from_euler_angles(0.5 * east / GRAVITY_MPS2, -north / GRAVITY_MPS2, 0.0),
        rates_radps: Vector3::new(0.5 * east_jerk / GRAVITY_MPS2, -north_jerk / GRAVITY_MPS2, 0.0),
    }
}

/// Sways in those gusts between trees and two walls with an attitude that is 30 ms late; what moves after each frame.
fn sway(seed: u64, lidar: &Lidar, walker: Option<Walker>) -> Vec<(f64, MovingObstacles)> {
    const LATE_S: f64 = 0.03;
    let wall = |center_m: Vector3<f64>, half_m: Vector3<f64>| WorldShape::Block { center_m, half_m };
    let mut still = forest(40.0, seed);
    still.push(wall(Vector3::new(7.0, 0.0, -1.5), Vector3::new(0.1, 4.0, 1.6)));
    still.push(wall(Vector3::new(-2.0, -6.0, -1.5), Vector3::new(3.0, 0.1, 1.6)));
    let motion = |t_s: f64| gusty(t_s, seed as f64);
    let mut random = SplitMix64::seed_from_u64(seed);
    let mut fusion = Fusion::new(FusionConfig::from_params(&ParamSet::default(), 1));
    let mut cloud = PointCloud::boxed();
    let mut seen = Vec::new();
    for sweep in 1..=(12.0 * RATE_HZ) as usize {
        let t_s = sweep as f64 / RATE_HZ;
        for i in (0..3).rev() {
            let state_s = t_s - 0.02 * f64::from(i);
            let (mut state, late) = (motion(state_s), motion(state_s - LATE_S));
            (state.attitude, state.rates_radps) = (late.attitude, late.rates_radps);
            state.position_m += Vector3::from_fn(|_, _| random.random_range(-0.03..0.03));
            fusion.vehicle(&state.state(), &header(state_s));
        }
        let mut world = still.clone();
        world.extend(walker.map(|walker| {
            let place_m = walker.at(t_s);
            wall(
                Vector3::new(place_m.x, place_m.y, -1.0),
                Vector3::new(RADIUS_M, RADIUS_M, 2.0),
            )
        }));
        lidar.sweep(&world, motion, t_s, sweep, &mut cloud);
        fusion.cloud(0, &cloud, &header(t_s));
        let mut moving = MovingObstacles::default();
        fusion.write_moving(&mut moving);
        seen.push((t_s, moving));
    }
    seen
}

#[test]
fn nothing_but_who_walks_moves_in_gusts_whose_tilts_are_reported_late() {
    let lidar = |rays: usize, rings: usize, elevation_rad: f64| Lidar {
        rays,
        rings,
        elevation_rad: (-elevation_rad, elevation_rad),
        range_max_m: 40.0,
        sweep_s: 1.0 / RATE_HZ,
        ..Lidar::default()
    };
    let flies = |lidar: Lidar| {
        for seed in 1..=3 {
            for (t_s, moving) in sway(seed, &lidar, None) {
                assert!(
                    moving.obstacles().is_empty(),
                    "seed {seed} at {t_s}: {:?}",
                    moving.obstacles()
                );
            }
        }
        let walker = Walker {
            velocity_mps: Vector3::new(0.0, 1.0, 0.0),
            place_m: Vector3::new(4.5, 0.0, -2.0),
            middle_s: 6.0,
        };
        let seen = sway(1, &lidar, Some(walker));
        let near = seen.iter().filter(|(t_s, _)| (t_s - walker.middle_s).abs() < 1.5);
        let found = near.clone().filter(|(t_s, moving)| {
            let is_walker = |place: Vector3<f64>| (place - walker.at(*t_s)).xy().norm() < 0.8;
            moving
                .obstacles()
                .iter()
                .any(|one| is_walker(one.position.vector()))
        });
        println!("{} of {}", found.clone().count(), near.clone().count());
        assert!(found.count() * 10 >= near.count() * 6);
    };
    std::thread::scope(|scope| {
        for lidar in [
            lidar(14_400, 16, 0.26),
            lidar(20_000, 0, 0.9),
            lidar(32_768, 64, 0.79),
        ] {
            scope.spawn(move || flies(lidar));
        }
    });
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    // Who walks away enters no space that was seen to be open: it lies behind.
    #[test]
    fn a_person_in_a_forest_is_reported_with_place_and_velocity(
        seed in 1..1_000u64, walks_mps in 0.6..2.5f64, heading_rad in 1.5..4.8f64,
        ahead_m in 3.0..6.0f64, flies_mps in 0.0..2.0f64, lidar in lidars(),
    ) {
        let middle_s = 3.0;
        // With few rays, who is slow or far is found when he is near: space opens later, and hits are few.
        let (walks_mps, ahead_m) =
            if lidar.range_max_m < 10.0 { (walks_mps.max(1.2), ahead_m.min(4.5)) } else { (walks_mps, ahead_m) };
        let walker = Walker {
            velocity_mps: Vector3::new(heading_rad.cos(), heading_rad.sin(), 0.0) * walks_mps,
            place_m: Vector3::new(flies_mps * middle_s + ahead_m, 0.0, -2.0),
            middle_s,
        };
        let near = |t_s: f64| {
            let away_m = (walker.at(t_s) - Vector3::new(flies_mps * t_s, 0.0, -2.0)).norm();
            (1.5..7.0).contains(&away_m)
        };
        let (mut frames, mut found, mut others) = (0, 0, 0);
        for (t_s, moving) in fly(seed, &lidar, flies_mps, Some(walker), middle_s + 1.0) {
            let place_m = walker.at(t_s);
            let is_walker = |away: Vector3<f64>| away.xy().norm() < 0.7;
            let its = moving.obstacles().iter().find(|one| is_walker(one.position.vector() - place_m));
            others += moving.obstacles().iter().filter(|one| !is_walker(one.position.vector() - place_m)).count();
            if t_s > 2.0 && near(t_s) {
                frames += 1;
                found += usize::from(its.is_some_and(|one| {
                    (one.velocity.vector() - walker.velocity_mps).xy().norm() < 0.6
                        && (0.2..0.9).contains(&one.radius_m)
                }));
            }
        }
        // A tree may hide it.
        prop_assert!(frames == 0 || found * 10 >= frames * 6, "{found} of {frames} frames");
        // Who is hidden by one is expected for 0.7 s where he no longer is.
        prop_assert!(others <= 10, "{others} others");
    }

    #[test]
    fn nothing_moves_in_a_forest_that_is_flown_through(
        seed in 1..1_000u64, flies_mps in 0.0..6.0f64, lidar in lidars(),
    ) {
        for (t_s, moving) in fly(seed, &lidar, flies_mps, None, 4.0) {
            prop_assert!(moving.obstacles().is_empty(), "at {t_s}: {:?}", moving.obstacles());
        }
    }
}
