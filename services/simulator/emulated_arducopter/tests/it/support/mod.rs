//! Flights of the emulated ArduCopter in lock-step.

#![allow(deprecated)]
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

pub mod copter;
pub mod copter_tracking;

/// Steps a second.
pub const STEPS_PER_S: f64 = 250.0;
