//! The whole chain in one process, in lock-step: world, vehicle, autopilot, ground station, sensors, fusion, planner,
//! generator, guard, gateway. Faster than real time, the same to the bit on every run.
//!
//! Time advances by 4 ms. What one part puts out in a step, the next part sees in the next step, so that a range needs some
//! steps to become a setpoint, as it does between processes. The board's clock and the autopilot's clock differ.

use crate::lossy::{LinkFaults, Lossy};
use jink_bezier_generator::Generator;
use jink_collision_guard::guard::{Guard, GuardConfig, GuardInputs};
use jink_collision_guard::prevention::{PreventionConfig, Watch};
use jink_collision_guard::ring::Ring;
use jink_mavlink_gateway::{
    Body, Content, Encoder, Gateway, GatewayConfig, Inputs, Outputs, ProfileName, Received, Representation,
    frame::Splitter,
};
use jink_obstacle_fusion::{Fusion, FusionConfig};
use jink_planner::Planner;
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::health::{Health, SystemStatus};
use jink_shared_types::link::AssistState;
use jink_shared_types::map::LocalMap;
use jink_shared_types::motion::{
    ApprovedTrajectory, MotionState, Route, RouteMode, Trajectory, TrajectoryMode, Verdict,
};
use jink_shared_types::params::{OA_VEH_RADIUS, ParamSet};
use jink_shared_types::prevention::{PilotDemand, PreventedDemand};
use jink_shared_types::ranges::{PointCloud, RangeScan};
use jink_shared_types::ring::SectorRing;
use jink_shared_types::topics::{self, Topic};
use jink_shared_types::truth::SimTruth;
use jink_shared_types::vehicle::{DesiredPath, VehicleState};
use jink_shared_types::{Coded, Reading, SampleHeader, Stamped, Timestamp};
use jink_simulator::autopilot::{Link, Packet};
use jink_simulator::flyer::{Flyer, FlyerConfig};
use jink_simulator::ground_station::{FlightPlan, GroundStation, Outcome};
use jink_simulator::sensors::{Output as SensorOutput, Pose, PoseTrack, SensorRig, SensorSpec};
use jink_simulator::truth::Observer;
use jink_simulator::vehicle::STEP_US;
use jink_simulator::world::World;
use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::{MavHeader, Message};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Instant;

/// Where the board's clock stands when the autopilot boots: any number but zero.
const BOARD_START_S: f64 = 1_000.0;
/// The planner runs at least this often (s).
const PLANNER_PERIOD_S: f64 = 1.0 / 30.0;
/// Component id of the autopilot.
const AUTOPILOT_COMPONENT: u8 = 1;
/// The guard runs at least this often (s).
const GUARD_PERIOD_S: f64 = 1.0 / 30.0;
/// The ring is sent this often (s).
const RING_PERIOD_S: f64 = 1.0 / 15.0;
const WATCH_PERIOD_S: f64 = 0.02;
/// The system's status is sent this often (s).
const STATUS_PERIOD_S: f64 = 0.1;

/// The newest sample of one topic with its header.
struct Slot<T> {
    sample: Box<T>,
    header: SampleHeader,
    deadline_ms: f64,
}

impl<T> Slot<T> {
    fn new(topic: Topic<T>, sample: Box<T>) -> Self {
        Self {
            sample,
            header: SampleHeader::default(),
            deadline_ms: topic.row.deadline_ms,
        }
    }

    fn stamped(&self) -> Option<Stamped<'_, T>> {
        self.header.publish.is_set().then_some(Stamped {
            sample: &*self.sample,
            header: &self.header,
        })
    }

    fn reading(&self, now: Timestamp) -> Reading<'_, T> {
        Reading::judge(self.stamped(), now, self.deadline_ms)
    }

    fn publish(&mut self, now: Timestamp, capture: Timestamp) {
        self.header = SampleHeader {
            sequence: self.header.sequence + 1,
            capture,
            publish: now,
            ..SampleHeader::default()
        };
    }
}

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
    pub autopilot: FlyerConfig,
    /// How the gateway speaks to it.
    pub profile: ProfileName,
    /// In which message.
    pub representation: Representation,
    /// What happens to what they say to each other.
    pub link_faults: Option<LinkFaults>,
    /// What the ground station flies.
    pub plan: FlightPlan,
}

