//! When samples come: how often, how regularly, how old, and whether their times can be true.

use jink_shared_types::quantile::quantile;
use jink_shared_types::{SampleHeader, Timestamp};

/// A capture this much later than its publication (s) is no rounding: both come from one clock.
const FUTURE_S: f64 = 1e-3;

/// What the headers of one producer's samples say, in the order in which they came.
#[derive(Clone, Debug, Default)]
pub struct Timing {
    first: Timestamp,
    last: Option<SampleHeader>,
    samples: u64,
    lost: u64,
    backwards: u64,
    future: u64,
    ages_s: Vec<f64>,
    apart_s: Vec<f64>,
}

impl Timing {
    /// Takes the next sample.
    pub fn take(&mut self, header: &SampleHeader) {
        self.samples += 1;
        if header.capture.is_set() {
            let age_s = header.publish.seconds_since(header.capture);
            self.future += u64::from(age_s < -FUTURE_S);
            self.ages_s.push(age_s);
        }
        let Some(last) = self.last.replace(*header) else {
            self.first = header.publish;
            return;
        };
        if header.sequence >> 32 != last.sequence >> 32 {
            return;
        }
        let missing = header.sequence.saturating_sub(last.sequence).saturating_sub(1);
        self.lost += missing;
        self.backwards += u64::from(header.capture.is_set() && header.capture <= last.capture);
        if missing == 0 {
            self.apart_s.push(header.publish.seconds_since(last.publish));
        }
    }

    /// Samples that came.
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// Samples that were published and overwritten before they were read.
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Samples captured no later than the one before.
    pub fn backwards(&self) -> u64 {
        self.backwards
    }

    /// Samples captured after their publication.
    pub fn future(&self) -> u64 {
        self.future
    }

    /// Time from the first to the last (s).
    pub fn span_s(&self) -> f64 {
        self.last
            .map_or(0.0, |last| last.publish.seconds_since(self.first))
    }

    /// How many were published a second, those that were overwritten included; `None` before the second.
    pub fn rate_hz(&self) -> Option<f64> {
        let span_s = self.span_s();
        let steps = (self.samples + self.lost).saturating_sub(1);
        (steps > 0 && span_s > 0.0).then(|| steps as f64 / span_s)
    }

    /// Age at publication (s): the `share` quantile; `None` if no sample says when it was captured.
    pub fn age_s(&self, share: f64) -> Option<f64> {
        quantile(&self.ages_s, share)
    }

    /// Jitter (s): how far 99 of 100 times between two samples are from the usual one at most; `None` before the second.
    pub fn jitter_s(&self) -> Option<f64> {
        let usual_s = quantile(&self.apart_s, 0.5)?;
        let off: Vec<f64> = self
            .apart_s
            .iter()
            .map(|apart_s| (apart_s - usual_s).abs())
            .collect();
        quantile(&off, 0.99)
    }
}

#[cfg(test)]
mod tests {
    use super::Timing;
    use jink_shared_types::{SampleHeader, Timestamp};
    use proptest::prelude::*;

    fn header(sequence: u64, capture_s: f64, publish_s: f64) -> SampleHeader {
        SampleHeader {
            sequence,
            capture: Timestamp::from_seconds(capture_s),
            publish: Timestamp::from_seconds(publish_s),
            ..SampleHeader::default()
        }
    }

    proptest! {
        #[test]
        fn whatever_is_lost_the_rate_and_the_age_stay_what_they_are(
            rate_hz in 1.0..200.0f64, age_s in 0.0..0.3f64, kept in proptest::collection::vec(any::<bool>(), 50),
        ) {
            let mut timing = Timing::default();
            for (i, kept) in kept.iter().enumerate() {
                // The first and the last are seen: between them lies the time.
                if *kept || i == 0 || i == 49 {
                    let publish_s = 10.0 + i as f64 / rate_hz;
                    timing.take(&header(1 << 32 | i as u64, publish_s - age_s, publish_s));
                }
            }
            prop_assert_eq!(timing.samples() + timing.lost(), 50);
            prop_assert!((timing.rate_hz().unwrap() / rate_hz - 1.0).abs() < 1e-6);
            prop_assert!((timing.age_s(0.5).unwrap() - age_s).abs() < 1e-6);
            prop_assert!(timing.jitter_s().is_none_or(|jitter_s| jitter_s < 1e-6));
            prop_assert_eq!((timing.backwards(), timing.future()), (0, 0));
        }
    }

    #[test]
    fn times_that_cannot_be_are_counted_and_a_new_producer_begins_anew() {
        let mut timing = Timing::default();
        for (sequence, capture_s) in [(1, 10.0), (2, 10.1), (3, 10.1), (4, 10.05), (5, 11.0)] {
            timing.take(&header(
                1 << 32 | sequence,
                capture_s,
                10.0 + 0.1 * sequence as f64,
            ));
        }
        assert_eq!((timing.backwards(), timing.future()), (2, 1));
        timing.take(&header(2 << 32, 10.4, 10.7));
        assert_eq!((timing.backwards(), timing.lost()), (2, 0));
    }

    #[test]
    fn jitter_is_how_far_the_times_between_samples_are_from_the_usual_one() {
        let mut timing = Timing::default();
        for i in 0..100_u64 {
            let late_s = if i % 10 == 5 { 0.02 } else { 0.0 };
            let publish_s = 10.0 + 0.1 * i as f64 + late_s;
            timing.take(&header(i, publish_s, publish_s));
        }
        assert!((timing.jitter_s().unwrap() - 0.02).abs() < 1e-6);
    }
}
