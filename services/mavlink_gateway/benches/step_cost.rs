//! What one cycle of the gateway costs, from received bytes to bytes ready to be sent: percentiles over a simulated
//! flight of ten minutes in a mission; and what the figures of `jink top` and `jink status` cost beside that.
//! `cargo bench -p jink-mavlink-gateway --bench step_cost`

use jink_mavlink_gateway::{
    Body, Content, Encoder, Gateway, GatewayConfig, Inputs, Outputs, Receipt, Received,
};
use jink_mavlink_link::frame::Splitter;
use jink_shared_types::bezier::{End, quintic_between};
use jink_shared_types::health::Histogram;
use jink_shared_types::link::LinkStatus;
use jink_shared_types::motion::{ApprovedTrajectory, BezierPiece, Trajectory, TrajectoryMode, Verdict};
use jink_shared_types::ring::SectorRing;
use jink_shared_types::{Coded, Reading, SampleHeader, Stage, Stamped, Timestamp};
use mavlink::dialect::*;
use nalgebra::Vector3;
use std::time::Instant;

/// Ticks of 10 ms.
const TICKS: u32 = 60_000;

/// One takes less than the clock resolves: so many are timed together, so many times.
const TOGETHER: u32 = 1_000;
const TIMES: u32 = 1_000;

fn main() {
    let mut gateway = Gateway::new(GatewayConfig {
        is_proven: true,
        ..GatewayConfig::default()
    });
    let mut outputs = Outputs::default();
    let mut splitter = Splitter::new();
    let (mut autopilot, mut ours) = (Encoder::new(), Encoder::new());
    let mut messages: Vec<Received> = Vec::with_capacity(64);
    let ring = SectorRing::default();
    let mut approved = ApprovedTrajectory {
        verdict: Coded::new(Verdict::Passed),
        ..ApprovedTrajectory::default()
    };
    let mut costs = [
        (
            "receive: split and decode one tick's bytes",
            Nanoseconds::default(),
        ),
        ("step without a setpoint", Nanoseconds::default()),
        ("step with a setpoint", Nanoseconds::default()),
        ("encode one message", Nanoseconds::default()),
        ("bytes in to setpoint bytes out", Nanoseconds::default()),
    ];
    for tick in 0..TICKS {
        let now = Timestamp::from_seconds(1000.0 + f64::from(tick) * 0.01);
        if tick.is_multiple_of(3) {
            approved.trajectory = flight(u64::from(tick) + 1, now);
        }
        let header = SampleHeader::at(now);
        let bytes = telemetry(&mut autopilot, tick);

        let began = Instant::now();
        messages.clear();
        splitter.push(&bytes);
        while let Some(frame) = splitter.next_frame() {
            if let Some(content) = Content::of(&frame) {
                messages.push(Received {
                    header: frame.header,
                    content,
                    time: now,
                    link: 0,
                });
            }
        }
        let received = Instant::now();
        let inputs = Inputs {
            messages: &messages,
            link: Default::default(),
            approved: fresh(&approved, &header),
            prevented: Reading::Never,
            ring: fresh(&ring, &header),
            system: Reading::Never,
            events: &[],
            parameters: None,
            answers: &[],
        };
        gateway.step(now, &inputs, &mut outputs);
        let stepped = Instant::now();
        let mut setpoint_out = None;
        for message in outputs.messages() {
            let before = Instant::now();
            let bytes = ours.encode(message.system_id, message.component_id, &message.body);
            std::hint::black_box(bytes);
            costs[3].1.record(before.elapsed().as_nanos());
            if matches!(message.receipt, Receipt::Setpoint { .. }) {
                setpoint_out = Some(Instant::now());
            }
            gateway.wire(now, message.receipt);
        }
        costs[0].1.record((received - began).as_nanos());
        let kind = if setpoint_out.is_some() { 2 } else { 1 };
        costs[kind].1.record((stepped - received).as_nanos());
        if let Some(out) = setpoint_out {
            costs[4].1.record((out - began).as_nanos());
        }
    }
    println!("{:45} {:>9} {:>9} {:>9}  [us]", "", "p50", "p99", "max");
    for (name, cost) in &costs {
        let us = |ns: f64| ns / 1000.0;
        println!(
            "{name:45} {:9.2} {:9.2} {:9.2}",
            us(cost.0.quantile_us(0.5)),
            us(cost.0.quantile_us(0.99)),
            us(f64::from(cost.0.max_us)),
        );
    }
    figures_of_the_flight(&mut gateway);
}