/// What a flight cost in time.
#[derive(Clone, Debug, Default)]
pub struct Costs {
    /// Wall time of each planner cycle with a new map (ms).
    pub plan_ms: Vec<f64>,
    /// Wall time of each generator answer to a plan (ms).
    pub curve_ms: Vec<f64>,
    /// Wall time of each map update (ms).
    pub map_ms: Vec<f64>,
}

/// A flight under way.
pub struct LockStep {
    autopilot: Box<dyn Flyer>,
    station: GroundStation,
    world: World,
    observer: Observer,
    rig: SensorRig,
    track: PoseTrack,
    gateway_config: GatewayConfig,
    params: ParamSet,
    gateway: Gateway,
    encoder: Encoder,
    splitters: [Splitter; 2],
    /// The way to the autopilot, and from it.
    ways: [Lossy; 2],
    outputs: Outputs,
    fusion: Fusion,
    ring: Ring,
    guard: Guard,
    planner: Planner,
    generator: Generator,
    state: Slot<VehicleState>,
    desired: Slot<DesiredPath>,
    map: Slot<LocalMap>,
    route: Slot<Route>,
    trajectory: Slot<Trajectory>,
    approved: Slot<ApprovedTrajectory>,
    watch: Watch,
    watch_due: Timestamp,
    demand: Slot<PilotDemand>,
    prevented: Slot<PreventedDemand>,
    sectors: Slot<SectorRing>,
    assist: AssistState,
    system: Slot<SystemStatus>,
    cloud: Box<PointCloud>,
    scan: RangeScan,
    scans_under_way: VecDeque<LateScan>,
    truth: SimTruth,
    step: u64,
    to_autopilot: Vec<Packet>,
    from_autopilot: Vec<Packet>,
    news: Vec<EventSample>,
    new_map: bool,
    new_route: bool,
    new_trajectory: bool,
    planner_due: Timestamp,
    guard_due: Timestamp,
    ring_due: Timestamp,
    status_due: Timestamp,
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
    /// The companion hears of no sticks.
    pub mute_sticks: bool,
    /// How long scans are under way from their sensor, and what their stamps say.
    pub scan_delay: ScanDelay,
    /// What of the companion's came over the ground station's link, through the autopilot's forwarding, by message id.
    pub companion_traffic: BTreeMap<u32, Traffic>,
}

/// What came over a link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Messages.
    pub messages: u64,
    /// Bytes on the wire.
    pub bytes: u64,
}

/// A slow driver. Clouds are not delayed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ScanDelay {
    /// From the end of a scan until anybody hears of it (s).
    pub delay_s: f64,
    /// It is stamped as if it had been taken when it arrives: what a driver does that does not know better.
    pub is_stamped_on_arrival: bool,
}

/// A scan that nobody has heard of yet.
struct LateScan {
    arrives: Timestamp,
    sensor: usize,
    scan: Box<RangeScan>,
    capture: Timestamp,
}

