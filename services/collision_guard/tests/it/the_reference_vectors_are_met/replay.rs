//! A scenario, flown by our own ring and prevention.

use jink_collision_guard::prevention::{HorizontalSetpoint, Prevention, PreventionConfig, PreventionOutput};
use jink_collision_guard::ring::Ring;
use jink_shared_types::beams::{BeamReading, ObstacleDistance};
use jink_shared_types::params::ParamSet;
use jink_shared_types::pose_history::Pose;
use jink_shared_types::ranges::{RangeScan, ScanFrame};
use jink_shared_types::ring::SectorRing;
use jink_shared_types::{SampleHeader, Timestamp};
use jink_testkit::vectors::{distances_cm, list_if_any, number, numbers, whole};
use nalgebra::{Quaternion, UnitQuaternion, Vector2, Vector3};
use serde_json::Value;

/// How long messages wait to be read (s).
const KEPT_S: f64 = 0.5;
/// The layer of OBSTACLE_DISTANCE; rangefinders have those of their instances, 0 to 9.
const ROW_LAYER: usize = 10;

/// A range message of a step.
#[derive(Clone, Debug)]
pub struct Message {
    /// Where it goes.
    pub layer: usize,
    /// When it was sent.
    pub at: Timestamp,
    pub content: Content,
}

#[derive(Clone, Debug)]
pub enum Content {
    /// A rangefinder's.
    Beam(BeamReading),
    /// A row of distances; its frame is only right if it is a known one.
    Row {
        row: ObstacleDistance,
        is_frame_known: bool,
    },
}

/// A message that was read.
#[derive(Clone, Debug)]
pub struct AcceptedMessage {
    pub message: Message,
    /// Whether the ring took it.
    pub is_taken: bool,
    /// The attitude it was read at.
    pub attitude: UnitQuaternion<f64>,
}

/// Our side of a scenario.
#[derive(Debug)]
pub struct Replay {
    ring: Ring,
    prevention: Prevention,
    /// PX4's parameters as of now.
    pub config: PreventionConfig,
    attitude: UnitQuaternion<f64>,
    pending: Vec<Message>,
}

/// What came of a step.
#[derive(Debug)]
pub struct ReplayedStep {
    pub now: Timestamp,
    pub ring: SectorRing,
    /// The setpoint.
    pub outcome: PreventionOutput,
    /// The setpoint that came.
    pub asked: Vector2<f64>,
    /// The velocity that came.
    pub velocity: Vector2<f64>,
    /// Heading (rad).
    pub yaw_rad: f64,
    pub accepted: Vec<AcceptedMessage>,
}

impl Replay {
    /// At the beginning of `scenario`.
    pub fn new(scenario: &Value) -> Self {
        let config = read_config(None, &scenario["params"]);
        Self {
            // PX4 knows no band and no hull: everything that is reported counts.
            ring: Ring::from_params(&without_hull()),
            prevention: Prevention::new(config),
            config,
            attitude: UnitQuaternion::identity(),
            pending: Vec::new(),
        }
    }

    /// One step.
    pub fn step(&mut self, step: &Value) -> ReplayedStep {
        if let Some(params) = step.get("params") {
            self.config = read_config(Some(self.config), params);
            self.prevention.configure(self.config);
        }
        let now = micros(&step["t_us"]);
        if let Some(attitude) = step.get("attitude") {
            let [w, x, y, z] = numbers(&attitude["q"]);
            let q = Quaternion::new(w, x, y, z);
            if q.norm() > 0.1 {
                self.attitude = UnitQuaternion::from_quaternion(q);
            }
        }
        let beams = list_if_any(step, "distance_sensors").iter().map(read_beam);
        // The newest message of each layer is kept while prevention is off.
        for message in beams.chain(step.get("obstacle_distance").map(read_row)) {
            self.pending.retain(|other| other.layer != message.layer);
            self.pending.push(message);
        }
        self.pending.sort_by_key(|message| message.layer);
        let pose = Pose {
            position_m: Vector3::zeros(),
            local_q_body: self.attitude,
        };
        let accepted = if self.config.is_active() {
            self.take(now, &pose)
        } else {
            Vec::new()
        };
        let mut ring = SectorRing::default();
        self.ring.ring_from(now, &pose, &mut ring);
        let asked = Vector2::from(numbers::<2>(&step["setpoint_accel"]));
        let velocity = Vector2::from(numbers::<2>(&step["velocity"]));
        let outcome = self
            .prevention
            .step(now, &ring, HorizontalSetpoint::Acceleration(asked), velocity);
        ReplayedStep {
            now,
            ring,
            outcome,
            asked,
            velocity,
            yaw_rad: pose.yaw_rad(),
            accepted,
        }
    }

