//! The link to an autopilot and to ground stations: bytes and frames, the rules between several links, and what is
//! known of autopilots.
//!
//! | module | |
//! |---|---|
//! | [`link`] | the bytes of one link: serial, UDP, TCP; passing it on to another process |
//! | [`frame`], [`message`], [`encoder`] | frames out of bytes, messages out of frames, and back |
//! | [`links`] | all links of a vehicle as one network: [`router`], [`budget`], [`signing`], [`tlog`] |
//! | [`autopilot_type`], [`px4_mode`], [`version`], [`encoding`], [`vehicle_selector`] | which autopilot this is, and which of several is ours |
//! | [`exchange`] | messages as samples, for the ground services |
//! | [`streams`], [`clock_map`] | the messages it must send, and its clock against ours |
//! | [`profile_name`], [`fit`] | the profiles, and which of them fits the autopilot |
//!
//! Nothing here flies: the gateway does, and the examination of a link before the flight uses the same parts.

pub mod autopilot_type;
pub mod budget;
pub mod clock_map;
pub mod encoder;
pub mod encoding;
pub mod exchange;
pub mod fit;
pub mod frame;
pub mod link;
pub mod links;
pub mod message;
pub mod profile_name;
pub mod px4_mode;
pub mod router;
pub mod signing;
pub mod streams;
pub mod ticker;
pub mod tlog;
pub mod vehicle_selector;
pub mod version;
