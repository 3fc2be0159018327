//! What goes into a step of the gateway and what comes out.

use crate::note::Note;
use crate::ranges::{Arrived, SCANS};
use jink_mavlink_link::links::LinksReport;
use jink_mavlink_link::message::{Outgoing, Received};
use jink_shared_types::events::EventSample;
use jink_shared_types::ground::{GroundAnswer, GroundRequest};
use jink_shared_types::health::SystemStatus;
use jink_shared_types::link::LinkStatus;
use jink_shared_types::motion::ApprovedTrajectory;
use jink_shared_types::param_messages::ParameterValues;
use jink_shared_types::prevention::{PilotDemand, PreventedDemand};
use jink_shared_types::ring::SectorRing;
use jink_shared_types::vehicle::{DesiredPath, VehicleState};
use jink_shared_types::{Reading, SampleHeader, Timestamp};

/// Messages that fit into one step's output. Of its own accord the gateway sends at most twenty-two per step, eight obstacles as
/// points among them.
pub const OUTBOX: usize = 64;
/// Part of it that answers may fill: a flood of requests must not push out a setpoint.
const ANSWERS: usize = OUTBOX - 32;
/// Requests for the ground services that fit into one step's output, as many as their topic holds: further ones are asked again.
const REQUESTS: usize = 32;
/// Events that fit into one step's output.
const EVENTS: usize = 4;
/// Lines for the log that fit into one step's output; of a flood the first are enough.
const NOTES: usize = 16;

/// Inputs of a step.
#[derive(Clone, Copy, Debug)]
pub struct Inputs<'a> {
    /// Messages since the last step, oldest first.
    pub messages: &'a [Received],
    /// The links' own counters.
    pub link: LinksReport,
    /// What the guard lets through.
    pub approved: Reading<'a, ApprovedTrajectory>,
    /// What the guard leaves of a pilot's wish.
    pub prevented: Reading<'a, PreventedDemand>,
    /// What the guard sees.
    pub ring: Reading<'a, SectorRing>,
    /// Health of the whole.
    pub system: Reading<'a, SystemStatus>,
    /// What has happened in other processes since the last step.
    pub events: &'a [EventSample],
    /// The values that the parameter server has in force, if it has published since the last step.
    pub parameters: Option<&'a ParameterValues>,
    /// What the ground services answer since the last step, oldest first.
    pub answers: &'a [GroundAnswer],
}

/// Outputs of a step; made once and used again.
#[derive(Debug)]
pub struct Outputs {
    messages: Vec<Outgoing>,
    scans: Vec<Arrived>,
    events: Vec<EventSample>,
    notes: Vec<Note>,
    requests: Vec<GroundRequest>,
    /// Of a new trajectory that says what the autopilot flies already: nothing of it need be sent.
    pub reported: Option<SampleHeader>,
    /// The vehicle's state with its time of validity, if there is a new one.
    pub vehicle_state: Option<(VehicleState, Timestamp)>,
    /// What the autopilot wants, with its time of validity, if it was reported anew.
    pub desired_path: Option<(DesiredPath, Timestamp)>,
    /// What the pilot wants, with its time of validity, when that is due to be reported.
    pub pilot_demand: Option<(PilotDemand, Timestamp)>,
    /// The counters, when they are due for publication.
    pub link_status: Option<LinkStatus>,
    /// Somebody wants the gateway started anew, and may have it.
    pub restart: bool,
}

impl Default for Outputs {
    fn default() -> Self {
        Self {
            messages: Vec::with_capacity(OUTBOX),
            scans: Vec::with_capacity(SCANS),
            events: Vec::with_capacity(EVENTS),
            notes: Vec::with_capacity(NOTES),
            requests: Vec::with_capacity(REQUESTS),
            reported: None,
            vehicle_state: None,
            desired_path: None,
            pilot_demand: None,
            link_status: None,
            restart: false,
        }
    }
}

impl Outputs {
    /// Messages to be sent, in this order.
    pub fn messages(&self) -> &[Outgoing] {
        &self.messages
    }

    /// Ranges that have come over MAVLink, oldest first.
    pub fn scans(&self) -> &[Arrived] {
        &self.scans
    }

    /// What the gateway itself has to report.
    pub fn events(&self) -> &[EventSample] {
        &self.events
    }

    /// What is asked of our components, apart from flying.
    pub fn requests(&self) -> &[GroundRequest] {
        &self.requests
    }

    /// What is to be said in the log.
    pub fn notes(&self) -> &[Note] {
        &self.notes
    }

    pub(crate) fn clear(&mut self) {
        self.messages.clear();
        self.scans.clear();
        self.events.clear();
        self.notes.clear();
        self.requests.clear();
        self.reported = None;
        self.vehicle_state = None;
        self.desired_path = None;
        self.pilot_demand = None;
        self.link_status = None;
        self.restart = false;
    }

    /// Adds an answer, unless the answers' part is full.
    pub(crate) fn answer(&mut self, message: Outgoing) {
        if self.messages.len() < ANSWERS {
            self.messages.push(message);
        }
    }

    /// Adds a message that the gateway sends of its own accord.
    pub(crate) fn send(&mut self, message: Outgoing) {
        if self.messages.len() < OUTBOX {
            self.messages.push(message);
        }
    }

    /// Adds a request for the ground services, unless there are too many.
    pub(crate) fn ask(&mut self, request: GroundRequest) {
        if self.requests.len() < REQUESTS {
            self.requests.push(request);
        }
    }

    pub(crate) fn note(&mut self, note: Note) {
        if self.notes.len() < NOTES {
            self.notes.push(note);
        }
    }

    pub(crate) fn see(&mut self, arrived: Arrived) {
        if self.scans.len() < SCANS {
            self.scans.push(arrived);
        }
    }

    pub(crate) fn report(&mut self, event: EventSample) {
        if self.events.len() < EVENTS {
            self.events.push(event);
        }
    }
}
