//! The ground services as a process: woken by requests and by parameters, and while something is under way.

use crate::board::Board;
use crate::{GroundServices, Inputs, Outputs};
use jink_mavlink_link::encoding::Encoding;
use jink_runtime::{Cycle, Input, Output, Ports, Service, StartError, Wake};
use jink_shared_types::events::EventSample;
use jink_shared_types::ground::{GroundAnswer, GroundRequest};
use jink_shared_types::hash;
use jink_shared_types::health::Name;
use jink_shared_types::link::LinkStatus;
use jink_shared_types::param_messages::{ParameterChange, ParameterValues};
use jink_shared_types::{SampleHeader, Timestamp, topics};
use std::fmt;

/// Requests and events handled in one cycle: what the buffer of a topic holds.
const INPUTS_MAX: usize = 32;
/// How often events are looked for (s): nobody is woken by them, and a pilot reads four lines a second.
const EVENTS_EVERY_S: f64 = 0.05;
/// How far back from its start events are taken (s): longer than the gap that a killed process leaves, and shorter than what a
/// pilot takes for old.
const LOOK_BACK_S: f64 = 0.5;
/// Where Linux keeps a number of the installation.
const MACHINE_ID: &str = "/etc/machine-id";

/// The service: see [`crate`].
pub struct GroundServicesService {
    services: GroundServices,
    outputs: Outputs,
    requests: Input<GroundRequest>,
    asked: Vec<GroundRequest>,
    events: Input<EventSample>,
    happened: Vec<EventSample>,
    link: Input<LinkStatus>,
    parameters: Input<ParameterValues>,
    /// Sequence number of the parameters taken last.
    parameters_taken: Option<u64>,
    answers: Output<GroundAnswer>,
    changes: Output<ParameterChange>,
    /// Nobody's need: without it the board stays unknown.
    board: Option<Board>,
    /// This process, as it stands in its events.
    process: Name,
    /// When this process began to listen.
    begin: Timestamp,
}

impl fmt::Debug for GroundServicesService {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("GroundServicesService")
    }
}

impl Service for GroundServicesService {
    const PROGRAM: &'static str = "ground_services";
    const REPLAYS: bool = false;

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        Ok(Self {
            services: GroundServices::new(&ports.param_store().load().0, board_id()),
            outputs: Outputs::default(),
            requests: ports.trigger(topics::GROUND_REQUEST)?,
            asked: Vec::with_capacity(INPUTS_MAX),
            events: ports.input(topics::EVENT)?,
            happened: Vec::with_capacity(INPUTS_MAX),
            link: ports.input(topics::LINK_STATUS)?,
            parameters: ports.trigger(topics::PARAMETERS)?,
            parameters_taken: None,
            answers: ports.output(topics::GROUND_ANSWER)?,
            changes: ports.output(topics::PARAMETER_CHANGE)?,
            // What else the board does is no part of a simulated flight.
            board: (!ports.clock().is_virtual())
                .then(|| Board::watch().ok())
                .flatten(),
            process: Name::new(&ports.setup().process),
            begin: ports.clock().now(),
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        let now = cycle.now;
        self.asked.clear();
        let (asked, begin) = (&mut self.asked, self.begin);
        self.requests.each(|request| {
            // The instance before may have done what was asked of it.
            if request.header.publish >= begin && asked.len() < INPUTS_MAX {
                asked.push(*request.sample);
            }
        });
        self.happened.clear();
        let (happened, process) = (&mut self.happened, self.process);
        let since = begin.plus_seconds(-LOOK_BACK_S);
        self.events.each(|event| {
            // Its own are on their way already, and what came long before it has been said by the instance before.
            let is_new = event.sample.process != process && event.header.publish >= since;
            if is_new && happened.len() < INPUTS_MAX {
                happened.push(*event.sample);
            }
        });
        let parameters = self.parameters.latest(now).fresh();
        let parameters = parameters.filter(|values| self.parameters_taken != Some(values.header.sequence));
        if let Some(values) = &parameters {
            self.parameters_taken = Some(values.header.sequence);
        }
        self.link.latest(now);
        let inputs = Inputs {
            requests: &self.asked,
            events: &self.happened,
            parameters: parameters.map(|values| values.sample),
            encoding: self.link.newest().map_or_else(Encoding::default, |link| {
                Encoding::of_flag(link.sample.param_c_cast)
            }),
            board: self.board.as_ref().and_then(Board::update),
        };
        self.services.step(now, &inputs, &mut self.outputs);
        for answer in self.outputs.answers() {
            self.answers.send(SampleHeader::at(now), answer);
        }
        if let Some(change) = &self.outputs.parameter_change {
            self.changes.send(SampleHeader::at(now), change);
        }
        for event in self.outputs.events() {
            cycle.events.publish(now, event);
        }
        Wake::at(self.services.next_wake().min(now.plus_seconds(EVENTS_EVERY_S)))
    }
}

/// A number of this board that does not give the installation's own away, which is to be kept confidential; 0 = unknown.
fn board_id() -> u64 {
    let salted = |id: String| hash::text(hash::text(hash::START, "jink board"), id.trim());
    std::fs::read_to_string(MACHINE_ID).map_or(0, salted)
}
