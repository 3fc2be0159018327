//! The loop of every service: sleep until a topic, a socket or a timer wakes it, run one cycle, tell that it lives.
//!
//! Nothing polls for data: the process sleeps in one `ppoll` over the wake-ups of its trigger topics and the file
//! descriptors the service watches, at most until the next moment the service or the heartbeat asked for. The control
//! record wakes it, too: whoever has become the owner by it runs a cycle at once, and says so.

use crate::config::{Config, ConfigError};
use crate::duty::Duty;
use crate::events::EventSender;
use crate::heartbeat::{CycleMeter, HEARTBEAT_PERIOD_S};
use crate::input::{Input, InputHealth};
use crate::instance::Instance;
use crate::output::Output;
use crate::param_store::ParamStore;
use crate::pretouch::Pretouch;
use crate::realtime::{self, RealtimeWish, Scheduling};
use crate::session::{OpenError, Session};
use crate::wakeup::Wakeup;
use clap::{CommandFactory, FromArgMatches, Parser};
use jink_shared_types::control::Control;
use jink_shared_types::health::{Heartbeat, Name, Role, ServiceState};
use jink_shared_types::layout::Layout;
use jink_shared_types::params::ParamSet;
use jink_shared_types::topics::{self, Topic};
use jink_shared_types::tuning::ParameterValues;
use jink_shared_types::{SampleHeader, Timestamp};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::fmt;
use std::os::fd::BorrowedFd;
use std::path::PathBuf;
use std::process::ExitCode;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Descriptors a service may watch besides its topics: three for each of the gateway's links.
pub const WATCHED_FDS: usize = 3 * jink_shared_types::link::LINKS;
/// Trigger topics and watched descriptors together.
const POLL_FDS: usize = 32;
/// Exit code of a service that could not start: wrong configuration, missing device, refused topic. The supervisor does
/// not restart it at once: it would fail again.
pub const EXIT_CANNOT_START: u8 = 78;
/// Exit code of a service that wants to be started again ([`Wake::restart`]): for the supervisor a death like any other, so
/// back-off and intensity hold for it, too.
pub const EXIT_RESTART: u8 = 75;

/// What the supervisor tells a process when it starts it.
#[derive(Clone, Debug, Parser)]
#[command(
    about = "A jink service. It is started by jink-supervisor; by hand only for tests.",
    version
)]
pub struct Setup {
    /// Name of the process in the process table
    #[arg(long)]
    pub process: String,
    /// Instance to join
    #[arg(long, default_value = "default")]
    pub instance: Instance,
    /// Folder with jink.toml
    #[arg(long, default_value = "config")]
    pub config: PathBuf,
    /// Which start of this process it is
    #[arg(long, default_value_t = 1)]
    pub generation: u32,
    /// Cycle budget (us), 0 = none
    #[arg(long, default_value_t = 0)]
    pub budget_us: u32,
    /// Oldest range data behind an output (us), 0 = any
    #[arg(long, default_value_t = 0)]
    pub end_to_end_us: u32,
    /// Compute, but publish nothing before the control record says so
    #[arg(long)]
    pub shadow: bool,
    /// SCHED_FIFO priority, 0 = ordinary scheduling
    #[arg(long, default_value_t = 0)]
    pub priority: u8,
    /// Core to stay on
    #[arg(long)]
    pub core: Option<usize>,
    /// Keep all pages in memory
    #[arg(long)]
    pub lock_memory: bool,
    /// Log level: error, warn, info, debug, trace
    #[arg(long, default_value = "info")]
    pub log: tracing::Level,
    /// Arguments of this kind of service
    #[arg(last = true)]
    pub arguments: Vec<String>,
}

impl Setup {
    /// The command line of the program called `name`.
    fn try_parse_as(name: &str) -> Result<Self, clap::Error> {
        let command = Self::command().display_name(name).bin_name(name);
        let matches = command.try_get_matches()?;
        Self::from_arg_matches(&matches)
    }
}

