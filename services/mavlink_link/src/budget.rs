//! What a slow link carries: a bucket of bytes that fills at the link's speed, from which the urgent may take more than
//! the rest.
//!
//! | in | out |
//! |---|---|
//! | time, [`TrafficClass`] and size of a message | whether it goes out now ([`Budget::admits`]) |
//! | the same over two seconds | whether the link carries what a flight needs ([`Budget::judge`]) |
//!
//! Three rules let a message out, and each has its reason:
//!
//! - The bucket holds it: over any time no more leaves than the speed allows and the bucket held.
//! - After it the bucket still holds one message of every class that is more urgent: nothing less urgent keeps a setpoint
//!   waiting now. (Token bucket: RFC 2697, section 3, with one floor per class.)
//! - Its class has not used up what the more urgent ones leave: nothing less urgent keeps them waiting later, and the line
//!   does not stand full, which would make every setpoint late. What they take is measured, about a second back.
//!
//! Obstacle maps are needed five times a second. Those beyond that are surplus and come last, so that a link that is
//! just fast enough still carries the ground stations' traffic.

use jink_shared_types::Timestamp;
use jink_shared_types::link::CLASSES;
use mavlink::MessageData;
use mavlink::dialect::{
    COMPONENT_METADATA_DATA, FILE_TRANSFER_PROTOCOL_DATA, HEARTBEAT_DATA, OBSTACLE_DISTANCE_DATA,
    ONBOARD_COMPUTER_STATUS_DATA, PARAM_ERROR_DATA, PARAM_EXT_VALUE_DATA, PARAM_VALUE_DATA,
    SET_POSITION_TARGET_GLOBAL_INT_DATA, SET_POSITION_TARGET_LOCAL_NED_DATA, STATUSTEXT_DATA,
};
// The trajectory messages are gone from PX4 1.16 on; some profiles are for the versions before.
#[allow(deprecated)]
use mavlink::dialect::{TRAJECTORY_REPRESENTATION_BEZIER_DATA, TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA};

/// How urgent a message is; the number is its place in the counters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum TrafficClass {
    /// HEARTBEAT: without it PX4 gives the companion up.
    Heartbeat = 0,
    /// What the vehicle flies.
    Setpoint = 1,
    /// TIMESYNC, commands and answers.
    Answer = 2,
    /// OBSTACLE_DISTANCE.
    Obstacles = 3,
    /// STATUSTEXT.
    Text = 4,
    /// Parameters, files, how the board is.
    Parameter = 5,
    /// What others have sent to others.
    Forwarded = 6,
}

impl TrafficClass {
    /// All, the most urgent first.
    pub const ALL: [Self; CLASSES.len()] = [
        Self::Heartbeat,
        Self::Setpoint,
        Self::Answer,
        Self::Obstacles,
        Self::Text,
        Self::Parameter,
        Self::Forwarded,
    ];

    /// The class of a message that we send.
    #[allow(deprecated)]
    pub fn of(message_id: u32) -> Self {
        match message_id {
            HEARTBEAT_DATA::ID => Self::Heartbeat,
            TRAJECTORY_REPRESENTATION_BEZIER_DATA::ID
            | TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA::ID
            | SET_POSITION_TARGET_LOCAL_NED_DATA::ID
            | SET_POSITION_TARGET_GLOBAL_INT_DATA::ID => Self::Setpoint,
            OBSTACLE_DISTANCE_DATA::ID => Self::Obstacles,
            STATUSTEXT_DATA::ID => Self::Text,
            PARAM_VALUE_DATA::ID
            | PARAM_EXT_VALUE_DATA::ID
            | PARAM_ERROR_DATA::ID
            | FILE_TRANSFER_PROTOCOL_DATA::ID
            | COMPONENT_METADATA_DATA::ID
            | ONBOARD_COMPUTER_STATUS_DATA::ID => Self::Parameter,
            _ => Self::Answer,
        }
    }

