//! A flight in one process, in lock-step: the processes of the table, a radio link with its faults, a ground station. Faster than
//! real time, the same to the bit on every run.
//!
//! | part | what it is |
//! |---|---|
//! | [`Board`] | the very services that fly, opened and run as in processes of their own, and the supervisor's rules |
//! | the wire | datagram sockets between autopilot and gateway, where frames may be lost, doubled and damaged |
//! | the ground station | the one that `jink-simulator fly` has, on a socket of its own |
//!
//! Time advances by 4 ms. Processes run from the end of the chain to its start: what one puts out in a step, the next one sees in the
//! next step, so that a range needs some steps to become a setpoint, as it does between processes. The board's clock and the
//! autopilot's clock differ. What a service computes takes no time.

use crate::board::{Board, Rig};
use crate::lossy::{LinkFaults, Lossy};
use crate::proposer::{Plan, ProposerService};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::truth::Observer;
use jink_emulated_ground_station::{FlightPlan, GroundStation, Outcome};
use jink_mavlink_link::profile_name::{ProfileName, Representation};
use jink_runtime::config::{CONFIG_FILE, Config};
use jink_runtime::lockstep::{LocalBus, Member};
use jink_runtime::{Clock, Input, Instance, OpenError, Output, Session};
use jink_shared_types::coded::Wire as _;
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::health::Health;
use jink_shared_types::link::{AssistState, LinkStatus};
use jink_shared_types::map::LocalMap;
use jink_shared_types::motion::{ApprovedTrajectory, MotionState, Route, RouteMode, TrajectoryMode, Verdict};
use jink_shared_types::param_messages::ParameterChange;
use jink_shared_types::params::{OA_VEH_RADIUS, ParamSet};
use jink_shared_types::prevention::PreventedDemand;
use jink_shared_types::topics;
use jink_shared_types::truth::SimTruth;
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{SampleHeader, Timestamp};
use jink_simulated_world::sensors::SensorSpec;
use jink_simulated_world::vehicle::STEP_US;
use jink_simulated_world::world::World;
use jink_simulator::autopilot::AutopilotConfig;
use jink_simulator::service::local::{LocalSocket, MavLocal};
use jink_simulator::service::{SensorService, VehicleService};
use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::{MavHeader, Message};
use serde::Serialize;
use std::any::Any;
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::atomic::{AtomicU32, Ordering};

pub use jink_simulator::service::ScanDelay;

/// Where the board's clock stands when the autopilot boots: any number but zero.
const BOARD_START_S: f64 = 1_000.0;
/// Component id of the autopilot.
const AUTOPILOT_COMPONENT: u8 = 1;
/// The process table that is shipped.
const PROCESSES: &str = include_str!("../../config/services.toml");
/// The process with the vehicle, and the one with its sensors.
const VEHICLE: &str = "simulator";
const SENSORS: &str = "sensors";
/// A planner that a user brings, and its row in the table.
const PROPOSER: &str = "proposer";
const PROPOSER_ROW: &str = r#"
[[process]]
name = "proposer"
program = "jink-proposer"
essential = false
on_failure = "ignore"
"#;
/// Message ids of the sticks: RC_CHANNELS, MANUAL_CONTROL.
const STICKS: [u32; 2] = [65, 69];
/// Longest datagram.
const DATAGRAM_BYTES: usize = 2048;

/// One flight's set-up.
#[derive(Clone, Debug)]
pub struct FlightSetup {
    /// The world.
    pub world: World,
    /// Seed of sensors and wind.
    pub seed: u64,
    /// Parameters of all services.
    pub params: ParamSet,
    /// The sensors.
    pub sensors: Vec<SensorSpec>,
    /// The autopilot.
    pub autopilot: AutopilotConfig,
    /// How the gateway talks to it.
    pub profile: ProfileName,
    /// In which message.
    pub representation: Representation,
    /// Whether the gateway takes missions over.
    pub takes_missions: bool,
    /// What happens to what they say to each other.
    pub link_faults: Option<LinkFaults>,
    /// What the ground station flies.
    pub plan: FlightPlan,
    /// How the planner that a user brings plans; `None` where there is none.
    pub proposer: Option<Plan>,
}

