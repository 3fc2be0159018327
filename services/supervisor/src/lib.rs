//! Keeps the other processes running: starts them in order, sees at once when one dies or hangs, replaces it, and
//! gives up in a defined way when replacing does not help. It never waits for any of them.
//!
//! | in | out |
//! |---|---|
//! | process table (`services.toml`) | what to start, in which order, and what to expect of it |
//! | deaths, heartbeats, time | starts, signals, events, `system/status` |
//!
//! This library is the policy and starts nothing: [`table`] reads and checks the process table, `policy` decides when
//! a process may be restarted, [`supervision`] is the state machine, `health` judges the whole, [`shared`] has its
//! topics. The program around it ([`program`]) carries its decisions out.
//!
//! The shape follows Erlang/OTP's supervisors (start order, reverse stop, restart intensity within a period); detection
//! follows Linux (a death is seen through its pidfd) and the heartbeat contract in [`jink_shared_types::health`].

mod health;
mod policy;
mod process;
pub mod program;
pub mod shadow;
pub mod shared;
mod slowness;
pub mod supervision;
pub mod table;
