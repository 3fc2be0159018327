//! A scenario, flown by our own ring and prevention.

use super::schema::{BINS, Node, Unreadable};
use jink_collision_guard::prevention::{HorizontalSetpoint, Prevention, PreventionConfig, PreventionOutput};
use jink_collision_guard::ring::Ring;
use jink_shared_types::beams::{BeamReading, ObstacleDistance};
use jink_shared_types::params::ParamSet;
use jink_shared_types::pose_history::Pose;
use jink_shared_types::ranges::{RangeScan, ScanFrame};
use jink_shared_types::ring::SectorRing;
use jink_shared_types::{SampleHeader, Timestamp};
use nalgebra::{Quaternion, UnitQuaternion, Vector2, Vector3};

/// How long messages wait to be read (s).
const KEPT_S: f64 = 0.5;
/// The layer of OBSTACLE_DISTANCE; rangefinders have those of their instances, 0 to 9.
const ROW_LAYER: usize = 10;
/// MAV_FRAME_GLOBAL, MAV_FRAME_LOCAL_NED, MAV_FRAME_BODY_FRD.
const FRAMES: [(i64, ScanFrame); 3] = [
    (0, ScanFrame::North),
    (1, ScanFrame::North),
    (12, ScanFrame::Level),
];

/// A range message of a step.
#[derive(Clone, Debug)]
pub enum Message {
    /// A rangefinder's.
    Beam {
        /// Which one.
        instance: usize,
        /// Its reading.
        reading: BeamReading,
        /// When.
        at: Timestamp,
    },
    /// A row of distances.
    Row {
        /// Frame as sent.
        frame: i64,
        /// Its content; the frame in it is only right if `frame` is a known one.
        row: ObstacleDistance,
        /// When.
        at: Timestamp,
    },
}

/// A message that was taken in, as it was placed.
#[derive(Clone, Debug)]
pub struct AcceptedMessage {
    /// Its layer.
    pub layer: usize,
    /// It, as a scan; `None` if it was refused.
    pub scan: Option<RangeScan>,
    /// The message.
    pub message: Message,
    /// Its time.
    pub at: Timestamp,
    /// The attitude it was taken at.
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
    /// When.
    pub now: Timestamp,
    /// The ring.
    pub ring: SectorRing,
    /// The setpoint.
    pub outcome: PreventionOutput,
    /// The setpoint that came.
    pub asked: Vector2<f64>,
    /// The velocity that came.
    pub velocity: Vector2<f64>,
    /// Heading (rad).
    pub yaw_rad: f64,
    /// What was taken in.
    pub accepted: Vec<AcceptedMessage>,
}

impl Replay {
    /// At the beginning of `scenario`.
    pub fn new(scenario: &Node<'_>) -> Result<Self, Unreadable> {
        let config = read_config(None, &scenario.get("params")?)?;
        Ok(Self {
            // PX4 knows no band and no hull: everything that is reported counts.
            ring: Ring::from_params(&without_hull()),
            prevention: Prevention::new(config),
            config,
            attitude: UnitQuaternion::identity(),
            pending: Vec::new(),
        })
    }

    /// One step.
    pub fn step(&mut self, step: &Node<'_>) -> Result<ReplayedStep, Unreadable> {
        if let Some(params) = step.find("params") {
            self.config = read_config(Some(self.config), &params)?;
            self.prevention.configure(self.config);
        }
        let now = micros(&step.get("t_us")?)?;
        if let Some(attitude) = step.find("attitude") {
            let [w, x, y, z] = attitude.get("q")?.numbers()?;
            let q = Quaternion::new(w, x, y, z);
            if q.norm() > 0.1 {
                self.attitude = UnitQuaternion::from_quaternion(q);
            }
        }
        self.note_messages(step)?;
        let accepted = if self.config.is_active() {
            self.take(now)
        } else {
            Vec::new()
        };
        let pose = Pose {
            position_m: Vector3::zeros(),
            local_q_body: self.attitude,
        };
        let mut ring = SectorRing::default();
        self.ring.ring_from(now, &pose, &mut ring);
        let asked = Vector2::from(step.get("setpoint_accel")?.numbers::<2>()?);
        let velocity = Vector2::from(step.get("velocity")?.numbers::<2>()?);
        let outcome = self
            .prevention
            .step(now, &ring, HorizontalSetpoint::Acceleration(asked), velocity);
        Ok(ReplayedStep {
            now,
            ring,
            outcome,
            asked,
            velocity,
            yaw_rad: pose.yaw_rad(),
            accepted,
        })
    }

    /// What is new, and waits while prevention is off: the newest of each.
    fn note_messages(&mut self, step: &Node<'_>) -> Result<(), Unreadable> {
        if let Some(sensors) = step.find("distance_sensors") {
            for sensor in sensors.list()? {
                let message = read_beam(&sensor)?;
                let instance = layer(&message);
                self.pending.retain(|other| layer(other) != instance);
                self.pending.push(message);
            }
        }
        if let Some(row) = step.find("obstacle_distance") {
            self.pending.retain(|other| layer(other) != ROW_LAYER);
            self.pending.push(read_row(&row)?);
        }
        self.pending.sort_by_key(layer);
        Ok(())
    }

