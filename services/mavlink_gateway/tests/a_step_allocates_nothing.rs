//! After construction the hot path (splitting, decoding, stepping, encoding) asks the allocator for nothing.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
#![allow(deprecated)] // The trajectory messages are gone from PX4 1.16 on; this profile is for the versions before.

mod support;

use jink_mavlink_gateway::frame::Splitter;
use jink_mavlink_gateway::{Body, Content, Encoder, Gateway, GatewayConfig, Inputs, Outputs, Received};
use jink_shared_types::motion::{ApprovedTrajectory, Verdict};
use jink_shared_types::ring::SectorRing;
use jink_shared_types::{Coded, Timestamp};
use mavlink::dialects::ardupilotmega::*;
use nalgebra::Vector3;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use support::{MODE_MISSION, Sample, at, flight, heartbeat, wish};

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

struct Counting;

#[allow(unsafe_code)]
// SAFETY: everything is handed on to the system's allocator unchanged.
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
static ALLOCATOR: Counting = Counting;

fn allocations() -> usize {
    ALLOCATIONS.with(Cell::get)
}

/// One second of an autopilot's messages as bytes, per 10 ms.
fn telemetry() -> Vec<Vec<u8>> {
    let mut encoder = Encoder::new();
    let mut bytes = |message: MavMessage| encoder.encode(1, 1, &Body::Message(message)).to_vec();
    (0..200u32)
        .map(|i| {
            let time_boot_ms = 5000 + 10 * i;
            let mut tick = Vec::new();
            if i % 100 == 0 {
                tick.extend(bytes(heartbeat(MODE_MISSION, true)));
            }
            if i % 20 == 0 {
                tick.extend(bytes(wish([(Vector3::new(40.0, 0.0, -5.0), u16::MAX); 3])));
            }
            tick.extend(bytes(MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
                time_boot_ms,
                ..LOCAL_POSITION_NED_DATA::default()
            })));
            tick.extend(bytes(MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
                time_boot_ms,
                q1: 1.0,
                ..ATTITUDE_QUATERNION_DATA::default()
            })));
            tick.extend(bytes(MavMessage::TIMESYNC(TIMESYNC_DATA {
                ts1: 1,
                ..TIMESYNC_DATA::default()
            })));
            tick
        })
        .collect()
}

#[test]
fn from_bytes_to_bytes_without_the_allocator() {
    let telemetry = telemetry();
    let mut gateway = Gateway::new(GatewayConfig::default());
    let mut outputs = Outputs::default();
    let mut splitter = Splitter::new();
    let mut encoder = Encoder::new();
    let mut messages: Vec<Received> = Vec::with_capacity(64);
    let mut approved = Sample::new(
        ApprovedTrajectory {
            trajectory: flight(1, at(0.0), Vector3::zeros(), Vector3::new(9.0, 0.0, 0.0), 8.0),
            verdict: Coded::new(Verdict::Passed),
            ..ApprovedTrajectory::default()
        },
        at(0.0),
    );
    let mut ring = Some(Sample::new(SectorRing::default(), at(0.0)));
    let mut cycle = |now: Timestamp, bytes: &[u8], id: u64| -> usize {
        approved.value.trajectory.id = id;
        approved.header.publish = now;
        if let Some(ring) = &mut ring {
            ring.header.publish = now;
        }
        messages.clear();
        splitter.push(bytes);
        while let Some(frame) = splitter.next_frame() {
            if let Some(content) = Content::of(&frame) {
                messages.push(Received {
                    header: frame.header,
                    content,
                    time: now,
                });
            }
        }
        let inputs = Inputs {
            messages: &messages,
            link: Default::default(),
            approved: jink_shared_types::Reading::Fresh(jink_shared_types::Stamped {
                sample: &*approved.value,
                header: &approved.header,
            }),
            ring: Sample::reading(&ring, now, 200.0),
            system: jink_shared_types::Reading::Never,
            events: &[],
        };
        gateway.step(now, &inputs, &mut outputs);
        let mut sent = 0;
        for message in outputs.messages() {
            sent += encoder
                .encode(message.system_id, message.component_id, &message.body)
                .len();
            gateway.wire(now, message.receipt);
        }
        sent
    };
    // The first second holds the only event, whose text is formatted on the heap.
    for (i, bytes) in telemetry[..100].iter().enumerate() {
        cycle(at(i as f64 / 100.0), bytes, 1);
    }
    let before = allocations();
    let mut sent = 0;
    for (i, bytes) in telemetry.iter().enumerate().skip(100) {
        sent += cycle(at(i as f64 / 100.0), bytes, 1 + i as u64 / 3);
    }
    assert_eq!(allocations() - before, 0);
    assert!(sent > 5000, "{sent} bytes");
}
