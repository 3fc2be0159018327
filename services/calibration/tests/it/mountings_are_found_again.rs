//! Where a sensor is mounted is found again from what it measures, to half a degree and two centimetres; and where the scene does not
//! say it, nobody pretends to know.

use jink_calibration::{
    Axis, CalibrateError, Collector, Correction, MountingTable, Points, against_gravity, against_sensor,
    calibrate,
};
use jink_shared_types::frames::{Attitude, Velocity};
use jink_shared_types::ranges::{CloudPoint, PointCloud, RayKind};
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{Coded, Point, Timestamp};
use jink_simulated_world::random::Random;
use jink_simulated_world::sensors::{Output, Pose, PoseTrack, SensorKind, SensorRig, SensorSpec};
use jink_simulated_world::world::{Cylinder, Obstacle, Scene, World, WorldKind, YawedBox};
use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use proptest::prelude::*;

/// The vehicle's centre of gravity above the ground, standing (m).
const STANDS_M: f64 = 0.4;
const ANGLE_MAX_DEG: f64 = 0.5;
const DISTANCE_MAX_M: f64 = 0.02;

fn scene(obstacles: Vec<Obstacle>) -> World {
    World::new(Scene::of("test", obstacles))
}

fn wall(north_m: f64, east_m: f64, length_m: f64, width_m: f64) -> Obstacle {
    Obstacle::Box(YawedBox::new(north_m, east_m, length_m, width_m, 0.0, 4.0))
}

fn pole(north_m: f64, east_m: f64) -> Obstacle {
    Obstacle::Cylinder(Cylinder {
        north_m,
        east_m,
        radius_m: 0.2,
        top_m: 5.0,
    })
}

/// The corner of a building ahead, a crate, two trees.
fn yard() -> World {
    scene(vec![
        wall(7.0, 0.0, 1.0, 30.0),
        wall(0.0, 6.5, 14.0, 1.0),
        Obstacle::Box(YawedBox::new(4.0, -2.0, 1.2, 0.8, 0.6, 1.0)),
        pole(5.0, 2.5),
        pole(-4.0, -5.0),
    ])
}

/// A corner of a hall with its ceiling, a crate and two pillars: level and upright surfaces to all sides.
fn hall() -> World {
    let ceiling = YawedBox::new(-4.0, -4.0, 18.0, 18.0, 0.0, 3.4).raised(3.0);
    scene(vec![
        wall(3.5, -4.0, 0.4, 20.0),
        wall(-4.0, 2.4, 20.0, 0.4),
        Obstacle::Box(YawedBox::new(2.2, -0.9, 0.8, 0.6, 0.5, 0.7)),
        Obstacle::Box(ceiling),
        Obstacle::Box(YawedBox::new(2.0, 0.5, 0.5, 0.5, -0.6, 1.2)),
        pole(2.9, 1.4),
        pole(-3.0, -2.5),
    ])
}

/// Two walls along north.
fn corridor() -> World {
    scene(vec![wall(0.0, 3.0, 100.0, 0.4), wall(0.0, -3.0, 100.0, 0.4)])
}

fn bare_ground() -> World {
    scene(Vec::new())
}

fn product(name: &str, model: &str, kind: SensorKind) -> SensorSpec {
    SensorSpec {
        model: Some(model.to_owned()),
        ..SensorSpec::new(name, kind)
    }
}

/// By the names of their sets, mounted as on a vehicle.
fn sensor(name: &str) -> SensorSpec {
    let lidar = |model: &str| product(name, model, SensorKind::Lidar3d);
    match name {
        "mid360" => lidar("livox_mid360"),
        "os0" => lidar("ouster_os0"),
        "os1" => lidar("ouster_os1"),
        "vlp16" => lidar("vlp16"),
        "avia" => SensorSpec {
            forward_m: 0.12,
            range_min_m: Some(0.3),
            ..lidar("livox_avia")
        },
        "d435" => SensorSpec {
            forward_m: 0.1,
            ..product(name, "realsense_d435", SensorKind::DepthCamera)
        },
        "sphere" => SensorSpec {
            elevation_min_deg: Some(-90.0),
            elevation_max_deg: Some(90.0),
            ..SensorSpec::new(name, SensorKind::Lidar3d)
        },
        _ => panic!("no sensor {name}"),
    }
}

