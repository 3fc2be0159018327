//! The commands, and what they share.

pub mod ask;
pub mod autopilot;
pub mod bench;
pub mod beside;
pub mod chaos;
pub mod check;
pub mod demo;
pub mod down;
pub mod instances;
pub mod lidar;
pub mod meter;
pub mod param;
pub mod places;
pub mod ring;
pub mod running;
pub mod schema;
pub mod status;
pub mod supervisor;
pub mod top;
pub mod topic;
pub mod up;
pub mod watch;
pub mod world;

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// The command could not do what it was asked for.
pub const EXIT_PROBLEM: u8 = 1;
/// The instance of whoever names none.
pub const DEFAULT_INSTANCE: &str = "default";
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

    /// The exit code that tells it to scripts.
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

/// Set once the user wants to end: Ctrl-C, a closed terminal, SIGTERM.
#[derive(Clone, Debug)]
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Listens from now on.
    pub fn listen() -> Result<Self, Problem> {
        let flag = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            signal_hook::flag::register(signal, Arc::clone(&flag)).map_err(Problem::io("signal handler"))?;
        }
        Ok(Self(flag))
    }

    /// Whether it has come.
    pub fn has_come(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
