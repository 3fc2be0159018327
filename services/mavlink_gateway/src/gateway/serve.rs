//! Whatever is asked of our components, apart from flying: passed on to the [`GroundServices`], and their answers sent.

use super::Gateway;
use crate::avoidance::{AVOIDANCE_RATE_HZ, COMPUTER_RATE_HZ};
use crate::io::Outputs;
use jink_ground_services::computer::BoardReading;
use jink_ground_services::{
    Command, Component, GatewayRequest, GroundServices, LinkFacts, Named, Question, is_question,
};
use jink_mavlink_link::autopilot_type::AutopilotType;
use jink_mavlink_link::encoding::Encoding;
use jink_mavlink_link::message::{Body, CommandAck, Content, Destination, Outgoing, Received};
use jink_shared_types::Timestamp;
use jink_shared_types::params::ParamSet;
use jink_shared_types::tuning::ParameterValues;
use mavlink::dialects::ardupilotmega::{MavCmd, MavResult};

impl Gateway {
    /// With these values in force instead of the defaults, on the board with this number (0 = unknown).
    #[must_use]
    pub fn with_params(mut self, params: &ParamSet, board_id: u64) -> Self {
        self.ground = GroundServices::new(params, board_id);
        self
    }

    /// The parameters in force.
    pub fn params(&self) -> &ParamSet {
        self.ground.params()
    }

    /// Takes the values that the parameter server has in force, and answers who has asked for a change.
    pub(super) fn take_parameters(
        &mut self,
        now: Timestamp,
        values: &ParameterValues,
        outputs: &mut Outputs,
    ) {
        self.answers.clear();
        self.ground.take_parameters(values, &mut self.answers);
        self.pass_on(now, Outputs::answer, outputs);
    }

    /// A new reading of the board.
    pub fn notice_board(&mut self, reading: BoardReading) {
        self.ground.take_board(reading);
    }

    /// Answers what is asked of one of our components; `false` if nothing is.
    pub(super) fn serve(&mut self, now: Timestamp, received: &Received, outputs: &mut Outputs) -> bool {
        if !is_question(&received.content) {
            return false;
        }
        let Some((component, named)) = self.addressed(now, &received.content) else {
            return false;
        };
        if component == Component::Avoidance && self.switch_assist(now, received, outputs) {
            return true;
        }
        let question = Question {
            content: &received.content,
            from: (received.header.system_id as u8, received.header.component_id),
            link: received.link,
            component,
            named,
        };
        self.answers.clear();
        let facts = self.link_facts(now);
        self.ground.take(now, &question, &facts, &mut self.answers);
        self.pass_on(now, Outputs::answer, outputs);
        true
    }

    /// What is due of the answers that come in many pieces, and what the board is told.
    pub(super) fn serve_due(&mut self, now: Timestamp, outputs: &mut Outputs) {
        self.answers.clear();
        let facts = self.link_facts(now);
        self.ground.send_due(now, &facts, &mut self.answers);
        self.pass_on(now, Outputs::send, outputs);
        outputs.parameter_change = self.answers.parameter_change;
    }

    /// Sends the answers, and does what the ground services ask for.
    fn pass_on(&mut self, now: Timestamp, push: fn(&mut Outputs, Outgoing), outputs: &mut Outputs) {
        for answer in self.answers.messages.drain(..) {
            let component_id = match answer.component {
                Component::Avoidance => Some(self.config.component_id),
                Component::Computer => self.config.computer_component_id,
            };
            let Some(component_id) = component_id else {
                continue;
            };
            let to = match answer.link {
                Some(link) => Destination::Link(link),
                None => super::destination(&answer.body, self.latch.link()),
            };
            push(
                outputs,
                Outgoing {
                    component_id,
                    to,
                    ..super::outgoing_of(&self.latch, &self.config, now, answer.body)
                },
            );
        }
        for event in self.answers.events.drain(..) {
            outputs.tell(event);
        }
        for index in 0..self.answers.requests.len() {
            match self.answers.requests[index] {
                GatewayRequest::SendHeartbeat(component) => {
                    self.heartbeats.ask(now, component == Component::Computer);
                }
                GatewayRequest::SendObstacles => self.obstacles.hasten(now),
                GatewayRequest::ObstaclesPeriod(period_s) => self.obstacles_period_s = period_s,
                // A vehicle that was armed meanwhile keeps its gateway.
                GatewayRequest::Restart => outputs.restart = self.vehicle.armed() == Some(false),
            }
        }
    }

    /// Which of our components is addressed, and how. Commands to all components are for the autopilot to answer.
    fn addressed(&self, now: Timestamp, content: &Content) -> Option<(Component, Named)> {
        let ours = self.latch.system_id(now)?;
        let target = content.target();
        if Command::of(content).is_some() {
            return (target.system_id == u32::from(ours))
                .then(|| self.component(target.component_id))?
                .map(|component| (component, Named::Alone));
        }
        // Parameters and files are those of one component.
        let is_ours = target.system_id == u32::from(ours);
        match target.component_id {
            id if is_ours && id == self.config.component_id => Some((Component::Avoidance, Named::Alone)),
            0 if is_ours || target.system_id == 0 => Some((Component::Avoidance, Named::WithAll)),
            _ => None,
        }
    }

    /// Which of our components has this id.
    fn component(&self, component_id: u8) -> Option<Component> {
        if component_id == self.config.component_id {
            Some(Component::Avoidance)
        } else if Some(component_id) == self.config.computer_component_id {
            Some(Component::Computer)
        } else {
            None
        }
    }

    /// MAV_CMD_USER_1, 1: a pilot is to be assisted, 0: not any more ([`crate::assist`]); ACCEPTED, or TEMPORARILY_REJECTED with a
    /// text that says why; other numbers DENIED. `false` if it is another command.
    fn switch_assist(&mut self, now: Timestamp, received: &Received, outputs: &mut Outputs) -> bool {
        let Some(command) = Command::of(&received.content) else {
            return false;
        };
        if command.command != MavCmd::MAV_CMD_USER_1 as u16 {
            return false;
        }
        let result = match command.params[0] {
            // What has become of it shows in the next step.
            on @ (0.0 | 1.0) => match self.assist.choose(on == 1.0) {
                Ok(()) => MavResult::MAV_RESULT_ACCEPTED,
                Err(_) => MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
            },
            _ => MavResult::MAV_RESULT_DENIED,
        };
        let ack = Body::CommandAck(CommandAck {
            command: command.command,
            result,
            target_system: received.header.system_id as u8,
            target_component: received.header.component_id,
        });
        outputs.answer(Outgoing {
            to: Destination::Link(received.link),
            ..self.outgoing(now, ack)
        });
        true
    }

    /// What answers depend on.
    fn link_facts(&self, now: Timestamp) -> LinkFacts {
        LinkFacts {
            encoding: match self.vehicle.make() {
                Some(AutopilotType::ArduPilot) => Encoding::CCast,
                _ => Encoding::Bytewise,
            },
            armed: self.vehicle.armed(),
            obstacles_period_s: self.obstacles_hz(now).map(|rate_hz| 1.0 / rate_hz),
            timesync_period_s: self.timesync.period_s(),
            heartbeat_periods_s: [1.0 / AVOIDANCE_RATE_HZ, 1.0 / COMPUTER_RATE_HZ],
        }
    }
}
