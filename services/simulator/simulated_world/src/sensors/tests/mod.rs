//! Helpers for the promises of this module, then what concerns all kinds of sensor.

mod allocation;
mod clouds;
mod scans;
mod specs;

use super::*;
use crate::world::{Cylinder, Obstacle, Scene, Target, WorldKind, YawedBox};
use jink_shared_types::layout::Layout;
use jink_shared_types::ranges::{CloudPoint, RayKind};
use jink_shared_types::{BodyFrd, LocalNed, Point};
use nalgebra::{UnitQuaternion, Vector3};

fn forest(seed: u64) -> World {
    World::generate(WorldKind::ALL[0].clone(), seed).unwrap()
}

fn scene(obstacles: Vec<Obstacle>) -> World {
    seeded_scene(0, obstacles)
}

/// The same; the seed paints the obstacles and hangs the sun.
fn seeded_scene(seed: u64, obstacles: Vec<Obstacle>) -> World {
    World::new(Scene {
        seed,
        ..Scene::of("test", obstacles)
    })
}

/// A wall across north, its near face `north_m` away.
fn wall(north_m: f64) -> Obstacle {
    Obstacle::Box(YawedBox::new(north_m + 0.5, 0.0, 1.0, 200.0, 0.0, 100.0))
}

fn pole(north_m: f64, east_m: f64, radius_m: f64) -> Obstacle {
    Obstacle::Cylinder(Cylinder {
        north_m,
        east_m,
        radius_m,
        top_m: 10.0,
    })
}

fn hover(up_m: f64) -> PoseTrack {
    standing(Pose::level(Point::new(0.0, 0.0, -up_m), 0.0))
}

fn standing(pose: Pose) -> PoseTrack {
    let mut track = PoseTrack::new(1.0, 0.5);
    track.push(Timestamp::from_ns(1), pose);
    track
}

/// From 1 s on: 6 m/s, climbing, turning at 2 rad/s, swinging in roll; a pose every 4 ms.
fn swerving() -> PoseTrack {
    let mut track = PoseTrack::new(1.0, 0.004);
    for step in 0..200_u32 {
        let t = f64::from(step) * 0.004;
        let pose = Pose {
            position: Point::new(6.0 * t, 0.5 * (4.0 * t).sin(), -2.5 - 0.5 * t),
            attitude: UnitQuaternion::from_euler_angles(0.3 * (9.0 * t).sin(), -0.2, 2.0 * t),
        };
        track.push(Timestamp::from_seconds(1.0 + t), pose);
    }
    track
}

fn rig(spec: &SensorSpec, seed: u64) -> SensorRig {
    SensorRig::new(std::slice::from_ref(spec), seed).unwrap()
}

/// The frames of the first `seconds` after 1 s.
fn frames(rig: &mut SensorRig, seconds: f64) -> Vec<Frame> {
    let mut frames = Vec::new();
    for step in 0..=(seconds * 250.0).round() as u64 {
        while let Some(frame) = rig.next_due(Timestamp::from_ns(1_000_000_000 + 4_000_000 * step)) {
            frames.push(frame);
        }
    }
    frames
}

fn clouds(
    spec: &SensorSpec,
    seed: u64,
    world: &World,
    track: &PoseTrack,
    seconds: f64,
) -> Vec<Box<PointCloud>> {
    let mut rig = rig(spec, seed);
    frames(&mut rig, seconds)
        .iter()
        .map(|frame| {
            let mut cloud = PointCloud::boxed();
            rig.render_cloud(frame, world, track, &mut cloud).unwrap();
            assert!(cloud.is_plausible(), "{cloud:?}");
            cloud
        })
        .collect()
}

fn scans(spec: &SensorSpec, seed: u64, world: &World, track: &PoseTrack, seconds: f64) -> Vec<RangeScan> {
    let mut rig = rig(spec, seed);
    frames(&mut rig, seconds)
        .iter()
        .map(|frame| {
            let mut scan = RangeScan::default();
            rig.render_scan(frame, world, track, &mut scan).unwrap();
            assert!(scan.is_plausible(), "{scan:?}");
            scan
        })
        .collect()
}

