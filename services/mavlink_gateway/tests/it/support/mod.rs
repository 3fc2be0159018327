//! A gateway on a test bench: an autopilot that sends real bytes, a guard, a supervisor, and a log of what is sent.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
#![allow(dead_code)] // Every test file uses its own part of the bench.
#![allow(deprecated)] // The trajectory messages are gone from PX4 1.16 on; this profile is for the versions before.

use crate::harness::ground::Ground;
use jink_mavlink_gateway::{
    COMPONENT_AUTOPILOT, Content, Destination, Encoder, Gateway, GatewayConfig, Inputs, Outputs, Received,
};
use jink_mavlink_link::frame::Splitter;
use jink_parameter_server::ParameterServer;
use jink_shared_types::bezier::{self, End};
use jink_shared_types::events::EventSample;
use jink_shared_types::health::{Health, SystemStatus};
use jink_shared_types::link::LinkStatus;
use jink_shared_types::motion::{ApprovedTrajectory, BezierPiece, Trajectory, TrajectoryMode, Verdict};
use jink_shared_types::param_messages::ParameterValues;
use jink_shared_types::params::ParamSet;
use jink_shared_types::prevention::PreventedDemand;
use jink_shared_types::ring::SectorRing;
use jink_shared_types::vehicle::{DesiredPath, VehicleState};
use jink_shared_types::{Coded, Reading, SampleHeader, Stamped, Timestamp};
use mavlink::MessageData;
use mavlink::dialect::*;
use nalgebra::Vector3;

pub const SYSTEM: u8 = 1;
pub const MODE_POSITION: u32 = 3 << 16;
pub const MODE_TAKEOFF: u32 = 4 << 16 | 2 << 24;
pub const MODE_HOLD: u32 = 4 << 16 | 3 << 24;
pub const MODE_MISSION: u32 = 4 << 16 | 4 << 24;
pub const MODE_LAND: u32 = 4 << 16 | 6 << 24;

/// A message as it left, decoded again from its bytes.
#[derive(Clone, Debug)]
pub struct Sent {
    pub time: Timestamp,
    pub component_id: u8,
    pub message: MavMessage,
    pub to: Destination,
}

/// A sample with its header.
#[derive(Clone, Debug)]
pub struct Sample<T> {
    pub value: Box<T>,
    pub header: SampleHeader,
}

impl<T> Sample<T> {
    pub fn new(value: T, published: Timestamp) -> Self {
        Self {
            value: Box::new(value),
            header: SampleHeader::at(published),
        }
    }

    pub fn reading(sample: &Option<Self>, now: Timestamp, deadline_ms: f64) -> Reading<'_, T> {
        let stamped = sample.as_ref().map(|sample| Stamped {
            sample: &*sample.value,
            header: &sample.header,
        });
        Reading::judge(stamped, now, deadline_ms)
    }
}

pub struct Bench {
    pub gateway: Gateway,
    pub outputs: Outputs,
    /// What comes of the answers.
    answered: Outputs,
    pub ground: Ground,
    pub now: Timestamp,
    pub approved: Option<Sample<ApprovedTrajectory>>,
    pub ring: Option<Sample<SectorRing>>,
    pub prevented: Option<Sample<PreventedDemand>>,
    pub system: Option<Sample<SystemStatus>>,
    pub events: Vec<EventSample>,
    pub sent: Vec<Sent>,
    pub states: Vec<(VehicleState, Timestamp)>,
    pub paths: Vec<(DesiredPath, Timestamp)>,
    pub status: Option<LinkStatus>,
    pub boot_ms_at_zero: u32,
    /// The link on which messages are received.
    pub link: u8,
    /// The owner of the parameters; `None` = it is dead.
    pub server: Option<ParameterServer>,
    /// What it has published since the last step.
    pub parameters: Option<ParameterValues>,
    pending: Vec<Received>,
    autopilot: Encoder,
    ours: Encoder,
    splitter: Splitter,
}

pub fn at(s: f64) -> Timestamp {
    Timestamp::from_seconds(1000.0 + s)
}

impl Bench {
    pub fn new() -> Self {
        Self::with(GatewayConfig::default())
    }

    /// The profile fits, as an earlier gateway has found out.
    pub fn with(config: GatewayConfig) -> Self {
        Self::unproven(GatewayConfig {
            is_proven: true,
            ..config
        })
    }

