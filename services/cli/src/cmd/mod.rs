//! The commands.

pub mod ask;
pub mod check;
pub mod down;
pub mod instances;
pub mod lidar;
pub mod log;
pub mod param;
pub mod recording;
pub mod replay;
pub mod ring;
pub mod schema;
pub mod status;
pub mod top;
pub mod topic;
pub mod up;
pub mod world;
