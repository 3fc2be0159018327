//! A flight in which anything may happen: what is sent is always something that the autopilot may fly, and it is always sent.
//!
//! | law | measured after |
//! |---|---|
//! | no setpoint holds what its profile forbids, and none is of another profile | every step |
//! | setpoints go on for as long as it is known whose they are, a period and a half apart at most | every pause |
//! | whose they are stays known, once it was for longer than a second autopilot could put it in doubt | every step |
//! | every frame of ours is intact, understood, and from one of us | every step |
//! | a command to one of us has one final answer, another one none | every command |
//! | no more messages than fit; nothing wakes itself without end | every step |

use super::dice::Dice;
use super::ground::Ground;
use super::messages;
use jink_mavlink_gateway::{
    Body, COMPONENT_AUTOPILOT, COMPONENT_AVOIDANCE, COMPONENT_ONBOARD_COMPUTER, Content, Encoder, Gateway,
    GatewayConfig, HandoverState, Inputs, OUTBOX, Outputs, ProfileName, Receipt, Received, Remedy,
    Representation,
};
use jink_mavlink_link::frame::Splitter;
use jink_mavlink_link::signing::stamps::Stamps;
use jink_shared_types::bezier::{self, End};
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::ground::{GroundAction, GroundAnswer, MavlinkMessage};
use jink_shared_types::health::{Health, SystemStatus};
use jink_shared_types::layout::Layout;
use jink_shared_types::motion::{ApprovedTrajectory, BezierPiece, Trajectory, TrajectoryMode, Verdict};
use jink_shared_types::param_messages::ParameterValues;
use jink_shared_types::params::{self, ParamSet};
use jink_shared_types::prevention::{PreventedDemand, PreventionState};
use jink_shared_types::ring::SectorRing;
use jink_shared_types::{Coded, Flag, Reading, SampleHeader, Stamped, Timestamp, Velocity};
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::*;
use nalgebra::Vector3;

/// Steps of a story, so that none lasts for ever.
const STEPS_MAX: usize = 3000;
/// Whose autopilot it is, unless another one was there before.
const SYSTEM: u8 = 1;
/// For so long (s) a second autopilot may put the first in doubt.
const DEBOUNCE_S: f64 = 3.0;
/// Setpoints are this many periods apart at most, woken late by less than half of one.
const GAP_PERIODS: f64 = 1.5;

/// A sample with its header.
type Sample<T> = Option<(Box<T>, SampleHeader)>;

fn reading<T>(sample: &Sample<T>, now: Timestamp, deadline_ms: f64) -> Reading<'_, T> {
    let stamped = sample.as_ref().map(|(sample, header)| Stamped {
        sample: &**sample,
        header,
    });
    Reading::judge(stamped, now, deadline_ms)
}

/// The gateway, what it receives, and what it has said.
struct Story {
    config: GatewayConfig,
    gateway: Gateway,
    ground: Ground,
    outputs: Outputs,
    ours: Encoder,
    splitter: Splitter,
    now: Timestamp,
    began: Timestamp,
    pending: Vec<Received>,
    approved: Sample<ApprovedTrajectory>,
    ring: Sample<SectorRing>,
    prevented: Sample<PreventedDemand>,
    system: Sample<SystemStatus>,
    events: Vec<EventSample>,
    parameters: Option<ParameterValues>,
    /// What the ground services have answered, or somebody in their name.
    answers: Vec<GroundAnswer>,
    steps: usize,
    last_setpoint: Option<Timestamp>,
    /// Since when it has been known whose autopilot it is.
    known_since: Option<Timestamp>,
    /// The last thing that was asked of the autopilot about its mission.
    asked: Option<MavMessage>,
    /// Part of a period by which it is woken late.
    lateness: f64,
}

/// Runs the laws of a flight.
pub fn laws(data: &[u8]) {
    let mut dice = Dice::new(data);
    let mut story = Story::begin(&mut dice);
    while !dice.is_empty() && story.steps < STEPS_MAX {
        story.go_on(&mut dice);
    }
    story.wait(0.3);
}

