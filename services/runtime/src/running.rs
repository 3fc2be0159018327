//! A service with everything that goes on around its cycles: parameters that change, ownership, heartbeats, events.
//!
//! One [`Running::turn`] is one cycle and what belongs to it. Whoever calls it decides when: the loop of a process, which sleeps
//! in between ([`crate::process_loop`]), or a scheduler that has all services in one process ([`crate::lockstep`]).

use crate::clock::Clock;
use crate::config::Config;
use crate::cycle_log::CycleLog;
use crate::events::EventSender;
use crate::heartbeat::{CycleMeter, HEARTBEAT_PERIOD_S};
use crate::input::Input;
use crate::open_error::OpenError;
use crate::output::Output;
use crate::ownership::Ownership;
use crate::param_store::ParamStore;
use crate::ports::Ports;
use crate::service::{Cycle, Service, Wake};
use crate::session::Session;
use crate::setup::{Setup, StartError};
use crate::transport::Wakeup;
use jink_shared_types::control::Control;
use jink_shared_types::health::{Heartbeat, Name, Role, ServiceState};
use jink_shared_types::param_messages::ParameterValues;
use jink_shared_types::params::ParamSet;
use jink_shared_types::{SampleHeader, Timestamp, topics};
use std::rc::Rc;

/// A service that has been opened.
pub(crate) struct Running<S> {
    pub(crate) service: S,
    pub(crate) ports: Ports,
    pub(crate) control: ControlRecord,
    beat: HeartbeatPublisher,
    events: EventSender,
    param_messages: Option<LiveParams>,
    clock: Clock,
    cycle_log: Option<Rc<CycleLog>>,
}

impl<S: Service> Running<S> {
    /// Opens the service over `session`: first its heartbeat and the control record, then what is its own.
    pub(crate) fn start(mut session: Session, setup: Setup, mut config: Config) -> Result<Self, StartError> {
        let store = ParamStore::of(&config, &setup.instance);
        let (params, refused) = store.in_force();
        config.params = params;
        for refusal in refused {
            tracing::warn!("{refusal}");
        }
        if S::REPLAYS && config.recorder.folder.is_some() {
            session.record(setup.shadow);
        }
        let cycle_log = session.cycle_log.clone();
        let clock = session.clock();
        let health = session.output(topics::HEALTH, &setup.process, setup.generation)?;
        let control = ControlRecord {
            input: session.input(topics::CONTROL, "")?,
            wakeup: session.wakeup(topics::CONTROL, "")?,
            process: Name::new(&setup.process),
        };
        let events = EventSender::new(&setup.process);
        let mut ports = Ports::new(session, setup, config, store);
        let ownership = Rc::clone(&ports.ownership);
        let mut beat =
            HeartbeatPublisher::new(ports.setup(), health, ownership, clock.clone(), cycle_log.clone());
        beat.send(ServiceState::Starting, 0, 0);
        let service = S::open(&mut ports)?;
        // The supervisor waits for the first heartbeat from the loop: after the first cycle, not a period later.
        beat.due = clock.now();
        Ok(Self {
            service,
            ports,
            control,
            beat,
            events,
            param_messages: None,
            clock,
            cycle_log,
        })
    }

    /// One cycle.
    pub(crate) fn turn(&mut self) -> Wake {
        // Before the clock: what this cycle takes was then published after any record it has not read.
        self.control.read(&self.ports.ownership);
        let now = self.clock.now();
        if let Some(log) = &self.cycle_log {
            log.begin(now);
        }
        if let Some(params) = self
            .param_messages
            .as_mut()
            .and_then(|param_messages| param_messages.update(now))
        {
            self.service.on_params_changed(params);
        }
        self.ports.ownership.begin(now);
        let events = &mut self.events;
        let wake = self.service.cycle(&mut Cycle { now, events });
        self.ports.report_refusals(now, &mut self.events);
        if let Some(log) = &self.cycle_log {
            log.end();
        }
        let end = self.clock.now();
        self.beat.meter.cycle(now, end);
        self.beat.send_if_due(end, &self.ports);
        self.ports.ownership.rest(self.clock.now());
        wake
    }

    /// After the first cycle, when the service works and has said so: what could wait until then.
    pub(crate) fn settle(&mut self) -> Result<(), OpenError> {
        self.events.connect(self.ports.output(topics::EVENT)?);
        self.param_messages = Some(LiveParams::open(
            &self.ports.session,
            &self.ports.config().params,
        )?);
        if let Some(log) = &self.cycle_log {
            let setup = self.ports.setup();
            let session = &self.ports.session;
            log.connect(session.output(topics::CYCLES, &setup.process, setup.generation)?);
        }
        self.ports.session.reserve()
    }