    fn take(&mut self, now: Timestamp, pose: &Pose) -> Vec<AcceptedMessage> {
        let ring = &mut self.ring;
        let take = |message: Message| {
            let mut scan = RangeScan::default();
            // Messages are stamped when they arrive: none is newer than now, and half a second later none is read.
            let is_current = message.at <= now && now.seconds_since(message.at) < KEPT_S;
            let is_written = is_current
                && match &message.content {
                    Content::Beam(reading) => reading.write(&mut scan).is_ok(),
                    Content::Row { row, is_frame_known } => *is_frame_known && row.write(&mut scan).is_ok(),
                };
            let header = SampleHeader::at(message.at);
            let is_taken = is_written && ring.scan_from(message.layer, &scan, &header, pose).is_ok();
            AcceptedMessage {
                message,
                is_taken,
                attitude: pose.local_q_body,
            }
        };
        std::mem::take(&mut self.pending).into_iter().map(take).collect()
    }
}

fn micros(value: &Value) -> Timestamp {
    Timestamp::from_ns(whole(value) as u64 * 1000)
}

fn read_beam(value: &Value) -> Message {
    Message {
        layer: whole(&value["instance"]) as usize,
        at: micros(&value["t_us"]),
        content: Content::Beam(BeamReading {
            range_min_m: number(&value["min_m"]) as f32,
            range_max_m: number(&value["max_m"]) as f32,
            range_m: number(&value["current_m"]) as f32,
            quality: whole(&value["quality"]) as i8,
            orientation: whole(&value["orientation"]) as u8,
            opening_rad: number(&value["h_fov_rad"]) as f32,
            quaternion: numbers::<4>(&value["q"]).map(|x| x as f32),
        }),
    }
}

fn read_row(value: &Value) -> Message {
    let frame = match whole(&value["frame"]) {
        // MAV_FRAME_GLOBAL, MAV_FRAME_LOCAL_NED, MAV_FRAME_BODY_FRD.
        0 | 1 => Some(ScanFrame::North),
        12 => Some(ScanFrame::Level),
        _ => None,
    };
    Message {
        layer: ROW_LAYER,
        at: micros(&value["t_us"]),
        content: Content::Row {
            row: ObstacleDistance {
                frame: frame.unwrap_or(ScanFrame::Level),
                increment_deg: number(&value["increment_deg"]) as f32,
                offset_deg: number(&value["angle_offset_deg"]) as f32,
                min_cm: whole(&value["min_cm"]) as u16,
                max_cm: whole(&value["max_cm"]) as u16,
                distances_cm: distances_cm(&value["distances_cm"]),
            },
            is_frame_known: frame.is_some(),
        },
    }
}

/// The parameters of `params`; what it does not name stays as in `before`.
fn read_config(before: Option<PreventionConfig>, params: &Value) -> PreventionConfig {
    let of = |name, old: fn(&PreventionConfig) -> f64| match (params.get(name), &before) {
        (None, Some(before)) => old(before),
        _ => number(&params[name]),
    };
    PreventionConfig {
        distance_m: of("CP_DIST", |c| c.distance_m),
        delay_s: of("CP_DELAY", |c| c.delay_s),
        guide_rad: of("CP_GUIDE_ANG", |c| c.guide_rad.to_degrees()).to_radians(),
        goes_unseen: of("CP_GO_NO_DATA", |c| f64::from(u8::from(c.goes_unseen))) != 0.0,
        position_gain_per_s: of("MPC_XY_P", |c| c.position_gain_per_s),
        manual_mps: of("MPC_VEL_MANUAL", |c| c.manual_mps),
        jerk_mps3: of("MPC_JERK_MAX", |c| c.jerk_mps3),
        acceleration_mps2: of("MPC_ACC_HOR", |c| c.acceleration_mps2),
        velocity_gain_per_s: of("MPC_XY_VEL_P_ACC", |c| c.velocity_gain_per_s),
    }
}

fn without_hull() -> ParamSet {
    let mut params = ParamSet::default();
    for (name, value) in [("OA_VEH_RADIUS", 0.05), ("GD_BAND", 5.0)] {
        params.set(name, value).unwrap();
    }
    params
}
