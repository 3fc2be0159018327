//! The senders on the links, and what they send.

use jink_mavlink_link::message::{COMPONENT_AUTOPILOT, Content, Received};
use jink_mavlink_link::vehicle_selector::is_autopilot;
use jink_shared_types::Timestamp;
use mavlink::Message;
use mavlink::dialect::{MavAutopilot, MavMessage, MavType};

/// Senders remembered; later ones do not change a finding.
const SENDERS: usize = 64;

/// One sender.
#[derive(Clone, Debug, PartialEq)]
pub struct ObservedSender {
    /// System.
    pub system_id: u32,
    /// Component of it.
    pub component_id: u8,
    /// The link on which it was received first.
    pub link: u8,
    /// The types in its heartbeat; `None` before one was received.
    pub kind: Option<(MavType, MavAutopilot)>,
    /// Its heartbeat is that of an autopilot.
    pub is_autopilot: bool,
    /// The setpoints it sends, if it does: the name of the message.
    pub setpoints: Option<&'static str>,
    /// Its last message.
    pub last: Timestamp,
}

impl ObservedSender {
    /// In words: `a ground station (255/190)`.
    pub fn words(&self) -> String {
        let what = match self.kind {
            Some((MavType::MAV_TYPE_GCS, _)) => "a ground station",
            Some((MavType::MAV_TYPE_GIMBAL, _)) => "a gimbal",
            Some((MavType::MAV_TYPE_CAMERA, _)) => "a camera",
            Some((MavType::MAV_TYPE_ADSB, _)) => "an ADS-B receiver",
            Some((MavType::MAV_TYPE_ONBOARD_CONTROLLER, _)) => "an on-board computer",
            Some(_) if self.is_autopilot => "an autopilot",
            _ => "somebody",
        };
        format!("{what} ({}/{})", self.system_id, self.component_id)
    }
}

/// All senders received so far.
#[derive(Clone, Debug)]
pub struct Observations {
    senders: Vec<ObservedSender>,
}

impl Default for Observations {
    fn default() -> Self {
        Self {
            senders: Vec::with_capacity(SENDERS),
        }
    }
}

impl Observations {
    /// Takes note of one message.
    pub fn take(&mut self, received: &Received) {
        let header = received.header;
        let is_it = |sender: &ObservedSender| {
            (sender.system_id, sender.component_id) == (header.system_id, header.component_id)
        };
        let known = self.senders.iter().position(is_it);
        let at = match known {
            Some(at) => at,
            None if self.senders.len() < SENDERS => {
                self.senders.push(ObservedSender {
                    system_id: header.system_id,
                    component_id: header.component_id,
                    link: received.link,
                    kind: None,
                    is_autopilot: false,
                    setpoints: None,
                    last: received.time,
                });
                self.senders.len() - 1
            }
            None => return,
        };
        let sender = &mut self.senders[at];
        sender.last = received.time;
        if let Content::Message(message) = &received.content {
            if let MavMessage::HEARTBEAT(heartbeat) = message {
                sender.kind = Some((heartbeat.mavtype, heartbeat.autopilot));
                sender.is_autopilot = header.component_id == COMPONENT_AUTOPILOT && is_autopilot(heartbeat);
            }
            if is_setpoint(message, header.component_id) {
                sender.setpoints = Some(message.message_name());
            }
        }
    }

    /// All of them, in the order in which they were first received.
    pub fn senders(&self) -> &[ObservedSender] {
        &self.senders
    }

    /// Autopilots on links where one is looked for.
    pub fn autopilots(&self, is_looked_for_on: impl Fn(u8) -> bool) -> impl Iterator<Item = &ObservedSender> {
        self.senders
            .iter()
            .filter(move |sender| sender.is_autopilot && is_looked_for_on(sender.link))
    }
}

/// Whether an autopilot would fly it. PX4 itself sends its desired path in the message of the answers.
#[allow(deprecated)]
fn is_setpoint(message: &MavMessage, component_id: u8) -> bool {
    match message {
        MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(_)
        | MavMessage::TRAJECTORY_REPRESENTATION_BEZIER(_) => component_id != COMPONENT_AUTOPILOT,
        MavMessage::SET_POSITION_TARGET_LOCAL_NED(_)
        | MavMessage::SET_POSITION_TARGET_GLOBAL_INT(_)
        | MavMessage::SET_ATTITUDE_TARGET(_) => true,
        _ => false,
    }
}
