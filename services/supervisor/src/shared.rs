//! The supervisor's topics: it creates every topic and holds it open, so that a topic outlives the processes that use
//! it; it reads heartbeats and publishes status, control record and events.

use crate::supervision::{Observation, Supervision};
use jink_runtime::config::{Config, SensorOutput};
use jink_runtime::session::HeldTopic;
use jink_runtime::{Input, OpenError, Output, Session};
use jink_shared_types::coded::Wire;
use jink_shared_types::control::Control;
use jink_shared_types::events::{EventSample, Severity};
use jink_shared_types::health::{Heartbeat, Name, SystemStatus};
use jink_shared_types::{SampleHeader, Timestamp, topics};
use std::fmt;

/// How soon it is checked again whether adopted processes have sent heartbeats (s).
const SETTLING_LOOK_S: f64 = 0.01;
/// The supervisor in the topic table, and in its events.
pub const PROGRAM: &str = "supervisor";

/// Status and control record are published this often even if nothing changes (s): the topics' rate.
const STATUS_PERIOD_S: f64 = 0.1;

/// Ports and topics. Ports go before the session that they belong to.
pub struct SupervisorTopics {
    heartbeats: Vec<Input<Heartbeat>>,
    events: Output<EventSample>,
    status: Output<SystemStatus>,
    control: Output<Control>,
    status_sample: Box<SystemStatus>,
    status_due: Timestamp,
    control_sample: Box<Control>,
    control_due: Timestamp,
    _held: Vec<HeldTopic>,
    _session: Session,
}

impl fmt::Debug for SupervisorTopics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "SupervisorTopics({} processes)", self.heartbeats.len())
    }
}

impl SupervisorTopics {
    /// Creates every topic that `processes` and the sensors of `config` can use. `generation` distinguishes this
    /// supervisor from those of the instance before it.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn open(
        session: Session,
        config: &Config,
        processes: &[&str],
        generation: u32,
    ) -> Result<Self, OpenError> {
        let mut heartbeats = Vec::new();
        for process in processes {
            // A process and its shadow publish on the same topic.
            heartbeats.push(session.input(topics::HEALTH, process)?.of_all_producers());
        }
        let held = hold_all(&session, config, processes)?;
        let events = session.output(topics::EVENT, "", generation)?;
        let status = session.output(topics::SYSTEM_STATUS, "", generation)?;
        let control = session.output(topics::CONTROL, "", generation)?;
        session.reserve()?;
        Ok(Self {
            heartbeats,
            events,
            status,
            control,
            status_sample: Box::default(),
            status_due: Timestamp::NEVER,
            control_sample: Box::default(),
            control_due: Timestamp::NEVER,
            _held: held,
            _session: session,
        })
    }

    /// Appends every heartbeat sent since the last call.
    pub fn read_heartbeats(&mut self, observations: &mut Vec<Observation>) {
        for (process, input) in self.heartbeats.iter_mut().enumerate() {
            input.each(|beat| {
                observations.push(Observation::Heartbeat {
                    process,
                    heartbeat: *beat.sample,
                    time: beat.header.publish,
                });
            });
        }
    }

    /// Publishes control record and status as `supervision` has them, if they are due or have changed.
    pub fn publish(&mut self, now: Timestamp, supervision: &Supervision, changed: bool) {
        // Before the status: the former owner is informed that it is none before any reader is.
        let before = *self.control_sample;
        supervision.write_control(&mut self.control_sample);
        if before != *self.control_sample || now >= self.control_due {
            self.control.send(SampleHeader::at(now), &self.control_sample);
            self.control_due = now.plus_seconds(STATUS_PERIOD_S);
        }
        if supervision.is_settling(now) {
            self.status_due = now.plus_seconds(SETTLING_LOOK_S);
        } else if changed || now >= self.status_due {
            supervision.write_status(&mut self.status_sample);
            self.status.send(SampleHeader::at(now), &self.status_sample);
            self.status_due = now.plus_seconds(STATUS_PERIOD_S);
        }
    }

    /// When something is to be published again, changed or not.
    pub fn due(&self) -> Timestamp {
        self.status_due.min(self.control_due)
    }

    /// Publishes the event, and logs it.
    pub fn raise(&mut self, now: Timestamp, event: &EventSample) {
        let text = event.text();
        match event.severity.get() {
            Severity::Debug | Severity::Info | Severity::Notice => tracing::info!(event = event.id, "{text}"),
            severity => tracing::warn!(event = event.id, severity = severity.name(), "{text}"),
        }
        let event = EventSample {
            process: Name::new(PROGRAM),
            ..*event
        };
        self.events.send(SampleHeader::at(now), &event);
    }

    /// Lets readers that came after the last event find it.
    pub fn announce(&self) {
        self.events.announce();
    }
}

/// One held topic per row of the table; of a family, one per process or sensor.
fn hold_all(session: &Session, config: &Config, processes: &[&str]) -> Result<Vec<HeldTopic>, OpenError> {
    let mut held = vec![
        session.hold(topics::VEHICLE_STATE, "")?,
        session.hold(topics::DESIRED_PATH, "")?,
        session.hold(topics::LOCAL_MAP, "")?,
        session.hold(topics::ROUTE, "")?,
        session.hold(topics::PROPOSAL, "")?,
        session.hold(topics::PROPOSAL_ANSWER, "")?,
        session.hold(topics::TRAJECTORY, "")?,
        session.hold(topics::APPROVED, "")?,
        session.hold(topics::RING, "")?,
        session.hold(topics::EVENT, "")?,
        session.hold(topics::SYSTEM_STATUS, "")?,
        session.hold(topics::CONTROL, "")?,
        session.hold(topics::LINK_STATUS, "")?,
        session.hold(topics::PARAMETERS, "")?,
        session.hold(topics::PARAMETER_CHANGE, "")?,
        session.hold(topics::SIM_TRUTH, "")?,
    ];
    for process in processes {
        held.push(session.hold(topics::HEALTH, process)?);
    }
    for sensor in &config.sensors {
        held.push(match sensor.output {
            SensorOutput::Cloud => session.hold(topics::RANGE_CLOUD, &sensor.name)?,
            SensorOutput::Scan => session.hold(topics::RANGE_SCAN, &sensor.name)?,
        });
    }
    Ok(held)
}
