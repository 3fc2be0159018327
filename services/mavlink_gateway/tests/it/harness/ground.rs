//! The ground services beside a gateway, as their process runs them.

use jink_ground_services::computer::BoardReading;
use jink_ground_services::{GroundServices, Inputs, Outputs};
use jink_mavlink_link::encoding::Encoding;
use jink_shared_types::Timestamp;
use jink_shared_types::events::EventSample;
use jink_shared_types::health::Name;
use jink_shared_types::param_messages::ParameterValues;
use jink_shared_types::params::ParamSet;

pub struct Ground {
    pub services: GroundServices,
    pub outputs: Outputs,
    /// What is read of the board next.
    pub board: Option<BoardReading>,
    encoding: Encoding,
}

impl Ground {
    pub fn new() -> Self {
        Self {
            services: GroundServices::new(&ParamSet::default(), 0),
            outputs: Outputs::default(),
            board: None,
            encoding: Encoding::default(),
        }
    }

    /// One step with what a step of the gateway has put out, and with the events of others.
    pub fn step(
        &mut self,
        now: Timestamp,
        gateway: &jink_mavlink_gateway::Outputs,
        events: &[EventSample],
        parameters: Option<&ParameterValues>,
    ) {
        if let Some(status) = &gateway.link_status {
            self.encoding = Encoding::of_flag(status.param_c_cast);
        }
        let mut events = events.to_vec();
        events.extend(gateway.events().iter().map(|event| EventSample {
            process: Name::new("mavlink_gateway"),
            ..*event
        }));
        let inputs = Inputs {
            requests: gateway.requests(),
            events: &events,
            parameters,
            encoding: self.encoding,
            board: self.board.take(),
        };
        self.services.step(now, &inputs, &mut self.outputs);
    }
}
