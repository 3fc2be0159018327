//! The gateway itself: one pure step from messages and samples to messages and samples.

mod assist;
mod controlled_stop;
mod echoes;
mod intake;
mod mission;
mod mode_choice;
mod profile_check;
mod serve;
mod steering;
mod unguarded_mode;
mod watch;

use crate::avoidance::{self, Heartbeats, Input};
use crate::blockage::Blockage;
use crate::config::GatewayConfig;
use crate::desired::VerticalMotions;
use crate::executive::Part;
use crate::io::{Inputs, Outputs};
use crate::landed_state::LandedState;
use crate::obstacles;
use crate::profile::pilot::is_for_flying;
use crate::profile::{Profile, Situation};
use crate::radio_share::{REPEATED_HZ, RadioShare};
use crate::ranges::RangeSources;
use crate::vehicle::VehicleTracker;
use crate::wire::Wire;
use assist::AssistedFlight;
use controlled_stop::ControlledStop;
use jink_mavlink_link::budget::TrafficClass;
use jink_mavlink_link::clock_map::{ClockMap, SEARCHING_HZ, nanoseconds};
use jink_mavlink_link::message::{Body, COMPONENT_AUTOPILOT, Destination, Outgoing, Receipt};
use jink_mavlink_link::router::OwnIds;
use jink_mavlink_link::streams::Streams;
use jink_mavlink_link::ticker::Ticker;
use jink_mavlink_link::vehicle_selector::VehicleSelector;
use jink_shared_types::events::{
    AUTOPILOT_FOUND, AUTOPILOT_LOST, EventSample, GOAL_BLOCKED, LANDED_UNKNOWN, TWO_AUTOPILOTS,
};
use jink_shared_types::health::Name;
use jink_shared_types::link::{AvoidanceState, LinkStatus};
use jink_shared_types::params::{GW_OBST_RATE, MPC_XY_P, MPC_XY_VEL_P_ACC, ParamSet};
use jink_shared_types::tracking::Tracking;
use jink_shared_types::vehicle::{DesiredPath, NavMode};
use jink_shared_types::{Coded, Flag, Timestamp};
use mavlink::MessageData;
use mavlink::dialect::{
    COMMAND_LONG_DATA, DISTANCE_SENSOR_DATA, EXTENDED_SYS_STATE_DATA, MavCmd, MavMessage, TIMESYNC_DATA,
};
use mission::MissionFlight;
use mode_choice::ModeChoice;
use profile_check::ProfileCheck;
use steering::Steering;
use unguarded_mode::UnguardedMode;

/// Whether the vehicle stands on the ground is asked for this often while it is not known (s).
const LANDED_STATE_EVERY_S: f64 = 0.3;
/// After so many requests without an answer the pilot is notified.
const LANDED_STATE_TRIES: u32 = 15;
/// Rate of OBSTACLE_DISTANCE (Hz): ArduPilot and PX4 stop believing a map after half a second, and two may get lost. ArduCopter's
/// LOITER stops 0.1 m later than with ten. Each message is 179 bytes, which an autopilot may pass on to the ground station's radio.
const OBSTACLES_HZ: f64 = 5.0;
/// The same while PX4's own collision prevention is on: it asks for ten, and counts on the age of what it has.
const OBSTACLES_PREVENTION_HZ: f64 = 10.0;
/// No rate is lower (Hz): one map may get lost within half a second.
const OBSTACLES_LEAST_HZ: f64 = 2.5;
/// A second autopilot is reported again when it was gone for so long (s).
const TWO_GONE_S: f64 = 30.0;
/// Rate at which the counters are published (Hz), as the topic table says.
const STATUS_RATE_HZ: u32 = 5;
/// A new trajectory does not wait for the beat, but keeps this part of a period behind the setpoint before: 2.5 ms at
/// 20 Hz. (Every fifth comes within 10 ms after a beat; to keep those waiting was a third of the latency's 99th percentile.)
const SOONEST_PERIODS: f64 = 0.05;
/// Two setpoints that did not wait for the beat are this part of a period apart: 10 ms at 20 Hz, so that a burst of
/// trajectories does not crowd a serial line.
const EARLY_APART_PERIODS: f64 = 0.2;
/// The setpoint after one with a new trajectory comes this part of a period sooner than the others: 7.5 ms at 20 Hz. Maps
/// come at 10, 20 or 5 Hz as well, so that without it every new trajectory would meet a setpoint that has just
/// been sent, and keep [`SOONEST_PERIODS`] behind it. Trajectories vary by less.
const AFTER_NEW_PERIODS: f64 = 0.15;

