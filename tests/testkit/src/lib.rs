//! What the tests of several crates share: a dev-dependency only.
//!
//! | module | what it has | whose tests |
//! |---|---|---|
//! | [`motions`] | motions and the limits that they just keep | collision_guard, bezier_generator |
//! | [`vectors`] | how PX4's recorded answers are read | collision_guard, emulated_px4 |
//! | [`video_device`] | a depth camera's device file | depth_driver, tests |
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a helper that cannot do its work fails the test"
)]

pub mod motions;
pub mod vectors;
pub mod video_device;
