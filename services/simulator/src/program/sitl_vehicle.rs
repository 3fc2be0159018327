//! Somebody's real autopilot in simulation as a process: its truth, seen by our judge.

use crate::service::settings;
use crate::sitl::{Interface, Sitl, SitlBuild, SitlOptions, SitlSample};
use jink_emulated_autopilot::truth::{Observed, Observer};
use jink_runtime::config::Config;
use jink_runtime::{Cycle, Output, Ports, Service, StartError, Wake};
use jink_shared_types::truth::SimTruth;
use jink_shared_types::{SampleHeader, params, topics};
use jink_simulated_world::world::World;
use std::net::{Ipv4Addr, SocketAddr};
use std::os::fd::BorrowedFd;
use std::path::{Path, PathBuf};

/// The log of the autopilot, among those of the processes.
const LOG: &str = "autopilot.log";
/// Its predecessor's: it says why a simulator had to be started again.
const PREVIOUS_LOG: &str = "autopilot.previous.log";

/// The real autopilot and the world around it.
pub struct SitlVehicle {
    world: World,
    observer: Observer,
    sitl: Option<Sitl>,
    truth: Output<SimTruth>,
    late_max_s: f64,
    /// The working folder, if nobody else wants it afterwards.
    folder: Option<PathBuf>,
}

impl Service for SitlVehicle {
    const PROGRAM: &'static str = "simulator";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        let config = ports.config().clone();
        let instance = &ports.setup().instance;
        let (folder, is_ours) = match config.simulation.sitl_folder.as_str() {
            "" => (std::env::temp_dir().join(format!("jink_{instance}_sitl")), true),
            folder => (PathBuf::from(folder), false),
        };
        let logs = instance.log_folder();
        let log = match logs.is_dir() {
            true => logs.join(LOG),
            false => folder.join(LOG),
        };
        let _none_before = std::fs::rename(&log, log.with_file_name(PREVIOUS_LOG));
        let sitl = Sitl::start(options(&config, &folder, &log)?).map_err(|error| StartError::Needs {
            what: "the autopilot in simulation".to_owned(),
            cause: error.to_string(),
        })?;
        tracing::info!(
            "autopilot started, interface {}, instance {}, log {}",
            sitl.interface().name(),
            sitl.ports().instance,
            log.display()
        );
        Ok(Self {
            world: settings::world(&config)?,
            observer: Observer::new(config.params.get(&params::OA_VEH_RADIUS)),
            sitl: Some(sitl),
            truth: ports.output(topics::SIM_TRUTH)?,
            late_max_s: 0.0,
            folder: is_ours.then_some(folder),
        })
    }

    fn cycle(&mut self, _cycle: &mut Cycle<'_>) -> Wake {
        let Some(sitl) = &mut self.sitl else {
            return Wake::restart();
        };
        for sample in sitl.take() {
            self.publish(&sample);
        }
        let ended = self.sitl.as_ref().and_then(Sitl::ended);
        if let Some(reason) = ended {
            tracing::error!("{reason}");
            // What it has written may say why it ended.
            self.folder = None;
            return Wake::restart();
        }
        Wake::on_data()
    }

    fn watched(&self) -> [Option<BorrowedFd<'_>>; jink_runtime::service::WATCHED_FDS] {
        let mut fds = [None; jink_runtime::service::WATCHED_FDS];
        fds[0] = self.sitl.as_ref().map(Sitl::fd);
        fds
    }
}

impl SitlVehicle {
    fn publish(&mut self, sample: &SitlSample) {
        let autopilot = &sample.autopilot;
        self.late_max_s = match autopilot.armed {
            true => self.late_max_s.max(sample.late_s),
            false => 0.0,
        };
        let seen = Observed {
            time_s: sample.time_s,
            truth: &sample.truth,
            mode: autopilot.mode,
            armed: autopilot.armed,
            landed: sample.truth.on_ground,
            mission: autopilot.mission,
            setpoints: &autopilot.setpoints,
            hold_count: autopilot.hold_count,
        };
        let truth = SimTruth {
            late_max_s: self.late_max_s,
            ..self.observer.judge(&seen, &self.world)
        };
        let header = SampleHeader {
            capture: sample.time,
            ..SampleHeader::default()
        };
        self.truth.send(header, &truth);
    }
}

impl Drop for SitlVehicle {
    fn drop(&mut self) {
        if let Some(sitl) = self.sitl.take() {
            sitl.stop();
        }
        if let Some(folder) = &self.folder {
            // Somebody may look into it.
            let _remains = std::fs::remove_dir_all(folder);
        }
    }
}

/// What the configuration asks for.
fn options(config: &Config, folder: &Path, log: &Path) -> Result<SitlOptions, StartError> {
    let simulation = &config.simulation;
    let build =
        SitlBuild::find(Path::new(&simulation.sitl)).map_err(|error| needs("simulation.sitl", error))?;
    let mut options = SitlOptions::new(
        build,
        settings::companion_address(&config.link.address)?,
        folder.to_owned(),
    );
    options.log = Some(log.to_owned());
    options.interface = match simulation.sitl_interface.as_str() {
        "auto" => None,
        name => Some(Interface::named(name).ok_or_else(|| {
            let names: Vec<_> = Interface::NAMES.iter().map(|(known, _)| *known).collect();
            needs(
                "simulation.sitl_interface",
                format!("{name:?}: there are auto {}", names.join(" ")),
            )
        })?),
    };
    options.instance = match simulation.sitl_instance {
        -1 => None,
        number => Some(
            u8::try_from(number)
                .map_err(|error| needs("simulation.sitl_instance", format!("{number}: {error}")))?,
        ),
    };
    options.ground_station = match simulation.ground_station_port {
        0 => None,
        port => Some(SocketAddr::from((Ipv4Addr::LOCALHOST, port))),
    };
    options.parameters = options.build.parameters_for(&config.link.profile);
    for assignment in simulation
        .sitl_parameters
        .split(',')
        .filter(|text| !text.is_empty())
    {
        let parameter = assignment
            .split_once('=')
            .and_then(|(name, value)| Some((name.trim().to_owned(), value.trim().parse().ok()?)));
        options.parameters.push(parameter.ok_or_else(|| {
            needs(
                "simulation.sitl_parameters",
                format!("{assignment:?}: expected NAME=NUMBER,NAME=NUMBER"),
            )
        })?);
    }
    options.wind = settings::wind(simulation);
    options.seed = simulation.seed;
    Ok(options)
}

fn needs(what: &str, cause: impl ToString) -> StartError {
    StartError::Needs {
        what: what.to_owned(),
        cause: cause.to_string(),
    }
}
