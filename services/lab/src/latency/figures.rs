//! Percentiles of measured times.

use jink_control::figures::round;
use jink_shared_types::quantile::quantiles;
use serde::{Deserialize, Serialize};

/// What can be said of a list of times (ms).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Figures {
    /// How many.
    pub n: usize,
    /// Median.
    pub p50_ms: f64,
    /// Nine of ten are no longer.
    pub p90_ms: f64,
    /// 99 of a hundred.
    pub p99_ms: f64,
    /// 999 of a thousand; of fewer the longest.
    pub p999_ms: f64,
    /// The longest.
    pub max_ms: f64,
    /// Mean difference between one and the next (RFC 3550, 6.4.1, without its filter).
    pub jitter_ms: f64,
}

impl Figures {
    /// Of `times_ms` in the order in which they were measured; all zero without any.
    pub fn of(times_ms: &[f64]) -> Self {
        let Some([p50, p90, p99, p999, max]) = quantiles(times_ms, [0.5, 0.9, 0.99, 0.999, 1.0]) else {
            return Self::default();
        };
        let steps: f64 = times_ms.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum();
        Self {
            n: times_ms.len(),
            p50_ms: round(p50),
            p90_ms: round(p90),
            p99_ms: round(p99),
            p999_ms: round(p999),
            max_ms: round(max),
            jitter_ms: round(steps / (times_ms.len().max(2) - 1) as f64),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Figures;

    #[test]
    fn times_are_summed_up_by_their_order_of_size_and_of_time() {
        let times: Vec<f64> = (0..1001).map(f64::from).collect();
        let figures = Figures::of(&times);
        assert_eq!(
            (
                figures.n,
                figures.p50_ms,
                figures.p90_ms,
                figures.p99_ms,
                figures.p999_ms,
                figures.max_ms
            ),
            (1001, 500.0, 900.0, 990.0, 999.0, 1000.0)
        );
        assert_eq!(figures.jitter_ms, 1.0);
        assert_eq!(Figures::of(&[]), Figures::default());
        assert_eq!(Figures::of(&[2.0]).jitter_ms, 0.0);
    }
}
