//! Promises about the configuration. JSON stands in for TOML: both go through the same `Deserialize`.

use super::*;
use serde_json::json;

fn parse(value: serde_json::Value) -> Result<SensorSpec, serde_json::Error> {
    serde_json::from_value(value)
}

fn validate(spec: &SensorSpec) -> Result<(), SensorError> {
    SensorRig::new(std::slice::from_ref(spec), 1).map(drop)
}

#[test]
fn name_and_kind_are_enough() {
    for (text, kind) in [
        ("lidar_3d", SensorKind::Lidar3d),
        ("depth_camera", SensorKind::DepthCamera),
        ("lidar_2d", SensorKind::Lidar2d),
        ("rangefinder", SensorKind::Rangefinder),
    ] {
        let spec = parse(json!({"name": "front", "kind": text})).unwrap();
        assert_eq!(spec, SensorSpec::new("front", kind));
        assert_eq!(validate(&spec), Ok(()));
        assert_eq!(kind.name(), text);
    }
}

#[test]
fn options_take_effect_whole_numbers_too() {
    let spec = parse(json!({
        "name": "lidar", "kind": "lidar_3d", "rate_hz": 20, "range_max_m": 8, "rays": 500, "down_m": -0.1, "seed": 3
    }))
    .unwrap();
    let mut rig = rig(&spec, 1);
    assert_eq!(rig.longest_frame_s(), 0.05);
    let due = frames(&mut rig, 0.05);
    let mut cloud = PointCloud::boxed();
    rig.render_cloud(&due[0], &forest(1), &hover(2.5), &mut cloud)
        .unwrap();
    assert_eq!(
        (cloud.points().len(), cloud.range_max_m, cloud.origin.z_m),
        (500, 8.0, -0.1)
    );
}

#[test]
fn the_configuration_of_a_real_depth_camera_is_rendered_with_as_many_points_as_its_driver_makes() {
    let real = |keys: serde_json::Value| {
        let mut table = json!({
            "name": "front", "kind": "depth_camera", "model": "realsense_d435", "device": "/dev/video0",
            "width_px": 848, "height_px": 480, "depth_scale_m": 0.001, "border_px": 4, "flying_pixel_per_m": 0.02,
            "fx_px": 425, "fy_px": 425, "cx_px": 423.5, "cy_px": 239.5, "k1": 0, "k2": 0, "p1": 0, "p2": 0, "k3": 0
        });
        table
            .as_object_mut()
            .unwrap()
            .extend(keys.as_object().unwrap().clone());
        let mut rig = rig(&parse(table).unwrap(), 1);
        let due = frames(&mut rig, 0.1);
        let mut cloud = PointCloud::boxed();
        rig.render_cloud(&due[0], &forest(1), &hover(2.5), &mut cloud)
            .unwrap();
        cloud.points().len()
    };
    assert_eq!(real(json!({})), 169 * 96);
    assert_eq!(real(json!({"bin_px": 8})), 106 * 60);
}

#[test]
fn the_configuration_of_a_real_rangefinder_is_rendered_where_it_is_mounted() {
    let real = json!({
        "name": "front", "kind": "rangefinder", "model": "sf45b", "device": "/dev/ttyUSB0", "baud": 921600,
        "scan_low_deg": -90, "scan_high_deg": 90, "range_max_m": 20, "orientation": "left"
    });
    let spec = parse(real).unwrap();
    let turned = SensorSpec {
        yaw_deg: 270.0,
        ..SensorSpec::new("front", SensorKind::Rangefinder)
    };
    assert_eq!(spec.body_q_sensor(), turned.body_q_sensor());
    assert_eq!(validate(&spec), Ok(()));
    let by_code = SensorSpec {
        orientation: parse(json!({"name": "a", "kind": "lidar_2d", "orientation": 6}))
            .unwrap()
            .orientation,
        ..spec.clone()
    };
    assert_eq!(by_code.body_q_sensor(), spec.body_q_sensor());
    for (change, said) in [
        (
            json!("leftish"),
            "sensor \"front\": orientation is one of forward (0), ",
        ),
        (json!(25), ""),
    ] {
        let orientation = parse(json!({"name": "a", "kind": "lidar_2d", "orientation": change}))
            .unwrap()
            .orientation;
        let spec = SensorSpec {
            orientation,
            ..spec.clone()
        };
        let error = validate(&spec)
            .err()
            .map(|error| error.to_string())
            .unwrap_or_default();
        assert!(error.starts_with(said), "{error}");
        assert_eq!(error.is_empty(), said.is_empty());
    }
    let twice = SensorSpec { yaw_deg: 5.0, ..spec };
    assert!(
        validate(&twice)
            .unwrap_err()
            .to_string()
            .contains("give one of them")
    );
}

