//! The last filter before the autopilot: nothing passes that raw ranges contradict. It knows neither map nor planner.
//!
//! | in | out |
//! |---|---|
//! | raw ranges of every sensor, vehicle state | [`ring`]: the 72-sector ring, and what is known of places along a path |
//! | a new trajectory, the ring | [`guard`]: the approved trajectory, with verdict and reason |
//! | a pilot's setpoint, the ring | [`prevention`]: the setpoint that may be flown, with state and cause |
//!
//! The guard is independent of the planner. What the planner concludes from its map, accumulated over a flight, is
//! checked again with what the sensors measure now, by other means: sectors instead of voxels, and the stopping
//! distance `v tau + v a / 2j + v^2 / 2a` instead of a certified corridor. A trajectory is approved only if both agree.
//!
//! Everything here is pure and deterministic, and allocates nothing after construction: the same samples in the same
//! order give the same results to the bit.

pub mod guard;
pub mod prevention;
pub mod ring;
mod service;
mod step_events;

pub use service::GuardService;
pub use step_events::StepEvents;
