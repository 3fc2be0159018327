//! The simulator's processes: the vehicle with its autopilot, and its sensors.

pub mod local;
mod sensors;
pub mod settings;
pub mod udp;
mod vehicle;
pub mod wire;

pub use sensors::{FrameDelay, SensorService};
pub use vehicle::VehicleService;