/// The gateway between jink and one autopilot.
#[derive(Debug)]
pub struct Gateway {
    config: GatewayConfig,
    profile: Box<dyn Profile>,
    /// Whether it is for the autopilot on the link.
    profile_check: ProfileCheck,
    /// Somebody is about to end jink.
    controlled_stop: Option<ControlledStop>,
    unguarded_mode: UnguardedMode,
    mode_choice: ModeChoice,
    selector: VehicleSelector,
    clock: ClockMap,
    vehicle: VehicleTracker,
    desired: Option<DesiredPath>,
    vertical_motions: VerticalMotions,
    /// Where jink flies the mission itself.
    mission: Option<MissionFlight>,
    /// The mission item that the autopilot counts as current, and how many there are, where it says so.
    current_item: Option<(u16, Option<u16>)>,
    blockage: Blockage,
    position: Input,
    ranges: Input,
    approved: Input,
    /// On the ground or in the air.
    landed_state: Input,
    /// When that was asked for last, and how often.
    footing_asked: (Timestamp, u32),
    was_alive: bool,
    /// When two autopilots were heard last.
    two_heard: Timestamp,
    /// The autopilot was sent what comes before the first setpoint.
    was_announced: bool,
    ignored: u64,
    last_setpoint: Timestamp,
    /// The last setpoint that did not wait for the beat.
    last_early: Timestamp,
    /// The next one does not.
    is_early: bool,
    heartbeats: Heartbeats,
    params: ParamSet,
    steering: Steering,
    assist: AssistedFlight,
    sources: RangeSources,
    radio: RadioShare,
    streams: Streams,
    wire: Wire,
    setpoints: Ticker,
    obstacles: Ticker,
    /// What somebody has asked for in place of the parameter.
    obstacles_period_s: Option<f64>,
    timesync: Ticker,
    status_due: Timestamp,
}

impl Gateway {
    /// A gateway that has received nothing yet.
    pub fn new(config: GatewayConfig) -> Self {
        Self {
            profile: config.build_profile(),
            profile_check: ProfileCheck::new(config.chooses_profile, config.is_proven),
            controlled_stop: None,
            unguarded_mode: UnguardedMode::default(),
            mode_choice: ModeChoice::default(),
            selector: VehicleSelector::new(config.system_id),
            clock: ClockMap::default(),
            vehicle: VehicleTracker::default(),
            desired: None,
            vertical_motions: VerticalMotions::default(),
            mission: config
                .profile
                .reads_the_mission()
                .then(|| MissionFlight::new(Part::of(&config))),
            current_item: None,
            blockage: Blockage::new(config.blocked_remedy),
            position: Input::Missing,
            ranges: Input::Missing,
            approved: Input::Missing,
            landed_state: Input::Missing,
            footing_asked: (Timestamp::NEVER, 0),
            was_alive: false,
            two_heard: Timestamp::NEVER,
            was_announced: false,
            ignored: 0,
            last_setpoint: Timestamp::NEVER,
            last_early: Timestamp::NEVER,
            is_early: false,
            heartbeats: Heartbeats::default(),
            params: ParamSet::default(),
            steering: Steering::default(),
            assist: AssistedFlight::default(),
            sources: RangeSources::default(),
            radio: RadioShare::default(),
            streams: Streams::new(config.profile),
            wire: Wire::default(),
            setpoints: Ticker::new(config.setpoint_rate_hz),
            obstacles: Ticker::new(OBSTACLES_HZ),
            obstacles_period_s: None,
            timesync: Ticker::new(SEARCHING_HZ),
            status_due: Timestamp::NEVER,
            config,
        }
    }

