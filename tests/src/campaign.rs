//! Flights by the hundred: one line per flight, one table at the end.

pub mod page;
pub mod plot;
pub mod recorded;
pub mod table;
pub mod variation;

use crate::lockstep::{FlightSetup, LockStep, UserPlanner};
use crate::station::StationColumn;
use crate::suite;
use crate::suite::difficulty::Difficulty;
use crate::suite::hindrance::Hindrance;
use crate::suite::judge::Judge;
use crate::suite::picture::Course;
use jink_control::speed_limit::SpeedLimit;
use jink_emulated_ground_station::{Ending, FlightPlan, Outcome};
use jink_emulated_px4::Px4Config;
use jink_mavlink_link::profile_name::{ProfileName, Representation};
use jink_runtime::config::sensor_sets::SensorSet;
use jink_runtime::config::{Config, parse_toml};
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::map::declared_as;
use jink_shared_types::motion::Verdict;
use jink_shared_types::quantile::quantiles;
use jink_shared_types::vehicle::NavMode;
use jink_simulated_world::sensors::SensorSpec;
use jink_simulated_world::world::{World, WorldKind, WorldSpec};
use jink_simulator::autopilot::AutopilotConfig;
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::time::Instant;
use variation::Variation;

/// What to fly.
#[derive(Clone, Debug)]
pub struct Cell {
    /// Suite and cell in it, if it is one of a suite.
    pub suite: Option<(&'static str, &'static str)>,
    /// Kind of world.
    pub kind: WorldKind,
    /// Trees per square metre, if not the world's own.
    pub density_per_m2: Option<f64>,
    /// Highest speed (m/s).
    pub speed_mps: f64,
    /// Longest mission (s).
    pub limit_s: f64,
    /// What it sees with.
    pub sensors: SensorSet,
    /// Radius of the vehicle (m), if not that of its parameters.
    pub radius_m: Option<f64>,
    /// What happens in flight.
    pub hindrance: Hindrance,
    /// What differs from other flights of the cell.
    pub variation: Option<Variation>,
}

impl Cell {
    /// The forest, as [`Cell::of`] has it.
    ///
    /// # Errors
    /// A text naming what cannot be built.
    pub fn forest() -> Result<Self, String> {
        Self::of("forest".parse().map_err(|error| format!("{error}"))?)
    }

    /// A world of that kind flown with sensors that see everything, at 3 m/s at most and for two minutes.
    ///
    /// # Errors
    /// A text naming what cannot be built.
    pub fn of(kind: WorldKind) -> Result<Self, String> {
        Ok(Self {
            suite: None,
            radius_m: None,
            hindrance: Hindrance::None,
            variation: None,
            kind,
            density_per_m2: None,
            speed_mps: 3.0,
            limit_s: 120.0,
            sensors: sensor_set(SPHERE)?,
        })
    }
}

/// How a flight ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FlightOutcome {
    /// The last waypoint was reached without a contact, and the vehicle landed.
    Goal,
    /// It touched an obstacle.
    CollisionStatic,
    /// It touched something that moves, or was touched by it.
    CollisionDynamic,
    /// It flew faster than the limit allows.
    LimitViolation,
    /// It stood still until the time was over.
    Stuck,
    /// The time was over.
    Timeout,
    /// It came to rest without a contact where it could not go on: sensors or companion had died.
    Stopped,
    /// It was said before the take-off that no motion can be certified with these sensors.
    Refused,
}

