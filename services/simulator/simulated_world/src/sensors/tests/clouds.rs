//! Promises of the sensors that render point clouds.

use super::*;
use std::time::Instant;

fn lidar() -> SensorSpec {
    SensorSpec::new("lidar", SensorKind::Lidar3d)
}

fn camera() -> SensorSpec {
    SensorSpec::new("camera", SensorKind::DepthCamera)
}

fn hits(cloud: &PointCloud) -> impl Iterator<Item = &CloudPoint> {
    cloud.points().iter().filter(|p| p.kind == RayKind::Hit)
}

#[test]
fn lidar_noise_has_the_stated_sigma_along_the_ray() {
    let (world, track) = (forest(2), swerving());
    let clouds = clouds(&lidar(), 1, &world, &track, 0.5);
    let errors: Vec<f64> = clouds
        .iter()
        .flat_map(|cloud| hits(cloud).map(|p| truth_m(&world, &track, cloud, p)))
        // At the end of the range the noise is cut off; at silhouettes the stored direction may just miss.
        .filter_map(|(truth, measured)| Some(measured - truth.filter(|t| *t < 11.8)?))
        .filter(|error| error.abs() < 0.2)
        .collect();
    let (mean, sigma) = mean_and_sigma(&errors);
    assert!(errors.len() > 30_000);
    assert!(mean.abs() < 0.0005, "{mean}");
    assert!((sigma / 0.02 - 1.0).abs() < 0.02, "{sigma}");
    assert_eq!(clouds[0].range_sigma_m, 0.02);
}

#[test]
fn camera_noise_grows_with_the_square_of_the_depth() {
    for depth_m in [1.0, 2.0, 3.0] {
        let world = scene(vec![wall(depth_m)]);
        let mut spec = camera();
        spec.fov_horizontal_deg = Some(30.0);
        spec.fov_vertical_deg = Some(30.0);
        let clouds = clouds(&spec, 1, &world, &hover(20.0), 0.5);
        let depths: Vec<f64> = clouds
            .iter()
            .flat_map(|cloud| hits(cloud).map(|p| f64::from(p.forward_m)))
            .collect();
        let (mean, sigma) = mean_and_sigma(&depths);
        assert!(depths.len() > 100_000);
        assert!((mean - depth_m).abs() < 0.001, "{mean}");
        assert!(
            (sigma / (0.005 * depth_m * depth_m) - 1.0).abs() < 0.02,
            "{sigma}"
        );
    }
}

#[test]
fn no_point_lies_below_the_ground_beyond_noise() {
    let (world, track) = (forest(4), swerving());
    for spec in [lidar(), camera()] {
        for cloud in clouds(&spec, 2, &world, &track, 0.5) {
            let sigma_m = f64::from(cloud.range_sigma_m);
            for point in hits(&cloud) {
                let local = track.at(time_of(&cloud, point)).unwrap().to_local(body(point));
                assert!(world.height_above_ground_m(local) > -6.0 * sigma_m, "{local:?}");
            }
        }
    }
}

#[test]
fn the_pose_at_each_points_own_time_removes_the_distortion() {
    let (world, track) = (forest(5), swerving());
    let (mut points, mut good, mut good_with_one_pose) = (0, 0, 0);
    for cloud in clouds(&lidar(), 3, &world, &track, 0.5) {
        let end = track
            .at(Timestamp::from_ns(cloud.first_point.ns + 100_000_000))
            .unwrap();
        for point in hits(&cloud) {
            let own = track.at(time_of(&cloud, point)).unwrap().to_local(body(point));
            // The ground looks the same from everywhere: only trees show the distortion.
            if world.height_above_ground_m(own) < 0.3 {
                continue;
            }
            points += 1;
            let off_m = |at| world.clearance_to_obstacles_m(at).abs();
            assert!(off_m(own) < 0.12, "six sigma: {}", off_m(own));
            good += u32::from(off_m(own) < 0.08);
            good_with_one_pose += u32::from(off_m(end.to_local(body(point))) < 0.08);
        }
    }
    assert!(points > 5_000, "{points}");
    assert!(f64::from(good) > 0.999 * f64::from(points), "{good} of {points}");
    assert!(
        f64::from(good_with_one_pose) < 0.5 * f64::from(points),
        "{good_with_one_pose} of {points}"
    );
}

