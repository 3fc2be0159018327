//! World, vehicle, range sensors and two autopilots that speak MAVLink: one like PX4, one like ArduCopter.
//!
//! | module | in | out |
//! |---|---|---|
//! | [`world`] | kind, seed | obstacles: exact distances, ray casting, JSON |
//! | [`sensors`] | world, pose | range scans and point clouds with noise |
//! | [`vehicle`] | attitude and thrust setpoints, wind | true motion |
//! | [`autopilot`] | MAVLink messages, vehicle | MAVLink messages, setpoints for the vehicle: PX4 |
//! | [`ardupilot`] | the same | the same: ArduCopter |
//! | [`flyer`] | | what both have in common |
//! | [`ground_station`] | MAVLink messages, a flight plan | MAVLink messages, progress |
//! | [`sitl`] | a build of PX4 or ArduCopter | it runs, with this simulator around it: truth |
//! | [`service`] | topics, MAVLink on sockets | the processes that the above runs in |
//! | [`truth`] | autopilot, world | ground truth of the flight |
//!
//! Everything is a pure step with a fixed period: the same seed gives the same flight to the bit, in lock-step
//! within one process as well as behind real sockets and shared memory.

pub mod ardupilot;
pub mod autopilot;
pub mod flyer;
pub mod ground_station;
pub mod random;
pub mod sensors;
pub mod service;
pub mod sitl;
pub mod truth;
pub mod vehicle;
pub mod world;
