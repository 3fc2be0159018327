//! What every sample carries, and how a reader learns how old it is.
//!
//! Latency from photon to wire is a subtraction: every stage copies the stage times of the sample it was made from
//! and adds its own, so the last one holds the whole history.

use crate::clock::Timestamp;
use crate::layout::Layout;
use crate::reserved::Reserved;

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
        /// Age, from `publish` and from `capture`, at which the producer says this sample is stale (us); 0 = the
        /// topic's own deadline.
        pub deadline_us: u32,
        /// History of the measurement this sample was made from: sensor, fusion, planner, generator, guard, gateway
        /// ([`Stage`]). The rest is unset.
        pub stages: [StageTime; STAGE_ROOM],
        /// Room for later fields, zero.
        pub reserved: Reserved<32>,
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

    /// The header of an output made in `stage` from an input with header `self`: same capture time and history,
    /// with the stage's begin added. The runtime fills sequence, generation, publication and the stage's end.
    pub fn derived(&self, stage: Stage, begin: Timestamp) -> Self {
        let mut header = *self;
        header.stages[stage as usize] = StageTime {
            begin,
            end: Timestamp::NEVER,
        };
        header
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
    /// Published within the topic's deadline.
    Fresh(Stamped<'a, T>),
    /// The newest sample is older than the topic's deadline.
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
    /// Judges `stamped` at time `now` against the topic's deadline (ms).
    pub fn judge(stamped: Option<Stamped<'a, T>>, now: Timestamp, deadline_ms: f64) -> Self {
        match stamped {
            None => Reading::Never,
            Some(stamped) => {
                let age_s = now.seconds_since(stamped.header.publish);
                if age_s * 1e3 > deadline_ms {
                    Reading::Stale { age_s }
                } else {
                    Reading::Fresh(stamped)
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
    fn a_derived_header_keeps_the_history() {
        let mut sensor = SampleHeader::at(Timestamp::from_ns(5));
        sensor.stages[Stage::Sensor as usize].end = Timestamp::from_ns(7);
        let fused = sensor.derived(Stage::Fusion, Timestamp::from_ns(9));
        assert_eq!(fused.capture, Timestamp::from_ns(5));
        assert_eq!(fused.stages[Stage::Sensor as usize].end, Timestamp::from_ns(7));
        assert_eq!(fused.stages[Stage::Fusion as usize].begin, Timestamp::from_ns(9));
    }
}