impl Story {
    fn begin(dice: &mut Dice<'_>) -> Self {
        let (profile, representation) = dice.pick(&[
            (ProfileName::Px4Trajectory, Representation::Bezier),
            (ProfileName::Px4Trajectory, Representation::Waypoints),
            (ProfileName::Px4Offboard, Representation::Bezier),
            (ProfileName::Px4Deviation, Representation::Bezier),
            (ProfileName::ArdupilotGuided, Representation::Bezier),
        ]);
        let config = GatewayConfig {
            representation,
            takes_missions: !dice.once_in(4),
            system_id: dice.once_in(4).then_some(SYSTEM),
            blocked_remedy: dice.pick(&[Remedy::Wait, Remedy::Skip, Remedy::Stop]),
            computer_component_id: (!dice.once_in(4)).then_some(COMPONENT_ONBOARD_COMPUTER),
            is_proven: true,
            ..GatewayConfig::from_params(&ParamSet::default(), profile)
        };
        let began = Timestamp::from_seconds(1000.0);
        Self {
            config,
            gateway: Gateway::new(config),
            ground: Ground::new(),
            outputs: Outputs::default(),
            ours: Encoder::new(),
            splitter: Splitter::new(),
            now: began,
            began,
            pending: Vec::new(),
            approved: None,
            ring: None,
            prevented: None,
            system: None,
            events: Vec::new(),
            parameters: None,
            answers: Vec::new(),
            steps: 0,
            last_setpoint: None,
            known_since: None,
            asked: None,
            lateness: f64::from(dice.below(45)) / 100.0,
        }
    }

    fn us(&self) -> u8 {
        self.gateway.us(self.now).system_id.unwrap_or(SYSTEM)
    }

    fn boot_ms(&self) -> u32 {
        (self.now.seconds_since(self.began) * 1e3) as u32 + 60_000
    }

    /// One thing happens.
    fn go_on(&mut self, dice: &mut Dice<'_>) {
        match dice.below(24) {
            0..=3 => self.wait(f64::from(dice.below(120)) * 1e-3),
            4 => self.oversleep(f64::from(dice.byte()) * 0.05),
            5 => {
                // The autopilot falls silent.
                self.wait(f64::from(dice.below(40)) * 0.1);
            }
            6 | 7 => {
                let message = messages::heartbeat(dice, self.config.profile);
                self.autopilot_says(message);
            }
            8 => {
                let stamp_ms = if dice.once_in(8) {
                    dice.u32()
                } else {
                    self.boot_ms()
                };
                let message = messages::position(dice, stamp_ms);
                self.autopilot_says(message);
                self.locate();
            }
            9 => {
                let stamp_ms = if dice.once_in(8) {
                    dice.u32()
                } else {
                    self.boot_ms()
                };
                let message = messages::attitude(dice, stamp_ms);
                self.autopilot_says(message);
                self.locate();
            }
            10 | 11 => {
                let message = messages::wish(dice);
                self.autopilot_says(message);
            }
            12 => {
                let message = messages::telemetry(dice, self.boot_ms());
                self.autopilot_says(message);
            }
            13 => {
                if let Some(asked) = self.asked.take()
                    && let Some(answer) = messages::mission(dice, &asked, (self.us(), COMPONENT_AVOIDANCE))
                {
                    self.autopilot_says(answer);
                }
            }
            14 => self.somebody_says_anything(dice),
            15 => self.somebody_commands(dice),
            16 => {
                let whom = (self.us(), COMPONENT_AVOIDANCE);
                let message = match dice.below(3) {
                    0 => messages::parameter(dice, whom),
                    1 => messages::files(dice, whom),
                    _ => MavMessage::TIMESYNC(TIMESYNC_DATA {
                        tc1: if dice.once_in(2) { 0 } else { dice.u64() as i64 },
                        ts1: dice.u64() as i64,
                        target_system: dice.pick(&[0, whom.0, 9]),
                        target_component: dice.pick(&[0, whom.1, 9]),
                    }),
                };
                let copies = if dice.once_in(8) { 200 } else { 1 };
                for _ in 0..copies {
                    self.queue((255, 190), 1, Content::Message(message.clone()));
                }
                self.step();
            }
            17 | 18 => self.guard_says(dice),
            19 => self.approved = None,
            20 => {
                let (distance, range) = (dice.number(), dice.number());
                let ring = SectorRing {
                    distance_m: [distance; 72],
                    range_max_m: [range; 72],
                    range_min_m: dice.number(),
                    seen: [self.now; 72],
                    ..SectorRing::default()
                };
                self.ring = Some((Box::new(ring), SampleHeader::at(self.now)));
                let prevented = PreventedDemand {
                    velocity: Velocity::new(
                        f64::from(dice.number()),
                        f64::from(dice.number()),
                        f64::from(dice.number()),
                    ),
                    nearest_m: dice.number(),
                    state: Coded::new(dice.pick(&[
                        PreventionState::Off,
                        PreventionState::Acting,
                        PreventionState::Hold,
                    ])),
                    ..PreventedDemand::default()
                };
                self.prevented = Some((Box::new(prevented), SampleHeader::at(self.now)));
                let sticks = MANUAL_CONTROL_DATA {
                    x: dice.u16() as i16,
                    y: dice.u16() as i16,
                    ..MANUAL_CONTROL_DATA::default()
                };
                self.autopilot_says(MavMessage::MANUAL_CONTROL(sticks));
            }
            21 => {
                let health = dice.pick(&[
                    Health::Starting,
                    Health::Healthy,
                    Health::Healthy,
                    Health::Degraded,
                    Health::Failed,
                    Health::Stopping,
                ]);
                let status = SystemStatus {
                    health: Coded::new(health),
                    ..SystemStatus::default()
                };
                self.system = Some((Box::new(status), SampleHeader::at(self.now)));
            }
            22 => {
                let row = &events::TABLE[usize::from(dice.byte()) % events::TABLE.len()];
                self.events.push(EventSample {
                    id: dice.u16(),
                    ..EventSample::new(row, "planner", [f64::from(dice.number()); 2])
                });
            }
            _ => self.the_board_does_something(dice),
        }
        self.step();
    }