    /// With sensors that come over MAVLink.
    pub fn with_range_sources(mut self, sources: RangeSources) -> Self {
        self.sources = sources;
        self.streams = self.needed_streams();
        self
    }

    /// What the autopilot has to report for us to work, nothing of it received yet.
    fn needed_streams(&self) -> Streams {
        let mut streams = Streams::new(self.config.profile);
        if self.config.has_fast_link {
            streams.look_often();
        }
        if let Some(rate_hz) = self.sources.rate_hz() {
            streams.need(DISTANCE_SENSOR_DATA::ID, rate_hz);
        }
        streams
    }

    /// One step: takes in what has come, gives out what is due. To be called whenever an input changes, and at the
    /// latest at [`Self::next_wake`].
    pub fn step(&mut self, now: Timestamp, inputs: &Inputs<'_>, outputs: &mut Outputs) {
        outputs.clear();
        self.wire.wake(now);
        if let Some(values) = inputs.parameters {
            values.apply_live(&mut self.params);
        }
        for received in inputs.messages {
            self.take(now, received, outputs);
        }
        self.notice_life(now, outputs);
        self.notice_two(now, outputs);
        for event in inputs.events.iter().filter(|event| event.id == GOAL_BLOCKED.id) {
            self.take_blocked_goal(now, event, outputs);
        }
        self.watch_profile(now, outputs);
        self.judge(now, inputs);
        if self.profile_check.speaks() {
            self.run_assist(now, inputs, outputs);
            if !self.run_controlled_stop(now, outputs) {
                self.run_mission(now, outputs);
                self.watch_unguarded_modes(now, outputs);
            }
            self.watch_mode_choice(now, outputs);
            self.fly(now, inputs, outputs);
        }
        for answer in inputs.answers {
            self.answer(now, answer, outputs);
        }
        self.speak(now, inputs, outputs);
        if now >= self.status_due {
            self.status_due = now.next_beat(STATUS_RATE_HZ);
            outputs.link_status = Some(*self.link_status(now, inputs));
        }
    }

    /// When the next step is due at the latest. May lie in the past: then at once.
    pub fn next_wake(&self, now: Timestamp) -> Timestamp {
        let with_computer = self.config.computer_component_id.is_some();
        let mut wake = self.heartbeats.next_wake(with_computer).min(self.status_due);
        if self.was_alive {
            wake = wake.min(self.vehicle.alive_until().plus_seconds(1e-3));
        }
        if self.selector.system_id(now).is_some() {
            wake = wake.min(self.timesync.due());
            if self.obstacles_hz(now).is_some() {
                wake = wake.min(self.obstacles.due());
            }
            if self.was_alive {
                wake = wake.min(self.streams.next_wake());
                if let Some(question) = self.assist_wake() {
                    wake = wake.min(question);
                }
                if let Some(question) = self.profile_check.fit.next_wake(self.profile_check.found()) {
                    wake = wake.min(question);
                }
            }
            if self.profile_check.speaks() && self.vehicle.present(now).is_some() {
                wake = wake.min(self.setpoints.due());
            }
        }
        wake
    }

    /// Reports that the bytes of a message were handed to the kernel at `now`.
    pub fn wire(&mut self, now: Timestamp, receipt: Receipt) {
        self.wire.sent(now, receipt);
    }

    /// How many setpoints were sent so far.
    pub fn setpoints_sent(&self) -> u64 {
        self.wire.status.setpoints
    }

    /// Whether another gateway sends on this link: its time synchronisation is learned from as well.
    pub fn listen_only(&mut self, only: bool) {
        self.clock.accept_foreign_answers(only);
    }

