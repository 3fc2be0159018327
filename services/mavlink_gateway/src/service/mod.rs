//! The gateway as a process: woken by its links, by approved trajectories, by the system's status, and by its own beat.

mod kept;
mod opening;

use crate::ranges::{RangeSources, SensorTable};
use crate::{
    COMPONENT_AVOIDANCE, Destination, Gateway, GatewayConfig, HandoverState, Inputs, Outputs, ProfileChoice,
    Receipt, Received, Representation,
};
use jink_mavlink_link::link::Progress;
use jink_mavlink_link::links::Links;
use jink_runtime::service::WATCHED_FDS;
use jink_runtime::{
    Clock, Cycle, ExclusiveOwnership, Input, Latency, Output, Ports, Service, StartError, Wake,
};
use jink_shared_types::events::EventSample;
use jink_shared_types::ground::{GroundAnswer, GroundRequest};
use jink_shared_types::health::Name;
use jink_shared_types::health::SystemStatus;
use jink_shared_types::link::{Delivery, LinkStatus, StopRequest};
use jink_shared_types::motion::ApprovedTrajectory;
use jink_shared_types::param_messages::ParameterValues;
use jink_shared_types::prevention::{PilotDemand, PreventedDemand};
use jink_shared_types::ranges::RangeScan;
use jink_shared_types::ring::SectorRing;
use jink_shared_types::vehicle::{DesiredPath, VehicleState};
use jink_shared_types::{Flag, SampleHeader, Stage, Timestamp, topics};
use kept::{FlightFile, ProvenProfile};
pub use opening::check_links;
use opening::open_links;
use std::fmt::{self, Display};
use std::os::fd::BorrowedFd;

/// A link that carries this (bytes/s) carries every stream as often as it is of use: a serial line at 460800 bit/s.
const FAST_LINK_BPS: f64 = 46_000.0;
/// Messages handled per cycle; a link that floods is read on in the next one, after the setpoint.
const MESSAGES_MAX: usize = 256;
/// How often an instance that receives nothing any more looks whether the link is its own now (s).
const ORPHAN_LOOKS_S: f64 = 0.002;
/// Events handled per cycle, and answers of the ground services.
const INPUTS_MAX: usize = 32;

/// The service: see [`crate`].
pub struct GatewayService {
    gateway: Gateway,
    clock: Clock,
    links: Links,
    outputs: Outputs,
    received: Vec<Received>,
    happened: Vec<EventSample>,
    approved: Input<ApprovedTrajectory>,
    prevented: Input<PreventedDemand>,
    ring: Input<SectorRing>,
    system: Input<SystemStatus>,
    events: Input<EventSample>,
    /// This process, as it stands in its events.
    me: Name,
    state: Output<VehicleState>,
    desired: Output<DesiredPath>,
    pilot: Output<PilotDemand>,
    /// One for each sensor that comes over MAVLink.
    scans: Vec<Output<RangeScan>>,
    status: Output<LinkStatus>,
    delivery: Output<Delivery>,
    parameters: Input<ParameterValues>,
    /// Sequence number of the parameters taken last.
    parameters_taken: Option<u64>,
    requests: Output<GroundRequest>,
    answers: Input<GroundAnswer>,
    answered: Vec<GroundAnswer>,
    stop_requests: Input<StopRequest>,
    latency: Latency,
    exclusive_ownership: ExclusiveOwnership,
    /// What the next gateway is to know of this flight.
    flight: FlightFile,
    /// What the next gateway of this run begins with.
    proven: ProvenProfile,
    /// When this process began to listen.
    begin: Timestamp,
}

fn needs<E: Display>(what: String) -> impl FnOnce(E) -> StartError {
    move |cause| StartError::Needs {
        what,
        cause: cause.to_string(),
    }
}

impl fmt::Debug for GatewayService {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("GatewayService")
    }
}

