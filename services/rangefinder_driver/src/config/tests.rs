use super::{Mistake, RangefinderSpec, SensorTable};
use nalgebra::Vector3;

fn tables(text: &str) -> Vec<SensorTable> {
    let file: toml::Table = text.parse().unwrap();
    file["sensor"].clone().try_into().unwrap()
}

fn read(keys: &str) -> Result<RangefinderSpec, Mistake> {
    let text = format!(
        "[[sensor]]\nname = \"lidar\"\nkind = \"lidar_3d\"\nrays = 7\n\
         [[sensor]]\nname = \"front\"\nkind = \"rangefinder\"\n{keys}"
    );
    RangefinderSpec::find(&tables(&text), "front")
}

const SHORT: &str = "model = \"tf_luna\"\ndevice = \"/dev/ttyS4\"\n";

#[test]
fn model_and_device_are_enough() {
    let spec = read(SHORT).unwrap();
    assert_eq!((spec.baud, spec.rate_hz), (115_200, 20.0));
    assert_eq!(
        (spec.reach.min_m, spec.reach.max_m, spec.reach.device_max_m),
        (0.2, 8.0, 8.0)
    );
    assert_eq!(spec.mounting.rotation().unwrap() * Vector3::x(), Vector3::x());
}

#[test]
fn everything_that_is_given_takes_effect() {
    let spec = read(
        "model = \"sf45b\"\ndevice = \"/dev/ttyUSB0\"\nbaud = 115200\nforward_m = 0.12\ndown_m = -0.05\norientation = 8\n\
         beam_width_deg = 1\nrange_max_m = 20\nsigma_m = 0.1\nrate_hz = 25\nscan_low_deg = -90\nscan_high_deg = 45.5\ndropout = 0.1\n",
    )
    .unwrap();
    assert_eq!((spec.position.x_m, spec.position.z_m), (0.12, -0.05));
    assert!((spec.mounting.rotation().unwrap() * Vector3::z() + Vector3::z()).norm() < 1e-12);
    assert_eq!((spec.reach.max_m, spec.reach.device_max_m), (20.0, 50.0));
    assert_eq!(
        (spec.scan.baud, spec.scan.low_deg, spec.scan.high_deg),
        (115_200, -90.0, 45.5)
    );
    assert_eq!(
        (spec.beam_width_rad, spec.sigma_m, spec.rate_hz),
        (1f64.to_radians(), 0.1, 25.0)
    );
}

#[test]
fn every_mistake_names_the_sensor_the_key_and_what_is_possible() {
    for (keys, reported) in [
        (
            "device = \"/dev/ttyS4\"\n",
            "sensor \"front\": `model` is missing; possible: sf45b, cm8jl65, tfmini, tfmini_s, tfmini_plus, tf_luna, sf11c, lw20c",
        ),
        (
            "model = \"tfluna\"\ndevice = \"/dev/ttyS4\"\n",
            "sensor \"front\": model = \"tfluna\" is not possible; possible: sf45b, cm8jl65, tfmini, tfmini_s, tfmini_plus, tf_luna, sf11c, lw20c",
        ),
        (
            "model = \"tf_luna\"\n",
            "sensor \"front\": `device` is missing; possible: the path of a serial port, e.g. \"/dev/ttyUSB0\"",
        ),
        (
            "model = \"tf_luna\"\ndevice = 4\n",
            "sensor \"front\": device = 4 is not possible; possible: the path of a serial port, e.g. \"/dev/ttyUSB0\"",
        ),
        (
            "model = \"tf_luna\"\ndevice = \"/dev/ttyS4\"\nbauds = 9600\n",
            "sensor \"front\": a rangefinder has no key `bauds`; did you mean `baud`?",
        ),
        (
            "model = \"tf_luna\"\ndevice = \"/dev/ttyS4\"\nbaud = \"fast\"\n",
            "sensor \"front\": baud = \"fast\" is not possible; possible: 9600 to 921600",
        ),
        (
            "model = \"tf_luna\"\ndevice = \"/dev/ttyS4\"\nrange_max_m = 12\n",
            "sensor \"front\": range_max_m = 12 is not possible; possible: 0.1 to 8",
        ),
        (
            "model = \"tf_luna\"\ndevice = \"/dev/ttyS4\"\nrange_min_m = 3\nrange_max_m = 2\n",
            "sensor \"front\": range_max_m = 2 is not possible; possible: more than range_min_m = 3, up to 8",
        ),
        (
            "model = \"tf_luna\"\ndevice = \"/dev/ttyS4\"\nscan_low_deg = -90\n",
            "sensor \"front\": a tf_luna has no scan_low_deg; sf45b has",
        ),
        (
            "model = \"sf45b\"\ndevice = \"/dev/ttyS4\"\nscan_high_deg = 170\n",
            "sensor \"front\": scan_high_deg = 170 is not possible; possible: 10 to 160",
        ),
        (
            "model = \"tf_luna\"\ndevice = \"/dev/ttyS4\"\norientation = \"left\"\nyaw_deg = 5\n",
            "sensor \"front\": orientation, yaw_deg with pitch_deg and roll_deg, and quaternion say the same: give one of them",
        ),
        (
            "model = \"tf_luna\"\ndevice = \"/dev/ttyS4\"\nquaternion = [1, 0, 0]\n",
            "sensor \"front\": quaternion = [1, 0, 0] is not possible; possible: [w, x, y, z], four numbers",
        ),
    ] {
        assert_eq!(read(keys).unwrap_err().to_string(), reported);
    }
    let reported = read(&format!("{SHORT}orientation = \"leftish\"\n"))
        .unwrap_err()
        .to_string();
    assert!(
        reported.contains("orientation = \"leftish\" is not possible; possible: forward (0), "),
        "{reported}"
    );
    assert!(reported.contains("down (25), custom (100)"), "{reported}");
}

#[test]
fn a_sensor_that_is_not_there_or_of_another_kind_is_reported_as_such() {
    let two = tables(
        "[[sensor]]\nname = \"lidar\"\nkind = \"lidar_3d\"\n[[sensor]]\nname = \"front\"\nkind = \"rangefinder\"\n",
    );
    let reported = |name| RangefinderSpec::find(&two, name).unwrap_err().to_string();
    assert_eq!(
        reported("rear"),
        "there is no sensor \"rear\"; the configuration has lidar, front"
    );
    assert_eq!(
        reported("lidar"),
        "sensor \"lidar\" is a lidar_3d; this driver is for the kind rangefinder"
    );
}
