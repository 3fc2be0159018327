//! The autopilot's clock on the board's clock.
//!
//! | in | out |
//! |---|---|
//! | responses to our TIMESYNC requests | offset, shortest round trip, whether both can be trusted |
//! | time stamps of the autopilot with their time of reception | the same moments as [`Timestamp`]s |
//! | a moment of the board's clock | the autopilot's clock then, not ahead of the newest stamp and the time since |
//!
//! A request leaves at board time `a`, the autopilot notes `p` of its own clock, the sample arrives at board time `b`.
//! Then `p` happened between `a` and `b`, so the offset (autopilot minus board) is `p - (a + b) / 2` with an error of
//! at most half the round trip `b - a`. Short round trips are therefore the exact ones: the estimate is the mean over
//! those of the last few seconds that are within `RTT_SLACK_NS` of the shortest. This is the clock filter of NTP (RFC
//! 5905, section 10) in its simplest form.
//!
//! Clocks of hardware agree in their rate to some 50 ppm; a simulated autopilot's may run a per cent slow. Each sample
//! bounds the offset to an interval of half a round trip to both sides. While one offset lies in the intervals of all
//! samples, the rates are taken as equal. Once none does, a line is fitted through the offsets, each weighted by the
//! square of what it knows (1 / round trip), and stamps are mapped along that line.
//!
//! Until enough samples have come, a stamp is mapped through its reception ([`SourceClock`]). Where the stamps themselves
//! show that the autopilot's clock was set, the samples before count no more.

use jink_shared_types::Timestamp;
use jink_shared_types::source_clock::SourceClock;

/// Samples that are remembered: about six seconds at 10 Hz.
const WINDOW: usize = 64;
/// Samples older than this (s) count no more: clocks that drift by 50 ppm are 0.4 ms apart by then.
const WINDOW_S: f64 = 8.0;
/// Rate of requests until the estimate can be trusted, and while it is in doubt (Hz): the autopilot's own.
pub const SEARCHING_HZ: f64 = 10.0;
/// The same from then on (Hz). An autopilot may pass requests on to the ground station's radio; in a second a clock
/// drifts by 0.05 ms.
const FOLLOWING_HZ: f64 = 1.0;
/// A clock whose rate differs by more than this (1) has jumped.
const RATE_ERROR_MAX: f64 = 0.2;
/// Samples needed before the estimate is used: two seconds at 10 Hz, so that a few short round trips are among
/// them.
const NEEDED: u32 = 20;
/// How much longer than the shortest a round trip may be to count in the mean (ns).
const RTT_SLACK_NS: u64 = 500_000;
/// After so long (ns) a counter of milliseconds begins anew.
const WRAP_NS: i64 = 1_000_000 << 32;
/// By how much a sample may contradict the estimate beyond its own error bound (ns) before it is an outlier.
const OUTLIER_NS: u64 = 10_000_000;
/// Outliers in a row after which the autopilot's clock has jumped (half a second at 10 Hz): start again.
const OUTLIERS_TO_RESET: u32 = 5;
/// A round trip above this is no measurement (ns).
const LONGEST_RTT_NS: u64 = 1_000_000_000;
/// Requests that can be under way.
const PENDING: usize = 16;
/// No message is older than this when it arrives (s); a stamp that claims so is wrong.
const OLDEST_S: f64 = 1.0;
/// By how much the autopilot's clock can have stood still (ns): a simulated one on a busy machine lost 85 ms. A stamp that is farther behind
/// the estimate was held back on its way.
const STOOD_STILL_NS: i64 = 200_000_000;

#[derive(Clone, Copy, Debug, Default)]
struct TimesyncSample {
    /// Board time in the middle of its round trip.
    at: Timestamp,
    offset_ns: i64,
    round_trip_ns: u64,
}

/// What is known of the offset.
#[derive(Clone, Copy, Debug, Default)]
struct Estimate {
    /// Board time at which the offset is `offset_ns`.
    at: Timestamp,
    offset_ns: i64,
    /// Growth of the offset (ns per ns); zero where the rates are equal as far as can be measured.
    rate_error: f64,
    round_trip_ns: u64,
}

