//! A running autopilot with its simulator: ports, threads, how it is started and ended.

use super::build::Interface;
use super::error::StartError;
use super::launch::{HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG, launch};
use super::options::SitlOptions;
use super::ports::{PortError, SitlPorts};
use super::process::{AutopilotProcess, LOG_FILE};
use super::relay::{self, RelayLink};
use super::stage::{Shared, SitlSample, Stage, guard};
use super::watch::AutopilotWatch;
use super::{hil, json, sih};
use jink_shared_types::geo::GlobalPoint;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::collections::VecDeque;
use std::io::Read;
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, mpsc};
use std::thread::JoinHandle;
use std::time::Duration;

/// A running autopilot; it ends with this.
pub struct Sitl {
    shared: Arc<Shared>,
    wake: UnixStream,
    ports: SitlPorts,
    interface: Interface,
    log: PathBuf,
    threads: Vec<JoinHandle<()>>,
}

impl Sitl {
    /// Starts the autopilot and its simulator.
    ///
    /// # Errors
    /// What cannot be had; nothing runs then.
    pub fn start(options: SitlOptions) -> Result<Self, StartError> {
        let interface = options.interface()?;
        let (ports, links, simulation) = reserve(&options, interface)?;
        let folder = std::path::absolute(&options.folder).map_err(|cause| StartError::Io {
            what: options.folder.display().to_string(),
            cause: cause.to_string(),
        })?;
        let origin = GlobalPoint {
            latitude_deg: HOME_LATITUDE_DEG,
            longitude_deg: HOME_LONGITUDE_DEG,
        };
        let (wake, wakes) = pair()?;
        let shared = Arc::new(Shared {
            samples: Mutex::default(),
            ended: Mutex::default(),
            stop: AtomicBool::new(false),
            now_us: AtomicU64::new(0),
            watch: Arc::new(Mutex::new(AutopilotWatch::new(options.build.make, origin))),
        });
        let mut sitl = Self {
            shared: Arc::clone(&shared),
            wake,
            interface,
            log: options.log.clone().unwrap_or_else(|| folder.join(LOG_FILE)),
            ports: ports.clone(),
            threads: Vec::new(),
        };
        let (started, start) = mpsc::channel();
        let log = sitl.log.clone();
        // The kernel ends the autopilot with the thread that started it, so that is the one which simulates.
        sitl.spawn("sitl", move || {
            simulate(
                &options,
                simulation,
                &ports,
                [&folder, &log],
                shared,
                wakes,
                &started,
            );
        })?;
        let shared = Arc::clone(&sitl.shared);
        sitl.spawn("sitl relay", move || {
            relay::run(links, &shared.watch, &shared.now_us, &shared.stop);
        })?;
        match start.recv() {
            Ok(result) => result.map(|()| sitl),
            Err(_) => Err(StartError::Io {
                what: "the simulation".to_owned(),
                cause: "its thread ended".to_owned(),
            }),
        }
    }

    fn spawn(&mut self, name: &str, work: impl FnOnce() + Send + 'static) -> Result<(), StartError> {
        let thread = std::thread::Builder::new()
            .name(name.to_owned())
            .spawn(work)
            .map_err(|cause| StartError::Io {
                what: "a thread".to_owned(),
                cause: cause.to_string(),
            })?;
        self.threads.push(thread);
        Ok(())
    }

    /// How it is simulated.
    pub fn interface(&self) -> Interface {
        self.interface
    }

    /// Its ports.
    pub fn ports(&self) -> &SitlPorts {
        &self.ports
    }

    /// The autopilot's log.
    pub fn log(&self) -> &Path {
        &self.log
    }

