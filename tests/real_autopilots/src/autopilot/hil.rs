//! PX4 with our quadrotor behind its simulator interface. Truth is the simulator's own state.

use super::{Running, Source, Start, clearance};
use jink_shared_types::geo::Projection;
use jink_simulated_world::vehicle::wind::WindConfig;
use jink_simulator::sitl::{Interface, Sitl, SitlBuild, SitlOptions};
use nalgebra::Vector2;
use std::net::SocketAddr;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Every so many states of the simulator one is written down: 50 in a second.
const EVERY: usize = 5;

/// A simulation that may be started anew.
pub(super) type Simulation = Arc<Mutex<Option<Sitl>>>;

/// Program and folder.
pub(super) fn find(folder: &Path) -> Option<(std::path::PathBuf, std::path::PathBuf)> {
    let build = SitlBuild::find(folder).ok()?;
    build
        .interfaces
        .contains(&Interface::Px4Hil)
        .then(|| (build.program.clone(), folder.to_owned()))
}

pub(super) fn start(start: &Start<'_>) -> Result<Running, String> {
    let ports = start.ports;
    let build = SitlBuild::find(&start.build.folder).map_err(|error| error.to_string())?;
    let here = |port: u16| SocketAddr::from(([127, 0, 0, 1], port));
    let mut options = SitlOptions::new(
        build,
        here(ports.companion(start.build.autopilot)),
        start.folder.clone(),
    );
    options.interface = Some(Interface::Px4Hil);
    options.instance = u8::try_from(ports.instance).ok();
    options.ground_station = Some(here(ports.station()));
    options.parameters = start
        .parameters()
        .map(|(name, value)| (name.to_owned(), value))
        .collect();
    let [north_mps, east_mps] = start.wind_mps;
    options.wind = WindConfig {
        mean_mps: [north_mps, east_mps, 0.0],
        ..WindConfig::default()
    };
    let again = options.clone();
    let sitl = Sitl::start(options).map_err(|error| error.to_string())?;
    let simulation: Simulation = Arc::new(Mutex::new(Some(sitl)));
    let reader = read_truth(start, Arc::clone(&simulation));
    Ok(Running {
        source: Source::Simulation {
            simulation,
            again: Box::new(move || Sitl::start(again.clone()).map_err(|error| error.to_string())),
        },
        _truth: reader,
    })
}

fn read_truth(start: &Start<'_>, simulation: Simulation) -> crate::wire::Reader {
    let (record, clearance) = (start.record.clone(), clearance(&start.world));
    // Any origin does: only differences are looked at.
    let origin = Projection::new(jink_shared_types::geo::GlobalPoint {
        latitude_deg: 47.0,
        longitude_deg: 8.0,
    });
    let mut count = 0;
    crate::wire::Reader::repeat(move || {
        let samples = {
            let mut simulation = simulation.lock().unwrap_or_else(PoisonError::into_inner);
            simulation
                .as_mut()
                .map(|sitl| sitl.wait(Duration::from_millis(20)))
        };
        for sample in samples.into_iter().flatten() {
            count += 1;
            if count % EVERY == 0 {
                let place = sample.truth.position;
                let global = origin.to_global(Vector2::new(place.x_m, place.y_m));
                record
                    .lock()
                    .see_truth(global, -place.z_m, sample.truth.velocity.vector(), &clearance);
            }
        }
        // Whoever starts it anew gets its turn.
        std::thread::sleep(Duration::from_millis(2));
    })
}