    /// The link on which our autopilot is seen; the first one as long as it is not.
    pub fn autopilot_link(&self) -> u8 {
        self.selector.link()
    }

    /// Whether no setpoint is sent now because the vehicle is not in the air yet.
    pub fn waits_for_air(&self) -> bool {
        !self.assist.streams() && self.profile.waits_for_air() && !self.vehicle.has_taken_off()
    }

    /// Whether no setpoint is sent now because the autopilot does without one, and a station's go-to would be lost by it: in modes
    /// that do not follow setpoints, and while it holds a place of jink's own.
    pub fn rests(&self, now: Timestamp) -> bool {
        if self.assist.streams() {
            return false;
        }
        let Some(flight) = self.mission.as_ref().filter(|_| self.config.profile.sees_go_to()) else {
            return false;
        };
        let mode = self.vehicle.mode();
        if mode != NavMode::Offboard {
            return !self.profile.listens(mode) && !flight.wants_a_plan();
        }
        self.vehicle
            .present(now)
            .is_some_and(|present| flight.may_rest(now, present.position))
    }

    /// Our system: that of the vehicle that is selected, or that is to be.
    fn our_system(&self, now: Timestamp) -> Option<u8> {
        self.selector.system_id(now).or(self.config.system_id)
    }

    /// Who we are on the links.
    pub fn us(&self, now: Timestamp) -> OwnIds {
        OwnIds {
            system_id: self.our_system(now),
            components: [
                self.config.component_id,
                self.config.computer_component_id.unwrap_or(0),
            ],
        }
    }

    /// When the last setpoint was due and sent.
    pub(crate) fn last_setpoint(&self) -> Timestamp {
        self.last_setpoint
    }

    /// Sends from now on, after another gateway whose last setpoint was sent then.
    pub(crate) fn resume_from(&mut self, last_setpoint: Timestamp) {
        self.last_setpoint = last_setpoint;
        self.setpoints.resume_from(last_setpoint);
        self.wire.resume_from(last_setpoint);
    }

    /// Sends from now on, after another gateway that has died: the next setpoint goes out at once.
    pub fn resume_now(&mut self, now: Timestamp) {
        self.setpoints.schedule_early(now);
    }

    fn vehicle_state(&self, now: Timestamp) -> Option<(jink_shared_types::vehicle::VehicleState, Timestamp)> {
        let system_id = self.selector.system_id(now).unwrap_or(0);
        // Who does not know its profile yet says nothing of how closely it is followed.
        let tracking = if self.profile_check.speaks() {
            self.config.profile.tracking()
        } else {
            Tracking::default()
        };
        self.vehicle.state(now, system_id, tracking)
    }

    /// Reports when the autopilot is seen for the first time, is lost, and is back; at a loss consumers get one last
    /// state that says so.
    fn notice_life(&mut self, now: Timestamp, outputs: &mut Outputs) {
        let alive = self.vehicle.is_alive(now) && self.selector.system_id(now).is_some();
        if alive == self.was_alive {
            return;
        }
        self.was_alive = alive;
        let system_id = f64::from(self.selector.system_id(now).unwrap_or(0));
        if alive {
            if let Some(flight) = &mut self.mission {
                flight.read_anew(now);
            }
            outputs.report(EventSample::new(&AUTOPILOT_FOUND, "", [system_id, 0.0]));
        } else {
            self.wire.interrupted();
            outputs.report(EventSample::new(&AUTOPILOT_LOST, "", [system_id, 0.0]));
            outputs.vehicle_state = self.vehicle_state(now);
        }
    }

    /// Reports that two autopilots are heard and nobody says which one is ours; again if that has ended and comes back.
    fn notice_two(&mut self, now: Timestamp, outputs: &mut Outputs) {
        let Some(systems) = self.selector.two(now) else {
            return;
        };
        let is_new = !self.two_heard.is_set() || now.seconds_since(self.two_heard) > TWO_GONE_S;
        self.two_heard = now;
        if is_new {
            outputs.report(EventSample::new(&TWO_AUTOPILOTS, "", systems.map(f64::from)));
        }
    }

