//! Messages as an autopilot, a ground station or a madman would send them.

use super::dice::Dice;
use jink_mavlink_gateway::{COMPONENT_AUTOPILOT, Content, ProfileName};
use jink_mavlink_link::frame::Splitter;
use mavlink::dialect::*;
use mavlink::types::CharArray;
use mavlink::{Message, calculate_crc};

/// Modes of PX4: position, take-off, hold, mission, return, land, offboard.
const PX4_MODES: [u32; 7] = [
    3 << 16,
    4 << 16 | 2 << 24,
    4 << 16 | 3 << 24,
    4 << 16 | 4 << 24,
    4 << 16 | 5 << 24,
    4 << 16 | 6 << 24,
    6 << 16,
];
/// Modes of ArduCopter: stabilize, auto, guided, loiter, return, land.
const COPTER_MODES: [u32; 6] = [0, 3, 4, 5, 6, 9];
/// Of mission items, and of the points of a desired path.
const COMMANDS: [MavCmd; 6] = [
    MavCmd::MAV_CMD_NAV_WAYPOINT,
    MavCmd::MAV_CMD_NAV_TAKEOFF,
    MavCmd::MAV_CMD_NAV_LAND,
    MavCmd::MAV_CMD_NAV_LOITER_UNLIM,
    MavCmd::MAV_CMD_DO_CHANGE_SPEED,
    MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH,
];

/// A frame of MAVLink 2 whose checksum fits, with any payload.
pub fn frame(id: u32, (system, component): (u8, u8), payload: &[u8]) -> Vec<u8> {
    let payload = &payload[..payload.len().min(255)];
    let mut frame = vec![0xfd, payload.len() as u8, 0, 0, 0, system, component];
    frame.extend_from_slice(&id.to_le_bytes()[..3]);
    frame.extend_from_slice(payload);
    let crc = calculate_crc(&frame[1..], MavMessage::extra_crc(id));
    frame.extend_from_slice(&crc.to_le_bytes());
    frame
}

/// Of any kind that the dialect knows, with any payload: as its bytes are understood.
pub fn any(dice: &mut Dice<'_>, from: (u8, u8)) -> Option<Content> {
    let id = dice.known_id();
    let len = usize::from(dice.byte());
    let bytes = frame(id, from, dice.take(len));
    let mut splitter = Splitter::new();
    splitter.load_datagram(&bytes);
    let frame = splitter.next_frame().expect("its checksum fits");
    Content::of(&frame)
}

pub fn heartbeat(dice: &mut Dice<'_>, profile: ProfileName) -> MavMessage {
    let copter = profile == ProfileName::ArdupilotGuided;
    let custom_mode = match (dice.below(8), copter) {
        (0, _) => dice.u32(),
        (_, false) => dice.pick(&PX4_MODES),
        (_, true) => dice.pick(&COPTER_MODES),
    };
    let mut base_mode = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
    base_mode.set(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED, !dice.once_in(4));
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode,
        mavtype: MavType::MAV_TYPE_QUADROTOR,
        autopilot: if copter {
            MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA
        } else {
            MavAutopilot::MAV_AUTOPILOT_PX4
        },
        base_mode,
        system_status: MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    })
}

/// A position with any numbers in it.
pub fn position(dice: &mut Dice<'_>, time_boot_ms: u32) -> MavMessage {
    MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
        time_boot_ms,
        x: dice.number(),
        y: dice.number(),
        z: dice.number(),
        vx: dice.number(),
        vy: dice.number(),
        vz: dice.number(),
    })
}

pub fn attitude(dice: &mut Dice<'_>, time_boot_ms: u32) -> MavMessage {
    let (q1, q4) = match dice.once_in(4) {
        true => (dice.number(), dice.number()),
        false => {
            let half_rad = dice.metres() * 0.2;
            (half_rad.cos() as f32, half_rad.sin() as f32)
        }
    };
    MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
        time_boot_ms,
        q1,
        q4,
        yawspeed: if dice.once_in(8) { dice.number() } else { 0.0 },
        ..ATTITUDE_QUATERNION_DATA::default()
    })
}

/// A desired path as PX4 sends it, or with anything in its first three points.
pub fn wish(dice: &mut Dice<'_>) -> MavMessage {
    let unset = [f32::NAN; 5];
    let mut data = TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA {
        time_usec: dice.u64(),
        pos_x: unset,
        pos_y: unset,
        pos_z: unset,
        vel_x: unset,
        vel_y: unset,
        vel_z: unset,
        acc_x: unset,
        acc_y: unset,
        acc_z: unset,
        pos_yaw: unset,
        vel_yaw: unset,
        command: [u16::MAX; 5],
        valid_points: if dice.once_in(8) { dice.byte() } else { 3 },
    };
    for i in 0..3 {
        let given = dice.byte();
        let fields = [
            &mut data.pos_x[i],
            &mut data.pos_y[i],
            &mut data.pos_z[i],
            &mut data.vel_x[i],
            &mut data.vel_y[i],
            &mut data.vel_z[i],
            &mut data.pos_yaw[i],
            &mut data.vel_yaw[i],
        ];
        for (bit, field) in fields.into_iter().enumerate() {
            // Positions are given more often than not.
            if (given >> bit & 1 == 1) != (bit < 3) {
                *field = dice.number();
            }
        }
        data.command[i] = match dice.below(4) {
            0 => dice.u16(),
            1 => dice.pick(&COMMANDS) as u16,
            _ => u16::MAX,
        };
    }
    MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(data)
}