/// One flight.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct FlightReport {
    /// Suite; empty if it is none.
    pub suite: String,
    /// Cell of the suite, or kind of world.
    pub cell: String,
    /// Autopilot and profile.
    pub profile: String,
    /// Highest speed allowed (m/s).
    pub speed_mps: f64,
    /// Set of sensors.
    pub sensor: String,
    /// A planner of somebody else's that proposed ways.
    #[serde(default)]
    pub process: Option<UserPlanner>,
    /// What the ground station does in flight.
    pub station: StationColumn,
    /// Longest mission (s).
    pub limit_s: f64,
    /// What differs from other flights of the cell.
    #[serde(default)]
    pub variation: Option<Variation>,
    /// World.
    pub world: String,
    /// Trees per square metre, of a forest.
    pub density_per_m2: Option<f64>,
    /// Worlds drawn before this one that had no way through.
    pub discarded: u32,
    /// How hard the world is; `None` where nothing has a way at flight height.
    pub difficulty: Option<Difficulty>,
    /// Seed.
    pub seed: u64,
    /// Outcome.
    pub outcome: FlightOutcome,
    /// Contacts with obstacles.
    pub collisions: u32,
    /// Smallest distance between hull and obstacles (m); infinity where there are none, `null` in JSON.
    #[serde(deserialize_with = "infinite_if_null")]
    pub min_clearance_m: f64,
    /// Mean speed of the mission (m/s).
    pub mean_speed_mps: f64,
    /// Top speed (m/s).
    pub top_speed_mps: f64,
    /// Way not flown for being slower than allowed (m), by what limited the speed then.
    #[serde(default)]
    pub lost_m: BTreeMap<String, f64>,
    /// The speed that plans reach (m/s), if that is less than what is allowed.
    pub speed_cut_mps: Option<f64>,
    /// Way flown in the mission (m).
    pub path_m: f64,
    /// Way flown over the straight line (1).
    pub path_ratio: f64,
    /// Way flown over the shortest one in the known map (1), where there is one.
    pub path_over_shortest: Option<f64>,
    /// Mean jerk of what was flown (m/s3).
    pub mean_jerk_mps3: f64,
    /// Contacts with something that stands still while a certificate was held.
    pub collisions_certified: u32,
    /// Commitments that were laid into the true world.
    pub commitments: u32,
    /// Those along which the hull would touch something that stands still.
    pub commitments_touching: u32,
    /// Time of the mission (s).
    pub time_s: f64,
    /// Falls to Hold because of the companion.
    pub hold_count: u32,
    /// Largest gap between setpoints as the autopilot saw it (ms).
    pub setpoint_gap_ms: f64,
    /// Times the guard braked.
    pub guard_brakes: u32,
    /// Times the committed way was found blocked.
    pub commitments_changed: usize,
    /// Times the certificate was lost.
    pub certificates_lost: usize,
    /// Planner cycle with a new map: median, 99th percentile, largest (ms).
    pub plan_ms: [f64; 3],
    /// Curve generation (ms).
    pub curve_ms: [f64; 3],
    /// Map and ring update (ms).
    pub map_ms: [f64; 3],
    /// Simulated time over wall time.
    pub speed_up: f64,
    /// What the user declares of space that no sensor measures, as the map names it.
    pub declarations: Vec<String>,
    /// Why the goal was not reached: the last that was said about it; empty if it was.
    pub reason: String,
    /// Hash over the true positions every 20 ms.
    pub hash: String,
}

fn infinite_if_null<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
}

/// The set of sensors called `name`, or in that file.
///
/// # Errors
/// A text naming file and line.
pub fn sensor_set(name: &str) -> Result<SensorSet, String> {
    suite::sensor_set(name)
}

/// The `[[sensor]]` tables of a set.
///
/// # Errors
/// A text naming file and line.
pub fn sensors_of(set: &SensorSet) -> Result<Vec<SensorSpec>, String> {
    #[derive(Deserialize)]
    struct Sensors {
        #[serde(default)]
        sensor: Vec<SensorSpec>,
        #[serde(rename = "params")]
        _params: Option<IgnoredAny>,
    }
    let sensors: Sensors = parse_toml(&set.file, &set.text).map_err(|error| error.to_string())?;
    if sensors.sensor.is_empty() {
        return Err(format!("{}: there is no [[sensor]] in it", set.file.display()));
    }
    Ok(sensors.sensor)
}

/// The sensors of most flights: a lidar that sees all around.
pub fn default_sensors() -> Vec<SensorSpec> {
    sensor_set(SPHERE)
        .and_then(|set| sensors_of(&set))
        .unwrap_or_default()
}

/// The set of sensors that sees everything.
pub const SPHERE: &str = "sphere";
/// The set of the default configuration.
pub const MID360: &str = "mid360";

