//! Flights by the hundred: one line per flight, one table at the end.

use crate::lockstep::{FlightSetup, LockStep};
use jink_emulated_ground_station::{Ending, FlightPlan, Outcome};
use jink_emulated_px4::Px4Config;
use jink_mavlink_link::profile_name::{ProfileName, Representation};
use jink_runtime::config::sensor_sets::{self, SensorSet};
use jink_runtime::config::{Config, parse_toml};
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::map::declared_as;
use jink_shared_types::quantile::quantiles;
use jink_shared_types::vehicle::NavMode;
use jink_simulated_world::sensors::SensorSpec;
use jink_simulated_world::world::{World, WorldKind, WorldSpec};
use jink_simulator::autopilot::AutopilotConfig;
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// What to fly.
#[derive(Clone, Debug)]
pub struct Cell {
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
            kind,
            density_per_m2: None,
            speed_mps: 3.0,
            limit_s: 120.0,
            sensors: sensor_set(SPHERE)?,
        })
    }
}

/// How a flight ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FlightOutcome {
    /// The last waypoint was reached without a contact, and the vehicle landed.
    Goal,
    /// It touched an obstacle.
    CollisionStatic,
    /// It flew faster than the limit allows.
    LimitViolation,
    /// It stood still until the time was over.
    Stuck,
    /// The time was over.
    Timeout,
    /// It was said before the take-off that no motion can be certified with these sensors.
    Refused,
}

/// One flight.
#[derive(Clone, Debug, Serialize)]
pub struct FlightReport {
    /// Set of sensors.
    pub sensor: String,
    /// World.
    pub world: String,
    /// Seed.
    pub seed: u64,
    /// Outcome.
    pub outcome: FlightOutcome,
    /// Contacts with obstacles.
    pub collisions: u32,
    /// Smallest distance between hull and obstacles (m).
    pub min_clearance_m: f64,
    /// Mean speed of the mission (m/s).
    pub mean_speed_mps: f64,
    /// Top speed (m/s).
    pub top_speed_mps: f64,
    /// The speed that plans reach (m/s), if that is less than what is allowed.
    pub speed_cut_mps: Option<f64>,
    /// Way flown in the mission (m).
    pub path_m: f64,
    /// Way flown over the straight line (1).
    pub path_ratio: f64,
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

/// The set of sensors called `name`, or in that file.
///
/// # Errors
/// A text naming file and line.
pub fn sensor_set(name: &str) -> Result<SensorSet, String> {
    sensor_sets::named(name).map_err(|error| error.to_string())
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
    params
        .set("OA_SPD_MAX", cell.speed_mps)
        .map_err(|error| error.to_string())?;
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
    })
}

/// Flies one flight.
///
/// # Errors
/// A text naming what cannot be built.
pub fn fly(cell: &Cell, seed: u64) -> Result<FlightReport, String> {
    fly_as(setup(cell, seed)?, cell)
}

/// Flies one flight of `cell` as it is set up.
///
/// # Errors
/// A text naming what cannot be built.
pub fn fly_as(setup: FlightSetup, cell: &Cell) -> Result<FlightReport, String> {
    let allowed_mps = cell.speed_mps;
    let seed = setup.seed;
    let world = setup.world.name().to_owned();
    let straight_m = setup
        .plan
        .waypoints
        .last()
        .map_or(1.0, |goal| (goal.x_m.powi(2) + goal.y_m.powi(2)).sqrt());
    // In its own mission mode an autopilot that only follows setpoints flies as fast as it likes.
    let flown: &[NavMode] = match setup.profile.flies_the_mission() {
        true => &[NavMode::Offboard],
        false => &[NavMode::Mission],
    };
    let mut flight = LockStep::new(setup)?;
    let begin = Instant::now();
    let (mut hash, mut top_speed_mps, mut still_s, mut steps) = (Hash::new(), 0.0f64, 0.0, 0u64);
    let mut is_refused = false;
    while flight.outcome().is_none() && !is_refused {
        flight.step();
        is_refused = flight.count(&events::SENSORS_UNFIT) > 0 && flight.truth().cruise_s == 0.0;
        steps += 1;
        let truth = flight.truth();
        let speed_mps = truth.velocity.vector().norm();
        if steps.is_multiple_of(5) {
            let p = truth.position;
            [p.x_m, p.y_m, p.z_m].iter().for_each(|x| hash.add(x.to_bits()));
        }
        if flown.contains(&truth.mode.get()) {
            top_speed_mps = top_speed_mps.max(speed_mps);
            still_s = if speed_mps < 0.1 { still_s + 0.004 } else { 0.0 };
        }
    }
    let truth = flight.truth();
    let reached = flight.outcome() == Some(&Outcome::Done);
    // The vehicle overshoots a reference a little; a tenth is what PX4 itself does.
    let outcome = match (truth.collisions, reached) {
        (1.., _) => FlightOutcome::CollisionStatic,
        _ if is_refused => FlightOutcome::Refused,
        (0, _) if top_speed_mps > allowed_mps * 1.1 => FlightOutcome::LimitViolation,
        (0, true) => FlightOutcome::Goal,
        (0, false) if still_s > 10.0 => FlightOutcome::Stuck,
        (0, false) => FlightOutcome::Timeout,
    };
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
    Ok(FlightReport {
        sensor: cell.sensors.name.clone(),
        declarations,
        reason,
        world,
        seed,
        outcome,
        collisions: truth.collisions,
        min_clearance_m: truth.min_clearance_m,
        mean_speed_mps: truth.cruise_m / truth.cruise_s.max(1e-9),
        top_speed_mps,
        speed_cut_mps: speed_cut_mps(&flight),
        path_m: truth.cruise_m,
        path_ratio: truth.cruise_m / straight_m,
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
        hash: hash.text(),
    })
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
const CAUSES: [&events::Event; 7] = [
    &events::SENSORS_UNFIT,
    &events::GOAL_BLOCKED,
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
