//! Whatever is asked of our components: commands, parameters, files. The state is at the [`Desk`](crate::desk::Desk).

use super::Gateway;
use crate::avoidance::{AVOIDANCE_RATE_HZ, COMPUTER_RATE_HZ};
use crate::commands::{Circumstances, Command, Deed, Rhythm, Role, Topic};
use crate::computer::BoardReading;
use crate::files::FileServer;
use crate::io::Outputs;
use crate::parameters::Reply;
use crate::version;
use jink_mavlink_link::message::{Body, CommandAck, Content, Destination, Outgoing, Received};
use jink_shared_types::Timestamp;
use jink_shared_types::events::RESTART_REFUSED;
use jink_shared_types::params::ParamSet;
use jink_shared_types::tuning::ParameterValues;
use mavlink::dialects::ardupilotmega::{
    FILE_TRANSFER_PROTOCOL_DATA, MESSAGE_INTERVAL_DATA, MavMessage, MavResult,
};

impl Gateway {
    /// With these values in force instead of the defaults.
    #[must_use]
    pub fn with_params(mut self, params: &ParamSet) -> Self {
        self.desk.parameters.begin_with(params);
        self.desk.files = FileServer::of(params);
        self
    }

    /// With a number that tells this board from others.
    #[must_use]
    pub fn with_board_id(mut self, id: u64) -> Self {
        self.desk.board_id = id;
        self
    }

    /// The parameters in force.
    pub fn params(&self) -> &ParamSet {
        self.desk.parameters.set()
    }

    /// Takes the values that the parameter server has in force, and answers who has asked for a change.
    pub(super) fn take_parameters(
        &mut self,
        now: Timestamp,
        values: &ParameterValues,
        outputs: &mut Outputs,
    ) {
        let answer = self.desk.parameters.take_values(values);
        self.reply(
            now,
            Reply {
                error: None,
                value: answer,
            },
            outputs,
        );
    }

    /// A new reading of the board.
    pub fn notice_board(&mut self, reading: BoardReading) {
        self.desk.notice_board(reading);
    }

    /// Answers what is asked of one of our components; `false` if nothing is.
    pub(super) fn serve(&mut self, now: Timestamp, received: &Received, outputs: &mut Outputs) -> bool {
        let from = (received.header.system_id as u8, received.header.component_id);
        if let Some(command) = Command::of(&received.content) {
            let role = self.role(command.target_component);
            let is_ours = self.latch.system_id(now) == Some(command.target_system);
            return match role.filter(|_| is_ours) {
                Some(role) => {
                    self.obey(now, &command, role, received, outputs);
                    true
                }
                None => false,
            };
        }
        let Content::Message(message) = &received.content else {
            return false;
        };
        match message {
            MavMessage::PARAM_REQUEST_LIST(request) => {
                let us = self.names_us(now, request.target_system, request.target_component);
                if us.is_some() {
                    self.desk.parameters.request_list();
                }
                us.is_some()
            }
            MavMessage::PARAM_REQUEST_READ(request) => {
                let us = self.names_us(now, request.target_system, request.target_component);
                if let Some(us) = us {
                    let reply = self
                        .desk
                        .parameters
                        .request_read(from, request, us == Named::WithAll);
                    self.reply(now, reply, outputs);
                }
                us.is_some()
            }
            MavMessage::PARAM_SET(request) => {
                let us = self.names_us(now, request.target_system, request.target_component);
                if us == Some(Named::Alone) {
                    let reply = self.desk.parameters.request_set(now, from, request);
                    self.reply(now, reply, outputs);
                }
                us.is_some()
            }
            MavMessage::FILE_TRANSFER_PROTOCOL(request) => {
                let us = self.names_us(now, request.target_system, request.target_component);
                if us == Some(Named::Alone)
                    && let Some(payload) = self.desk.files.take(now, from, &request.payload)
                {
                    outputs.answer(Outgoing {
                        to: Destination::Link(received.link),
                        ..self.outgoing(now, file_transfer(from, payload))
                    });
                }
                us.is_some()
            }
            _ => false,
        }
    }

    /// What is due of the answers that come in many pieces, and what the board is told.
    pub(super) fn serve_due(&mut self, now: Timestamp, outputs: &mut Outputs) {
        let unanswered = self.desk.parameters.give_up(now);
        for value in [unanswered, self.desk.parameters.next(now)].into_iter().flatten() {
            let message = MavMessage::PARAM_VALUE(value);
            outputs.send(self.outgoing(now, Body::Message(message)));
        }
        outputs.parameter_change = self.desk.parameters.ask(now);
        if let Some((to, payload)) = self.desk.files.next(now) {
            outputs.send(self.outgoing(now, file_transfer(to, payload)));
        }
        if let Some(component_id) = self.config.computer_component_id
            && let Some(status) = self.desk.computer_due(now)
        {
            outputs.send(Outgoing {
                component_id,
                ..self.outgoing(now, Body::Message(status))
            });
        }
        outputs.restart = self.desk.restart_due(now);
    }

    /// Which of our components has this id.
    fn role(&self, component_id: u8) -> Option<Role> {
        if component_id == self.config.component_id {
            Some(Role::Avoidance)
        } else if Some(component_id) == self.config.computer_component_id {
            Some(Role::Computer)
        } else {
            None
        }
    }

