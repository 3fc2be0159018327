//! A device that one instance of a driver reads at a time: who owns it, and what the others do meanwhile.

use crate::ports::{ExclusiveOwnership, Ports};
use crate::service::Wake;
use jink_shared_types::Timestamp;

/// Changes of the device's state are looked for at least this often (Hz).
const CHECK_HZ: u32 = 10;
/// The counters go to the log this often (s).
const REPORT_S: f64 = 60.0;

/// Ownership of a device, and the schedule of its driver.
#[derive(Debug)]
pub struct DeviceOwnership {
    exclusive_ownership: ExclusiveOwnership,
    standby_due: Timestamp,
    report_due: Timestamp,
}

impl DeviceOwnership {
    /// That of the instance with these `ports`.
    pub fn new(ports: &mut Ports) -> Self {
        Self {
            exclusive_ownership: ports.exclusive_ownership(),
            standby_due: Timestamp::NEVER,
            report_due: Timestamp::NEVER,
        }
    }

    /// Whether this instance reads the device from `now` on: a stream has one reader, and the next owner opens it when it owns the
    /// device. What is put out is published accordingly.
    pub fn owns(&self, now: Timestamp) -> bool {
        let is_ours = self.exclusive_ownership.is_due(now);
        self.exclusive_ownership.declare(is_ours);
        is_ours
    }

    /// When the owner runs again if its device does not wake it.
    pub fn owner_due(now: Timestamp) -> Timestamp {
        now.next_beat(CHECK_HZ)
    }

    /// Whether a standby is to show at `now` that it runs and can write its samples, which it does `rate_hz` times a second. None of
    /// them is published.
    pub fn is_standby_due(&mut self, now: Timestamp, rate_hz: u32) -> bool {
        let is_due = now >= self.standby_due;
        if is_due {
            self.standby_due = now.next_beat(rate_hz);
        }
        is_due
    }

    /// When a standby runs again: for its next sample, or when it becomes the owner.
    pub fn standby_wake(&self, now: Timestamp) -> Wake {
        let change = self.exclusive_ownership.changes_at();
        let change = change.filter(|change| *change > now);
        Wake::at(change.map_or(self.standby_due, |change| change.min(self.standby_due)))
    }

    /// Whether the counters are to be written to the log: once a minute, not at the start.
    pub fn is_report_due(&mut self, now: Timestamp) -> bool {
        if now < self.report_due {
            return false;
        }
        let is_first = !self.report_due.is_set();
        self.report_due = now.plus_seconds(REPORT_S);
        !is_first
    }
}
