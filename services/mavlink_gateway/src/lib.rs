//! The only service that talks to the autopilot: it keeps it in setpoints, whatever dies behind it.
//!
//! | in | out |
//! |---|---|
//! | autopilot: HEARTBEAT, LOCAL_POSITION_NED, ATTITUDE_QUATERNION, ALTITUDE, EXTENDED_SYS_STATE, HOME_POSITION | `vehicle/state` |
//! | autopilot: TRAJECTORY_REPRESENTATION_WAYPOINTS, or its mission | `vehicle/desired_path` |
//! | `guard/approved` | TRAJECTORY_REPRESENTATION_BEZIER or _WAYPOINTS, 20 Hz (curves 10.8 Hz where a radio carries them), or SET_POSITION_TARGET_LOCAL_NED, 50 Hz, in every mode |
//! | where jink flies the mission: its items | changes of mode and of the current item ([`executive`]) |
//! | `guard/ring` | OBSTACLE_DISTANCE, 5 Hz; 10 Hz while PX4's own collision prevention is on |
//! | `system/status` | HEARTBEAT of component 196, honest |
//! | TIMESYNC | answers; the autopilot's clock mapped to the board's |
//! | where a pilot chooses assisted flight: his sticks, `guard/prevented` | `pilot/demand`, SET_POSITION_TARGET_LOCAL_NED ([`assist`]) |
//! | commands, PARAM_*, FILE_TRANSFER_PROTOCOL for our components | `mavlink/requests`: the ground services answer, in a process of their own |
//! | `mavlink/answers` | those answers, STATUSTEXT, ONBOARD_COMPUTER_STATUS of component 191 |
//!
//! [`Gateway::step`] is pure; the links and their rules, frames and messages are those of [`jink_mavlink_link`]:
//!
//! ```
//! use jink_mavlink_gateway::{Encoder, Gateway, GatewayConfig, Inputs, Outputs};
//! use jink_shared_types::{Reading, Timestamp};
//!
//! let mut gateway = Gateway::new(GatewayConfig::default());
//! let mut outputs = Outputs::default();
//! let mut encoder = Encoder::new();
//! let now = Timestamp::from_seconds(1.0);
//! let inputs = Inputs {
//!     messages: &[],
//!     link: Default::default(),
//!     approved: Reading::Never,
//!     prevented: Reading::Never,
//!     ring: Reading::Never,
//!     system: Reading::Never,
//!     events: &[],
//!     parameters: None,
//!     answers: &[],
//! };
//! gateway.step(now, &inputs, &mut outputs);
//! for message in outputs.messages() {
//!     let bytes = encoder.encode(message.system_id, message.component_id, &message.body);
//!     assert!(!bytes.is_empty()); // hand them to a `Link`, and after that:
//!     gateway.wire(now, message.receipt);
//! }
//! assert!(gateway.next_wake(now) > now);
//! ```
//!
//! The rule behind everything: silence is a bug. A setpoint goes out at every beat once a position was known: the
//! approved trajectory, else the rest of the last one (it ends at rest in space that was certified), else the
//! autopilot's own target, else a held point. Which of them, and why, is the table in `profile::pilot`; how it is said,
//! those in `profile::px4_trajectory` and `profile::position_target`.

pub mod assist;
mod avoidance;
mod blockage;
mod config;
mod demand;
mod desired;
pub mod executive;
mod gateway;
mod handover;
mod io;
pub mod landed_state;
mod note;
mod obstacles;
mod profile;

mod radio_share;
pub mod ranges;
mod service;
mod vehicle;
mod wire;

pub use blockage::Remedy;
pub use config::GatewayConfig;
pub use gateway::Gateway;
pub use handover::HandoverState;
pub use io::{Inputs, OUTBOX, Outputs};
pub use jink_mavlink_link::encoder::Encoder;
pub use jink_mavlink_link::message::{
    Body, COMPONENT_AUTOPILOT, COMPONENT_AVOIDANCE, COMPONENT_ONBOARD_COMPUTER, CommandAck, Content,
    Destination, Outgoing, Receipt, Received,
};
pub use jink_mavlink_link::profile_name::{ProfileChoice, ProfileName, Representation};
pub use note::Note;
pub use service::{GatewayService, check_links};
pub use vehicle::Present;
