//! The answers themselves: one pure step from questions, events and readings to messages.

use crate::commands::{Answerable, CommandAction, CommandContext, Component, MessageInterval, judge};
use crate::computer::{self, BoardReading};
use crate::files::{FileServer, Payload};
use crate::parameters::{Parameters, Reply};
use crate::texts::Texts;
use crate::version;
use jink_mavlink_link::encoding::Encoding;
use jink_mavlink_link::exchange;
use jink_mavlink_link::message::{Body, Command, CommandAck, Content};
use jink_mavlink_link::ticker::Ticker;
use jink_shared_types::events::{EventSample, GOAL_BLOCKED, LOOSENING_REFUSED, RESTART_REFUSED};
use jink_shared_types::ground::{ANY_LINK, Armed, GroundAction, GroundAnswer, GroundRequest};
use jink_shared_types::health::Name;
use jink_shared_types::param_messages::{ParameterChange, ParameterValues};
use jink_shared_types::params::ParamSet;
use jink_shared_types::{Coded, Flag, Timestamp};
use mavlink::dialect::{
    FILE_TRANSFER_PROTOCOL_DATA, MESSAGE_INTERVAL_DATA, MavMessage, MavParamError, MavResult,
};

/// The process that talks to the autopilot, as it stands in its events.
const GATEWAY: &str = "mavlink_gateway";
/// Rate of ONBOARD_COMPUTER_STATUS (Hz): 250 bytes that an autopilot may pass on to a radio, of figures that change slowly.
const COMPUTER_RATE_HZ: f64 = 0.2;
/// From the acknowledgement of a restart to the restart (s): the answer has left, and the heartbeat of a vehicle that is armed
/// right after it has arrived.
const RESTART_AFTER_S: f64 = 0.5;
/// Answers of one step at most, as many as the gateway's topic holds: further requests stay without one, and are asked again.
const ANSWERS: usize = 32;
/// Events of one step.
const EVENTS: usize = 4;

/// What goes into a step.
#[derive(Clone, Copy, Debug)]
pub struct Inputs<'a> {
    /// Messages for our components since the last step, oldest first.
    pub requests: &'a [GroundRequest],
    /// What has happened since the last step, with the names of the processes that report it.
    pub events: &'a [EventSample],
    /// The values that the parameter server has in force, if it has published since the last step.
    pub parameters: Option<&'a ParameterValues>,
    /// How whole numbers travel in parameter messages with the autopilot on the link.
    pub encoding: Encoding,
    /// A new reading of the board.
    pub board: Option<BoardReading>,
}

/// What a step gives out; made once and used again.
#[derive(Debug)]
pub struct Outputs {
    answers: Vec<GroundAnswer>,
    events: Vec<EventSample>,
    /// For the parameter server.
    pub parameter_change: Option<ParameterChange>,
}

impl Default for Outputs {
    fn default() -> Self {
        Self {
            answers: Vec::with_capacity(ANSWERS),
            events: Vec::with_capacity(EVENTS),
            parameter_change: None,
        }
    }
}

impl Outputs {
    /// For the gateway, in this order.
    pub fn answers(&self) -> &[GroundAnswer] {
        &self.answers
    }

    /// What happened here, for all who read `event`; it is on its way to the pilot already.
    pub fn events(&self) -> &[EventSample] {
        &self.events
    }

    fn clear(&mut self) {
        self.answers.clear();
        self.events.clear();
        self.parameter_change = None;
    }

    fn push(&mut self, answer: GroundAnswer) {
        if self.answers.len() < ANSWERS {
            self.answers.push(answer);
        }
    }

    fn send(&mut self, component: Component, link: Option<u8>, body: &Body) {
        self.push(GroundAnswer {
            message: exchange::of_body(body),
            of_computer: Flag::from(component == Component::Computer),
            link: link.unwrap_or(ANY_LINK),
            ..GroundAnswer::default()
        });
    }

    fn ask(&mut self, action: GroundAction, component: Component, period_us: u32) {
        self.push(GroundAnswer {
            action: Coded::new(action),
            of_computer: Flag::from(component == Component::Computer),
            period_us,
            link: ANY_LINK,
            ..GroundAnswer::default()
        });
    }
}

/// One request, understood.
#[derive(Clone, Copy, Debug)]
struct Question<'a> {
    request: &'a GroundRequest,
    component: Component,
}

