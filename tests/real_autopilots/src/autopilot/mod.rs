//! Builds of real autopilots: where they are, how they start, where their truth comes from.
//!
//! | autopilot | its simulator | truth |
//! |---|---|---|
//! | PX4 of 2021 | ours (`jink_simulator::sitl`) | the simulator's own state |
//! | PX4 of today | PX4's own (SIH) | HIL_STATE_QUATERNION |
//! | ArduCopter | ArduPilot's own (`--model +`) | SIM_STATE |

mod ardupilot;
mod hil;
mod px4;

use crate::record::Shared;
use crate::setup::{Autopilot, Setup};
use crate::wire::{Reader, Wire};
use jink_shared_types::frames::{LocalNed, Point};
use jink_simulated_world::world::World;
use jink_simulator::sitl::Sitl;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

/// A build at hand.
#[derive(Clone, Debug)]
pub struct Build {
    /// Whose.
    pub autopilot: Autopilot,
    /// The program.
    program: PathBuf,
    /// The folder that it lies in, as it needs it.
    folder: PathBuf,
}

impl Build {
    /// The build of `autopilot` in `folder`: a source folder in which it was built, or the build's own.
    ///
    /// # Errors
    /// A sentence that names what was looked for.
    pub fn find(autopilot: Autopilot, folder: &Path) -> Result<Self, String> {
        let found = match autopilot {
            Autopilot::ArduCopter => ardupilot::find(folder),
            Autopilot::Px4Of2021 => hil::find(folder),
            Autopilot::Px4 => px4::find(folder),
        };
        let found = found.map(|(program, folder)| Self {
            autopilot,
            program,
            folder,
        });
        found.ok_or_else(|| format!("no build of {} at {}", autopilot.option(), folder.display()))
    }

    /// Where it is.
    pub fn program(&self) -> &Path {
        &self.program
    }
}

/// Ports of one flight; flights side by side have different instance numbers.
#[derive(Clone, Copy, Debug)]
pub struct Ports {
    /// The instance number that the autopilot gets.
    pub instance: u16,
}

impl Ports {
    /// Where the autopilot talks to its companion.
    pub fn companion(self, autopilot: Autopilot) -> u16 {
        match autopilot {
            // Our simulator holds PX4's own number, and passes on to this one.
            Autopilot::Px4Of2021 => 18040 + self.instance,
            _ => 14540 + self.instance,
        }
    }

    /// Where jink waits.
    pub fn jink(self) -> u16 {
        15540 + self.instance
    }

    /// Where the ground station is.
    pub fn station(self) -> u16 {
        16540 + self.instance
    }

    /// Where truth arrives.
    pub fn truth(self, autopilot: Autopilot) -> u16 {
        match autopilot {
            Autopilot::ArduCopter => 17540 + self.instance,
            // PX4's own number.
            _ => 19410 + self.instance,
        }
    }
}

/// What an autopilot is started with.
#[derive(Clone, Debug)]
pub struct Start<'a> {
    /// The build.
    pub build: &'a Build,
    /// The setup, for the parameters that its page asks for.
    pub setup: Setup,
    /// Ports.
    pub ports: Ports,
    /// Its own folder: parameters, logs.
    pub folder: PathBuf,
    /// Parameters of the scenario.
    pub parameters: &'a [(&'a str, f64)],
    /// Wind, towards north and east (m/s).
    pub wind_mps: [f64; 2],
    /// Who writes down.
    pub record: Shared,
    /// The world in which it is judged.
    pub world: Arc<World>,
}

impl Start<'_> {
    /// All parameters; later ones replace earlier ones.
    fn parameters(&self) -> impl Iterator<Item = (&str, f64)> {
        self.setup.parameters().iter().chain(self.parameters).copied()
    }
}

/// An autopilot that runs; it ends with this.
pub struct Running {
    source: Source,
    _truth: Reader,
}

/// What runs.
enum Source {
    /// A program that is its own simulator.
    Program {
        process: Process,
        again: Box<dyn Fn() -> std::io::Result<Process> + Send>,
    },
    /// One that our simulator has started.
    Simulation {
        simulation: hil::Simulation,
        again: Box<dyn Fn() -> Result<Sitl, String> + Send>,
    },
}

impl Running {
    /// Starts it.
    ///
    /// # Errors
    /// A sentence that says what is missing.
    pub fn start(start: &Start<'_>) -> Result<Self, String> {
        std::fs::create_dir_all(&start.folder).map_err(|error| error.to_string())?;
        match start.build.autopilot {
            Autopilot::ArduCopter => ardupilot::start(start),
            Autopilot::Px4Of2021 => hil::start(start),
            Autopilot::Px4 => px4::start(start),
        }
    }

    /// Kills it and starts it again with the parameters of its first start, as a reset does.
    ///
    /// # Errors
    /// If it cannot be started.
    pub fn restart(&mut self) -> Result<(), String> {
        match &mut self.source {
            Source::Program { process, again } => {
                process.end();
                *process = again().map_err(|error| error.to_string())?;
            }
            Source::Simulation { simulation, again } => {
                let mut simulation = simulation.lock().unwrap_or_else(PoisonError::into_inner);
                drop(simulation.take());
                *simulation = Some(again()?);
            }
        }
        Ok(())
    }
}

/// The nearest surface around a place (m).
fn clearance(world: &Arc<World>) -> impl Fn(Point<LocalNed>) -> f64 + Send + 'static {
    let world = Arc::clone(world);
    move |place| world.clearance_to_obstacles_m(place)
}

/// Where truth arrives.
fn truth_wire(port: u16) -> Result<Arc<Wire>, String> {
    Wire::listen(port)
        .map(Arc::new)
        .map_err(|error| error.to_string())
}

/// A program that is ended with this, and with the thread that started it.
pub struct Process {
    child: Child,
}

impl Process {
    /// Starts `program`; what it writes goes to `log`.
    fn start(
        program: &Path,
        arguments: &[String],
        environment: &[(String, String)],
        folder: &Path,
        log: &Path,
    ) -> std::io::Result<Self> {
        let out = File::options().create(true).append(true).open(log)?;
        let errors = out.try_clone()?;
        let mut command = Command::new("setpriv");
        command.args(["--pdeathsig", "KILL"]).arg(program).args(arguments);
        command.envs(environment.iter().map(|(key, value)| (key, value)));
        command
            .current_dir(folder)
            .stdin(Stdio::null())
            .stdout(out)
            .stderr(errors);
        Ok(Self {
            child: command.spawn()?,
        })
    }

    fn has_ended(&mut self) -> bool {
        self.child.try_wait().is_ok_and(|status| status.is_some())
    }

    fn end(&mut self) {
        let pid = i32::try_from(self.child.id())
            .ok()
            .and_then(rustix::process::Pid::from_raw);
        if let (Some(pid), false) = (pid, self.has_ended()) {
            let _gone_already = rustix::process::kill_process(pid, rustix::process::Signal::TERM);
            let begin = Instant::now();
            while !self.has_ended() && begin.elapsed() < Duration::from_secs(2) {
                std::thread::sleep(Duration::from_millis(20));
            }
        }
        let _gone_already = self.child.kill();
        let _not_ours = self.child.wait();
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.end();
    }
}