impl Service for GatewayService {
    const PROGRAM: &'static str = "mavlink_gateway";
    const REPLAYS: bool = false;

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        let settings = ports.config().link.clone();
        let links = open_links(ports)?;
        let choice: ProfileChoice = settings
            .profile
            .parse()
            .map_err(needs("link.profile".to_owned()))?;
        let proven = ProvenProfile::of(ports.setup().instance.proven_profile());
        let (profile, is_proven) = proven.for_choice(choice);
        let representation: Representation =
            settings.output.parse().map_err(needs("link.output".to_owned()))?;
        let config = GatewayConfig {
            system_id: (settings.system_id != 0).then_some(settings.system_id),
            component_id: COMPONENT_AVOIDANCE,
            ground_station_links: links.of_ground_stations(),
            representation,
            chooses_profile: choice == ProfileChoice::Auto,
            is_proven,
            takes_missions: settings.takes_missions,
            has_fast_link: links.carries(FAST_LINK_BPS),
            ..GatewayConfig::from_params(&ports.config().params, profile)
        };
        let tables: Vec<SensorTable> = jink_runtime::config::sensors(&ports.setup().config)?;
        let sources = RangeSources::new(&tables).map_err(|mistake| StartError::Needs {
            what: "ranges over MAVLink".to_owned(),
            cause: mistake.to_string(),
        })?;
        let scans = sources
            .names()
            .map(|name| ports.range_output(topics::RANGE_SCAN, name, 0.0))
            .collect::<Result<_, _>>()?;
        let flight = FlightFile::of(ports.setup().instance.flight_record());
        Ok(Self {
            gateway: Gateway::new(config)
                .resuming(ports.clock().now(), flight.read())
                .with_range_sources(sources)
                .with_params(&ports.config().params),
            links,
            outputs: Outputs::default(),
            received: Vec::with_capacity(MESSAGES_MAX),
            happened: Vec::with_capacity(INPUTS_MAX),
            approved: ports.trigger(topics::APPROVED)?,
            prevented: ports.input(topics::PREVENTED)?,
            ring: ports.input(topics::RING)?,
            system: ports.trigger(topics::SYSTEM_STATUS)?,
            events: ports.input(topics::EVENT)?,
            me: Name::new(&ports.setup().process),
            state: ports.output(topics::VEHICLE_STATE)?,
            desired: ports.output(topics::DESIRED_PATH)?,
            pilot: ports.output(topics::PILOT_DEMAND)?,
            scans,
            status: ports.output(topics::LINK_STATUS)?,
            delivery: ports.output(topics::DELIVERY)?,
            parameters: ports.input(topics::PARAMETERS)?,
            parameters_taken: None,
            requests: ports.output(topics::GROUND_REQUEST)?,
            answers: ports.trigger(topics::GROUND_ANSWER)?,
            answered: Vec::with_capacity(INPUTS_MAX),
            // Each command that asks is a producer of its own.
            stop_requests: ports.input(topics::STOP_REQUEST)?.of_all_producers(),
            latency: ports.latency(),
            exclusive_ownership: ports.exclusive_ownership(),
            flight,
            proven,
            begin: ports.clock().now(),
            clock: ports.clock(),
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        let now = cycle.now;
        if self.links.is_owner() && !self.exclusive_ownership.is_due(now) {
            self.release();
        }
        // What the former holder has read is its own to answer, also if the link passes over behind it.
        let speaks = self.links.is_owner();
        self.exclusive_ownership.declare(speaks);
        self.gateway.listen_only(!speaks);
        let progress = self.receive(now);
        for event in self.links.take_events() {
            cycle.events.publish(now, &event);
        }
        let begin = self.begin;
        self.happened.clear();
        let (happened, me) = (&mut self.happened, self.me);
        self.events.each(|event| {
            let is_new = event.sample.process != me && event.header.publish >= begin;
            if is_new && happened.len() < INPUTS_MAX {
                happened.push(*event.sample);
            }
        });
        self.answered.clear();
        let answered = &mut self.answered;
        self.answers.each(|answer| {
            // What came before was the instance's before.
            if answer.header.publish >= begin && answered.len() < INPUTS_MAX {
                answered.push(*answer.sample);
            }
        });
        let parameters = self.parameters.latest(now).fresh();
        let parameters = parameters.filter(|values| self.parameters_taken != Some(values.header.sequence));
        if let Some(values) = &parameters {
            self.parameters_taken = Some(values.header.sequence);
        }
        self.stop_requests.each(|_| self.gateway.request_stop());
        let inputs = Inputs {
            messages: &self.received,
            link: self.links.report(),
            approved: self.approved.latest(now),
            prevented: self.prevented.latest(now),
            ring: self.ring.latest(now),
            system: self.system.latest(now),
            events: &self.happened,
            parameters: parameters.map(|values| values.sample),
            answers: &self.answered,
        };
        self.gateway.step(now, &inputs, &mut self.outputs);
        if speaks {
            self.send(now);
            self.flight.keep(now, self.gateway.record(now));
        }
        self.exclusive_ownership.stand_by(!self.gateway.profile_fits());
        if speaks {
            self.proven.keep(self.gateway.proven_profile());
        }
        self.publish();
        for note in self.outputs.notes() {
            note.log();
        }
        for event in self.outputs.events() {
            cycle.events.publish(now, event);
        }
        if speaks && self.outputs.restart {
            tracing::info!("started anew, as asked for over the link");
            return Wake::restart();
        }
        if self.take_over(now) || progress == Progress::More {
            return Wake::at(now);
        }
        let mut wake = self.gateway.next_wake(now);
        wake = wake.min(self.links.next_wake().unwrap_or(wake));
        if let Some(change) = self
            .exclusive_ownership
            .changes_at()
            .filter(|change| *change > now)
        {
            wake = wake.min(change);
        }
        if self.links.has_lost_owner() {
            wake = wake.min(now.plus_seconds(ORPHAN_LOOKS_S));
        }
        Wake::at(wake)
    }

    fn watched(&self) -> [Option<BorrowedFd<'_>>; WATCHED_FDS] {
        self.links.fds()
    }
}

impl GatewayService {
    /// Lets the next instance go on from here, if there is one.
    fn release(&mut self) {
        let stamps = self.links.stamps();
        if let Some(encoder) = self.links.encoder() {
            let handover = HandoverState::of(&self.gateway, encoder, stamps).to_bytes();
            self.links.release(&handover);
        }
    }

