//! Simulated flights of the real programs: flown, disturbed on purpose, measured and drawn. The program is `jink-lab`; `jink demo`
//! and its kin find it beside `jink`. An aircraft needs none of it.
//!
//! | module | in | out |
//! |---|---|---|
//! | [`rig`] | what to fly, which faults to make | a whole system in an instance of its own, from start to stop: a flight |
//! | [`flight_log`] | `sim/truth`, `link/status` | the course of a flight and its summary |
//! | [`drill`] | `planner@8s`, or a seed | which fault to make to which process when |
//! | `handover` | headers around a change of the producer | what was missing, doubled, out of order |
//! | [`latency`] | loads | the way from the capture of a range to the wire, stage by stage |
//! | [`fault_matrix`] | the faults of many flights | figures by process, fault and phase |
//! | [`drawing`] | shapes, words, values | pictures and plots as SVG, for whoever draws |
//! | [`picture`] | world, course | the flight from above and over time as SVG |

pub mod drawing;
pub mod drill;
pub mod fault_matrix;
pub mod flight_log;
mod handover;
pub mod latency;
pub mod picture;
pub mod rig;
