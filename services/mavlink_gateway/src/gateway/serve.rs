//! Whatever is asked of our components, apart from flying: passed on to the ground services, and their answers sent.
//!
//! | | |
//! |---|---|
//! | a command, a request for parameters or files, addressed to one of us | published for the ground services, with what the answer depends on |
//! | their answer | sent as the component that was asked, if it is one of [`ANSWERED`]: they never send a setpoint |
//! | MAV_CMD_USER_1 | answered here ([`crate::assist`]) |

#![allow(deprecated)] // Ground stations still ask for PROTOCOL_VERSION.

use super::Gateway;
use crate::avoidance::{AVOIDANCE_RATE_HZ, COMPUTER_RATE_HZ};
use crate::io::Outputs;
use jink_mavlink_link::autopilot_type::AutopilotType;
use jink_mavlink_link::encoding::Encoding;
use jink_mavlink_link::exchange;
use jink_mavlink_link::message::{Body, Command, CommandAck, Content, Destination, Outgoing, Received};
use jink_shared_types::ground::{ANY_LINK, Armed, GroundAction, GroundAnswer, GroundRequest};
use jink_shared_types::link::LINKS;
use jink_shared_types::params::ParamSet;
use jink_shared_types::{Coded, Flag, Timestamp};
use mavlink::MessageData;
use mavlink::dialect::{
    AUTOPILOT_VERSION_DATA, COMMAND_ACK_DATA, COMPONENT_METADATA_DATA, FILE_TRANSFER_PROTOCOL_DATA,
    MESSAGE_INTERVAL_DATA, MavCmd, MavMessage, MavResult, ONBOARD_COMPUTER_STATUS_DATA, PARAM_ERROR_DATA,
    PARAM_VALUE_DATA, PROTOCOL_VERSION_DATA, STATUSTEXT_DATA,
};

/// What the ground services may have sent.
const ANSWERED: [u32; 10] = [
    COMMAND_ACK_DATA::ID,
    PARAM_VALUE_DATA::ID,
    PARAM_ERROR_DATA::ID,
    FILE_TRANSFER_PROTOCOL_DATA::ID,
    STATUSTEXT_DATA::ID,
    ONBOARD_COMPUTER_STATUS_DATA::ID,
    AUTOPILOT_VERSION_DATA::ID,
    PROTOCOL_VERSION_DATA::ID,
    COMPONENT_METADATA_DATA::ID,
    MESSAGE_INTERVAL_DATA::ID,
];
/// Limits of the period of OBSTACLE_DISTANCE (us). Wider than what the ground services grant (33 to 200 ms): whatever they ask for,
/// it neither crowds a serial line for long nor falls below what an autopilot believes in.
const OBSTACLE_PERIODS_US: [u32; 2] = [20_000, (1e6 / super::OBSTACLES_LEAST_HZ) as u32];

