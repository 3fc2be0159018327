//! The set-up of a flight, and its configuration file.

use crate::lossy::LinkFaults;
use crate::proposer::Plan;
use jink_emulated_ground_station::FlightPlan;
use jink_mavlink_link::profile_name::{ProfileName, Representation};
use jink_shared_types::params::ParamSet;
use jink_simulated_world::sensors::SensorSpec;
use jink_simulated_world::world::World;
use jink_simulator::autopilot::AutopilotConfig;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;

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
    /// A planner of somebody else's, in a program of its own.
    pub planner: Option<UserPlanner>,
}

/// A program that proposes ways.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct UserPlanner {
    /// What its process is called behind `user_`.
    pub name: String,
    /// Its file.
    pub program: PathBuf,
}

impl std::str::FromStr for UserPlanner {
    type Err = String;

    /// `NAME=PROGRAM`.
    fn from_str(text: &str) -> Result<Self, String> {
        let (name, program) = text.split_once('=').ok_or("expected NAME=PROGRAM")?;
        let is_name = |letter: char| letter.is_ascii_lowercase() || letter.is_ascii_digit() || letter == '_';
        if name.is_empty() || !name.chars().all(is_name) {
            return Err(format!("{name:?} is no name: lower-case letters, digits and _"));
        }
        let program = std::fs::canonicalize(program).map_err(|error| format!("{program}: {error}"))?;
        Ok(Self {
            name: name.to_owned(),
            program,
        })
    }
}

impl UserPlanner {
    /// Its process.
    pub fn process(&self) -> String {
        format!("user_{}", self.name)
    }

    /// Its row of the process table.
    pub(super) fn row(&self) -> String {
        format!(
            "\n[[process]]\nname = {:?}\nprogram = {:?}\nreads = {READS:?}\npublishes = [\"plan/proposal\"]\n\
             essential = false\non_failure = \"ignore\"\n",
            self.process(),
            self.program
        )
    }
}

/// What a planner of somebody else's may read besides what is open to every process.
const READS: [&str; 6] = [
    "map/local",
    "map/far",
    "map/moving",
    "vehicle/desired_path",
    "plan/proposal_answer",
    "guard/approved",
];

/// `jink.toml` for a set-up.
pub(super) fn configuration(setup: &FlightSetup) -> Result<String, String> {
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
