//! What every sample carries, and how a reader learns how old it is.
//!
//! Latency from photon to wire is a subtraction: every stage copies the stage times of the sample it was made from
//! and adds its own, so the last one holds the whole history.

use crate::clock::Timestamp;
use crate::layout::Layout;

/// The stages between a sensor and the wire, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Stage {
    /// A sensor driver: begins at capture, ends at publication.
    Sensor = 0,
    /// Obstacle fusion.
    Fusion = 1,
    /// Planner.
    Planner = 2,
    /// Bezier generator.
    Generator = 3,
    /// Collision guard.
    Guard = 4,
    /// MAVLink gateway: ends when the bytes are handed to the kernel.
    Gateway = 5,
}

impl Stage {
    /// All of them, in order.
    pub const ALL: [Self; STAGES] = [
        Self::Sensor,
        Self::Fusion,
        Self::Planner,
        Self::Generator,
        Self::Guard,
        Self::Gateway,
    ];
}

/// Number of [`Stage`]s.
pub const STAGES: usize = 6;

/// Stages that a header has room for: builds that know a stage more still exchange samples.
pub const STAGE_ROOM: usize = 8;

/// The names of the stages, in order.
pub const STAGE_NAMES: [&str; STAGES] = ["sensor", "fusion", "planner", "generator", "guard", "gateway"];

crate::sample! {
    /// When a sample entered and left one stage.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub struct StageTime: 16 {
        /// When the stage was woken with the input.
        pub begin: Timestamp,
        /// When the stage published its output.
        pub end: Timestamp,
    }
}

crate::sample! {
    /// The user header of every topic.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub struct SampleHeader: 192 {
        /// Counts samples of one topic; continues over restarts of the producer as far as it can know.
        pub sequence: u64,
        /// Time of validity: when the newest measurement inside was taken.
        pub capture: Timestamp,
        /// When the sample was published.
        pub publish: Timestamp,
        /// Which start of the producer this is (1, 2, ...), as counted by the supervisor.
        pub generation: u32,
        /// Age, from `publish` and from `capture`, at which this sample is stale (us), as a source of measurements says of
        /// itself; 0 = the topic's own deadline, from `publish`.
        pub deadline_us: u32,
        /// History of the measurement this sample was made from: sensor, fusion, planner, generator, guard, gateway
        /// ([`Stage`]). The rest is unset.
        pub stages: [StageTime; STAGE_ROOM],
        /// How long each stage was still busy with something else when its input was published, or kept it for a later cycle (us): a part
        /// of the time from the end of the stage before to its begin. The rest of that is the wake-up.
        pub busy_us: [u32; STAGE_ROOM],
    }
}

impl SampleHeader {
    /// The header of something made now from nothing older: validity and publication at `now`.
    pub fn at(now: Timestamp) -> Self {
        Self {
            capture: now,
            publish: now,
            ..Self::default()
        }
    }

    /// Whether the sample still counts at `now`: the one rule for age. Its publication is no older than the deadline; where the
    /// producer of measurements says its own ([`Self::deadline_us`]), the newest measurement inside is no older than that, either.
    /// `topic_deadline_ms` is that of the topic's row, for all others.
    pub fn is_fresh(&self, now: Timestamp, topic_deadline_ms: f64) -> bool {
        let is_within = |time: Timestamp| {
            time.is_set() && now.seconds_since(time) * 1e3 <= self.deadline_ms(topic_deadline_ms)
        };
        is_within(self.publish) && (self.deadline_us == 0 || is_within(self.capture))
    }

    /// The age at which the sample is stale (ms): what its producer says, else that of the topic's row.
    pub fn deadline_ms(&self, topic_deadline_ms: f64) -> f64 {
        if self.deadline_us == 0 {
            topic_deadline_ms
        } else {
            f64::from(self.deadline_us) * 1e-3
        }
    }

    /// The header of an output made in `stage` from an input with header `self`: same capture time and history,
    /// with the stage's begin added. The runtime fills sequence, generation, publication and the stage's end.
    pub fn derived(&self, stage: Stage, begin: Timestamp) -> Self {
        let mut header = Self {
            // Said by a source of measurements, for itself.
            deadline_us: 0,
            ..*self
        };
        header.stages[stage as usize] = StageTime {
            begin,
            end: Timestamp::NEVER,
        };
        header.busy_us[stage as usize] = 0;
        header
    }

    /// The time from the end of the stage before `stage`, or from the capture, to its begin (us), and how much of that the stage was busy
    /// with something else or kept its input; `None` if the sample did not pass it.
    pub fn hop_us(&self, stage: Stage) -> Option<[u64; 2]> {
        let index = stage as usize;
        let begin = Some(self.stages[index].begin).filter(|begin| begin.is_set())?;
        let mut ends = self.stages[..index].iter().rev().map(|stage| stage.end);
        let before = ends.find(|end| end.is_set()).unwrap_or(self.capture);
        let hop_us = begin.ns_since(before) / 1_000;
        Some([hop_us, u64::from(self.busy_us[index]).min(hop_us)])
    }
}

/// A sample together with its header, as a reader holds it.
#[derive(Debug)]
pub struct Stamped<'a, T> {
    /// The payload, in shared memory.
    pub sample: &'a T,
    /// Its header.
    pub header: &'a SampleHeader,
}

