//! World, vehicle and autopilot as a process: 250 steps a second in real time, MAVLink on two links, ground truth.

use super::settings;
use super::udp::Arrival;
use super::wire::{Wire, Wires};
use crate::autopilot::AutopilotConfig;
use jink_emulated_autopilot::Autopilot;
use jink_emulated_autopilot::truth::Observer;
use jink_emulated_autopilot::{Link, Packet};
use jink_runtime::config::Config;
use jink_runtime::{Cycle, Output, Ports, Service, StartError, Wake};
use jink_shared_types::truth::SimTruth;
use jink_shared_types::{SampleHeader, Timestamp, params, topics};
use jink_simulated_world::vehicle::STEP_US;
use jink_simulated_world::world::World;
use std::collections::VecDeque;
use std::fmt;
use std::os::fd::BorrowedFd;

/// More steps than this behind, the autopilot's clock falls behind the board's: 2 s. No autopilot's clock does, and curves that are dated
/// by it lie in its future then; a busy machine keeps a simulator waiting for less.
const CATCH_UP_STEPS: u64 = 500;
/// The links, in the order in which they are read.
const LINKS: [Link; 2] = [Link::Companion, Link::GroundStation];

/// Steps of the simulation (Hz).
const STEP_RATE_HZ: u32 = 1_000_000 / STEP_US as u32;

/// The simulated aircraft.
pub struct VehicleService {
    world: World,
    autopilot: Box<dyn Autopilot>,
    observer: Observer,
    companion: Wire,
    ground_station: Option<Wire>,
    truth: Output<SimTruth>,
    newest: SimTruth,
    begin: Timestamp,
    steps: u64,
    late_max_s: f64,
    received: Vec<Arrival>,
    /// Arrived and not yet given to a step, per link in order of arrival.
    waiting: [VecDeque<Arrival>; LINKS.len()],
    inbox: Vec<Packet>,
    outbox: Vec<Packet>,
}

impl fmt::Debug for VehicleService {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "VehicleService({} steps)", self.steps)
    }
}

impl Service for VehicleService {
    const PROGRAM: &'static str = "simulator";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        let config = ports.config().clone();
        let Wires {
            companion,
            ground_station,
        } = Wires::open(ports)?;
        Ok(Self {
            world: settings::world(&config)?,
            autopilot: autopilot(&config)?,
            observer: Observer::new(config.params.get(&params::OA_VEH_RADIUS)),
            companion,
            ground_station,
            truth: ports.output(topics::SIM_TRUTH)?,
            newest: SimTruth::default(),
            // The frames of the sensors end on beats of the clock: a pose is there then, and they need not wait for one.
            begin: ports.clock().now().next_beat(STEP_RATE_HZ),
            steps: 0,
            late_max_s: 0.0,
            received: Vec::new(),
            waiting: Default::default(),
            inbox: Vec::new(),
            outbox: Vec::new(),
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        self.receive();
        let due = cycle.now.ns_since(self.begin) / (STEP_US * 1_000);
        if due > self.steps + CATCH_UP_STEPS {
            let behind = due - self.steps - CATCH_UP_STEPS;
            self.begin = self.begin.plus_seconds(behind as f64 * STEP_US as f64 * 1e-6);
        }
        while self.step_time(self.steps + 1) <= cycle.now {
            self.late_max_s = match self.autopilot.is_armed() {
                true => self
                    .late_max_s
                    .max(cycle.now.seconds_since(self.step_time(self.steps + 1))),
                false => 0.0,
            };
            self.step();
        }
        Wake::at(self.step_time(self.steps + 1))
    }

    fn watched(&self) -> [Option<BorrowedFd<'_>>; jink_runtime::service::WATCHED_FDS] {
        let station = self.ground_station.as_ref().map(Wire::fd);
        let mut fds = [None; jink_runtime::service::WATCHED_FDS];
        fds[..2].copy_from_slice(&[Some(self.companion.fd()), station]);
        fds
    }
}

impl VehicleService {
    /// Puts another autopilot and another world in the place of those that the configuration names.
    pub fn replace(&mut self, autopilot: Box<dyn Autopilot>, world: World) {
        self.autopilot = autopilot;
        self.world = world;
    }

