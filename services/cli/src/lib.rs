//! What the `jink` command shows and computes, without touching the system: everything here is a function of its
//! arguments. The command itself (`main.rs`) reads shared memory, starts processes and prints.
//!
//! | module | in | out |
//! |---|---|---|
//! | [`report`] | `system/status`, `link/status` | one screen, or JSON |
//! | [`narrate`] | `system/status` | one line per piece of news |
//! | [`flight`] | `sim/truth`, `link/status` | the course of a demonstration flight and its summary |
//! | [`drill`] | `planner@8s` | which process to kill when |
//! | [`picture`] | world, course, sensed points | the flight from above as SVG |

pub mod chaos;
pub mod drill;
pub mod flight;
pub mod narrate;
pub mod picture;
pub mod report;
