//! Why a command cannot do what it was asked for, and the exit codes that report it to scripts.

use std::fmt;

/// The command could not do what it was asked for.
pub const EXIT_PROBLEM: u8 = 1;
/// Nothing runs under this instance's name.
pub const EXIT_NOT_RUNNING: u8 = 3;

/// Why a command cannot do what it was asked for.
#[derive(Debug)]
pub enum Problem {
    /// The system would not do it.
    Io {
        /// What was being done.
        what: String,
        /// Why not.
        cause: std::io::Error,
    },
    /// Shared memory would not open.
    Memory(jink_runtime::OpenError),
    /// The supervisor did not come up.
    NotUp {
        /// In its own words.
        reason: String,
        /// Its exit code.
        code: u8,
    },
    /// A sentence of its own.
    Other(String),
}

impl Problem {
    /// Says what was being done when `cause` happened.
    pub fn io(what: impl Into<String>) -> impl FnOnce(std::io::Error) -> Self {
        let what = what.into();
        |cause| Self::Io { what, cause }
    }

    /// The exit code that reports it to scripts.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::NotUp { code, .. } => *code,
            Self::Io { .. } | Self::Memory(_) | Self::Other(_) => EXIT_PROBLEM,
        }
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Io { what, cause } => write!(f, "{what}: {cause}"),
            Self::Memory(error) => write!(f, "{error}"),
            Self::NotUp { reason: text, .. } | Self::Other(text) => f.write_str(text),
        }
    }
}
impl std::error::Error for Problem {}
impl From<jink_runtime::OpenError> for Problem {
    fn from(error: jink_runtime::OpenError) -> Self {
        Self::Memory(error)
    }
}
