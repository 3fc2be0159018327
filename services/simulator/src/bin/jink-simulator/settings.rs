//! What both roles read from the configuration.

use jink_runtime::config::Config;
use jink_runtime::{Ports, StartError};
use jink_simulator::sensors::SensorSpec;
use jink_simulator::world::{World, WorldError, WorldKind, WorldSpec};

/// The world the configuration names.
pub fn world(config: &Config) -> Result<World, StartError> {
    build(
        &config.simulation.world,
        config.simulation.seed,
        config.simulation.density_per_m2,
    )
    .map_err(|error| StartError::Needs {
        what: "the world".to_owned(),
        cause: error.to_string(),
    })
}

/// The world called `name`.
pub fn build(name: &str, seed: u64, density_per_m2: Option<f64>) -> Result<World, WorldError> {
    let kind: WorldKind = name.parse()?;
    World::from_spec(&WorldSpec {
        kind,
        seed,
        density_per_m2,
    })
}

/// The sensors to render, with the keys that only the simulator knows. Everything else in the file has been checked by
/// [`Config`] already.
pub fn sensors(ports: &Ports) -> Result<Vec<SensorSpec>, StartError> {
    let mut specs: Vec<SensorSpec> = jink_runtime::config::sensors(&ports.setup().config)?;
    specs.retain(|spec| spec.kind.is_rendered());
    Ok(specs)
}