/// What `jink top` and `jink status` show of every trajectory: counting it, and handing all counts on, five times a second.
fn figures_of_the_flight(gateway: &mut Gateway) {
    let now = Timestamp::from_seconds(2_000.0);
    let mut header = SampleHeader::at(now.plus_seconds(-0.006));
    for stage in [
        Stage::Sensor,
        Stage::Fusion,
        Stage::Planner,
        Stage::Generator,
        Stage::Guard,
    ] {
        header = header.derived(stage, header.capture.plus_seconds(1e-3 * f64::from(stage as u8)));
    }
    let counting = nanoseconds_of(|| {
        // Of trajectories of one measurement only the first is counted.
        header.capture = header.capture.plus_seconds(1e-9);
        gateway.wire(
            now,
            Receipt::Setpoint {
                first_of: Some(header),
            },
        );
    });
    let from = Box::new(LinkStatus::default());
    let mut to = Box::new(LinkStatus::default());
    let copying = nanoseconds_of(|| std::hint::black_box(&mut *to).clone_from(std::hint::black_box(&from)));
    let mut cycles = Histogram::default();
    let cycle = nanoseconds_of(|| std::hint::black_box(&mut cycles).record_us(std::hint::black_box(700)));
    println!("\nfigures of the flight [ns]");
    println!("{:45} {counting:9.0}", "count the stages of one trajectory");
    println!(
        "{:45} {copying:9.0}",
        format!("hand all counts on ({} bytes)", size_of::<LinkStatus>())
    );
    println!("{:45} {cycle:9.0}", "count one cycle of a service");
}

/// Median time of one call (ns).
fn nanoseconds_of(mut work: impl FnMut()) -> f64 {
    let mut times: Vec<f64> = (0..TIMES)
        .map(|_| {
            let began = Instant::now();
            (0..TOGETHER).for_each(|_| work());
            began.elapsed().as_nanos() as f64 / f64::from(TOGETHER)
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// A histogram of microseconds, fed with nanoseconds.
#[derive(Default)]
struct Nanoseconds(Histogram);

impl Nanoseconds {
    fn record(&mut self, ns: u128) {
        self.0.record_us(u32::try_from(ns).unwrap_or(u32::MAX));
    }
}

fn fresh<'a, T>(sample: &'a T, header: &'a SampleHeader) -> Reading<'a, T> {
    Reading::Fresh(Stamped { sample, header })
}

/// What an autopilot sends in one tick: attitude 50 Hz, position 30 Hz, time synchronisation 10 Hz, heartbeat 1 Hz.
fn telemetry(encoder: &mut Encoder, tick: u32) -> Vec<u8> {
    let time_boot_ms = 10 * tick;
    let mut bytes = Vec::new();
    let mut add = |message| bytes.extend_from_slice(encoder.encode(1, 1, &Body::Message(message)));
    if tick.is_multiple_of(100) {
        add(MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode: 4 << 16 | 4 << 24,
            mavtype: MavType::MAV_TYPE_QUADROTOR,
            autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
            ..HEARTBEAT_DATA::default()
        }));
    }
    if tick.is_multiple_of(2) {
        add(MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
            time_boot_ms,
            q1: 1.0,
            ..ATTITUDE_QUATERNION_DATA::default()
        }));
    }
    if tick.is_multiple_of(3) {
        add(MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
            time_boot_ms,
            ..LOCAL_POSITION_NED_DATA::default()
        }));
    }
    if tick.is_multiple_of(10) {
        add(MavMessage::TIMESYNC(TIMESYNC_DATA {
            ts1: 1,
            ..TIMESYNC_DATA::default()
        }));
    }
    bytes
}

/// A full trajectory of twenty pieces, weaving, at rest at its end.
fn flight(id: u64, start: Timestamp) -> Trajectory {
    let end = |i: usize| {
        let t = i as f64;
        let moving = f64::from(u8::from(i < 20));
        End {
            position: Vector3::new(0.6 * t, (t / 2.0).sin(), -3.0),
            velocity: Vector3::new(2.0, 5.0 / 3.0 * (t / 2.0).cos(), 0.0) * moving,
            acceleration: Vector3::zeros(),
        }
    };
    let mut trajectory = Trajectory {
        id,
        start,
        mode: Coded::new(TrajectoryMode::Plan),
        ..Trajectory::default()
    };
    for i in 0..20 {
        trajectory.push(BezierPiece::new(
            &quintic_between(&end(i), &end(i + 1), 0.3),
            [0.1; 6],
            0.3,
        ));
    }
    trajectory
}
