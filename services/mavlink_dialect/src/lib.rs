//! MAVLink, as far as jink and its simulations speak it: the MAVLink project's own library (`mavlink-core`), and the messages of
//! `jink.xml`, which is a part of the dialect ardupilotmega, made into Rust by that project's generator. The whole dialect would
//! be the longest unit of the build, and a quarter of its messages is used.
//!
//! What is only passed on is in [`wire`]: a frame of any message of the dialect can be verified and routed.

pub mod wire;

#[allow(missing_docs, clippy::all)]
mod generated {
    include!(concat!(env!("OUT_DIR"), "/mod.rs"));
}

pub use generated::jink as dialect;
pub use mavlink_core::*;