/// What else an autopilot says that the gateway listens to.
pub fn telemetry(dice: &mut Dice<'_>, time_boot_ms: u32) -> MavMessage {
    match dice.below(10) {
        0 => MavMessage::ALTITUDE(ALTITUDE_DATA {
            bottom_clearance: dice.number(),
            ..ALTITUDE_DATA::default()
        }),
        1 => MavMessage::HOME_POSITION(HOME_POSITION_DATA {
            z: dice.number(),
            ..HOME_POSITION_DATA::default()
        }),
        2 => MavMessage::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA {
            landed_state: dice.pick(&[
                MavLandedState::MAV_LANDED_STATE_IN_AIR,
                MavLandedState::MAV_LANDED_STATE_ON_GROUND,
            ]),
            ..EXTENDED_SYS_STATE_DATA::default()
        }),
        3 => MavMessage::MISSION_CURRENT(MISSION_CURRENT_DATA {
            seq: dice.pick(&[0, 1, 2, 3, u16::MAX - 1, u16::MAX]),
            total: dice.pick(&[0, 1, 3, u16::MAX]),
            ..MISSION_CURRENT_DATA::default()
        }),
        4 => MavMessage::CURRENT_MODE(CURRENT_MODE_DATA {
            custom_mode: dice.pick(&PX4_MODES),
            ..CURRENT_MODE_DATA::default()
        }),
        5 => MavMessage::GLOBAL_POSITION_INT(GLOBAL_POSITION_INT_DATA {
            time_boot_ms,
            lat: dice.pick(&[0, 473_977_418, 900_000_000, i32::MIN, i32::MAX]),
            lon: dice.pick(&[0, 85_455_938, -1_800_000_000, i32::MIN, i32::MAX]),
            alt: dice.u32() as i32,
            relative_alt: dice.u32() as i32,
            ..GLOBAL_POSITION_INT_DATA::default()
        }),
        6 => MavMessage::POSITION_TARGET_LOCAL_NED(POSITION_TARGET_LOCAL_NED_DATA {
            type_mask: PositionTargetTypemask::from_bits_truncate(dice.u16()),
            ..POSITION_TARGET_LOCAL_NED_DATA::default()
        }),
        7 => MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
            command: dice.pick(&[
                MavCmd::MAV_CMD_DO_SET_MODE,
                MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
                MavCmd::MAV_CMD_REQUEST_MESSAGE,
            ]),
            result: dice.pick(&[
                MavResult::MAV_RESULT_ACCEPTED,
                MavResult::MAV_RESULT_DENIED,
                MavResult::MAV_RESULT_IN_PROGRESS,
            ]),
            ..COMMAND_ACK_DATA::default()
        }),
        8 => MavMessage::MISSION_ITEM_REACHED(MISSION_ITEM_REACHED_DATA { seq: dice.u16() }),
        _ => MavMessage::SYSTEM_TIME(SYSTEM_TIME_DATA {
            time_unix_usec: dice.u64(),
            time_boot_ms: dice.u32(),
        }),
    }
}

/// The answer to a request for a mission or one of its items, more or less.
pub fn mission(dice: &mut Dice<'_>, asked: &MavMessage, target: (u8, u8)) -> Option<MavMessage> {
    let (target_system, target_component) = target;
    match asked {
        MavMessage::MISSION_REQUEST_LIST(_) => Some(MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
            count: dice.pick(&[0, 1, 3, 5, 1000, u16::MAX]),
            target_system,
            target_component,
            ..MISSION_COUNT_DATA::default()
        })),
        MavMessage::MISSION_REQUEST_INT(request) => {
            Some(MavMessage::MISSION_ITEM_INT(MISSION_ITEM_INT_DATA {
                seq: if dice.once_in(8) { dice.u16() } else { request.seq },
                param1: dice.number(),
                param2: dice.number(),
                param3: dice.number(),
                param4: dice.number(),
                x: dice.u32() as i32,
                y: dice.u32() as i32,
                z: dice.number(),
                command: dice.pick(&COMMANDS),
                frame: dice.pick(&[
                    MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT,
                    MavFrame::MAV_FRAME_GLOBAL,
                    MavFrame::MAV_FRAME_LOCAL_NED,
                    MavFrame::MAV_FRAME_MISSION,
                ]),
                autocontinue: u8::from(!dice.once_in(8)),
                target_system,
                target_component,
                ..MISSION_ITEM_INT_DATA::default()
            }))
        }
        _ => None,
    }
}