/// What a flight cost in time.
#[derive(Clone, Debug, Default)]
pub struct Costs {
    /// Wall time of each planner cycle with a new map (ms).
    pub plan_ms: Vec<f64>,
    /// Wall time of each generator cycle with a new plan (ms).
    pub curve_ms: Vec<f64>,
    /// Wall time of each fusion cycle that put out a map (ms).
    pub map_ms: Vec<f64>,
}

/// What came over a link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Messages.
    pub messages: u64,
    /// Bytes on the wire.
    pub bytes: u64,
}

/// The folder of an instance that is removed at the end.
struct Folder(Instance);

impl Folder {
    /// A new one with its configuration.
    fn new(config: &str) -> Result<Self, String> {
        static FLIGHTS: AtomicU32 = AtomicU32::new(0);
        let number = FLIGHTS.fetch_add(1, Ordering::Relaxed);
        let name = format!("ls{}_{number}", std::process::id());
        let folder = Self(name.parse().map_err(|error| format!("{error}"))?);
        let run_config = folder.0.run_config();
        std::fs::create_dir_all(&run_config)
            .and_then(|()| std::fs::write(run_config.join(CONFIG_FILE), config))
            .map_err(|error| format!("{}: {error}", run_config.display()))?;
        Ok(folder)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.folder().join(name)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // What is left is reported by whoever looks for left-overs.
        let _left = std::fs::remove_dir_all(self.0.folder());
    }
}

/// The link between autopilot and gateway.
struct Radio {
    autopilot: LocalSocket,
    gateway: LocalSocket,
    /// The way to the autopilot, and from it.
    ways: [Lossy; 2],
}

impl Radio {
    fn new(folder: &Folder, faults: LinkFaults, seed: u64) -> std::io::Result<Self> {
        let pair = |own: &str, peer: &str| LocalSocket::bind(&folder.path(own), &folder.path(peer));
        Ok(Self {
            autopilot: pair("autopilot.jink", "autopilot")?,
            gateway: pair("wire", "wire.jink")?,
            ways: [0, 1].map(|way| Lossy::new(faults, 2 * seed + way)),
        })
    }

    fn down(&mut self, now_s: f64, mute_sticks: bool) {
        let mut buffer = [0; DATAGRAM_BYTES];
        while let Some(frame) = self.autopilot.receive(&mut buffer) {
            if !(mute_sticks && STICKS.contains(&message_id(frame))) {
                self.ways[1].send(now_s, frame);
            }
        }
        for frame in self.ways[1].arrived(now_s) {
            self.gateway.send(&frame);
        }
    }

    fn up(&mut self, now_s: f64) {
        let mut buffer = [0; DATAGRAM_BYTES];
        while let Some(frame) = self.gateway.receive(&mut buffer) {
            self.ways[0].send(now_s, frame);
        }
        for frame in self.ways[0].arrived(now_s) {
            self.autopilot.send(&frame);
        }
    }
}

/// Of a frame of MAVLink 2: bytes 7 to 9, little-endian.
fn message_id(frame: &[u8]) -> u32 {
    match frame {
        [_, _, _, _, _, _, _, low, middle, high, ..] => u32::from_le_bytes([*low, *middle, *high, 0]),
        _ => u32::MAX,
    }
}

/// What is flown, and where: no configuration can say it as exactly.
struct Flown {
    autopilot: AutopilotConfig,
    world: World,
    proposer: Plan,
}

/// Sets the processes of a flight up.
struct FlightRig {
    wire: String,
    vehicle: String,
    flown: Rc<RefCell<Flown>>,
}

impl Rig for FlightRig {
    /// The vehicle and the gateway are at the two ends of the radio.
    fn configure(&self, process: &str, config: &mut Config) {
        let side = if process == VEHICLE {
            &self.vehicle
        } else {
            &self.wire
        };
        config.link.address.clone_from(side);
    }

