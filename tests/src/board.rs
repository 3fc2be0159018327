//! A board in one process: the processes of the table in lock-step, under the supervisor's own rules.
//!
//! Every service is opened and run as in a process of its own; they meet on a [`LocalBus`] and in the instance's folder. What the
//! supervisor's host does with processes (start, signal, reap) is done with members here; every decision is that of
//! [`Supervision`].

use crate::proposer::ProposerService;
use crate::remote::Remote;
use jink_bezier_generator::GeneratorService;
use jink_collision_guard::GuardService;
use jink_ground_services::GroundServicesService;
use jink_mavlink_gateway::GatewayService;
use jink_obstacle_fusion::FusionService;
use jink_parameter_server::ParameterService;
use jink_planner::PlannerService;
use jink_runtime::config::{Config, PROCESS_FILE, is_foreign};
use jink_runtime::lockstep::{LocalBus, Looked, Member};
use jink_runtime::service::{EXIT_CANNOT_START, EXIT_RESTART};
use jink_runtime::{Instance, Service, Session, Setup, StartError};
use jink_shared_types::Timestamp;
use jink_shared_types::health::{Health, ServiceState, SystemStatus};
use jink_simulator::service::{SensorService, VehicleService};
use jink_supervisor::shadow::{PROBATION_CYCLES, SwapProgress};
use jink_supervisor::shared::{PROGRAM, SupervisorTopics};
use jink_supervisor::supervision::{Action, Exit, Observation, ProcessActivity, Supervision};
use jink_supervisor::table::{Mode, ProcessRow, ProcessTable, Start};
use std::any::Any;
use std::ffi::OsString;
use std::path::Path;
use std::time::Instant;

/// From the decision to start a process to its first cycle (s): what a restart takes on two cores.
const START_S: f64 = 0.008;

/// A process of the board.
pub(crate) trait Process {
    fn run_if_due(&mut self) -> Looked;
    fn terminate(self: Box<Self>);
    fn as_any(&self) -> &dyn Any;
    fn as_any_mut(&mut self) -> &mut dyn Any;
}

impl<S: Service + 'static> Process for Member<S> {
    fn run_if_due(&mut self) -> Looked {
        self.run_if_due()
    }

    fn terminate(self: Box<Self>) {
        Member::terminate(*self);
    }

    fn as_any(&self) -> &dyn Any {
        self
    }

    fn as_any_mut(&mut self) -> &mut dyn Any {
        self
    }
}

/// What a flight changes of its processes.
pub trait Rig {
    /// Before a process is started: its configuration.
    fn configure(&self, process: &str, config: &mut Config);
    /// Before its first cycle: the [`Member`] itself.
    fn fit(&self, member: &mut dyn Any);
}

/// Starts the service of a program, by the names of the process table.
fn member(
    program: &Path,
    bus: &LocalBus,
    setup: Setup,
    config: Config,
) -> Result<Box<dyn Process>, StartError> {
    fn start<S: Service + 'static>(
        bus: &LocalBus,
        setup: Setup,
        config: Config,
    ) -> Result<Box<dyn Process>, StartError> {
        Ok(Box::new(Member::<S>::start(bus, setup, config)?))
    }
    let role = setup.arguments.first().map(String::as_str);
    match (program.to_str(), role) {
        (Some("jink-mavlink-gateway"), _) => start::<GatewayService>(bus, setup, config),
        (Some("jink-parameter-server"), _) => start::<ParameterService>(bus, setup, config),
        (Some("jink-ground-services"), _) => start::<GroundServicesService>(bus, setup, config),
        (Some("jink-collision-guard"), _) => start::<GuardService>(bus, setup, config),
        (Some("jink-bezier-generator"), _) => start::<GeneratorService>(bus, setup, config),
        (Some("jink-planner"), _) => start::<PlannerService>(bus, setup, config),
        (Some("jink-obstacle-fusion"), _) => start::<FusionService>(bus, setup, config),
        (Some("jink-simulator"), Some("sensors")) => start::<SensorService>(bus, setup, config),
        (Some("jink-simulator"), Some("vehicle")) => start::<VehicleService>(bus, setup, config),
        (Some("jink-proposer"), _) => start::<ProposerService>(bus, setup, config),
        _ => Err(StartError::Needs {
            what: program.display().to_string(),
            cause: "there is no such service in lock-step".to_owned(),
        }),
    }
}

