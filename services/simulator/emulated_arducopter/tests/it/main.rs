//! What the emulated ArduCopter promises, in one binary: it links once.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod arducopter_arming;
mod arducopter_failsafe;
mod arducopter_guided;
mod arducopter_is_observed;
mod arducopter_link;
mod arducopter_missions;
mod arducopter_modes;
mod arducopter_proximity;
mod arducopter_steps_allocate_nothing;
mod arducopter_tracking;
mod support;
