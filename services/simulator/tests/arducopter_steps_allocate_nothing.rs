//! A step of the emulated ArduCopter and vehicle takes no memory from the heap once it flies.

#![allow(
    deprecated,
    unsafe_code,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic
)]

mod support;

use jink_simulator::autopilot::{Link, Packet};
use mavlink::MavHeader;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use support::copter::{CopterFlight, PVA, at, level, setpoint};

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call goes to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

#[test]
fn a_step_in_guided_allocates_nothing() {
    let mut flight = CopterFlight::airborne(&[]);
    for (id, rate_hz) in [(32, 50.0), (31, 50.0), (85, 20.0), (1, 2.0)] {
        flight.want(Link::Companion, id, rate_hz);
    }
    let ahead = setpoint(PVA, at(0.0, 0.0), level(0.2, 0.0), level(0.0, 0.0));
    flight.stream(2.0, 50.0, |_| ahead.clone());
    let inbox = [Packet {
        link: Link::Companion,
        header: MavHeader {
            system_id: 1,
            component_id: 191,
            sequence: 0,
        },
        message: ahead,
    }];
    let mut outbox = Vec::with_capacity(256);
    let before = ALLOCATIONS.with(Cell::get);
    let mut sent = 0;
    for step in 0..2_000 {
        outbox.clear();
        let heard = if step % 5 == 0 { &inbox[..] } else { &[] };
        flight.copter.step(heard, &mut outbox);
        sent += outbox.len();
    }
    assert_eq!(ALLOCATIONS.with(Cell::get), before);
    assert!(sent > 900, "{sent}");
    assert_eq!(flight.copter.aborted(), None);
}