/// What the sensors see of `world` in a second in which the vehicle stands still, each moved by its error (true to configured).
fn seen(world: &World, pose: Pose, specs: &[(SensorSpec, Isometry3<f64>)], seed: u64) -> Vec<Points> {
    let mut points = vec![Points::default(); specs.len()];
    for (sensor, cloud) in clouds(world, pose, specs, seed) {
        points[sensor].add(&cloud, 0.35);
    }
    points
}

/// The clouds themselves, each with the number of its sensor.
fn clouds(
    world: &World,
    pose: Pose,
    specs: &[(SensorSpec, Isometry3<f64>)],
    seed: u64,
) -> Vec<(usize, Box<PointCloud>)> {
    let only: Vec<SensorSpec> = specs.iter().map(|(spec, _)| spec.clone()).collect();
    let mut rig = SensorRig::new(&only, seed).unwrap();
    let mut track = PoseTrack::new(1.0, 0.5);
    track.push(Timestamp::from_ns(1), pose);
    let mut clouds = Vec::new();
    rig.next_due(Timestamp::from_ns(1));
    let now = Timestamp::from_seconds(1.2);
    while let Some(frame) = rig.next_due(now) {
        assert_eq!(frame.output, Output::Cloud);
        let mut cloud = PointCloud::boxed();
        rig.render_cloud(&frame, world, &track, &mut cloud).unwrap();
        moved(&mut cloud, &specs[frame.sensor].1);
        clouds.push((frame.sensor, cloud));
    }
    clouds
}

/// As a wrong configuration would have placed the points.
fn moved(cloud: &mut PointCloud, by: &Isometry3<f64>) {
    cloud.origin = Point::from_vector((by * Point3::from(cloud.origin.vector())).coords);
    let count = cloud.len as usize;
    for point in &mut cloud.points[..count] {
        let place = by * Point3::new(point.forward_m, point.right_m, point.down_m).cast::<f64>();
        [point.forward_m, point.right_m, point.down_m] = [place.x, place.y, place.z].map(|part| part as f32);
    }
}

/// A turn about the sensor at `origin` and a shift.
fn error(origin: Point3<f64>, axis: [f64; 3], angle_deg: f64, shift_m: [f64; 3]) -> Isometry3<f64> {
    let axis = Unit::try_new(Vector3::from(axis), 1e-9).unwrap_or_else(Vector3::z_axis);
    let turn = UnitQuaternion::from_axis_angle(&axis, angle_deg.to_radians());
    let there = Translation3::from(origin.coords);
    Translation3::from(Vector3::from(shift_m)) * there * turn * there.inverse()
}

fn level() -> Pose {
    Pose::level(Point::new(0.0, 0.0, -STANDS_M), 0.0)
}

/// Angle (deg) and distance at the sensor (m) that are left when `correction` follows `error`.
fn left(correction: &Isometry3<f64>, error: &Isometry3<f64>, origin: Point3<f64>) -> (f64, f64) {
    let rest = correction * error;
    (
        rest.rotation.angle().to_degrees(),
        (rest * origin - origin).norm(),
    )
}

fn errors() -> impl Strategy<Value = ([f64; 3], f64, [f64; 3])> {
    let axis = proptest::array::uniform3(-1.0..1.0f64);
    let shift = proptest::array::uniform3(-1.0..1.0f64).prop_map(|shift| {
        let norm = Vector3::from(shift).norm().max(1.0);
        shift.map(|part| 0.3 * part / norm)
    });
    (axis, 0.0..20.0f64, shift)
}