impl LockStep {
    /// Sets everything up; the vehicle stands on the ground.
    ///
    /// # Errors
    /// A text naming what cannot be built.
    pub fn new(setup: FlightSetup) -> Result<Self, String> {
        let params = &setup.params;
        let sensors = setup.sensors.len();
        let rig = SensorRig::new(&setup.sensors, setup.seed).map_err(|error| error.to_string())?;
        let mut autopilot = setup.autopilot;
        autopilot.vehicle_mut().seed = setup.seed;
        let gateway_config = GatewayConfig {
            representation: setup.representation,
            ..GatewayConfig::from_params(params, setup.profile)
        };
        Ok(Self {
            autopilot: autopilot.build().map_err(|error| error.to_string())?,
            station: GroundStation::new(setup.plan),
            observer: Observer::new(params.get(&OA_VEH_RADIUS)),
            world: setup.world,
            track: PoseTrack::new(rig.longest_frame_s() + 0.1, STEP_US as f64 * 1e-6),
            rig,
            gateway: Gateway::new(gateway_config).with_params(params),
            params: params.clone(),
            gateway_config,
            encoder: Encoder::new(),
            splitters: [Splitter::new(), Splitter::new()],
            ways: [0, 1].map(|way| Lossy::new(setup.link_faults.unwrap_or_default(), 2 * setup.seed + way)),
            outputs: Outputs::default(),
            fusion: Fusion::new(FusionConfig::from_params(params, sensors)),
            ring: Ring::from_params(params),
            guard: Guard::new(GuardConfig::from_params(params), 1),
            planner: Planner::new(params, 1).with_sensors(sensors as u16),
            generator: Generator::new(1),
            state: Slot::new(topics::VEHICLE_STATE, Box::default()),
            desired: Slot::new(topics::DESIRED_PATH, Box::default()),
            map: Slot::new(topics::LOCAL_MAP, LocalMap::boxed()),
            route: Slot::new(topics::ROUTE, Box::default()),
            trajectory: Slot::new(topics::TRAJECTORY, Box::default()),
            approved: Slot::new(topics::APPROVED, Box::default()),
            watch: Watch::new(PreventionConfig::from_params(params)),
            watch_due: Timestamp::NEVER,
            demand: Slot::new(topics::PILOT_DEMAND, Box::default()),
            prevented: Slot::new(topics::PREVENTED, Box::default()),
            sectors: Slot::new(topics::RING, Box::default()),
            assist: AssistState::Off,
            system: Slot::new(topics::SYSTEM_STATUS, Box::default()),
            cloud: PointCloud::boxed(),
            scan: RangeScan::default(),
            scans_under_way: VecDeque::new(),
            truth: SimTruth::default(),
            step: 0,
            to_autopilot: Vec::new(),
            from_autopilot: Vec::new(),
            news: Vec::new(),
            new_map: false,
            new_route: false,
            new_trajectory: false,
            planner_due: Timestamp::NEVER,
            guard_due: Timestamp::NEVER,
            ring_due: Timestamp::NEVER,
            status_due: Timestamp::NEVER,
            costs: Costs::default(),
            events: Vec::new(),
            brakes: 0,
            silent_sensors: BTreeSet::new(),
            silent_station: false,
            mute_sticks: false,
            scan_delay: ScanDelay::default(),
            companion_traffic: BTreeMap::new(),
        })
    }

    /// A gateway that takes no missions over, from before the flight.
    pub fn leave_missions(&mut self) {
        self.gateway_config.takes_missions = false;
        self.gateway = Gateway::new(self.gateway_config).with_params(&self.params);
    }

    /// The gateway dies and is started again: it knows nothing of what it was told before but what its record keeps.
    pub fn restart_gateway(&mut self) {
        let now = self.now();
        let record = self.gateway.record(now);
        // As the process does from its file: with the profile that was proven in this run.
        let proven = self.gateway.proven_profile();
        let config = GatewayConfig {
            profile: proven.unwrap_or(self.gateway_config.profile),
            is_proven: proven.is_some(),
            ..self.gateway_config
        };
        self.gateway = Gateway::new(config)
            .with_params(&self.params)
            .resuming(now, record);
        self.encoder = Encoder::new();
        self.splitters = [Splitter::new(), Splitter::new()];
    }

    /// A second ground station, a pilot's tablet say, sends a message to the autopilot.
    pub fn send(&mut self, message: MavMessage) {
        let header = MavHeader {
            system_id: 254,
            ..MavHeader::default()
        };
        self.to_autopilot.push(Packet {
            link: Link::GroundStation,
            header,
            message,
        });
    }

    /// Where the vehicle should be now, and how fast; `None` while the autopilot's own setpoints are mirrored.
    pub fn reference(&self) -> Option<MotionState> {
        let trajectory = &self.approved.sample.trajectory;
        let flown = trajectory.mode != TrajectoryMode::Mirror && trajectory.is_sound();
        flown.then(|| trajectory.at(self.now()))?
    }

    /// The truth after the last step.
    pub fn truth(&self) -> &SimTruth {
        &self.truth
    }

