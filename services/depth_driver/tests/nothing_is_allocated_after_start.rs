//! The hot path allocates nothing: not for images, faults, clouds, counters.
#![allow(
    unsafe_code,
    reason = "a global allocator that counts cannot be written without"
)]
#![allow(
    clippy::unwrap_used,
    reason = "a helper that cannot do its work fails the test"
)]

#[path = "camera/images.rs"]
mod images;

use images::{bytes, image, small};
use jink_depth_driver::{Driver, Image};
use jink_shared_types::Timestamp;
use jink_shared_types::ranges::PointCloud;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: hands everything to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(block, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

fn allocations_of(run: impl FnOnce()) -> u64 {
    let before = ALLOCATIONS.with(Cell::get);
    run();
    ALLOCATIONS.with(Cell::get) - before
}

#[test]
fn the_counter_counts() {
    assert_eq!(allocations_of(|| drop(std::hint::black_box(Box::new(7)))), 1);
}

#[test]
fn a_minute_of_images_with_every_fault() {
    let spec = small("k1 = 0.05\n");
    let walls: Vec<Vec<u8>> = (0..900).map(|index| bytes(&vec![1_000 + index; 1_200])).collect();
    let mut driver = Driver::new(spec.clone());
    let mut cloud = PointCloud::boxed();
    let mut clouds = 0;
    let allocations = allocations_of(|| {
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
            driver.news(now);
            driver.counters(now);
            if index % 300 == 0 {
                driver.connected();
            }
        }
    });
    assert_eq!(clouds, 540);
    assert_eq!(allocations, 0);
}