    /// Goes on where the former holder of the links has stopped, if it has passed them on or died. Returns whether this
    /// instance sends from now on.
    fn take_over(&mut self, now: Timestamp) -> bool {
        if let Some(handover) = self.links.take_handover_state() {
            match (HandoverState::of_bytes(&handover), self.links.encoder()) {
                (Some(handover), Some(encoder)) => {
                    let stamps = handover.hand_to(now, &mut self.gateway, encoder);
                    self.links.resume_from(stamps);
                }
                _ => self.gateway.resume_now(now),
            }
            tracing::info!("the link was passed on to this instance");
            return true;
        }
        let left_alone = self.links.has_lost_owner() && self.exclusive_ownership.is_due(now);
        if left_alone {
            self.links.take_over();
            self.gateway.resume_now(now);
            tracing::info!("the link is taken over from an instance that has died");
        }
        left_alone
    }

    fn receive(&mut self, now: Timestamp) -> Progress {
        self.received.clear();
        let us = self.gateway.us(now);
        let clock = &self.clock;
        self.links.receive(|| clock.now(), us, &mut self.received)
    }

    /// Sends what the cycle that began at `begin` has made.
    fn send(&mut self, begin: Timestamp) {
        if let Some(header) = self.outputs.reported {
            self.deliver(&header, begin, self.clock.now(), false);
        }
        let mut sent_first: Option<(SampleHeader, Timestamp)> = None;
        for message in self.outputs.messages() {
            let sent = self.links.send(self.clock.now(), message);
            // What is for everybody counts when the autopilot has it.
            let link = match message.to {
                Destination::Link(link) => link,
                Destination::Everyone => self.gateway.autopilot_link(),
            };
            if sent.contains(link) {
                let now = self.clock.now();
                self.gateway.wire(now, message.receipt);
                if let Receipt::Setpoint {
                    first_of: Some(header),
                } = message.receipt
                {
                    sent_first = Some((header, now));
                }
            }
        }
        if let Some((header, at)) = sent_first {
            self.deliver(&header, begin, at, true);
        }
    }

    /// The autopilot knows at `at` what the trajectory with this header says. One that was made of no measurement says nothing of how long
    /// measurements take.
    fn deliver(&mut self, header: &SampleHeader, begin: Timestamp, at: Timestamp, was_sent: bool) {
        if !header.capture.is_set() {
            return;
        }
        let header = self.latency.left(header, Stage::Gateway, begin, at);
        let delivery = Delivery {
            setpoints: self.gateway.setpoints_sent(),
            was_sent: Flag::from(was_sent),
            ..Delivery::default()
        };
        self.delivery.send(header, &delivery);
    }

    fn publish(&mut self) {
        let captured = |capture: Timestamp| SampleHeader {
            capture,
            ..SampleHeader::default()
        };
        if let Some((state, capture)) = &self.outputs.vehicle_state {
            self.state.send(captured(*capture), state);
        }
        if let Some((desired, capture)) = &self.outputs.desired_path {
            self.desired.send(captured(*capture), desired);
        }
        for arrived in self.outputs.scans() {
            if let Some(output) = self.scans.get_mut(arrived.source) {
                output.send(captured(arrived.at), &arrived.scan);
            }
        }
        if let Some((demand, capture)) = &self.outputs.pilot_demand {
            self.pilot.send(captured(*capture), demand);
        }
        for request in self.outputs.requests() {
            self.requests.send(SampleHeader::at(self.clock.now()), request);
        }
        if let Some(status) = &self.outputs.link_status {
            self.status.send(SampleHeader::at(self.clock.now()), status);
        }
    }
}