    /// Whether it is certain which autopilot is ours. In flight it is: the one that is flown is kept.
    fn is_unmistakable(&self, now: Timestamp) -> bool {
        let is_on_ground = self.vehicle.armed() == Some(false);
        self.selector.two(now).is_none() || self.selector.system_id(now).is_some() && !is_on_ground
    }

    fn judge(&mut self, now: Timestamp, inputs: &Inputs<'_>) {
        self.position
            .notice(self.was_alive && self.vehicle.is_position_valid(now));
        self.ranges.notice(avoidance::ranges_flow(now, inputs.ring));
        self.approved.notice(inputs.approved.is_fresh());
        // Without knowing whether the vehicle stands on the ground jink sends and asks for nothing.
        let is_reported = self.mission.is_none() || self.vehicle.landed_state() != LandedState::Unknown;
        self.landed_state.notice(self.was_alive && is_reported);
        let needed = [
            self.position,
            self.ranges,
            self.approved,
            self.landed_state,
            self.profile_check.input,
            match self.is_unmistakable(now) {
                true => Input::Flowing,
                false => Input::Missing,
            },
        ];
        self.heartbeats
            .set_state(now, avoidance::judge(inputs.system, &needed));
    }

    fn fly(&mut self, now: Timestamp, inputs: &Inputs<'_>, outputs: &mut Outputs) {
        if self.is_steered() {
            self.steer(now, inputs, outputs);
            return;
        }
        if self.assist.streams() {
            self.fly_assisted(now, inputs, outputs);
            return;
        }
        let Some(system_id) = self.selector.system_id(now) else {
            return;
        };
        let mode = self.vehicle.mode();
        // Where the way is only shown, what was approved goes on while a gateway that was started in flight reads the mission.
        let goes_on = mode == NavMode::Mission
            && !self.config.profile.flies_the_mission()
            && inputs
                .approved
                .fresh()
                .is_some_and(|approved| is_for_flying(&approved));
        let is_about_to = self
            .mission
            .as_ref()
            .is_some_and(|flight| flight.wants_a_plan() || goes_on && flight.is_reading_after_start(now));
        let spares_radio = self.spares_radio(now);
        let situation = Situation {
            now,
            spares_radio,
            vehicle: self.vehicle.present(now),
            system_id,
            mode,
            in_air: self.vehicle.has_taken_off(),
            is_flown: self.profile.listens(mode) || is_about_to,
            position_gain_per_s: self.params().get(&MPC_XY_P),
            velocity_gain_per_s: self.params().get(&MPC_XY_VEL_P_ACC),
            clock: &self.clock,
            desired: self
                .desired
                .as_ref()
                .filter(|path| self.was_alive && path.mode == mode),
            approved: inputs.approved,
        };
        self.setpoints.set_rate(self.setpoint_rate_hz(now));
        if self.profile.observe(&situation) {
            let period_s = self.setpoints.period_s();
            let soonest = self
                .last_setpoint
                .plus_seconds(SOONEST_PERIODS * period_s)
                .max(self.last_early.plus_seconds(EARLY_APART_PERIODS * period_s))
                .max(now);
            self.is_early |= soonest < self.setpoints.due();
            self.setpoints.schedule_early(soonest);
        }
        outputs.reported = self.profile.reported();
        if let Some(header) = &outputs.reported {
            self.wire.known(now, header);
        }
        if situation.vehicle.is_none() || !self.setpoints.take(now) {
            return;
        }
        let setpoint = match self.rests(now) {
            true => None,
            false => self.profile.setpoint(&situation),
        };
        let Some(setpoint) = setpoint else {
            // There is nothing to be said now: the next setpoint begins another stream.
            self.wire.interrupted();
            return;
        };
        if !std::mem::replace(&mut self.was_announced, true)
            && let Some(announcement) = self.profile.announcement()
        {
            outputs.send(self.outgoing(now, Body::Message(announcement)));
        }
        self.last_setpoint = now;
        if std::mem::take(&mut self.is_early) {
            self.last_early = now;
        }
        if setpoint.first_of.is_some() {
            let period_s = (1.0 - AFTER_NEW_PERIODS) * self.setpoints.period_s();
            self.setpoints.schedule_early(now.plus_seconds(period_s));
        }
        let receipt = Receipt::Setpoint {
            first_of: setpoint.first_of,
        };
        outputs.send(Outgoing {
            receipt,
            ..self.outgoing(now, Body::Message(setpoint.message))
        });
    }