    fn fit(&self, process: &mut dyn Any) {
        let flown = self.flown.borrow();
        if let Some(member) = process.downcast_mut::<Member<VehicleService>>()
            && let Ok(autopilot) = flown.autopilot.clone().build()
        {
            member.service_mut().replace(autopilot, flown.world.clone());
        }
        if let Some(member) = process.downcast_mut::<Member<SensorService>>() {
            member.service_mut().move_world(flown.world.clone());
        }
        if let Some(member) = process.downcast_mut::<Member<ProposerService>>() {
            member.service_mut().plan = flown.proposer;
        }
    }
}

/// What a spectator reads.
struct Spectator {
    map: Input<LocalMap>,
    route: Input<Route>,
    approved: Input<ApprovedTrajectory>,
    prevented: Input<PreventedDemand>,
    state: Input<VehicleState>,
    link: Input<LinkStatus>,
    events: Input<EventSample>,
    change: Output<ParameterChange>,
}

impl Spectator {
    fn new(bus: &LocalBus) -> Result<Self, OpenError> {
        let session = Session::local(bus, "cli");
        Ok(Self {
            map: session.input(topics::LOCAL_MAP, "")?,
            route: session.input(topics::ROUTE, "")?,
            approved: session.input(topics::APPROVED, "")?,
            prevented: session.input(topics::PREVENTED, "")?,
            state: session.input(topics::VEHICLE_STATE, "")?,
            link: session.input(topics::LINK_STATUS, "")?,
            events: session.input(topics::EVENT, "")?,
            change: session.output(topics::PARAMETER_CHANGE, "", 1)?,
        })
    }
}

/// What is read before anything has been said.
struct Nothing {
    map: Box<LocalMap>,
    route: Box<Route>,
    approved: Box<ApprovedTrajectory>,
    prevented: PreventedDemand,
    state: VehicleState,
}

/// A flight under way.
pub struct LockStep {
    bus: LocalBus,
    board: Board,
    radio: Radio,
    station: GroundStation,
    station_link: MavLocal,
    spectator: Spectator,
    nothing: Nothing,
    flown: Rc<RefCell<Flown>>,
    boots: Box<dyn Autopilot>,
    truth: SimTruth,
    step: u64,
    was_braked: bool,
    planned_map: u64,
    curved_plan: u64,
    /// What it cost.
    pub costs: Costs,
    /// Every event raised, with the time since boot (s).
    pub events: Vec<(f64, EventSample)>,
    /// Guard brakes.
    pub brakes: u32,
    /// Sensors (by index) that are silent: what a dead driver looks like to the rest.
    pub silent_sensors: BTreeSet<usize>,
    /// The ground station says nothing: somebody else commands.
    pub silent_station: bool,
    /// The companion receives no sticks.
    pub mute_sticks: bool,
    /// How long scans are under way from their sensor, and what their stamps say.
    pub scan_delay: ScanDelay,
    /// What of the companion's came over the ground station's link, through the autopilot's forwarding, by message id.
    pub companion_traffic: BTreeMap<u32, Traffic>,
    /// The last to go: everything above may still use it.
    _folder: Folder,
}

