//! What the `jink` command shows and computes, without touching the system: everything here is a function of its
//! arguments. The command itself (`main.rs`) reads shared memory, starts processes and prints.
//!
//! | module | in | out |
//! |---|---|---|
//! | [`report`] | `system/status`, `link/status` | one screen, or JSON |
//! | [`top`] | the same, rates of topics, events | a screen that is drawn again and again |
//! | [`topic_list`], [`beat`], [`digest`], [`sample_json`] | topic table, headers, samples | topics, their rates, what they say |
//! | [`calibrate`] | clouds and attitude of a vehicle that stands | where its sensors are mounted, and how sure that is |
//! | [`findings`] | what an examination has found | verdict and table, or JSON |
//! | [`running_link`] | `link/status`, the rate of `vehicle/state`, events | findings |
//! | [`sensors_seen`] | scans, clouds, `guard/ring`, events | findings and figures |
//! | [`memory_need`] | topic table, configuration | shared memory that the topics take |
//! | [`schema`] | topic table, shapes of samples | a table, a C header, a Python module, JSON |
//! | [`param_list`] | parameter table, `parameters` | a table, or JSON |

pub mod beat;
pub mod calibrate;
pub mod digest;
pub mod findings;
pub mod memory_need;
pub mod param_list;
pub mod report;
pub mod ring_view;
pub mod running_link;
pub mod sample_json;
pub mod schema;
pub mod sensors_seen;
pub mod top;
pub mod topic_list;
