//! What a change of the producer looked like to a topic's readers: what is missing, what came twice, what came out of
//! order, and how long nothing came.

use jink_control::figures::round;
use jink_shared_types::SampleHeader;
use jink_shared_types::quantile::quantile;
use jink_shared_types::topics::TopicRow;
use serde::Serialize;

/// Samples whose times of capture usually lie more than this share of a period apart stand for a measurement each.
const ONE_EACH_SHARE: f64 = 0.5;
/// Between two measurements that are more than this many usual steps apart one is missing: half way to the next.
const MISSING_STEPS: f64 = 1.5;
/// Published within this share of a period, two samples answer the same input: a timer's next beat is later.
const AT_ONCE_SHARE: f64 = 0.1;

/// Samples of one topic around a change of its producer.
#[derive(Clone, Debug)]
pub struct Seam {
    topic: String,
    row: TopicRow,
    headers: Vec<SampleHeader>,
}

/// What was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SeamFigures {
    /// Topic.
    pub topic: String,
    /// Samples looked at.
    pub samples: usize,
    /// Changes of the producer among them.
    pub changes: usize,
    /// Measurements that nobody passed on, between the last one of one producer and the first one of the next.
    pub missing: usize,
    /// Measurements that both passed on.
    pub doubled: usize,
    /// Samples whose sequence number is not above that of the one published before.
    pub reordered: usize,
    /// From the last sample of one producer to the first of the next, in declared periods; the largest.
    pub gap_periods: f64,
}

impl Seam {
    /// Of topic `name`.
    pub fn new(name: &str, row: TopicRow) -> Self {
        Self {
            topic: name.to_owned(),
            row,
            headers: Vec::new(),
        }
    }

    /// Takes the next sample in the order of publication.
    pub fn take(&mut self, header: &SampleHeader) {
        self.headers.push(*header);
    }

    /// What was found; `None` if the producer did not change.
    pub fn figures(&self) -> Option<SeamFigures> {
        let pairs = || self.headers.windows(2);
        let changed = |pair: &&[SampleHeader]| pair[0].generation != pair[1].generation;
        let changes = pairs().filter(changed).count();
        if changes == 0 || self.row.rate_hz <= 0.0 {
            return None;
        }
        let period_s = 1.0 / self.row.rate_hz;
        let gap_s = pairs()
            .filter(changed)
            .map(|pair| pair[1].publish.seconds_since(pair[0].publish))
            .fold(0.0, f64::max);
        let (missing, doubled) = self.captures(period_s);
        Some(SeamFigures {
            topic: self.topic.clone(),
            samples: self.headers.len(),
            changes,
            missing,
            doubled,
            reordered: pairs()
                .filter(|pair| pair[1].sequence <= pair[0].sequence)
                .count(),
            gap_periods: round(gap_s / period_s),
        })
    }

    /// Missing and doubled measurements at the changes of the producer, where each sample stands for a measurement of its own at a fixed rate; where one
    /// measurement may lead to several samples only those that both producers made at once count as doubled.
    fn captures(&self, period_s: f64) -> (usize, usize) {
        let steps: Vec<f64> = self
            .headers
            .windows(2)
            .map(|pair| pair[1].capture.seconds_since(pair[0].capture))
            .collect();
        let usual_s = quantile(&steps, 0.5).unwrap_or(0.0);
        let one_each = usual_s > ONE_EACH_SHARE * period_s;
        // What was made of no measurement has no place among them.
        let changes = || {
            let pairs = self.headers.windows(2).zip(&steps);
            pairs.filter(|(pair, _)| {
                pair[0].generation != pair[1].generation && pair.iter().all(|header| header.capture.is_set())
            })
        };
        let missing = changes().filter(|(_, step)| one_each && **step > MISSING_STEPS * usual_s);
        let both = changes().filter(|(pair, step)| {
            let at_once = pair[1].publish.seconds_since(pair[0].publish) < AT_ONCE_SHARE * period_s;
            **step <= 0.0 && (one_each || at_once)
        });
        (missing.count(), both.count())
    }
}

#[cfg(test)]
mod tests {
    use super::{Seam, SeamFigures};
    use jink_shared_types::topics::LOCAL_MAP;
    use jink_shared_types::{SampleHeader, Timestamp};

    fn header(generation: u32, count: u64, capture_ms: u64, publish_ms: u64) -> SampleHeader {
        let at = |ms: u64| Timestamp::from_ns((1_000 + ms) * 1_000_000);
        SampleHeader {
            generation,
            sequence: u64::from(generation) << 32 | count,
            capture: at(capture_ms),
            publish: at(publish_ms),
            ..SampleHeader::default()
        }
    }

    fn figures(headers: &[SampleHeader]) -> Option<SeamFigures> {
        let mut seam = Seam::new("map/local", LOCAL_MAP.row);
        headers.iter().for_each(|header| seam.take(header));
        seam.figures()
    }

    #[test]
    fn a_seamless_change_shows_nothing() {
        let headers: Vec<_> = (0..20)
            .map(|n| header(1 + u32::from(n >= 10), n % 10, n * 100, n * 100 + 6))
            .collect();
        let found = figures(&headers).unwrap();
        assert_eq!((found.missing, found.doubled, found.reordered), (0, 0, 0));
        assert_eq!((found.changes, found.gap_periods), (1, 1.0));
        assert_eq!(figures(&headers[..10]), None);
    }

    #[test]
    fn a_lost_a_doubled_and_a_late_sample_are_found() {
        let mut headers: Vec<_> = (0..20)
            .map(|n| header(1 + u32::from(n >= 10), n % 10, n * 100, n * 100 + 6))
            .collect();
        // Within the stream of one producer a gap is its own business.
        headers.remove(15);
        let found = figures(&headers).unwrap();
        assert_eq!((found.missing, found.doubled), (0, 0), "{found:?}");
        // The last one of the old producer is lost.
        let last = headers.remove(9);
        let found = figures(&headers).unwrap();
        assert_eq!((found.missing, found.doubled), (1, 0), "{found:?}");
        // The new one answers what the old one has answered, and the old one comes again.
        headers.insert(9, last);
        headers.insert(10, header(2, 0, 900, 907));
        headers.insert(11, header(1, 10, 950, 950));
        let found = figures(&headers).unwrap();
        assert_eq!(found.doubled, 1, "{found:?}");
        assert!(found.reordered >= 1, "{found:?}");
    }
}
