//! Rendering allocates nothing: counted per thread, so that tests running beside this one do not matter.

use super::*;
use allocation_counter::measure;

#[test]
fn rendering_allocates_nothing() {
    let specs: Vec<_> = [
        SensorKind::Lidar3d,
        SensorKind::DepthCamera,
        SensorKind::Lidar2d,
        SensorKind::Rangefinder,
    ]
    .map(|kind| SensorSpec::new(kind.name(), kind))
    .into();
    let (world, mut track) = (forest(1), hover(2.5));
    let mut rig = SensorRig::new(&specs, 1).unwrap();
    let (mut cloud, mut scan) = (PointCloud::boxed(), RangeScan::default());
    let mut rendered = 0;
    let allocated = measure(|| {
        for step in 1..=100_u64 {
            let now = Timestamp::from_ns(step * 4_000_000);
            track.push(now, Pose::level(Point::new(0.1 * step as f64, 0.0, -2.5), 0.0));
            while let Some(frame) = rig.next_due(now) {
                match frame.output {
                    Output::Cloud => rig.render_cloud(&frame, &world, &track, &mut cloud).unwrap(),
                    Output::Scan => rig.render_scan(&frame, &world, &track, &mut scan).unwrap(),
                }
                rendered += 1;
            }
        }
    })
    .count_total;
    assert_eq!(allocated, 0);
    assert!(rendered > 15);
}
