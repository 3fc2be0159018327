//! The set-up of a flight, and its configuration file.

use crate::lossy::LinkFaults;
use crate::proposer::Plan;
use jink_emulated_ground_station::FlightPlan;
use jink_mavlink_link::profile_name::{ProfileName, Representation};
use jink_shared_types::params::ParamSet;
use jink_simulated_world::sensors::SensorSpec;
use jink_simulated_world::world::World;
use jink_simulator::autopilot::AutopilotConfig;
use serde::Serialize;
use std::collections::BTreeMap;

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