fn body(point: &CloudPoint) -> Point<BodyFrd> {
    Point::new(
        f64::from(point.forward_m),
        f64::from(point.right_m),
        f64::from(point.down_m),
    )
}

fn time_of(cloud: &PointCloud, point: &CloudPoint) -> Timestamp {
    Timestamp::from_ns(cloud.first_point.ns + u64::from(point.offset_10us) * 10_000)
}

/// What the world has in the direction of a point, from the pose at the point's own time (m); and the measured
/// range.
fn truth_m(world: &World, track: &PoseTrack, cloud: &PointCloud, point: &CloudPoint) -> (Option<f64>, f64) {
    let pose = track.at(time_of(cloud, point)).unwrap();
    let origin = pose.to_local(cloud.origin);
    let ray = pose.to_local(body(point)).vector() - origin.vector();
    let hit = world.cast(origin, &ray.normalize(), f64::from(cloud.range_max_m));
    (hit.map(|hit| hit.range_m), ray.norm())
}

fn mean_and_sigma(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let square = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
    (mean, square.sqrt())
}

#[test]
fn frames_follow_each_other_without_gap_at_their_rate() {
    let mut camera = SensorSpec::new("camera", SensorKind::DepthCamera);
    camera.rate_hz = Some(30.0);
    let mut specs = SensorSpec::default_rig();
    specs.push(camera);
    let mut rig = SensorRig::new(&specs, 1).unwrap();
    assert_eq!(rig.len(), 3);
    assert_eq!(rig.name(1), Some("ground"));
    assert_eq!(rig.longest_frame_s(), 0.1);
    assert_eq!(
        rig.outputs()
            .map(|(name, output, rate_hz)| (name, output, rate_hz.round()))
            .collect::<Vec<_>>(),
        [
            ("lidar", Output::Cloud, 10.0),
            ("ground", Output::Scan, 20.0),
            ("camera", Output::Cloud, 30.0)
        ]
    );
    let all = frames(&mut rig, 10.0);
    assert!(all.windows(2).all(|pair| pair[0].end <= pair[1].end));
    for (sensor, count, period_ns) in [(0, 100, 100_000_000), (1, 200, 50_000_000), (2, 299, 33_333_333)] {
        let own: Vec<_> = all.iter().filter(|frame| frame.sensor == sensor).collect();
        assert_eq!(own.len(), count);
        let first_begin_ns = 1_000_000_000_u64.next_multiple_of(period_ns);
        assert_eq!(own[0].end.ns, first_begin_ns + period_ns);
        for pair in own.windows(2) {
            assert_eq!(pair[1].end.ns_since(pair[0].end), period_ns);
            // Only a sweep takes time.
            let begin = if sensor == 0 { pair[0].end } else { pair[1].end };
            assert_eq!(pair[1].begin, begin);
        }
    }
}

#[test]
fn rigs_switched_on_at_different_times_measure_the_same_frames() {
    let (mut one, mut other) = (
        SensorRig::new(&SensorSpec::default_rig(), 1).unwrap(),
        SensorRig::new(&SensorSpec::default_rig(), 1).unwrap(),
    );
    let (mut early, mut late) = (Vec::new(), Vec::new());
    for step in 0..1_000u64 {
        let now = Timestamp::from_ns(1_000_000_000 + 4_000_000 * step);
        early.extend(std::iter::from_fn(|| one.next_due(now)));
        if step >= 333 {
            late.extend(std::iter::from_fn(|| other.next_due(now)));
        }
    }
    assert!(late.len() > 70);
    assert!(late.iter().all(|frame| early.contains(frame)));
}

