//! Measurements of a device that does not scan: the nearest of each period becomes a scan of one beam.
//!
//! Devices measure up to a thousand times a second, consumers read some twenty times. Nothing near is lost between two
//! reads: of what was measured since the last scan, the nearest counts.
//!
//! **Confirmation.** Where a frame can be damaged and look sound (an 8-bit sum, no checksum at all), the nearest answer
//! counts if another one of the same period, or the last one of the period before, agrees: if it differs by no more
//! than a vehicle can have come nearer in the time between the two, at 20 m/s, and four standard deviations. Otherwise
//! the beam is unknown for this period. That is sound because of what it can cost. A measurement that nothing confirms
//! is never taken for free space, however far it is, and never for an obstacle; unknown space is not flown into. And a
//! real thing is confirmed: at 100 Hz, a pole of 5 cm at 3 m that passes through a beam of 2 deg at 1 rad/s is measured
//! five times in a row.

use crate::devices::Range;
use jink_shared_types::Timestamp;

/// Answers of one period at most: more end it early.
const ANSWERS: usize = 64;
/// No multicopter that jink flies comes nearer to anything faster (m/s): the upper limit of `OA_SPD_MAX`.
const FASTEST_MPS: f64 = 20.0;
/// Two measurements further apart in time (s) than a scan may be old do not confirm each other.
const NEIGHBOUR_S: f64 = 0.25;

#[derive(Clone, Copy, Debug)]
struct TimedRange {
    time: Timestamp,
    range: Range,
}

const NONE: TimedRange = TimedRange {
    time: Timestamp::NEVER,
    range: Range::Unknown,
};

/// What was measured since the last scan.
#[derive(Clone, Debug)]
pub struct BeamFilter {
    period_s: f64,
    confirm: bool,
    sigma_m: f64,
    answers: [TimedRange; ANSWERS],
    len: usize,
    /// The last measurement of the period before.
    before: TimedRange,
}

/// The result of a period.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeamResult {
    /// When it was measured.
    pub time: Timestamp,
    /// The range as in a scan (m).
    pub range_m: f32,
}

impl BeamFilter {
    /// For scans every `period_s`; with `confirm`, a measurement counts when a second one agrees.
    pub fn new(period_s: f64, confirm: bool, sigma_m: f64) -> Self {
        Self {
            period_s,
            confirm,
            sigma_m,
            answers: [NONE; ANSWERS],
            len: 0,
            before: NONE,
        }
    }

    /// Adds a measurement made at `time`.
    pub fn take(&mut self, time: Timestamp, range: Range) {
        if let Some(place) = self.answers.get_mut(self.len) {
            *place = TimedRange { time, range };
            self.len += 1;
        }
    }

    /// When the period ends; never while it is empty.
    pub fn due(&self) -> Timestamp {
        match self.len {
            0 => Timestamp::from_ns(u64::MAX),
            ANSWERS => self.answers[0].time,
            _ => self.answers[0].time.plus_seconds(self.period_s),
        }
    }

    /// Ends the period and returns its result, unless nothing was measured.
    pub fn close(&mut self) -> Option<BeamResult> {
        let answers = &self.answers[..self.len];
        let last = *answers.last()?;
        // Of equal ones the latest: it is the youngest.
        let nearest = answers.iter().enumerate().rev().min_by(|a, b| nearer(a.1, b.1));
        let confirmed =
            nearest.and_then(|(index, nearest)| Some((nearest.time, self.confirmed(index, nearest)?)));
        let (time, range) = confirmed.unwrap_or((last.time, Range::Unknown));
        let outcome = BeamResult {
            time,
            range_m: range.metres(),
        };
        self.before = last;
        self.len = 0;
        Some(outcome)
    }

    /// The line was interrupted.
    pub fn clear(&mut self) {
        self.len = 0;
        self.before = NONE;
    }

    /// The confirmed range of the nearest measurement. Where only the period before agrees, the nearer of the two
    /// counts: either of them may be the damaged one.
    fn confirmed(&self, index: usize, one: &TimedRange) -> Option<Range> {
        let mut others = self.answers[..self.len].iter().enumerate();
        if !self.confirm || others.any(|(other, answers)| other != index && self.agree(one, answers)) {
            return Some(one.range);
        }
        let pair = [one, &self.before];
        let nearest = pair.into_iter().min_by(|a, b| nearer(a, b));
        nearest
            .filter(|_| self.agree(one, &self.before))
            .map(|answers| answers.range)
    }

    fn agree(&self, one: &TimedRange, other: &TimedRange) -> bool {
        let apart_s = one.time.seconds_since(other.time).abs();
        if apart_s > NEIGHBOUR_S {
            return false;
        }
        match (one.range, other.range) {
            (Range::Hit(one_m), Range::Hit(other_m)) => {
                let apart_m = f64::from((one_m - other_m).abs());
                apart_m <= FASTEST_MPS * apart_s + 4.0 * self.sigma_m
            }
            (Range::Clear, Range::Clear) => true,
            _ => false,
        }
    }
}