    /// Whether the profile fits is still to be found out.
    pub fn unproven(config: GatewayConfig) -> Self {
        Self {
            gateway: Gateway::new(config),
            outputs: Outputs::default(),
            answered: Outputs::default(),
            ground: Ground::new(),
            now: at(0.0),
            approved: None,
            ring: None,
            prevented: None,
            system: None,
            events: Vec::new(),
            sent: Vec::new(),
            states: Vec::new(),
            paths: Vec::new(),
            status: None,
            boot_ms_at_zero: 60_000,
            link: 0,
            server: Some(ParameterServer::new(&ParamSet::default())),
            parameters: None,
            pending: Vec::new(),
            autopilot: Encoder::new(),
            ours: Encoder::new(),
            splitter: Splitter::new(),
        }
    }

    /// The autopilot's clock.
    pub fn boot_ms(&self, time: Timestamp) -> u32 {
        self.boot_ms_at_zero
            .wrapping_add((time.seconds_since(at(0.0)) * 1e3).round() as i64 as u32)
    }

    /// Queues a message from `system`/`component`, through real bytes.
    pub fn receive_from(&mut self, system: u8, component: u8, message: MavMessage) {
        let body = jink_mavlink_gateway::Body::Message(message);
        let bytes = self.autopilot.encode(system, component, &body).to_vec();
        self.receive_bytes(&bytes);
    }

    pub fn receive_bytes(&mut self, bytes: &[u8]) {
        self.splitter.load_datagram(bytes);
        while let Some(frame) = self.splitter.next_frame() {
            if let Some(content) = Content::of(&frame) {
                self.pending.push(Received {
                    header: frame.header,
                    content,
                    time: self.now,
                    link: self.link,
                });
            }
        }
    }

    pub fn receive(&mut self, message: MavMessage) {
        self.receive_from(SYSTEM, COMPONENT_AUTOPILOT, message);
    }

    pub fn receive_heartbeat(&mut self, custom_mode: u32, armed: bool) {
        self.receive(heartbeat(custom_mode, armed));
    }

