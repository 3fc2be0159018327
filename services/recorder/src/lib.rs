//! Keeps what flows on the topics in [MCAP](https://mcap.dev) files, and never costs a flight anything.
//!
//! | in | out |
//! |---|---|
//! | every topic whose row says `logged`, and those that the configuration declares, as bytes | files `jink-SECONDS-START.mcap` in the folder of `[recorder]` |
//! | logs and telemetry logs in the instance's memory | the same in their folders ([`jink_runtime::spool`]) |
//!
//! It is the only process of a flight that waits for a disk.
//!
//! A channel of a file is a topic, a message one sample: its [`SampleHeader`](jink_shared_types::SampleHeader) and its payload, byte by byte
//! as they were in shared memory, but for the unused end of a list ([`layouts::Layout::used_bytes`]). The schema (encoding `jink`) is the JSON
//! of `jink schema --json` for the payload. `log_time` is the time of publication and `publish_time` that of the newest measurement,
//! both on the clock of the day as it was when the file began; the metadata record `jink` says by how much the board's clock differs.
//!
//! The service looks at its topics fifty times a second and hands copies to a thread of the lowest priority, which compresses and writes.
//! What the disk is too slow for is left out, counted, and said: in the log, to the pilot, and in the file on the channel `recorder/lost`.

mod carrier;
mod copy;
pub mod layouts;
pub mod reading;
mod recording;
pub mod schema;
mod schema_json;
mod service;
#[cfg(test)]
mod tests;
mod topic_recorder;
mod writer;

pub use copy::{CopyError, RecordingCopy};
pub use recording::{About, Channel, Kept, LOST, PARAMETERS_FILE, Recording};
pub use service::RecorderService;