/// One row of the table with what runs of it.
struct Place {
    row: ProcessRow,
    /// The instance that was started as the process, and the one beside it.
    running: [Option<Box<dyn Process>>; 2],
    /// What is being started.
    starting: [Option<Starting>; 2],
    /// Stopped as by SIGSTOP.
    is_paused: bool,
    /// Wall time of its last cycle, if it ran in this step (ms).
    ran_ms: Option<f64>,
}

/// A start under way.
#[derive(Clone, Copy)]
struct Starting {
    due: Timestamp,
    generation: u32,
    pid: u32,
}

/// The index of the process among a place's instances, and of its shadow.
const FIRST: usize = 0;
const SECOND: usize = 1;

/// The board.
pub struct Board {
    bus: LocalBus,
    instance: Instance,
    places: Vec<Place>,
    supervision: Supervision,
    shared: SupervisorTopics,
    observations: Vec<Observation>,
    actions: Vec<Action>,
    pids: u32,
    rig: Box<dyn Rig>,
    /// What was said about swaps, with the process.
    pub swap_progress: Vec<(String, SwapProgress)>,
}

impl std::fmt::Debug for Board {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Board({} processes)", self.places.len())
    }
}

impl Board {
    /// The processes of `table` that run where the vehicle is simulated, none of them started. The configuration lies in the
    /// instance's folder; `rig` sets each process up.
    ///
    /// # Errors
    /// A text naming what is wrong.
    pub fn new(
        bus: &LocalBus,
        instance: &Instance,
        table: &str,
        rig: impl Rig + 'static,
    ) -> Result<Self, String> {
        let config = Config::load(&instance.run_config()).map_err(|error| error.to_string())?;
        let table = ProcessTable::parse(Path::new(PROCESS_FILE), table).map_err(|error| error.to_string())?;
        let rows = table.rows.into_iter();
        // Nothing is recorded.
        let flies = |row: &ProcessRow| row.when.includes(Mode::SimulatedVehicle, &Config::default());
        let rows = rows.filter(|row| flies(row) && row.per_sensor.is_none());
        let places: Vec<Place> = rows
            .map(|row| Place {
                row,
                running: [None, None],
                starting: [None, None],
                is_paused: false,
                ran_ms: None,
            })
            .collect();
        let names: Vec<&str> = places.iter().map(|place| place.row.rules.name.as_str()).collect();
        let shared = SupervisorTopics::open(Session::local(bus, PROGRAM), &config, &names, 1)
            .map_err(|error| error.to_string())?;
        let rules = places.iter().map(|place| place.row.rules.clone());
        let supervision = Supervision::new(rules, bus.now(), 1);
        Ok(Self {
            bus: bus.clone(),
            instance: instance.clone(),
            places,
            supervision,
            shared,
            observations: Vec::new(),
            actions: Vec::new(),
            pids: 1,
            rig: Box::new(rig),
            swap_progress: Vec::new(),
        })
    }

    /// Health of the whole.
    pub fn health(&self) -> Health {
        self.supervision.health()
    }

    /// Each process with its state, as the supervisor sees it.
    pub fn states(&self) -> Vec<(String, ServiceState)> {
        let mut status = SystemStatus::default();
        self.supervision.write_status(&mut status);
        let states = status.processes.iter().map(|process| process.state.get());
        self.names().map(str::to_owned).zip(states).collect()
    }

