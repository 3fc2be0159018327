//! The answers themselves: one pure step from questions, events and readings to messages.

use crate::commands::{Answerable, Command, CommandAction, CommandContext, Component, MessageInterval};
use crate::computer::{self, BoardReading};
use crate::files::{FileServer, Payload};
use crate::parameters::{Parameters, Reply};
use crate::texts::Texts;
use crate::version;
use jink_mavlink_link::encoding::Encoding;
use jink_mavlink_link::message::{Body, CommandAck, Content};
use jink_mavlink_link::ticker::Ticker;
use jink_shared_types::Timestamp;
use jink_shared_types::events::{EventSample, RESTART_REFUSED};
use jink_shared_types::params::ParamSet;
use jink_shared_types::tuning::{ParameterChange, ParameterValues};
use mavlink::dialects::ardupilotmega::{
    FILE_TRANSFER_PROTOCOL_DATA, MESSAGE_INTERVAL_DATA, MavMessage, MavResult,
};

/// Rate of ONBOARD_COMPUTER_STATUS (Hz): 250 bytes that an autopilot may pass on to a radio, of figures that change slowly.
const COMPUTER_RATE_HZ: f64 = 0.2;
/// From the acknowledgement of a restart to the restart (s): the answer has left, and the heartbeat of a vehicle that is armed
/// right after it has arrived.
const RESTART_AFTER_S: f64 = 0.5;
/// Messages of one call at most: an acknowledgement, an error and a value; or four parts of a line with what else is due.
const MESSAGES: usize = 16;

/// How a message names the component that it is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Named {
    /// By its number.
    Alone,
    /// As one of all.
    WithAll,
}

/// A message for one of our components.
#[derive(Clone, Copy, Debug)]
pub struct Question<'a> {
    /// What it says.
    pub content: &'a Content,
    /// System and component that sent it.
    pub from: (u8, u8),
    /// The link on which it came in.
    pub link: u8,
    /// The component of ours that answers.
    pub component: Component,
    /// How it is named.
    pub named: Named,
}

/// Whether `content` is a message that is answered here, if it is addressed to one of our components.
pub fn is_question(content: &Content) -> bool {
    matches!(
        content,
        Content::UnknownCommand { .. }
            | Content::Message(
                MavMessage::COMMAND_LONG(_)
                    | MavMessage::COMMAND_INT(_)
                    | MavMessage::PARAM_REQUEST_LIST(_)
                    | MavMessage::PARAM_REQUEST_READ(_)
                    | MavMessage::PARAM_SET(_)
                    | MavMessage::FILE_TRANSFER_PROTOCOL(_)
            )
    )
}

/// What the gateway knows and answers depend on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkFacts {
    /// How integers of parameters travel with this autopilot.
    pub encoding: Encoding,
    /// Whether the vehicle is armed; `None` before the first heartbeat.
    pub armed: Option<bool>,
    /// Period of OBSTACLE_DISTANCE (s); `None`: it is not sent.
    pub obstacles_period_s: Option<f64>,
    /// Period of TIMESYNC (s).
    pub timesync_period_s: f64,
    /// Periods of HEARTBEAT (s), of components 196 and 191.
    pub heartbeat_periods_s: [f64; 2],
}

/// What the gateway itself is asked to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GatewayRequest {
    /// The next heartbeat of this component is sent at once.
    SendHeartbeat(Component),
    /// The next OBSTACLE_DISTANCE is sent at once.
    SendObstacles,
    /// The period of OBSTACLE_DISTANCE (s); `None`: the usual one.
    ObstaclesPeriod(Option<f64>),
    /// The gateway is started anew, if the vehicle is disarmed by then.
    Restart,
}

/// A message of one of our components.
#[derive(Clone, Debug)]
pub struct Answer {
    /// Who says it.
    pub component: Component,
    /// The link it goes to; `None`: where its addressee is, or everybody.
    pub link: Option<u8>,
    /// What it says.
    pub body: Body,
}

/// What one call gives out; made once and used again.
#[derive(Debug)]
pub struct Answers {
    /// To be sent, in this order.
    pub messages: Vec<Answer>,
    /// For the gateway.
    pub requests: Vec<GatewayRequest>,
    /// For the parameter server.
    pub parameter_change: Option<ParameterChange>,
    /// What happened, for all who read `event`; it is on its way to the pilot already.
    pub events: Vec<EventSample>,
}

impl Default for Answers {
    fn default() -> Self {
        Self {
            messages: Vec::with_capacity(MESSAGES),
            requests: Vec::with_capacity(2),
            parameter_change: None,
            events: Vec::with_capacity(1),
        }
    }
}

impl Answers {
    /// Forgets what the last call gave out.
    pub fn clear(&mut self) {
        self.messages.clear();
        self.requests.clear();
        self.parameter_change = None;
        self.events.clear();
    }