    /// What the bucket keeps for one turn of this class (bytes): its longest message, signed. Two of our components
    /// have heartbeats; TIMESYNC comes in pairs, a request and an answer; the longest setpoint is WAYPOINTS.
    fn reserve_bytes(self) -> f64 {
        match self {
            Self::Heartbeat => 2.0 * 34.0,
            Self::Setpoint => 264.0,
            Self::Answer => 2.0 * 46.0,
            Self::Obstacles => 192.0,
            Self::Text => 79.0,
            // Eight come at once; they can wait for each other.
            Self::Parameter | Self::Forwarded => 293.0,
        }
    }

    /// What the bucket must still hold after a message of this class (bytes).
    fn floor_bytes(self) -> f64 {
        let more_urgent = |class: &&Self| **class < self;
        Self::ALL
            .iter()
            .filter(more_urgent)
            .map(|class| class.reserve_bytes())
            .sum()
    }
}

/// Obstacle maps that are needed (Hz): PX4 and ArduPilot stop believing them after half a second, and two may get lost.
pub const OBSTACLES_NEEDED_HZ: f64 = 5.0;
/// Needed maps that may have been saved up (1): two, so that seven a second are thinned to five and not to three and a
/// half.
const SAVED_UP: f64 = 2.0;
/// Time that a fast link's bucket holds (s): what bursts at most before the next one.
const DEPTH_S: f64 = 0.1;
/// Part of the speed that is used (1): the last bit would only build a queue.
const LOAD: f64 = 0.98;
/// How far back it is measured what a class asks for (s): as long as the rarest regular message, a heartbeat, is apart.
const MEASURED_S: f64 = 1.0;
/// A class may have saved up so many of its longest messages (1): two come at once where two streams meet.
const SAVED_MESSAGES: f64 = 2.0;
/// Obstacle maps beyond those that are needed: less urgent than all classes.
const SURPLUS: usize = CLASSES.len();
/// How long traffic is watched before it is judged (s).
const WINDOW_S: f64 = 2.0;
/// Good windows in a row before a slow link counts as fast again.
const GOOD_WINDOWS: u32 = 3;
/// Part of the needed obstacle maps that must get through (1): a map more or less at the edge of a window is no fault.
const ENOUGH: f64 = 0.9;

/// What has changed about a link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CapacityChange {
    /// It does not carry what a flight needs.
    Slow {
        /// What it carries (bytes/s).
        carries_bps: f64,
        /// What setpoints, what is more urgent, answers and five obstacle maps a second need (bytes/s).
        needed_bps: f64,
    },
    /// It does again.
    FastAgain,
}

/// What was to be sent in a window.
#[derive(Clone, Copy, Debug, Default)]
struct TrafficWindow {
    urgent_bytes: f64,
    urgent_refused: bool,
    obstacles: f64,
    obstacles_bytes: f64,
    obstacles_sent: f64,
}

/// What one class asks for and may have.
#[derive(Clone, Copy, Debug, Default)]
struct ClassShare {
    asks_bps: f64,
    held_bytes: f64,
    depth_bytes: f64,
}

/// The budget of one link.
#[derive(Clone, Debug)]
pub struct Budget {
    rate_bps: f64,
    depth_bytes: f64,
    held_bytes: f64,
    filled: Timestamp,
    obstacles_saved: f64,
    /// Per class, and of the surplus.
    shares: [ClassShare; SURPLUS + 1],
    window: TrafficWindow,
    window_end: Timestamp,
    is_slow: bool,
    good_windows: u32,
}