    /// The autopilot.
    pub fn autopilot(&self) -> &dyn Flyer {
        self.autopilot.as_ref()
    }

    /// What is approved now.
    pub fn approved(&self) -> &ApprovedTrajectory {
        &self.approved.sample
    }

    /// The planner's newest answer.
    pub fn route(&self) -> &Route {
        &self.route.sample
    }

    /// What of the pilot's wish was allowed last.
    pub fn prevented(&self) -> &PreventedDemand {
        &self.prevented.sample
    }

    /// Puts another world in the place of the one there is: something in it has moved.
    pub fn move_world(&mut self, world: World) {
        self.world = world;
    }

    /// The newest map.
    pub fn map(&self) -> &LocalMap {
        &self.map.sample
    }

    /// The newest vehicle state, as the board knows it.
    pub fn state(&self) -> &VehicleState {
        &self.state.sample
    }

    /// Whether a pilot is assisted, as the gateway said last.
    pub fn assist(&self) -> AssistState {
        self.assist
    }

    /// The board's clock.
    pub fn now(&self) -> Timestamp {
        Timestamp::from_seconds(BOARD_START_S).plus_seconds(self.step as f64 * STEP_US as f64 * 1e-6)
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
        // From the end of the chain to its start, so that nobody sees in a step what was made in it.
        let now = self.now();
        self.run_gateway(now);
        self.run_guard(now);
        self.watch_over_the_pilot(now);
        self.run_generator(now);
        self.run_planner(now);
        self.run_sensors(now);
        self.run_autopilot();
        self.step += 1;
    }

    fn run_autopilot(&mut self) {
        let inbox = std::mem::take(&mut self.to_autopilot);
        self.from_autopilot.clear();
        self.autopilot.step(&inbox, &mut self.from_autopilot);
        let to_station: Vec<_> = self
            .from_autopilot
            .iter()
            .filter(|packet| packet.link == Link::GroundStation)
            .map(|packet| (packet.header, packet.message.clone()))
            .collect();
        let mut raw = mavlink::MAVLinkV2MessageRaw::new();
        let of_companion = |header: &MavHeader| header.component_id != AUTOPILOT_COMPONENT;
        for (header, message) in to_station.iter().filter(|(header, _)| of_companion(header)) {
            raw.serialize_message(*header, message);
            let traffic = self.companion_traffic.entry(message.message_id()).or_default();
            traffic.messages += 1;
            traffic.bytes += raw.raw_bytes().len() as u64;
        }
        let mut sent = Vec::new();
        self.station.step(self.autopilot.time_s(), &to_station, &mut sent);
        if self.silent_station {
            sent.clear();
        }
        self.to_autopilot
            .extend(sent.into_iter().map(|(header, message)| Packet {
                link: Link::GroundStation,
                header,
                message,
            }));
        self.truth = self.observer.observe(self.autopilot.as_ref(), &self.world);
    }

    fn run_sensors(&mut self, now: Timestamp) {
        self.track.push(
            now,
            Pose {
                position: self.autopilot.truth().position,
                attitude: self.autopilot.truth().attitude.rotation(),
            },
        );
        while let Some(frame) = self.rig.next_due(now) {
            if self.silent_sensors.contains(&frame.sensor) {
                continue;
            }
            let header = SampleHeader {
                capture: frame.end,
                publish: now,
                ..SampleHeader::default()
            };
            match frame.output {
                SensorOutput::Cloud => {
                    if self
                        .rig
                        .render_cloud(&frame, &self.world, &self.track, &mut self.cloud)
                        .is_ok()
                    {
                        let begin = Instant::now();
                        self.fusion.cloud(frame.sensor, &self.cloud, &header);
                        let _late = self.ring.cloud(frame.sensor, &self.cloud, &header);
                        self.fusion.write(now, &mut self.map.sample);
                        self.costs.map_ms.push(begin.elapsed().as_secs_f64() * 1e3);
                        self.map.publish(now, frame.end);
                        self.new_map = true;
                    }
                }
                SensorOutput::Scan => {
                    if self
                        .rig
                        .render_scan(&frame, &self.world, &self.track, &mut self.scan)
                        .is_ok()
                    {
                        self.scans_under_way.push_back(LateScan {
                            arrives: frame.end.plus_seconds(self.scan_delay.delay_s),
                            sensor: frame.sensor,
                            scan: Box::new(self.scan),
                            capture: frame.end,
                        });
                    }
                }
            }
        }
        self.deliver_scans(now);
    }

