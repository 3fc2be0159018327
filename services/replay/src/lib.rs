//! Flies a recorded flight once more: each service gets the samples that it took, in cycles that begin at the times at which they began,
//! and what it publishes is compared bit by bit with what it published then.
//!
//! | a recording holds | used for |
//! |---|---|
//! | configuration and parameters at the start | each program is started with them, in lock-step ([`jink_runtime::lockstep::relay`]) |
//! | `cycles/PROCESS` | when each cycle began, and which samples it took |
//! | the topics | what is handed over, and what is compared |
//!
//! A service can be replayed that reads nothing but topics ([`jink_runtime::Service::REPLAYS`]). One that was started anew in the flight is
//! started anew here.

mod difference;
mod flight;
mod instance;
mod layout;
mod report;

pub use difference::FieldDifference;
pub use flight::{Options, Progress, replay};
pub use instance::InstanceName;
pub use report::{Compared, Difference, Report};

use jink_recorder::CopyError;
use jink_recorder::reading::ReadError;
use std::fmt;
use std::path::PathBuf;

/// Why a flight cannot be replayed.
#[derive(Debug)]
pub enum ReplayError {
    /// The recording cannot be read.
    Read(ReadError),
    /// It holds no configuration.
    NoStart,
    /// What it was started with is not understood.
    Start(String),
    /// A parameter does not exist, or cannot have this value.
    Param(String),
    /// No cycles of such a process are in it; these are.
    NoCycles(Option<String>, Vec<String>),
    /// A topic was recorded with another layout than the program has.
    Layout(String),
    /// The program of this process does not run.
    Program(String, String),
    /// A folder or file cannot be written.
    Folder(PathBuf, std::io::Error),
    /// The new recording cannot be written.
    Out(CopyError),
}

impl fmt::Display for ReplayError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Read(error) => write!(f, "{error}"),
            Self::NoStart => {
                f.write_str("the recording holds no configuration: nothing can be started as it was")
            }
            Self::Start(cause) => write!(f, "what the flight was started with is not understood: {cause}"),
            Self::NoCycles(asked_for, there) => {
                match asked_for {
                    Some(process) => write!(f, "the recording holds no cycles of {process}")?,
                    None => f.write_str("the recording holds no cycles of any service")?,
                }
                match there.as_slice() {
                    [] => f.write_str(": a recording that begins in flight cannot be replayed"),
                    there => write!(f, "; there are those of {}", there.join(", ")),
                }
            }
            Self::Layout(cause) | Self::Param(cause) => f.write_str(cause),
            Self::Program(process, cause) => write!(f, "{process} cannot be replayed: {cause}"),
            Self::Folder(path, error) => write!(f, "{}: {error}", path.display()),
            Self::Out(error) => error.fmt(f),
        }
    }
}
impl std::error::Error for ReplayError {}

impl From<CopyError> for ReplayError {
    fn from(error: CopyError) -> Self {
        Self::Out(error)
    }
}

impl From<ReadError> for ReplayError {
    fn from(error: ReadError) -> Self {
        Self::Read(error)
    }
}
