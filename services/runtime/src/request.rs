//! What can be asked of a running supervisor, and what it answers: one JSON object a line over a Unix socket in the
//! instance's folder.
//!
//! ```
//! use jink_runtime::request::{Answer, Request};
//! let asked = r#"{"swap":{"process":"planner","program":"/opt/new/jink-planner","cycles":50,"dry_run":true}}"#;
//! assert!(matches!(serde_json::from_str(asked)?, Request::Swap { .. }));
//! let answer: Answer = serde_json::from_str(r#"{"text":"swapped","last":true,"good":true}"#)?;
//! assert!(answer.last);
//! # Ok::<(), serde_json::Error>(())
//! ```

use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Something to be done to one process.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Request {
    /// Let another binary take its place in flight.
    Swap {
        /// Name in the process table.
        process: String,
        /// The binary; `None` = its own again, which replaces the instance without a gap.
        program: Option<PathBuf>,
        /// Cycles of the probation; `None` = the supervisor's default.
        cycles: Option<u64>,
        /// Stop before the switch.
        dry_run: bool,
    },
    /// End it and start it again.
    Restart {
        /// Name in the process table.
        process: String,
    },
    /// End it for good.
    Stop {
        /// Name in the process table.
        process: String,
    },
    /// Let another supervisor binary take over; the others go on.
    Upgrade {
        /// The binary.
        program: PathBuf,
    },
}

/// How it goes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Answer {
    /// For people.
    pub text: String,
    /// Nothing comes after it.
    pub last: bool,
    /// It is what was wanted.
    pub good: bool,
}
