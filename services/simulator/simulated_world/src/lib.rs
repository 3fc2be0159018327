//! A simulated world, the vehicle in it and the range sensors on the vehicle.
//!
//! | module | in | out |
//! |---|---|---|
//! | [`world`] | kind, seed | obstacles: exact distances, ray casting, JSON |
//! | [`sensors`] | world, pose | range scans and point clouds with noise |
//! | [`vehicle`] | attitude and thrust setpoints, wind | true motion |
//! | [`random`] | a seed | reproducible random numbers |
//!
//! Everything is a pure step with a fixed period: the same seed gives the same flight to the bit.

pub mod random;
pub mod sensors;
pub mod vehicle;
pub mod world;
