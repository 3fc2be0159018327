//! What has become of a sensor's data, and whether it still sends any.

use crate::decode::Fault;
use jink_shared_types::Timestamp;
use jink_shared_types::events::{EventSample, LIDAR_BACK, LIDAR_LOST};

/// Silence that is reported to the pilot (s), as of a rangefinder.
const SILENCE_S: f64 = 1.0;

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

/// A change to report to the pilot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LidarChange {
    /// The sensor is silent, or gone.
    Lost,
    /// It measures again.
    Back,
}

impl LidarChange {
    /// As an event about the sensor called `name`.
    pub fn event(self, name: &str) -> EventSample {
        let event = match self {
            Self::Lost => &LIDAR_LOST,
            Self::Back => &LIDAR_BACK,
        };
        EventSample::new(event, name, [0.0; 2])
    }
}

/// Watches for silence: each loss and each return is reported once.
#[derive(Clone, Copy, Debug, Default)]
pub struct SilenceMonitor {
    received: Timestamp,
    waiting: Timestamp,
    loss_reported: bool,
}

impl SilenceMonitor {
    /// Something was measured, received at `now`.
    pub fn received(&mut self, now: Timestamp) {
        self.received = now;
    }

    /// Whether nothing was received for a while; true before the first time, too.
    pub fn is_silent(&self, now: Timestamp, silence_s: f64) -> bool {
        !self.received.is_set() || now.seconds_since(self.received) > silence_s
    }

    /// Whether the sensor has fallen silent, or measures again; once per change.
    pub fn take_change(&mut self, now: Timestamp) -> Option<LidarChange> {
        if !self.waiting.is_set() {
            self.waiting = now;
        }
        let silent = now.seconds_since(self.received.max(self.waiting)) > SILENCE_S;
        if silent == self.loss_reported {
            return None;
        }
        self.loss_reported = silent;
        Some(if silent {
            LidarChange::Lost
        } else {
            LidarChange::Back
        })
    }
}

/// The rate between two looks.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rate(Timestamp, u64);

impl Rate {
    /// Per second since the last look (Hz); zero at the first.
    pub fn look(&mut self, now: Timestamp, count: u64) -> f64 {
        let Self(time, before) = std::mem::replace(self, Self(now, count));
        let since_s = now.seconds_since(time);
        if time.is_set() && since_s > 0.0 {
            (count - before) as f64 / since_s
        } else {
            0.0
        }
    }
}
