//! What the autopilot echoes of its target: whether it follows the positions that it is sent.

use jink_shared_types::Timestamp;
use jink_shared_types::events::{Event, SETPOINTS_FOLLOWED, SETPOINTS_IGNORED};

/// So many echoes in a row that show no position ...
const ECHOES_TO_REPORT: u32 = 3;
/// ... for so long (s) count as a refusal: a mode has been entered by then.
pub const EMPTY_S: f64 = 0.6;

/// Counts the echoes in a row in which the autopilot followed no position.
#[derive(Clone, Copy, Debug, Default)]
pub struct Echoes {
    empty: u32,
    since: Timestamp,
    is_reported: bool,
}

impl Echoes {
    /// One more; what there is to report, if that has changed.
    pub fn count(&mut self, now: Timestamp, is_empty: bool) -> Option<&'static Event> {
        if !is_empty {
            self.empty = 0;
            return std::mem::take(&mut self.is_reported).then_some(&SETPOINTS_FOLLOWED);
        }
        if self.empty == 0 {
            self.since = now;
        }
        self.empty = self.empty.saturating_add(1);
        let is_due = self.empty >= ECHOES_TO_REPORT && now.seconds_since(self.since) >= EMPTY_S;
        (is_due && !std::mem::replace(&mut self.is_reported, is_due)).then_some(&SETPOINTS_IGNORED)
    }
}
