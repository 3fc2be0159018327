//! Quantiles of a list of measurements, for figures and benchmarks. What runs in flight counts in [`crate::health::Histogram`].

/// The values at `shares` (each 0..1: 0.5 the median, 1 the largest) of `values`, in their order: of every share the value of the
/// nearest rank. `None` without values. Sorts a copy.
pub fn quantiles<const N: usize>(values: &[f64], shares: [f64; N]) -> Option<[f64; N]> {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let last = sorted.len().checked_sub(1)?;
    // Shares beyond 0 to 1 are the ends.
    Some(shares.map(|share| sorted[((share * last as f64).round() as usize).min(last)]))
}

/// The value at `share`; `None` without values.
pub fn quantile(values: &[f64], share: f64) -> Option<f64> {
    quantiles(values, [share]).map(|[value]| value)
}

#[cfg(test)]
mod tests {
    use super::{quantile, quantiles};
    use proptest::prelude::*;

    #[test]
    fn nothing_has_no_quantile() {
        assert_eq!(quantile(&[], 0.5), None);
    }

    proptest! {
        #[test]
        fn as_many_values_are_below_a_quantile_as_its_share_says(
            values in proptest::collection::vec(-1e6..1e6f64, 1..100), share in 0.0..=1.0f64,
        ) {
            let [least, value, most] = quantiles(&values, [0.0, share, 1.0]).unwrap();
            prop_assert!(values.iter().all(|one| (least..=most).contains(one)));
            let last = values.len() as f64 - 1.0;
            let below = values.iter().filter(|one| **one < value).count() as f64;
            let above = values.iter().filter(|one| **one > value).count() as f64;
            prop_assert!(below <= share * last + 0.5 && above <= (1.0 - share) * last + 0.5, "{below} {above} of {last}");
        }
    }
}