impl<T> Clone for Stamped<'_, T> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<T> Copy for Stamped<'_, T> {}
impl<T> std::ops::Deref for Stamped<'_, T> {
    type Target = T;
    fn deref(&self) -> &T {
        self.sample
    }
}

/// What a reader gets: never a value without its age.
#[derive(Debug)]
pub enum Reading<'a, T> {
    /// Within its deadline.
    Fresh(Stamped<'a, T>),
    /// The newest sample is older than its deadline.
    Stale {
        /// Its age (s) since publication.
        age_s: f64,
    },
    /// Nothing has ever arrived.
    Never,
}

impl<T> Clone for Reading<'_, T> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<T> Copy for Reading<'_, T> {}

impl<'a, T> Reading<'a, T> {
    /// Judges `stamped` at time `now` against the topic's deadline (ms); see [`SampleHeader::is_fresh`].
    pub fn judge(stamped: Option<Stamped<'a, T>>, now: Timestamp, deadline_ms: f64) -> Self {
        match stamped {
            None => Reading::Never,
            Some(stamped) => {
                if stamped.header.is_fresh(now, deadline_ms) {
                    Reading::Fresh(stamped)
                } else {
                    Reading::Stale {
                        age_s: now.seconds_since(stamped.header.publish),
                    }
                }
            }
        }
    }

    /// The sample if it is fresh.
    pub fn fresh(self) -> Option<Stamped<'a, T>> {
        match self {
            Reading::Fresh(stamped) => Some(stamped),
            Reading::Stale { .. } | Reading::Never => None,
        }
    }

    /// Whether the sample is fresh.
    pub fn is_fresh(&self) -> bool {
        matches!(self, Reading::Fresh(_))
    }
}

/// An all-zero `T` on the heap, made without passing over the stack: samples may be larger than one.
pub fn zeroed_box<T: Layout>() -> Box<T> {
    let uninit = Box::<T>::new_zeroed();
    #[allow(unsafe_code)]
    // SAFETY: `Layout` promises that every bit pattern, zero included, is a valid value.
    unsafe {
        uninit.assume_init()
    }
}

#[cfg(test)]
mod tests {
    use super::{Reading, SampleHeader, Stage, Stamped};
    use crate::clock::Timestamp;

    #[test]
    fn a_reading_ages() {
        let header = SampleHeader::at(Timestamp::from_seconds(10.0));
        let stamped = Some(Stamped {
            sample: &7u8,
            header: &header,
        });
        let at = |s: f64| Reading::judge(stamped, Timestamp::from_seconds(s), 100.0);
        assert!(at(10.05).is_fresh());
        assert!(matches!(at(10.2), Reading::Stale { age_s } if (age_s - 0.2).abs() < 1e-9));
        assert!(matches!(
            Reading::<u8>::judge(None, Timestamp::from_seconds(1.0), 1.0),
            Reading::Never
        ));
    }

    #[test]
    fn a_source_of_measurements_says_its_own_deadline_and_is_held_to_the_capture() {
        let mut header = SampleHeader::at(Timestamp::from_seconds(10.0));
        header.publish = Timestamp::from_seconds(10.2);
        let at = |header: &SampleHeader, s: f64| header.is_fresh(Timestamp::from_seconds(s), 100.0);
        assert!(
            at(&header, 10.29) && !at(&header, 10.31),
            "the topic's, from publication"
        );
        header.deadline_us = 625_000;
        assert!(
            at(&header, 10.62) && !at(&header, 10.63),
            "its own, from the capture"
        );
        header.capture = Timestamp::NEVER;
        assert!(!at(&header, 10.21), "a measurement that was never made");
        assert_eq!(header.derived(Stage::Fusion, header.publish).deadline_us, 0);
    }

    #[test]
    fn a_derived_header_keeps_the_history() {
        let mut sensor = SampleHeader::at(Timestamp::from_ns(5));
        sensor.stages[Stage::Sensor as usize].end = Timestamp::from_ns(7);
        let fused = sensor.derived(Stage::Fusion, Timestamp::from_ns(9));
        assert_eq!(fused.capture, Timestamp::from_ns(5));
        assert_eq!(fused.stages[Stage::Sensor as usize].end, Timestamp::from_ns(7));
        assert_eq!(fused.stages[Stage::Fusion as usize].begin, Timestamp::from_ns(9));
    }

    #[test]
    fn the_way_into_a_stage_is_what_lies_between_it_and_the_one_before() {
        let us = |us: u64| Timestamp::from_ns(1_000 * us);
        let mut header = SampleHeader::at(us(100));
        header.stages[Stage::Sensor as usize].end = us(140);
        header.stages[Stage::Planner as usize].begin = us(190);
        header.busy_us[Stage::Planner as usize] = 30;
        assert_eq!(header.hop_us(Stage::Planner), Some([50, 30]));
        assert_eq!(header.hop_us(Stage::Fusion), None);
        header.busy_us[Stage::Planner as usize] = 70;
        assert_eq!(
            header.hop_us(Stage::Planner),
            Some([50, 50]),
            "never more than all"
        );
    }
}
