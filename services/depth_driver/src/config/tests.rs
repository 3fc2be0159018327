use super::{DepthCameraSpec, SensorTable};
use crate::config_error::DepthConfigError;
use nalgebra::Vector3;

fn tables(text: &str) -> Vec<SensorTable> {
    let file: toml::Table = text.parse().unwrap();
    file["sensor"].clone().try_into().unwrap()
}

fn read(keys: &str) -> Result<DepthCameraSpec, DepthConfigError> {
    let text = format!(
        "[[sensor]]\nname = \"ground\"\nkind = \"rangefinder\"\nbaud = 7\n\
         [[sensor]]\nname = \"front\"\nkind = \"depth_camera\"\n{keys}"
    );
    DepthCameraSpec::find(&tables(&text), "front")
}

const SHORT: &str = "model = \"realsense_d435\"\ndevice = \"/dev/video0\"\n";
const ANY: &str = "model = \"z16\"\ndevice = \"/dev/video0\"\n";

#[test]
fn model_and_device_are_enough_for_a_realsense() {
    let spec = read(SHORT).unwrap();
    assert_eq!(
        (spec.size_px, spec.rate_hz, spec.depth_scale_m),
        ([848, 480], 15.0, 0.001)
    );
    assert_eq!((spec.bin_px, spec.points()), (5, 169 * 96));
    // 424 px / tan(43.5 deg) = 446.8 px: 446.8 * 0.05 m / 126 px, and 0.08 px / (446.8 px * 0.05 m).
    assert!((spec.range_m[0] - 0.1773).abs() < 1e-4 && spec.range_m[1] == 5.0);
    assert!((spec.sigma_per_m - 0.003_581).abs() < 1e-6);
    assert!((spec.flying_pixel_per_m - 9.0 / 446.8).abs() < 1e-5);
    assert_eq!(spec.mounting.rotation().unwrap() * Vector3::x(), Vector3::x());
}

#[test]
fn everything_that_is_given_takes_effect() {
    let spec = read(&format!(
        "{ANY}width_px = 320\nheight_px = 200\nrate_hz = 30\nfx_px = 300\nfy_px = 301.5\ncx_px = 160\ncy_px = 99.5\nk1 = 0.1\n\
         depth_scale_m = 0.0001\nrange_min_m = 0.3\nrange_max_m = 3\nsigma_per_m = 0.01\nflying_pixel_per_m = 0\nbin_px = 3\n\
         border_px = 10\nforward_m = 0.12\ndown_m = -0.05\norientation = \"down\"\ndropout = 0.1\nseed = 4\n"
    ))
    .unwrap();
    assert_eq!((spec.position.x_m, spec.position.z_m), (0.12, -0.05));
    assert!((spec.mounting.rotation().unwrap() * Vector3::x() - Vector3::z()).norm() < 1e-12);
    assert_eq!((spec.range_m, spec.depth_scale_m), ([0.3, 3.0], 0.0001));
    assert_eq!((spec.bins(), spec.border_px), ([100, 60], 10));
    assert_eq!((spec.sigma_per_m, spec.flying_pixel_per_m), (0.01, 0.0));
    // Column 160, row 199: on the axis to the right, (199 - 99.5) / 301.5 down, drawn inwards by the distortion.
    let [right, down] = spec.projection.slopes(199 * 320 + 160);
    assert!(right.abs() < 1e-6 && down < 0.3301 && down > 0.32, "{down}");
}

#[test]
fn a_field_of_view_stands_for_intrinsics() {
    let keys = "width_px = 100\nheight_px = 50\nfov_horizontal_deg = 90\nfov_vertical_deg = 60\n";
    let spec = read(&format!("{ANY}{keys}")).unwrap();
    let [right, down] = spec.projection.slopes(0);
    // The outer edge of the image lies half a pixel beyond the centre of its corner.
    assert!((right + 0.99).abs() < 1e-6 && (f64::from(down) + 0.98 * 30f64.to_radians().tan()).abs() < 1e-6);
}