impl LockStep {
    /// Sets everything up; nothing runs yet.
    ///
    /// # Errors
    /// A text naming what cannot be built.
    pub fn new(setup: FlightSetup) -> Result<Self, String> {
        let text = |error: &dyn std::fmt::Display| error.to_string();
        let mut autopilot = setup.autopilot.clone();
        autopilot.vehicle_mut().seed = setup.seed;
        // Refused here, not when its process starts; and what is seen until then.
        let boots = autopilot.clone().build().map_err(|error| text(&error))?;
        let truth = Observer::new(setup.params.get(&OA_VEH_RADIUS)).observe(boots.as_ref(), &setup.world);
        let bus = LocalBus::new(Timestamp::from_seconds(BOARD_START_S));
        let folder = Folder::new(&configuration(&setup)?)?;
        let (wire, vehicle) = (address(&folder.path("wire")), address(&folder.path("autopilot")));
        let flown = Rc::new(RefCell::new(Flown {
            autopilot,
            world: setup.world,
            proposer: setup.proposer.unwrap_or(Plan::Silent),
        }));
        let rig = FlightRig {
            wire,
            vehicle,
            flown: Rc::clone(&flown),
        };
        let users = setup.proposer.map_or("", |_| PROPOSER_ROW);
        let board = Board::new(&bus, &folder.0, &format!("{PROCESSES}{users}"), rig)?;
        let faults = setup.link_faults.unwrap_or_default();
        let station = LocalSocket::bind(
            &folder.path("autopilot.station"),
            &folder.path("autopilot.ground"),
        )
        .map_err(|error| text(&error))?;
        Ok(Self {
            radio: Radio::new(&folder, faults, setup.seed).map_err(|error| text(&error))?,
            station: GroundStation::new(setup.plan),
            station_link: MavLocal::new(station, Clock::of(&bus)),
            spectator: Spectator::new(&bus).map_err(|error| text(&error))?,
            nothing: Nothing {
                map: LocalMap::boxed(),
                route: Box::default(),
                approved: Box::default(),
                prevented: PreventedDemand::default(),
                state: VehicleState::default(),
            },
            board,
            bus,
            flown,
            boots,
            truth,
            step: 0,
            was_braked: false,
            planned_map: 0,
            curved_plan: 0,
            costs: Costs::default(),
            events: Vec::new(),
            brakes: 0,
            silent_sensors: BTreeSet::new(),
            silent_station: false,
            mute_sticks: false,
            scan_delay: ScanDelay::default(),
            companion_traffic: BTreeMap::new(),
            _folder: folder,
        })
    }

    /// The processes.
    pub fn board(&mut self) -> &mut Board {
        &mut self.board
    }

    /// Asks for a value of a parameter, as `jink param set` does.
    pub fn set_param(&mut self, name: &str, value: f64) {
        let row = jink_shared_types::params::TABLE
            .iter()
            .position(|row| row.name == name);
        let change = ParameterChange {
            table: jink_shared_types::param_messages::TABLE_HASH,
            id: self.step + 1,
            value,
            row: row.map_or(u32::MAX, |row| row as u32),
            ..ParameterChange::default()
        };
        self.spectator
            .change
            .send(SampleHeader::at(self.bus.now()), &change);
    }

    /// A second ground station, a pilot's tablet say, sends a message to the autopilot.
    pub fn send(&mut self, message: MavMessage) {
        let header = MavHeader {
            system_id: 254,
            ..MavHeader::default()
        };
        self.station_link.send(&header, &message);
    }

    /// Where the vehicle should be now, and how fast; `None` while the autopilot's own setpoints are mirrored.
    pub fn reference(&self) -> Option<MotionState> {
        let trajectory = &self.approved().trajectory;
        let flown = trajectory.mode != TrajectoryMode::Mirror && trajectory.is_sound();
        flown.then(|| trajectory.at(self.now()))?
    }

    /// The truth after the last step.
    pub fn truth(&self) -> &SimTruth {
        &self.truth
    }

    /// The autopilot; before its process runs, one that has just booted.
    pub fn autopilot(&self) -> &dyn Autopilot {
        let vehicle = self.board.service::<VehicleService>(VEHICLE);
        vehicle.map_or(self.boots.as_ref(), VehicleService::autopilot)
    }

    /// What is approved now.
    pub fn approved(&self) -> &ApprovedTrajectory {
        let newest = self.spectator.approved.newest();
        newest.map_or(&*self.nothing.approved, |approved| approved.sample)
    }

    /// The planner's newest answer.
    pub fn route(&self) -> &Route {
        let newest = self.spectator.route.newest();
        newest.map_or(&*self.nothing.route, |route| route.sample)
    }

    /// The planner that a user brings, while it runs.
    pub fn proposer(&self) -> Option<&ProposerService> {
        self.board.service(PROPOSER)
    }

    /// It proposes nothing any more, nor does whoever is started in its place.
    pub fn silence_proposer(&mut self) {
        self.flown.borrow_mut().proposer = Plan::Silent;
        if let Some(proposer) = self.board.service_mut::<ProposerService>(PROPOSER) {
            proposer.plan = Plan::Silent;
        }
    }