#[test]
fn clear_means_clear_up_to_the_range_and_unknown_says_nothing() {
    let (world, track) = (forest(6), swerving());
    let mut near_blind = lidar();
    near_blind.range_min_m = Some(4.0);
    let mut holed = lidar();
    holed.dropout = Some(0.1);
    for (spec, unknown) in [
        (lidar(), 0.0..0.001),
        (near_blind, 0.01..0.3),
        (holed, 0.09..0.11),
        (camera(), 0.005..0.1),
    ] {
        for cloud in clouds(&spec, 4, &world, &track, 0.2) {
            let max_m = f64::from(cloud.range_max_m);
            let mut unknowns = 0;
            for point in cloud.points() {
                match point.kind.get() {
                    RayKind::Clear => {
                        let (truth, reported_m) = truth_m(&world, &track, &cloud, point);
                        assert!((reported_m - max_m).abs() < 1e-5);
                        // The stored direction has 32 bits: at a silhouette it may just meet what the ray missed.
                        let inside = truth.is_some() && {
                            let pose = track.at(time_of(&cloud, point)).unwrap();
                            let from = pose.to_local(cloud.origin).vector();
                            let to = pose.to_local(body(point)).vector();
                            let ray = (to - from).normalize();
                            let hit = world.cast(Point::from_vector(from), &ray, max_m).unwrap();
                            hit.incidence_cos > 0.01 && hit.range_m < max_m - 1e-4
                        };
                        assert!(!inside, "{point:?} {truth:?}");
                    }
                    RayKind::Hit => {
                        let (_, reported_m) = truth_m(&world, &track, &cloud, point);
                        assert!(reported_m <= max_m + 1e-5);
                    }
                    RayKind::Unknown => {
                        unknowns += 1;
                        assert_eq!((point.forward_m, point.right_m, point.down_m), (0.0, 0.0, 0.0));
                    }
                }
            }
            let share = f64::from(unknowns) / cloud.points().len() as f64;
            assert!(unknown.contains(&share), "{} {share}", spec.kind.name());
        }
    }
}

#[test]
fn the_lidar_pattern_covers_its_field_evenly_and_never_repeats() {
    let clouds = clouds(&lidar(), 1, &scene(Vec::new()), &hover(50.0), 0.2);
    let direction = |p: &CloudPoint| body(p).vector().normalize();
    let (low, high) = ((-45.0_f64).to_radians().sin(), 60.0_f64.to_radians().sin());
    let mut bins = vec![0_u32; 36 * 10];
    for point in clouds[0].points() {
        let d = direction(point);
        let up = (-d.z - low) / (high - low);
        assert!((-1e-6..=1.0 + 1e-6).contains(&up));
        let column = (d.y.atan2(d.x) / std::f64::consts::TAU + 0.5) * 36.0;
        bins[column.min(35.9) as usize * 10 + (up * 10.0).clamp(0.0, 9.9) as usize] += 1;
    }
    // 55.6 rays per bin on average; chance would leave some with fewer than 35.
    assert!(bins.iter().all(|count| (50..=61).contains(count)), "{bins:?}");
    let repeated = clouds[0]
        .points()
        .iter()
        .zip(clouds[1].points())
        .filter(|(a, b)| direction(a).dot(&direction(b)) > 0.999_99)
        .count();
    assert_eq!(repeated, 0);
    // The sweep fills its whole period.
    let offsets: Vec<u16> = clouds[0].points().iter().map(|p| p.offset_10us).collect();
    assert!(offsets.is_sorted() && offsets[0] == 0 && offsets[19_999] == 9_999);
}

