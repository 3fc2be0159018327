//! What has become of a sensor's data.

use crate::decode::Fault;

/// Silence that is reported to the pilot (s), as of a rangefinder.
pub const LOSS_S: f64 = 1.0;

/// Counts since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LidarCounters {
    /// Clouds or scans that were published.
    pub published: u64,
    /// Packets, or frames of a serial line, that were decoded.
    pub good: u64,
    /// Packets that never came.
    pub lost: u64,
    /// Of another sender, another length, another model.
    pub foreign: u64,
    /// A checksum or the contents contradict themselves.
    pub damaged: u64,
    /// Came twice.
    pub doubled: u64,
    /// Came after their scan had ended.
    pub late: u64,
    /// Of the sensor, without ranges.
    pub other: u64,
    /// Points that a cloud had no room for.
    pub overflow: u64,
    /// Clouds or scans per second since the last look (Hz).
    pub rate_hz: f64,
}

impl LidarCounters {
    /// Counts a packet that was not used.
    pub fn count(&mut self, fault: Fault) {
        *match fault {
            Fault::Foreign => &mut self.foreign,
            Fault::Damaged => &mut self.damaged,
            Fault::Doubled => &mut self.doubled,
            Fault::Late => &mut self.late,
            Fault::Other => &mut self.other,
        } += 1;
    }
}
