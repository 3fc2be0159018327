//! Durations counted in fixed memory.

use crate::reserved::Reserved;

/// Buckets of a [`Histogram`]: from 1 us to 1 s.
pub const HISTOGRAM_BUCKETS: usize = 160;
/// Of those, buckets per octave: a bucket is at most 12.5 % wide.
const BUCKETS_PER_OCTAVE: usize = 8;

crate::sample! {
    /// Durations counted in fixed memory, so that they can be shared, added and read while they are written.
    #[derive(Clone, Copy, PartialEq)]
    pub struct Histogram: 656 {
        /// Values counted.
        pub count: u64,
        /// Largest value (us).
        pub max_us: u32,
        /// Explicit padding, zero.
        pub reserved: Reserved<4>,
        /// Counts per bucket.
        pub buckets: [u32; HISTOGRAM_BUCKETS],
    }
    means { BUCKETS_PER_OCTAVE: usize }
}

impl Default for Histogram {
    fn default() -> Self {
        Self {
            count: 0,
            max_us: 0,
            reserved: Reserved::ZERO,
            buckets: [0; HISTOGRAM_BUCKETS],
        }
    }
}

impl Histogram {
    fn bucket_of(us: u32) -> usize {
        let us = us.max(1);
        let octave = us.ilog2();
        let eighth = if octave >= 3 {
            (us >> (octave - 3)) & 7
        } else {
            (us << (3 - octave)) & 7
        };
        (octave as usize * BUCKETS_PER_OCTAVE + eighth as usize).min(HISTOGRAM_BUCKETS - 1)
    }

    fn bucket_top_us(bucket: usize) -> f64 {
        let octave = (bucket / BUCKETS_PER_OCTAVE) as i32;
        let eighth = (bucket % BUCKETS_PER_OCTAVE) as f64;
        2f64.powi(octave) * (1.0 + (eighth + 1.0) / 8.0)
    }

    /// Counts one duration.
    pub fn record_us(&mut self, us: u32) {
        self.buckets[Self::bucket_of(us)] += 1;
        self.count += 1;
        self.max_us = self.max_us.max(us);
    }

    /// Adds everything another histogram counted.
    pub fn merge(&mut self, other: &Self) {
        for (mine, theirs) in self.buckets.iter_mut().zip(&other.buckets) {
            *mine = mine.saturating_add(*theirs);
        }
        self.count = self.count.saturating_add(other.count);
        self.max_us = self.max_us.max(other.max_us);
    }

    /// The value below which `quantile` (0..1) of all values lie (us): the top of its bucket, at most 12.5 % too high;
    /// 0 without values.
    pub fn quantile_us(&self, quantile: f64) -> f64 {
        if self.count == 0 {
            return 0.0;
        }
        let wanted = (quantile * self.count as f64).ceil().max(1.0);
        let mut seen = 0.0;
        for (bucket, count) in self.buckets.iter().enumerate() {
            seen += f64::from(*count);
            if seen >= wanted {
                return Self::bucket_top_us(bucket).min(f64::from(self.max_us));
            }
        }
        f64::from(self.max_us)
    }
}
impl std::fmt::Debug for Histogram {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "Histogram(n {}, p50 {} us, p99 {} us, max {} us)",
            self.count,
            self.quantile_us(0.5),
            self.quantile_us(0.99),
            self.max_us
        )
    }
}

#[cfg(test)]
mod tests {
    use super::Histogram;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_quantile_is_at_most_an_eighth_too_high(mut values in proptest::collection::vec(1u32..900_000, 1..200)) {
            let mut histogram = Histogram::default();
            for value in &values {
                histogram.record_us(*value);
            }
            values.sort_unstable();
            let exact = f64::from(values[(values.len() - 1) / 2]);
            let read = histogram.quantile_us(0.5);
            prop_assert!(read >= exact - 1.0 && read <= exact * 1.126 + 1.0, "{read} for {exact}");
        }
    }
}