impl Budget {
    /// For a link that carries `rate_bps` (bytes/s).
    pub fn new(rate_bps: f64) -> Self {
        let needed: f64 = TrafficClass::ALL.iter().map(|class| class.reserve_bytes()).sum();
        let depth_bytes = (needed + TrafficClass::Obstacles.reserve_bytes()).max(rate_bps * DEPTH_S);
        Self {
            rate_bps,
            depth_bytes,
            held_bytes: depth_bytes,
            filled: Timestamp::NEVER,
            obstacles_saved: SAVED_UP,
            shares: std::array::from_fn(|place| {
                let class = TrafficClass::ALL
                    .get(place)
                    .copied()
                    .unwrap_or(TrafficClass::Obstacles);
                let depth_bytes = (SAVED_MESSAGES * class.reserve_bytes()).max(rate_bps * DEPTH_S);
                ClassShare {
                    asks_bps: 0.0,
                    held_bytes: depth_bytes,
                    depth_bytes,
                }
            }),
            window: TrafficWindow::default(),
            window_end: Timestamp::NEVER,
            is_slow: false,
            good_windows: 0,
        }
    }

    /// Whether a message of `bytes` bytes goes out now; if so, they are taken.
    pub fn admits(&mut self, now: Timestamp, class: TrafficClass, bytes: usize) -> bool {
        self.fill(now);
        let bytes = bytes as f64;
        let is_surplus = class == TrafficClass::Obstacles && self.obstacles_saved < 1.0;
        let (place, floor_bytes) = if is_surplus {
            let all = TrafficClass::Forwarded.floor_bytes() + TrafficClass::Forwarded.reserve_bytes();
            (SURPLUS, all)
        } else {
            (class as usize, class.floor_bytes())
        };
        let share = &mut self.shares[place];
        share.asks_bps += bytes / MEASURED_S;
        // Heartbeats and setpoints may use the whole link: the bucket alone decides.
        let is_in_share = class <= TrafficClass::Setpoint || share.held_bytes >= bytes;
        let admitted = is_in_share && self.held_bytes - bytes >= floor_bytes;
        if admitted {
            self.held_bytes -= bytes;
            share.held_bytes -= bytes;
        }
        if class == TrafficClass::Obstacles && !is_surplus {
            self.obstacles_saved -= 1.0;
        }
        self.note(class, bytes, admitted);
        admitted
    }

    fn fill(&mut self, now: Timestamp) {
        if self.filled.is_set() && now > self.filled {
            let elapsed_s = now.seconds_since(self.filled);
            self.held_bytes = (self.held_bytes + elapsed_s * self.rate_bps).min(self.depth_bytes);
            self.obstacles_saved = (self.obstacles_saved + elapsed_s * OBSTACLES_NEEDED_HZ).min(SAVED_UP);
            let fade = (-elapsed_s / MEASURED_S).exp();
            let mut left_bps = LOAD * self.rate_bps;
            for share in &mut self.shares {
                let filled = share.held_bytes + elapsed_s * left_bps.max(0.0);
                share.held_bytes = filled.min(share.depth_bytes);
                share.asks_bps *= fade;
                left_bps -= share.asks_bps;
            }
        }
        self.filled = self.filled.max(now);
    }

    fn note(&mut self, class: TrafficClass, bytes: f64, admitted: bool) {
        let window = &mut self.window;
        if class <= TrafficClass::Answer {
            window.urgent_bytes += bytes;
            window.urgent_refused |= !admitted;
        } else if class == TrafficClass::Obstacles {
            window.obstacles += 1.0;
            window.obstacles_bytes += bytes;
            window.obstacles_sent += f64::from(u8::from(admitted));
        }
    }