    /// Whether setpoints go out over a ground station's radio, so that what it carries is kept small.
    fn spares_radio(&self, now: Timestamp) -> bool {
        self.config.sends_curves() && self.radio.is_carried(now)
    }

    /// Rate of the setpoint stream (Hz) while nothing new is to be said.
    pub fn setpoint_rate_hz(&self, now: Timestamp) -> f64 {
        if self.spares_radio(now) {
            self.config.setpoint_rate_hz.min(REPEATED_HZ)
        } else {
            self.config.setpoint_rate_hz
        }
    }

    /// How often the obstacle map is due (Hz): as somebody has asked for it, as the parameter says, or as the autopilot needs it;
    /// `None`: it needs none, and a radio would carry it.
    pub(super) fn obstacles_hz(&self, now: Timestamp) -> Option<f64> {
        let configured_hz = self.params().get(&GW_OBST_RATE);
        match self.obstacles_period_s {
            Some(period_s) => Some(1.0 / period_s),
            None if configured_hz > 0.0 => Some(configured_hz.max(OBSTACLES_LEAST_HZ)),
            None if self.profile_check.fit.prevents_collisions() => Some(OBSTACLES_PREVENTION_HZ),
            None => (!self.spares_radio(now)).then_some(OBSTACLES_HZ),
        }
    }

    /// Everything that is said at a rate of its own besides setpoints.
    fn speak(&mut self, now: Timestamp, inputs: &Inputs<'_>, outputs: &mut Outputs) {
        if let Some(heartbeat) = self.heartbeats.avoidance(now) {
            outputs.send(self.outgoing(now, Body::Message(heartbeat)));
        }
        if let Some(component_id) = self.config.computer_component_id
            && let Some(heartbeat) = self.heartbeats.computer(now)
        {
            outputs.send(Outgoing {
                component_id,
                ..self.outgoing(now, Body::Message(heartbeat))
            });
        }
        let Some(system_id) = self.selector.system_id(now) else {
            return;
        };
        let autopilot = (system_id, COMPONENT_AUTOPILOT);
        let obstacles_hz = self.obstacles_hz(now);
        if let Some(rate_hz) = obstacles_hz {
            self.obstacles.set_rate(rate_hz);
        }
        if obstacles_hz.is_some() && self.obstacles.take(now) {
            let map = obstacles::message(now, inputs.ring, self.vehicle.make());
            outputs.send(Outgoing {
                receipt: Receipt::Obstacles,
                ..self.outgoing(now, Body::Message(map))
            });
        }
        self.timesync.set_rate(self.clock.request_rate_hz());
        if self.timesync.take(now) {
            self.clock.request(now);
            let request = MavMessage::TIMESYNC(TIMESYNC_DATA {
                tc1: 0,
                ts1: nanoseconds(now),
                target_system: autopilot.0,
                target_component: autopilot.1,
            });
            outputs.send(self.outgoing(now, Body::Message(request)));
        }
        let mode = self.vehicle.mode();
        if self.was_alive
            && let Some(request) = self.streams.request(now, mode, autopilot)
        {
            outputs.send(self.outgoing(now, Body::Message(request)));
        }
    }

