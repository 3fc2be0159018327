//! The sensor's clock on the board's: the least delayed packet of the last seconds dates all of them.
//!
//! A packet arrives some delay after its last measurement: at least the time on the wire, at times much more, because
//! the network or the scheduler kept it. The smallest difference between arrival and stamp therefore is the best
//! estimate of the offset of the two clocks; it grows by 0.2 ms per second, so that a sensor whose clock runs slow is
//! followed. This is the minimum filter of NTP (RFC 5905, section 10) for one direction only.
//!
//! Stamps that contradict the offset by more than half a second are outliers (a damaged stamp, a clock that was set). A
//! few in a row start the filter anew; until then such packets are dated to their arrival.

use jink_shared_types::Timestamp;

/// How fast the smallest delay is forgotten (ns per s): two bad crystals drift apart by 100 ppm, packets are delayed by
/// milliseconds.
const LEAK_NSPS: f64 = 200_000.0;
/// A stamp further from the offset than this (ns) is an outlier: no packet is delayed so long and still of use.
const OUTLIER_NS: i128 = 500_000_000;
/// Outliers in a row after which the sensor's clock has been set: some milliseconds of a network lidar.
const OUTLIERS_TO_RESTART: u32 = 8;

/// Maps stamps of one sensor to the board's clock.
#[derive(Clone, Copy, Debug, Default)]
pub struct ClockFilter {
    /// Smallest arrival minus stamp (ns), and when it was brought up to date.
    least: Option<(i128, Timestamp)>,
    outliers: u32,
    /// Of the packet at hand: board time minus sensor time (ns).
    offset_ns: i128,
}

impl ClockFilter {
    /// Takes a packet whose last measurement was at `last_ns` of the sensor's clock, and which arrived at `arrived`.
    /// Stamps of this packet are then mapped by [`Self::map`].
    pub fn packet(&mut self, last_ns: u64, arrived: Timestamp) {
        let seen_ns = i128::from(arrived.ns) - i128::from(last_ns);
        let Some((least_ns, since)) = self.least else {
            return self.restart(seen_ns, arrived);
        };
        if (seen_ns - least_ns).abs() > OUTLIER_NS {
            self.outliers += 1;
            if self.outliers >= OUTLIERS_TO_RESTART {
                return self.restart(seen_ns, arrived);
            }
            self.offset_ns = seen_ns;
            return;
        }
        self.outliers = 0;
        let leak_ns = (LEAK_NSPS * arrived.seconds_since(since).max(0.0)) as i128;
        let offset_ns = seen_ns.min(least_ns + leak_ns);
        self.least = Some((offset_ns, arrived.max(since)));
        self.offset_ns = offset_ns;
    }

    /// The moment that the sensor calls `stamp_ns`, on the board's clock.
    pub fn map(&self, stamp_ns: u64) -> Timestamp {
        let ns = (i128::from(stamp_ns) + self.offset_ns).clamp(1, i128::from(u64::MAX));
        Timestamp::from_ns(ns as u64)
    }

    fn restart(&mut self, seen_ns: i128, arrived: Timestamp) {
        *self = Self {
            least: Some((seen_ns, arrived)),
            outliers: 0,
            offset_ns: seen_ns,
        };
    }
}

#[cfg(test)]
mod tests {
    use super::{ClockFilter, OUTLIERS_TO_RESTART};
    use jink_shared_types::Timestamp;
    use proptest::prelude::*;

    const START_NS: u64 = 5_000_000_000_000;

    /// Packets every millisecond, the sensor's clock ahead by `ahead_ns`.
    fn arrival(index: u64, delay_us: u64) -> Timestamp {
        Timestamp::from_ns(START_NS + index * 1_000_000 + delay_us * 1_000)
    }

    proptest! {
        #[test]
        fn jitter_is_taken_out_to_the_least_delay(
            ahead_ns in 0u64..2_000_000_000_000_000_000,
            delays_us in prop::collection::vec(100u64..30_000, 20..200),
        ) {
            let mut filter = ClockFilter::default();
            let stamp = |index: u64| START_NS + index * 1_000_000 + ahead_ns;
            for (index, delay_us) in delays_us.iter().enumerate() {
                filter.packet(stamp(index as u64), arrival(index as u64, *delay_us));
            }
            let last = delays_us.len() as u64 - 1;
            let least_us = delays_us.iter().min().unwrap();
            let mapped = filter.map(stamp(last));
            let off_ns = i128::from(mapped.ns) - i128::from(arrival(last, *least_us).ns);
            // The leak: 200 us per second, packets of 0.2 s, some of them delayed by 30 ms.
            prop_assert!((-1..=60_000).contains(&off_ns), "off by {off_ns} ns");
        }

        #[test]
        fn any_stamps_and_arrivals_are_mapped_without_a_panic(pairs in prop::collection::vec((any::<u64>(), any::<u64>()), 1..50)) {
            let mut filter = ClockFilter::default();
            for (stamp, arrived) in pairs {
                filter.packet(stamp, Timestamp::from_ns(arrived));
                prop_assert!(filter.map(stamp) <= Timestamp::from_ns(arrived.max(1)));
            }
        }
    }

    #[test]
    fn one_damaged_stamp_changes_nothing_and_a_clock_that_was_set_is_followed() {
        let mut filter = ClockFilter::default();
        for index in 0..100 {
            filter.packet(index * 1_000_000, arrival(index, 300));
        }
        filter.packet(77_000_000_000_000, arrival(100, 300));
        assert_eq!(
            filter.map(77_000_000_000_000),
            arrival(100, 300),
            "dated to its arrival"
        );
        filter.packet(101_000_000, arrival(101, 5_000));
        let off_ns = filter.map(101_000_000).ns.abs_diff(arrival(101, 300).ns);
        assert!(off_ns < 10_000, "{off_ns}");
        // From here on the sensor's clock counts from 1970.
        let set_ns = 1_700_000_000_000_000_000;
        for index in 102..102 + u64::from(OUTLIERS_TO_RESTART) {
            filter.packet(set_ns + index * 1_000_000, arrival(index, 300));
        }
        filter.packet(set_ns + 200_000_000, arrival(200, 9_000));
        let off_ns = filter.map(set_ns + 200_000_000).ns.abs_diff(arrival(200, 300).ns);
        assert!(off_ns < 30_000, "{off_ns}");
    }

    #[test]
    fn a_clock_that_runs_slow_is_followed() {
        let mut filter = ClockFilter::default();
        let stamp = |index: u64| (index as f64 * 1e6 * 0.999_9) as u64;
        for index in 0..60_000 {
            filter.packet(stamp(index), arrival(index, 300 + index * 7 % 900));
        }
        let mapped = filter.map(stamp(59_999));
        assert!(mapped.ns.abs_diff(arrival(59_999, 300).ns) < 200_000);
    }
}