    /// Judges the traffic of the last window, when one has ended; returns what has changed.
    pub fn judge(&mut self, now: Timestamp) -> Option<CapacityChange> {
        if now < self.window_end {
            return None;
        }
        let begun = self.window_end.is_set();
        self.window_end = now.plus_seconds(WINDOW_S);
        let window = std::mem::take(&mut self.window);
        if !begun {
            return None;
        }
        let needed = window.obstacles.min(OBSTACLES_NEEDED_HZ * WINDOW_S);
        let is_bad = window.urgent_refused || window.obstacles_sent < ENOUGH * needed;
        self.good_windows = if is_bad { 0 } else { self.good_windows + 1 };
        if is_bad && !self.is_slow {
            self.is_slow = true;
            let maps_bytes = needed * window.obstacles_bytes / window.obstacles.max(1.0);
            return Some(CapacityChange::Slow {
                carries_bps: self.rate_bps,
                needed_bps: (window.urgent_bytes + maps_bytes) / WINDOW_S,
            });
        }
        if self.is_slow && self.good_windows >= GOOD_WINDOWS {
            self.is_slow = false;
            return Some(CapacityChange::FastAgain);
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::{Budget, CapacityChange, OBSTACLES_NEEDED_HZ, TrafficClass};
    use jink_shared_types::Timestamp;
    use proptest::prelude::*;

    fn at(s: f64) -> Timestamp {
        Timestamp::from_seconds(10.0 + s)
    }

    /// Offers messages for 20 s; answers how many a second of each class got through in the second half, and every
    /// change.
    fn offer(
        rate_bps: f64,
        streams: &[(TrafficClass, usize, f64)],
    ) -> ([f64; TrafficClass::ALL.len()], Vec<CapacityChange>) {
        let mut budget = Budget::new(rate_bps);
        let (mut sent, mut changes) = ([0.0; TrafficClass::ALL.len()], Vec::new());
        let mut due: Vec<_> = streams.iter().map(|_| 0.0).collect();
        for ms in 0..20_000 {
            let s = f64::from(ms) / 1000.0;
            for ((class, bytes, rate_hz), due_s) in streams.iter().zip(&mut due) {
                if s >= *due_s {
                    *due_s += 1.0 / rate_hz;
                    if budget.admits(at(s), *class, *bytes) && s >= 10.0 {
                        sent[*class as usize] += 0.1;
                    }
                }
            }
            changes.extend(budget.judge(at(s)));
        }
        (sent, changes)
    }

    #[test]
    fn obstacle_maps_are_thinned_to_five_before_anything_else_suffers() {
        let streams = [
            (TrafficClass::Obstacles, 179, 15.0),
            (TrafficClass::Setpoint, 121, 20.0),
            (TrafficClass::Answer, 30, 20.0),
            (TrafficClass::Heartbeat, 21, 2.0),
            (TrafficClass::Forwarded, 40, 20.0),
        ];
        let (sent, changes) = offer(4900.0, &streams);
        assert!(sent[TrafficClass::Setpoint as usize] > 19.8 && sent[TrafficClass::Heartbeat as usize] > 1.8);
        assert!(
            (4.8..6.5).contains(&sent[TrafficClass::Obstacles as usize]),
            "{sent:?}"
        );
        assert!(sent[TrafficClass::Forwarded as usize] > 15.0, "{sent:?}");
        assert!(changes.is_empty(), "{changes:?}");
    }

    #[test]
    fn what_does_not_fit_is_reported_once_with_figures() {
        let streams = [
            (TrafficClass::Setpoint, 251, 20.0),
            (TrafficClass::Answer, 30, 20.0),
            (TrafficClass::Obstacles, 179, 15.0),
        ];
        let (sent, changes) = offer(5760.0, &streams);
        assert!(
            sent[TrafficClass::Setpoint as usize] > 19.8 && sent[TrafficClass::Answer as usize] > 19.0,
            "{sent:?}"
        );
        let [
            CapacityChange::Slow {
                carries_bps,
                needed_bps,
            },
        ] = changes[..]
        else {
            panic!("{changes:?}");
        };
        let needed = 251.0 * 20.0 + 30.0 * 20.0 + 179.0 * 5.0;
        assert!((needed_bps - needed).abs() < 0.03 * needed && carries_bps == 5760.0);
    }

    #[test]
    fn a_link_that_has_room_again_is_reported_as_well() {
        let mut budget = Budget::new(1000.0);
        let mut changes = Vec::new();
        for ms in (0..30_000).step_by(50) {
            let s = f64::from(ms) / 1000.0;
            let bytes = if s < 10.0 { 250 } else { 20 };
            budget.admits(at(s), TrafficClass::Setpoint, bytes);
            changes.extend(budget.judge(at(s)));
        }
        assert!(
            matches!(
                changes[..],
                [CapacityChange::Slow { .. }, CapacityChange::FastAgain]
            ),
            "{changes:?}"
        );
    }

    fn class() -> impl Strategy<Value = TrafficClass> {
        proptest::sample::select(&TrafficClass::ALL[..])
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(100) })]