impl Question<'_> {
    fn from(&self) -> (u8, u8) {
        (self.request.from_system, self.request.from_component)
    }

    fn link(&self) -> Option<u8> {
        Some(self.request.link)
    }

    fn armed(&self) -> Option<bool> {
        match self.request.armed.get() {
            Armed::Unknown => None,
            Armed::Disarmed => Some(false),
            Armed::Armed => Some(true),
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
    /// With these parameters in force, and a number that distinguishes this board from others (0 = unknown).
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

    /// One step: takes in what has come, gives out what is due. To be called whenever an input changes, and at the latest at
    /// [`Self::next_wake`].
    pub fn step(&mut self, now: Timestamp, inputs: &Inputs<'_>, outputs: &mut Outputs) {
        outputs.clear();
        self.parameters.set_encoding(inputs.encoding);
        if inputs.board.is_some() {
            self.board = inputs.board;
        }
        if let Some(values) = inputs.parameters {
            let value = self.parameters.take_values(values);
            reply(Reply { error: None, value }, outputs);
        }
        for event in inputs.events {
            // The planner reports a goal out of reach to the gateway, which knows whether it is still flown to.
            if event.id != GOAL_BLOCKED.id || event.process == Name::new(GATEWAY) {
                self.texts.push(now, event);
            }
        }
        for request in inputs.requests {
            let component = match request.for_computer.is_set() {
                true => Component::Computer,
                false => Component::Avoidance,
            };
            self.take(now, &Question { request, component }, outputs);
        }
        self.send_due(now, outputs);
    }

    /// Answers one question.
    fn take(&mut self, now: Timestamp, question: &Question<'_>, outputs: &mut Outputs) {
        let Some(content) = exchange::to_content(&question.request.message) else {
            return;
        };
        self.parameters
            .set_encoding(Encoding::of_flag(question.request.param_c_cast));
        if let Some(command) = Command::of(&content) {
            self.execute(now, &command, question, outputs);
            return;
        }
        let Content::Message(message) = &content else {
            return;
        };
        let (from, named) = (question.from(), question.request.named.is_set());
        match message {
            MavMessage::PARAM_REQUEST_LIST(_) => self.parameters.request_list(),
            MavMessage::PARAM_REQUEST_READ(request) => {
                reply(self.parameters.request_read(from, request, !named), outputs);
            }
            MavMessage::PARAM_SET(request) if named => {
                let is_disarmed = question.armed() == Some(false);
                let answer = self.parameters.request_set(now, from, request, is_disarmed);
                let denied = MavParamError::MAV_PARAM_ERROR_PERMISSION_DENIED;
                if answer.error.as_ref().is_some_and(|error| error.error == denied) {
                    let name = request.param_id.to_str().unwrap_or_default();
                    self.explain(
                        now,
                        &EventSample::new(&LOOSENING_REFUSED, name, [0.0; 2]),
                        outputs,
                    );
                }
                reply(answer, outputs);
            }
            MavMessage::FILE_TRANSFER_PROTOCOL(request) if named => {
                if let Some(payload) = self.files.take(now, from, &request.payload) {
                    outputs.send(
                        Component::Avoidance,
                        question.link(),
                        &file_transfer(from, payload),
                    );
                }
            }
            _ => {}
        }
    }

    /// Gives out what is due of itself: lines of text, and of answers that have many parts the next one.
    fn send_due(&mut self, now: Timestamp, outputs: &mut Outputs) {
        while let Some(line) = self.texts.next(now) {
            outputs.send(Component::Avoidance, None, &Body::Message(line));
        }
        let unanswered = self.parameters.give_up(now);
        for value in [unanswered, self.parameters.next(now)].into_iter().flatten() {
            let value = Body::Message(MavMessage::PARAM_VALUE(value));
            outputs.send(Component::Avoidance, None, &value);
        }
        outputs.parameter_change = self.parameters.ask(now);
        if let Some((to, payload)) = self.files.next(now) {
            outputs.send(Component::Avoidance, None, &file_transfer(to, payload));
        }
        let computer = self.board.is_some() && self.computer.as_mut().is_some_and(|due| due.take(now));
        if let Some(status) = self.computer_status(now).filter(|_| computer) {
            outputs.send(Component::Computer, None, &Body::Message(status));
        }
        if self.restart_at.is_some_and(|due| now >= due) {
            self.restart_at = None;
            outputs.ask(GroundAction::Restart, Component::Avoidance, 0);
        }
    }

    /// When something is due next. May lie in the past: then at once.
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

    fn execute(&mut self, now: Timestamp, command: &Command, question: &Question<'_>, outputs: &mut Outputs) {
        let component = question.component;
        let (mut result, action) = judge(
            command,
            &CommandContext {
                component,
                armed: question.armed(),
                restarting: self.restart_at.is_some(),
            },
        );
        // The board has not been read in the first second.
        if action == CommandAction::Say(Answerable::Computer) && self.board.is_none() {
            result = MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
        }
        let ack = Body::CommandAck(CommandAck {
            command: command.command,
            result,
            target_system: question.request.from_system,
            target_component: question.request.from_component,
        });
        outputs.send(component, question.link(), &ack);
        if let Some(message) = self.act(now, question, action, outputs) {
            outputs.send(component, question.link(), &Body::Message(message));
        }
    }

    /// Does it; returns the message that was asked for. What has a rate of its own only comes sooner.
    fn act(
        &mut self,
        now: Timestamp,
        question: &Question<'_>,
        action: CommandAction,
        outputs: &mut Outputs,
    ) -> Option<MavMessage> {
        let component = question.component;
        match action {
            CommandAction::Nothing => None,
            CommandAction::Restart => {
                self.restart_at = Some(now.plus_seconds(RESTART_AFTER_S));
                None
            }
            CommandAction::ExplainRefusal => {
                self.explain(now, &EventSample::new(&RESTART_REFUSED, "", [0.0; 2]), outputs);
                None
            }
            CommandAction::ReportInterval(id, message) => {
                let period_us = message.map_or(Some(0), |message| self.period_us(question, message));
                Some(MavMessage::MESSAGE_INTERVAL(MESSAGE_INTERVAL_DATA {
                    message_id: id as u16,
                    // 0 = it does not come by itself, -1 = it could, but does not.
                    interval_us: period_us
                        .map_or(-1, |period_us| i32::try_from(period_us).unwrap_or(i32::MAX)),
                }))
            }
            CommandAction::Set(message, interval) => {
                self.set_interval(message, interval, outputs);
                None
            }
            CommandAction::Say(message) => match message {
                Answerable::Heartbeat => {
                    outputs.ask(GroundAction::Heartbeat, component, 0);
                    None
                }
                Answerable::Obstacles => {
                    outputs.ask(GroundAction::Obstacles, component, 0);
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

    /// Says to the pilot and to all who read `event` why something was refused.
    fn explain(&mut self, now: Timestamp, event: &EventSample, outputs: &mut Outputs) {
        self.texts.push(now, event);
        if outputs.events.len() < EVENTS {
            outputs.events.push(*event);
        }
    }

    fn set_interval(&mut self, message: Answerable, interval: MessageInterval, outputs: &mut Outputs) {
        match (message, interval) {
            (Answerable::Obstacles, MessageInterval::Usual) => {
                outputs.ask(GroundAction::ObstaclePeriod, Component::Avoidance, 0);
            }
            (Answerable::Obstacles, MessageInterval::Period(period_s)) => {
                let period_us = micros(period_s);
                outputs.ask(GroundAction::ObstaclePeriod, Component::Avoidance, period_us);
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
    fn period_us(&self, question: &Question<'_>, message: Answerable) -> Option<u32> {
        let request = question.request;
        match message {
            Answerable::Heartbeat => Some(request.heartbeat_periods_us[question.component as usize]),
            Answerable::Timesync => Some(request.timesync_period_us),
            Answerable::Obstacles => Some(request.obstacle_period_us).filter(|period_us| *period_us > 0),
            Answerable::Computer => self.computer.map(|ticker| micros(ticker.period_s())),
            Answerable::Version | Answerable::Protocol | Answerable::Metadata => Some(0),
        }
    }
}

fn micros(period_s: f64) -> u32 {
    (period_s * 1e6).round() as u32
}

/// An error goes to who asked, a value to everybody.
fn reply(reply: Reply, outputs: &mut Outputs) {
    let error = reply.error.map(MavMessage::PARAM_ERROR);
    let value = reply.value.map(MavMessage::PARAM_VALUE);
    for message in [error, value].into_iter().flatten() {
        outputs.send(Component::Avoidance, None, &Body::Message(message));
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