    /// Readable when there are samples.
    pub fn fd(&self) -> BorrowedFd<'_> {
        self.wake.as_fd()
    }

    /// The samples since the last call, oldest first.
    pub fn take(&mut self) -> VecDeque<SitlSample> {
        let mut drained = [0; 256];
        while matches!(self.wake.read(&mut drained), Ok(1..)) {}
        std::mem::take(&mut *guard(&self.shared.samples))
    }

    /// The samples since the last call; waits for one for at most `patience`.
    pub fn wait(&mut self, patience: Duration) -> VecDeque<SitlSample> {
        let timeout = Timespec {
            tv_sec: i64::try_from(patience.as_secs()).unwrap_or(i64::MAX),
            tv_nsec: i64::from(patience.subsec_nanos()),
        };
        let mut fds = [PollFd::from_borrowed_fd(self.fd(), PollFlags::IN)];
        let _interrupted = poll(&mut fds, Some(&timeout));
        self.take()
    }

    /// Why the simulation is over, if it is: the autopilot died, or never came.
    pub fn ended(&self) -> Option<String> {
        guard(&self.shared.ended).clone()
    }

    /// Ends the autopilot and waits for it.
    pub fn stop(mut self) {
        self.end();
    }

    fn end(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            // One that panicked is over as well.
            let _panicked = thread.join();
        }
    }
}

impl Drop for Sitl {
    fn drop(&mut self) {
        self.end();
    }
}

fn pair() -> Result<(UnixStream, UnixStream), StartError> {
    let io = |cause: std::io::Error| StartError::Io {
        what: "a socket pair".to_owned(),
        cause: cause.to_string(),
    };
    let (reader, writer) = UnixStream::pair().map_err(io)?;
    reader.set_nonblocking(true).map_err(io)?;
    writer.set_nonblocking(true).map_err(io)?;
    Ok((reader, writer))
}

/// So often another instance is tried that somebody else took between the look and the binding.
const TRIES: u32 = 10;

/// Ports with everything of ours bound to them.
fn reserve(
    options: &SitlOptions,
    interface: Interface,
) -> Result<(SitlPorts, Vec<RelayLink>, Simulation), StartError> {
    let bind = || {
        let ports = SitlPorts::choose(interface, options.instance)?;
        let mut links = vec![RelayLink::open(ports.companion, options.companion)?];
        if let Some(station) = options.ground_station {
            links.push(RelayLink::open(ports.ground_station, station)?);
        }
        let simulation = Simulation::open(interface, ports.simulator, options)?;
        Ok((ports, links, simulation))
    };
    let mut bound = bind();
    for _ in 1..TRIES {
        match bound {
            Err(StartError::Port(PortError::Io { .. }) | StartError::Io { .. })
                if options.instance.is_none() =>
            {
                bound = bind();
            }
            settled => return settled,
        }
    }
    bound
}

/// The thread of the simulation.
fn simulate(
    options: &SitlOptions,
    mut simulation: Simulation,
    ports: &SitlPorts,
    [folder, log]: [&Path; 2],
    shared: Arc<Shared>,
    wakes: UnixStream,
    started: &mpsc::Sender<Result<(), StartError>>,
) {
    let with_station = options.ground_station.is_some();
    let launch = launch(
        &options.build,
        simulation.interface(),
        ports,
        folder,
        with_station,
        &options.parameters,
    );
    let process = match AutopilotProcess::start(&launch, folder, log) {
        Ok(process) => process,
        Err(error) => {
            let _nobody_waits = started.send(Err(error));
            return;
        }
    };
    let _nobody_waits = started.send(Ok(()));
    let mut stage = Stage::new(shared, wakes, process);
    let result = match &mut simulation {
        Simulation::Hil(hil) => hil.run(&mut stage),
        Simulation::Sih(sih) => sih.run(&mut stage),
        Simulation::Json(json) => json.run(&mut stage),
    };
    stage.end(result);
}

enum Simulation {
    Hil(Box<hil::Hil>),
    Sih(Box<sih::Sih>),
    Json(Box<json::Json>),
}

impl Simulation {
    fn open(interface: Interface, port: u16, options: &SitlOptions) -> Result<Self, StartError> {
        Ok(match interface {
            Interface::Px4Hil => Self::Hil(Box::new(hil::Hil::open(port, options)?)),
            Interface::Px4Sih => Self::Sih(Box::new(sih::Sih::open(port)?)),
            Interface::ArduPilotJson => Self::Json(Box::new(json::Json::open(port, options)?)),
        })
    }

    fn interface(&self) -> Interface {
        match self {
            Self::Hil(_) => Interface::Px4Hil,
            Self::Sih(_) => Interface::Px4Sih,
            Self::Json(_) => Interface::ArduPilotJson,
        }
    }
}
