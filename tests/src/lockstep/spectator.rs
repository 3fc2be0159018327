//! The topics that a test reads in a flight, and what it reads before the first sample.

use jink_runtime::lockstep::LocalBus;
use jink_runtime::{Input, OpenError, Output, Session};
use jink_shared_types::events::EventSample;
use jink_shared_types::link::LinkStatus;
use jink_shared_types::map::LocalMap;
use jink_shared_types::motion::{ApprovedTrajectory, Route};
use jink_shared_types::param_messages::ParameterChange;
use jink_shared_types::prevention::PreventedDemand;
use jink_shared_types::topics;

/// What a spectator reads.
pub(super) struct Spectator {
    pub(super) map: Input<LocalMap>,
    pub(super) route: Input<Route>,
    pub(super) approved: Input<ApprovedTrajectory>,
    pub(super) prevented: Input<PreventedDemand>,
    pub(super) link: Input<LinkStatus>,
    pub(super) events: Input<EventSample>,
    pub(super) change: Output<ParameterChange>,
}

impl Spectator {
    pub(super) fn new(bus: &LocalBus) -> Result<Self, OpenError> {
        let session = Session::local(bus, "cli");
        Ok(Self {
            map: session.input(topics::LOCAL_MAP, "")?,
            route: session.input(topics::ROUTE, "")?,
            approved: session.input(topics::APPROVED, "")?,
            prevented: session.input(topics::PREVENTED, "")?,
            link: session.input(topics::LINK_STATUS, "")?,
            events: session.input(topics::EVENT, "")?,
            change: session.output(topics::PARAMETER_CHANGE, "", 1)?,
        })
    }
}

/// What is read before anything has been said.
pub(super) struct Nothing {
    pub(super) map: Box<LocalMap>,
    pub(super) route: Box<Route>,
    pub(super) approved: Box<ApprovedTrajectory>,
    pub(super) prevented: PreventedDemand,
}
