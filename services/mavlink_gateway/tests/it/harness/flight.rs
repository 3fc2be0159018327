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

mod output_checks;
mod random_inputs;
mod setpoint_checks;

use super::dice::Dice;
use super::ground::Ground;
use jink_mavlink_gateway::{
    COMPONENT_ONBOARD_COMPUTER, Encoder, Gateway, GatewayConfig, Inputs, OUTBOX, Outputs, ProfileName,
    Received, Remedy, Representation,
};
use jink_mavlink_link::frame::Splitter;
use jink_shared_types::events::EventSample;
use jink_shared_types::ground::GroundAnswer;
use jink_shared_types::health::SystemStatus;
use jink_shared_types::motion::ApprovedTrajectory;
use jink_shared_types::param_messages::ParameterValues;
use jink_shared_types::params::ParamSet;
use jink_shared_types::prevention::PreventedDemand;
use jink_shared_types::ring::SectorRing;
use jink_shared_types::{Reading, SampleHeader, Stamped, Timestamp};
use mavlink::dialect::MavMessage;

/// Steps of a story, so that none lasts for ever.
const STEPS_MAX: usize = 3000;
/// Whose autopilot it is, unless another one was there before.
const SYSTEM: u8 = 1;
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
}