    pub fn receive_position(&mut self, position: Vector3<f64>, velocity: Vector3<f64>) {
        let time_boot_ms = self.boot_ms(self.now);
        self.receive(MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
            time_boot_ms,
            x: position.x as f32,
            y: position.y as f32,
            z: position.z as f32,
            vx: velocity.x as f32,
            vy: velocity.y as f32,
            vz: velocity.z as f32,
        }));
    }

    pub fn receive_attitude(&mut self, yaw_rad: f64) {
        let time_boot_ms = self.boot_ms(self.now);
        self.receive(MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
            time_boot_ms,
            q1: (yaw_rad / 2.0).cos() as f32,
            q4: (yaw_rad / 2.0).sin() as f32,
            ..ATTITUDE_QUATERNION_DATA::default()
        }));
    }

    /// Steps with everything queued, at the present time; checks what must hold after every step.
    pub fn step(&mut self) {
        let inputs = Inputs {
            messages: &self.pending,
            link: Default::default(),
            approved: Sample::reading(&self.approved, self.now, 150.0),
            prevented: Sample::reading(&self.prevented, self.now, 300.0),
            ring: Sample::reading(&self.ring, self.now, 200.0),
            system: Sample::reading(&self.system, self.now, 300.0),
            events: &self.events,
            parameters: self.parameters.as_ref(),
            answers: &[],
        };
        self.gateway.step(self.now, &inputs, &mut self.outputs);
        let parameters = self.parameters.take();
        self.ground
            .step(self.now, &self.outputs, &self.events, parameters.as_ref());
        self.pending.clear();
        self.events.clear();
        let change = self.ground.outputs.parameter_change;
        if let (Some(change), Some(server)) = (&change, &mut self.server) {
            server.take(change);
            self.parameters = Some(server.publish(self.now));
        }
        self.log_what_is_sent(false);
        if !self.ground.outputs.answers().is_empty() {
            let inputs = Inputs {
                messages: &[],
                link: Default::default(),
                approved: Sample::reading(&self.approved, self.now, 150.0),
                prevented: Sample::reading(&self.prevented, self.now, 300.0),
                ring: Sample::reading(&self.ring, self.now, 200.0),
                system: Sample::reading(&self.system, self.now, 300.0),
                events: &[],
                parameters: None,
                answers: self.ground.outputs.answers(),
            };
            self.gateway.step(self.now, &inputs, &mut self.answered);
            self.outputs.restart |= self.answered.restart;
            self.log_what_is_sent(true);
        }
        self.states.extend(self.outputs.vehicle_state);
        self.paths.extend(self.outputs.desired_path);
        self.status = self.outputs.link_status.or(self.status);
        assert!(self.next_wake() > self.now, "it would be woken without end");
    }

    /// When something is due next.
    pub fn next_wake(&self) -> Timestamp {
        self.gateway
            .next_wake(self.now)
            .min(self.ground.services.next_wake())
    }

    fn log_what_is_sent(&mut self, answers: bool) {
        let outputs = if answers { &self.answered } else { &self.outputs };
        for outgoing in outputs.messages() {
            let bytes = self
                .ours
                .encode(outgoing.system_id, outgoing.component_id, &outgoing.body);
            self.splitter.load_datagram(bytes);
            let frame = self.splitter.next_frame().expect("a frame of ours is intact");
            assert_eq!(frame.header.system_id, u32::from(SYSTEM));
            match frame.decode() {
                Ok(mut message) => {
                    if let MavMessage::TRAJECTORY_REPRESENTATION_BEZIER(curve) = &mut message {
                        // In the board's clock, as all else here.
                        let began_us = 1000 * u64::from(self.boot_ms_at_zero);
                        curve.time_usec =
                            (at(0.0).ns / 1000).wrapping_add(curve.time_usec.wrapping_sub(began_us));
                    }
                    self.sent.push(Sent {
                        time: self.now,
                        component_id: frame.header.component_id,
                        message,
                        to: outgoing.to,
                    });
                }
                // The answer to a command that the dialect does not know.
                Err(error) => assert_eq!(frame.message_id, COMMAND_ACK_DATA::ID, "{error}"),
            }
            self.gateway.wire(self.now, outgoing.receipt);
        }
    }

    /// Steps at every wake-up of the gateway until `until`, with nothing new from outside.
    pub fn idle_until(&mut self, until: Timestamp) {
        loop {
            let wake = self.next_wake().max(self.now);
            if wake > until {
                break;
            }
            self.now = wake;
            self.step();
        }
        self.now = until;
    }

    /// Flies for `duration_s` in steps of 10 ms: a vehicle at `position(t)`, `t` seconds from the beginning.
    pub fn fly(&mut self, duration_s: f64, mut each: impl FnMut(&mut Self, f64)) {
        let start = self.now;
        for i in 0..(duration_s * 100.0).round() as u32 {
            let t = f64::from(i) / 100.0;
            self.idle_until(start.plus_seconds(t));
            each(self, t);
            self.step();
        }
        self.idle_until(start.plus_seconds(duration_s));
    }

    /// A vehicle at rest at `position`: telemetry for one call per 10 ms.
    pub fn telemetry(&mut self, t: f64, custom_mode: u32, position: Vector3<f64>, velocity: Vector3<f64>) {
        let tick = (t * 100.0).round() as u32;
        if tick.is_multiple_of(100) {
            self.receive_heartbeat(custom_mode, true);
        }
        if tick.is_multiple_of(3) {
            self.receive_position(position, velocity);
        }
        if tick.is_multiple_of(2) {
            self.receive_attitude(0.3);
        }
    }

    pub fn approve(&mut self, verdict: Verdict, trajectory: Trajectory) {
        let approved = ApprovedTrajectory {
            trajectory,
            verdict: Coded::new(verdict),
            ..ApprovedTrajectory::default()
        };
        self.approved = Some(Sample::new(approved, self.now));
    }

    pub fn healthy(&mut self, health: Health) {
        let status = SystemStatus {
            health: Coded::new(health),
            ..SystemStatus::default()
        };
        self.system = Some(Sample::new(status, self.now));
    }

    pub fn ranges(&mut self) {
        let mut ring = SectorRing::default();
        ring.seen[3] = self.now;
        self.ring = Some(Sample::new(ring, self.now));
    }

    /// All curves sent, with the time of sending.
    pub fn curves(&self) -> Vec<(Timestamp, TRAJECTORY_REPRESENTATION_BEZIER_DATA)> {
        self.sent
            .iter()
            .filter_map(|sent| match &sent.message {
                MavMessage::TRAJECTORY_REPRESENTATION_BEZIER(data) => Some((sent.time, data.clone())),
                _ => None,
            })
            .collect()
    }

    pub fn last_curve(&self) -> TRAJECTORY_REPRESENTATION_BEZIER_DATA {
        self.curves().pop().expect("a setpoint was sent").1
    }

    /// States of the heartbeats that `component_id` sent, with the times.
    pub fn heartbeats(&self, component_id: u8) -> Vec<(Timestamp, HEARTBEAT_DATA)> {
        self.sent
            .iter()
            .filter(|sent| sent.component_id == component_id)
            .filter_map(|sent| match &sent.message {
                MavMessage::HEARTBEAT(data) => Some((sent.time, data.clone())),
                _ => None,
            })
            .collect()
    }
}

