//! What else the machine did while a test ran: what a busy one makes late is no fault of what is tested.

use jink_runtime::procfs::{CpuTicks, CpuTimes};

/// Share of the processors' time above which a machine is busy with something else than one flight.
pub const BUSY_SHARE: f64 = 0.5;

/// The processors' time since a test began.
#[derive(Clone, Copy, Debug)]
pub struct Load {
    since: CpuTicks,
}

impl Load {
    /// From now on.
    pub fn begin() -> Self {
        let since = CpuTimes::now().unwrap_or_default().all;
        Self { since }
    }

    /// The busy share of the processors' time so far, 0 to 1; 0 where the kernel does not say.
    pub fn share(self) -> f64 {
        let now = CpuTimes::now().unwrap_or_default().all;
        let all = now.all.saturating_sub(self.since.all).max(1);
        now.busy.saturating_sub(self.since.busy) as f64 / all as f64
    }
}
