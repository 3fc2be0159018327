//! Mission upload and download, as PX4 implements them: MISSION_COUNT, one request per item, MISSION_ACK.

// Ground stations still send MISSION_REQUEST and MISSION_SET_CURRENT.
#![allow(deprecated)]

use super::link::{Link, Packet, Wire};
use super::mission::{ITEMS_MAX, Mission};
use mavlink::MavHeader;
use mavlink::dialect::{
    MISSION_ACK_DATA, MISSION_COUNT_DATA, MISSION_ITEM_INT_DATA, MISSION_REQUEST_INT_DATA, MavMessage,
    MavMissionResult, MavMissionType,
};

/// An unanswered request is repeated after this (us).
const REPEAT_US: u64 = 250_000;
/// An upload without any item for this long is given up (us).
const GIVE_UP_US: u64 = 5_000_000;

/// The other side of an exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Partner {
    link: Link,
    system: u8,
    component: u8,
}

impl Partner {
    fn of(packet_link: Link, header: &MavHeader) -> Self {
        Self {
            link: packet_link,
            system: header.system_id as u8,
            component: header.component_id,
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Upload {
    partner: Partner,
    count: u16,
    received_us: u64,
    asked_us: u64,
}

/// What a message of the protocol changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MissionChange {
    /// Nothing that matters to flight.
    None,
    /// The mission is another one now, received on this link.
    Replaced(Link),
    /// There is none any more.
    Cleared,
    /// The operator wants to go on at this item.
    JumpTo(usize),
}

/// The protocol's state.
#[derive(Clone, Debug)]
pub struct MissionProtocol {
    upload: Option<Upload>,
    received: Vec<MISSION_ITEM_INT_DATA>,
    /// The mission cannot be cleared now.
    pub keeps_mission: bool,
}

impl Default for MissionProtocol {
    fn default() -> Self {
        Self {
            upload: None,
            received: Vec::with_capacity(ITEMS_MAX),
            keeps_mission: false,
        }
    }
}

impl MissionProtocol {
    /// Takes a message of the protocol.
    pub fn receive(
        &mut self,
        now_us: u64,
        packet: &Packet,
        mission: &mut Mission,
        wire: &mut Wire,
        outbox: &mut Vec<Packet>,
    ) -> MissionChange {
        let partner = Partner::of(packet.link, &packet.header);
        match &packet.message {
            MavMessage::MISSION_COUNT(count) => {
                return self.begin(now_us, partner, count, mission, wire, outbox);
            }
            MavMessage::MISSION_ITEM_INT(item) => {
                return self.take(now_us, partner, item, mission, wire, outbox);
            }
            MavMessage::MISSION_CLEAR_ALL(clear) => {
                if clear.mission_type != MavMissionType::MAV_MISSION_TYPE_MISSION
                    && clear.mission_type != MavMissionType::MAV_MISSION_TYPE_ALL
                {
                    let refused = MavMissionResult::MAV_MISSION_UNSUPPORTED;
                    acknowledge(partner, refused, clear.mission_type, wire, outbox);
                    return MissionChange::None;
                }
                return self.clear(partner, clear.mission_type, mission, wire, outbox);
            }
            MavMessage::MISSION_REQUEST_LIST(list) => {
                let own = list.mission_type == MavMissionType::MAV_MISSION_TYPE_MISSION;
                let count = MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
                    count: if own { mission.len() as u16 } else { 0 },
                    target_system: partner.system,
                    target_component: partner.component,
                    mission_type: list.mission_type,
                    opaque_id: 0,
                });
                wire.send(outbox, partner.link, count);
            }
            MavMessage::MISSION_REQUEST_INT(request) => {
                send_item(partner, request.seq, mission, wire, outbox);
            }
            MavMessage::MISSION_REQUEST(request) => {
                send_item(partner, request.seq, mission, wire, outbox);
            }
            MavMessage::MISSION_SET_CURRENT(current) if usize::from(current.seq) < mission.len() => {
                return MissionChange::JumpTo(usize::from(current.seq));
            }
            _ => {}
        }
        MissionChange::None
    }

    /// Repeats requests and gives up on silence.
    pub fn step(&mut self, now_us: u64, wire: &mut Wire, outbox: &mut Vec<Packet>) {
        let Some(mut upload) = self.upload else { return };
        if now_us - upload.received_us > GIVE_UP_US {
            self.upload = None;
            let cancelled = MavMissionResult::MAV_MISSION_OPERATION_CANCELLED;
            let kind = MavMissionType::MAV_MISSION_TYPE_MISSION;
            acknowledge(upload.partner, cancelled, kind, wire, outbox);
        } else if now_us - upload.asked_us > REPEAT_US {
            upload.asked_us = now_us;
            self.upload = Some(upload);
            self.ask(upload.partner, wire, outbox);
        }
    }