/// Whether `content` is a message that is answered by whom it is addressed to.
fn is_question(content: &Content) -> bool {
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

/// Which of our components a message is for, and how it says so.
#[derive(Clone, Copy, Debug)]
struct Addressed {
    component_id: u8,
    /// By its number, not as one of all.
    named: bool,
}

impl Gateway {
    /// With these values in force instead of the defaults.
    #[must_use]
    pub fn with_params(mut self, params: &ParamSet) -> Self {
        self.params.clone_from(params);
        self
    }

    /// The parameters in force.
    pub fn params(&self) -> &ParamSet {
        &self.params
    }

    /// Passes on what is asked of one of our components; `false` if nothing is.
    pub(super) fn serve(&mut self, now: Timestamp, received: &Received, outputs: &mut Outputs) -> bool {
        if !is_question(&received.content) {
            return false;
        }
        let Some(addressed) = self.addressed(now, &received.content) else {
            return false;
        };
        let for_computer = addressed.component_id != self.config.component_id;
        if !for_computer && self.switch_assist(now, received, outputs) {
            return true;
        }
        let period_us = |rate_hz: f64| (1e6 / rate_hz).round() as u32;
        outputs.ask(GroundRequest {
            message: exchange::of_content(&received.content),
            obstacle_period_us: self.obstacles_hz(now).map_or(0, period_us),
            timesync_period_us: (self.timesync.period_s() * 1e6).round() as u32,
            heartbeat_periods_us: [AVOIDANCE_RATE_HZ, COMPUTER_RATE_HZ].map(period_us),
            from_system: received.header.system_id as u8,
            from_component: received.header.component_id,
            link: received.link,
            for_computer: Flag::from(for_computer),
            named: Flag::from(addressed.named),
            armed: Coded::new(match self.vehicle.armed() {
                None => Armed::Unknown,
                Some(false) => Armed::Disarmed,
                Some(true) => Armed::Armed,
            }),
            param_c_cast: self.encoding().flag(),
            ..GroundRequest::default()
        });
        true
    }

    /// Sends what the ground services answer, and does what they ask for.
    pub(super) fn answer(&mut self, now: Timestamp, answer: &GroundAnswer, outputs: &mut Outputs) {
        let of_computer = answer.of_computer.is_set();
        match answer.action.get() {
            GroundAction::Send => self.send_answer(now, answer, outputs),
            GroundAction::Heartbeat => self.heartbeats.ask(now, of_computer),
            GroundAction::Obstacles => self.obstacles.schedule_early(now),
            GroundAction::ObstaclePeriod => {
                let [shortest, longest] = OBSTACLE_PERIODS_US;
                let asked = (answer.period_us > 0).then(|| answer.period_us.clamp(shortest, longest));
                self.obstacles_period_s = asked.map(|period_us| f64::from(period_us) * 1e-6);
            }
            // A vehicle that was armed meanwhile keeps its gateway.
            GroundAction::Restart => outputs.restart |= self.vehicle.armed() == Some(false),
        }
    }

    fn send_answer(&self, now: Timestamp, answer: &GroundAnswer, outputs: &mut Outputs) {
        let component_id = match answer.of_computer.is_set() {
            false => Some(self.config.component_id),
            true => self.config.computer_component_id,
        };
        let body = Some(&answer.message)
            .filter(|message| ANSWERED.contains(&message.id))
            .and_then(exchange::to_body);
        let (Some(component_id), Some(body)) = (component_id, body) else {
            return;
        };
        let to = match answer.link {
            ANY_LINK => super::destination(&body, self.selector.link()),
            link if usize::from(link) < LINKS => Destination::Link(link),
            _ => return,
        };
        outputs.answer(Outgoing {
            component_id,
            to,
            ..self.outgoing(now, body)
        });
    }

    /// How whole numbers travel in parameter messages with this autopilot.
    pub(super) fn encoding(&self) -> Encoding {
        match self.vehicle.make() {
            Some(AutopilotType::ArduPilot) => Encoding::CCast,
            Some(AutopilotType::Px4) | None => Encoding::Bytewise,
        }
    }

    /// Which of our components is addressed, and how. Commands to all components are for the autopilot to answer.
    fn addressed(&self, now: Timestamp, content: &Content) -> Option<Addressed> {
        let ours = self.our_system(now)?;
        let target = content.target();
        let is_ours = target.system_id == u32::from(ours);
        let named = |component_id| Addressed {
            component_id,
            named: true,
        };
        let avoidance = self.config.component_id;
        if Command::of(content).is_some() {
            let ours = [Some(avoidance), self.config.computer_component_id];
            let is_one = is_ours && ours.contains(&Some(target.component_id));
            return is_one.then(|| named(target.component_id));
        }
        // Parameters and files are those of one component.
        match target.component_id {
            id if is_ours && id == avoidance => Some(named(id)),
            0 if is_ours || target.system_id == 0 => Some(Addressed {
                component_id: avoidance,
                named: false,
            }),
            _ => None,
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
}