impl Estimate {
    fn offset_ns(&self, at: Timestamp) -> i64 {
        let growth_ns = self.rate_error * at.seconds_since(self.at) * 1e9;
        self.offset_ns.saturating_add(growth_ns as i64)
    }
}

/// Maps the autopilot's clock to the board's.
#[derive(Clone, Debug)]
pub struct ClockMap {
    pending: [Timestamp; PENDING],
    next_pending: usize,
    accepts_foreign: bool,
    window: [TimesyncSample; WINDOW],
    good: u32,
    outliers: u32,
    estimate: Estimate,
    reception: SourceClock,
    /// The newest stamp that contradicts nothing (ns), and when it arrived.
    newest: Option<(u64, Timestamp)>,
    /// By how much the autopilot's clock was set ahead (s), until that is reported.
    step_s: Option<f64>,
}

impl Default for ClockMap {
    fn default() -> Self {
        Self {
            pending: [Timestamp::NEVER; PENDING],
            next_pending: 0,
            accepts_foreign: false,
            window: [TimesyncSample::default(); WINDOW],
            good: 0,
            outliers: 0,
            estimate: Estimate::default(),
            reception: SourceClock::default(),
            newest: None,
            step_s: None,
        }
    }
}

impl ClockMap {
    /// Notes that a request leaves at `now`; its `ts1` is `now` in nanoseconds.
    pub fn request(&mut self, now: Timestamp) {
        self.pending[self.next_pending] = now;
        self.next_pending = (self.next_pending + 1) % PENDING;
    }

    /// Whether responses to the requests of another gateway on the same board are used, too: they carry the same clock.
    pub fn accept_foreign_answers(&mut self, accepts_foreign: bool) {
        self.accepts_foreign = accepts_foreign;
    }

    /// Processes a response received at `received`: the autopilot's clock `autopilot_ns`, and our request's time as it
    /// was sent back. Responses to requests that we did not send are ignored.
    pub fn on_response(&mut self, received: Timestamp, autopilot_ns: i64, echoed_ns: i64) {
        let Ok(sent_ns) = u64::try_from(echoed_ns) else {
            return;
        };
        let sent = Timestamp::from_ns(sent_ns);
        let slot = self
            .pending
            .iter_mut()
            .find(|pending| pending.is_set() && **pending == sent);
        match slot {
            Some(slot) => *slot = Timestamp::NEVER,
            None if self.accepts_foreign => {}
            None => return,
        }
        let round_trip_ns = received.ns_since(sent);
        if received < sent || round_trip_ns > LONGEST_RTT_NS || autopilot_ns < 0 {
            return;
        }
        let at = Timestamp::from_ns(sent.ns + round_trip_ns / 2);
        let Ok(offset_ns) = i64::try_from(i128::from(autopilot_ns) - i128::from(at.ns)) else {
            return;
        };
        self.take(TimesyncSample {
            at,
            offset_ns,
            round_trip_ns,
        });
    }

    fn take(&mut self, sample: TimesyncSample) {
        let deviation_ns = sample.offset_ns.abs_diff(self.estimate.offset_ns(sample.at));
        let bound_ns = (sample.round_trip_ns + self.estimate.round_trip_ns) / 2;
        if self.good > 0 && deviation_ns > bound_ns + OUTLIER_NS {
            self.outliers += 1;
            if self.outliers < OUTLIERS_TO_RESET {
                return;
            }
            let ahead_ns = sample
                .offset_ns
                .saturating_sub(self.estimate.offset_ns(sample.at));
            self.clock_was_set(ahead_ns as f64 * 1e-9);
        }
        self.outliers = 0;
        self.window[self.good as usize % WINDOW] = sample;
        self.good = self.good.saturating_add(1);
        self.estimate();
    }

    /// The samples before are of another clock, which differs by `ahead_s`.
    fn clock_was_set(&mut self, ahead_s: f64) {
        self.good = 0;
        self.outliers = 0;
        self.estimate = Estimate::default();
        self.step_s = Some(ahead_s);
    }

