//! The gateway as a process: woken by its links, by approved trajectories, and by its own beat.

use jink_mavlink_gateway::board::Board;
use jink_mavlink_gateway::executive::record::Record;
use jink_mavlink_gateway::link::{Link, LinkError, Progress};
use jink_mavlink_gateway::links::{LinkSetup, Links};
use jink_mavlink_gateway::ranges::{RangeSources, SensorTable};
use jink_mavlink_gateway::tlog::Tlog;
use jink_mavlink_gateway::{
    Baton, COMPONENT_AVOIDANCE, Destination, Gateway, GatewayConfig, Inputs, Outputs, ProfileChoice,
    ProfileName, Receipt, Received, Representation,
};
use jink_runtime::service::WATCHED_FDS;
use jink_runtime::{Claim, Cycle, Input, Latency, Output, Ports, Service, StartError, StoreWriter, Wake};
use jink_shared_types::events::EventSample;
use jink_shared_types::health::Name;
use jink_shared_types::health::SystemStatus;
use jink_shared_types::layout::{hash_start, hash_text};
use jink_shared_types::link::{LinkStatus, StopRequest};
use jink_shared_types::motion::ApprovedTrajectory;
use jink_shared_types::params::ParamSet;
use jink_shared_types::prevention::{PilotDemand, PreventedDemand};
use jink_shared_types::ranges::RangeScan;
use jink_shared_types::ring::SectorRing;
use jink_shared_types::tuning::{ParameterChange, ParameterValues};
use jink_shared_types::vehicle::{DesiredPath, VehicleState};
use jink_shared_types::{SampleHeader, Timestamp, topics};
use std::fmt::Display;
use std::os::fd::BorrowedFd;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

/// A link that carries this (bytes/s) carries every stream as often as it is of use: a serial line at 460800 bit/s.
const FAST_LINK_BPS: f64 = 46_000.0;
/// Messages handled per cycle; a link that floods is read on in the next one, after the setpoint.
const MESSAGES_MAX: usize = 256;
/// How long a restarted gateway waits for its port to be let go (s).
const LET_GO_S: f64 = 0.3;
/// How often an instance that hears nobody any more looks whether the link is its own now (s).
const ORPHAN_LOOKS_S: f64 = 0.002;
/// How far back from its start a gateway takes events that nobody may have said (s): longer than the gap that a killed gateway
/// leaves, and shorter than what a pilot takes for old.
const TOLD_BEFORE_S: f64 = 0.5;
/// Events handled per cycle.
const EVENTS_MAX: usize = 32;