    fn take(&mut self, now: Timestamp) -> Vec<AcceptedMessage> {
        let pose = Pose {
            position_m: Vector3::zeros(),
            local_q_body: self.attitude,
        };
        std::mem::take(&mut self.pending)
            .into_iter()
            .map(|message| {
                let mut scan = RangeScan::default();
                let (at, layer) = (time(&message), layer(&message));
                // Messages are stamped when they arrive: none is newer than now, and half a second later none is read.
                let is_current = at <= now && now.seconds_since(at) < KEPT_S;
                let written = is_current && written(&message, &mut scan);
                let header = SampleHeader::at(at);
                let accepted = written && self.ring.scan_from(layer, &scan, &header, &pose).is_ok();
                AcceptedMessage {
                    layer,
                    scan: accepted.then_some(scan),
                    message,
                    at,
                    attitude: self.attitude,
                }
            })
            .collect()
    }
}

fn written(message: &Message, scan: &mut RangeScan) -> bool {
    match message {
        Message::Beam { reading, .. } => reading.write(scan).is_ok(),
        Message::Row { frame, row, .. } => {
            FRAMES.iter().any(|(known, _)| known == frame) && row.write(scan).is_ok()
        }
    }
}

fn layer(message: &Message) -> usize {
    match message {
        Message::Beam { instance, .. } => *instance,
        Message::Row { .. } => ROW_LAYER,
    }
}

fn time(message: &Message) -> Timestamp {
    match message {
        Message::Beam { at, .. } | Message::Row { at, .. } => *at,
    }
}

fn micros(node: &Node<'_>) -> Result<Timestamp, Unreadable> {
    Ok(Timestamp::from_ns(node.integer()? as u64 * 1000))
}

fn read_beam(node: &Node<'_>) -> Result<Message, Unreadable> {
    let quaternion: [f64; 4] = node.get("q")?.numbers()?;
    Ok(Message::Beam {
        instance: node.get("instance")?.integer()? as usize,
        at: micros(&node.get("t_us")?)?,
        reading: BeamReading {
            range_min_m: node.get("min_m")?.number()? as f32,
            range_max_m: node.get("max_m")?.number()? as f32,
            range_m: node.get("current_m")?.number()? as f32,
            quality: node.get("quality")?.integer()? as i8,
            orientation: node.get("orientation")?.integer()? as u8,
            opening_rad: node.get("h_fov_rad")?.number()? as f32,
            quaternion: quaternion.map(|x| x as f32),
        },
    })
}

fn read_row(node: &Node<'_>) -> Result<Message, Unreadable> {
    let frame = node.get("frame")?.integer()?;
    let known = FRAMES.iter().find(|(code, _)| *code == frame);
    let distances: [i64; BINS] = node.get("distances_cm")?.bins()?;
    Ok(Message::Row {
        frame,
        at: micros(&node.get("t_us")?)?,
        row: ObstacleDistance {
            frame: known.map_or(ScanFrame::Level, |(_, frame)| *frame),
            increment_deg: node.get("increment_deg")?.number()? as f32,
            offset_deg: node.get("angle_offset_deg")?.number()? as f32,
            min_cm: node.get("min_cm")?.integer()? as u16,
            max_cm: node.get("max_cm")?.integer()? as u16,
            distances_cm: distances.map(|cm| cm as u16),
        },
    })
}

/// The parameters of `node`; what it does not name stays as in `before`.
fn read_config(before: Option<PreventionConfig>, node: &Node<'_>) -> Result<PreventionConfig, Unreadable> {
    let of = |name, old: fn(&PreventionConfig) -> f64| match (node.find(name), &before) {
        (Some(value), _) => value.number(),
        (None, Some(before)) => Ok(old(before)),
        (None, None) => node.get(name)?.number(),
    };
    Ok(PreventionConfig {
        distance_m: of("CP_DIST", |c| c.distance_m)?,
        delay_s: of("CP_DELAY", |c| c.delay_s)?,
        guide_rad: of("CP_GUIDE_ANG", |c| c.guide_rad.to_degrees())?.to_radians(),
        goes_unseen: of("CP_GO_NO_DATA", |c| f64::from(u8::from(c.goes_unseen)))? != 0.0,
        position_gain_per_s: of("MPC_XY_P", |c| c.position_gain_per_s)?,
        manual_mps: of("MPC_VEL_MANUAL", |c| c.manual_mps)?,
        jerk_mps3: of("MPC_JERK_MAX", |c| c.jerk_mps3)?,
        acceleration_mps2: of("MPC_ACC_HOR", |c| c.acceleration_mps2)?,
        velocity_gain_per_s: of("MPC_XY_VEL_P_ACC", |c| c.velocity_gain_per_s)?,
    })
}

fn without_hull() -> ParamSet {
    let mut params = ParamSet::default();
    for (name, value) in [("OA_VEH_RADIUS", 0.05), ("GD_BAND", 5.0)] {
        let set = params.set(name, value);
        debug_assert!(set.is_ok());
    }
    params
}
