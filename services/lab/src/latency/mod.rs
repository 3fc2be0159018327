//! The way from the capture of a range to the bytes of a setpoint, measured on the real processes in a simulated flight.
//!
//! | in | out |
//! |---|---|
//! | [`Load`]: points, rate, sensors, readers, a [`Disturbance`] beside, real-time scheduling | [`Measured`]: percentiles of the whole way, of each stage's waking up, waiting and computing; CPU, context switches and page faults of each process; how they grow with the load |
//!
//! Nothing is measured from outside: every sample carries the begin and the end of each stage that it has passed, and the gateway
//! publishes the history of each new trajectory that the autopilot has been sent (`link/delivery`).
//!
//! Simulated sensors stamp a frame and then render it; a real one has measured it by then. So the sensor's stage is shown apart, and
//! beside the whole way stands what comes after the sensor.

mod disturbance;
mod figures;
mod load;
mod readers;
mod recorder;
mod report;
mod scaling;

pub use disturbance::{Disturbance, Disturber};
pub use figures::Figures;
pub use load::Load;
pub use readers::Readers;
pub use recorder::{Measured, ProcessFigures, Recorder, StageFigures};
pub use report::{Bench, Provenance, html};
