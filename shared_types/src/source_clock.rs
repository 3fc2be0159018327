//! The clock of a source (a sensor, an autopilot) on the board's: the least delayed message of the last second dates all
//! of them.
//!
//! A message arrives some delay after the moment that its stamp names: at least the time on the wire, at times much more,
//! because a network or a scheduler kept it. So the smallest difference between arrival and stamp in a window is the best
//! estimate of the offset of the two clocks. This is the minimum filter of NTP (RFC 5905, section 10) for one direction.
//!
//! | what happens | what becomes of it |
//! |---|---|
//! | messages are held back and come in a burst | the window advances by the time that passes on both clocks, so that a burst does not empty it |
//! | the clocks drift apart, or the delay stays longer than before | the window forgets |
//! | the source's clock is set ahead | arrivals come earlier after the stamps: the new smallest difference counts at once, one that is smaller by half a second when eight messages in a row have it (a damaged stamp is alone); until then each is dated to its arrival |
//! | it is set back | eight stamps in a row are older than the newest one: the window begins anew with them. A step of less than eight messages is forgotten with the window |
//!
//! A message is never dated later than the least delayed one of the window allows, so its age is at least its true age
//! less that delay. It is dated a second before its arrival at most: older ones are of no use anyway.

use crate::Timestamp;

/// Parts of the window, and the length of one (ns): the window holds 0.64 to 0.8 s, so that within a second a clock that was
/// set is forgotten.
const PARTS: usize = 5;
const PART_NS: i128 = 160_000_000;
/// Messages overtake each other by less than this, and smaller changes of the offset are none (ns).
const SLACK_NS: i128 = 20_000_000;
/// A stamp that is ahead of the offset by more than this (ns) is damaged, or its clock was set.
const AHEAD_NS: i128 = 500_000_000;
/// Contradictions in a row after which the source's clock has been set: some milliseconds of a network lidar.
const CONTRADICTIONS: u32 = 8;
/// No message is dated earlier than this before its arrival (ns): older ones are of no use.
const OLDEST_NS: i128 = 1_000_000_000;
/// A part in which nothing has come.
const NOTHING: i128 = i128::MAX;

/// How a source's clock was set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockStep {
    /// By how much it went ahead (s).
    pub ahead_s: f64,
    /// Its stamps contradict each other. Otherwise its messages may as well be delayed by so much more or less than before.
    pub is_certain: bool,
}

/// Maps stamps of one source to the board's clock.
#[derive(Clone, Copy, Debug)]
pub struct SourceClock {
    /// Smallest arrival minus stamp (ns) of each part of the window, the newest first.
    least_ns: [i128; PARTS],
    /// Stamp and arrival of the message with which the newest part began (ns).
    part_began_ns: [i128; 2],
    /// Stamp of the last message (ns).
    last_ns: Option<u64>,
    /// The newest stamp that contradicts nothing (ns).
    newest_ns: i128,
    /// Contradictions in a row, and the smallest difference among them (ns).
    contradictions: u32,
    contradicting_ns: i128,
    /// Of the message at hand: board time minus source time (ns).
    offset_ns: i128,
}

impl Default for SourceClock {
    fn default() -> Self {
        Self {
            least_ns: [NOTHING; PARTS],
            part_began_ns: [0; 2],
            last_ns: None,
            newest_ns: 0,
            contradictions: 0,
            contradicting_ns: 0,
            offset_ns: 0,
        }
    }
}