    /// What of the pilot's wish was allowed last.
    pub fn prevented(&self) -> &PreventedDemand {
        let newest = self.spectator.prevented.newest();
        newest.map_or(&self.nothing.prevented, |prevented| prevented.sample)
    }

    /// The newest map.
    pub fn map(&self) -> &LocalMap {
        let newest = self.spectator.map.newest();
        newest.map_or(&*self.nothing.map, |map| map.sample)
    }

    /// The newest vehicle state, as the board knows it.
    pub fn state(&self) -> &VehicleState {
        let newest = self.spectator.state.newest();
        newest.map_or(&self.nothing.state, |state| state.sample)
    }

    /// Whether a pilot is assisted, as the gateway said last.
    pub fn assist(&self) -> AssistState {
        let newest = self.spectator.link.newest();
        newest.map_or(AssistState::UNKNOWN, |link| link.assist.get())
    }

    /// The gateway's figures, as it said last.
    pub fn link_status(&self) -> LinkStatus {
        let newest = self.spectator.link.newest();
        newest.map_or_else(LinkStatus::default, |link| *link.sample)
    }

    /// Health of the whole, as the supervisor judges.
    pub fn health(&self) -> Health {
        self.board.health()
    }

    /// Puts another world in the place of the one there is: something in it has moved.
    pub fn move_world(&mut self, world: World) {
        if let Some(vehicle) = self.board.service_mut::<VehicleService>(VEHICLE) {
            vehicle.move_world(world.clone());
        }
        if let Some(sensors) = self.board.service_mut::<SensorService>(SENSORS) {
            sensors.move_world(world.clone());
        }
        self.flown.borrow_mut().world = world;
    }

    /// The board's clock.
    pub fn now(&self) -> Timestamp {
        self.bus.now()
    }

    /// How the ground station sees the flight; the outcome is set when it is over.
    pub fn outcome(&self) -> Option<&Outcome> {
        self.station.progress().outcome.as_ref()
    }

    /// The ground station.
    pub fn station(&self) -> &GroundStation {
        &self.station
    }

    /// Goes on for `seconds` of the board's clock.
    pub fn run(&mut self, seconds: f64) {
        let end = self.now().plus_seconds(seconds);
        while self.now() < end {
            self.step();
        }
    }

    /// Goes on until `done`, at most for `seconds` of the board's clock. Returns whether it was.
    pub fn run_until(&mut self, seconds: f64, done: impl Fn(&Self) -> bool) -> bool {
        let end = self.now().plus_seconds(seconds);
        while self.now() < end {
            self.step();
            if done(self) {
                return true;
            }
        }
        false
    }

    /// 4 ms of everything.
    pub fn step(&mut self) {
        let now = self.now();
        let now_s = now.ns as f64 * 1e-9;
        let (map, route) = (self.newest_map(), self.newest_plan());
        self.board.supervise();
        self.radio.down(now_s, self.mute_sticks);
        self.set_sensors_up();
        self.board.run([
            "mavlink_gateway",
            "collision_guard",
            "bezier_generator",
            "planner",
            PROPOSER,
            "obstacle_fusion",
            SENSORS,
            "parameter_server",
            "ground_services",
        ]);
        self.radio.up(now_s);
        self.board.run([VEHICLE]);
        self.run_station();
        self.look(map, route);
        self.step += 1;
        self.bus.set_clock(
            Timestamp::from_seconds(BOARD_START_S).plus_seconds(self.step as f64 * STEP_US as f64 * 1e-6),
        );
    }

    fn set_sensors_up(&mut self) {
        if let Some(sensors) = self.board.service_mut::<SensorService>(SENSORS) {
            sensors.silence(&self.silent_sensors);
            sensors.delay_scans(self.scan_delay);
        }
    }

