//! Time on the board: CLOCK_MONOTONIC in nanoseconds, the same for every process.
//!
//! Autopilot time is mapped to it by the gateway and appears nowhere else. Reading the clock is the runtime's
//! business; the mathematics only ever receives a [`Timestamp`].

use crate::layout::{Layout, ZeroCopySend};
use crate::shape::Shape;
use std::fmt;

/// A moment: nanoseconds of CLOCK_MONOTONIC. Zero means "never".
#[repr(transparent)]
#[derive(Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Timestamp {
    /// Nanoseconds since the clock's arbitrary start.
    pub ns: u64,
}

#[allow(unsafe_code)]
// SAFETY: a transparent u64.
unsafe impl ZeroCopySend for Timestamp {}
#[allow(unsafe_code)]
// SAFETY: a transparent u64: no padding, every pattern valid.
unsafe impl Layout for Timestamp {
    const SHAPE: Shape = Shape::Timestamp;
}

/// In seconds, to the nanosecond; `never` if it is not set.
impl fmt::Debug for Timestamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.ns {
            0 => f.write_str("never"),
            ns => write!(f, "{}.{:09} s", ns / 1_000_000_000, ns % 1_000_000_000),
        }
    }
}

impl Timestamp {
    /// The moment that never was: an unset time.
    pub const NEVER: Self = Self { ns: 0 };

    /// `ns` nanoseconds of the monotonic clock.
    pub const fn from_ns(ns: u64) -> Self {
        Self { ns }
    }

    /// `seconds` of the monotonic clock; negative and NaN become [`Timestamp::NEVER`].
    pub fn from_seconds(seconds: f64) -> Self {
        Self {
            ns: (seconds * 1e9) as u64,
        }
    }

    /// Seconds since the clock's start.
    pub fn seconds(self) -> f64 {
        self.ns as f64 * 1e-9
    }

    /// Whether this is a moment at all.
    pub const fn is_set(self) -> bool {
        self.ns != 0
    }

    /// Seconds from `earlier` to `self`; negative if `earlier` is later.
    pub fn seconds_since(self, earlier: Self) -> f64 {
        if self.ns >= earlier.ns {
            (self.ns - earlier.ns) as f64 * 1e-9
        } else {
            -((earlier.ns - self.ns) as f64 * 1e-9)
        }
    }

    /// Nanoseconds from `earlier` to `self`, zero if `earlier` is later.
    pub const fn ns_since(self, earlier: Self) -> u64 {
        self.ns.saturating_sub(earlier.ns)
    }

    /// The moment `seconds` later (earlier if negative), saturating at the clock's ends.
    pub fn plus_seconds(self, seconds: f64) -> Self {
        if seconds >= 0.0 {
            Self {
                ns: self.ns.saturating_add((seconds * 1e9).round() as u64),
            }
        } else {
            Self {
                ns: self.ns.saturating_sub((-seconds * 1e9).round() as u64),
            }
        }
    }

    /// The next multiple of `1 / rate_hz` of the clock, later than this moment; never for a rate of zero.
    ///
    /// What is done on such beats is done at the same moments by every process, also by the one that is about to take over.
    pub fn next_beat(self, rate_hz: u32) -> Self {
        const SECOND_NS: u128 = 1_000_000_000;
        let rate = u128::from(rate_hz);
        if rate == 0 {
            return Self { ns: u64::MAX };
        }
        let beats = u128::from(self.ns) * rate / SECOND_NS + 1;
        let ns = (beats * SECOND_NS).div_ceil(rate);
        Self {
            ns: u64::try_from(ns).unwrap_or(u64::MAX),
        }
    }
}

/// A step back in time by more than this (s) means that the newest sample had a wrong time, not that this one is late:
/// late samples are bounded by the topic's buffer (16 vehicle states, 0.32 s).
const CLOCK_STEP_S: f64 = 1.0;

/// How the time of a sample compares with the newest one known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Later: take it.
    Newer,
    /// Not later: a repetition or a straggler.
    Late,
    /// Earlier by so much that the newest one's time was wrong.
    ClockStep,
}

impl Order {
    /// Judges `at` against `newest`; an unset time is always late, anything set is newer than an unset newest.
    pub fn judge(at: Timestamp, newest: Timestamp) -> Self {
        if !at.is_set() {
            Order::Late
        } else if at > newest {
            Order::Newer
        } else if newest.seconds_since(at) > CLOCK_STEP_S {
            Order::ClockStep
        } else {
            Order::Late
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Order, Timestamp};

    #[test]
    fn differences_are_signed_and_sums_saturate() {
        let early = Timestamp::from_ns(1_000_000_000);
        let late = early.plus_seconds(0.25);
        assert_eq!(late.ns, 1_250_000_000);
        assert!((late.seconds_since(early) - 0.25).abs() < 1e-12);
        assert!((early.seconds_since(late) + 0.25).abs() < 1e-12);
        assert_eq!(early.ns_since(late), 0);
        assert_eq!(early.plus_seconds(-5.0), Timestamp::NEVER);
    }

    #[test]
    fn beats_never_drift_and_rates_meet_where_they_should() {
        let start = Timestamp::from_seconds(86_400.0 * 30.0);
        let mut beat = start;
        for count in 1..=90u64 {
            beat = beat.next_beat(30);
            assert_eq!(
                beat.ns - start.ns,
                (count * 1_000_000_000).div_ceil(30),
                "beat {count}"
            );
        }
        assert_eq!(beat.ns, start.ns + 3_000_000_000);
        assert_eq!(start.next_beat(10).ns, start.ns + 100_000_000, "later than now");
        assert_eq!(Timestamp::from_ns(start.ns - 1).next_beat(20), start);
        assert_eq!(start.next_beat(0).ns, u64::MAX);
    }

    #[test]
    fn stragglers_differ_from_a_clock_that_was_wrong() {
        assert_eq!(
            Order::judge(
                Timestamp::from_seconds(100.0 + 0.1),
                Timestamp::from_seconds(100.0 + 0.0)
            ),
            Order::Newer
        );
        assert_eq!(
            Order::judge(Timestamp::from_seconds(100.0 + 0.1), Timestamp::NEVER),
            Order::Newer
        );
        assert_eq!(
            Order::judge(
                Timestamp::from_seconds(100.0 + 0.0),
                Timestamp::from_seconds(100.0 + 0.0)
            ),
            Order::Late
        );
        assert_eq!(
            Order::judge(
                Timestamp::from_seconds(100.0 + 0.0),
                Timestamp::from_seconds(100.0 + 0.9)
            ),
            Order::Late
        );
        assert_eq!(
            Order::judge(
                Timestamp::from_seconds(100.0 + 0.0),
                Timestamp::from_seconds(100.0 + 1.1)
            ),
            Order::ClockStep
        );
        assert_eq!(
            Order::judge(Timestamp::NEVER, Timestamp::from_seconds(100.0 + 1.1)),
            Order::Late
        );
    }
}