#[test]
fn a_thin_pole_is_missed_as_often_as_reported_and_then_the_wall_behind_is_seen() {
    // At 10 m a beam of 1 deg is 17.5 cm wide; a pole of 4 cm fills 23 % of it.
    let world = scene(vec![pole(10.0, 0.0, 0.02), wall(11.0)]);
    let mut spec = lidar();
    spec.beam_width_deg = Some(1.0);
    spec.thin_miss = Some(0.8);
    spec.fov_horizontal_deg = Some(1.0);
    spec.elevation_min_deg = Some(-1.0);
    spec.elevation_max_deg = Some(1.0);
    let (mut missed, mut rays) = (0.0, 0.0);
    for cloud in clouds(&spec, 1, &world, &hover(5.0), 0.5) {
        for point in hits(&cloud) {
            if (f64::from(point.right_m) / f64::from(point.forward_m)).abs() < 0.0019 {
                rays += 1.0;
                missed += f64::from(u8::from(point.forward_m > 10.5));
            }
        }
    }
    let covered = 0.04 / (10.0 * 1.0_f64.to_radians());
    assert!(rays > 10_000.0);
    assert!(
        (missed / rays - 0.8 * (1.0 - covered)).abs() < 0.02,
        "{missed} of {rays}"
    );
}

#[test]
fn a_mounted_camera_looks_where_it_points_from_where_it_sits() {
    let mut spec = camera();
    spec.forward_m = 0.1;
    spec.right_m = 0.3;
    spec.yaw_deg = 90.0;
    spec.sigma_per_m = Some(0.0);
    spec.dropout = Some(0.0);
    // Heading east, so the camera looks south, and its place right of the body is south of it.
    let track = standing(Pose::level(
        Point::new(0.0, 0.0, -10.0),
        std::f64::consts::FRAC_PI_2,
    ));
    let world = scene(vec![Obstacle::Box(YawedBox::new(
        -2.8, 0.0, 1.0, 40.0, 0.0, 40.0,
    ))]);
    let cloud = &clouds(&spec, 1, &world, &track, 0.1)[0];
    assert_eq!(cloud.origin, Point::new(0.1, 0.3, 0.0));
    assert_eq!(cloud.points().len(), 160 * 120);
    // The wall's face stands 2.3 m south: 2 m before the camera, seen by all pixels within range.
    for point in hits(cloud) {
        assert!((f64::from(point.right_m) - 2.3).abs() < 1e-5);
        let local = track.at(time_of(cloud, point)).unwrap().to_local(body(point));
        assert!((local.x_m + 2.3).abs() < 1e-5);
    }
    assert_eq!(hits(cloud).count(), 160 * 120);
    // Rows run from the upper left: behind a camera looking right, left is forward.
    let first = cloud.points()[0];
    assert!(first.forward_m > 1.9 && first.down_m < -1.4);
}

#[test]
fn a_camera_loses_grazing_surfaces_and_blurs_depth_edges() {
    // A wall along the line of sight, 0.3 m to the right.
    let side = Obstacle::Box(YawedBox::new(5.0, 0.8, 40.0, 1.0, 0.0, 40.0));
    let mut spec = camera();
    spec.dropout = Some(0.0);
    let cloud = &clouds(&spec, 1, &scene(vec![side]), &hover(20.0), 0.1)[0];
    let share_known = |from_m: f32, to_m: f32| {
        let (mut seen, mut expected) = (0.0, 0.0);
        for (pixel, point) in cloud.points().iter().enumerate() {
            // Where the pixel's ray crosses the plane of the wall.
            let right = (2.0 * (pixel % 160) as f32 + 1.0) / 160.0 - 1.0;
            let down = ((2.0 * (pixel / 160) as f32 + 1.0) / 120.0 - 1.0) * 37.5_f32.to_radians().tan();
            let along_m = 0.3 / right;
            let range_m = along_m * (1.0 + right * right + down * down).sqrt();
            if (from_m..to_m).contains(&along_m) && range_m < 3.9 {
                expected += 1.0;
                seen += f32::from(u8::from(point.kind == RayKind::Hit));
                assert_ne!(point.kind, RayKind::Clear);
            }
        }
        seen / expected
    };
    assert_eq!(share_known(0.4, 0.9), 1.0);
    // From 2.5 m to 3.5 m the cosine of the incidence falls from 0.12 to 0.08: less than half of the pixels match.
    let far = share_known(2.5, 3.5);
    assert!((0.1..0.5).contains(&far), "{far}");

    // A pole before a wall: between them only what the edge mixes.
    let world = scene(vec![pole(1.5, 0.0, 0.2), wall(3.0)]);
    let between = |mixing| {
        let mut spec = camera();
        spec.edge_mixing = Some(mixing);
        spec.sigma_per_m = Some(0.0);
        let cloud = &clouds(&spec, 1, &world, &hover(5.0), 0.1)[0];
        hits(cloud).filter(|p| (1.6..2.9).contains(&p.forward_m)).count()
    };
    assert_eq!(between(0.0), 0);
    assert!((120..500).contains(&between(1.0)), "{}", between(1.0));
}