    fn queue(&mut self, (system, component_id): (u8, u8), link: u8, content: Content) {
        self.pending.push(Received {
            header: MavHeader {
                system_id: u32::from(system),
                component_id,
                sequence: 0,
            },
            content,
            time: self.now,
            link,
        });
    }

    fn autopilot_says(&mut self, message: MavMessage) {
        let link = self.gateway.autopilot_link();
        self.queue(messages::autopilot(self.us()), link, Content::Message(message));
        self.step();
    }

    /// Two sound positions: whatever the stamps before were, the second one counts.
    fn locate(&mut self) {
        for _ in 0..2 {
            self.autopilot_says(MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
                time_boot_ms: self.boot_ms(),
                x: 1.0,
                z: -5.0,
                ..LOCAL_POSITION_NED_DATA::default()
            }));
        }
    }

    /// From anybody, on any link.
    fn somebody_says_anything(&mut self, dice: &mut Dice<'_>) {
        let from = (
            dice.pick(&[self.us(), 0, 7, 255]),
            dice.pick(&[COMPONENT_AUTOPILOT, 0, 196]),
        );
        let link = dice.below(4);
        if let Some(content) = messages::any(dice, from) {
            self.queue(from, link, content);
            self.step();
            self.locate();
        }
    }

    fn somebody_commands(&mut self, dice: &mut Dice<'_>) {
        let components = [
            COMPONENT_AVOIDANCE,
            COMPONENT_ONBOARD_COMPUTER,
            COMPONENT_AUTOPILOT,
            0,
        ];
        let from = (dice.byte(), dice.byte());
        let targets = (dice.pick(&[self.us(), self.us(), 0, 9]), dice.pick(&components));
        let command = messages::command(dice, targets, from);
        let number = match &command {
            Content::Message(MavMessage::COMMAND_LONG(data)) => data.command as u16,
            Content::Message(MavMessage::COMMAND_INT(data)) => data.command as u16,
            Content::UnknownCommand { command, .. } => *command,
            // A number that the dialect knows in the third message.
            Content::Message(_) => return,
        };
        let us = self.gateway.us(self.now);
        let is_ours = us.system_id == Some(targets.0) && targets.1 != 0 && us.components.contains(&targets.1);
        // What was asked before has its answer.
        self.step();
        self.queue(from, dice.below(3), command);
        let mut acks = Vec::new();
        for _ in 0..2 {
            self.step();
            acks.extend(
                self.outputs
                    .messages()
                    .iter()
                    .filter_map(|sent| match &sent.body {
                        Body::CommandAck(ack) => Some((sent.component_id, *ack)),
                        Body::Message(_) => None,
                    }),
            );
        }
        assert_eq!(acks.len(), usize::from(is_ours), "to {targets:?}: {acks:?}");
        for (component, ack) in acks {
            assert_eq!((component, ack.command), (targets.1, number));
            assert_eq!((ack.target_system, ack.target_component), from);
            assert_ne!(ack.result, MavResult::MAV_RESULT_IN_PROGRESS, "no final answer");
        }
    }

    fn guard_says(&mut self, dice: &mut Dice<'_>) {
        let mut vector = || Vector3::new(dice.metres(), dice.metres(), dice.metres());
        let (from, velocity, to) = (vector(), vector() * 0.2, vector());
        let duration_s = 0.5 + f64::from(dice.below(60)) * 0.1;
        let end = |position, velocity| End {
            position,
            velocity,
            acceleration: Vector3::zeros(),
        };
        let mut trajectory = Trajectory {
            id: if dice.once_in(4) { dice.u64() } else { self.now.ns },
            start: self.now,
            splice: self.now,
            mode: Coded::new(dice.pick(&[
                TrajectoryMode::Plan,
                TrajectoryMode::Plan,
                TrajectoryMode::Stop,
                TrajectoryMode::Mirror,
            ])),
            ..Trajectory::default()
        };
        let points = bezier::quintic_between(&end(from, velocity), &end(to, Vector3::zeros()), duration_s);
        trajectory.push(BezierPiece::new(&points, [dice.metres(); 6], duration_s));
        if dice.once_in(3) {
            // Shared memory may hold anything.
            let piece = &mut trajectory.pieces[0];
            let number = f64::from(dice.number());
            match dice.below(6) {
                0 => piece.duration_s = number,
                1 => piece.yaw_rad[usize::from(dice.below(6))] = number,
                2 => piece.position[usize::from(dice.below(6))].x_m = number,
                3 => trajectory.len = dice.u32(),
                4 => trajectory.start.ns = dice.u64(),
                _ => piece.duration_s = f64::from_bits(dice.u64()),
            }
        }
        let approved = ApprovedTrajectory {
            trajectory,
            verdict: Coded::new(dice.pick(&[
                Verdict::Passed,
                Verdict::Passed,
                Verdict::Kept,
                Verdict::Braked,
                Verdict::Hold,
            ])),
            ..ApprovedTrajectory::default()
        };
        let mut header = SampleHeader::at(self.now);
        if dice.once_in(8) {
            header.capture.ns = dice.u64();
        }
        self.approved = Some((Box::new(approved), header));
    }

    fn the_board_does_something(&mut self, dice: &mut Dice<'_>) {
        match dice.below(5) {
            0 => {
                let mut values = ParameterValues::of(self.gateway.params());
                values.answered = dice.u64();
                if dice.once_in(4) {
                    values.table = dice.u64();
                }
                if let Some(value) = values.values.get_mut(usize::from(dice.byte())) {
                    *value = f64::from(dice.number());
                }
                self.parameters = Some(values);
            }
            1 => self.gateway.listen_only(dice.once_in(2)),
            2 => self.gateway.resume_now(self.now),
            3 => self.somebody_speaks_for_the_ground_services(dice),
            _ => {
                let handover = HandoverState::of(&self.gateway, &self.ours, Stamps::begin(dice.u64()));
                let mut bytes = handover.to_bytes();
                if dice.once_in(2) {
                    let reported = dice.take(bytes.len());
                    bytes[..reported.len()].copy_from_slice(reported);
                    // A wrong time may cost a beat, no more.
                    self.last_setpoint = self.last_setpoint.map(|_| self.now);
                }
                let handover = HandoverState::of_bytes(&bytes).expect("its length is right");
                let _stamps = handover.hand_to(self.now, &mut self.gateway, &mut self.ours);
            }
        }
    }

    /// A ground service that has gone wrong may say anything; it is never a setpoint.
    fn somebody_speaks_for_the_ground_services(&mut self, dice: &mut Dice<'_>) {
        let mut message = MavlinkMessage {
            id: dice.known_id(),
            len: dice.byte(),
            ..MavlinkMessage::default()
        };
        let bytes = dice.take(usize::from(message.len));
        message.payload[..bytes.len()].copy_from_slice(bytes);
        self.answers.push(GroundAnswer {
            message,
            period_us: dice.u32(),
            action: Coded::new(dice.pick(&[
                GroundAction::Send,
                GroundAction::Send,
                GroundAction::Heartbeat,
                GroundAction::Obstacles,
                GroundAction::ObstaclePeriod,
                GroundAction::Restart,
            ])),
            link: dice.byte(),
            of_computer: Flag::from(dice.once_in(2)),
            ..GroundAnswer::default()
        });
        self.step();
    }

    /// Time passes, and the gateway is woken when it wants to be, a little late.
    fn wait(&mut self, seconds: f64) {
        let until = self.now.plus_seconds(seconds);
        loop {
            let wake = self.gateway.next_wake(self.now).max(self.now);
            let wake = wake.plus_seconds(self.lateness / self.config.setpoint_rate_hz);
            if wake > until || self.steps > 2 * STEPS_MAX {
                break;
            }
            self.pass_to(wake);
            self.step();
        }
        self.pass_to(until.max(self.now));
        self.step();
    }

    /// It gets no processor for a while.
    fn oversleep(&mut self, seconds: f64) {
        self.now = self.now.plus_seconds(seconds);
        self.last_setpoint = self.last_setpoint.map(|_| self.now);
        self.step();
    }

    fn pass_to(&mut self, time: Timestamp) {
        if self.gateway.us(self.now).system_id.is_none() {
            // Nobody knows for whom setpoints would be.
            self.last_setpoint = self.last_setpoint.map(|_| time);
        }
        // Where nothing is to be deviated, silence is what lets the autopilot fly.
        let may_be_silent = self.config.profile == ProfileName::Px4Deviation;
        if self.gateway.waits_for_air() || self.gateway.rests(self.now) || may_be_silent {
            self.last_setpoint = self.last_setpoint.map(|_| time);
        }
        self.now = time;
        if let Some(last) = self.last_setpoint {
            let gap_s = time.seconds_since(last);
            let [before_hz, now_hz] = [last, time].map(|time| self.gateway.setpoint_rate_hz(time));
            let limit_s = GAP_PERIODS / before_hz.min(now_hz) + 1e-6;
            assert!(gap_s <= limit_s, "silent for {gap_s} s, {limit_s} s are allowed");
        }
    }

    /// One step, and everything that must hold after it.
    fn step(&mut self) {
        self.steps += 1;
        let inputs = Inputs {
            messages: &self.pending,
            link: Default::default(),
            approved: reading(&self.approved, self.now, 150.0),
            prevented: reading(&self.prevented, self.now, 300.0),
            ring: reading(&self.ring, self.now, 200.0),
            system: reading(&self.system, self.now, 300.0),
            events: &self.events,
            parameters: self.parameters.as_ref(),
            answers: &self.answers,
        };
        self.gateway.step(self.now, &inputs, &mut self.outputs);
        self.ground
            .step(self.now, &self.outputs, &self.events, self.parameters.as_ref());
        self.parameters = None;
        self.answers.clear();
        self.answers.extend(self.ground.outputs.answers());
        self.pending.clear();
        self.events.clear();
        assert!(self.outputs.messages().len() <= OUTBOX);
        let setpoints = self.judge_messages();
        assert!(setpoints <= 1, "{setpoints} setpoints in one step");
        self.judge_samples();
        assert!(
            self.gateway.next_wake(self.now) > self.now,
            "it would be woken without end"
        );
        self.judge_identity();
        if setpoints > 0 || self.last_setpoint.is_some() && self.gateway.us(self.now).system_id.is_none() {
            self.last_setpoint = Some(self.now);
        }
    }

    /// Looks at every message as its receiver does; answers how many are setpoints.
    fn judge_messages(&mut self) -> usize {
        let us = self.gateway.us(self.now);
        let mut setpoints = 0;
        for sent in self.outputs.messages() {
            assert!(us.components.contains(&sent.component_id) && sent.component_id != 0);
            let bytes = self.ours.encode(sent.system_id, sent.component_id, &sent.body);
            self.splitter.load_datagram(bytes);
            let frame = self.splitter.next_frame().expect("a frame of ours is intact");
            assert_eq!(frame.header.system_id, u32::from(us.system_id.unwrap_or(SYSTEM)));
            let is_setpoint = matches!(sent.receipt, Receipt::Setpoint { .. });
            setpoints += usize::from(is_setpoint);
            match (&sent.body, frame.decode()) {
                (_, Ok(message)) => {
                    judge_setpoint(&self.config, self.now, is_setpoint, &message);
                    if matches!(
                        message,
                        MavMessage::MISSION_REQUEST_LIST(_) | MavMessage::MISSION_REQUEST_INT(_)
                    ) {
                        self.asked = Some(message);
                    }
                }
                // The answer to a command that the dialect does not know.
                (body, Err(error)) => assert!(matches!(body, Body::CommandAck(_)), "{error}"),
            }
            self.gateway.wire(self.now, sent.receipt);
        }
        setpoints
    }

    fn judge_samples(&self) {
        if let Some((state, _)) = &self.outputs.vehicle_state {
            assert!(state.is_plausible() && state.position.is_finite(), "{state:?}");
            assert!(state.attitude.is_rotation() && !state.ground_distance_m.is_infinite());
        }
        if let Some((path, _)) = &self.outputs.desired_path {
            assert!(path.is_plausible(), "{path:?}");
        }
        if let Some((demand, _)) = &self.outputs.pilot_demand {
            assert!(demand.is_plausible(), "{demand:?}");
        }
        if let Some(status) = &self.outputs.link_status {
            assert!(status.is_plausible(), "{status:?}");
        }
        for request in self.outputs.requests() {
            assert!(request.is_plausible(), "{request:?}");
        }
        for arrived in self.outputs.scans() {
            assert!(arrived.scan.is_plausible(), "{:?}", arrived.scan);
        }
        for answer in self.ground.outputs.answers() {
            assert!(answer.is_plausible(), "{answer:?}");
        }
        for row in params::TABLE {
            let value = self.gateway.params().get(row);
            assert!((row.min..=row.max).contains(&value), "{} = {value}", row.name);
        }
    }

    fn judge_identity(&mut self) {
        match self.gateway.us(self.now).system_id {
            Some(system_id) => {
                assert_ne!(system_id, 0, "nobody is system 0");
                self.known_since.get_or_insert(self.now);
            }
            None => {
                let known_s = self
                    .known_since
                    .take()
                    .map_or(0.0, |since| self.now.seconds_since(since));
                assert!(
                    known_s <= DEBOUNCE_S + 1e-6,
                    "the autopilot is nobody's after {known_s} s"
                );
            }
        }
    }
}