/// Why a service could not start.
#[derive(Debug)]
pub enum StartError {
    /// A topic could not be opened.
    Topic(OpenError),
    /// The configuration is wrong.
    Config(ConfigError),
    /// Something else the service needs is not to be had.
    Needs {
        /// What it needs.
        what: String,
        /// Why it is not there.
        cause: String,
    },
}

impl fmt::Display for StartError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Topic(error) => write!(f, "{error}"),
            Self::Config(error) => write!(f, "{error}"),
            Self::Needs { what, cause } => write!(f, "{what}: {cause}"),
        }
    }
}
impl std::error::Error for StartError {}
impl From<OpenError> for StartError {
    fn from(error: OpenError) -> Self {
        Self::Topic(error)
    }
}
impl From<ConfigError> for StartError {
    fn from(error: ConfigError) -> Self {
        Self::Config(error)
    }
}

/// When a service wants to run again at the latest, data or not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wake {
    at: Timestamp,
    restart: bool,
}

impl Wake {
    /// Only when data arrive.
    pub fn on_data() -> Self {
        Self::at(Timestamp::from_ns(u64::MAX))
    }

    /// At `time`. For what is put out at a fixed rate: [`Timestamp::next_beat`], so that a second instance of the service keeps
    /// the same time and its takeover is not heard.
    pub fn at(time: Timestamp) -> Self {
        Self {
            at: time,
            restart: false,
        }
    }

    /// Never again: the process ends, and the supervisor starts it anew.
    pub fn restart() -> Self {
        Self {
            restart: true,
            ..Self::on_data()
        }
    }

    /// `seconds` from now.
    pub fn within_s(seconds: f64) -> Self {
        Self::at(realtime::now().plus_seconds(seconds))
    }
}

/// One run of a service.
#[derive(Debug)]
pub struct Cycle<'a> {
    /// When it was woken.
    pub now: Timestamp,
    /// News for the pilot.
    pub events: &'a mut EventSender,
}

/// A service: opened once, then run cycle by cycle.
pub trait Service: Sized {
    /// The program's name in the topic table.
    const PROGRAM: &'static str;

    /// Opens topics and devices.
    ///
    /// # Errors
    /// Whatever keeps the service from working at all; it is logged and the process ends.
    fn open(ports: &mut Ports) -> Result<Self, StartError>;

    /// Does what there is to do now and says when it must run again without data.
    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake;

    /// Takes new values of the parameters that apply at once. What is known and what is under way stays; the others are
    /// as they were at the start.
    fn retune(&mut self, _params: &ParamSet) {}

    /// Descriptors whose readability starts a cycle; they may change from cycle to cycle.
    fn watched(&self) -> [Option<BorrowedFd<'_>>; WATCHED_FDS] {
        [None; WATCHED_FDS]
    }
}

/// Opens the topics of a service.
pub struct Ports {
    session: Session,
    setup: Setup,
    config: Config,
    store: ParamStore,
    inputs: Vec<Rc<InputHealth>>,
    wakeups: Vec<Wakeup>,
    duty: Rc<Duty>,
}

impl fmt::Debug for Ports {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Ports({}, {} inputs)", self.setup.process, self.inputs.len())
    }
}

impl Ports {
    /// What the supervisor said.
    pub fn setup(&self) -> &Setup {
        &self.setup
    }

    /// The configuration, with the parameters that were in force when the process was started.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Where changed parameters are kept.
    pub fn param_store(&self) -> &ParamStore {
        &self.store
    }

