//! How services say that they live, and what the supervisor makes of it.

mod histogram;

pub use histogram::{HISTOGRAM_BUCKETS, Histogram};

use crate::clock::Timestamp;
use crate::coded::{Coded, Flag};
use crate::reserved::Reserved;
use crate::sample::STAGE_ROOM;

/// Longest name of a process in a sample (bytes).
pub const NAME_BYTES: usize = 24;
/// Most processes in one system.
pub const PROCESSES: usize = 24;
/// [`ProcessStatus::last_exit`] of a program that the kernel did not start, as shells report it.
pub const EXIT_NOT_SPAWNED: u32 = 127;
/// [`ProcessStatus::last_exit`] where the supervisor was not informed: no signal has the number 255.
pub const EXIT_UNKNOWN: u32 = 511;

crate::sample! {
    /// A short text, UTF-8, padded with zeros.
    #[derive(Clone, Copy, Default, PartialEq, Eq, Hash)]
    pub struct Name: 24 {
        /// The bytes.
        pub bytes: [u8; NAME_BYTES],
    }
}

impl Name {
    /// `text`, cut to what fits at a character border.
    pub fn new(text: &str) -> Self {
        let mut end = text.len().min(NAME_BYTES);
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        let mut bytes = [0; NAME_BYTES];
        bytes[..end].copy_from_slice(&text.as_bytes()[..end]);
        Self { bytes }
    }

    /// Whether the bytes are a text.
    pub fn is_text(&self) -> bool {
        let end = self.bytes.iter().position(|b| *b == 0).unwrap_or(NAME_BYTES);
        std::str::from_utf8(&self.bytes[..end]).is_ok()
    }

    /// The text; empty if the bytes are no UTF-8.
    pub fn as_str(&self) -> &str {
        let end = self.bytes.iter().position(|b| *b == 0).unwrap_or(NAME_BYTES);
        std::str::from_utf8(&self.bytes[..end]).unwrap_or("")
    }
}
impl std::fmt::Debug for Name {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:?}", self.as_str())
    }
}

crate::wire_enum! {
    /// State of a service, as it says itself.
    pub enum ServiceState {
        /// Not seen yet.
        Unknown = 0 "unknown",
        /// Opening topics, not yet in its loop.
        Starting = 1 "starting",
        /// Ready, waiting for inputs that have never come.
        Standby = 2 "standby",
        /// Working on fresh inputs.
        Active = 3 "active",
        /// Running, but an input it needs is stale: alive and blind.
        Degraded = 4 "degraded",
        /// On its way out after SIGTERM.
        Stopping = 5 "stopping",
        /// Dead, to be restarted (said by the supervisor).
        Dead = 6 "dead",
        /// Dead and given up (said by the supervisor).
        Failed = 7 "failed",
        /// Ended on request, until it is restarted (said by the supervisor).
        Stopped = 8 "stopped",
    }
}

crate::wire_enum! {
    /// What an instance of a service does with what it computes.
    pub enum Role {
        /// It publishes.
        Owner = 0 "owner",
        /// It computes from the live inputs but publishes nothing: on probation, or ready to take over.
        Shadow = 1 "shadow",
    }
}

crate::sample! {
    /// A service's sign of life with its cycle statistics since the last one hundred heartbeats.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct Heartbeat: 136 {
        /// Which process this is.
        pub name: Name,
        /// Its process id.
        pub pid: u32,
        /// Which start of it.
        pub generation: u32,
        /// Cycles since the start.
        pub cycles: u64,
        /// Cycles that took longer than the budget.
        pub budget_misses: u64,
        /// Inputs that were late, counted once per lateness.
        pub deadline_misses: u64,
        /// Last cycle (us).
        pub cycle_last_us: u32,
        /// Median cycle (us).
        pub cycle_p50_us: u32,
        /// 99th percentile (us).
        pub cycle_p99_us: u32,
        /// Longest since the start (us).
        pub cycle_max_us: u32,
        /// One bit per input in the order of opening: set = fresh.
        pub inputs_fresh: u32,
        /// One bit per input: set = the service needs it to work.
        pub inputs_needed: u32,
        /// CPU time used since the start (ms).
        pub cpu_ms: u32,
        /// State.
        pub state: Coded<ServiceState>,
        /// What it does with what it computes.
        pub role: Coded<Role>,
        /// Of the latest late output: the stage that took most of the time ([`STAGE_NAMES`](crate::STAGE_NAMES)).
        pub late_stage: u8,
        /// Explicit padding, zero.
        pub reserved: Reserved<1>,
        /// Samples published since the start; in a shadow, those it would have published.
        pub outputs: u64,
        /// Of those, how many were older than the process's end-to-end budget.
        pub late_outputs: u64,
        /// Of those, how many no consumer could use: not finite, or inconsistent.
        pub implausible_outputs: u64,
        /// Of the latest late output: its age, from capture to publication (us).
        pub late_us: u32,
        /// Of that, what the stage that took most took (us).
        pub late_stage_us: u32,
        /// Room for later fields, zero.
        pub reserved_tail: Reserved<16>,
    }
    plausible if Self::is_consistent
}