    /// Whether the vehicle stands on the ground must be known before the first setpoint, so it is asked for at once.
    pub(super) fn ask_for_footing(&mut self, now: Timestamp, target: (u8, u8), outputs: &mut Outputs) {
        if self.vehicle.landed_state() != LandedState::Unknown {
            self.footing_asked = (Timestamp::NEVER, 0);
            return;
        }
        let (last, times) = self.footing_asked;
        if last.is_set() && now.seconds_since(last) < LANDED_STATE_EVERY_S {
            return;
        }
        self.footing_asked = (now, times.saturating_add(1));
        if times == LANDED_STATE_TRIES {
            outputs.report(EventSample::new(&LANDED_UNKNOWN, "", [0.0; 2]));
        }
        self.request_message(now, EXTENDED_SYS_STATE_DATA::ID, target, outputs);
    }

    /// Asks `target` (system, component) for one message.
    pub(super) fn request_message(
        &self,
        now: Timestamp,
        message_id: u32,
        target: (u8, u8),
        outputs: &mut Outputs,
    ) {
        let request = COMMAND_LONG_DATA {
            param1: message_id as f32,
            command: MavCmd::MAV_CMD_REQUEST_MESSAGE,
            target_system: target.0,
            target_component: target.1,
            ..COMMAND_LONG_DATA::default()
        };
        outputs.send(self.outgoing(now, Body::Message(MavMessage::COMMAND_LONG(request))));
    }

    fn outgoing(&self, now: Timestamp, body: Body) -> Outgoing {
        outgoing_of(&self.selector, &self.config, now, body)
    }

    fn link_status(&mut self, now: Timestamp, inputs: &Inputs<'_>) -> &LinkStatus {
        let said: AvoidanceState = self.heartbeats.said();
        let [profile, suited] = self.profile_names();
        let param_c_cast = self.encoding().flag();
        let status = &mut self.wire.status;
        status.param_c_cast = param_c_cast;
        status.profile = Name::new(profile);
        status.matching_profile = Name::new(suited);
        status.profile_fit = Coded::new(self.profile_check.found());
        status.garbage_bytes = inputs.link.garbage_bytes();
        status.assist = Coded::new(self.assist.state());
        status.links = inputs.link.links;
        status.telemetry_log = inputs.link.telemetry_log;
        status.ignored = self.ignored + inputs.link.undecodable;
        status.system_id = self.selector.system_id(now).unwrap_or(0);
        status.timesync_converged = Flag::from(self.clock.is_converged());
        status.avoidance = Coded::new(said);
        status.autopilot_alive = Flag::from(self.was_alive);
        status.clock_offset_ns = self.clock.offset_ns();
        status.clock_rate_ppm = (self.clock.rate_error() * 1e6).round() as i32;
        status.round_trip_us = u32::try_from(self.clock.round_trip_ns() / 1000).unwrap_or(u32::MAX);
        status.timesync_samples = self.clock.samples();
        status
    }
}

/// A message of the avoidance component, on its way to whom it is for.
fn outgoing_of(selector: &VehicleSelector, config: &GatewayConfig, now: Timestamp, body: Body) -> Outgoing {
    Outgoing {
        system_id: selector.system_id(now).unwrap_or_else(|| selector.default_id()),
        component_id: config.component_id,
        to: destination(&body, selector.link()),
        body,
        receipt: Receipt::Plain,
    }
}

/// Setpoints, requests and time stamps are the autopilot's; answers go where their addressee is; the rest is for everybody.
fn destination(body: &Body, autopilot_link: u8) -> Destination {
    let target = body.target();
    let names_another = target.system_id != 0 && target.component_id != COMPONENT_AUTOPILOT;
    match TrafficClass::of(body.message_id()) {
        TrafficClass::Setpoint => Destination::Link(autopilot_link),
        TrafficClass::Answer if !names_another => Destination::Link(autopilot_link),
        _ => Destination::Everyone,
    }
}
