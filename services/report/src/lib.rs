//! One HTML file about a flight or a campaign: it opens anywhere, without a network, and asks nobody for anything.
//!
//! | module | in | out |
//! |---|---|---|
//! | [`flight`] | recordings of one flight, an [`AutopilotLog`] | the page of a flight |
//! | [`autopilot_log`] | PX4's ULog, ArduPilot's DataFlash log | where the autopilot wanted to be and was |
//! | [`campaign`] | flights of a campaign with their pictures | the page of a campaign |
//!
//! Charts are drawn by uPlot in the reader's browser; library, style and figures stand in the file.

pub mod autopilot_log;
pub mod campaign;
pub mod flight;
mod page;

pub use autopilot_log::AutopilotLog;
pub use flight::Flight;

use jink_recorder::reading::ReadError;
use std::fmt;
use std::path::PathBuf;

/// Why there is no report.
#[derive(Debug)]
pub enum ReportError {
    /// The recording cannot be read.
    Recording(ReadError),
    /// A topic was recorded with another layout: its name, the type then and the type of this program.
    Layout(PathBuf, String, String, &'static str),
    /// There is nothing of a vehicle in it.
    NoVehicle(PathBuf),
    /// The system's about the autopilot's log.
    File(PathBuf, std::io::Error),
    /// It is no log of PX4 or ArduPilot.
    ForeignLog(PathBuf),
    /// It is one, and nothing can be read of it.
    UnreadableLog(PathBuf, String),
    /// It holds no positions.
    NoPositions(PathBuf),
    /// The recording does not say what the autopilot's clock is.
    NoClock(PathBuf),
    /// The log is of another flight: its positions and those of the recording are so far apart in the median (m), or none is of one time.
    OtherFlight(PathBuf, f64),
}

impl fmt::Display for ReportError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Recording(error) => error.fmt(f),
            Self::Layout(path, topic, recorded, ours) => write!(
                f,
                "{}: {topic} was recorded with another layout ({recorded}, this program has {ours})",
                path.display()
            ),
            Self::NoVehicle(path) => write!(f, "{}: no sample of vehicle/state", path.display()),
            Self::File(path, error) => write!(f, "{}: {error}", path.display()),
            Self::ForeignLog(path) => write!(
                f,
                "{}: neither a ULog of PX4 nor a DataFlash log of ArduPilot",
                path.display()
            ),
            Self::UnreadableLog(path, why) => write!(f, "{}: {why}", path.display()),
            Self::NoPositions(path) => write!(f, "{}: no positions in it", path.display()),
            Self::NoClock(path) => write!(
                f,
                "{}: cannot be laid over the recording, which does not know the autopilot's clock (no TIMESYNC)",
                path.display()
            ),
            Self::OtherFlight(path, apart_m) if apart_m.is_nan() => {
                write!(f, "{}: a log of another time than the recording", path.display())
            }
            Self::OtherFlight(path, apart_m) => write!(
                f,
                "{}: a log of another flight: its positions are {apart_m:.1} m from those of the recording",
                path.display()
            ),
        }
    }
}
impl std::error::Error for ReportError {}

impl From<ReadError> for ReportError {
    fn from(error: ReadError) -> Self {
        Self::Recording(error)
    }
}