/// A command in one of its three messages; who is meant comes from `targets`.
pub fn command(dice: &mut Dice<'_>, targets: (u8, u8), from: (u8, u8)) -> Content {
    let known = [
        MavCmd::MAV_CMD_REQUEST_MESSAGE,
        MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
        MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL,
        MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN,
        MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
        MavCmd::MAV_CMD_DO_SET_MODE,
    ];
    let messages = [0.0, 111.0, 148.0, 244.0, 300.0, 330.0, 390.0, 397.0, 65_536.0];
    let command = dice.pick(&known);
    let param1 = if dice.once_in(4) {
        dice.number()
    } else {
        dice.pick(&messages)
    };
    let param2 = dice.pick(&[
        0.0,
        -1.0,
        1.0,
        2.0,
        33_333.0,
        200_000.0,
        1e9,
        f32::NAN,
        f32::INFINITY,
    ]);
    let (target_system, target_component) = targets;
    match dice.below(3) {
        0 => Content::Message(MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            param1,
            param2,
            command,
            target_system,
            target_component,
            ..COMMAND_LONG_DATA::default()
        })),
        1 => Content::Message(MavMessage::COMMAND_INT(COMMAND_INT_DATA {
            param1,
            param2,
            command,
            target_system,
            target_component,
            ..COMMAND_INT_DATA::default()
        })),
        _ => {
            let mut payload = [0; 33];
            payload[28..30].copy_from_slice(&dice.u16().to_le_bytes());
            payload[30..32].copy_from_slice(&[target_system, target_component]);
            let bytes = frame(76, from, &payload);
            let mut splitter = Splitter::new();
            splitter.load_datagram(&bytes);
            let frame = splitter.next_frame().expect("its checksum fits");
            Content::of(&frame).expect("every command can be read")
        }
    }
}

/// What a ground station asks of the component that has parameters.
pub fn parameter(dice: &mut Dice<'_>, (target_system, target_component): (u8, u8)) -> MavMessage {
    let rows = jink_shared_types::params::TABLE;
    let mut param_id = [0; 16];
    match dice.once_in(8) {
        true => {
            let text = dice.take(16);
            param_id[..text.len()].copy_from_slice(text);
        }
        false => {
            let name = rows[usize::from(dice.byte()) % rows.len()].name.as_bytes();
            param_id[..name.len()].copy_from_slice(name);
        }
    }
    match dice.below(3) {
        0 => MavMessage::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA {
            target_system,
            target_component,
        }),
        1 => MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
            param_index: match dice.below(3) {
                0 => -1,
                1 => i16::from(dice.byte() as i8),
                _ => dice.u16() as i16,
            },
            target_system,
            target_component,
            param_id: CharArray::new(param_id),
        }),
        _ => MavMessage::PARAM_SET(PARAM_SET_DATA {
            param_value: match dice.below(3) {
                0 => f32::from_bits(u32::from(dice.byte())),
                _ => dice.number(),
            },
            target_system,
            target_component,
            param_id: CharArray::new(param_id),
            param_type: dice.pick(&[
                MavParamType::MAV_PARAM_TYPE_REAL32,
                MavParamType::MAV_PARAM_TYPE_INT32,
                MavParamType::MAV_PARAM_TYPE_UINT8,
                MavParamType::MAV_PARAM_TYPE_REAL64,
                MavParamType::MAV_PARAM_TYPE_INT8,
                MavParamType::MAV_PARAM_TYPE_UINT32,
            ]),
        }),
    }
}

/// A request for files, in a payload that is no more right than it has to be.
pub fn files(dice: &mut Dice<'_>, (target_system, target_component): (u8, u8)) -> MavMessage {
    let mut payload = [0; 251];
    let seq = dice.u16().to_le_bytes();
    let opcode = if dice.once_in(8) {
        dice.byte()
    } else {
        dice.pick(&[1, 2, 3, 4, 5, 14, 15])
    };
    let path = dice.pick(&[
        "general.json",
        "/parameters.json",
        ".",
        "",
        "../etc/passwd",
        "\u{e9}",
    ]);
    let offset = match dice.below(4) {
        0 => dice.u32(),
        1 => u32::MAX,
        _ => u32::from(dice.u16()),
    };
    payload[..4].copy_from_slice(&[seq[0], seq[1], dice.below(4), opcode]);
    payload[8..12].copy_from_slice(&offset.to_le_bytes());
    match dice.once_in(4) {
        true => {
            payload[4] = dice.byte();
            let data = dice.take(usize::from(payload[4]).min(239));
            payload[12..12 + data.len()].copy_from_slice(data);
        }
        false => {
            payload[4] = path.len() as u8;
            payload[12..12 + path.len()].copy_from_slice(path.as_bytes());
        }
    }
    MavMessage::FILE_TRANSFER_PROTOCOL(FILE_TRANSFER_PROTOCOL_DATA {
        target_network: dice.byte(),
        target_system,
        target_component,
        payload,
    })
}

/// The autopilot of `system`.
pub fn autopilot(system: u8) -> (u8, u8) {
    (system, COMPONENT_AUTOPILOT)
}