impl Heartbeat {
    /// Whether it says in words whose it is, and names a stage that there is room for.
    pub fn is_consistent(&self) -> bool {
        self.name.is_text() && usize::from(self.late_stage) < STAGE_ROOM
    }
}

crate::wire_enum! {
    /// Why a process was replaced last.
    pub enum ReplaceReason {
        /// It never was.
        Never = 0 "never",
        /// It ended by itself, or somebody ended it.
        Died = 1 "died",
        /// It was silent for too long.
        Hung = 2 "hung",
        /// Its cycles were over budget for too long.
        Slow = 3 "slow",
        /// Somebody asked for it.
        Asked = 4 "asked",
        /// Another binary took over.
        Swapped = 5 "swapped",
        /// It ended, and its second instance took over.
        TakenOver = 6 "taken over",
    }
}

crate::wire_enum! {
    /// Where a hot swap stands.
    pub enum SwapPhase {
        /// None under way.
        Idle = 0 "idle",
        /// The candidate starts.
        Starting = 1 "starting",
        /// The candidate computes beside the owner and is judged.
        Probation = 2 "probation",
        /// The moment of the switch is set and has not come.
        Switching = 3 "switching",
        /// The candidate owns; the old one still stands by.
        Watching = 4 "watching",
    }
}

crate::sample! {
    /// One process as the supervisor sees it.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct ProcessStatus: 200 {
        /// Its last heartbeat.
        pub heartbeat: Heartbeat,
        /// When that was published.
        pub heartbeat_time: Timestamp,
        /// When the process was started.
        pub started: Timestamp,
        /// When it worked again after its last replacement.
        pub back: Timestamp,
        /// Cycle budget from the process table (us); 0 = none.
        pub cycle_budget_us: u32,
        /// Restarts since the system came up.
        pub restarts: u32,
        /// How long the last restart took, from the death to the first active heartbeat (us); 0 = none yet.
        pub recovery_us: u32,
        /// Exit status of the last death: code (127: it could not be started), 256 + signal, or 511: not known.
        pub last_exit: u32,
        /// State as the supervisor judges it.
        pub state: Coded<ServiceState>,
        /// The system cannot fly without it.
        pub essential: Flag,
        /// Why it was replaced last.
        pub reason: Coded<ReplaceReason>,
        /// Where a hot swap of it stands.
        pub swap: Coded<SwapPhase>,
        /// It is slow beyond its budget, and counts as degraded for it.
        pub slow: Flag,
        /// Explicit padding, zero.
        pub reserved: Reserved<3>,
        /// Process id now; 0 = none.
        pub pid: u32,
        /// Process id of its shadow (hot shadow, swap candidate, or the old one after a switch); 0 = none.
        pub shadow_pid: u32,
        /// End-to-end budget of its outputs (us); 0 = none.
        pub end_to_end_budget_us: u32,
        /// Explicit padding, zero.
        pub reserved2: Reserved<4>,
    }
}

crate::wire_enum! {
    /// Health of the whole.
    pub enum Health {
        /// Not judged yet.
        Starting = 0 "starting",
        /// Every essential service is active or ready.
        Healthy = 1 "healthy",
        /// Something is missing, the aircraft is still kept safe.
        Degraded = 2 "degraded",
        /// An essential service has been given up.
        Failed = 3 "failed",
        /// Going down on request.
        Stopping = 4 "stopping",
    }
}

crate::sample! {
    /// Every process, and the health of the whole.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct SystemStatus: 4832 {
        /// When the supervisor started.
        pub started: Timestamp,
        /// Health of the whole.
        pub health: Coded<Health>,
        /// Explicit padding, zero.
        pub reserved: Reserved<3>,
        /// Processes in use.
        pub len: u32,
        /// Process id of the supervisor.
        pub pid: u32,
        /// Restarts of all processes since the system came up.
        pub restarts: u32,
        /// Room for later fields, zero.
        pub reserved2: Reserved<8>,
        /// The processes, in start order.
        pub processes: [ProcessStatus; PROCESSES],
    }
    plausible if Self::is_consistent
}

impl Default for SystemStatus {
    fn default() -> Self {
        Self {
            started: Timestamp::NEVER,
            health: Coded::new(Health::Starting),
            reserved: Reserved::ZERO,
            len: 0,
            pid: 0,
            restarts: 0,
            reserved2: Reserved::ZERO,
            processes: [ProcessStatus::default(); PROCESSES],
        }
    }
}

impl SystemStatus {
    /// Whether it has room for the processes that it counts, and each heartbeat is one.
    pub fn is_consistent(&self) -> bool {
        let is_one = |process: &ProcessStatus| process.heartbeat.is_consistent();
        self.len as usize <= PROCESSES && self.processes().iter().all(is_one)
    }

    /// The processes in use.
    pub fn processes(&self) -> &[ProcessStatus] {
        &self.processes[..(self.len as usize).min(PROCESSES)]
    }
}

#[cfg(test)]
mod tests {
    use super::Name;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_name_is_cut_at_a_character(text in "\\PC{0,40}") {
            let name = Name::new(&text);
            prop_assert!(text.starts_with(name.as_str()));
        }
    }
}