    fn push(&mut self, component: Component, link: Option<u8>, body: Body) {
        if self.messages.len() < MESSAGES {
            self.messages.push(Answer {
                component,
                link,
                body,
            });
        }
    }
}

/// State of all that is asked for.
#[derive(Debug)]
pub struct GroundServices {
    parameters: Parameters,
    files: FileServer,
    texts: Texts,
    /// A number of this board, 0 = unknown.
    board_id: u64,
    board: Option<BoardReading>,
    computer: Option<Ticker>,
    restart_at: Option<Timestamp>,
}

impl GroundServices {
    /// With these parameters in force, and a number that tells this board from others (0 = unknown).
    pub fn new(params: &ParamSet, board_id: u64) -> Self {
        Self {
            parameters: Parameters::new(params),
            files: FileServer::of(params),
            texts: Texts::default(),
            board_id,
            board: None,
            computer: Some(Ticker::new(COMPUTER_RATE_HZ)),
            restart_at: None,
        }
    }

    /// The parameters in force.
    pub fn params(&self) -> &ParamSet {
        self.parameters.set()
    }

    /// Takes the values that the parameter server has in force, and answers who has asked for a change.
    pub fn take_parameters(&mut self, values: &ParameterValues, answers: &mut Answers) {
        let value = self.parameters.take_values(values);
        reply(Reply { error: None, value }, answers);
    }

    /// Takes a new reading of the board.
    pub fn take_board(&mut self, reading: BoardReading) {
        self.board = Some(reading);
    }

    /// Takes an event for the pilot.
    pub fn take_event(&mut self, now: Timestamp, event: &EventSample) {
        self.texts.push(now, event);
    }

    /// Answers one question ([`is_question`]).
    pub fn take(
        &mut self,
        now: Timestamp,
        question: &Question<'_>,
        facts: &LinkFacts,
        answers: &mut Answers,
    ) {
        self.parameters.set_encoding(facts.encoding);
        if let Some(command) = Command::of(question.content) {
            self.execute(now, &command, question, facts, answers);
            return;
        }
        let Content::Message(message) = question.content else {
            return;
        };
        let alone = question.named == Named::Alone;
        match message {
            MavMessage::PARAM_REQUEST_LIST(_) => self.parameters.request_list(),
            MavMessage::PARAM_REQUEST_READ(request) => {
                reply(
                    self.parameters.request_read(question.from, request, !alone),
                    answers,
                );
            }
            MavMessage::PARAM_SET(request) if alone => {
                reply(self.parameters.request_set(now, question.from, request), answers);
            }
            MavMessage::FILE_TRANSFER_PROTOCOL(request) if alone => {
                if let Some(payload) = self.files.take(now, question.from, &request.payload) {
                    answers.push(
                        Component::Avoidance,
                        Some(question.link),
                        file_transfer(question.from, payload),
                    );
                }
            }
            _ => {}
        }
    }

    /// Gives out what is due of itself: lines of text, and of answers that have many parts the next one.
    pub fn send_due(&mut self, now: Timestamp, facts: &LinkFacts, answers: &mut Answers) {
        while let Some(line) = self.texts.next(now) {
            answers.push(Component::Avoidance, None, Body::Message(line));
        }
        self.parameters.set_encoding(facts.encoding);
        let unanswered = self.parameters.give_up(now);
        for value in [unanswered, self.parameters.next(now)].into_iter().flatten() {
            answers.push(
                Component::Avoidance,
                None,
                Body::Message(MavMessage::PARAM_VALUE(value)),
            );
        }
        answers.parameter_change = self.parameters.ask(now);
        if let Some((to, payload)) = self.files.next(now) {
            answers.push(Component::Avoidance, None, file_transfer(to, payload));
        }
        let computer = self.board.is_some() && self.computer.as_mut().is_some_and(|due| due.take(now));
        if let Some(status) = self.computer_status(now).filter(|_| computer) {
            answers.push(Component::Computer, None, Body::Message(status));
        }
        if self.restart_at.is_some_and(|due| now >= due) {
            self.restart_at = None;
            answers.requests.push(GatewayRequest::Restart);
        }
    }

    /// When something is due next.
    pub fn next_wake(&self) -> Timestamp {
        let computer = self.computer.filter(|_| self.board.is_some());
        [
            computer.map(|computer| computer.due()),
            self.texts.next_wake(),
            self.parameters.next_wake(),
            self.files.next_wake(),
            self.restart_at,
        ]
        .into_iter()
        .flatten()
        .min()
        .unwrap_or(Timestamp::from_ns(u64::MAX))
    }

    /// ONBOARD_COMPUTER_STATUS, as far as the board is known.
    fn computer_status(&self, now: Timestamp) -> Option<MavMessage> {
        self.board.as_ref().map(|board| computer::message(now, board))
    }

