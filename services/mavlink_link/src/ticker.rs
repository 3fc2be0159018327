//! Something that is due at a fixed rate.

use jink_shared_types::Timestamp;

/// A fixed-rate timer without a clock.
#[derive(Clone, Copy, Debug)]
pub struct Ticker {
    period_s: f64,
    due: Timestamp,
}

impl Ticker {
    /// Due for the first time at once, then at `rate_hz`.
    pub fn new(rate_hz: f64) -> Self {
        Self {
            period_s: 1.0 / rate_hz,
            due: Timestamp::NEVER,
        }
    }

    /// The period (s).
    pub fn period_s(&self) -> f64 {
        self.period_s
    }

    /// From the next time on at `rate_hz`; what is due sooner by that comes sooner.
    pub fn set_rate(&mut self, rate_hz: f64) {
        let period_s = 1.0 / rate_hz;
        if period_s != self.period_s {
            let last = self.due.plus_seconds(-self.period_s);
            self.due = self.due.min(last.plus_seconds(period_s));
            self.period_s = period_s;
        }
    }

    /// When it is due next.
    pub fn due(&self) -> Timestamp {
        self.due
    }

    /// Whether it is due; if so, the next time is one period later. Being late once does not shift the schedule, being
    /// late by a whole period starts a new one: what was missed is not made up for.
    pub fn take(&mut self, now: Timestamp) -> bool {
        if now < self.due {
            return false;
        }
        let next = self.due.plus_seconds(self.period_s);
        self.due = if next > now {
            next
        } else {
            now.plus_seconds(self.period_s)
        };
        true
    }

    /// Starts a new schedule: due one period after `now`.
    pub fn restart(&mut self, now: Timestamp) {
        self.due = now.plus_seconds(self.period_s);
    }

    /// The schedule continues from `last`, when another process took it.
    pub fn resume_from(&mut self, last: Timestamp) {
        self.due = last.plus_seconds(self.period_s);
    }

    /// Makes it due at `time`, if that is earlier.
    pub fn schedule_early(&mut self, time: Timestamp) {
        self.due = self.due.min(time);
    }
}

#[cfg(test)]
mod tests {
    use super::Ticker;
    use jink_shared_types::Timestamp;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn woken_late_by_less_than_half_a_period_the_gap_stays_below_one_and_a_half(
            lateness in proptest::collection::vec(0.0..0.5f64, 1..200),
        ) {
            let mut ticker = Ticker::new(20.0);
            let mut now = Timestamp::from_seconds(5.0);
            prop_assert!(ticker.take(now));
            for late in lateness {
                let last = now;
                now = ticker.due().plus_seconds(late * ticker.period_s());
                prop_assert!(ticker.take(now));
                prop_assert!(now.seconds_since(last) <= 1.5 * ticker.period_s() + 1e-9);
                prop_assert!(!ticker.take(now));
            }
        }
    }
}
