//! Promises of the sensors that render range scans.

use super::*;

fn lidar() -> SensorSpec {
    SensorSpec::new("ring", SensorKind::Lidar2d)
}

fn ground() -> SensorSpec {
    SensorSpec::default_rig().remove(1)
}

/// Direction of a beam in the body.
fn direction(scan: &RangeScan, beam: usize) -> Vector3<f64> {
    let angle_rad = f64::from(scan.angle_first_rad) + beam as f64 * f64::from(scan.angle_step_rad);
    scan.mounting.rotation().unwrap() * Vector3::new(angle_rad.cos(), angle_rad.sin(), 0.0)
}

#[test]
fn every_beam_of_a_turn_reports_the_range_in_its_direction_at_its_time() {
    let (world, track) = (forest(7), swerving());
    let mut spec = lidar();
    spec.forward_m = 0.2;
    spec.yaw_deg = 30.0;
    let (mut errors, mut nothing) = (Vec::new(), 0);
    for scan in scans(&spec, 1, &world, &track, 0.7) {
        assert_eq!(scan.ranges().len(), 360);
        assert!((f64::from(scan.beam_interval_s) - 0.1 / 360.0).abs() < 1e-9);
        for (beam, range_m) in scan.ranges().iter().enumerate() {
            let time = scan
                .first_beam
                .plus_seconds(beam as f64 * f64::from(scan.beam_interval_s));
            let pose = track.at(time).unwrap();
            let ray = pose.attitude * direction(&scan, beam);
            let hit = world.cast(pose.to_local(scan.origin), &ray, 12.0);
            match hit {
                None => {
                    nothing += 1;
                    assert_eq!(*range_m, f32::INFINITY);
                }
                // Noise is cut off at the range.
                Some(hit) if hit.range_m < 11.9 => errors.push(f64::from(*range_m) - hit.range_m),
                Some(_) => assert!(*range_m <= 12.0),
            }
        }
    }
    let (mean, sigma) = mean_and_sigma(&errors);
    assert!(errors.len() > 300 && nothing > 300, "{} {nothing}", errors.len());
    assert!(
        mean.abs() < 0.002 && (0.009..0.011).contains(&sigma),
        "{mean} {sigma}"
    );
}

#[test]
fn beams_run_clockwise_from_behind_the_left_shoulder_round_to_it() {
    // A pole on the right.
    let world = scene(vec![pole(0.0, 5.0, 0.3)]);
    let scan = scans(&lidar(), 1, &world, &hover(5.0), 0.1)[0];
    let seen: Vec<usize> = (0..360).filter(|beam| scan.range_m[*beam].is_finite()).collect();
    assert!(
        !seen.is_empty() && seen.iter().all(|beam| (265..=275).contains(beam)),
        "{seen:?}"
    );
    assert!((direction(&scan, 0).x + 1.0).abs() < 1e-3 && direction(&scan, 0).y < 0.0);
}

#[test]
fn something_nearer_than_the_shortest_range_is_still_reported() {
    let mut spec = lidar();
    spec.range_min_m = Some(1.0);
    let scan = scans(&spec, 1, &scene(vec![wall(0.5)]), &hover(5.0), 0.1)[0];
    assert!((scan.range_m[180] - 0.5).abs() < 0.06);
    assert!(scan.range_m[180] < scan.range_min_m);
}

#[test]
fn the_rangefinder_measures_the_height_with_its_stated_noise() {
    let mut spec = ground();
    spec.rate_hz = Some(200.0);
    for height_m in [1.0, 2.5, 5.0] {
        let scans = scans(&spec, 1, &scene(Vec::new()), &hover(height_m), 20.0);
        let dropped = scans.iter().filter(|scan| scan.range_m[0].is_nan()).count();
        let heights: Vec<f64> = scans
            .iter()
            .map(|scan| f64::from(scan.range_m[0]))
            .filter(|range_m| !range_m.is_nan())
            .collect();
        let (mean, sigma) = mean_and_sigma(&heights);
        let stated_m = 0.02 + 0.01 * height_m;
        assert!((mean - height_m).abs() < 0.005, "{mean}");
        assert!((sigma / stated_m - 1.0).abs() < 0.06, "{sigma}");
        assert!((f64::from(scans[0].range_sigma_m) - stated_m).abs() < 1e-6);
        assert!((15..70).contains(&dropped), "{dropped} of {}", scans.len());
        assert_eq!((scans[0].beams, scans[0].angle_step_rad), (1, 0.0));
        assert!((f64::from(scans[0].beam_width_rad) - 27.0_f64.to_radians()).abs() < 1e-6);
        assert!((direction(&scans[0], 0) - Vector3::z()).norm() < 1e-9);
    }
}

#[test]
fn the_rangefinder_takes_the_nearest_in_its_cone_and_infinity_for_nothing() {
    let mut spec = ground();
    spec.dropout = Some(0.0);
    let range_m = |world: &World, track: &PoseTrack| scans(&spec, 1, world, track, 0.05)[0].range_m[0];
    let open = scene(Vec::new());
    assert_eq!(range_m(&open, &hover(8.5)), f32::INFINITY);
    // Rolled by 10 deg, the vertical is still inside the cone of 13.5 deg to each side; the rim ray is 3.5 deg off
    // it.
    let rolled = Pose {
        position: Point::new(0.0, 0.0, -4.0),
        attitude: UnitQuaternion::from_euler_angles(10.0_f64.to_radians(), 0.0, 0.0),
    };
    assert!((range_m(&open, &standing(rolled)) - 4.008).abs() < 0.25);
    // A crate beside the vertical, but inside the cone.
    let crate_ = Obstacle::Box(YawedBox::new(0.0, 0.85, 1.0, 1.0, 0.0, 3.0));
    assert!((range_m(&scene(vec![crate_]), &hover(5.0)) - 2.02).abs() < 0.16);
}
