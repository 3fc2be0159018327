//! Why a topic could not be opened.

use crate::room::{REMEDY, SHARED_MEMORY, megabytes};
use std::fmt;

/// Why a topic, or the connection itself, could not be opened.
#[derive(Debug)]
pub enum OpenError {
    /// The topic's row does not allow it.
    NotInTable {
        /// Topic asked for.
        topic: String,
        /// Program that asked.
        program: String,
        /// "publish", "read" or "wait for".
        what: &'static str,
    },
    /// The configuration declares no such topic, or declares it otherwise.
    NotAsDeclared {
        /// Topic asked for.
        topic: String,
        /// What is wrong.
        cause: String,
    },
    /// Another build of the same topic is in use: the layouts differ.
    Layout {
        /// Topic asked for.
        topic: String,
        /// This build's type name with its layout hash.
        ours: &'static str,
    },
    /// The service has opened as many as there is room for.
    TooMany {
        /// The one that was too many.
        topic: String,
        /// Of what.
        what: &'static str,
        /// How many there may be.
        most: usize,
    },
    /// Every place of a topic is taken, by others that live.
    Taken {
        /// Topic asked for.
        topic: String,
        /// What iceoryx2 said.
        cause: String,
    },
    /// As many look on as may; the other places belong to the services.
    TooManySpectators {
        /// Topic asked for.
        topic: String,
        /// How many may look on.
        most: usize,
    },
    /// There is not enough shared memory left.
    NoRoom {
        /// Topic asked for, or what was being done.
        what: String,
        /// What it takes (bytes).
        needed_bytes: u64,
        /// What there is (bytes).
        available_bytes: u64,
    },
    /// iceoryx2 refused for another reason.
    Transport {
        /// Topic asked for, or what was being done.
        topic: String,
        /// What iceoryx2 said.
        cause: String,
    },
}

impl fmt::Display for OpenError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotInTable { topic, program, what } => {
                write!(
                    f,
                    "{program} may not {what} {topic}: neither the topic's row nor a row of the process table allows it"
                )
            }
            Self::NotAsDeclared { topic, cause } => write!(f, "{topic}: {cause}"),
            Self::Layout { topic, ours } => write!(
                f,
                "{topic}: somebody holds it with another layout than this build's {ours}; \
                 stop the other instance or use binaries of one build"
            ),
            Self::TooMany { topic, what, most } => {
                write!(f, "{topic}: there is room for {most} {what} in one service")
            }
            Self::Taken { topic, cause } => write!(f, "{topic}: all places are taken ({cause})"),
            Self::TooManySpectators { topic, most } => write!(
                f,
                "{topic}: {most} commands look at it already, the other places belong to the services; end one of them"
            ),
            Self::NoRoom {
                what,
                needed_bytes,
                available_bytes,
            } => write!(
                f,
                "{what}: {} of shared memory needed, {} available in {SHARED_MEMORY}; {REMEDY}",
                megabytes(*needed_bytes),
                megabytes(*available_bytes)
            ),
            Self::Transport { topic, cause } => write!(f, "{topic}: {cause}"),
        }
    }
}

impl std::error::Error for OpenError {}
