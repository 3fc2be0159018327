//! Why a simulation does not start.

use super::options::Unsupported;
use super::ports::PortError;
use std::fmt;

/// Why a simulation does not start.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StartError {
    /// It cannot be simulated like that.
    Unsupported(Unsupported),
    /// A port is taken.
    Port(PortError),
    /// The system would not do something.
    Io {
        /// What.
        what: String,
        /// Why not.
        cause: String,
    },
}

impl fmt::Display for StartError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unsupported(error) => write!(f, "{error}"),
            Self::Port(error) => write!(f, "{error}"),
            Self::Io { what, cause } => write!(f, "{what}: {cause}"),
        }
    }
}
impl std::error::Error for StartError {}
impl From<Unsupported> for StartError {
    fn from(error: Unsupported) -> Self {
        Self::Unsupported(error)
    }
}
impl From<PortError> for StartError {
    fn from(error: PortError) -> Self {
        Self::Port(error)
    }
}
