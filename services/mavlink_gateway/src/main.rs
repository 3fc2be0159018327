//! The gateway as a process: woken by the link, by approved trajectories, and by its own beat.

use jink_mavlink_gateway::board::Board;
use jink_mavlink_gateway::link::{Endpoint, Link, LinkError, Progress, Sent};
use jink_mavlink_gateway::tlog::Tlog;
use jink_mavlink_gateway::{
    Baton, COMPONENT_AVOIDANCE, Encoder, Gateway, GatewayConfig, Inputs, Outputs, ProfileName, Receipt,
    Received, Representation,
};
use jink_runtime::service::WATCHED_FDS;
use jink_runtime::{Claim, Cycle, Input, Latency, Output, Ports, Service, StartError, StoreWriter, Wake};
use jink_shared_types::events::EventSample;
use jink_shared_types::health::Name;
use jink_shared_types::health::SystemStatus;
use jink_shared_types::layout::{hash_start, hash_text};
use jink_shared_types::link::LinkStatus;
use jink_shared_types::motion::ApprovedTrajectory;
use jink_shared_types::params::ParamSet;
use jink_shared_types::ring::SectorRing;
use jink_shared_types::tuning::{ParameterChange, ParameterValues};
use jink_shared_types::vehicle::{DesiredPath, VehicleState};
use jink_shared_types::{SampleHeader, Timestamp, topics};
use std::fmt::Display;
use std::os::fd::BorrowedFd;
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

/// Messages handled per cycle; a link that floods is read on in the next one, after the setpoint.
const MESSAGES_MAX: usize = 256;
/// How long a restarted gateway waits for its port to be let go (s).
const LET_GO_S: f64 = 0.3;
/// How often an instance that hears nobody any more looks whether the link is its own now (s).
const ORPHAN_LOOKS_S: f64 = 0.002;
/// Events handled per cycle.
const EVENTS_MAX: usize = 32;

struct GatewayService {
    gateway: Gateway,
    link: Link,
    link_lost: bool,
    encoder: Encoder,
    outputs: Outputs,
    received: Vec<Received>,
    news: Vec<EventSample>,
    approved: Input<ApprovedTrajectory>,
    ring: Input<SectorRing>,
    system: Input<SystemStatus>,
    events: Input<EventSample>,
    /// This process, as it stands in its events.
    me: Name,
    state: Output<VehicleState>,
    desired: Output<DesiredPath>,
    status: Output<LinkStatus>,
    /// Nothing that is needed to fly: without it the board stays unknown.
    board: Option<Board>,
    parameters: Output<ParameterValues>,
    changes: Input<ParameterChange>,
    store: StoreWriter,
    latency: Latency,
    claim: Claim,
}

fn needs<E: Display>(what: String) -> impl FnOnce(E) -> StartError {
    move |cause| StartError::Needs {
        what,
        cause: cause.to_string(),
    }
}

