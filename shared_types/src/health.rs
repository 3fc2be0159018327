//! How services say that they live, and what the supervisor makes of it.

use crate::clock::Timestamp;
use crate::coded::{Coded, Flag};

/// Longest name of a process in a sample (bytes).
pub const NAME_BYTES: usize = 24;
/// Most processes in one system.
pub const PROCESSES: usize = 24;

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
        /// Not heard of.
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
    pub struct Heartbeat: 120 {
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
        pub reserved: u8,
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
    pub struct ProcessStatus: 184 {
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
        /// Exit status of the last death: code, or 256 + signal.
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
        pub reserved: [u8; 3],
        /// Process id now; 0 = none.
        pub pid: u32,
        /// Process id of its shadow (hot shadow, swap candidate, or the old one after a switch); 0 = none.
        pub shadow_pid: u32,
        /// End-to-end budget of its outputs (us); 0 = none.
        pub end_to_end_budget_us: u32,
        /// Explicit padding, zero.
        pub reserved2: u32,
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
    pub struct SystemStatus: 4448 {
        /// When the supervisor started.
        pub started: Timestamp,
        /// Health of the whole.
        pub health: Coded<Health>,
        /// Explicit padding, zero.
        pub reserved: [u8; 3],
        /// Processes in use.
        pub len: u32,
        /// Process id of the supervisor.
        pub pid: u32,
        /// Restarts of all processes since the system came up.
        pub restarts: u32,
        /// Explicit padding, zero.
        pub reserved2: u64,
        /// The processes, in start order.
        pub processes: [ProcessStatus; PROCESSES],
    }
}

impl Default for SystemStatus {
    fn default() -> Self {
        Self {
            started: Timestamp::NEVER,
            health: Coded::new(Health::Starting),
            reserved: [0; 3],
            len: 0,
            pid: 0,
            restarts: 0,
            reserved2: 0,
            processes: [ProcessStatus::default(); PROCESSES],
        }
    }
}

impl SystemStatus {
    /// The processes in use.
    pub fn processes(&self) -> &[ProcessStatus] {
        &self.processes[..(self.len as usize).min(PROCESSES)]
    }
}

/// Buckets of a [`Histogram`]: eight per octave from 1 us to 1 s, so a bucket is at most 12.5 % wide.
pub const HISTOGRAM_BUCKETS: usize = 160;

crate::sample! {
    /// Durations counted in fixed memory, so that they can be shared, added and read while they are written.
    #[derive(Clone, Copy, PartialEq)]
    pub struct Histogram: 656 {
        /// Values counted.
        pub count: u64,
        /// Largest value (us).
        pub max_us: u32,
        /// Explicit padding, zero.
        pub reserved: u32,
        /// Counts per bucket.
        pub buckets: [u32; HISTOGRAM_BUCKETS],
    }
}

impl Default for Histogram {
    fn default() -> Self {
        Self {
            count: 0,
            max_us: 0,
            reserved: 0,
            buckets: [0; HISTOGRAM_BUCKETS],
        }
    }
}

impl Histogram {
    fn bucket_of(us: u32) -> usize {
        let us = us.max(1);
        let octave = us.ilog2();
        let eighth = if octave >= 3 {
            (us >> (octave - 3)) & 7
        } else {
            (us << (3 - octave)) & 7
        };
        ((octave * 8 + eighth) as usize).min(HISTOGRAM_BUCKETS - 1)
    }

    fn bucket_top_us(bucket: usize) -> f64 {
        let octave = (bucket / 8) as i32;
        let eighth = (bucket % 8) as f64;
        2f64.powi(octave) * (1.0 + (eighth + 1.0) / 8.0)
    }

    /// Counts one duration.
    pub fn record_us(&mut self, us: u32) {
        self.buckets[Self::bucket_of(us)] += 1;
        self.count += 1;
        self.max_us = self.max_us.max(us);
    }

    /// Adds everything another histogram counted.
    pub fn merge(&mut self, other: &Self) {
        for (mine, theirs) in self.buckets.iter_mut().zip(&other.buckets) {
            *mine = mine.saturating_add(*theirs);
        }
        self.count = self.count.saturating_add(other.count);
        self.max_us = self.max_us.max(other.max_us);
    }

    /// The value below which `quantile` (0..1) of all values lie (us): the top of its bucket, at most 12.5 % too high;
    /// 0 without values.
    pub fn quantile_us(&self, quantile: f64) -> f64 {
        if self.count == 0 {
            return 0.0;
        }
        let wanted = (quantile * self.count as f64).ceil().max(1.0);
        let mut seen = 0.0;
        for (bucket, count) in self.buckets.iter().enumerate() {
            seen += f64::from(*count);
            if seen >= wanted {
                return Self::bucket_top_us(bucket).min(f64::from(self.max_us));
            }
        }
        f64::from(self.max_us)
    }
}
impl std::fmt::Debug for Histogram {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "Histogram(n {}, p50 {} us, p99 {} us, max {} us)",
            self.count,
            self.quantile_us(0.5),
            self.quantile_us(0.99),
            self.max_us
        )
    }
}

#[cfg(test)]
mod tests {
    use super::{Histogram, Name};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_quantile_is_at_most_an_eighth_too_high(mut values in proptest::collection::vec(1u32..900_000, 1..200)) {
            let mut histogram = Histogram::default();
            for value in &values {
                histogram.record_us(*value);
            }
            values.sort_unstable();
            let exact = f64::from(values[(values.len() - 1) / 2]);
            let read = histogram.quantile_us(0.5);
            prop_assert!(read >= exact - 1.0 && read <= exact * 1.126 + 1.0, "{read} for {exact}");
        }

        #[test]
        fn a_name_is_cut_at_a_character(text in "\\PC{0,40}") {
            let name = Name::new(&text);
            prop_assert!(text.starts_with(name.as_str()));
        }
    }
}