    /// By how much the autopilot's clock was set ahead (s); once per step.
    pub fn take_step(&mut self) -> Option<f64> {
        self.step_s.take()
    }

    fn estimate(&mut self) {
        let known = &self.window[..(self.good as usize).min(WINDOW)];
        let newest = known.iter().map(|sample| sample.at).max().unwrap_or_default();
        let recent = || {
            let young = |sample: &&TimesyncSample| newest.seconds_since(sample.at) <= WINDOW_S;
            known.iter().filter(young)
        };
        let shortest_ns = recent()
            .map(|sample| sample.round_trip_ns)
            .min()
            .unwrap_or(LONGEST_RTT_NS);
        self.estimate = if is_one_offset(recent()) {
            mean_of_short(recent(), shortest_ns, newest)
        } else {
            line_through(recent(), shortest_ns, newest)
        };
    }

    /// How often the autopilot is to be asked now (Hz).
    pub fn request_rate_hz(&self) -> f64 {
        if self.is_converged() && self.outliers == 0 {
            FOLLOWING_HZ
        } else {
            SEARCHING_HZ
        }
    }

    /// By how much the autopilot's clock runs faster than the board's (1); zero where no difference shows.
    pub fn rate_error(&self) -> f64 {
        self.estimate.rate_error
    }

    /// Whether the offset can be trusted.
    pub fn is_converged(&self) -> bool {
        self.good >= NEEDED
    }

    /// Autopilot clock minus board clock (ns); 0 before the first sample.
    pub fn offset_ns(&self) -> i64 {
        self.estimate.offset_ns
    }

    /// Shortest round trip of the last seconds (ns); 0 before the first sample.
    pub fn round_trip_ns(&self) -> u64 {
        self.estimate.round_trip_ns
    }

    /// Good samples since the last reset.
    pub fn samples(&self) -> u32 {
        self.good
    }

    /// The moment that the autopilot calls `boot_ms` milliseconds (a counter that wraps after 49.7 days), received at
    /// `received`. Never later than `received`, never more than a second earlier.
    pub fn map_ms(&mut self, boot_ms: u32, received: Timestamp) -> Timestamp {
        const NS_PER_MS: i64 = 1_000_000;
        // The counter as it would be if it did not wrap: nearest to the last stamp.
        let unwrapped_ms = self.reception.last_ns().map_or(u64::from(boot_ms), |last_ns| {
            let last_ms = last_ns / NS_PER_MS.unsigned_abs();
            let ahead_ms = boot_ms.wrapping_sub(last_ms as u32) as i32;
            last_ms.saturating_add_signed(i64::from(ahead_ms))
        });
        let stamp_ns = unwrapped_ms.saturating_mul(NS_PER_MS.unsigned_abs());
        self.observe(stamp_ns, received);
        if !self.is_converged() {
            return self.reception.map(stamp_ns);
        }
        let autopilot_ns = self.autopilot_ns(received).max(0);
        let whole_ms_behind = ((autopilot_ns / NS_PER_MS) as u32).wrapping_sub(boot_ms) as i32;
        let behind_ns = i64::from(whole_ms_behind) * NS_PER_MS + autopilot_ns % NS_PER_MS;
        bounded(received.plus_seconds(-(behind_ns as f64) * 1e-9), received)
    }

    /// The moment that the autopilot calls `boot_us` microseconds, as [`Self::map_ms`]; zero is taken for "not
    /// stamped" and becomes `received`.
    pub fn map_us(&mut self, boot_us: u64, received: Timestamp) -> Timestamp {
        let Some(boot_ns) = boot_us.checked_mul(1000).and_then(|ns| i64::try_from(ns).ok()) else {
            return received;
        };
        if boot_ns == 0 {
            return received;
        }
        self.observe(boot_ns.unsigned_abs(), received);
        if !self.is_converged() {
            return self.reception.map(boot_ns.unsigned_abs());
        }
        let behind_ns = self.autopilot_ns(received).saturating_sub(boot_ns);
        bounded(received.plus_seconds(-(behind_ns as f64) * 1e-9), received)
    }

