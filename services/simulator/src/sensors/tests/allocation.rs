//! Rendering allocates nothing: counted per thread, so that tests running beside this one do not matter.

use super::*;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

#[allow(unsafe_code)]
// SAFETY: every call goes to the system's allocator unchanged; the counter is a plain number without destructor.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = ALLOCATIONS.try_with(|count| count.set(count.get() + 1));
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

fn allocations() -> u64 {
    ALLOCATIONS.with(Cell::get)
}

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
    let before = allocations();
    let mut rendered = 0;
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
    assert_eq!(allocations(), before);
    assert!(rendered > 15);
    // The counter counts.
    drop(std::hint::black_box(Box::new(1)));
    assert_eq!(allocations(), before + 1);
}
