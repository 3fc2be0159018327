//! A step of the emulated ArduCopter and vehicle takes no memory from the heap once it flies.

#![allow(deprecated)]

use crate::support::copter::{CopterFlight, PVA, at, level, setpoint};
use allocation_counter::measure;
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::{Link, Packet};
use mavlink::MavHeader;

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
    let mut sent = 0;
    let allocated = measure(|| {
        for step in 0..2_000 {
            outbox.clear();
            let received = if step % 5 == 0 { &inbox[..] } else { &[] };
            flight.copter.step(received, &mut outbox);
            sent += outbox.len();
        }
    })
    .count_total;
    assert_eq!(allocated, 0);
    assert!(sent > 900, "{sent}");
    assert_eq!(flight.copter.aborted(), None);
}
