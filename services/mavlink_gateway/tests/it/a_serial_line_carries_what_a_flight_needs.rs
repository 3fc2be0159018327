//! What each stream costs, and what of it a serial line of 57600 and one of 921600 bit/s carries: heartbeats and setpoints
//! always, obstacle maps at least five times a second where that fits, and an event where it does not.
#![allow(deprecated)] // The trajectory messages are gone from PX4 1.16 on.

use jink_mavlink_gateway::{Body, Encoder};
use jink_mavlink_link::budget::{Budget, CapacityChange, TrafficClass};
use jink_shared_types::Timestamp;
use mavlink::dialect::*;

/// How long the line is watched (s).
const SECONDS: u32 = 30;

/// One message that is sent at a rate.
struct Stream {
    name: &'static str,
    class: TrafficClass,
    bytes: usize,
    rate_hz: f64,
}

impl Stream {
    /// The message as its sender encodes it; its last field must not be zero, or it would be shorter than in flight.
    fn new(name: &'static str, message: MavMessage, rate_hz: f64) -> Self {
        let body = Body::Message(message);
        Self {
            name,
            class: TrafficClass::of(body.message_id()),
            bytes: Encoder::new().encode(1, 196, &body).len(),
            rate_hz,
        }
    }

    fn bytes_per_s(&self) -> f64 {
        self.bytes as f64 * self.rate_hz
    }
}

/// Everything that is said to an autopilot beside setpoints; the forwarded part is a ground station's.
fn always() -> Vec<Stream> {
    let heartbeat = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        mavlink_version: 3,
        ..HEARTBEAT_DATA::default()
    });
    let timesync = |tc1| {
        MavMessage::TIMESYNC(TIMESYNC_DATA {
            tc1,
            ts1: i64::MAX,
            target_system: 1,
            target_component: 1,
        })
    };
    let obstacles = MavMessage::OBSTACLE_DISTANCE(OBSTACLE_DISTANCE_DATA {
        distances: [u16::MAX; 72],
        frame: MavFrame::MAV_FRAME_BODY_FRD,
        ..OBSTACLE_DISTANCE_DATA::default()
    });
    let text = MavMessage::STATUSTEXT(STATUSTEXT_DATA {
        text: [b'x'; 50].into(),
        ..STATUSTEXT_DATA::default()
    });
    let parameter = MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
        param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
        ..PARAM_VALUE_DATA::default()
    });
    vec![
        Stream::new("HEARTBEAT, two components", heartbeat, 2.0),
        Stream::new("TIMESYNC requests", timesync(0), 1.0),
        Stream::new("TIMESYNC answers", timesync(i64::MAX), 10.0),
        Stream::new("OBSTACLE_DISTANCE", obstacles, 5.0),
        Stream::new("STATUSTEXT", text, 0.5),
        Stream::new("PARAM_VALUE", parameter, 2.0),
        Stream {
            name: "forwarded",
            class: TrafficClass::Forwarded,
            bytes: 40,
            rate_hz: 10.0,
        },
    ]
}

fn setpoints() -> [Stream; 3] {
    let curve = MavMessage::TRAJECTORY_REPRESENTATION_BEZIER(TRAJECTORY_REPRESENTATION_BEZIER_DATA {
        valid_points: 5,
        ..TRAJECTORY_REPRESENTATION_BEZIER_DATA::default()
    });
    let waypoints =
        MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA {
            valid_points: 1,
            ..TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA::default()
        });
    let target = MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
        ..SET_POSITION_TARGET_LOCAL_NED_DATA::default()
    });
    [
        Stream::new("BEZIER", curve, 20.0),
        Stream::new("SET_POSITION_TARGET", target, 50.0),
        Stream::new("WAYPOINTS", waypoints, 20.0),
    ]
}

/// Rates that get through (Hz), after a second of warming up, and what is reported.
fn carried(rate_bps: f64, streams: &[Stream]) -> (Vec<f64>, Vec<CapacityChange>) {
    let mut budget = Budget::new(rate_bps);
    let mut due_s: Vec<_> = streams.iter().map(|_| 0.0).collect();
    let mut sent = vec![0.0; streams.len()];
    let mut changes = Vec::new();
    for ms in 0..(1 + SECONDS) * 1000 {
        let time_s = f64::from(ms) / 1e3;
        let now = Timestamp::from_seconds(100.0 + time_s);
        for (index, stream) in streams.iter().enumerate() {
            if time_s + 1e-9 >= due_s[index] {
                due_s[index] += 1.0 / stream.rate_hz;
                if budget.admits(now, stream.class, stream.bytes) && ms >= 1000 {
                    sent[index] += 1.0 / f64::from(SECONDS);
                }
            }
        }
        changes.extend(budget.judge(now));
    }
    (sent, changes)
}

#[test]
fn of_57600_and_921600_bits_per_second() {
    for setpoint in setpoints() {
        let name = setpoint.name;
        let mut streams = always();
        streams.push(setpoint);
        let asked: f64 = streams.iter().map(Stream::bytes_per_s).sum();
        let lines = [57_600.0, 921_600.0].map(|baud| (baud / 10.0, carried(baud / 10.0, &streams)));
        println!("{name}: {asked:.0} B/s asked for");
        println!(
            "  {:26} {:>5} {:>6} {:>7}   at 5760   at 92160 B/s",
            "", "bytes", "Hz", "B/s"
        );
        for (index, stream) in streams.iter().enumerate() {
            println!(
                "  {:26} {:5} {:6.1} {:7.0} {:6.1} Hz {:6.1} Hz",
                stream.name,
                stream.bytes,
                stream.rate_hz,
                stream.bytes_per_s(),
                lines[0].1.0[index],
                lines[1].1.0[index],
            );
        }
        for (rate_bps, (sent, changes)) in &lines {
            println!("  {rate_bps:.0} B/s: {changes:?}");
            for (stream, sent_hz) in streams.iter().zip(sent) {
                let what = format!("{name} at {rate_bps} B/s: {} {sent_hz:.1} Hz", stream.name);
                if stream.class <= TrafficClass::Setpoint || *rate_bps > 6000.0 {
                    assert!(*sent_hz >= 0.99 * stream.rate_hz - 0.1, "{what}");
                }
                if stream.class == TrafficClass::Obstacles && name != "WAYPOINTS" {
                    assert!(*sent_hz >= 4.85, "{what}");
                }
            }
            let is_too_slow = name == "WAYPOINTS" && *rate_bps < 6000.0;
            assert_eq!(changes.len(), usize::from(is_too_slow), "{name}: {changes:?}");
        }
    }
}