impl Service for GatewayService {
    const PROGRAM: &'static str = "mavlink_gateway";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        let settings = ports.config().link.clone();
        let at = format!("link.address = {:?}", settings.address);
        let endpoint: Endpoint = settings.address.parse().map_err(needs(at.clone()))?;
        let door = ports.setup().instance.handover_socket(&ports.setup().process);
        let mut link = if ports.setup().shadow {
            Link::join(endpoint, &door).map_err(needs(at))?
        } else {
            let mut link = open(endpoint, ports.setup().generation).map_err(needs(at.clone()))?;
            link.share(&door).map_err(needs(at))?;
            link
        };
        if !settings.tlog.is_empty() {
            let log = Tlog::begin(Path::new(&settings.tlog), ports.setup().generation)
                .map_err(needs(format!("link.tlog = {:?}", settings.tlog)))?;
            tracing::info!("telemetry log: {}", log.path().display());
            link.record(log);
        }
        let profile: ProfileName = settings
            .profile
            .parse()
            .map_err(needs("link.profile".to_owned()))?;
        let representation: Representation =
            settings.output.parse().map_err(needs("link.output".to_owned()))?;
        let config = GatewayConfig {
            system_id: (settings.system_id != 0).then_some(settings.system_id),
            component_id: COMPONENT_AVOIDANCE,
            representation,
            takes_missions: settings.takes_missions,
            ..GatewayConfig::from_params(&ports.config().params, profile)
        };
        Ok(Self {
            gateway: Gateway::new(config)
                .with_params(&ports.config().params)
                .with_board_id(board_id()),
            link,
            link_lost: false,
            encoder: Encoder::new(),
            outputs: Outputs::default(),
            received: Vec::with_capacity(MESSAGES_MAX),
            news: Vec::with_capacity(EVENTS_MAX),
            approved: ports.trigger(topics::APPROVED)?,
            ring: ports.input(topics::RING)?,
            system: ports.trigger(topics::SYSTEM_STATUS)?,
            events: ports.input(topics::EVENT)?,
            me: Name::new(&ports.setup().process),
            state: ports.output(topics::VEHICLE_STATE)?,
            desired: ports.output(topics::DESIRED_PATH)?,
            status: ports.output(topics::LINK_STATUS)?,
            board: Board::watch().ok(),
            parameters: ports.output(topics::PARAMETERS)?,
            // Each command that asks is a producer of its own.
            changes: ports.input(topics::PARAMETER_CHANGE)?.of_all_producers(),
            store: ports.param_store().clone().writer(),
            latency: ports.latency(),
            claim: ports.claim(),
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        let now = cycle.now;
        if self.link.holds() && !self.claim.is_due(now) {
            self.link
                .release(&Baton::of(&self.gateway, &self.encoder).to_bytes());
        }
        // What the former holder has read is its own to answer, also if the link passes over behind it.
        let speaks = self.link.holds();
        self.claim.declare(speaks);
        self.gateway.listen_only(!speaks);
        let progress = self.receive();
        self.news.clear();
        self.events.each(|event| {
            // Its own are on their way already.
            if event.sample.process != self.me && self.news.len() < EVENTS_MAX {
                self.news.push(*event.sample);
            }
        });
        self.changes
            .each(|change| self.gateway.change_param(change.sample));
        if let Some(reading) = self.board.as_ref().and_then(Board::news) {
            self.gateway.notice_board(reading);
        }
        let inputs = Inputs {
            messages: &self.received,
            link: self.link.counters(),
            approved: self.approved.latest(now),
            ring: self.ring.latest(now),
            system: self.system.latest(now),
            events: &self.news,
        };
        self.gateway.step(now, &inputs, &mut self.outputs);
        if speaks {
            self.send();
        }
        self.publish();
        for event in self.outputs.events() {
            cycle.events.publish(now, event);
        }
        if speaks {
            self.keep_params(cycle);
            if self.outputs.restart {
                tracing::info!("started anew, as asked for over the link");
                return Wake::restart();
            }
        }
        if self.take_over(now) || progress == Progress::More {
            return Wake::at(now);
        }
        let mut wake = self.gateway.next_wake(now);
        wake = wake.min(self.link.next_wake().unwrap_or(wake));
        if let Some(change) = self.claim.changes_at().filter(|change| *change > now) {
            wake = wake.min(change);
        }
        if self.link.is_orphaned() {
            wake = wake.min(now.plus_seconds(ORPHAN_LOOKS_S));
        }
        Wake::at(wake)
    }

    /// An instance that only listens does as the one that speaks; that one knows best itself.
    fn retune(&mut self, params: &ParamSet) {
        if !self.link.holds() {
            self.gateway.follow_params(params);
        }
    }

    fn watched(&self) -> [Option<BorrowedFd<'_>>; WATCHED_FDS] {
        let [link, peer, door] = self.link.fds();
        [link, peer, door, None]
    }
}

impl GatewayService {
    /// Goes on where the former holder of the link has stopped, if it has passed it on or died. Returns whether this
    /// instance speaks from now on.
    fn take_over(&mut self, now: Timestamp) -> bool {
        if let Some(baton) = self.link.take_baton() {
            match Baton::of_bytes(&baton) {
                Some(baton) => baton.hand_to(&mut self.gateway, &mut self.encoder),
                None => self.gateway.go_on_at_once(now),
            }
            tracing::info!("the link was passed on to this instance");
            return true;
        }
        let left_alone = self.link.is_orphaned() && self.claim.is_due(now);
        if left_alone {
            self.link.take();
            self.gateway.go_on_at_once(now);
            tracing::info!("the link is taken over from an instance that has died");
        }
        left_alone
    }

