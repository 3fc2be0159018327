//! A flight in one process, in lock-step: the processes of the table, a radio link with its faults, a ground station. Faster than
//! real time, the same to the bit on every run.
//!
//! | part | what it is |
//! |---|---|
//! | `Board` | the very services that fly, opened and run as in processes of their own, and the supervisor's rules |
//! | the wire | datagram sockets between autopilot and gateway, where frames may be lost, doubled and damaged |
//! | the ground station | the one that `jink-simulator fly` has, on a socket of its own |
//!
//! Time advances by 4 ms. Processes run from the end of the chain to its start: what one puts out in a step, the next one sees in the
//! next step, so that a range needs some steps to become a setpoint, as it does between processes. The board's clock and the
//! autopilot's clock differ. What a service computes takes no time.

mod folder;
mod observation;
mod radio;
mod rig;
mod setup;
mod spectator;

pub use jink_simulator::service::FrameDelay;
pub use setup::{FlightSetup, UserPlanner};

use crate::board::Board;
use crate::proposer::{Plan, ProposerService};
use folder::{Folder, address};
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::truth::Observer;
use jink_emulated_ground_station::GroundStation;
use jink_runtime::Clock;
use jink_runtime::lockstep::LocalBus;
use jink_shared_types::events::EventSample;
use jink_shared_types::map::LocalMap;
use jink_shared_types::motion::{RouteMode, Verdict};
use jink_shared_types::param_messages::ParameterChange;
use jink_shared_types::params::OA_VEH_RADIUS;
use jink_shared_types::prevention::PreventedDemand;
use jink_shared_types::truth::SimTruth;
use jink_shared_types::{SampleHeader, Timestamp};
use jink_simulated_world::vehicle::STEP_US;
use jink_simulated_world::world::World;
use jink_simulator::service::local::{LocalSocket, MavLocal};
use jink_simulator::service::{SensorService, VehicleService};
use mavlink::dialect::MavMessage;
use mavlink::{MavHeader, Message};
use radio::Radio;
use rig::{FlightRig, Flown};
use setup::configuration;
use spectator::{Nothing, Spectator};
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;

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
    /// The process of somebody else's planner.
    user_planner: Option<String>,
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
    /// The companion has no power: none of its processes runs.
    pub dead_companion: bool,
    /// How long frames are under way from their sensor, and what their stamps say.
    pub frame_delay: FrameDelay,
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
        let proposer = setup.proposer.map_or("", |_| PROPOSER_ROW);
        let planner = setup.planner.as_ref().map(UserPlanner::row).unwrap_or_default();
        let table = format!("{PROCESSES}{proposer}{planner}");
        let folder = Folder::new(&configuration(&setup)?, &table)?;
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
        let board = Board::new(&bus, &folder.0, &table, rig)?;
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
            },
            user_planner: setup.planner.map(|planner| planner.process()),
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
            dead_companion: false,
            frame_delay: FrameDelay::default(),
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

    /// It proposes nothing any more, nor does whoever is started in its place.
    pub fn silence_proposer(&mut self) {
        self.flown.borrow_mut().proposer = Plan::Silent;
        if let Some(proposer) = self.board.service_mut::<ProposerService>(PROPOSER) {
            proposer.plan = Plan::Silent;
        }
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
        if !self.dead_companion {
            self.board.supervise();
            self.radio.down(now_s, self.mute_sticks);
            self.set_sensors_up();
            self.board.run([
                "mavlink_gateway",
                "collision_guard",
                "bezier_generator",
                "planner",
                PROPOSER,
                self.user_planner.as_deref().unwrap_or_default(),
                "obstacle_fusion",
                SENSORS,
                "parameter_server",
                "ground_services",
            ]);
            self.radio.up(now_s);
        }
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
            sensors.delay_frames(self.frame_delay);
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
            link,
            events,
            ..
        } = &mut self.spectator;
        maps.latest(now);
        route.latest(now);
        prevented.latest(now);
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
}

impl std::fmt::Debug for LockStep {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "LockStep(step {})", self.step)
    }
}
