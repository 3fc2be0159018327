//! What all roles read from the configuration.

use jink_runtime::config::{Config, Simulation};
use jink_runtime::{Ports, StartError};
use jink_simulated_world::sensors::SensorSpec;
use jink_simulated_world::vehicle::wind::WindConfig;
use jink_simulated_world::world::{World, WorldError, WorldKind, WorldSpec};
use std::net::SocketAddr;

/// The world the configuration names.
///
/// # Errors
/// It names none.
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
///
/// # Errors
/// There is none.
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
///
/// # Errors
/// What is wrong, with file and line.
pub fn sensors(ports: &Ports) -> Result<Vec<SensorSpec>, StartError> {
    let mut specs: Vec<SensorSpec> = jink_runtime::config::sensors_of_ours(&ports.setup().config)?;
    specs.retain(|spec| spec.kind.is_rendered());
    Ok(specs)
}

/// The wind the configuration asks for.
pub fn wind(simulation: &Simulation) -> WindConfig {
    WindConfig {
        mean_mps: [simulation.wind_north_mps, simulation.wind_east_mps, 0.0],
        gust_sigma_mps: simulation.wind_gust_mps,
        ..WindConfig::default()
    }
}

/// Where the gateway waits for its autopilot.
///
/// # Errors
/// The link is no listening UDP socket.
pub fn companion_address(link: &str) -> Result<SocketAddr, StartError> {
    link.strip_prefix("udpin:")
        .and_then(|address| address.parse().ok())
        .ok_or_else(|| StartError::Needs {
            what: format!("link.address = {link:?}"),
            cause: "a simulated autopilot speaks to udpin:ADDRESS:PORT only".to_owned(),
        })
}
