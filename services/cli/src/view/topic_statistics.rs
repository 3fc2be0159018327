//! The rate of a topic as measured on its samples.

use jink_control::figures::round;
use jink_shared_types::quantile::quantile;
use jink_shared_types::topics::TopicRow;
use jink_shared_types::{SampleHeader, Timestamp};
use serde_json::json;

/// What the headers of successive samples say.
#[derive(Clone, Debug, Default)]
pub struct TopicStatistics {
    first: Timestamp,
    last: Option<SampleHeader>,
    samples: u64,
    lost: u64,
    doubled: u64,
    changes: u64,
    shortest_s: f64,
    longest_s: f64,
    ages_s: Vec<f64>,
}

impl TopicStatistics {
    /// Takes the next sample.
    pub fn take(&mut self, header: &SampleHeader) {
        self.samples += 1;
        if header.capture.is_set() {
            self.ages_s.push(header.publish.seconds_since(header.capture));
        }
        let Some(last) = self.last.replace(*header) else {
            self.first = header.publish;
            self.shortest_s = f64::INFINITY;
            return;
        };
        let interval_s = header.publish.seconds_since(last.publish);
        self.shortest_s = self.shortest_s.min(interval_s);
        self.longest_s = self.longest_s.max(interval_s);
        if header.sequence >> 32 == last.sequence >> 32 {
            self.lost += header.sequence.saturating_sub(last.sequence).saturating_sub(1);
            self.doubled += u64::from(header.sequence <= last.sequence);
        } else {
            self.changes += 1;
        }
    }

    /// Samples seen.
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// Samples a second; `None` before the second sample.
    pub fn rate_hz(&self) -> Option<f64> {
        let span_s = self.last?.publish.seconds_since(self.first);
        (self.samples > 1 && span_s > 0.0).then(|| (self.samples - 1) as f64 / span_s)
    }

    /// Longest time between two samples (s); `None` before the second.
    pub fn longest_s(&self) -> Option<f64> {
        (self.samples > 1).then_some(self.longest_s)
    }

    /// Samples that were missed.
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Age at publication (s): the `share` quantile; `None` if the samples carry no time of capture.
    pub fn age_s(&self, share: f64) -> Option<f64> {
        quantile(&self.ages_s, share)
    }

    /// For people.
    pub fn line(&self, name: &str, row: &TopicRow) -> String {
        let declared = match row.rate_hz {
            rate if rate > 0.0 => format!("declared at least {rate} Hz"),
            _ => "declared on change".to_owned(),
        };
        let Some(rate_hz) = self.rate_hz() else {
            return format!("{name}: {} samples ({declared})", self.samples);
        };
        let age = match (self.age_s(0.5), self.age_s(0.99)) {
            (Some(p50), Some(p99)) => {
                format!(
                    ", age at publication {:.1} / {:.1} ms p50/p99",
                    p50 * 1e3,
                    p99 * 1e3
                )
            }
            _ => String::new(),
        };
        // Of several producers each counts for itself.
        if row.is_shared() {
            return format!(
                "{name}: {rate_hz:.1} Hz ({declared}), {} samples {:.1} to {:.1} ms apart",
                self.samples,
                self.shortest_s * 1e3,
                self.longest_s * 1e3
            );
        }
        let changes = match self.changes {
            0 => String::new(),
            1 => ", producer replaced once".to_owned(),
            n => format!(", producer replaced {n} times"),
        };
        format!(
            "{name}: {rate_hz:.1} Hz ({declared}), {} samples {:.1} to {:.1} ms apart, {} lost{changes}{age}",
            self.samples,
            self.shortest_s * 1e3,
            self.longest_s * 1e3,
            self.lost
        )
    }

    /// For scripts.
    pub fn json(&self, name: &str, row: &TopicRow) -> serde_json::Value {
        let ms = |seconds: Option<f64>| seconds.map(|s| round(s * 1e3));
        let counted = |count: u64| (!row.is_shared()).then_some(count);
        let apart = (self.samples > 1).then_some((self.shortest_s, self.longest_s));
        json!({
            "topic": name,
            "declared_hz": row.rate_hz,
            "rate_hz": self.rate_hz().map(round),
            "samples": self.samples,
            "lost": counted(self.lost),
            "doubled": counted(self.doubled),
            "producer_changes": counted(self.changes),
            "interval_min_ms": ms(apart.map(|(shortest, _)| shortest)),
            "interval_max_ms": ms(apart.map(|(_, longest)| longest)),
            "age_p50_ms": ms(self.age_s(0.5)),
            "age_p99_ms": ms(self.age_s(0.99)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::TopicStatistics;
    use jink_shared_types::topics::{EVENT, LOCAL_MAP};
    use jink_shared_types::{SampleHeader, Timestamp};

    fn header(sequence: u64, publish_s: f64) -> SampleHeader {
        SampleHeader {
            sequence,
            publish: Timestamp::from_seconds(publish_s),
            capture: Timestamp::from_seconds(publish_s - 0.004),
            ..SampleHeader::default()
        }
    }

    #[test]
    fn rate_losses_and_changes_of_the_producer_are_reported() {
        let mut statistics = TopicStatistics::default();
        assert_eq!(statistics.rate_hz(), None);
        assert_eq!(
            statistics.line("event", &EVENT.row),
            "event: 0 samples (declared on change)"
        );
        let (mut all, mut together) = (statistics.clone(), header(1 << 32, 1.0));
        for time in [1.0, 1.5, 2.0] {
            together.publish = Timestamp::from_seconds(time);
            all.take(&together);
        }
        assert_eq!(
            all.line("event", &EVENT.row),
            "event: 2.0 Hz (declared on change), 3 samples 500.0 to 500.0 ms apart"
        );
        for (sequence, time) in [(1 << 32, 1.0), (1 << 32 | 3, 1.1), (2 << 32, 1.3)] {
            statistics.take(&header(sequence, time));
        }
        let line = statistics.line("map/local", &LOCAL_MAP.row);
        assert_eq!(
            line,
            "map/local: 6.7 Hz (declared at least 10 Hz), 3 samples 100.0 to 200.0 ms apart, 2 lost, producer replaced once, \
             age at publication 4.0 / 4.0 ms p50/p99"
        );
        let json = statistics.json("map/local", &LOCAL_MAP.row);
        assert_eq!((&json["lost"], &json["producer_changes"]), (&2.into(), &1.into()));
    }
}