    /// Reads the control record and sends the heartbeat if it is due. Returns whether the instance has just become the owner:
    /// it runs a cycle at once, and says so.
    pub(crate) fn attend(&mut self) -> bool {
        self.control.read(&self.ports.ownership);
        let now = self.clock.now();
        let is_new_owner = self.beat.role == Role::Shadow && self.ports.ownership.role(now) == Role::Owner;
        if !is_new_owner {
            self.beat.send_if_due(now, &self.ports);
        }
        is_new_owner
    }

    /// When the next heartbeat is due.
    pub(crate) fn beat_due(&self) -> Timestamp {
        self.beat.due
    }

    /// Says that it ends.
    pub(crate) fn end(&mut self) {
        self.beat.send(ServiceState::Stopping, 0, 0);
    }
}

/// The parameters of a running service.
struct LiveParams {
    input: Input<ParameterValues>,
    /// Sequence number of the last sample taken.
    taken: Option<u64>,
    params: ParamSet,
}

impl LiveParams {
    /// Not counted among the service's own inputs: it works without.
    fn open(session: &Session, params: &ParamSet) -> Result<Self, OpenError> {
        Ok(Self {
            input: session.input(topics::PARAMETERS, "")?,
            taken: None,
            params: params.clone(),
        })
    }

    /// The parameters, if one that applies at once has changed.
    fn update(&mut self, now: Timestamp) -> Option<&ParamSet> {
        let values = self.input.latest(now).fresh()?;
        let sequence = values.header.sequence;
        let is_new = self.taken.replace(sequence) != Some(sequence);
        (is_new && values.sample.apply_live(&mut self.params)).then_some(&self.params)
    }
}

/// The control record as one process reads it.
pub(crate) struct ControlRecord {
    input: Input<Control>,
    pub(crate) wakeup: Wakeup,
    process: Name,
}

impl ControlRecord {
    fn read(&mut self, ownership: &Ownership) {
        let process = &self.process;
        self.input.each(|record| ownership.read(record.entry(process)));
    }
}

/// The heartbeat with its period.
struct HeartbeatPublisher {
    meter: CycleMeter,
    ownership: Rc<Ownership>,
    output: Output<Heartbeat>,
    /// What the service's cycles took goes out with its heartbeats.
    cycle_log: Option<Rc<CycleLog>>,
    clock: Clock,
    due: Timestamp,
    /// As it was reported last.
    role: Role,
    /// Needed inputs that are late.
    late: u32,
}

impl HeartbeatPublisher {
    fn new(
        setup: &Setup,
        output: Output<Heartbeat>,
        ownership: Rc<Ownership>,
        clock: Clock,
        cycle_log: Option<Rc<CycleLog>>,
    ) -> Self {
        Self {
            meter: CycleMeter::new(&setup.process, setup.pid, setup.generation, setup.budget_us),
            ownership,
            output,
            cycle_log,
            due: clock.now(),
            clock,
            role: if setup.shadow { Role::Shadow } else { Role::Owner },
            late: 0,
        }
    }

    fn send(&mut self, state: ServiceState, fresh: u32, needed: u32) {
        let now = self.clock.now();
        let mut heartbeat = self.meter.beat(state, fresh, needed);
        self.ownership.fill(now, &mut heartbeat);
        self.role = heartbeat.role.get();
        self.output.send(SampleHeader::at(now), &heartbeat);
        if let Some(log) = &self.cycle_log {
            log.publish(now);
        }
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
        if now >= self.due || self.ownership.role(now) != self.role {
            self.send(ports.state(now), fresh, needed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::LiveParams;
    use crate::{Instance, Session, now};
    use jink_shared_types::param_messages::ParameterValues;
    use jink_shared_types::params::{OA_SPD_MAX, OA_VEH_RADIUS, ParamSet};
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
        isolated.0.make_folder().unwrap();
        let owner = Session::open(&isolated.0, "parameter_server").unwrap();
        let mut output = owner.output(topics::PARAMETERS, "", 1).unwrap();
        let planner = Session::open(&isolated.0, "planner").unwrap();
        let mut started_with = ParamSet::default();
        started_with.set("OA_GOAL_RAD", 0.7).unwrap();
        let mut param_messages = LiveParams::open(&planner, &started_with).unwrap();
        assert!(param_messages.update(now()).is_none(), "nobody has published yet");

        let mut reported = started_with.clone();
        output.send(SampleHeader::at(now()), &ParameterValues::of(&reported));
        assert!(param_messages.update(now()).is_none(), "nothing has changed");
        reported.set("OA_SPD_MAX", 4.5).unwrap();
        reported.set("OA_VEH_RADIUS", 0.6).unwrap();
        output.send(SampleHeader::at(now()), &ParameterValues::of(&reported));
        let params = param_messages.update(now()).unwrap();
        assert_eq!(params.get(&OA_SPD_MAX), 4.5);
        assert_eq!(params.get(&OA_VEH_RADIUS), OA_VEH_RADIUS.default);
        output.send(SampleHeader::at(now()), &ParameterValues::of(&reported));
        assert!(param_messages.update(now()).is_none(), "said twice");
    }
}
