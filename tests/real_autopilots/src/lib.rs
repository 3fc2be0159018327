//! Flights of jink on real autopilots in simulation: every situation of a table, judged by the simulator's truth.
//!
//! | module | in | out |
//! |---|---|---|
//! | [`scenarios`] | | the table: what is flown, on which setups, with which expectation |
//! | [`setup`] | | which autopilot in which profile |
//! | `script` | a flight under way | what the pilot and the ground station do in it |
//! | `flight` | scenario, builds | one flight from start to stop |
//! | [`autopilot`] | a build's folder | an autopilot that runs, its ports, the truth |
//! | [`builds`] | `builds.toml` | builds that need not be named each time |
//! | `mission` | places in metres | mission items |
//! | `wire` | datagrams | frames, modes, texts |
//! | `station` | commands, missions | what a ground station sends, and what it receives |
//! | `relay` | datagrams between autopilot and jink | the same datagrams; what was seen of them |
//! | [`jink`] | scenario | the jink that flies, its processes |
//! | `record` | everything that is seen | one flight as data |
//! | `judge` | record, world, expectation | outcome, clearance, figures |
//! | [`runner`] | scenarios, number of jobs | flights side by side, progress |
//! | [`table`] | results | one table, JSON Lines, pictures |
//!
//! Nothing is judged by an estimate: clearance, speed, places and times come from the simulator's truth and from the world.

pub mod autopilot;
pub mod builds;
mod flight;
pub mod jink;
mod judge;
mod mission;
mod record;
mod relay;
pub mod runner;
pub mod scenarios;
mod script;
pub mod setup;
mod station;
pub mod table;
mod wire;