    fn run_station(&mut self) {
        let Some(vehicle) = self.board.service::<VehicleService>(VEHICLE) else {
            return;
        };
        // Nothing is seen before its first step.
        if vehicle.truth().time_s > 0.0 {
            self.truth = *vehicle.truth();
        }
        let time_s = vehicle.autopilot().time_s();
        let (mut arrivals, mut sent) = (Vec::new(), Vec::new());
        self.station_link.receive(&mut arrivals);
        let received: Vec<_> = arrivals
            .into_iter()
            .map(|arrival| (arrival.header, arrival.message))
            .collect();
        let mut raw = mavlink::MAVLinkV2MessageRaw::new();
        let of_companion = |header: &MavHeader| header.component_id != AUTOPILOT_COMPONENT;
        for (header, message) in received.iter().filter(|(header, _)| of_companion(header)) {
            raw.serialize_message(*header, message);
            let traffic = self.companion_traffic.entry(message.message_id()).or_default();
            traffic.messages += 1;
            traffic.bytes += raw.raw_bytes().len() as u64;
        }
        self.station.step(time_s, &received, &mut sent);
        for (header, message) in sent.iter().filter(|_| !self.silent_station) {
            self.station_link.send(header, message);
        }
    }

    /// Reads the topics; `map` and `plan` are what stood there before this step.
    fn look(&mut self, map: u64, plan: u64) {
        let now = self.now();
        let Spectator {
            map: maps,
            route,
            approved,
            prevented,
            state,
            link,
            events,
            ..
        } = &mut self.spectator;
        maps.latest(now);
        route.latest(now);
        prevented.latest(now);
        state.latest(now);
        link.latest(now);
        approved.each(|approved| {
            let is_braked = approved.verdict == Verdict::Braked;
            self.brakes += u32::from(is_braked && !self.was_braked);
            self.was_braked = is_braked;
        });
        events.each(|event| self.events.push((self.truth.time_s, *event.sample)));
        if let Some(ms) = self.board.ran_ms("planner")
            && std::mem::replace(&mut self.planned_map, map) != map
        {
            self.costs.plan_ms.push(ms);
        }
        if let Some(ms) = self.board.ran_ms("bezier_generator")
            && std::mem::replace(&mut self.curved_plan, plan) != plan
        {
            self.costs.curve_ms.push(ms);
        }
        if let Some(ms) = self.board.ran_ms("obstacle_fusion")
            && self.newest_map() != map
        {
            self.costs.map_ms.push(ms);
        }
    }

    /// Sequence of the newest map.
    fn newest_map(&self) -> u64 {
        let newest = self.spectator.map.newest();
        newest.map_or(0, |map| map.header.sequence)
    }

    /// Sequence of the newest route, if it is a plan.
    fn newest_plan(&self) -> u64 {
        let newest = self.spectator.route.newest();
        let plan = newest.filter(|route| route.mode == RouteMode::Plan);
        plan.map_or(self.curved_plan, |plan| plan.header.sequence)
    }

    /// How often an event was raised.
    pub fn count(&self, event: &events::Event) -> usize {
        self.events
            .iter()
            .filter(|(_, sample)| sample.id == event.id)
            .count()
    }
}

impl std::fmt::Debug for LockStep {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "LockStep(step {})", self.step)
    }
}

/// The address of a socket in the instance's folder.
fn address(path: &Path) -> String {
    format!("unix:{}", path.display())
}

/// `jink.toml` for a set-up.
fn configuration(setup: &FlightSetup) -> Result<String, String> {
    #[derive(Serialize)]
    struct File<'a> {
        params: BTreeMap<&'static str, f64>,
        link: Link<'a>,
        simulation: Simulation,
        sensor: &'a [SensorSpec],
    }
    #[derive(Serialize)]
    struct Link<'a> {
        profile: &'a str,
        output: &'a str,
        takes_missions: bool,
    }
    #[derive(Serialize)]
    struct Simulation {
        world: &'static str,
        seed: u64,
    }
    toml::to_string(&File {
        params: setup
            .params
            .rows()
            .map(|(row, value)| (row.name, value))
            .collect(),
        link: Link {
            profile: setup.profile.name(),
            output: setup.representation.name(),
            takes_missions: setup.takes_missions,
        },
        // The flight's own world takes its place.
        simulation: Simulation {
            world: "empty",
            seed: setup.seed,
        },
        sensor: &setup.sensors,
    })
    .map_err(|error| error.to_string())
}
