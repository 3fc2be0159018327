//! No data: the vehicle may not move, the pilot is warned, and at last it holds.
//!
//! | condition | consequence |
//! |---|---|
//! | active for more than a second, last warning more than a second ago | warning |
//! | with a warning: active and without a message for more than 5 s | Hold is asked for |
//!
//! Hold is asked for again with every further warning, and up to a second after it could have been.

/// Between two warnings (us).
const WARNING_US: u64 = 1_000_000;
/// Without data for longer: Hold (us).
const HOLD_US: u64 = 5_000_000;

/// When it began and when it last spoke, boot times (us).
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Silence {
    active: bool,
    activated_us: u64,
    warned_us: u64,
}

impl Silence {
    /// Remembers when it was switched on. Returns `active`.
    pub(super) fn activate(&mut self, now_us: u64, active: bool) -> bool {
        if active && !self.active {
            self.activated_us = now_us;
        }
        self.active = active;
        active
    }

    /// Nothing is known, the newest message is of `map_us`: whether to warn, and whether to ask for Hold.
    pub(super) fn step(&mut self, now_us: u64, map_us: u64) -> (bool, bool) {
        let active_us = now_us.wrapping_sub(self.activated_us);
        if now_us.wrapping_sub(self.warned_us) <= WARNING_US || active_us <= WARNING_US {
            return (false, false);
        }
        self.warned_us = now_us;
        (true, now_us.wrapping_sub(map_us) > HOLD_US && active_us > HOLD_US)
    }
}