    /// A topic to publish.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn output<T: Layout>(&mut self, topic: Topic<T>) -> Result<Output<T>, OpenError> {
        self.output_of(topic, "")
    }

    /// One topic of a family to publish.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn output_of<T: Layout>(&mut self, topic: Topic<T>, member: &str) -> Result<Output<T>, OpenError> {
        let output = self.session.output(topic, member, self.setup.generation)?;
        Ok(output.with_duty(&self.duty))
    }

    /// Judges the age of what leaves shared memory; see [`Latency::left`].
    pub fn latency(&self) -> Latency {
        Latency {
            duty: Rc::clone(&self.duty),
        }
    }

    /// A topic to look at in every cycle.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn input<T: Layout>(&mut self, topic: Topic<T>) -> Result<Input<T>, OpenError> {
        self.input_of(topic, "")
    }

    /// One topic of a family to look at in every cycle.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn input_of<T: Layout>(&mut self, topic: Topic<T>, member: &str) -> Result<Input<T>, OpenError> {
        let input = self.session.input(topic, member)?;
        self.inputs.push(input.health());
        Ok(input)
    }

    /// A topic whose samples start a cycle.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn trigger<T: Layout>(&mut self, topic: Topic<T>) -> Result<Input<T>, OpenError> {
        self.trigger_of(topic, "")
    }

    /// One topic of a family whose samples start a cycle.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn trigger_of<T: Layout>(&mut self, topic: Topic<T>, member: &str) -> Result<Input<T>, OpenError> {
        self.wakeups
            .push(Wakeup::new(self.session.listener(topic, member)?));
        Ok(self.input_of(topic, member)?.with_duty(&self.duty))
    }

    /// For a service with a thing that only one instance can have: it declares itself which cycles it owns.
    pub fn claim(&self) -> Claim {
        let claim = Claim {
            duty: Rc::clone(&self.duty),
        };
        claim.declare(!self.setup.shadow);
        claim
    }

    fn masks(&self, now: Timestamp) -> (u32, u32) {
        let mut fresh = 0;
        let mut needed = 0;
        for (index, input) in self.inputs.iter().enumerate().take(32) {
            fresh |= u32::from(input.is_fresh(now)) << index;
            needed |= u32::from(input.needed.get()) << index;
        }
        (fresh, needed)
    }

    /// Alive and blind is told from alive and well: a needed input that is stale degrades, one that never came is a
    /// reason to stand by, and so is what the service lacks besides.
    fn state(&self, now: Timestamp) -> ServiceState {
        let needed = || self.inputs.iter().filter(|input| input.needed.get());
        if self.duty.stands_by() || needed().any(|input| !input.newest.get().is_set()) {
            ServiceState::Standby
        } else if needed().all(|input| input.is_fresh(now)) {
            ServiceState::Active
        } else {
            ServiceState::Degraded
        }
    }
}

/// Judges the age of outputs that do not leave through a topic against the process's end-to-end budget.
#[derive(Clone, Debug)]
pub struct Latency {
    duty: Rc<Duty>,
}

impl Latency {
    /// Something made from the sample with this header left at `time`.
    pub fn left(&self, header: &SampleHeader, time: Timestamp) {
        self.duty.judge_age(header, time);
    }
}

/// Ownership that a service passes on by itself, when the control record says so.
#[derive(Clone, Debug)]
pub struct Claim {
    duty: Rc<Duty>,
}

impl Claim {
    /// Whether the record says that this instance is the owner at `time`.
    pub fn is_due(&self, time: Timestamp) -> bool {
        self.duty.owns(time)
    }

    /// When that changes, if a change is planned; may be past.
    pub fn changes_at(&self) -> Option<Timestamp> {
        self.duty.changes_at()
    }

    /// What is put out from now on is published, or not.
    pub fn declare(&self, owns: bool) {
        self.duty.declare(owns);
    }

    /// Something that the service needs besides its inputs is not there, or is there again: meanwhile it stands by.
    pub fn stand_by(&self, stands_by: bool) {
        self.duty.stand_by(stands_by);
    }
}