/// Whether `message` is what the profile may send: a setpoint without anything that it forbids, or none.
fn judge_setpoint(config: &GatewayConfig, now: Timestamp, is_setpoint: bool, message: &MavMessage) {
    use ProfileName::{ArdupilotGuided, Px4Deviation, Px4Offboard, Px4Trajectory};
    use Representation::{Bezier, Waypoints};
    match (message, config.profile, config.representation) {
        (MavMessage::TRAJECTORY_REPRESENTATION_BEZIER(curve), Px4Trajectory, Bezier) => {
            judge_curve(now, curve);
        }
        (MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(announcement), Px4Trajectory, Bezier) => {
            assert!(!is_setpoint && announcement.valid_points == 0, "{announcement:?}");
            assert!(announcement.pos_x.iter().all(|x| x.is_nan()), "{announcement:?}");
        }
        (MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(waypoints), Px4Trajectory, Waypoints) => {
            judge_waypoints(waypoints);
        }
        (MavMessage::SET_POSITION_TARGET_LOCAL_NED(target), Px4Offboard | ArdupilotGuided, _) => {
            judge_assisted_or_whole(config.profile, target);
        }
        (MavMessage::SET_POSITION_TARGET_LOCAL_NED(target), Px4Deviation, _) => judge_deviation(target),
        (
            MavMessage::TRAJECTORY_REPRESENTATION_BEZIER(_)
            | MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(_)
            | MavMessage::SET_POSITION_TARGET_LOCAL_NED(_),
            profile,
            _,
        ) => panic!("{profile:?} never sends {message:?}"),
        _ => assert!(!is_setpoint, "{message:?}"),
    }
}

