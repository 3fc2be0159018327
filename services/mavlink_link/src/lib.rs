//! The link to an autopilot and to ground stations: bytes and frames, the rules between several links, and what is known of
//! autopilots whoever speaks to them.
//!
//! | module | |
//! |---|---|
//! | [`link`] | the bytes of one link: serial, UDP, TCP; passing it on to another process |
//! | [`frame`], [`message`], [`encoder`] | frames out of bytes, messages out of frames, and back |
//! | [`links`] | all links of a vehicle as one network: [`router`], [`budget`], [`signing`], [`tlog`] |
//! | [`make`], [`px4_mode`], [`version`], [`encoding`], [`latch`] | which autopilot this is, and which of several is ours |
//! | [`streams`], [`clock_map`] | what it must tell, and its clock against ours |
//! | [`profile_name`], [`fit`] | ways of speaking to it, and which of them is for it |
//!
//! Nothing here flies: the gateway does, and the examination of a link before the flight uses the same parts.

pub mod budget;
pub mod clock_map;
pub mod encoder;
pub mod encoding;
pub mod fit;
pub mod frame;
pub mod latch;
pub mod link;
pub mod links;
pub mod make;
pub mod message;
pub mod profile_name;
pub mod px4_mode;
pub mod router;
pub mod signing;
pub mod streams;
pub mod ticker;
pub mod tlog;
pub mod version;