impl SourceClock {
    /// Takes a message with its latest stamp (ns of the source's clock), which arrived at `arrived`. Its stamps are then
    /// mapped by [`Self::map`]. Says when the source's clock has been set; once per step.
    pub fn observe(&mut self, stamp_ns: u64, arrived: Timestamp) -> Option<ClockStep> {
        let is_first = self.last_ns.replace(stamp_ns).is_none();
        let [stamp_ns, arrived_ns] = [stamp_ns, arrived.ns].map(i128::from);
        let seen_ns = arrived_ns - stamp_ns;
        if is_first {
            self.begin(seen_ns, stamp_ns, arrived_ns);
            return None;
        }
        let least_ns = self.least();
        let is_ahead = seen_ns < least_ns - AHEAD_NS;
        if is_ahead || stamp_ns < self.newest_ns - SLACK_NS {
            let offset_ns = if is_ahead { seen_ns } else { least_ns };
            return self.contradiction(stamp_ns, arrived_ns, offset_ns);
        }
        self.contradictions = 0;
        self.newest_ns = self.newest_ns.max(stamp_ns);
        let [began_stamp_ns, began_arrived_ns] = self.part_began_ns;
        let passed_ns = (stamp_ns - began_stamp_ns).min(arrived_ns - began_arrived_ns);
        let mut step = None;
        if passed_ns >= PART_NS {
            step = self.step_of_parts();
            for _ in 0..(passed_ns / PART_NS).min(PARTS as i128) {
                self.least_ns.rotate_right(1);
                self.least_ns[0] = NOTHING;
            }
            self.part_began_ns = [stamp_ns, arrived_ns];
        }
        self.least_ns[0] = self.least_ns[0].min(seen_ns);
        self.offset_ns = self.least().max(seen_ns - OLDEST_NS);
        step
    }

    /// The moment that the source calls `stamp_ns`, on the board's clock.
    pub fn map(&self, stamp_ns: u64) -> Timestamp {
        let ns = (i128::from(stamp_ns) + self.offset_ns).clamp(1, i128::from(u64::MAX));
        Timestamp::from_ns(ns as u64)
    }

    /// Whether the last message contradicts those before it, and too few have agreed with it so far.
    pub const fn is_contradicted(&self) -> bool {
        self.contradictions > 0
    }

    /// The stamp of the last message (ns of the source's clock).
    pub const fn last_ns(&self) -> Option<u64> {
        self.last_ns
    }

    /// A message contradicts the others; until enough agree with it, it is dated by `offset_ns`.
    fn contradiction(&mut self, stamp_ns: i128, arrived_ns: i128, offset_ns: i128) -> Option<ClockStep> {
        let seen_ns = arrived_ns - stamp_ns;
        // What is held back comes ever less late: only messages that agree show how the clock was set.
        let agrees = self.contradictions > 0 && seen_ns >= self.contradicting_ns - SLACK_NS;
        self.contradicting_ns = if agrees {
            self.contradicting_ns.min(seen_ns)
        } else {
            seen_ns
        };
        self.contradictions = if agrees { self.contradictions + 1 } else { 1 };
        if self.contradictions < CONTRADICTIONS {
            self.offset_ns = offset_ns.clamp(seen_ns - OLDEST_NS, seen_ns);
            return None;
        }
        let ahead_ns = self.least() - self.contradicting_ns;
        // Of the first messages all may have been held back.
        let is_settled = self.least_ns[1] != NOTHING;
        self.begin(self.contradicting_ns, stamp_ns, arrived_ns);
        is_settled.then_some(ClockStep {
            ahead_s: ahead_ns as f64 * 1e-9,
            is_certain: true,
        })
    }

    /// The window begins with a message.
    fn begin(&mut self, least_ns: i128, stamp_ns: i128, arrived_ns: i128) {
        self.least_ns = [NOTHING; PARTS];
        self.least_ns[0] = least_ns;
        self.part_began_ns = [stamp_ns, arrived_ns];
        self.newest_ns = stamp_ns;
        self.contradictions = 0;
        self.offset_ns = least_ns.max(arrived_ns - stamp_ns - OLDEST_NS);
    }

    fn least(&self) -> i128 {
        self.least_ns.iter().copied().min().unwrap_or(NOTHING)
    }

