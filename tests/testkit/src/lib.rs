//! What the tests of several crates share: a dev-dependency only.
//!
//! | module | what it has | whose tests |
//! |---|---|---|
//! | [`not_tested`] | what a test says that lacks what it needs | all |
//! | [`motions`] | motions and the limits that they just keep | collision_guard, bezier_generator |
//! | [`pseudo_terminal`] | what stands in for a serial port | mavlink_link, rangefinder_driver, tests |
//! | [`temp_folder`] | folders that go with their test | lidar_driver, depth_driver, cli, simulator, simulated_world, map_bench |
//! | [`vectors`] | how PX4's recorded answers are read | collision_guard, emulated_px4 |
//! | [`video_device`] | a depth camera's device file | depth_driver, tests |
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a helper that cannot do its work fails the test"
)]

pub mod motions;
mod not_tested;
pub mod pseudo_terminal;
pub mod temp_folder;
pub mod vectors;
pub mod video_device;

pub use not_tested::not_tested;