    /// Whether a message is for the component that has parameters and files.
    fn names_us(&self, now: Timestamp, system: u8, component: u8) -> Option<Named> {
        let ours = self.latch.system_id(now)?;
        match (system, component) {
            (system, component) if system == ours && component == self.config.component_id => {
                Some(Named::Alone)
            }
            (system, 0) if system == ours || system == 0 => Some(Named::WithAll),
            _ => None,
        }
    }

    fn reply(&self, now: Timestamp, reply: Reply, outputs: &mut Outputs) {
        let error = reply.error.map(MavMessage::PARAM_ERROR);
        let value = reply.value.map(MavMessage::PARAM_VALUE);
        for message in [error, value].into_iter().flatten() {
            outputs.answer(self.outgoing(now, Body::Message(message)));
        }
    }

    fn obey(
        &mut self,
        now: Timestamp,
        command: &Command,
        role: Role,
        received: &Received,
        outputs: &mut Outputs,
    ) {
        let (mut result, deed) = command.judge(&Circumstances {
            role,
            armed: self.desk.armed,
            restarting: self.desk.is_restarting(),
        });
        // Nobody has read the board in the gateway's first second.
        if deed == Deed::Say(Topic::Computer) && self.desk.computer(now).is_none() {
            result = MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
        }
        if let Deed::Assist(on) = deed
            && self.assist.choose(on).is_err()
        {
            result = MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
        }
        let ack = Body::CommandAck(CommandAck {
            command: command.command,
            result,
            target_system: received.header.system_id as u8,
            target_component: received.header.component_id,
        });
        let message = self.act(now, role, deed, outputs);
        for body in [Some(ack), message.map(Body::Message)].into_iter().flatten() {
            outputs.answer(Outgoing {
                component_id: command.target_component,
                to: Destination::Link(received.link),
                ..self.outgoing(now, body)
            });
        }
    }

    /// Does it, and answers with the message that was asked for. What has a beat of its own only comes sooner.
    fn act(&mut self, now: Timestamp, role: Role, deed: Deed, outputs: &mut Outputs) -> Option<MavMessage> {
        match deed {
            // What has become of it shows in the next step.
            Deed::Nothing | Deed::Assist(_) => None,
            Deed::Restart => {
                self.desk.restart(now);
                None
            }
            Deed::ExplainRefusal => {
                self.tell(now, &RESTART_REFUSED, 0.0, outputs);
                None
            }
            Deed::TellInterval(id, topic) => {
                let period_s = topic.map_or(Some(0.0), |topic| self.period_s(now, role, topic));
                Some(MavMessage::MESSAGE_INTERVAL(MESSAGE_INTERVAL_DATA {
                    message_id: id as u16,
                    // 0 = it does not come by itself, -1 = it could, but does not.
                    interval_us: period_s.map_or(-1, |period_s| (period_s * 1e6).round() as i32),
                }))
            }
            Deed::Set(topic, rhythm) => {
                self.set_rhythm(topic, rhythm);
                None
            }
            Deed::Say(topic) => match topic {
                Topic::Heartbeat => {
                    self.heartbeats.ask(now, role == Role::Computer);
                    None
                }
                Topic::Obstacles => {
                    self.obstacles.hasten(now);
                    None
                }
                Topic::Timesync => None,
                Topic::Computer => self.desk.computer(now),
                Topic::Version => {
                    let encoding = self.desk.parameters.encoding();
                    Some(version::version(role, encoding, self.desk.board_id))
                }
                Topic::Protocol => Some(version::protocol()),
                Topic::Metadata => Some(version::metadata(now, self.desk.files.general_crc())),
            },
        }
    }

    fn set_rhythm(&mut self, topic: Topic, rhythm: Rhythm) {
        match (topic, rhythm) {
            (Topic::Obstacles, Rhythm::Usual) => self.obstacles_period_s = None,
            (Topic::Obstacles, Rhythm::Period(period_s)) => self.obstacles_period_s = Some(period_s),
            (Topic::Computer, rhythm) => self.desk.set_computer_rhythm(rhythm),
            _ => {}
        }
    }

    /// `None`: it was silenced.
    fn period_s(&self, now: Timestamp, role: Role, topic: Topic) -> Option<f64> {
        match (topic, role) {
            (Topic::Heartbeat, Role::Avoidance) => Some(1.0 / AVOIDANCE_RATE_HZ),
            (Topic::Heartbeat, Role::Computer) => Some(1.0 / COMPUTER_RATE_HZ),
            (Topic::Timesync, _) => Some(self.timesync.period_s()),
            (Topic::Obstacles, _) => self.obstacles_hz(now).map(|rate_hz| 1.0 / rate_hz),
            (Topic::Computer, _) => self.desk.computer_period_s(),
            (Topic::Version | Topic::Protocol | Topic::Metadata, _) => Some(0.0),
        }
    }
}

/// How a message names the component that has parameters and files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Named {
    Alone,
    WithAll,
}

fn file_transfer((target_system, target_component): (u8, u8), payload: crate::files::Payload) -> Body {
    Body::Message(MavMessage::FILE_TRANSFER_PROTOCOL(FILE_TRANSFER_PROTOCOL_DATA {
        target_network: 0,
        target_system,
        target_component,
        payload,
    }))
}