/// The correction, and the angle (deg) and distance (m) that it leaves.
fn found(
    world: &World,
    names: [&str; 2],
    (axis, angle_deg, shift_m): ([f64; 3], f64, [f64; 3]),
    seed: u64,
) -> Result<(Correction, f64, f64), CalibrateError> {
    let specs = names.map(sensor);
    let origin = Point3::new(specs[1].forward_m, specs[1].right_m, specs[1].down_m);
    let wrong = error(origin, axis, angle_deg, shift_m);
    let [reference, sensor] = specs;
    let both = [(reference, Isometry3::identity()), (sensor, wrong)];
    let points = seen(world, level(), &both, seed);
    let correction = against_sensor(&points[0], &points[1], wrong * origin)?;
    let (deg, m) = left(&correction.body_t_configured, &wrong, origin);
    Ok((correction, deg, m))
}

fn found_again(world: &World, names: [&str; 2], error: ([f64; 3], f64, [f64; 3]), seed: u64) {
    let (correction, deg, m) =
        found(world, names, error, seed).unwrap_or_else(|problem| panic!("{names:?}, {error:?}: {problem}"));
    let is_right = deg < ANGLE_MAX_DEG && m < DISTANCE_MAX_M;
    assert!(
        is_right && correction.certainty.is_sure(),
        "{names:?}, {error:?}: left {deg} deg, {m} m: {correction:?}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn a_lidar_is_found_again_against_another_one_in_a_hall(
        error in errors(), seed in 0..1000u64,
        names in prop_oneof![Just(["os0", "mid360"]), Just(["os0", "vlp16"]), Just(["sphere", "os1"]), Just(["mid360", "os0"])],
    ) {
        found_again(&hall(), names, error, seed);
    }

    #[test]
    fn a_sensor_that_looks_ahead_is_found_again_against_one_that_looks_around_in_a_hall(
        error in errors(), seed in 0..1000u64,
        names in prop_oneof![Just(["os0", "d435"]), Just(["sphere", "d435"]), Just(["sphere", "avia"])],
    ) {
        found_again(&hall(), names, error, seed);
    }

    #[test]
    fn outdoors_what_is_called_sure_is_right(
        error in errors(), seed in 0..20u64, in_yard in any::<bool>(),
        names in prop_oneof![Just(["os0", "os1"]), Just(["os0", "mid360"]), Just(["mid360", "d435"]), Just(["mid360", "vlp16"])],
    ) {
        let world = if in_yard { yard() } else { World::generate(WorldKind::ALL[0].clone(), seed).unwrap() };
        if let Ok((correction, deg, m)) = found(&world, names, error, seed) {
            let is_right = deg < ANGLE_MAX_DEG && m < DISTANCE_MAX_M;
            prop_assert!(is_right || !correction.certainty.is_sure(), "left {deg} deg, {m} m: {correction:?}");
        }
    }

    #[test]
    fn a_single_sensor_is_levelled_by_the_ground(
        error in errors(), seed in 0..1000u64, roll_deg in -4.0..4.0f64, pitch_deg in -4.0..4.0f64, down_m in -0.2..0.1f64,
        name in prop_oneof![Just("os0"), Just("mid360"), Just("os1")],
    ) {
        let (axis, angle_deg, shift_m) = error;
        let mounted = SensorSpec { down_m: down_m - 0.4, ..sensor(name) };
        let origin = Point3::new(0.0, 0.0, mounted.down_m);
        // A turn about the vertical cannot be found: none is made.
        let wrong = self::error(origin, [axis[0], axis[1], 0.0], angle_deg, shift_m);
        let attitude = UnitQuaternion::from_euler_angles(roll_deg.to_radians(), pitch_deg.to_radians(), 1.0);
        let pose = Pose { attitude, ..level() };
        let points = seen(&yard(), pose, &[(mounted, wrong)], seed);
        let down = attitude.inverse() * Vector3::z();
        let ground = against_gravity(&points[0], &down).unwrap();
        let off = ground.turn * wrong.rotation * down;
        let deg = off.angle(&down).to_degrees();
        let expected_m = -(pose.to_local(Point::from_vector(origin.coords)).z_m);
        prop_assert!(deg < ANGLE_MAX_DEG, "left {deg} deg: {ground:?}");
        prop_assert!((ground.height_m - expected_m).abs() < DISTANCE_MAX_M, "{expected_m} m: {ground:?}");
        prop_assert!(ground.is_sure(), "{ground:?}");
    }
}