/// Prints what a frame costs; what it can fail on is an empty frame.
#[test]
fn frame_times_are_printed() {
    let (world, track) = (forest(1), swerving());
    for spec in [lidar(), camera()] {
        let mut rig = rig(&spec, 1);
        let due = frames(&mut rig, 0.5);
        let mut cloud = PointCloud::boxed();
        let mut ms: Vec<f64> = (0..40)
            .map(|repeat| {
                let before = Instant::now();
                rig.render_cloud(&due[repeat % due.len()], &world, &track, &mut cloud)
                    .unwrap();
                before.elapsed().as_secs_f64() * 1e3
            })
            .collect();
        ms.sort_by(f64::total_cmp);
        let rays = cloud.points().len();
        println!(
            "{}: {rays} rays, {} hits: min {:.2} ms, p50 {:.2} ms, p90 {:.2} ms, max {:.2} ms",
            spec.kind.name(),
            hits(&cloud).count(),
            ms[0],
            ms[20],
            ms[36],
            ms[39]
        );
        assert!(rays >= 19_200 && hits(&cloud).count() > 1_000);
    }
    let mut hit_count = 0;
    let before = Instant::now();
    for ray in 0..20_000_u32 {
        let azimuth = f64::from(ray) * 0.01;
        let sine = f64::from(ray % 100) * 0.01 - 0.6;
        let level = (1.0 - sine * sine).sqrt();
        let direction = Vector3::new(level * azimuth.cos(), level * azimuth.sin(), -sine);
        let origin = Point::<LocalNed>::new(30.0, 0.0, -2.5);
        hit_count += u32::from(world.cast(origin, &direction, 12.0).is_some());
    }
    println!(
        "20,000 casts alone: {:.2} ms",
        before.elapsed().as_secs_f64() * 1e3
    );
    assert!(hit_count > 5_000);
}

/// What the rays of `spec` say of nothing in the world but a wall of this reflectivity's seed, `wall_m` ahead.
fn kinds(spec: &SensorSpec, world: &World) -> [usize; 3] {
    let mut counts = [0; 3];
    for cloud in clouds(spec, 1, world, &hover(20.0), 0.3) {
        for point in cloud.points() {
            match point.kind.get() {
                RayKind::Hit => counts[0] += 1,
                RayKind::Clear => counts[1] += 1,
                _ => counts[2] += 1,
            }
        }
    }
    counts
}