    /// Puts another world in the place of the one there is: something in it has moved.
    pub fn move_world(&mut self, world: World) {
        self.world = world;
    }

    /// The autopilot.
    pub fn autopilot(&self) -> &dyn Autopilot {
        self.autopilot.as_ref()
    }

    /// The truth after the last step.
    pub fn truth(&self) -> &SimTruth {
        &self.newest
    }

    /// When a step is due on the board's clock.
    fn step_time(&self, step: u64) -> Timestamp {
        Timestamp::from_ns(self.begin.ns + step * STEP_US * 1_000)
    }

    fn receive(&mut self) {
        let links = [Some(&mut self.companion), self.ground_station.as_mut()];
        for (link, waiting) in links.into_iter().zip(&mut self.waiting) {
            if let Some(link) = link {
                link.receive(&mut self.received);
                waiting.extend(self.received.drain(..));
            }
        }
    }

    /// Hands the coming step what had arrived by then: a simulation that makes up for lost time sees the messages
    /// when an autopilot on a computer of its own would have seen them, not all at once and then none.
    fn fill_inbox(&mut self) {
        self.inbox.clear();
        let until = self.step_time(self.steps + 1);
        for (link, waiting) in LINKS.into_iter().zip(&mut self.waiting) {
            while waiting.front().is_some_and(|arrival| arrival.time <= until)
                && let Some(arrival) = waiting.pop_front()
            {
                self.inbox.push(Packet {
                    link,
                    header: arrival.header,
                    message: arrival.message,
                });
            }
        }
    }

    fn step(&mut self) {
        self.fill_inbox();
        self.outbox.clear();
        self.autopilot.step(&self.inbox, &mut self.outbox);
        for packet in &self.outbox {
            match (packet.link, &mut self.ground_station) {
                (Link::Companion, _) => self.companion.send(&packet.header, &packet.message),
                (Link::GroundStation, Some(station)) => station.send(&packet.header, &packet.message),
                (Link::GroundStation, None) => {}
            }
        }
        self.steps += 1;
        self.newest = SimTruth {
            late_max_s: self.late_max_s,
            ..self.observer.observe(self.autopilot.as_ref(), &self.world)
        };
        let header = SampleHeader {
            capture: self.step_time(self.steps),
            ..SampleHeader::default()
        };
        self.truth.send(header, &self.newest);
    }
}

/// The autopilot the configuration names; without a name the one that `link.profile` is for.
fn autopilot(config: &Config) -> Result<Box<dyn Autopilot>, StartError> {
    let name = match (config.simulation.autopilot.as_str(), config.link.profile.as_str()) {
        ("auto", "ardupilot_guided") => "ardupilot",
        ("auto", "px4_offboard" | "px4_deviation") => "px4_current",
        ("auto", _) => "px4",
        (name, _) => name,
    };
    let mut autopilot = AutopilotConfig::named(name)
        .ok_or_else(|| StartError::Needs {
            what: format!("simulation.autopilot = {name:?}"),
            cause: format!("there are: auto {}", AutopilotConfig::NAMES.join(" ")),
        })?
        .with_system_id(config.link.system_id.max(1));
    if (name, config.link.profile.as_str()) == ("px4_current", "px4_deviation") {
        autopilot = autopilot.with_parameter("EAV_EN", 1.0);
    }
    autopilot.vehicle_mut().seed = config.simulation.seed;
    autopilot.vehicle_mut().wind = settings::wind(&config.simulation);
    autopilot.build().map_err(|error| StartError::Needs {
        what: "the autopilot".to_owned(),
        cause: error.to_string(),
    })
}