        #[test]
        fn over_no_time_more_leaves_than_the_speed_allows_and_the_bucket_held(
            rate_bps in 100.0..20_000.0f64,
            offers in proptest::collection::vec((0..200u64, class(), 12..293usize), 1..300),
        ) {
            let mut budget = Budget::new(rate_bps);
            let (mut now_ms, mut sent) = (0, Vec::new());
            for (pause_ms, class, bytes) in offers {
                now_ms += pause_ms;
                if budget.admits(at(now_ms as f64 / 1e3), class, bytes) {
                    sent.push((now_ms, bytes as f64));
                }
            }
            for (i, (begin_ms, _)) in sent.iter().enumerate() {
                let mut total = 0.0;
                for (end_ms, bytes) in &sent[i..] {
                    total += bytes;
                    let allowed = budget.depth_bytes + rate_bps * (end_ms - begin_ms) as f64 / 1e3;
                    prop_assert!(total <= allowed + 1e-3, "{} of {}", total, allowed);
                }
            }
        }

        #[test]
        fn after_any_message_a_heartbeat_and_a_setpoint_still_go_out(
            rate_bps in 100.0..20_000.0f64,
            offers in proptest::collection::vec((0..50u64, class(), 12..293usize), 1..300),
        ) {
            let mut budget = Budget::new(rate_bps);
            let mut now_ms = 0;
            for (pause_ms, class, bytes) in offers {
                now_ms += pause_ms;
                let now = at(now_ms as f64 / 1e3);
                if budget.admits(now, class, bytes.min(class.reserve_bytes() as usize)) {
                    let mut then = budget.clone();
                    for urgent in [TrafficClass::Setpoint, TrafficClass::Heartbeat].into_iter().filter(|urgent| *urgent < class) {
                        let longest = urgent.reserve_bytes() as usize;
                        prop_assert!(then.admits(now, urgent, longest), "{:?} after {:?}", urgent, class);
                    }
                }
            }
        }

        #[test]
        fn less_urgent_traffic_costs_the_more_urgent_nothing(
            rate_bps in 1_000.0..12_000.0f64,
            streams in proptest::collection::vec((class(), 20..260usize, 1.0..40.0f64), 1..8),
            least in class(),
        ) {
            let fits = |(class, bytes, _): &(TrafficClass, usize, f64)| *bytes <= class.reserve_bytes() as usize;
            let streams: Vec<_> = streams.into_iter().filter(fits).collect();
            let urgent: Vec<_> = streams.iter().copied().filter(|(class, ..)| *class <= least).collect();
            let (alone, _) = offer(rate_bps, &urgent);
            let (together, _) = offer(rate_bps, &streams);
            for class in TrafficClass::ALL.into_iter().filter(|class| *class <= least) {
                let (mut alone, together) = (alone[class as usize], together[class as usize]);
                if class == TrafficClass::Obstacles {
                    // Maps beyond those needed are surplus.
                    alone = alone.min(OBSTACLES_NEEDED_HZ);
                }
                prop_assert!(together >= 0.9 * alone - 1.0, "{:?}: {} Hz of {}", class, together, alone);
            }
        }
    }
}