    /// The autopilot's clock (ns) at `at`, before `now`. What it has shown for certain by now is its newest stamp and the time since that
    /// arrived; what is later than that may lie in its future. `None` before the first stamp.
    pub fn to_autopilot_ns(&self, now: Timestamp, at: Timestamp) -> Option<u64> {
        let (stamp_ns, arrived) = self.newest?;
        let since_ns = |time: Timestamp| nanoseconds(now) - nanoseconds(time);
        let shown_ns = i64::try_from(stamp_ns).ok()?.checked_add(since_ns(arrived))?;
        let estimated_ns = if self.is_converged() {
            self.autopilot_ns(at)
        } else {
            shown_ns + since_ns(self.reception.map(stamp_ns)) - since_ns(arrived) - since_ns(at)
        };
        // Stamps in milliseconds wrap.
        let ahead_ns =
            (estimated_ns.saturating_sub(shown_ns) + WRAP_NS / 2).rem_euclid(WRAP_NS) - WRAP_NS / 2;
        u64::try_from(estimated_ns - ahead_ns.clamp(0, STOOD_STILL_NS)).ok()
    }

    fn autopilot_ns(&self, at: Timestamp) -> i64 {
        i64::try_from(at.ns)
            .unwrap_or(i64::MAX)
            .saturating_add(self.estimate.offset_ns(at))
    }

    /// Notes a stamp. Where stamps contradict each other, the clock was set; a delay that has changed shows nothing here, because
    /// round trips tell it apart.
    fn observe(&mut self, stamp_ns: u64, received: Timestamp) {
        let step = self.reception.observe(stamp_ns, received);
        if !self.reception.is_contradicted() {
            self.newest = Some((stamp_ns, received));
        }
        if let Some(step) = step.filter(|step| step.is_certain) {
            self.clock_was_set(step.ahead_s);
        }
    }
}

/// Whether one offset explains all samples: their intervals have something in common.
fn is_one_offset<'a>(samples: impl Iterator<Item = &'a TimesyncSample>) -> bool {
    let half_ns = |sample: &TimesyncSample| i64::try_from(sample.round_trip_ns / 2).unwrap_or(i64::MAX);
    let (least_ns, most_ns) = samples.fold((i64::MIN, i64::MAX), |(least_ns, most_ns), sample| {
        (
            least_ns.max(sample.offset_ns.saturating_sub(half_ns(sample))),
            most_ns.min(sample.offset_ns.saturating_add(half_ns(sample))),
        )
    });
    // A crystal's drift in the window, and the halved nanosecond.
    least_ns.saturating_sub(most_ns) <= RTT_SLACK_NS as i64
}

fn mean_of_short<'a>(
    samples: impl Iterator<Item = &'a TimesyncSample>,
    shortest_ns: u64,
    newest: Timestamp,
) -> Estimate {
    let short = samples.filter(|sample| sample.round_trip_ns <= shortest_ns + RTT_SLACK_NS);
    let (sum, count) = short.fold((0i128, 0i128), |(sum, count), sample| {
        (sum + i128::from(sample.offset_ns), count + 1)
    });
    Estimate {
        at: newest,
        offset_ns: (sum / count.max(1)) as i64,
        rate_error: 0.0,
        round_trip_ns: shortest_ns,
    }
}

/// Weighted least squares, around the newest sample.
fn line_through<'a>(
    samples: impl Iterator<Item = &'a TimesyncSample> + Clone,
    shortest_ns: u64,
    newest: Timestamp,
) -> Estimate {
    let base_ns = samples.clone().next().map_or(0, |sample| sample.offset_ns);
    let (mut weight, mut t, mut o, mut tt, mut to) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for sample in samples {
        let w = (sample.round_trip_ns as f64).max(1e3).powi(-2) * 1e12;
        let time_s = -newest.seconds_since(sample.at);
        let offset_s = sample.offset_ns.saturating_sub(base_ns) as f64 * 1e-9;
        weight += w;
        t += w * time_s;
        o += w * offset_s;
        tt += w * time_s * time_s;
        to += w * time_s * offset_s;
    }
    let spread = weight * tt - t * t;
    let slope = if spread > 0.0 {
        ((weight * to - t * o) / spread).clamp(-RATE_ERROR_MAX, RATE_ERROR_MAX)
    } else {
        0.0
    };
    let offset_s = if weight > 0.0 {
        (o - slope * t) / weight
    } else {
        0.0
    };
    Estimate {
        at: newest,
        offset_ns: base_ns.saturating_add((offset_s * 1e9) as i64),
        rate_error: slope,
        round_trip_ns: shortest_ns,
    }
}

