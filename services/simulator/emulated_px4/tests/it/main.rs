//! What the emulated PX4 promises, in one binary: it links once.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod collision_vectors;
mod px4_bezier;
mod px4_collision_prevention_alone;
mod px4_collision_prevention_vectors;
mod px4_current_collision_prevention;
mod px4_current_external_avoidance;
mod px4_current_flight;
mod px4_current_in_flight;
mod px4_current_links;
mod px4_current_no_obstacle_data;
mod px4_current_offboard;
mod px4_current_pilot;
mod px4_current_setpoints;
mod px4_current_tracking;
mod px4_desired_path;
mod px4_flight;
mod px4_heartbeat;
mod px4_in_flight;
mod px4_links;
mod px4_replies;
mod px4_steps_allocate_nothing;
mod px4_stream_loss;
mod px4_tracking;
mod support;