    fn execute(
        &mut self,
        now: Timestamp,
        command: &Command,
        question: &Question<'_>,
        facts: &LinkFacts,
        answers: &mut Answers,
    ) {
        let component = question.component;
        let (mut result, action) = command.judge(&CommandContext {
            component,
            armed: facts.armed,
            restarting: self.restart_at.is_some(),
        });
        // The board has not been read in the first second.
        if action == CommandAction::Say(Answerable::Computer) && self.board.is_none() {
            result = MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
        }
        let ack = Body::CommandAck(CommandAck {
            command: command.command,
            result,
            target_system: question.from.0,
            target_component: question.from.1,
        });
        answers.push(component, Some(question.link), ack);
        if let Some(message) = self.act(now, component, action, facts, answers) {
            answers.push(component, Some(question.link), Body::Message(message));
        }
    }

    /// Does it; returns the message that was asked for. What has a rate of its own only comes sooner.
    fn act(
        &mut self,
        now: Timestamp,
        component: Component,
        action: CommandAction,
        facts: &LinkFacts,
        answers: &mut Answers,
    ) -> Option<MavMessage> {
        match action {
            CommandAction::Nothing => None,
            CommandAction::Restart => {
                self.restart_at = Some(now.plus_seconds(RESTART_AFTER_S));
                None
            }
            CommandAction::ExplainRefusal => {
                let event = EventSample::new(&RESTART_REFUSED, "", [0.0; 2]);
                self.texts.push(now, &event);
                answers.events.push(event);
                None
            }
            CommandAction::ReportInterval(id, message) => {
                let period_s = message.map_or(Some(0.0), |message| self.period_s(component, message, facts));
                Some(MavMessage::MESSAGE_INTERVAL(MESSAGE_INTERVAL_DATA {
                    message_id: id as u16,
                    // 0 = it does not come by itself, -1 = it could, but does not.
                    interval_us: period_s.map_or(-1, |period_s| (period_s * 1e6).round() as i32),
                }))
            }
            CommandAction::Set(message, interval) => {
                self.set_interval(message, interval, answers);
                None
            }
            CommandAction::Say(message) => match message {
                Answerable::Heartbeat => {
                    answers.requests.push(GatewayRequest::SendHeartbeat(component));
                    None
                }
                Answerable::Obstacles => {
                    answers.requests.push(GatewayRequest::SendObstacles);
                    None
                }
                Answerable::Timesync => None,
                Answerable::Computer => self.computer_status(now),
                Answerable::Version => Some(version::version(
                    component,
                    self.parameters.encoding(),
                    self.board_id,
                )),
                Answerable::Protocol => Some(version::protocol()),
                Answerable::Metadata => Some(version::metadata(now, self.files.general_crc())),
            },
        }
    }

    fn set_interval(&mut self, message: Answerable, interval: MessageInterval, answers: &mut Answers) {
        match (message, interval) {
            (Answerable::Obstacles, MessageInterval::Usual) => {
                answers.requests.push(GatewayRequest::ObstaclesPeriod(None));
            }
            (Answerable::Obstacles, MessageInterval::Period(period_s)) => {
                answers
                    .requests
                    .push(GatewayRequest::ObstaclesPeriod(Some(period_s)));
            }
            (Answerable::Computer, interval) => {
                self.computer = match interval {
                    MessageInterval::Usual => Some(Ticker::new(COMPUTER_RATE_HZ)),
                    MessageInterval::Period(period_s) => Some(Ticker::new(1.0 / period_s)),
                    MessageInterval::Silent => None,
                };
            }
            _ => {}
        }
    }

    /// `None`: it is not sent.
    fn period_s(&self, component: Component, message: Answerable, facts: &LinkFacts) -> Option<f64> {
        match message {
            Answerable::Heartbeat => Some(facts.heartbeat_periods_s[component as usize]),
            Answerable::Timesync => Some(facts.timesync_period_s),
            Answerable::Obstacles => facts.obstacles_period_s,
            Answerable::Computer => self.computer.map(|ticker| ticker.period_s()),
            Answerable::Version | Answerable::Protocol | Answerable::Metadata => Some(0.0),
        }
    }
}

/// An error goes to who asked, a value to everybody.
fn reply(reply: Reply, answers: &mut Answers) {
    let error = reply.error.map(MavMessage::PARAM_ERROR);
    let value = reply.value.map(MavMessage::PARAM_VALUE);
    for message in [error, value].into_iter().flatten() {
        answers.push(Component::Avoidance, None, Body::Message(message));
    }
}

fn file_transfer((target_system, target_component): (u8, u8), payload: Payload) -> Body {
    Body::Message(MavMessage::FILE_TRANSFER_PROTOCOL(FILE_TRANSFER_PROTOCOL_DATA {
        target_network: 0,
        target_system,
        target_component,
        payload,
    }))
}
