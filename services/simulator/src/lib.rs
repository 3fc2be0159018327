//! The programs around a simulated flight: an emulated autopilot with its vehicle, sensors, real autopilots in simulation.
//!
//! | module | in | out |
//! |---|---|---|
//! | [`autopilot`] | a name in a configuration | an emulated autopilot |
//! | [`sitl`] | a build of PX4 or ArduCopter | it runs, with this simulator around it: truth |
//! | [`service`] | topics, MAVLink on sockets | the processes that the above runs in |
//! | [`program`] | a command line | one of these processes, or a tool |
//!
//! What they are made of are libraries of their own, in folders beside this one's sources, and point one way:
//! `simulated_world <- emulated_autopilot <- emulated_px4, emulated_arducopter, emulated_ground_station <- simulator`.
//!
//! Everything is a pure step with a fixed period: the same seed gives the same flight to the bit, in lock-step
//! within one process as well as behind real sockets and shared memory.

pub mod autopilot;
pub mod program;
pub mod service;
pub mod sitl;
