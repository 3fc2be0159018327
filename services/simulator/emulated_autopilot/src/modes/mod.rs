//! The flight modes of each make and their numbers on the wire, for the autopilots and for whoever talks to them.

pub mod arducopter;
pub mod px4;