    /// The service of process `name`, if it runs and is an `S`.
    pub fn service<S: Service + 'static>(&self, name: &str) -> Option<&S> {
        let running = self.places[self.find(name)?].running[FIRST].as_ref()?;
        let member = running.as_any().downcast_ref::<Member<S>>()?;
        Some(member.service())
    }

    /// As [`Self::service`].
    pub fn service_mut<S: Service + 'static>(&mut self, name: &str) -> Option<&mut S> {
        let index = self.find(name)?;
        let running = self.places[index].running[FIRST].as_mut()?;
        let member = running.as_any_mut().downcast_mut::<Member<S>>()?;
        Some(member.service_mut())
    }

    /// Wall time of the cycle that process `name` ran in this step (ms), if it ran one.
    pub fn ran_ms(&self, name: &str) -> Option<f64> {
        self.places[self.find(name)?].ran_ms
    }

    /// Ends a process as SIGKILL does.
    pub fn kill(&mut self, name: &str) {
        if let Some(process) = self.find(name)
            && self.places[process].running[FIRST].take().is_some()
        {
            let exit = Exit::Signal(9);
            self.observations.push(Observation::Died { process, exit });
        }
    }

    /// Stops a process as SIGSTOP does, or lets it go on.
    pub fn pause(&mut self, name: &str, is_paused: bool) {
        if let Some(index) = self.find(name) {
            self.places[index].is_paused = is_paused;
        }
    }

    /// Asks for a second instance in the place of a process.
    pub fn swap(&mut self, name: &str) {
        if let Some(process) = self.find(name) {
            self.observations.push(Observation::SwapRequested {
                process,
                cycles: PROBATION_CYCLES,
                dry_run: false,
            });
        }
    }

    /// The supervisor's turn: it sees what has happened, decides, and starts, ends and reports.
    pub fn supervise(&mut self) {
        let now = self.bus.now();
        self.shared.read_heartbeats(&mut self.observations);
        loop {
            self.actions.clear();
            let observed = std::mem::take(&mut self.observations);
            let changed = self.supervision.step(now, &observed, &mut self.actions);
            for action in std::mem::take(&mut self.actions) {
                self.act(now, action);
            }
            self.shared.publish(now, &self.supervision, changed);
            // What an action led to is looked at before anything else.
            if self.observations.is_empty() {
                return;
            }
        }
    }

    /// Runs what is due of the processes of these names, in this order.
    pub fn run<'a>(&mut self, names: impl IntoIterator<Item = &'a str>) {
        for name in names {
            if let Some(index) = self.find(name) {
                self.places[index].ran_ms = None;
                for which in [FIRST, SECOND] {
                    self.start_if_due(index, which);
                    self.run_one(index, which);
                }
            }
        }
    }

    /// The names of all processes, in the table's order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.places.iter().map(|place| place.row.rules.name.as_str())
    }

    fn find(&self, name: &str) -> Option<usize> {
        self.names().position(|known| known == name)
    }

    fn run_one(&mut self, index: usize, which: usize) {
        let place = &mut self.places[index];
        let Some(process) = place.running[which].as_mut().filter(|_| !place.is_paused) else {
            return;
        };
        let begin = Instant::now();
        match process.run_if_due() {
            Looked::Slept => {}
            Looked::Ran => {
                if which == FIRST {
                    place.ran_ms = Some(begin.elapsed().as_secs_f64() * 1e3);
                }
            }
            Looked::WantsRestart => {
                place.running[which] = None;
                self.ended(index, which, Exit::Code(EXIT_RESTART));
            }
            Looked::Ended(status) => {
                place.running[which] = None;
                self.ended(index, which, Exit::of(status));
            }
        }
    }

    fn start_if_due(&mut self, index: usize, which: usize) {
        let now = self.bus.now();
        let place = &mut self.places[index];
        let Some(begun) = place.starting[which].take_if(|start| start.due <= now) else {
            return;
        };
        let folder = self.instance.run_config();
        let start = Start {
            instance: &self.instance,
            config: &folder,
            log: tracing::Level::ERROR,
            generation: begun.generation,
            is_shadow: which == SECOND,
        };
        let name = place.row.rules.name.clone();
        let program: OsString = place.row.program.clone().into();
        let line = std::iter::once(program).chain(place.row.arguments_of(&start));
        let started = Setup::of_command_line(line).and_then(|mut setup| {
            setup.pid = begun.pid;
            if is_foreign(&name) {
                let socket = self.instance.folder().join(format!("lockstep_{}", begun.pid));
                let arguments = place.row.arguments_of(&start);
                let remote = Remote::start(&self.bus, &place.row.program, arguments, &socket)?;
                return Ok(Box::new(remote) as Box<dyn Process>);
            }
            let mut config = Config::load(&folder)?;
            self.rig.configure(&name, &mut config);
            let mut process = member(&place.row.program, &self.bus, setup, config)?;
            self.rig.fit(process.as_any_mut());
            Ok(process)
        });
        match started {
            Ok(process) => place.running[which] = Some(process),
            Err(error) => {
                tracing::error!("{name} cannot start: {error}");
                self.ended(index, which, Exit::Code(EXIT_CANNOT_START));
            }
        }
    }

    fn ended(&mut self, process: usize, which: usize, exit: Exit) {
        self.observations.push(match which {
            FIRST => Observation::Died { process, exit },
            _ => Observation::ShadowDied { process, exit },
        });
    }

    fn begin_start(&mut self, process: usize, which: usize, generation: u32) -> u32 {
        self.pids += 1;
        self.places[process].starting[which] = Some(Starting {
            due: self.bus.now().plus_seconds(START_S),
            generation,
            pid: self.pids,
        });
        self.pids
    }

    fn act(&mut self, now: Timestamp, action: Action) {
        match action {
            Action::Spawn { process, generation } => {
                let pid = self.begin_start(process, FIRST, generation);
                self.observations.push(Observation::Spawned { process, pid });
            }
            Action::SpawnShadow {
                process, generation, ..
            } => {
                let pid = self.begin_start(process, SECOND, generation);
                self.observations
                    .push(Observation::ShadowSpawned { process, pid });
            }
            Action::Inspect { process } => {
                let place = &self.places[process];
                self.observations.push(Observation::Inspected {
                    process,
                    activity: if place.is_paused {
                        ProcessActivity::Stopped
                    } else {
                        ProcessActivity::Sleeping
                    },
                    cpu_s: 0.0,
                    core_runs: true,
                });
            }
            Action::Terminate { process } => {
                if let Some(member) = self.places[process].running[FIRST].take() {
                    member.terminate();
                }
                self.places[process].starting[FIRST] = None;
                self.ended(process, FIRST, Exit::Code(0));
            }
            Action::Kill { process } => {
                self.places[process].running[FIRST] = None;
                self.places[process].starting[FIRST] = None;
                // Whoever takes its place is not stopped.
                self.places[process].is_paused = false;
                self.ended(process, FIRST, Exit::Signal(9));
            }
            Action::KillShadow { process } => {
                self.places[process].running[SECOND] = None;
                self.places[process].starting[SECOND] = None;
                self.ended(process, SECOND, Exit::Signal(9));
            }
            Action::Promote { process } => self.places[process].running.swap(FIRST, SECOND),
            Action::ReportSwap { process, progress } => {
                let name = self.places[process].row.rules.name.clone();
                self.swap_progress.push((name, progress));
            }
            Action::PublishEvent(event) => self.shared.raise(now, &event),
            // The program is the same; there is nothing to clean up; the caller ends the flight.
            Action::Commit { .. } | Action::TakeBack { .. } | Action::CleanUp | Action::End(_) => {}
        }
    }
}
