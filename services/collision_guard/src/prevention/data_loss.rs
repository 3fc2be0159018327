//! What is done when no range data come, with PX4's times.

use super::config::PreventionConfig;
use jink_shared_types::Timestamp;

/// Without data for this long the vehicle is to hold (s).
const HOLD_S: f64 = 5.0;
/// No warning before it has been active for this long (s): sensors may just be starting.
const WARM_UP_S: f64 = 1.0;

/// Since when data are missing.
#[derive(Clone, Copy, Debug, Default)]
pub struct DataLoss {
    active_since: Option<Timestamp>,
    last_data: Option<Timestamp>,
}

/// What is to be done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DataLossAction {
    /// There are data.
    Nothing,
    /// No data, but it has only just become active: no motion.
    Quiet,
    /// No data: no motion, and the pilot has to be notified.
    Warned,
    /// No data for so long that the vehicle is to hold.
    Hold,
}

impl DataLoss {
    /// Records whether there are data. The ring itself says "unknown" half a second after the last of them.
    pub fn note(
        &mut self,
        now: Timestamp,
        config: &PreventionConfig,
        data_at: Option<Timestamp>,
    ) -> DataLossAction {
        if !config.is_active() {
            self.active_since = None;
            return DataLossAction::Nothing;
        }
        let active_since = *self.active_since.get_or_insert(now);
        if let Some(data_at) = data_at {
            self.last_data = Some(data_at);
            return DataLossAction::Nothing;
        }
        let active_s = now.seconds_since(active_since);
        // If there have never been data, the time since activation counts.
        let missing_s = self.last_data.map_or(active_s, |last| now.seconds_since(last));
        if missing_s > HOLD_S && active_s > HOLD_S {
            DataLossAction::Hold
        } else if active_s > WARM_UP_S {
            DataLossAction::Warned
        } else {
            DataLossAction::Quiet
        }
    }
}