fn correction_in(world: &World) -> Result<Correction, CalibrateError> {
    let wrong = error(Point3::origin(), [0.3, 1.0, 0.2], 6.0, [0.1, 0.05, -0.1]);
    let specs = [(sensor("os0"), Isometry3::identity()), (sensor("os1"), wrong)];
    let points = seen(world, level(), &specs, 7);
    against_sensor(&points[0], &points[1], wrong * Point3::origin())
}

#[test]
fn in_a_corridor_the_place_along_it_is_not_claimed() {
    let correction = correction_in(&corridor()).unwrap();
    let certainty = &correction.certainty;
    assert!(!certainty.is_sure());
    assert!(certainty.unobservable.contains(&Axis::Forward), "{certainty:?}");
    assert_eq!(certainty.sigma[3], None);
    assert!(Axis::Forward.lacks().contains("turn the vehicle"));
}

#[test]
fn on_bare_ground_neither_heading_nor_place_are_claimed() {
    let correction = correction_in(&bare_ground()).unwrap();
    assert_eq!(
        correction.certainty.unobservable,
        [Axis::Yaw, Axis::Forward, Axis::Right],
        "{:?}",
        correction.certainty
    );
    assert!(!correction.certainty.is_sure());
}

#[test]
fn sensors_that_look_into_opposite_directions_have_nothing_in_common() {
    let back = SensorSpec {
        yaw_deg: 180.0,
        pitch_deg: 40.0,
        ..sensor("d435")
    };
    let specs = [
        (
            SensorSpec {
                pitch_deg: 40.0,
                ..sensor("avia")
            },
            Isometry3::identity(),
        ),
        (back, Isometry3::identity()),
    ];
    let points = seen(&yard(), level(), &specs, 3);
    let error = against_sensor(&points[0], &points[1], Point3::origin()).unwrap_err();
    assert!(
        matches!(
            error,
            CalibrateError::NoOverlap { .. } | CalibrateError::TooFewSurfaces { .. }
        ),
        "{error}"
    );
}

/// A state of a vehicle that moves at `speed_mps`.
fn state(speed_mps: f64) -> VehicleState {
    VehicleState {
        velocity: Velocity::new(speed_mps, 0.0, 0.0),
        attitude: Attitude::from_rotation(UnitQuaternion::identity()),
        ..VehicleState::default()
    }
}

/// A second of an OS0 and of a VLP-16 that is mounted 0.2 m higher and turned by 10 degrees against its table.
fn collected(world: &World, speed_mps: f64) -> Collector {
    let table = |name: &str| MountingTable {
        name: name.to_owned(),
        ..MountingTable::default()
    };
    let truly = SensorSpec {
        down_m: -0.2,
        yaw_deg: 10.0,
        ..sensor("vlp16")
    };
    // Its table says that it looks ahead at the vehicle's centre.
    let turn = UnitQuaternion::from_euler_angles(0.0, 0.0, 10f64.to_radians());
    let true_mounting = Isometry3::from_parts(Translation3::new(0.0, 0.0, -0.2), turn);
    let mut collector = Collector::new([table("os0"), table("vlp16")]);
    let specs = [
        (sensor("os0"), Isometry3::identity()),
        (truly, true_mounting.inverse()),
    ];
    for (sensor, cloud) in clouds(world, level(), &specs, 11) {
        collector.cloud(&specs[sensor].0.name, &cloud, 0.35);
    }
    for _ in 0..50 {
        collector.still.take(&state(speed_mps));
    }
    collector
}