pub fn heartbeat(custom_mode: u32, armed: bool) -> MavMessage {
    let mut base_mode = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
    base_mode.set(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED, armed);
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode,
        mavtype: MavType::MAV_TYPE_QUADROTOR,
        autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
        base_mode,
        system_status: MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    })
}

/// The autopilot's wish with three points at `targets` (position, command); everything else as PX4 sends it.
pub fn waypoints(targets: [(Vector3<f64>, u16); 3]) -> TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA {
    let unset = [f32::NAN; 5];
    let mut data = TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA {
        time_usec: 0,
        pos_x: unset,
        pos_y: unset,
        pos_z: unset,
        vel_x: unset,
        vel_y: unset,
        vel_z: unset,
        acc_x: unset,
        acc_y: unset,
        acc_z: unset,
        pos_yaw: unset,
        vel_yaw: unset,
        command: [u16::MAX; 5],
        valid_points: 3,
    };
    for (i, (position, command)) in targets.into_iter().enumerate() {
        data.pos_x[i] = position.x as f32;
        data.pos_y[i] = position.y as f32;
        data.pos_z[i] = position.z as f32;
        data.command[i] = command;
    }
    data.pos_yaw[1] = 1.0;
    data
}

pub fn wish(targets: [(Vector3<f64>, u16); 3]) -> MavMessage {
    MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(waypoints(targets))
}

/// A straight flight from `from` at `start` over `way`, at rest at both ends, in two pieces.
pub fn flight(
    id: u64,
    start: Timestamp,
    from: Vector3<f64>,
    way: Vector3<f64>,
    duration_s: f64,
) -> Trajectory {
    let half_s = duration_s / 2.0;
    let end = |position: Vector3<f64>, velocity: Vector3<f64>| End {
        position,
        velocity,
        acceleration: Vector3::zeros(),
    };
    let rest = Vector3::zeros();
    let middle = end(from + way / 2.0, way * (1.8 / duration_s));
    let mut trajectory = Trajectory {
        id,
        start,
        splice: start,
        mode: Coded::new(TrajectoryMode::Plan),
        ..Trajectory::default()
    };
    for (first, last) in [(end(from, rest), middle), (middle, end(from + way, rest))] {
        trajectory.push(BezierPiece::new(
            &bezier::quintic_between(&first, &last, half_s),
            [0.3; 6],
            half_s,
        ));
    }
    trajectory
}

/// The approval that says "send the autopilot's own setpoint back".
pub fn mirror() -> Trajectory {
    Trajectory {
        mode: Coded::new(TrajectoryMode::Mirror),
        ..Trajectory::default()
    }
}

pub fn control_points(data: &TRAJECTORY_REPRESENTATION_BEZIER_DATA) -> [Vector3<f64>; 5] {
    std::array::from_fn(|i| Vector3::new(data.pos_x[i], data.pos_y[i], data.pos_z[i]).map(f64::from))
}

/// Where PX4 would be sent at `time` by this curve, its clock being ours; `None` outside the curve.
pub fn evaluate(data: &TRAJECTORY_REPRESENTATION_BEZIER_DATA, time: Timestamp) -> Option<Vector3<f64>> {
    let u = time.seconds_since(Timestamp::from_ns(data.time_usec * 1000)) / f64::from(data.delta[4]);
    (0.0..=1.0)
        .contains(&u)
        .then(|| bezier::evaluate(&control_points(data), u))
}