#[test]
fn a_product_says_of_the_sky_nothing_and_of_what_is_beyond_its_range_that_nothing_is_nearer() {
    let mut mid360 = lidar();
    mid360.model = Some("livox_mid360".to_owned());
    mid360.elevation_min_deg = Some(1.0);
    let [hits, clear, unknown] = kinds(&mid360, &scene(Vec::new()));
    assert!(
        clear == 0 && unknown > 50_000 && hits * 1_000 < unknown,
        "{hits} {clear} {unknown}"
    );
    mid360.no_return = Some(NoReturn::Clear);
    let [hits, clear, unknown] = kinds(&mid360, &scene(Vec::new()));
    assert!(
        unknown == 0 && clear > 50_000 && hits * 1_000 < clear,
        "{hits} {clear} {unknown}"
    );
    // The wall answers from 15 m, beyond the 10 m of the table.
    let mut d435 = camera();
    d435.model = Some("realsense_d435".to_owned());
    d435.fov_horizontal_deg = Some(30.0);
    d435.fov_vertical_deg = Some(30.0);
    let [hits, clear, unknown] = kinds(&d435, &scene(vec![wall(15.0)]));
    assert!(hits == 0 && clear > 40 * unknown, "{hits} {clear} {unknown}");
    let [hits, clear, unknown] = kinds(&d435, &scene(vec![wall(25.0)]));
    assert!(
        hits == 0 && clear == 0 && unknown > 10_000,
        "too far even for that: {hits} {clear} {unknown}"
    );
}

#[test]
fn who_stands_on_open_ground_sees_it() {
    let world = scene(Vec::new());
    for (spec, model) in [
        (lidar(), "livox_mid360"),
        (lidar(), "vlp16"),
        (camera(), "realsense_d435"),
    ] {
        let spec = SensorSpec {
            model: Some(model.to_owned()),
            ..spec
        };
        for cloud in clouds(&spec, 1, &world, &hover(0.0), 0.3) {
            let near = hits(&cloud).filter(|point| (0.1..0.2).contains(&point.down_m));
            assert!(near.count() > 100, "{model}");
        }
    }
}

#[test]
fn dark_things_answer_from_near_only() {
    let mut ld19 = SensorSpec::new("scan", SensorKind::Lidar3d);
    ld19.model = Some("livox_mid360".to_owned());
    ld19.fov_horizontal_deg = Some(10.0);
    ld19.elevation_min_deg = Some(-2.0);
    ld19.elevation_max_deg = Some(2.0);
    let seen = |wall_m: f64, dark: bool| {
        // Of many walls the seed paints some dark.
        let is_dark = |world: &World| world.reflectivity(Target::Obstacle(0)) < 0.1;
        let world = (0..200)
            .map(|seed| seeded_scene(seed, vec![wall(wall_m)]))
            .find(|world| is_dark(world) == dark)
            .unwrap();
        let [hits, _, unknown] = kinds(&ld19, &world);
        hits > unknown
    };
    assert!(seen(10.0, true) && seen(10.0, false) && seen(25.0, false));
    assert!(!seen(25.0, true), "70 m times the root of 0.05 / 0.8 is 17.5 m");
}

#[test]
fn who_turns_quickly_gets_a_smeared_image() {
    let mut d435 = camera();
    d435.model = Some("realsense_d435".to_owned());
    let world = scene(vec![wall(3.0)]);
    let matched = |rate_rad_s: f64| {
        let mut track = PoseTrack::new(2.0, 0.001);
        for ms in 0..600_u32 {
            let yaw_rad = (f64::from(ms) * 1e-3 - 0.3) * rate_rad_s;
            let attitude = UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad);
            let position = Point::new(0.0, 0.0, -1.5);
            track.push(
                Timestamp::from_ns(1_000_000_000 + u64::from(ms) * 1_000_000),
                Pose { position, attitude },
            );
        }
        let clouds = clouds(&d435, 1, &world, &track, 0.4);
        let points = clouds.iter().flat_map(|cloud| cloud.points());
        let [known, all] = points.fold([0, 0], |[known, all], point| {
            [known + usize::from(point.kind != RayKind::Unknown), all + 1]
        });
        f64::from(known as u32) / f64::from(all as u32)
    };
    let (still, turning) = (matched(0.0), matched(2.0));
    // 8 ms at 2 rad/s are 0.016 of the 0.036 rad at which nothing is matched.
    assert!(
        (1.0 - turning / still - 0.016 / 0.036).abs() < 0.05,
        "{still} {turning}"
    );
}
