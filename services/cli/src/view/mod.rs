//! What the commands show, as functions of what they have read.

pub mod log;
pub mod recording;
pub mod ring;
pub mod sample_json;
pub mod sample_text;
pub mod schema;
pub mod top;
pub mod topic_statistics;
pub mod topics;