    /// Has changed parameters written; a disk that does not take them is told to the pilot.
    fn keep_params(&mut self, cycle: &mut Cycle<'_>) {
        let changed = matches!(self.outputs.parameters, Some((_, true)));
        let written = if changed {
            self.store.save(self.gateway.params())
        } else {
            Ok(())
        };
        if let Some(cause) = written.err().or_else(|| self.store.failure()) {
            tracing::warn!("parameters are not kept: {cause}");
            cycle
                .events
                .publish(cycle.now, &self.gateway.notice_lost_store(cycle.now));
        }
    }

    fn receive(&mut self) -> Progress {
        self.received.clear();
        let answer = self.link.receive(jink_runtime::now, &mut self.received);
        self.tell_link(answer.is_err(), answer.as_ref().err());
        answer.unwrap_or(Progress::Drained)
    }

    /// Logs a lost link once, and its return once.
    fn tell_link(&mut self, lost: bool, cause: Option<&impl Display>) {
        match (lost, cause) {
            (true, Some(cause)) if !self.link_lost => tracing::warn!("{cause}"),
            (false, _) if self.link_lost => tracing::info!("the link is back"),
            _ => {}
        }
        self.link_lost = lost || self.link.holds() && self.link.fd().is_none();
    }

    fn send(&mut self) {
        for message in self.outputs.messages() {
            let bytes = self
                .encoder
                .encode(message.system_id, message.component_id, &message.body);
            let now = jink_runtime::now();
            // A broken link shows at the next reception, where it is told and reopened.
            if let Ok(Sent::Yes) = self.link.send(now, bytes) {
                let now = jink_runtime::now();
                self.gateway.wire(now, message.receipt);
                if let Receipt::Setpoint {
                    first_of: Some(header),
                } = message.receipt
                {
                    self.latency.left(&header, now);
                }
            }
        }
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
        if let Some((values, _)) = &self.outputs.parameters {
            self.parameters
                .send(SampleHeader::at(jink_runtime::now()), values);
        }
        if let Some(status) = &self.outputs.link_status {
            self.status.send(SampleHeader::at(jink_runtime::now()), status);
        }
    }
}

/// Where Linux keeps a number of the installation.
const MACHINE_ID: &str = "/etc/machine-id";

/// A number of this board that does not give the installation's own away, which is to be kept confidential; 0 = unknown.
fn board_id() -> u64 {
    let salted = |id: String| hash_text(hash_start("jink board", 0, 0), id.trim());
    std::fs::read_to_string(MACHINE_ID).map_or(0, salted)
}

/// Opens the link. At a restart a second instance that is just being ended may still have it for a moment.
fn open(endpoint: Endpoint, generation: u32) -> Result<Link, LinkError> {
    let patience = jink_runtime::now().plus_seconds(LET_GO_S);
    loop {
        match Link::open(endpoint.clone()) {
            Err(LinkError::AddressInUse { .. }) if generation > 1 && jink_runtime::now() < patience => {
                std::thread::sleep(Duration::from_millis(2));
            }
            opened => return opened,
        }
    }
}

fn main() -> ExitCode {
    jink_runtime::run::<GatewayService>()
}