fn bounded(mapped: Timestamp, received: Timestamp) -> Timestamp {
    mapped.min(received).max(received.plus_seconds(-OLDEST_S))
}

/// Nanoseconds as TIMESYNC carries them.
pub fn nanoseconds(time: Timestamp) -> i64 {
    i64::try_from(time.ns).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests {
    use super::{ClockMap, NEEDED};
    use jink_shared_types::Timestamp;
    use proptest::prelude::*;

    const START_S: f64 = 1000.0;

    /// Runs one exchange; delays in microseconds.
    fn exchange(map: &mut ClockMap, at: Timestamp, offset_ns: i64, there_us: u64, back_us: u64) {
        map.request(at);
        let noted_ns = (at.ns + there_us * 1000) as i64 + offset_ns;
        let received = Timestamp::from_ns(at.ns + (there_us + back_us) * 1000);
        map.on_response(received, noted_ns, at.ns as i64);
    }

    fn time(i: usize) -> Timestamp {
        Timestamp::from_seconds(START_S + i as f64 * 0.1)
    }

    proptest! {
        #[test]
        fn the_offset_is_right_within_half_the_shortest_round_trip(
            offset_ns in -900_000_000_000i64..1_000_000_000_000_000,
            delays in proptest::collection::vec((50u64..20_000, 50u64..20_000), 30..100),
        ) {
            let mut map = ClockMap::default();
            for (i, (there, back)) in delays.iter().enumerate() {
                exchange(&mut map, time(i), offset_ns, *there, *back);
            }
            prop_assert!(map.is_converged());
            let error_ns = map.offset_ns().abs_diff(offset_ns);
            prop_assert!(error_ns <= map.round_trip_ns() / 2 + super::RTT_SLACK_NS / 2 + 2, "{error_ns} ns");
        }

        #[test]
        fn a_mapped_stamp_is_never_in_the_future_and_never_ancient(
            offset_ns in -900_000_000_000i64..1_000_000_000_000_000, exchanges in 0usize..40,
            nonsense in proptest::collection::vec((any::<i64>(), any::<i64>()), 0..10),
            stamps in proptest::collection::vec((any::<u32>(), any::<u64>(), -3000i32..3000, any::<u32>()), 1..20),
        ) {
            let mut map = ClockMap::default();
            for i in 0..exchanges {
                exchange(&mut map, time(i), offset_ns, 300, 300);
            }
            for (autopilot, echoed) in nonsense {
                map.on_response(time(100), autopilot, echoed);
            }
            let mut received = time(1000);
            for (ms, us, near_ms, pause) in stamps {
                received = Timestamp::from_ns(received.ns + u64::from(pause));
                let about_ns = received.ns as i64 + offset_ns + i64::from(near_ms) * 1_000_000;
                let (near_us, near_ms) = ((about_ns / 1000) as u64, (about_ns / 1_000_000) as u32);
                for mapped in [
                    map.map_ms(ms, received),
                    map.map_us(us, received),
                    map.map_ms(near_ms, received),
                    map.map_us(near_us, received),
                ] {
                    prop_assert!(mapped <= received);
                    prop_assert!(received.seconds_since(mapped) <= 1.0 + 1e-9);
                }
            }
        }

        /// Stamps and round trips with delays in both directions, and a clock that stands still once, as that of a simulated autopilot on a busy
        /// machine.
        #[test]
        fn no_moment_of_the_boards_past_lies_in_the_autopilots_future(
            offset_ns in 0i64..1_000_000_000_000, answered in any::<bool>(),
            delays_us in proptest::collection::vec((0u64..15_000, 0u64..15_000), 30..300),
            stands in (0usize..300, 0i64..190_000_000),
        ) {
            let mut map = ClockMap::default();
            for (i, (there_us, back_us)) in delays_us.into_iter().enumerate() {
                let stood_still_ns = if i < stands.0 { 0 } else { stands.1 };
                let clock_ns = |at: Timestamp| at.ns as i64 + offset_ns - stood_still_ns;
                let begun = time(i).plus_seconds(stood_still_ns as f64 * 1e-9);
                if answered && i % 5 == 0 {
                    exchange(&mut map, begun, offset_ns - stood_still_ns, there_us, back_us);
                }
                let sent = begun.plus_seconds(0.05);
                let received = Timestamp::from_ns(sent.ns + back_us * 1000);
                map.map_us(clock_ns(sent).unsigned_abs() / 1000, received);
                for later_s in [0.0, 0.01, 0.04] {
                    let now = received.plus_seconds(later_s);
                    let named_ns = map.to_autopilot_ns(now, now.plus_seconds(-0.01)).unwrap() as i64;
                    prop_assert!(named_ns <= clock_ns(now), "{} ns ahead", named_ns - clock_ns(now));
                    let behind_ns = clock_ns(now) - named_ns;
                    prop_assert!(behind_ns < 45_000_000 + stood_still_ns, "{behind_ns} ns behind");
                }
            }
        }

        #[test]
        fn before_convergence_the_least_delayed_message_maps_to_its_reception(
            boot_ms in 0u32..1_000_000, delays_us in proptest::collection::vec(0u64..50_000, 2..40),
        ) {
            let mut map = ClockMap::default();
            let base_ns = time(0).ns;
            let least_us = *delays_us.iter().min().unwrap();
            for (i, delay_us) in delays_us.iter().enumerate() {
                let received = Timestamp::from_ns(base_ns + i as u64 * 20_000_000 + delay_us * 1000);
                map.map_ms(boot_ms + i as u32 * 20, received);
            }
            let n = delays_us.len() as u64;
            let received = Timestamp::from_ns(base_ns + n * 20_000_000 + 60_000_000);
            let mapped = map.map_ms(boot_ms + n as u32 * 20, received);
            let true_ns = base_ns + n * 20_000_000 + least_us * 1000;
            prop_assert!(mapped.ns.abs_diff(true_ns) < 400_000, "off by {} ns", mapped.ns.abs_diff(true_ns));
        }
    }

    #[test]
    fn a_foreign_answer_and_a_replayed_one_change_nothing() {
        let mut map = ClockMap::default();
        map.on_response(time(1), 5_000_000_000, time(0).ns as i64);
        assert_eq!(map.samples(), 0);
        exchange(&mut map, time(2), 77, 300, 300);
        map.on_response(time(3), 9_000_000_000, time(2).ns as i64);
        assert_eq!((map.samples(), map.offset_ns()), (1, 77));
    }

    #[test]
    fn single_outliers_are_dropped_and_a_jump_of_the_clock_is_followed() {
        let mut map = ClockMap::default();
        for i in 0..40 {
            exchange(&mut map, time(i), 1_000_000, 200, 200);
        }
        exchange(&mut map, time(40), 500_000_000, 200, 200);
        assert_eq!(map.offset_ns(), 1_000_000);
        assert!(map.is_converged());
        for i in 41..50 {
            exchange(&mut map, time(i), 500_000_000, 200, 200);
        }
        assert_eq!(map.offset_ns(), 500_000_000);
        assert!(!map.is_converged(), "a new clock must prove itself again");
        for i in 50..50 + NEEDED as usize {
            exchange(&mut map, time(i), 500_000_000, 200, 200);
        }
        assert!(map.is_converged());
    }

    #[test]
    fn stamps_show_a_clock_that_was_set_before_round_trips_do() {
        for ahead_ms in [-900i64, -300, 700, 100_000] {
            let mut map = ClockMap::default();
            let mut boot_ms = 5_000_000i64;
            for i in 0..200 {
                exchange(&mut map, time(i), 1_000_000, 200, 200);
                for _ in 0..5 {
                    map.map_ms(boot_ms as u32, time(i).plus_seconds(0.01));
                    boot_ms += 20;
                }
            }
            assert!(map.is_converged() && map.take_step().is_none());
            // Fifty messages a second from here on, and no round trip.
            boot_ms += ahead_ms;
            for i in 0..50 {
                let received = time(200).plus_seconds(0.02 * f64::from(i));
                let mapped = map.map_ms((boot_ms + 20 * i64::from(i)) as u32, received);
                assert!(mapped <= received);
                let behind_s = received.seconds_since(mapped);
                assert!(
                    i < 10 || behind_s < 0.05,
                    "{ahead_ms} ms: {behind_s} s behind after {i} messages"
                );
            }
            let told_s = map.take_step().unwrap();
            assert!((told_s - ahead_ms as f64 * 1e-3).abs() < 0.1, "{told_s}");
            assert!(map.take_step().is_none());
        }
    }

    #[test]
    fn a_clock_that_runs_slow_is_followed_and_its_rate_is_reported() {
        for rate in [0.987f64, 0.99, 1.02] {
            let mut map = ClockMap::default();
            let clock_ns = |at: Timestamp| (at.ns as f64 - START_S * 1e9) * rate + 5e9;
            let mut now = time(0);
            for i in 0..400u64 {
                // 0.1 to 0.2 ms each way, as between processes of one machine.
                let (there_us, back_us) = (100 + i * 37 % 100, 100 + i * 53 % 100);
                map.request(now);
                let noted = Timestamp::from_ns(now.ns + there_us * 1000);
                let received = Timestamp::from_ns(noted.ns + back_us * 1000);
                map.on_response(received, clock_ns(noted) as i64, now.ns as i64);
                if i >= 40 {
                    assert!(map.is_converged(), "{rate}: lost after {i} samples");
                    assert!(
                        (map.rate_error() - (rate - 1.0)).abs() < 2e-4,
                        "{rate}: {}",
                        map.rate_error()
                    );
                    let later = received.plus_seconds(0.05);
                    let boot_us = (clock_ns(received) / 1e3) as u64;
                    let mapped = map.map_us(boot_us, later);
                    let error_s = mapped.seconds_since(received).abs();
                    assert!(error_s < 1.2e-3, "{rate}: off by {error_s} s");
                }
                now = now.plus_seconds(1.0 / map.request_rate_hz());
            }
        }
    }

    #[test]
    fn it_asks_often_until_it_knows_and_again_when_it_doubts() {
        let mut map = ClockMap::default();
        for i in 0..NEEDED as usize {
            assert_eq!(map.request_rate_hz(), 10.0);
            exchange(&mut map, time(i), 1_000_000, 200, 200);
        }
        assert_eq!(map.request_rate_hz(), 1.0);
        exchange(&mut map, time(30), 900_000_000, 200, 200);
        assert_eq!(map.request_rate_hz(), 10.0);
    }

    #[test]
    fn the_millisecond_counter_may_wrap() {
        let mut map = ClockMap::default();
        let wrap_ns = (1i64 << 32) * 1_000_000;
        let offset_ns = wrap_ns - time(30).ns as i64;
        for i in 0..30 {
            exchange(&mut map, time(i), offset_ns, 200, 200);
        }
        let before = map.map_ms(u32::MAX - 9, time(30).plus_seconds(0.005));
        let received = time(30).plus_seconds(0.015);
        let after = map.map_ms(10, received);
        assert!((after.seconds_since(before) - 0.020).abs() < 2e-3);
        // A gateway that starts after it has wrapped.
        let mut map = ClockMap::default();
        for i in 0..30 {
            exchange(&mut map, time(i), wrap_ns, 200, 200);
            map.map_ms((time(i).ns / 1_000_000) as u32, time(i));
        }
        let now = time(29).plus_seconds(0.02);
        let named_ns = map.to_autopilot_ns(now, now.plus_seconds(-0.01)).unwrap();
        assert!(named_ns.abs_diff(now.ns + wrap_ns as u64 - 10_000_000) < 1_000_000);
    }
}
