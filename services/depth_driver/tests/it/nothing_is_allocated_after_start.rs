//! The hot path allocates nothing: not for images, faults, clouds, counters.

use crate::images::{bytes, image, small};
use allocation_counter::measure;
use jink_depth_driver::{DepthCameraDriver, Image};
use jink_shared_types::Timestamp;
use jink_shared_types::ranges::PointCloud;

#[test]
fn a_minute_of_images_with_every_fault() {
    let spec = small("k1 = 0.05\n");
    let walls: Vec<Vec<u8>> = (0..900).map(|index| bytes(&vec![1_000 + index; 1_200])).collect();
    let mut driver = DepthCameraDriver::new(spec.clone());
    let mut cloud = PointCloud::boxed();
    let mut clouds = 0;
    let allocations = measure(|| {
        for (index, bytes) in (0..).zip(&walls) {
            let good = image(&spec, bytes, index * 2, u64::from(index) * 66);
            let faulty = match index % 5 {
                0 => Image {
                    is_damaged: true,
                    ..good
                },
                1 => Image {
                    bytes: &bytes[..50],
                    ..good
                },
                2 => Image { stamp: None, ..good },
                _ => good,
            };
            // Each one twice: the second repeats the first.
            for image in [faulty, faulty] {
                driver.image(&image, &mut |view| {
                    view.write(&mut cloud);
                    clouds += 1;
                });
            }
            let now = Timestamp::from_ns((1_000 + u64::from(index) * 66) * 1_000_000);
            driver.take_change(now);
            driver.counters(now);
            if index % 300 == 0 {
                driver.connected();
            }
        }
    });
    assert_eq!(clouds, 540);
    assert_eq!(allocations.count_total, 0);
}