fn judge_curve(now: Timestamp, curve: &TRAJECTORY_REPRESENTATION_BEZIER_DATA) {
    assert_eq!(curve.valid_points, 5);
    let numbers = [curve.pos_x, curve.pos_y, curve.pos_z, curve.pos_yaw, curve.delta];
    assert!(numbers.iter().flatten().all(|n| n.is_finite()), "{curve:?}");
    assert!(curve.delta[4] > 0.0, "{curve:?}");
    let start = Timestamp::from_ns(curve.time_usec * 1000);
    let age_s = now.seconds_since(start);
    assert!(age_s >= 0.0, "it starts in {} s", -age_s);
    assert!(age_s < f64::from(curve.delta[4]), "it is over");
    let turned = curve.pos_yaw.map(|yaw| (yaw - curve.pos_yaw[0]).abs());
    assert!(
        turned.iter().all(|turned| *turned < 3.2),
        "PX4 would unwrap {turned:?}"
    );
}

fn judge_waypoints(waypoints: &TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA) {
    assert_eq!(waypoints.valid_points, 1);
    let position = [waypoints.pos_x, waypoints.pos_y, waypoints.pos_z];
    let velocity = [waypoints.vel_x, waypoints.vel_y, waypoints.vel_z];
    let acceleration = [waypoints.acc_x, waypoints.acc_y, waypoints.acc_z];
    let heading = [waypoints.pos_yaw, waypoints.vel_yaw];
    for axis in 0..3 {
        let (p, v) = (position[axis][0], velocity[axis][0]);
        assert!(
            p.is_finite() || v.is_finite(),
            "axis {axis} is nowhere: {waypoints:?}"
        );
    }
    let given = position.iter().chain(&velocity).chain(&heading);
    assert!(
        given.clone().all(|field| !field[0].is_infinite()),
        "{waypoints:?}"
    );
    assert!(
        given.clone().all(|field| field[1..].iter().all(|n| n.is_nan())),
        "{waypoints:?}"
    );
    assert!(acceleration.iter().flatten().all(|n| n.is_nan()), "{waypoints:?}");
    assert_eq!(waypoints.command, [u16::MAX; 5]);
}

