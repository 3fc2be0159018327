//! Mission upload: count, items on request, acknowledgement. Source: MAVLink mission protocol.

use mavlink::dialect::{MISSION_COUNT_DATA, MISSION_ITEM_INT_DATA, MavMessage, MavMissionType};

/// Silence after which the count is announced again (s): a lost announcement or a lost request.
const SILENCE_S: f64 = 1.5;

/// One upload.
#[derive(Clone, Debug)]
pub(super) struct Upload {
    items: Vec<MISSION_ITEM_INT_DATA>,
    target_system: u8,
    received_s: f64,
    result: Option<u32>,
}

impl Upload {
    pub(super) fn new(items: Vec<MISSION_ITEM_INT_DATA>, target_system: u8) -> Self {
        Self {
            items,
            target_system,
            received_s: f64::NEG_INFINITY,
            result: None,
        }
    }

    /// MAV_MISSION_RESULT once the autopilot has answered; 0 = accepted.
    pub(super) fn result(&self) -> Option<u32> {
        self.result
    }

    /// The announcement, at the start and after silence.
    pub(super) fn announce(&mut self, now_s: f64) -> Option<MavMessage> {
        if now_s - self.received_s < SILENCE_S {
            return None;
        }
        self.received_s = now_s;
        Some(MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
            count: self.items.len() as u16,
            target_system: self.target_system,
            target_component: 1,
            mission_type: MavMissionType::MAV_MISSION_TYPE_MISSION,
            ..MISSION_COUNT_DATA::default()
        }))
    }

    /// Answers the autopilot's requests. PX4 still asks for the first item with the deprecated MISSION_REQUEST.
    #[allow(deprecated)]
    pub(super) fn receive(&mut self, now_s: f64, message: &MavMessage) -> Option<MavMessage> {
        let wanted = match message {
            MavMessage::MISSION_REQUEST_INT(request) => request.seq,
            MavMessage::MISSION_REQUEST(request) => request.seq,
            MavMessage::MISSION_ACK(ack) if self.received_s.is_finite() => {
                self.result = Some(ack.mavtype as u32);
                return None;
            }
            _ => return None,
        };
        self.received_s = now_s;
        let item = self.items.get(usize::from(wanted))?;
        Some(MavMessage::MISSION_ITEM_INT(item.clone()))
    }
}
