//! What this component is and can: AUTOPILOT_VERSION, PROTOCOL_VERSION and COMPONENT_METADATA, said on request.

#![allow(deprecated)] // PROTOCOL_VERSION is going, ground stations that ask for it are not.

use crate::commands::Component;
use crate::files::GENERAL_URI;
use jink_mavlink_link::encoding::Encoding;
use jink_shared_types::Timestamp;
use mavlink::dialect::{
    AUTOPILOT_VERSION_DATA, COMPONENT_METADATA_DATA, MavMessage, MavProtocolCapability, PROTOCOL_VERSION_DATA,
};
use mavlink::types::CharArray;

/// AUTOPILOT_VERSION. Only the avoidance component has parameters and files.
pub fn version(component: Component, encoding: Encoding, board_id: u64) -> MavMessage {
    let everybody = MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_MAVLINK2
        | MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_COMMAND_INT;
    MavMessage::AUTOPILOT_VERSION(AUTOPILOT_VERSION_DATA {
        capabilities: match component {
            Component::Avoidance => {
                everybody | MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_FTP | encoding.capability()
            }
            Component::Computer => everybody,
        },
        uid: board_id,
        flight_sw_version: software_version(),
        ..AUTOPILOT_VERSION_DATA::default()
    })
}

/// PROTOCOL_VERSION: both versions are understood, the second is sent.
pub fn protocol() -> MavMessage {
    MavMessage::PROTOCOL_VERSION(PROTOCOL_VERSION_DATA {
        version: 200,
        min_version: 100,
        max_version: 200,
        ..PROTOCOL_VERSION_DATA::default()
    })
}

/// COMPONENT_METADATA: where the general file is, and its checksum.
pub fn metadata(now: Timestamp, general_crc: u32) -> MavMessage {
    let mut uri = [0; 100];
    uri[..GENERAL_URI.len()].copy_from_slice(GENERAL_URI.as_bytes());
    MavMessage::COMPONENT_METADATA(COMPONENT_METADATA_DATA {
        time_boot_ms: (now.ns / 1_000_000) as u32,
        file_crc: general_crc,
        uri: CharArray::new(uri),
    })
}

/// Major, minor and patch in the upper three bytes; the lowest is the release type, 255 = official.
fn software_version() -> u32 {
    let mut version = 255;
    for (i, number) in env!("CARGO_PKG_VERSION").split('.').take(3).enumerate() {
        version |= u32::from(number.parse::<u8>().unwrap_or(0)) << (24 - 8 * i);
    }
    version
}