/// The set-up of one flight of `cell`.
///
/// # Errors
/// A text naming what cannot be built.
pub fn setup(cell: &Cell, seed: u64) -> Result<FlightSetup, String> {
    let spec = WorldSpec {
        kind: cell.kind.clone(),
        seed,
        density_per_m2: cell.density_per_m2,
    };
    let world = World::from_spec(&spec).map_err(|error| error.to_string())?;
    let config = Config::parse(&cell.sensors.file, &cell.sensors.text).map_err(|error| error.to_string())?;
    let mut params = config.params;
    let set = [
        ("OA_SPD_MAX", Some(cell.speed_mps)),
        ("OA_VEH_RADIUS", cell.radius_m),
    ];
    for (name, value) in set.into_iter().filter_map(|(name, value)| Some((name, value?))) {
        params.set(name, value).map_err(|error| error.to_string())?;
    }
    let plan = FlightPlan {
        takeoff_height_m: world.flight_height_m(),
        waypoints: world.goals().to_vec(),
        tail: Vec::new(),
        in_flight: Vec::new(),
        cruise_speed_mps: None,
        ending: Ending::Land,
        resume: true,
        mission_limit_s: cell.limit_s,
    };
    Ok(FlightSetup {
        world,
        seed,
        params,
        sensors: sensors_of(&cell.sensors)?,
        autopilot: AutopilotConfig::Px4(Px4Config::default()),
        profile: ProfileName::Px4Trajectory,
        representation: Representation::default(),
        takes_missions: true,
        link_faults: None,
        plan,
        proposer: None,
        planner: None,
    })
}

/// Flies one flight.
///
/// # Errors
/// A text naming what cannot be built.
pub fn fly(cell: &Cell, seed: u64) -> Result<FlightReport, String> {
    fly_as(setup(cell, seed)?, cell)
}

/// A flight that was flown.
#[derive(Debug)]
pub struct FlownFlight {
    /// What is said of it.
    pub report: FlightReport,
    /// Where it led.
    pub course: Course,
    /// The world it was flown in.
    pub world: World,
}

/// Flies one flight of `cell` as it is set up.
///
/// # Errors
/// A text naming what cannot be built.
pub fn fly_as(setup: FlightSetup, cell: &Cell) -> Result<FlightReport, String> {
    Ok(fly_drawn(setup, cell)?.report)
}

