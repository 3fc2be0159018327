//! What a script sends to an autopilot, and how it reads what comes back: for flights in lock-step, in tests and examples.

use crate::link::{Link, Packet};
use mavlink::MavHeader;
use mavlink::dialect::*;
use nalgebra::Vector3;

/// A packet of whoever is at the other end of `link`.
pub fn packet(link: Link, system: u32, component: u8, message: MavMessage) -> Packet {
    Packet {
        link,
        header: MavHeader {
            system_id: system,
            component_id: component,
            sequence: 0,
        },
        message,
    }
}

/// COMMAND_LONG to the autopilot.
pub fn command(command: MavCmd, parameters: [f32; 7]) -> MavMessage {
    let [param1, param2, param3, param4, param5, param6, param7] = parameters;
    MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        param1,
        param2,
        param3,
        param4,
        param5,
        param6,
        param7,
        command,
        target_system: 1,
        target_component: 1,
        confirmation: 0,
    })
}

/// SET_MESSAGE_INTERVAL: message `id` every `interval_us`.
pub fn message_interval(id: u32, interval_us: f32) -> MavMessage {
    command(
        MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
        [id as f32, interval_us, 0.0, 0.0, 0.0, 0.0, 0.0],
    )
}

/// The result on `link` of `command`, if it is acknowledged in `received`.
pub fn result_of(received: &[Packet], link: Link, command: MavCmd) -> Option<MavResult> {
    received.iter().find_map(|packet| match &packet.message {
        MavMessage::COMMAND_ACK(ack) if packet.link == link && ack.command == command => Some(ack.result),
        _ => None,
    })
}

/// PARAM_SET of a number; `value` as it travels.
pub fn parameter(name: &str, value: f32, param_type: MavParamType) -> MavMessage {
    MavMessage::PARAM_SET(PARAM_SET_DATA {
        param_value: value,
        target_system: 1,
        target_component: 1,
        param_id: name.into(),
        param_type,
    })
}

/// MISSION_COUNT: the beginning of an upload.
pub fn mission_count(items: usize) -> MavMessage {
    MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
        count: items as u16,
        target_system: 1,
        target_component: 1,
        ..MISSION_COUNT_DATA::default()
    })
}

/// How an upload of `items` goes on after `received`: with an item to send, or with the result as an error; `None`: it waits.
pub fn uploaded(
    received: &[Packet],
    items: &[MISSION_ITEM_INT_DATA],
) -> Option<Result<MavMessage, MavMissionResult>> {
    let mut wanted = None;
    for packet in received {
        match &packet.message {
            MavMessage::MISSION_REQUEST_INT(request) => wanted = Some(request.seq),
            MavMessage::MISSION_ACK(ack) => return Some(Err(ack.mavtype)),
            _ => {}
        }
    }
    let seq = wanted?;
    let mut item = items.get(usize::from(seq))?.clone();
    (item.seq, item.target_system, item.target_component) = (seq, 1, 1);
    Some(Ok(MavMessage::MISSION_ITEM_INT(item)))
}

/// SET_POSITION_TARGET_LOCAL_NED of position, velocity and acceleration (local NED; m, m/s, m/s^2) with the type mask `mask`.
pub fn setpoint(
    mask: u16,
    [position, velocity, acceleration]: [Vector3<f64>; 3],
) -> SET_POSITION_TARGET_LOCAL_NED_DATA {
    let [x, y, z] = position.map(|c| c as f32).into();
    let [vx, vy, vz] = velocity.map(|c| c as f32).into();
    let [afx, afy, afz] = acceleration.map(|c| c as f32).into();
    SET_POSITION_TARGET_LOCAL_NED_DATA {
        x,
        y,
        z,
        vx,
        vy,
        vz,
        afx,
        afy,
        afz,
        type_mask: PositionTargetTypemask::from_bits_retain(mask),
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
        target_system: 1,
        target_component: 1,
        ..SET_POSITION_TARGET_LOCAL_NED_DATA::default()
    }
}