/// Runs service `S` until SIGTERM or SIGINT: the whole `main` of a service.
pub fn run<S: Service>() -> ExitCode {
    let name = format!("jink-{}", S::PROGRAM.replace('_', "-"));
    let setup = match Setup::try_parse_as(&name) {
        Ok(setup) => setup,
        Err(answer) => answer.exit(),
    };
    crate::logging::init(&setup.process, setup.log);
    match start::<S>(setup) {
        Ok(Ended::Stopped) => ExitCode::SUCCESS,
        Ok(Ended::WantsRestart) => ExitCode::from(EXIT_RESTART),
        Err(error) => {
            tracing::error!("{} cannot start: {error}", S::PROGRAM);
            ExitCode::from(EXIT_CANNOT_START)
        }
    }
}

/// How the loop has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ended {
    Stopped,
    WantsRestart,
}

fn start<S: Service>(setup: Setup) -> Result<Ended, StartError> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).map_err(|error| StartError::Needs {
            what: "a signal handler".to_owned(),
            cause: error.to_string(),
        })?;
    }
    let mut config = Config::load(&setup.config)?;
    let store = ParamStore::of(&config, &setup.instance);
    let (params, refused) = store.load();
    config.params = params;
    for refusal in refused {
        tracing::warn!("{refusal}");
    }
    let wish = RealtimeWish {
        priority: setup.priority,
        core: setup.core,
        lock_memory: setup.lock_memory,
    };
    for refusal in realtime::apply(wish) {
        tracing::warn!("{refusal}");
    }
    let session = Session::open(&setup.instance, S::PROGRAM)?;
    let health = session.output(topics::HEALTH, &setup.process, setup.generation)?;
    let duty = Rc::new(Duty::new(setup.generation, setup.shadow, setup.end_to_end_us));
    let mut events = EventSender::new(&setup.process);
    let mut control = ControlRecord {
        input: session.input(topics::CONTROL, "")?,
        wakeup: Wakeup::new(session.listener(topics::CONTROL, "")?),
        process: Name::new(&setup.process),
    };
    let mut ports = Ports {
        session,
        config,
        store,
        inputs: Vec::new(),
        wakeups: Vec::new(),
        duty,
        setup,
    };
    let mut beat = Beat::new(&ports.setup, health, Rc::clone(&ports.duty));
    beat.send(ServiceState::Starting, 0, 0);
    let mut service = S::open(&mut ports)?;
    tracing::debug!(pid = std::process::id(), "{} runs", ports.setup.process);
    // The supervisor waits for the first heartbeat from the loop: after the first cycle, not a period later.
    beat.due = realtime::now();
    let ended = serve(
        &mut service,
        &mut ports,
        &mut control,
        &mut beat,
        &mut events,
        &stop,
    )?;
    beat.send(ServiceState::Stopping, 0, 0);
    Ok(ended)
}

fn serve<S: Service>(
    service: &mut S,
    ports: &mut Ports,
    control: &mut ControlRecord,
    beat: &mut Beat,
    events: &mut EventSender,
    stop: &AtomicBool,
) -> Result<Ended, OpenError> {
    let mut pretouch = None;
    let mut tuning: Option<Tuning> = None;
    while !stop.load(Ordering::Relaxed) {
        // Before the clock: what this cycle takes was then published after any record it has not read.
        control.read(&ports.duty);
        let now = realtime::now();
        if let Some(params) = tuning.as_mut().and_then(|tuning| tuning.news(now)) {
            service.retune(params);
        }
        ports.duty.begin(now);
        let wake = service.cycle(&mut Cycle { now, events });
        let end = realtime::now();
        beat.meter.cycle(now, end);
        beat.send_if_due(end, ports);
        match &mut pretouch {
            Some(pretouch) => Pretouch::step(pretouch),
            None => {
                // It works and has said so: what could wait until then.
                if ports.setup.priority == 0 {
                    // The supervisor lets a replacement start ahead of others. Whoever was not has nothing to give up.
                    let _refused_to_nobody = realtime::schedule(0, Scheduling::Ordinary);
                }
                events.connect(ports.output(topics::EVENT)?);
                tuning = Some(Tuning::open(&ports.session, &ports.config.params)?);
                pretouch = Some(Pretouch::of_this_process());
            }
        }
        if wake.restart {
            return Ok(Ended::WantsRestart);
        }
        sleep(service, ports, control, wake.at, stop, beat);
    }
    Ok(Ended::Stopped)
}