struct GatewayService {
    gateway: Gateway,
    links: Links,
    outputs: Outputs,
    received: Vec<Received>,
    news: Vec<EventSample>,
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
    /// Nothing that is needed to fly: without it the board stays unknown.
    board: Option<Board>,
    parameters: Output<ParameterValues>,
    changes: Input<ParameterChange>,
    stop_requests: Input<StopRequest>,
    store: StoreWriter,
    latency: Latency,
    claim: Claim,
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

impl Service for GatewayService {
    const PROGRAM: &'static str = "mavlink_gateway";

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
            .map(|name| ports.output_of(topics::RANGE_SCAN, name))
            .collect::<Result<_, _>>()?;
        let flight = FlightFile::of(&ports.setup().instance.folder());
        Ok(Self {
            gateway: Gateway::new(config)
                .resuming(jink_runtime::now(), flight.read())
                .with_range_sources(sources)
                .with_params(&ports.config().params)
                .with_board_id(board_id()),
            links,
            outputs: Outputs::default(),
            received: Vec::with_capacity(MESSAGES_MAX),
            news: Vec::with_capacity(EVENTS_MAX),
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
            board: Board::watch().ok(),
            parameters: ports.output(topics::PARAMETERS)?,
            // Each command that asks is a producer of its own.
            changes: ports.input(topics::PARAMETER_CHANGE)?.of_all_producers(),
            stop_requests: ports.input(topics::STOP_REQUEST)?.of_all_producers(),
            store: ports.param_store().clone().writer(),
            latency: ports.latency(),
            claim: ports.claim(),
            flight,
            proven,
            begin: jink_runtime::now(),
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        let now = cycle.now;
        if self.links.holds() && !self.claim.is_due(now) {
            self.release();
        }
        // What the former holder has read is its own to answer, also if the link passes over behind it.
        let speaks = self.links.holds();
        self.claim.declare(speaks);
        self.gateway.listen_only(!speaks);
        let progress = self.receive(now);
        self.news.clear();
        for event in self.links.news() {
            cycle.events.publish(now, &event);
            self.news.push(event);
        }
        let since = self.begin.plus_seconds(-TOLD_BEFORE_S);
        self.events.each(|event| {
            // Its own are on their way already, and what came long before it has been said by the gateway before.
            let is_news = event.sample.process != self.me && event.header.publish >= since;
            if is_news && self.news.len() < EVENTS_MAX {
                self.news.push(*event.sample);
            }
        });
        self.changes
            .each(|change| self.gateway.change_param(change.sample));
        self.stop_requests.each(|_| self.gateway.request_stop(now));
        if let Some(reading) = self.board.as_ref().and_then(Board::news) {
            self.gateway.notice_board(reading);
        }
        let inputs = Inputs {
            messages: &self.received,
            link: self.links.report(),
            approved: self.approved.latest(now),
            prevented: self.prevented.latest(now),
            ring: self.ring.latest(now),
            system: self.system.latest(now),
            events: &self.news,
        };
        self.gateway.step(now, &inputs, &mut self.outputs);
        if speaks {
            self.send();
            self.flight.keep(now, self.gateway.record(now));
        }
        self.claim.stand_by(!self.gateway.profile_fits());
        if speaks {
            self.proven.keep(self.gateway.proven_profile());
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
        wake = wake.min(self.links.next_wake().unwrap_or(wake));
        if let Some(change) = self.claim.changes_at().filter(|change| *change > now) {
            wake = wake.min(change);
        }
        if self.links.is_orphaned() {
            wake = wake.min(now.plus_seconds(ORPHAN_LOOKS_S));
        }
        Wake::at(wake)
    }

    /// An instance that only listens does as the one that speaks; that one knows best itself.
    fn retune(&mut self, params: &ParamSet) {
        if !self.links.holds() {
            self.gateway.follow_params(params);
        }
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
            let baton = Baton::of(&self.gateway, encoder, stamps).to_bytes();
            self.links.release(&baton);
        }
    }

    /// Goes on where the former holder of the links has stopped, if it has passed them on or died. Returns whether this
    /// instance speaks from now on.
    fn take_over(&mut self, now: Timestamp) -> bool {
        if let Some(baton) = self.links.take_baton() {
            match (Baton::of_bytes(&baton), self.links.encoder()) {
                (Some(baton), Some(encoder)) => {
                    let stamps = baton.hand_to(now, &mut self.gateway, encoder);
                    self.links.go_on_from(stamps);
                }
                _ => self.gateway.go_on_at_once(now),
            }
            tracing::info!("the link was passed on to this instance");
            return true;
        }
        let left_alone = self.links.is_orphaned() && self.claim.is_due(now);
        if left_alone {
            self.links.take();
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

    fn receive(&mut self, now: Timestamp) -> Progress {
        self.received.clear();
        let us = self.gateway.us(now);
        self.links.receive(jink_runtime::now, us, &mut self.received)
    }

    fn send(&mut self) {
        if let Some(header) = &self.outputs.told {
            self.latency.left(header, jink_runtime::now());
        }
        for message in self.outputs.messages() {
            let sent = self.links.send(jink_runtime::now(), message);
            // What is for everybody counts when the autopilot has it.
            let link = match message.to {
                Destination::Link(link) => link,
                Destination::Everyone => self.gateway.autopilot_link(),
            };
            if sent.contains(link) {
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
        for arrived in self.outputs.scans() {
            if let Some(output) = self.scans.get_mut(arrived.source) {
                output.send(captured(arrived.at), &arrived.scan);
            }
        }
        if let Some((demand, capture)) = &self.outputs.pilot_demand {
            self.pilot.send(captured(*capture), demand);
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

/// How often what is flown is written down although it has not changed (s): it is read if it is not much older.
const WRITTEN_EVERY_S: f64 = 1.0;

/// What is flown, in a file on tmpfs that is read by the next gateway.
struct FlightFile {
    path: PathBuf,
    written: Option<Record>,
}

impl FlightFile {
    fn of(folder: &Path) -> Self {
        Self {
            path: folder.join("mavlink_gateway.flight"),
            written: None,
        }
    }

    fn read(&self) -> Option<Record> {
        std::fs::read(&self.path)
            .ok()
            .and_then(|bytes| Record::of_bytes(&bytes))
    }

    /// Writes a new file beside the old one and puts it in its place: whoever reads meanwhile has one of the two whole.
    fn keep(&mut self, now: Timestamp, record: Option<Record>) {
        let Some(record) = record else { return };
        let is_kept = self.written.is_some_and(|written| {
            let is_recent = !record.armed || now.seconds_since(written.written) < WRITTEN_EVERY_S;
            written.says_the_same(&record) && is_recent
        });
        if is_kept {
            return;
        }
        self.written = Some(record);
        let beside = self.path.with_extension("new");
        let done =
            std::fs::write(&beside, record.to_bytes()).and_then(|()| std::fs::rename(&beside, &self.path));
        if let Err(cause) = done {
            tracing::warn!(
                "what is flown is not kept for a restart, {}: {cause}",
                self.path.display()
            );
        }
    }
}

/// Which profile a gateway of this run has found to fit the autopilot, in a file of the instance: a gateway that is started again
/// in flight goes on at once with what was chosen.
struct ProvenProfile {
    file: PathBuf,
    kept: Option<ProfileName>,
}

impl ProvenProfile {
    /// What is kept in `file`; nothing, if it cannot be read.
    fn of(file: PathBuf) -> Self {
        let text = std::fs::read_to_string(&file).unwrap_or_default();
        Self {
            kept: text.trim().parse().ok(),
            file,
        }
    }

    /// The profile to begin with, and whether it is proven.
    fn for_choice(&self, choice: ProfileChoice) -> (ProfileName, bool) {
        match (choice, self.kept) {
            (ProfileChoice::Fixed(profile), kept) => (profile, kept == Some(profile)),
            (ProfileChoice::Auto, Some(kept)) => (kept, true),
            (ProfileChoice::Auto, None) => (ProfileName::Px4Trajectory, false),
        }
    }

    /// Keeps it if it is another than before. What was proven once stays: a run has one profile.
    fn keep(&mut self, proven: Option<ProfileName>) {
        if proven.is_none() || proven == self.kept {
            return;
        }
        self.kept = proven;
        let written = std::fs::write(&self.file, proven.map_or("", ProfileName::name));
        if let Err(cause) = written {
            tracing::warn!(
                "{}: {cause}; a restarted gateway will ask the autopilot again",
                self.file.display()
            );
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

/// Opens or joins all links of the configuration.
fn open_links(ports: &Ports) -> Result<Links, StartError> {
    let (settings, setup) = (&ports.config().link, ports.setup());
    let mut setups = Vec::new();
    for row in settings.rows() {
        let link = LinkSetup::of(&row).map_err(|error| needs(error.key)(error.cause))?;
        if link.is_exposed() {
            tracing::warn!(
                "{}: anybody on the network can speak on {}; name the peers, or set signing = \"require\"",
                row.table,
                row.address
            );
        }
        setups.push(link);
    }
    let doors: Vec<_> = (0..setups.len())
        .map(|index| match index {
            0 => setup.instance.handover_socket(&setup.process),
            _ => setup
                .instance
                .handover_socket(&format!("{}.{index}", setup.process)),
        })
        .collect();
    let opened = if setup.shadow {
        Links::join(setups, &doors)
    } else {
        Links::open(setups, &doors, |first| open(first, setup.generation))
    };
    let mut links = opened.map_err(needs(format!("link.address = {:?}", settings.address)))?;
    let state = match settings.state.as_str() {
        "" => setup.instance.folder(),
        folder => PathBuf::from(folder),
    };
    let stamps = state.join(format!("{}.stamps", setup.process));
    links
        .sign_with_stamps_at(&stamps)
        .map_err(needs(format!("link.state: {}", stamps.display())))?;
    if !settings.tlog.is_empty() {
        let log = Tlog::begin(Path::new(&settings.tlog), setup.generation)
            .map_err(needs(format!("link.tlog = {:?}", settings.tlog)))?;
        tracing::info!("telemetry log: {}", log.path().display());
        links.record(log);
    }
    Ok(links)
}

/// Opens the first link. At a restart a second instance that is just being ended may still have it for a moment.
fn open(setup: &LinkSetup, generation: u32) -> Result<Link, LinkError> {
    let patience = jink_runtime::now().plus_seconds(LET_GO_S);
    loop {
        match Link::open(setup.endpoint.clone()) {
            Err(LinkError::AddressInUse { .. }) if generation > 1 && jink_runtime::now() < patience => {
                std::thread::sleep(Duration::from_millis(2));
            }
            opened => return opened,
        }
    }
}

fn main() -> ExitCode {
    // As a tool: the examination of the links before the flight.
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let Some((_, rest)) = arguments.split_first().filter(|(first, _)| *first == "check") {
        return jink_mavlink_gateway::check::run(rest);
    }
    jink_runtime::run::<GatewayService>()
}