#[test]
fn what_is_sure_comes_with_keys_to_copy_and_what_is_not_says_what_is_missing() {
    let calibrated = calibrate(&collected(&hall(), 0.0), None, None);
    let mounting = &calibrated.figures["vlp16"]["relative"]["mounting"];
    assert_eq!(
        calibrated.figures["vlp16"]["against"], "os0",
        "the one with the larger field of view"
    );
    assert!(
        (mounting["down_m"].as_f64().unwrap() + 0.2).abs() < DISTANCE_MAX_M,
        "{mounting}"
    );
    assert!(
        (mounting["yaw_deg"].as_f64().unwrap() - 10.0).abs() < ANGLE_MAX_DEG,
        "{mounting}"
    );
    let row = calibrated.rows.split("# vlp16, against os0\n").nth(1).unwrap();
    let keys: Vec<&str> = row
        .lines()
        .take(6)
        .filter_map(|line| line.split(" = ").next())
        .collect();
    assert_eq!(
        keys,
        [
            "forward_m",
            "right_m",
            "down_m",
            "yaw_deg",
            "pitch_deg",
            "roll_deg"
        ]
    );

    let unsure = calibrate(&collected(&corridor(), 0.0), Some("os0"), None);
    assert!(!unsure.rows.contains("against os0"), "{}", unsure.rows);
    let remedy = |text: &str| unsure.findings.iter().any(|one| one.remedy.contains(text));
    assert!(remedy("turn the vehicle"), "{:?}", unsure.findings);

    let moving = calibrate(&collected(&hall(), 1.0), None, None);
    assert!(moving.rows.is_empty() && moving.findings[0].is.contains("moved"));
    let nobody = calibrate(&collected(&hall(), 0.0), Some("top"), None);
    assert!(nobody.rows.is_empty() && nobody.findings[0].is.contains("os0, vlp16"));
}

#[test]
fn garbage_and_emptiness_are_refused_with_numbers() {
    let mut random = Random::new(5, 0);
    let mut noise = Points::default();
    let mut broken = Points::default();
    let mut cloud = PointCloud::boxed();
    for number in 0..20_000 {
        let far = random.unit() * 20.0;
        let direction = Vector3::new(random.normal(), random.normal(), random.normal()).normalize() * far;
        cloud.push(CloudPoint {
            forward_m: direction.x as f32,
            right_m: direction.y as f32,
            down_m: direction.z as f32,
            kind: Coded::new(RayKind::Hit),
            ..CloudPoint::default()
        });
        let worst = [f32::NAN, f32::INFINITY, f32::MAX, -f32::MAX][number % 4];
        if number % 2 == 0 {
            cloud.points[number].right_m = worst;
        }
    }
    broken.add(&cloud, 0.3);
    for point in &mut cloud.points[..20_000] {
        if point.right_m.is_nan() || point.right_m.abs() > 50.0 {
            point.right_m = 1.0;
        }
    }
    noise.add(&cloud, 0.3);
    let good = &seen(&yard(), level(), &[(sensor("os0"), Isometry3::identity())], 1)[0];
    for points in [&noise, &broken, &Points::default()] {
        let error = against_sensor(good, points, Point3::origin());
        let is_refused = error.as_ref().map_or(true, |found| !found.certainty.is_sure());
        assert!(is_refused, "{error:?}");
        let other = against_sensor(points, good, Point3::origin());
        assert!(other.map_or(true, |found| !found.certainty.is_sure()));
    }
    assert_eq!(
        against_sensor(good, &Points::default(), Point3::origin()),
        Err(CalibrateError::TooFewSurfaces { have: 0, need: 40 })
    );
    assert_eq!(
        against_gravity(&Points::default(), &Vector3::z()),
        Err(CalibrateError::NoGround)
    );
    assert_eq!(
        against_gravity(good, &Vector3::zeros()),
        Err(CalibrateError::NoGround)
    );
    let mut nan = PointCloud::boxed();
    nan.origin = Point::new(f64::NAN, 0.0, 0.0);
    noise.add(&nan, 0.3);
    assert!(noise.origin().x.is_finite());
}
