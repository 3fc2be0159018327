//! Nothing leaves for the autopilot that raw ranges speak against: the last filter, which knows neither map nor planner.
//!
//! | in | out |
//! |---|---|
//! | raw ranges of every sensor, vehicle state | [`ring`]: the 72-sector ring, and what is known of the places along a way |
//! | a new trajectory, the ring | [`guard`]: the trajectory that may leave, with verdict and reason |
//! | a pilot's setpoint, the ring | [`prevention`]: the setpoint that may leave, with state and cause |
//!
//! The guard is the second opinion in the chain. What the planner concludes from its map, accumulated over a flight, is judged
//! again from what the sensors say now, by other means: sectors instead of voxels, and the stopping distance
//! `v tau + v a / 2j + v^2 / 2a` instead of a certified corridor. The strictest answer wins: a trajectory leaves only if both agree.
//!
//! Everything here is pure and deterministic, and allocates nothing once it has been made: the same samples in the same order give
//! the same answers to the bit.

pub mod guard;
pub mod prevention;
pub mod ring;
mod service;
mod step_events;

pub use service::GuardService;
pub use step_events::StepEvents;
