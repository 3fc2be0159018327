//! One sensor's part of the ring: its newest view, and how old that may get.

use super::view::View;
use jink_shared_types::Timestamp;
use jink_shared_types::ring::SECTORS;

/// A sample stamped this far in the future (s) is broken, not fresh: clocks of one board agree to less.
const FUTURE_S: f64 = 0.1;

/// The newest view of one sensor.
#[derive(Clone, Debug)]
pub struct Layer {
    /// What it saw.
    pub view: View,
    /// When that was published; never if there is none.
    pub published: Timestamp,
    /// Whether the view still has its place in local NED.
    pub is_placed: bool,
    /// When its newest sample was published, placed or not.
    pub arrived: Timestamp,
    /// Age at which its samples count as stale (s).
    pub deadline_s: f64,
    /// Shortest range it measures (m).
    pub range_min_m: f32,
}

impl Layer {
    /// A sensor not heard of.
    pub fn new() -> Self {
        Self {
            view: View::unknown(),
            published: Timestamp::NEVER,
            is_placed: false,
            arrived: Timestamp::NEVER,
            deadline_s: 0.0,
            range_min_m: 0.0,
        }
    }

    /// Whether what it saw still counts.
    pub fn is_live(&self, now: Timestamp) -> bool {
        self.is_placed && self.is_young(now, self.published)
    }

    /// Whether samples still come from this sensor, wherever they could be placed.
    pub fn is_arriving(&self, now: Timestamp) -> bool {
        self.arrived.is_set() && self.is_young(now, self.arrived)
    }

    /// Whether it saw something once and does not any more.
    pub fn is_lost(&self, now: Timestamp) -> bool {
        self.published.is_set() && !self.is_live(now)
    }

    fn is_young(&self, now: Timestamp, time: Timestamp) -> bool {
        (-FUTURE_S..=self.deadline_s).contains(&now.seconds_since(time))
    }

    /// Marks in `mask` the sectors this layer knows something of, numbered from the heading it had.
    pub fn mark_covered(&self, mask: &mut [bool; SECTORS]) {
        for (covered, sector) in mask.iter_mut().zip(&self.view.sectors) {
            *covered |= sector.is_known() || sector.near_m2.is_finite();
        }
    }
}