/// The parameters of a running service.
struct Tuning {
    input: Input<ParameterValues>,
    /// Sequence number of the last sample taken.
    taken: Option<u64>,
    params: ParamSet,
}

impl Tuning {
    /// Not counted among the service's own inputs: it works without.
    fn open(session: &Session, params: &ParamSet) -> Result<Self, OpenError> {
        Ok(Self {
            input: session.input(topics::PARAMETERS, "")?,
            taken: None,
            params: params.clone(),
        })
    }

    /// The parameters, if one that applies at once has changed.
    fn news(&mut self, now: Timestamp) -> Option<&ParamSet> {
        let values = self.input.latest(now).fresh()?;
        let sequence = values.header.sequence;
        let is_new = self.taken.replace(sequence) != Some(sequence);
        (is_new && values.sample.apply_live(&mut self.params)).then_some(&self.params)
    }
}

/// Sleeps until data come, until `until`, or until this instance has become the owner; heartbeats go out meanwhile.
fn sleep<S: Service>(
    service: &S,
    ports: &Ports,
    control: &mut ControlRecord,
    until: Timestamp,
    stop: &AtomicBool,
    beat: &mut Beat,
) {
    loop {
        let woken = wait(service, ports, &control.wakeup, until.min(beat.due));
        if woken.by_control {
            control.read(&ports.duty);
        }
        let now = realtime::now();
        let is_new_owner = beat.role == Role::Shadow && ports.duty.role(now) == Role::Owner;
        if woken.by_data || is_new_owner || now >= until || stop.load(Ordering::Relaxed) {
            return;
        }
        beat.send_if_due(now, ports);
    }
}

/// What ended a sleep; neither: the time.
struct Woken {
    by_data: bool,
    by_control: bool,
}

/// One `ppoll` over topics, watched descriptors and the control record.
fn wait<S: Service>(service: &S, ports: &Ports, control: &Wakeup, until: Timestamp) -> Woken {
    let left_ns = until.ns_since(realtime::now());
    let timeout = Timespec {
        tv_sec: i64::try_from(left_ns / 1_000_000_000).unwrap_or(i64::MAX),
        tv_nsec: (left_ns % 1_000_000_000) as i64,
    };
    let watched = service.watched();
    let mut sources = std::iter::once(control.fd())
        .chain(ports.wakeups.iter().map(Wakeup::fd))
        .chain(watched.into_iter().flatten());
    let stdin = rustix::stdio::stdin();
    let mut used = 0;
    // Unused places hold a descriptor with no events asked for, and are not handed to the kernel.
    let mut fds: [PollFd<'_>; POLL_FDS] = std::array::from_fn(|_| match sources.next() {
        Some(fd) => {
            used += 1;
            PollFd::from_borrowed_fd(fd, PollFlags::IN)
        }
        None => PollFd::from_borrowed_fd(stdin, PollFlags::empty()),
    });
    // Interrupted by a signal: as good as a time-out, the caller looks at the stop flag.
    let ready = poll(&mut fds[..used], Some(&timeout)).unwrap_or(0);
    let by_control = ready > 0 && !fds[0].revents().is_empty();
    let by_data = ready > usize::from(by_control);
    if by_control {
        control.clear();
    }
    if by_data {
        for wakeup in &ports.wakeups {
            wakeup.clear();
        }
    }
    Woken { by_data, by_control }
}

/// The control record as one process reads it.
struct ControlRecord {
    input: Input<Control>,
    wakeup: Wakeup,
    process: Name,
}