/// Orders by range; what is unknown comes last.
fn nearer(a: &TimedRange, b: &TimedRange) -> std::cmp::Ordering {
    let key = |answers: &TimedRange| match answers.range {
        Range::Hit(range_m) => (0, range_m),
        Range::Clear => (1, 0.0),
        Range::Unknown => (2, 0.0),
    };
    let (a, b) = (key(a), key(b));
    a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
}

#[cfg(test)]
mod tests {
    use super::{BeamFilter, BeamResult};
    use crate::devices::Range::{self, Clear, Hit, Unknown};
    use jink_shared_types::Timestamp;
    use proptest::prelude::*;

    fn at(ms: u64) -> Timestamp {
        Timestamp::from_ns((10_000 + ms) * 1_000_000)
    }

    fn period(confirm: bool, ranges: &[Range]) -> BeamResult {
        let mut beam = BeamFilter::new(0.05, confirm, 0.03);
        for (index, range) in ranges.iter().enumerate() {
            beam.take(at(index as u64 * 10), *range);
        }
        beam.close().unwrap()
    }

    #[test]
    fn the_nearest_of_a_period_counts_with_its_own_time() {
        let outcome = period(false, &[Clear, Hit(5.0), Hit(4.0), Unknown, Hit(6.0)]);
        assert_eq!((outcome.time, outcome.range_m), (at(20), 4.0));
        assert_eq!(period(false, &[Hit(4.0), Hit(4.0), Hit(5.0)]).time, at(10));
        assert_eq!(period(false, &[Unknown, Clear]).range_m, f32::INFINITY);
        assert!(period(false, &[Unknown, Unknown]).range_m.is_nan());
    }

    #[test]
    fn an_answer_that_stands_alone_is_unknown_near_or_far() {
        assert!(
            period(true, &[Hit(5.0), Hit(1.0), Hit(5.0), Hit(5.0)])
                .range_m
                .is_nan()
        );
        assert!(period(true, &[Unknown, Clear, Unknown]).range_m.is_nan());
        assert!(period(true, &[Hit(5.0)]).range_m.is_nan());
        assert_eq!(period(true, &[Hit(5.1), Hit(5.0), Clear, Hit(11.0)]).range_m, 5.0);
        assert_eq!(period(true, &[Clear, Clear, Unknown]).range_m, f32::INFINITY);
    }

    #[test]
    fn a_slow_device_is_confirmed_by_the_period_before() {
        let mut beam = BeamFilter::new(0.05, true, 0.03);
        let mut outcomes = Vec::new();
        for (ms, range) in [
            (0, Hit(5.0)),
            (50, Hit(4.9)),
            (100, Hit(2.0)),
            (150, Hit(2.0)),
            (900, Hit(2.0)),
        ] {
            beam.take(at(ms), range);
            outcomes.push(beam.close().unwrap().range_m);
        }
        assert!(
            outcomes[0].is_nan() && outcomes[2].is_nan() && outcomes[4].is_nan(),
            "{outcomes:?}"
        );
        assert_eq!((outcomes[1], outcomes[3]), (4.9, 2.0));
    }

    #[test]
    fn a_period_ends_on_time_or_when_it_is_full() {
        let mut beam = BeamFilter::new(0.05, true, 0.03);
        assert_eq!(beam.due(), Timestamp::from_ns(u64::MAX));
        beam.take(at(7), Clear);
        assert_eq!(beam.due(), at(57));
        for _ in 0..100 {
            beam.take(at(8), Clear);
        }
        assert_eq!(beam.due(), at(7));
    }

    fn any_range() -> impl Strategy<Value = Range> {
        prop_oneof![(0.0..12.0f32).prop_map(Hit), Just(Clear), Just(Unknown),]
    }

    proptest! {
        #[test]
        fn nothing_measured_only_once_is_ever_published(ranges in prop::collection::vec(any_range(), 1..20)) {
            let published = period(true, &ranges).range_m;
            let tolerance_m = 20.0 * 0.01 * ranges.len() as f32 + 0.12;
            let supporting = ranges.iter().filter(|range| match range {
                Hit(range_m) => (range_m - published).abs() <= tolerance_m,
                Clear => published == f32::INFINITY,
                Unknown => false,
            });
            prop_assert!(published.is_nan() || supporting.count() >= 2);
        }

        #[test]
        fn what_is_published_is_never_farther_than_anything_measured(ranges in prop::collection::vec(any_range(), 1..20)) {
            for confirm in [true, false] {
                let published = period(confirm, &ranges).range_m;
                for range in &ranges {
                    if let Hit(range_m) = range {
                        prop_assert!(published.is_nan() || published <= *range_m);
                    }
                }
            }
        }
    }
}
