//! The time synchroniser of one link: the companion's clock in PX4's time.
//!
//! PX4 asks ten times a second with its own time; the answer carries that time back and the companion's. With `s` sent,
//! `r` received (both PX4's clock) and `c` the companion's, the offset is `(s + r) / 2 - c`. Only round trips under 10 ms
//! count; 500 of them make the estimate usable. Until then a companion's stamp is ignored and reception time is used.
//! The estimate is double exponential smoothing (offset and skew) with gains that fall while it converges. More than
//! five good samples in a row that deviate by more than 100 ms start it over.

/// Good samples before the estimate is used.
const WINDOW: u32 = 500;
/// Longest round trip of a good sample (us).
const ROUND_TRIP_MAX_US: i64 = 10_000;
/// Deviation that counts as a jump of a clock (us).
const DEVIATION_MAX_US: f64 = 100_000.0;
/// Jumps in a row that are believed.
const DEVIATIONS_MAX: u32 = 5;
/// Smoothing gain at the start.
const GAIN_START: f64 = 0.05;
/// Smoothing gain when converged.
const GAIN_END: f64 = 0.003;

/// The estimate.
#[derive(Clone, Debug, Default)]
pub struct Timesync {
    offset_us: f64,
    skew_us: f64,
    samples: u32,
    deviations: u32,
}

impl Timesync {
    /// Whether companions' stamps are believed.
    pub fn is_converged(&self) -> bool {
        self.samples >= WINDOW
    }

    /// Takes an answer: `sent_ns` PX4's time in the request, `theirs_ns` the companion's. Returns whether the estimate
    /// was started over.
    pub fn receive(&mut self, now_us: u64, sent_ns: i64, theirs_ns: i64) -> bool {
        let now_ns = now_us as i64 * 1_000;
        let round_trip_us = (now_ns - sent_ns) / 1_000;
        if !(0..ROUND_TRIP_MAX_US).contains(&round_trip_us) {
            return false;
        }
        let offset_us = ((sent_ns - theirs_ns) as f64 + (now_ns - theirs_ns) as f64) / 2_000.0;
        if self.is_converged() && (self.offset_us - offset_us).abs() > DEVIATION_MAX_US {
            self.deviations += 1;
            if self.deviations > DEVIATIONS_MAX {
                *self = Self::default();
                return true;
            }
            return false;
        }
        self.add(offset_us);
        self.deviations = 0;
        false
    }

    fn add(&mut self, offset_us: f64) {
        if self.samples == 0 {
            self.offset_us = offset_us;
        } else {
            let gain = self.gain();
            let before_us = self.offset_us;
            self.offset_us = gain * offset_us + (1.0 - gain) * (self.offset_us + self.skew_us);
            self.skew_us = gain * (self.offset_us - before_us) + (1.0 - gain) * self.skew_us;
        }
        self.samples = self.samples.saturating_add(1);
    }

    fn gain(&self) -> f64 {
        if self.is_converged() {
            return GAIN_END;
        }
        let progress = f64::from(self.samples) / f64::from(WINDOW);
        let share = 1.0 - (0.5 * (1.0 - 1.0 / (1.0 - progress))).exp();
        share * GAIN_END + (1.0 - share) * GAIN_START
    }

    /// A companion's stamp in PX4's time (us); reception time before convergence. Can lie before boot.
    pub fn to_boot_us(&self, now_us: u64, stamp_us: u64) -> i64 {
        if !self.is_converged() {
            return now_us as i64;
        }
        (stamp_us as i64).wrapping_add(self.offset_us as i64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn feed(sync: &mut Timesync, from: u32, count: u32, round_trip_us: u64, theirs_ahead_us: i64) -> bool {
        let mut restarted = false;
        for i in from..from + count {
            let sent_us = u64::from(i) * 100_000;
            let theirs_us = sent_us as i64 + round_trip_us as i64 / 2 + theirs_ahead_us;
            restarted |= sync.receive(sent_us + round_trip_us, sent_us as i64 * 1_000, theirs_us * 1_000);
        }
        restarted
    }

    #[test]
    fn stamps_are_ignored_before_500_good_samples_and_used_after() {
        let mut sync = Timesync::default();
        feed(&mut sync, 0, 499, 4_000, 7_000_000_000);
        assert!(!sync.is_converged());
        assert_eq!(sync.to_boot_us(60_000_000, 3), 60_000_000);
        feed(&mut sync, 499, 1, 4_000, 7_000_000_000);
        assert!(sync.is_converged());
        let boot_us = sync.to_boot_us(60_000_000, 7_059_500_000);
        assert!((boot_us - 59_500_000).abs() < 100, "{boot_us}");
        assert!(sync.to_boot_us(60_000_000, 0) < 0);
    }

    #[test]
    fn slow_round_trips_never_converge() {
        let mut sync = Timesync::default();
        feed(&mut sync, 0, 5_000, 12_000, 0);
        assert_eq!(sync.samples, 0);
    }

    #[test]
    fn a_jump_of_a_clock_starts_over_after_more_than_five_samples() {
        let mut sync = Timesync::default();
        feed(&mut sync, 0, 600, 4_000, 0);
        assert!(!feed(&mut sync, 600, 5, 4_000, 150_000));
        assert!(sync.is_converged());
        assert!(feed(&mut sync, 605, 1, 4_000, 150_000));
        assert!(!sync.is_converged());
    }
}