impl ControlRecord {
    fn read(&mut self, duty: &Duty) {
        let process = &self.process;
        self.input.each(|record| duty.read(record.entry(process)));
    }
}

/// The heartbeat with its period.
struct Beat {
    meter: CycleMeter,
    duty: Rc<Duty>,
    output: Output<Heartbeat>,
    due: Timestamp,
    /// As it was told last.
    role: Role,
    /// Needed inputs that are late.
    late: u32,
}

impl Beat {
    fn new(setup: &Setup, output: Output<Heartbeat>, duty: Rc<Duty>) -> Self {
        Self {
            meter: CycleMeter::new(&setup.process, setup.generation, setup.budget_us),
            duty,
            output,
            due: realtime::now(),
            role: if setup.shadow { Role::Shadow } else { Role::Owner },
            late: 0,
        }
    }

    fn send(&mut self, state: ServiceState, fresh: u32, needed: u32) {
        let now = realtime::now();
        let mut heartbeat = self.meter.beat(state, fresh, needed);
        self.duty.fill(now, &mut heartbeat);
        self.role = heartbeat.role.get();
        self.output.send(SampleHeader::at(now), &heartbeat);
        self.due = now.plus_seconds(HEARTBEAT_PERIOD_S);
    }

    /// Counts inputs that have become late, and sends the heartbeat if it is due, or if the instance's role has changed:
    /// others wait for that.
    fn send_if_due(&mut self, now: Timestamp, ports: &Ports) {
        let (fresh, needed) = ports.masks(now);
        let late = needed & !fresh;
        for _ in 0..(late & !self.late).count_ones() {
            self.meter.deadline_missed();
        }
        self.late = late;
        if now >= self.due || self.duty.role(now) != self.role {
            self.send(ports.state(now), fresh, needed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Tuning;
    use crate::{Instance, Session, now};
    use jink_shared_types::params::{OA_SPD_MAX, OA_VEH_RADIUS, ParamSet};
    use jink_shared_types::tuning::ParameterValues;
    use jink_shared_types::{SampleHeader, topics};

    /// An instance of its own that leaves nothing behind.
    struct Isolated(Instance);

    impl Drop for Isolated {
        fn drop(&mut self) {
            self.0.wipe().unwrap();
            std::fs::remove_dir_all(self.0.folder()).unwrap();
        }
    }

    #[test]
    fn a_live_value_reaches_a_running_service_once_and_a_restart_value_does_not() {
        let isolated = Isolated(format!("rt_tuning_{}", std::process::id()).parse().unwrap());
        std::fs::create_dir_all(isolated.0.folder()).unwrap();
        let gateway = Session::open(&isolated.0, "mavlink_gateway").unwrap();
        let mut output = gateway.output(topics::PARAMETERS, "", 1).unwrap();
        let planner = Session::open(&isolated.0, "planner").unwrap();
        let mut started_with = ParamSet::default();
        started_with.set("OA_GOAL_RAD", 0.7).unwrap();
        let mut tuning = Tuning::open(&planner, &started_with).unwrap();
        assert!(tuning.news(now()).is_none(), "nobody has spoken yet");

        let mut told = started_with.clone();
        output.send(SampleHeader::at(now()), &ParameterValues::of(&told));
        assert!(tuning.news(now()).is_none(), "nothing has changed");
        told.set("OA_SPD_MAX", 4.5).unwrap();
        told.set("OA_VEH_RADIUS", 0.6).unwrap();
        output.send(SampleHeader::at(now()), &ParameterValues::of(&told));
        let params = tuning.news(now()).unwrap();
        assert_eq!(params.get(&OA_SPD_MAX), 4.5);
        assert_eq!(params.get(&OA_VEH_RADIUS), OA_VEH_RADIUS.default);
        output.send(SampleHeader::at(now()), &ParameterValues::of(&told));
        assert!(tuning.news(now()).is_none(), "said twice");
    }
}