fn judge_deviation(target: &SET_POSITION_TARGET_LOCAL_NED_DATA) {
    let whole = SET_POSITION_TARGET_LOCAL_NED_DATA {
        type_mask: PositionTargetTypemask::empty(),
        ..target.clone()
    };
    judge_target(&whole);
    // Positions and headings are not given, velocities and accelerations are; where a pilot steers, the horizontal ones.
    let masks = [0b1100_0000_0111, 0b1101_0010_0111];
    assert!(masks.contains(&target.type_mask.bits()), "{target:?}");
}

/// Everything is given; where a pilot is assisted, but for the place and the heading: ArduCopter ignores the whole group.
fn judge_assisted_or_whole(profile: ProfileName, target: &SET_POSITION_TARGET_LOCAL_NED_DATA) {
    let place = match profile {
        ProfileName::ArdupilotGuided => 0b111,
        _ => 0b011,
    };
    let heading = 0b100_0000_0000;
    let masks = [0, heading, place, place | heading];
    assert!(masks.contains(&target.type_mask.bits()), "{target:?}");
    judge_target(&SET_POSITION_TARGET_LOCAL_NED_DATA {
        type_mask: PositionTargetTypemask::empty(),
        ..target.clone()
    });
}

fn judge_target(target: &SET_POSITION_TARGET_LOCAL_NED_DATA) {
    let numbers = [
        target.x,
        target.y,
        target.z,
        target.vx,
        target.vy,
        target.vz,
        target.afx,
        target.afy,
        target.afz,
        target.yaw,
        target.yaw_rate,
    ];
    assert!(numbers.iter().all(|n| n.is_finite()), "{target:?}");
    assert_eq!(target.type_mask, PositionTargetTypemask::empty());
    assert_eq!(target.coordinate_frame, MavFrame::MAV_FRAME_LOCAL_NED);
    assert_eq!(target.target_component, COMPONENT_AUTOPILOT);
}
