//! A running autopilot with its simulator: threads, clocks and the way of the truth to whoever wants it.

use super::build::Interface;
use super::launch::{HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG, launch};
use super::options::{SitlOptions, Unsupported};
use super::ports::{PortError, SitlPorts};
use super::process::{AutopilotProcess, LOG_FILE};
use super::relay::{self, RelayLink};
use super::watch::{AutopilotState, AutopilotWatch};
use super::{hil, json, sih};
use jink_shared_types::Timestamp;
use jink_shared_types::geo::GlobalPoint;
use jink_simulated_world::vehicle::{STEP_US, VehicleTruth};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::collections::VecDeque;
use std::fmt;
use std::io::{Read, Write};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread::JoinHandle;
use std::time::Duration;

/// Samples kept for a reader that does not come (4 s).
const SAMPLES_MAX: usize = 1_000;
/// More steps than this behind, the simulation goes on slower than real time instead of catching up: 200 ms.
const CATCH_UP_STEPS: u64 = 50;
/// Truth samples (Hz).
const STEP_RATE_HZ: u32 = 1_000_000 / STEP_US as u32;

/// Why a simulation does not start.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StartError {
    /// It cannot be simulated like that.
    Unsupported(Unsupported),
    /// A port is taken.
    Port(PortError),
    /// The system would not do something.
    Io {
        /// What.
        what: String,
        /// Why not.
        cause: String,
    },
}

impl fmt::Display for StartError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unsupported(error) => write!(f, "{error}"),
            Self::Port(error) => write!(f, "{error}"),
            Self::Io { what, cause } => write!(f, "{what}: {cause}"),
        }
    }
}
impl std::error::Error for StartError {}
impl From<Unsupported> for StartError {
    fn from(error: Unsupported) -> Self {
        Self::Unsupported(error)
    }
}
impl From<PortError> for StartError {
    fn from(error: PortError) -> Self {
        Self::Port(error)
    }
}

/// The truth at one moment, 250 times a second.
#[derive(Clone, Copy, Debug)]
pub struct SitlSample {
    /// When, on the board's clock.
    pub time: Timestamp,
    /// Simulated time since the start (s).
    pub time_s: f64,
    /// Where the vehicle really is; local NED about its start.
    pub truth: VehicleTruth,
    /// What the autopilot says.
    pub autopilot: AutopilotState,
    /// By how much the simulation ran behind real time (s).
    pub late_s: f64,
}

/// A running autopilot; it ends with this.
pub struct Sitl {
    shared: Arc<Shared>,
    wake: UnixStream,
    ports: SitlPorts,
    interface: Interface,
    log: PathBuf,
    threads: Vec<JoinHandle<()>>,
}

/// What the threads have in common.
pub(super) struct Shared {
    samples: Mutex<VecDeque<SitlSample>>,
    ended: Mutex<Option<String>>,
    stop: AtomicBool,
    now_us: AtomicU64,
    watch: Arc<Mutex<AutopilotWatch>>,
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

fn guard<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
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
    let mut stage = Stage {
        shared,
        wakes,
        process,
        begin: Timestamp::NEVER,
        steps: 0,
    };
    let result = match &mut simulation {
        Simulation::Hil(hil) => hil.run(&mut stage),
        Simulation::Sih(sih) => sih.run(&mut stage),
        Simulation::Json(json) => json.run(&mut stage),
    };
    stage.process.stop();
    if let Err(reason) = result {
        *guard(&stage.shared.ended) = Some(reason);
        stage.wake();
    }
}

enum Simulation {
    Hil(Box<hil::Hil>),
    Sih(sih::Sih),
    Json(Box<json::Json>),
}

impl Simulation {
    fn open(interface: Interface, port: u16, options: &SitlOptions) -> Result<Self, StartError> {
        Ok(match interface {
            Interface::Px4Hil => Self::Hil(Box::new(hil::Hil::open(port, options)?)),
            Interface::Px4Sih => Self::Sih(sih::Sih::open(port)?),
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

/// What every simulation does around its steps.
pub(super) struct Stage {
    shared: Arc<Shared>,
    wakes: UnixStream,
    process: AutopilotProcess,
    begin: Timestamp,
    steps: u64,
}

impl Stage {
    /// Whether to go on; an error if the autopilot has died.
    pub(super) fn goes_on(&mut self) -> Result<bool, String> {
        if self.shared.stop.load(Ordering::Relaxed) {
            return Ok(false);
        }
        match self.process.ended() {
            None => Ok(true),
            Some(status) => Err(format!(
                "the autopilot's process ended ({status}); its log is {}; it ends: {}",
                self.process.log().display(),
                self.process.last_words()
            )),
        }
    }

    /// The text for an autopilot from which nothing comes.
    pub(super) fn silence(&self, what: &str) -> String {
        format!(
            "{what}; the autopilot's log is {}; it ends: {}",
            self.process.log().display(),
            self.process.last_words()
        )
    }

    /// Publishes the truth after [`STEP_US`] more, which the simulation has reached with `late_s`; waits until the step is due
    /// in real time.
    pub(super) fn pace(&mut self, truth: VehicleTruth) {
        if !self.begin.is_set() {
            // Sensor frames end on beats of the clock: a pose is there then.
            self.begin = jink_runtime::now().next_beat(STEP_RATE_HZ);
        }
        self.steps += 1;
        let now = jink_runtime::now();
        let due_steps = now.ns_since(self.begin) / (STEP_US * 1_000);
        if due_steps > self.steps + CATCH_UP_STEPS {
            let behind = due_steps - self.steps - CATCH_UP_STEPS;
            self.begin = self.begin.plus_seconds(behind as f64 * STEP_US as f64 * 1e-6);
        }
        let due = Timestamp::from_ns(self.begin.ns + self.steps * STEP_US * 1_000);
        let wait_ns = due.ns_since(now);
        if wait_ns > 0 {
            std::thread::sleep(Duration::from_nanos(wait_ns));
        }
        let late_s = jink_runtime::now().seconds_since(due).max(0.0);
        self.publish(due, self.steps as f64 * STEP_US as f64 * 1e-6, truth, late_s);
    }

    /// Publishes the truth at `time`.
    pub(super) fn publish(&mut self, time: Timestamp, time_s: f64, truth: VehicleTruth, late_s: f64) {
        self.shared.now_us.store((time_s * 1e6) as u64, Ordering::Relaxed);
        let autopilot = {
            let mut watch = relay::lock(&self.shared.watch);
            watch.see_truth(time_s, truth.position, truth.on_ground);
            *watch.state()
        };
        let mut samples = guard(&self.shared.samples);
        if samples.len() >= SAMPLES_MAX {
            samples.pop_front();
        }
        samples.push_back(SitlSample {
            time,
            time_s,
            truth,
            autopilot,
            late_s,
        });
        drop(samples);
        self.wake();
    }

    fn wake(&mut self) {
        // A full pipe wakes as well.
        let _full = self.wakes.write(&[0]);
    }
}