#[test]
fn a_wrong_request_is_refused_and_changes_nothing() {
    let mut rig = SensorRig::new(&SensorSpec::default_rig(), 1).unwrap();
    let due = frames(&mut rig, 0.1);
    let (ground, lidar) = (due[0], due[1]);
    assert_eq!((ground.sensor, lidar.sensor), (1, 0));
    let (world, track) = (forest(1), hover(2.5));
    let (mut cloud, mut scan) = (PointCloud::boxed(), RangeScan::default());
    assert_eq!(
        rig.render_cloud(&ground, &world, &track, &mut cloud),
        Err(RenderError::OtherOutput {
            sensor: 1,
            kind: SensorKind::Rangefinder
        })
    );
    assert_eq!(
        rig.render_scan(&lidar, &world, &track, &mut scan),
        Err(RenderError::OtherOutput {
            sensor: 0,
            kind: SensorKind::Lidar3d
        })
    );
    let foreign = Frame { sensor: 7, ..ground };
    assert_eq!(
        rig.render_scan(&foreign, &world, &track, &mut scan),
        Err(RenderError::NoSuchSensor {
            sensor: 7,
            sensors: 2
        })
    );
    let empty = PoseTrack::new(1.0, 0.1);
    assert_eq!(
        rig.render_cloud(&lidar, &world, &empty, &mut cloud),
        Err(RenderError::NoPose)
    );
    assert!(cloud.points().is_empty() && scan.ranges().is_empty());
}

#[test]
fn a_seed_gives_the_same_measurements_to_the_bit() {
    let (world, track) = (forest(3), swerving());
    for kind in [SensorKind::Lidar3d, SensorKind::DepthCamera] {
        let spec = SensorSpec::new("eye", kind);
        let render = |seed| clouds(&spec, seed, &world, &track, 0.3);
        let bits = |clouds: &[Box<PointCloud>]| -> Vec<[u32; 3]> {
            clouds
                .iter()
                .flat_map(|cloud| cloud.points())
                .map(|p| [p.forward_m.to_bits(), p.right_m.to_bits(), p.down_m.to_bits()])
                .collect()
        };
        assert_eq!(bits(&render(5)), bits(&render(5)));
        assert_ne!(bits(&render(5)), bits(&render(6)));
    }
    for kind in [SensorKind::Lidar2d, SensorKind::Rangefinder] {
        let spec = SensorSpec::new("eye", kind);
        let bits = |seed| -> Vec<u32> {
            scans(&spec, seed, &world, &track, 0.5)
                .iter()
                .flat_map(|scan| scan.range_m.map(f32::to_bits))
                .collect()
        };
        assert_eq!(bits(5), bits(5));
        assert_ne!(bits(5), bits(6));
    }
}

#[test]
fn another_sensor_in_the_rig_leaves_the_first_alone() {
    let (world, track) = (forest(3), swerving());
    let own = SensorSpec::new("eye", SensorKind::Lidar3d);
    let alone = clouds(&own, 4, &world, &track, 0.1);
    let mut rig = SensorRig::new(&[SensorSpec::new("other", SensorKind::DepthCamera), own], 4).unwrap();
    let mut cloud = PointCloud::boxed();
    for frame in frames(&mut rig, 0.1) {
        rig.render_cloud(&frame, &world, &track, &mut cloud).unwrap();
    }
    assert_eq!(cloud.points(), alone[0].points());
}

#[test]
fn a_sweep_measured_on_the_way_is_the_sweep_measured_at_its_end() {
    let world = forest(3);
    let (whole_track, mut track) = (swerving(), PoseTrack::new(0.3, 0.004));
    let mut rigs = [(); 2].map(|()| rig(&SensorSpec::new("eye", SensorKind::Lidar3d), 5));
    let mut sweeps = [(); 2].map(|()| PointCloud::boxed());
    let mut compared = 0;
    for step in 0..100 {
        let now = Timestamp::from_ns(1_000_000_000 + 4_000_000 * step);
        track.push(now, whole_track.at(now).unwrap());
        for (number, rig) in rigs.iter_mut().enumerate() {
            while let Some(frame) = rig.next_due(now) {
                rig.render_cloud(&frame, &world, &track, &mut sweeps[number])
                    .unwrap();
            }
        }
        assert_eq!(sweeps[0].points(), sweeps[1].points());
        compared += sweeps[0].points().len();
        // Now and then it is busy with something else.
        if step % 7 != 3 {
            rigs[0].advance(now, &world, &track);
        }
    }
    assert!(compared > 0);
}