#[test]
fn unknown_keys_and_kinds_are_refused_by_name() {
    let error = parse(json!({"name": "a", "kind": "lidar_3d", "range": 5})).unwrap_err();
    assert!(error.to_string().contains("unknown field `range`"), "{error}");
    let error = parse(json!({"name": "a", "kind": "sonar"})).unwrap_err();
    assert!(error.to_string().contains("unknown variant `sonar`"), "{error}");
    let error = parse(json!({"kind": "lidar_3d"})).unwrap_err();
    assert!(error.to_string().contains("missing field `name`"), "{error}");
}

#[test]
fn every_wrong_number_is_refused_with_its_name_and_limits() {
    let refusal = |kind, change: &dyn Fn(&mut SensorSpec)| {
        let mut spec = SensorSpec::new("eye", kind);
        change(&mut spec);
        validate(&spec).err().map(|e| e.to_string()).unwrap_or_default()
    };
    use SensorKind::{DepthCamera, Lidar2d, Lidar3d, Rangefinder};
    let said = [
        refusal(Lidar3d, &|s| s.rate_hz = Some(1.0)),
        refusal(Lidar3d, &|s| s.rays = Some(0)),
        refusal(Lidar3d, &|s| s.sigma_m = Some(f64::NAN)),
        refusal(Lidar3d, &|s| s.elevation_min_deg = Some(70.0)),
        refusal(Lidar2d, &|s| s.beams = Some(2_000)),
        refusal(Lidar2d, &|s| s.range_min_m = Some(9.0)),
        refusal(Lidar2d, &|s| {
            s.range_min_m = Some(9.0);
            s.range_max_m = Some(8.0);
        }),
        refusal(DepthCamera, &|s| s.fov_horizontal_deg = Some(180.0)),
        refusal(DepthCamera, &|s| {
            s.width_px = Some(640);
            s.height_px = Some(480);
        }),
        refusal(Rangefinder, &|s| s.pitch_deg = f64::INFINITY),
        refusal(Rangefinder, &|s| s.rays = Some(9)),
        refusal(Rangefinder, &|s| s.name = "Ground!".to_owned()),
    ];
    assert_eq!(
        said,
        [
            "sensor \"eye\": rate_hz = 1 is not within 2 to 200",
            "sensor \"eye\": rays = 0 is not within 1 to 131072",
            "sensor \"eye\": sigma_m = NaN is not within 0 to 10",
            "sensor \"eye\": elevation_min_deg must be less than elevation_max_deg",
            "sensor \"eye\": beams = 2000 is not within 1 to 1024",
            "",
            "sensor \"eye\": range_min_m must be less than range_max_m",
            "sensor \"eye\": fov_horizontal_deg = 180 is not within 1 to 170",
            "sensor \"eye\": 640 x 480 pixels are more than the 131072 points of a cloud",
            "sensor \"eye\": pitch_deg = inf is not within -360 to 360",
            "sensor \"eye\": a rangefinder has no rays",
            "\"Ground!\" is no name for a sensor: 1 to 16 of a-z, 0-9 and _",
        ]
    );
    let twice = [SensorSpec::new("a", Lidar3d), SensorSpec::new("a", Lidar2d)];
    let error = SensorRig::new(&twice, 1).unwrap_err();
    assert_eq!(error.to_string(), "two sensors are called \"a\"");
}
