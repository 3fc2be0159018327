//! Whatever a device hands over, the driver survives it, and what it publishes is plausible.

use crate::images;
use crate::images::small;
use jink_depth_driver::config::SensorTable;
use jink_depth_driver::{DepthCameraDriver, DepthCameraSpec, Image};
use jink_shared_types::Timestamp;
use jink_shared_types::ranges::{PointCloud, RayKind};
use proptest::prelude::*;

fn garbage() -> impl Strategy<Value = (Vec<u8>, usize, u64, Option<u64>, u32, bool)> {
    (
        prop::collection::vec(any::<u8>(), 0..3_000),
        prop_oneof![Just(80usize), 0..200usize, any::<usize>()],
        any::<u64>(),
        any::<Option<u64>>(),
        any::<u32>(),
        prop::bool::weighted(0.1),
    )
}

proptest! {
    #[test]
    fn whatever_is_dequeued_is_survived(images in prop::collection::vec(garbage(), 1..20)) {
        let spec = small("range_max_m = 30\n");
        let mut driver = DepthCameraDriver::new(spec);
        let mut cloud = PointCloud::boxed();
        let mut count = 0;
        for (bytes, row_bytes, arrived, stamp, sequence, is_damaged) in &images {
            let image = Image {
                arrived: Timestamp::from_ns(*arrived),
                stamp: stamp.map(Timestamp::from_ns),
                sequence: *sequence,
                is_damaged: *is_damaged,
                row_bytes: *row_bytes,
                bytes,
            };
            driver.image(&image, &mut |view| {
                view.write(&mut cloud);
                count += 1;
            });
            driver.take_change(Timestamp::from_ns(*arrived));
            let counters = driver.counters(Timestamp::from_ns(*arrived));
            prop_assert_eq!(counters.good, count);
            if count > 0 {
                prop_assert!(cloud.is_consistent());
                prop_assert_eq!(cloud.points().len(), 1_200);
                for point in cloud.points().iter().filter(|point| point.kind.get() != RayKind::Unknown) {
                    let range_m = point.forward_m.hypot(point.right_m).hypot(point.down_m);
                    prop_assert!(range_m > 0.0 && range_m <= 30.0001, "{point:?}");
                }
            }
        }
    }

    #[test]
    fn whatever_is_written_in_its_table_is_answered(
        values in prop::collection::vec((0..34usize, prop_oneof![
            any::<f64>().prop_map(toml::Value::Float),
            (-5.0..700.0f64).prop_map(toml::Value::Float),
            (-3i64..900).prop_map(toml::Value::Integer),
            any::<i64>().prop_map(toml::Value::Integer),
            Just(toml::Value::String("/dev/video0".to_owned())),
            Just(toml::Value::Array(vec![toml::Value::Integer(1); 4])),
        ]), 0..12)
    ) {
        const KEYS: [&str; 34] = [
            "name", "kind", "model", "device", "width_px", "height_px", "rate_hz", "delay_ms", "fov_horizontal_deg",
            "fov_vertical_deg", "fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3", "depth_scale_m", "range_min_m",
            "range_max_m", "sigma_per_m", "flying_pixel_per_m", "bin_px", "border_px", "forward_m", "right_m", "down_m",
            "orientation", "yaw_deg", "pitch_deg", "roll_deg", "quaternion",
        ];
        let mut table: SensorTable = [("name", "front"), ("kind", "depth_camera"), ("model", "realsense_d455"), ("device", "/dev/v")]
            .map(|(key, value)| (key.to_owned(), toml::Value::String(value.to_owned())))
            .into();
        // A small image: what is tried are the keys, not the patience with 16 million pixels.
        table.insert("width_px".to_owned(), toml::Value::Integer(64));
        table.insert("height_px".to_owned(), toml::Value::Integer(36));
        for (key, value) in values {
            table.insert(KEYS[key].to_owned(), value);
        }
        match DepthCameraSpec::find(&[table], "front") {
            Ok(spec) => {
                prop_assert!(spec.points() > 0);
                let mut cloud = PointCloud::boxed();
                let pixels = spec.size_px.iter().map(|size| usize::from(*size)).product();
                let cloud_of = |depth: u16| images::cloud_of(&spec, &vec![depth; pixels]);
                for depth in [1, 1_000, u16::MAX] {
                    cloud = cloud_of(depth);
                }
                prop_assert!(cloud.is_consistent());
                prop_assert_eq!(cloud.points().len(), spec.points());
            }
            Err(mistake) => prop_assert!(!mistake.to_string().is_empty()),
        }
    }
}