    fn deliver_scans(&mut self, now: Timestamp) {
        while self
            .scans_under_way
            .front()
            .is_some_and(|late| late.arrives <= now)
        {
            let Some(mut late) = self.scans_under_way.pop_front() else {
                return;
            };
            if self.scan_delay.is_stamped_on_arrival {
                late.capture = late.capture.plus_seconds(self.scan_delay.delay_s);
                late.scan.first_beam = late.scan.first_beam.plus_seconds(self.scan_delay.delay_s);
            }
            let header = SampleHeader {
                capture: late.capture,
                publish: now,
                ..SampleHeader::default()
            };
            self.fusion.scan(late.sensor, &late.scan, &header);
            let _late = self.ring.scan(late.sensor, &late.scan, &header);
        }
    }

    fn run_planner(&mut self, now: Timestamp) {
        if !self.new_map && now < self.planner_due {
            return;
        }
        let begin = Instant::now();
        let inputs = jink_planner::Inputs {
            map: self.map.reading(now),
            state: self.state.reading(now),
            desired: self.desired.reading(now),
            approved: self.approved.stamped().map(|approved| approved.sample),
        };
        self.planner.step(now, &inputs, &mut self.route.sample);
        if self.new_map {
            self.costs.plan_ms.push(begin.elapsed().as_secs_f64() * 1e3);
        }
        self.new_map = false;
        self.planner_due = now.plus_seconds(PLANNER_PERIOD_S);
        self.route.publish(now, self.map.header.capture);
        self.new_route = true;
        let planner_events: Vec<_> = self.planner.events().to_vec();
        self.raise(&planner_events);
    }

    fn run_generator(&mut self, now: Timestamp) {
        if !std::mem::take(&mut self.new_route) {
            return;
        }
        let flown = self
            .approved
            .stamped()
            .map(|approved| &approved.sample.trajectory);
        let begin = Instant::now();
        let answer = self
            .generator
            .step(now, &self.route.sample, flown, &mut self.trajectory.sample);
        if answer.is_ok() {
            if self.route.sample.mode == RouteMode::Plan {
                self.costs.curve_ms.push(begin.elapsed().as_secs_f64() * 1e3);
            }
            self.trajectory.publish(now, self.route.header.capture);
            self.new_trajectory = true;
        }
    }

    fn run_guard(&mut self, now: Timestamp) {
        let new = std::mem::take(&mut self.new_trajectory);
        if new || now >= self.guard_due {
            let inputs = GuardInputs {
                trajectory: new.then_some(&*self.trajectory.sample),
                state: self.state.reading(now),
                ring: &self.ring,
            };
            let braked_before = self.approved.sample.verdict.get() == Verdict::Braked;
            let news = self.guard.step(now, &inputs, &mut self.approved.sample);
            if self.approved.sample.verdict.get() == Verdict::Braked && !braked_before {
                self.brakes += 1;
            }
            self.approved.publish(now, self.trajectory.header.capture);
            self.guard_due = now.plus_seconds(GUARD_PERIOD_S);
            let guard_events: Vec<_> = news.events().to_vec();
            self.raise(&guard_events);
        }
        if now >= self.ring_due {
            self.ring_due = now.plus_seconds(RING_PERIOD_S);
            self.ring.ring(now, &mut self.sectors.sample);
            self.sectors.publish(now, now);
        }
    }

