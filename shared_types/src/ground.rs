//! What the gateway and the ground services exchange: what ground stations ask of our components, and the answers.
//!
//! Payloads travel as they are in MAVLink 2 frames. Addresses, sequence numbers, signatures and links are the gateway's business.

use crate::coded::{Coded, Flag};
use crate::reserved::Reserved;

/// Longest payload of a MAVLink 2 frame (bytes).
pub const PAYLOAD_BYTES: usize = 255;
/// In [`GroundAnswer::link`]: where its addressee is, or over all links.
pub const ANY_LINK: u8 = u8::MAX;

crate::sample! {
    /// The content of one MAVLink message.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct MavlinkMessage: 260 {
        /// Message id, 24 bits.
        pub id: u32,
        /// Bytes of the payload in use.
        pub len: u8,
        /// The payload of a MAVLink 2 frame; zero behind `len`.
        pub payload: [u8; PAYLOAD_BYTES],
    }
    plausible if Self::is_consistent
}

impl Default for MavlinkMessage {
    fn default() -> Self {
        Self {
            id: 0,
            len: 0,
            payload: [0; PAYLOAD_BYTES],
        }
    }
}

impl MavlinkMessage {
    /// Whether a frame could hold it.
    pub fn is_consistent(&self) -> bool {
        self.id < 1 << 24
    }

    /// The bytes in use.
    pub fn bytes(&self) -> &[u8] {
        &self.payload[..usize::from(self.len)]
    }
}

crate::wire_enum! {
    /// Whether the vehicle is armed.
    pub enum Armed {
        /// Not known: no heartbeat yet.
        Unknown = 0 "unknown",
        /// It is not.
        Disarmed = 1 "disarmed",
        /// It is.
        Armed = 2 "armed",
    }
}

crate::sample! {
    /// A message that one of our components has to answer, with what the answer depends on.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct GroundRequest: 284 {
        /// What was said.
        pub message: MavlinkMessage,
        /// Period of OBSTACLE_DISTANCE (us); 0: it is not sent.
        pub obstacle_period_us: u32,
        /// Period of TIMESYNC (us).
        pub timesync_period_us: u32,
        /// Periods of HEARTBEAT (us), of the components 196 and 191.
        pub heartbeat_periods_us: [u32; 2],
        /// Who said it: system.
        pub from_system: u8,
        /// Who said it: component.
        pub from_component: u8,
        /// The link it came in on: its place in the configuration.
        pub link: u8,
        /// It is for the on-board computer, component 191, instead of 196.
        pub for_computer: Flag,
        /// It names the component by its number; otherwise it is for all.
        pub named: Flag,
        /// Whether the vehicle is armed.
        pub armed: Coded<Armed>,
        /// Whole numbers travel in parameter messages as floats (PARAM_ENCODE_C_CAST), not as bytes.
        pub param_c_cast: Flag,
        /// Explicit padding, zero.
        pub reserved: Reserved<1>,
    }
    plausible if Self::is_consistent
}

impl GroundRequest {
    /// Whether a frame could hold it.
    pub fn is_consistent(&self) -> bool {
        self.message.is_consistent()
    }
}

crate::wire_enum! {
    /// What the gateway is to do.
    pub enum GroundAction {
        /// Send the message.
        Send = 0 "send",
        /// Send this component's next HEARTBEAT at once.
        Heartbeat = 1 "heartbeat",
        /// Send the next OBSTACLE_DISTANCE at once.
        Obstacles = 2 "obstacles",
        /// Send OBSTACLE_DISTANCE with this period.
        ObstaclePeriod = 3 "obstacle period",
        /// Start anew, unless the vehicle is armed by then.
        Restart = 4 "restart",
    }
}

crate::sample! {
    /// What the gateway is to send, or to do, for somebody who has asked.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct GroundAnswer: 268 {
        /// What is said, if something is to be sent.
        pub message: MavlinkMessage,
        /// Of a period that is set (us); 0: the usual one.
        pub period_us: u32,
        /// What is to be done.
        pub action: Coded<GroundAction>,
        /// It is of the on-board computer, component 191, instead of 196.
        pub of_computer: Flag,
        /// The link it goes to; [`ANY_LINK`]: where its addressee is, or everybody.
        pub link: u8,
        /// Explicit padding, zero.
        pub reserved: Reserved<1>,
    }
    plausible if Self::is_consistent
}

impl GroundAnswer {
    /// Whether a frame could hold it.
    pub fn is_consistent(&self) -> bool {
        self.message.is_consistent()
    }
}