#[test]
fn the_points_of_a_cloud_are_25_000_at_most_unless_the_table_says_otherwise() {
    let points = |keys: &str| read(&format!("{SHORT}{keys}")).map(|spec| spec.points());
    assert_eq!(points(""), Ok(16_224));
    // 3 x 3 would leave 213 x 120 = 25,560.
    assert_eq!(points("width_px = 640\nheight_px = 360\n"), Ok(160 * 90));
    assert_eq!(points("bin_px = 2\n"), Ok(424 * 240));
    assert_eq!(
        points("bin_px = 1\n").unwrap_err().to_string(),
        "sensor \"front\": bin_px = 1 is not possible; possible: larger, so that at most 131072 points remain of the 407040"
    );
}

#[test]
fn every_mistake_names_the_sensor_the_key_and_what_is_possible() {
    let models = "realsense_d435, realsense_d455, realsense_d415, z16";
    for (keys, said) in [
        (
            "device = \"/dev/video0\"\n".to_owned(),
            format!("`model` is missing; possible: {models}"),
        ),
        (
            "model = \"d435\"\ndevice = \"/dev/video0\"\n".to_owned(),
            format!("model = \"d435\" is not possible; possible: {models}"),
        ),
        (
            "model = \"z16\"\nfov_horizontal_deg = 80\nfov_vertical_deg = 60\n".to_owned(),
            "`device` is missing; possible: the path of a V4L2 device, e.g. \"/dev/video0\" or one of /dev/v4l/by-id".to_owned(),
        ),
        (
            "model = \"realsense_d435\"\ndevice = \"video0\"\n".to_owned(),
            "device = \"video0\" is not possible; possible: the path of a V4L2 device, e.g. \"/dev/video0\" or one of \
             /dev/v4l/by-id"
                .to_owned(),
        ),
        (
            ANY.to_owned(),
            "`fx_px` is missing; possible: fx_px, fy_px, cx_px, cy_px of the camera's calibration, or fov_horizontal_deg and \
             fov_vertical_deg (a z16 has none of its own at 640 x 480)"
                .to_owned(),
        ),
        (
            format!("{SHORT}width_px = 640\n"),
            "`fx_px` is missing; possible: fx_px, fy_px, cx_px, cy_px of the camera's calibration, or fov_horizontal_deg and \
             fov_vertical_deg (a realsense_d435 has none of its own at 640 x 480)"
                .to_owned(),
        ),
        (
            format!("{SHORT}fx_px = 400\n"),
            "`fy_px` is missing; possible: 48 to 9600".to_owned(),
        ),
        (
            format!("{SHORT}fov_vertical_deg = 40\n"),
            "`fov_horizontal_deg` is missing; possible: 1 to 170".to_owned(),
        ),
        (
            format!("{SHORT}fov_vertical_deg = 40\ncx_px = 3\n"),
            "cx_px and fov_vertical_deg say the same: give one of them".to_owned(),
        ),
        (
            format!("{SHORT}depth_scale = 1\n"),
            "a depth_camera has no key `depth_scale`; did you mean `depth_scale_m`?".to_owned(),
        ),
        (
            format!("{SHORT}width_px = 848.5\n"),
            "width_px = 848.5 is not possible; possible: a whole number from 16 to 4096".to_owned(),
        ),
        (
            format!("{SHORT}border_px = 240\n"),
            "border_px = 240 is not possible; possible: a whole number from 0 to 236".to_owned(),
        ),
        (
            format!("{SHORT}bin_px = 0\n"),
            "bin_px = 0 is not possible; possible: a whole number from 1 to 480".to_owned(),
        ),
        (
            format!("{SHORT}range_min_m = 6\n"),
            "range_max_m = 5 is not possible; possible: more than range_min_m = 6, up to 60".to_owned(),
        ),
        (
            format!("{SHORT}range_max_m = inf\n"),
            "range_max_m = inf is not possible; possible: 0.1 to 60".to_owned(),
        ),
        (
            format!("{SHORT}k1 = nan\n"),
            "k1 = nan is not possible; possible: -100 to 100".to_owned(),
        ),
        (
            format!("{SHORT}k1 = -1\n"),
            "with this distortion (k1, k2, p1, p2, k3) the pixel in column 0, row 0 looks nowhere; correct it, or leave the edges \
             out with border_px"
                .to_owned(),
        ),
    ] {
        assert_eq!(
            read(&keys).unwrap_err().to_string(),
            format!("sensor \"front\": {said}"),
            "{keys}"
        );
    }
}