/// As [`fly_as`], with what a picture of it needs.
///
/// # Errors
/// A text naming what cannot be built.
pub fn fly_drawn(mut setup: FlightSetup, cell: &Cell) -> Result<FlownFlight, String> {
    cell.hindrance.prepare(&mut setup);
    if let Some(variation) = cell.variation {
        variation.prepare(&mut setup)?;
    }
    let seed = setup.seed;
    let profile = setup.profile;
    let world = setup.world.clone();
    let mut hindrance = cell.hindrance.in_flight(&world, seed, setup.sensors.len());
    let straight_m = setup
        .plan
        .waypoints
        .last()
        .map_or(1.0, |goal| (goal.x_m.powi(2) + goal.y_m.powi(2)).sqrt());
    // In its own mission mode an autopilot that only follows setpoints flies as fast as it likes.
    let flown: &[NavMode] = match profile.flies_the_mission() {
        true => &[NavMode::Offboard],
        false => &[NavMode::Mission],
    };
    let mut flight = LockStep::new(setup)?;
    if let Some(delay) = cell.variation.and_then(Variation::frame_delay) {
        flight.frame_delay = delay;
    }
    let begin = Instant::now();
    let mut watched = Watched::new();
    while flight.outcome().is_none() && !watched.is_over(cell) {
        hindrance.step(&mut flight);
        flight.step();
        watched.look(&flight, &world, flown, cell.speed_mps);
    }
    let truth = flight.truth();
    let outcome = watched.outcome(&flight, cell);
    let declarations = declared_as::NAMES
        .iter()
        .filter(|(bit, _)| flight.map().declarations & bit != 0)
        .map(|(_, name)| (*name).to_owned())
        .collect();
    let reason = if outcome == FlightOutcome::Goal {
        String::new()
    } else {
        reason(&flight)
    };
    let difficulty = cell.suite.and_then(|_| Difficulty::of(&world));
    let (suite, name) = cell.suite.unwrap_or(("", cell.kind.name()));
    let report = FlightReport {
        suite: suite.to_owned(),
        cell: name.to_owned(),
        profile: profile.name().to_owned(),
        speed_mps: cell.speed_mps,
        sensor: cell.sensors.name.clone(),
        process: None,
        station: StationColumn::default(),
        limit_s: cell.limit_s,
        variation: cell.variation,
        density_per_m2: cell.density_per_m2.or(cell.kind.density_per_m2()),
        discarded: world.discarded_maps(),
        declarations,
        reason,
        world: world.name().to_owned(),
        seed,
        outcome,
        collisions: truth.collisions,
        collisions_certified: watched.certified,
        min_clearance_m: truth.min_clearance_m,
        mean_speed_mps: truth.cruise_m / truth.cruise_s.max(1e-9),
        top_speed_mps: watched.top_speed_mps,
        lost_m: watched
            .lost_m
            .into_iter()
            .map(|(cause, m)| (cause.to_owned(), m))
            .collect(),
        speed_cut_mps: speed_cut_mps(&flight),
        path_m: truth.cruise_m,
        path_ratio: truth.cruise_m / straight_m,
        path_over_shortest: difficulty.map(|difficulty| truth.cruise_m / difficulty.way_m),
        difficulty,
        mean_jerk_mps3: watched.judge.mean_jerk_mps3(),
        commitments: watched.judge.commitments,
        commitments_touching: watched.judge.touching,
        time_s: truth.cruise_s,
        hold_count: truth.hold_count,
        setpoint_gap_ms: truth.setpoint_gap_max_s * 1e3,
        guard_brakes: flight.brakes,
        commitments_changed: flight.count(&events::COMMITMENT_CHANGED),
        certificates_lost: flight.count(&events::CERTIFICATE_LOST),
        plan_ms: percentiles(&flight.costs.plan_ms),
        curve_ms: percentiles(&flight.costs.curve_ms),
        map_ms: percentiles(&flight.costs.map_ms),
        speed_up: truth.time_s / begin.elapsed().as_secs_f64(),
        hash: watched.hash.text(),
    };
    Ok(FlownFlight {
        report,
        course: watched.course,
        world,
    })
}

/// Contacts this soon after a certificate was lost do not count as certified (s), nor do those while the guard brakes.
const UNCERTIFIED_FOR_S: f64 = 5.0;
/// A vehicle at rest for this long does not go on (s).
const STANDS_S: f64 = 10.0;
/// A step (s).
const STEP_S: f64 = 0.004;
/// In a suite nobody waits for it longer than this (s).
const AWAITED_S: f64 = 60.0;

/// What is watched of a flight, step by step.
struct Watched {
    hash: Hash,
    judge: Judge,
    course: Course,
    top_speed_mps: f64,
    lost_m: BTreeMap<&'static str, f64>,
    still_s: f64,
    steps: u64,
    is_refused: bool,
    contacts: u32,
    /// Contacts with what stands still.
    still_contacts: u32,
    certified: u32,
}

impl Watched {
    fn new() -> Self {
        Self {
            hash: Hash::new(),
            judge: Judge::new(),
            course: Course::default(),
            top_speed_mps: 0.0,
            lost_m: BTreeMap::new(),
            still_s: 0.0,
            steps: 0,
            is_refused: false,
            contacts: 0,
            still_contacts: 0,
            certified: 0,
        }
    }