    /// The newest part is complete: how the clock was set, if it and the one before differ from the two before them by much
    /// more than within both pairs, which drift and jitter do not make.
    fn step_of_parts(&self) -> Option<ClockStep> {
        let [newest, newer, older, oldest, _] = self.least_ns;
        if [newest, newer, older, oldest].contains(&NOTHING) {
            return None;
        }
        let (after_ns, before_ns) = (newest.min(newer), older.min(oldest));
        let within_ns = (newest - newer).abs().max((older - oldest).abs());
        ((after_ns - before_ns).abs() > SLACK_NS + 2 * within_ns).then_some(ClockStep {
            ahead_s: (before_ns - after_ns) as f64 * 1e-9,
            is_certain: false,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::{ClockStep, SourceClock};
    use crate::Timestamp;
    use proptest::prelude::*;

    const START_NS: u64 = 5_000_000_000_000;
    /// Where the source's clock stands at the start.
    const SOURCE_NS: i128 = 4_000_000_000_000_000_000;
    /// Delay of a message that nothing holds back (us).
    const DELAY_US: std::ops::Range<u64> = 100..30_000;

    /// Messages of one source: how far apart, how late each, when they are held back, and how the clock is wrong.
    #[derive(Clone, Debug)]
    struct Source {
        period_us: u64,
        delays_us: Vec<u64>,
        /// Message from which on messages are held back, and for how long (us).
        held: Option<(usize, u64)>,
        rate_ppm: i64,
        /// Message from which on the clock is ahead by so much (ns).
        step: Option<(usize, i64)>,
    }

    struct Dated {
        at: Timestamp,
        arrived: Timestamp,
        mapped: Timestamp,
        step: Option<ClockStep>,
    }

    impl Source {
        fn run(&self) -> Vec<Dated> {
            let mut clock = SourceClock::default();
            let mut free_ns = 0;
            let count = self.delays_us.len();
            (0..count)
                .map(|index| {
                    let since_ns = index as u64 * self.period_us * 1_000;
                    let at = Timestamp::from_ns(START_NS + since_ns);
                    let until_ns = self.held.map_or(0, |(first, held_us)| {
                        let begun_ns = START_NS + first as u64 * self.period_us * 1_000;
                        if index >= first {
                            begun_ns + held_us * 1_000
                        } else {
                            0
                        }
                    });
                    // Nothing overtakes.
                    free_ns = (at.ns + self.delays_us[index] * 1_000)
                        .max(until_ns)
                        .max(free_ns + 1_000);
                    let arrived = Timestamp::from_ns(free_ns);
                    let drift_ns = i128::from(since_ns) * i128::from(self.rate_ppm) / 1_000_000;
                    let step_ns = self
                        .step
                        .map_or(0, |(first, ahead_ns)| if index >= first { ahead_ns } else { 0 });
                    let stamp_ns = (SOURCE_NS + i128::from(since_ns) + drift_ns + i128::from(step_ns)) as u64;
                    let step = clock.observe(stamp_ns, arrived);
                    Dated {
                        at,
                        arrived,
                        mapped: clock.map(stamp_ns),
                        step,
                    }
                })
                .collect()
        }
    }

    fn source() -> impl Strategy<Value = Source> {
        let held = prop::option::of((0usize..1_500, 0u64..5_000_000));
        (
            1_000u64..20_000,
            prop::collection::vec(DELAY_US, 1_500),
            held,
            -100i64..=100,
        )
            .prop_map(|(period_us, delays_us, held, rate_ppm)| Source {
                period_us,
                delays_us,
                held,
                rate_ppm,
                step: None,
            })
    }

    fn steps() -> impl Strategy<Value = i64> {
        let size = prop_oneof![
            1_000_000i64..50_000_000,
            50_000_000i64..2_000_000_000,
            2_000_000_000i64..3_000_000_000_000_000_000
        ];
        (size, any::<bool>()).prop_map(|(size_ns, ahead)| if ahead { size_ns } else { -size_ns })
    }

    /// What jitter, and the drift within a window, may shift (ns).
    const JITTER_NS: u64 = (DELAY_US.end + 200) * 1_000;

    proptest! {
        #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

        #[test]
        fn whatever_delays_messages_their_age_is_never_understated_by_more_than_jitter(source in source()) {
            // Of messages that are held back from the first on nothing better is known.
            let from_first = source.held.is_some_and(|(first, _)| first < 100);
            for dated in source.run().iter().filter(|_| !from_first) {
                // What is a second old is dated so.
                let true_ns = dated.at.ns.max(dated.arrived.ns - 1_000_000_000);
                prop_assert!(dated.mapped.ns <= true_ns + JITTER_NS, "{dated:?}", dated = (dated.at, dated.mapped));
                prop_assert!(dated.mapped <= dated.arrived);
                prop_assert!(dated.arrived.seconds_since(dated.mapped) <= 1.0 + 1e-9);
                prop_assert_eq!(dated.step, None);
            }
        }

        #[test]
        fn a_clock_that_is_set_is_followed_within_a_second_and_no_age_is_understated(
            source in source(), ahead_ns in steps(),
        ) {
            const FIRST: usize = 1_200;
            let mut source = Source { held: None, step: Some((FIRST, ahead_ns)), ..source };
            source.delays_us.resize(FIRST + 3_000_000 / source.period_us as usize, 5_000);
            let all = source.run();
            let set_at = all[FIRST].at;
            for dated in &all {
                prop_assert!(dated.mapped.ns <= dated.at.ns + JITTER_NS, "{:?} is dated {:?}", dated.at, dated.mapped);
                let since_s = dated.at.seconds_since(set_at);
                if !(0.0..=1.1).contains(&since_s) {
                    prop_assert!(
                        dated.mapped.ns + JITTER_NS >= dated.at.ns,
                        "{:?} is dated {:?}, {} s after a step of {} ns", dated.at, dated.mapped, since_s, ahead_ns
                    );
                }
            }
            let told: Vec<f64> = all.iter().filter_map(|dated| dated.step).map(|step| step.ahead_s).collect();
            let is_large = ahead_ns.unsigned_abs() > 150_000_000;
            prop_assert!(told.len() <= 1, "{told:?}");
            prop_assert!(!is_large || told.len() == 1, "a step of {ahead_ns} ns is not told");
            for told_s in told {
                prop_assert!((told_s - ahead_ns as f64 * 1e-9).abs() <= 0.06 + 1e-9 * (ahead_ns as f64).abs() * 1e-3);
            }
        }

        #[test]
        fn any_stamps_and_arrivals_are_mapped_no_later_than_they_arrive(pairs in prop::collection::vec((any::<u64>(), any::<u64>()), 1..50)) {
            let mut clock = SourceClock::default();
            for (stamp_ns, arrived_ns) in pairs {
                let arrived = Timestamp::from_ns(arrived_ns);
                clock.observe(stamp_ns, arrived);
                prop_assert!(clock.map(stamp_ns) <= arrived.max(Timestamp::from_ns(1)));
                prop_assert!(arrived.seconds_since(clock.map(stamp_ns)) <= 1.0 + 1e-6);
            }
        }
    }

    /// Messages every millisecond, each `delay_us` late.
    fn at(index: u64, delay_us: u64) -> Timestamp {
        Timestamp::from_ns(START_NS + index * 1_000_000 + delay_us * 1_000)
    }

    #[test]
    fn damaged_stamps_change_nothing() {
        let mut clock = SourceClock::default();
        for index in 0..3_000u64 {
            let stamp_ns = index * 1_000_000;
            if index % 100 == 99 {
                let damaged_ns = [77_000_000_000_000, 0][index as usize / 100 % 2];
                assert_eq!(clock.observe(damaged_ns, at(index, 300)), None);
                continue;
            }
            assert_eq!(clock.observe(stamp_ns, at(index, 300 + index * 7 % 900)), None);
            let off_ns = clock.map(stamp_ns).ns.abs_diff(at(index, 300).ns);
            assert!(index < 200 || off_ns < 100_000, "{index}: {off_ns}");
        }
    }

    #[test]
    fn a_clock_that_runs_slow_is_followed_however_slow() {
        for slow in [0.000_1, 0.05, 0.2, 0.5] {
            let mut clock = SourceClock::default();
            for index in 0..20_000 {
                let stamp_ns = (index as f64 * 1e6 * (1.0 - slow)) as u64;
                assert!(
                    clock
                        .observe(stamp_ns, at(index, 300))
                        .is_none_or(|step| !step.is_certain)
                );
                let behind_s = at(index, 300).seconds_since(clock.map(stamp_ns));
                // What the clocks drift apart within the window.
                assert!(
                    (-1e-9..=slow / (1.0 - slow) + 1e-3).contains(&behind_s),
                    "{slow}: {behind_s}"
                );
            }
        }
    }

    #[test]
    fn messages_of_another_moment_in_between_do_not_count_as_a_clock_that_is_set() {
        let mut clock = SourceClock::default();
        for index in 0..2_000u64 {
            // Every second one is 15 ms older than the other, as two kinds of messages of an autopilot are.
            let stamp_ns = 1_000_000_000 + index * 10_000_000 - index % 2 * 15_000_000;
            let arrived = Timestamp::from_ns(START_NS + index * 10_000_000);
            assert_eq!(clock.observe(stamp_ns, arrived), None);
        }
    }
}