    fn begin(
        &mut self,
        now_us: u64,
        partner: Partner,
        count: &MISSION_COUNT_DATA,
        mission: &mut Mission,
        wire: &mut Wire,
        outbox: &mut Vec<Packet>,
    ) -> MissionChange {
        use MavMissionResult as R;
        let kind = count.mission_type;
        let busy = self.upload.is_some_and(|upload| upload.partner != partner);
        let refused = if kind != MavMissionType::MAV_MISSION_TYPE_MISSION {
            Some(R::MAV_MISSION_UNSUPPORTED)
        } else if busy {
            Some(R::MAV_MISSION_DENIED)
        } else if usize::from(count.count) > ITEMS_MAX {
            Some(R::MAV_MISSION_NO_SPACE)
        } else {
            None
        };
        if let Some(reason) = refused {
            acknowledge(partner, reason, kind, wire, outbox);
            return MissionChange::None;
        }
        self.received.clear();
        if count.count == 0 {
            return self.clear(partner, kind, mission, wire, outbox);
        }
        self.upload = Some(Upload {
            partner,
            count: count.count,
            received_us: now_us,
            asked_us: now_us,
        });
        self.ask(partner, wire, outbox);
        MissionChange::None
    }

    fn take(
        &mut self,
        now_us: u64,
        partner: Partner,
        item: &MISSION_ITEM_INT_DATA,
        mission: &mut Mission,
        wire: &mut Wire,
        outbox: &mut Vec<Packet>,
    ) -> MissionChange {
        let kind = MavMissionType::MAV_MISSION_TYPE_MISSION;
        let Some(mut upload) = self.upload.filter(|upload| upload.partner == partner) else {
            return MissionChange::None;
        };
        // A repeated item was answered already; a skipped one is asked for again by the repetition.
        if usize::from(item.seq) != self.received.len() {
            return MissionChange::None;
        }
        if let Err(reason) = mission.check(item) {
            self.upload = None;
            acknowledge(partner, reason, kind, wire, outbox);
            return MissionChange::None;
        }
        self.received.push(item.clone());
        upload.received_us = now_us;
        upload.asked_us = now_us;
        self.upload = Some(upload);
        if self.received.len() < usize::from(upload.count) {
            self.ask(partner, wire, outbox);
            return MissionChange::None;
        }
        self.upload = None;
        mission.replace(&self.received);
        let done = MavMissionResult::MAV_MISSION_ACCEPTED;
        acknowledge(partner, done, kind, wire, outbox);
        MissionChange::Replaced(partner.link)
    }

    fn clear(
        &mut self,
        partner: Partner,
        kind: MavMissionType,
        mission: &mut Mission,
        wire: &mut Wire,
        outbox: &mut Vec<Packet>,
    ) -> MissionChange {
        self.upload = None;
        if self.keeps_mission {
            acknowledge(partner, MavMissionResult::MAV_MISSION_ERROR, kind, wire, outbox);
            return MissionChange::None;
        }
        mission.replace(&[]);
        acknowledge(
            partner,
            MavMissionResult::MAV_MISSION_ACCEPTED,
            kind,
            wire,
            outbox,
        );
        MissionChange::Cleared
    }

    fn ask(&self, partner: Partner, wire: &mut Wire, outbox: &mut Vec<Packet>) {
        let request = MavMessage::MISSION_REQUEST_INT(MISSION_REQUEST_INT_DATA {
            seq: self.received.len() as u16,
            target_system: partner.system,
            target_component: partner.component,
            mission_type: MavMissionType::MAV_MISSION_TYPE_MISSION,
        });
        wire.send(outbox, partner.link, request);
    }
}

fn send_item(partner: Partner, seq: u16, mission: &Mission, wire: &mut Wire, outbox: &mut Vec<Packet>) {
    let kind = MavMissionType::MAV_MISSION_TYPE_MISSION;
    match mission.get(usize::from(seq)) {
        Some(item) => {
            let mut item = item.clone();
            item.target_system = partner.system;
            item.target_component = partner.component;
            wire.send(outbox, partner.link, MavMessage::MISSION_ITEM_INT(item));
        }
        None => {
            let reason = MavMissionResult::MAV_MISSION_INVALID_SEQUENCE;
            acknowledge(partner, reason, kind, wire, outbox);
        }
    }
}

fn acknowledge(
    partner: Partner,
    result: MavMissionResult,
    mission_type: MavMissionType,
    wire: &mut Wire,
    outbox: &mut Vec<Packet>,
) {
    let message = MavMessage::MISSION_ACK(MISSION_ACK_DATA {
        target_system: partner.system,
        target_component: partner.component,
        mavtype: result,
        mission_type,
        opaque_id: 0,
    });
    wire.send(outbox, partner.link, message);
}
