//! What the tests of links share.

use jink_mavlink_link::encoder::Encoder;
use jink_mavlink_link::message::Body;
use mavlink::dialect::{ATTITUDE_QUATERNION_DATA, MavMessage};
use std::net::UdpSocket;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

/// Patience with the kernel; nothing here takes anywhere near as long.
pub const WATCHDOG: Duration = Duration::from_secs(20);

pub fn bytes(system_id: u8, component_id: u8, message: MavMessage) -> Vec<u8> {
    Encoder::new()
        .encode(system_id, component_id, &Body::Message(message))
        .to_vec()
}

/// A message with a number.
pub fn attitude(n: u32) -> MavMessage {
    MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
        time_boot_ms: n,
        ..ATTITUDE_QUATERNION_DATA::default()
    })
}

/// It, as a component of the autopilot's system sends it.
pub fn frame(component: u8, n: u32) -> Vec<u8> {
    bytes(1, component, attitude(n))
}

pub fn free_udp_port() -> u16 {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.local_addr().unwrap().port()
}

/// A path that no other call returns.
pub fn own_path(what: &str) -> PathBuf {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    std::env::temp_dir().join(format!("jink-{what}-{}-{count}", std::process::id()))
}