    fn watch_over_the_pilot(&mut self, now: Timestamp) {
        if !self.demand.reading(now).is_fresh() || now < self.watch_due {
            return;
        }
        self.watch_due = now.plus_seconds(WATCH_PERIOD_S);
        let mut around = SectorRing::default();
        self.ring.ring(now, &mut around);
        let state = self.state.reading(now);
        if let Some((prevented, news)) = self.watch.step(now, self.demand.reading(now), state, &around) {
            *self.prevented.sample = prevented;
            self.prevented.publish(now, now);
            let watch_events: Vec<_> = news.events().to_vec();
            self.raise(&watch_events);
        }
    }

    fn run_gateway(&mut self, now: Timestamp) {
        if now >= self.status_due {
            self.status_due = now.plus_seconds(STATUS_PERIOD_S);
            self.system.sample.health = Coded::new(Health::Healthy);
            self.system.publish(now, now);
        }
        let received = self.received(now);
        let news = std::mem::take(&mut self.news);
        let inputs = Inputs {
            messages: &received,
            link: Default::default(),
            approved: self.approved.reading(now),
            prevented: self.prevented.reading(now),
            ring: self.sectors.reading(now),
            system: self.system.reading(now),
            events: &news,
        };
        self.gateway.step(now, &inputs, &mut self.outputs);
        for message in self.outputs.messages() {
            let bytes = self
                .encoder
                .encode(message.system_id, message.component_id, &message.body);
            if matches!(message.body, Body::Message(_)) {
                self.ways[0].send(now.ns as f64 * 1e-9, bytes);
            }
            self.gateway.wire(now, message.receipt);
        }
        for datagram in self.ways[0].arrived(now.ns as f64 * 1e-9) {
            self.splitters[0].load_datagram(&datagram);
            while let Some(frame) = self.splitters[0].next_frame() {
                if let Ok(message) = frame.decode() {
                    self.to_autopilot.push(Packet {
                        link: Link::Companion,
                        header: frame.header,
                        message,
                    });
                }
            }
        }
        if let Some((state, capture)) = self.outputs.vehicle_state {
            *self.state.sample = state;
            self.state.publish(now, capture);
            self.fusion.vehicle(&state, &self.state.header);
            let _invalid = self.ring.vehicle(&state, &self.state.header);
        }
        if let Some(status) = &self.outputs.link_status {
            self.assist = status.assist.get();
        }
        if let Some((demand, capture)) = self.outputs.pilot_demand {
            *self.demand.sample = demand;
            self.demand.publish(now, capture);
        }
        if let Some((desired, capture)) = self.outputs.desired_path {
            *self.desired.sample = desired;
            self.desired.publish(now, capture);
        }
        let gateway_events: Vec<_> = self.outputs.events().to_vec();
        for event in gateway_events {
            self.events.push((self.autopilot.time_s(), event));
        }
    }

    /// What the autopilot sent to its companion, through the bytes of the wire.
    fn received(&mut self, now: Timestamp) -> Vec<Received> {
        let mut received = Vec::new();
        let mut raw = mavlink::MAVLinkV2MessageRaw::new();
        for packet in self
            .from_autopilot
            .iter()
            .filter(|packet| packet.link == Link::Companion)
        {
            let is_stick = matches!(
                packet.message,
                MavMessage::MANUAL_CONTROL(_) | MavMessage::RC_CHANNELS(_)
            );
            if is_stick && self.mute_sticks {
                continue;
            }
            raw.serialize_message(packet.header, &packet.message);
            self.ways[1].send(now.ns as f64 * 1e-9, raw.raw_bytes());
        }
        for datagram in self.ways[1].arrived(now.ns as f64 * 1e-9) {
            self.splitters[1].load_datagram(&datagram);
            while let Some(frame) = self.splitters[1].next_frame() {
                if let Some(content) = Content::of(&frame) {
                    received.push(Received {
                        header: frame.header,
                        content,
                        time: now,
                        link: 0,
                    });
                }
            }
        }
        received
    }

    fn raise(&mut self, raised: &[EventSample]) {
        let time_s = self.autopilot.time_s();
        for event in raised {
            self.news.push(*event);
            self.events.push((time_s, *event));
        }
    }

    /// How often an event was raised.
    pub fn count(&self, event: &events::Event) -> usize {
        self.events
            .iter()
            .filter(|(_, sample)| sample.id == event.id)
            .count()
    }
}
