//! What the `jink` command shows and computes, without touching the system: everything here is a function of its
//! arguments. The command itself (`main.rs`) reads shared memory, starts processes and prints; what it shares with other
//! programs is in `jink-control`.
//!
//! | module | in | out |
//! |---|---|---|
//! | [`view::top`] | the status of [`jink_control::status`], rates of topics, events | a screen that is drawn again and again |
//! | [`view::topics`], [`view::topic_statistics`], [`view::sample_text`], [`view::sample_json`] | topic table, headers, samples | topics, their rates, what they say |
//! | [`view::schema`] | topic table, shapes of samples | a table, a C header, a Python module, JSON |
//! | [`view::log`] | lines of logs | the same in plain words |
//! | [`view::ring`] | `guard/ring` | a picture of characters, or JSON |
//! | [`running_link`] | `link/status`, the rate of `vehicle/state`, events | findings |
//! | [`sensors_seen`] | scans, clouds, `guard/ring`, events | findings and figures |
//! | [`host`] | the kernel's files, measured wake-ups | findings |

pub mod host;
pub mod running_link;
pub mod sensors_seen;
pub mod view;