    fn look(&mut self, flight: &LockStep, world: &World, flown: &[NavMode], allowed_mps: f64) {
        self.is_refused = flight.count(&events::SENSORS_UNFIT) > 0 && flight.truth().cruise_s == 0.0;
        self.steps += 1;
        self.judge.look(flight, world);
        self.course.look(flight);
        let truth = flight.truth();
        let speed_mps = truth.velocity.vector().norm();
        if self.steps.is_multiple_of(5) {
            let p = truth.position;
            [p.x_m, p.y_m, p.z_m]
                .iter()
                .for_each(|x| self.hash.add(x.to_bits()));
        }
        if flown.contains(&truth.mode.get()) {
            self.top_speed_mps = self.top_speed_mps.max(speed_mps);
            let limit = SpeedLimit::of(flight.route(), flight.approved(), flight.now());
            let cause = limit.map_or("no trajectory", |limit| limit.cause.words());
            *self.lost_m.entry(cause).or_default() += (allowed_mps - speed_mps).max(0.0) * STEP_S;
        }
        // In the air or landed where it was not to.
        self.still_s = if truth.cruise_s > 0.0 && speed_mps < 0.1 {
            self.still_s + STEP_S
        } else {
            0.0
        };
        let new = truth.collisions - self.contacts;
        if new == 0 {
            return;
        }
        self.contacts = truth.collisions;
        if world.clearance_to_obstacles_m(truth.position) > truth.hull_radius_m {
            return; // What it touched moves.
        }
        self.still_contacts += new;
        let since_s = truth.time_s - UNCERTIFIED_FOR_S;
        let is_lost = flight
            .events
            .iter()
            .any(|(time_s, event)| *time_s > since_s && event.id == events::CERTIFICATE_LOST.id);
        let is_braked = flight.approved().verdict == Verdict::Braked;
        if !is_lost && !is_braked && !flight.dead_companion {
            self.certified += new;
        }
    }

    /// Nothing more can happen: it was refused, or stands where it was to come to rest, or has stood for long.
    fn is_over(&self, cell: &Cell) -> bool {
        let longest_s = match cell.suite {
            Some(_) if cell.hindrance.ends_half_way() => STANDS_S,
            Some(_) => AWAITED_S,
            None => f64::INFINITY,
        };
        self.is_refused || self.still_s > longest_s
    }

    fn outcome(&self, flight: &LockStep, cell: &Cell) -> FlightOutcome {
        let reached = flight.outcome() == Some(&Outcome::Done);
        // The vehicle overshoots a reference a little; a tenth is what PX4 itself does.
        match (self.contacts, reached) {
            (1.., _) if self.still_contacts == 0 => FlightOutcome::CollisionDynamic,
            (1.., _) => FlightOutcome::CollisionStatic,
            _ if self.is_refused => FlightOutcome::Refused,
            (0, _) if self.top_speed_mps > cell.speed_mps * 1.1 => FlightOutcome::LimitViolation,
            (0, true) => FlightOutcome::Goal,
            (0, false) if cell.hindrance.ends_half_way() && self.still_s > STANDS_S => FlightOutcome::Stopped,
            (0, false) if self.still_s > STANDS_S => FlightOutcome::Stuck,
            (0, false) => FlightOutcome::Timeout,
        }
    }
}

/// The speed that plans reach (m/s), as it was reported.
fn speed_cut_mps(flight: &LockStep) -> Option<f64> {
    let mut events = flight.events.iter().rev().map(|(_, event)| event);
    let cut = events.find(|event| event.id == events::SPEED_CUT.id)?;
    Some(cut.numbers[0])
}

/// The last thing that was said in a flight about why it does not go on.
fn reason(flight: &LockStep) -> String {
    let reported = flight.events.iter().rev().map(|(_, event)| event);
    let mut causes = reported.filter(|event| CAUSES.iter().any(|cause| cause.id == event.id));
    causes
        .next()
        .map_or_else(|| "nothing was said".to_owned(), EventSample::text)
}

/// What is said of a flight that does not go on.
const CAUSES: [&events::Event; 8] = [
    &events::SENSORS_UNFIT,
    &events::GOAL_BLOCKED,
    &events::WAY_SEARCHED,
    &events::NO_PATH,
    &events::ITEM_BLOCKED,
    &events::RANGES_LOST,
    &events::CERTIFICATE_LOST,
    &events::PROCESS_FAILED,
];

/// Median, 99th percentile and maximum; zeros without values.
pub fn percentiles(values: &[f64]) -> [f64; 3] {
    quantiles(values, [0.5, 0.99, 1.0]).unwrap_or_default()
}

/// FNV-1a over numbers.
struct Hash(u64);

impl Hash {
    fn new() -> Self {
        Self(jink_shared_types::hash::START)
    }

    fn add(&mut self, number: u64) {
        self.0 = jink_shared_types::hash::number(self.0, number);
    }

    fn text(&self) -> String {
        format!("{:016x}", self.0)
    }
}
