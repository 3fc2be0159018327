//! Where the vehicle was when a ray was measured: the last seconds of its poses, interpolated.

use jink_shared_types::Timestamp;
use jink_shared_types::sample::SampleHeader;
use jink_shared_types::vehicle::VehicleState;
use nalgebra::{UnitQuaternion, Vector3};
use std::fmt;

/// Poses kept: 2.5 s at 50 Hz, more than a sweep and its way here take.
const POSES: usize = 128;
/// How far beyond the newest state a pose may be predicted from velocity and body rates (s): the state's own deadline and
/// one period of it. At 5 m/s2 the prediction is then 6 cm wrong, less than the guard's margin.
const PREDICTION_S: f64 = 0.15;
/// Longest gap between two states that may be bridged by interpolation (s): at 5 m/s2 the error half way is 6 cm.
const GAP_S: f64 = 0.3;
/// A state this much older than the newest one is no late-comer but a new beginning: whoever stamped the newest one was wrong.
const REWIND_S: f64 = 1.0;

/// Position and attitude at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Local NED position (m).
    pub position: Vector3<f64>,
    /// `local_q_body`.
    pub attitude: UnitQuaternion<f64>,
}

impl Pose {
    /// The pose `share` (0 to 1) of the way to `other`.
    pub fn toward(&self, other: &Self, share: f64) -> Self {
        // The two quaternions of one rotation differ in sign: take the nearer one, or the mean would be nonsense.
        let from = self.attitude;
        let to = if from.coords.dot(&other.attitude.coords) < 0.0 {
            UnitQuaternion::new_unchecked(-other.attitude.into_inner())
        } else {
            other.attitude
        };
        Self {
            position: self.position.lerp(&other.position, share),
            attitude: from.nlerp(&to, share),
        }
    }

    /// Heading (rad), clockwise from north.
    pub fn yaw_rad(&self) -> f64 {
        jink_shared_types::frames::Attitude::from_rotation(self.attitude).yaw_rad()
    }
}

/// Why a vehicle state was not taken into the history.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PoseRefused {
    /// The autopilot says that its position may not be used, or a number in it is not finite.
    Invalid,
    /// Not newer than the newest state there is.
    OutOfOrder {
        /// Its time of validity.
        capture: Timestamp,
        /// That of the newest state.
        newest: Timestamp,
    },
}

impl fmt::Display for PoseRefused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PoseRefused::Invalid => write!(f, "the vehicle's position or attitude is not valid"),
            PoseRefused::OutOfOrder { capture, newest } => write!(
                f,
                "vehicle state of {} ns came after that of {} ns",
                capture.ns, newest.ns
            ),
        }
    }
}
impl std::error::Error for PoseRefused {}

#[derive(Clone, Copy, Debug)]
struct Entry {
    time: Timestamp,
    pose: Pose,
    velocity: Vector3<f64>,
    rates: Vector3<f64>,
}

/// The pose history.
#[derive(Clone, Debug)]
pub struct Poses {
    entries: Vec<Entry>,
    newest: usize,
    resets: Option<u32>,
}

impl Poses {
    /// Empty, with all its memory.
    pub fn new() -> Self {
        Self {
            entries: Vec::with_capacity(POSES),
            newest: 0,
            resets: None,
        }
    }

    /// Adds a state. `Ok(true)` if the estimator has moved its origin since the one before: everything that was placed in
    /// local coordinates is then worthless, the history included.
    pub fn push(&mut self, state: &VehicleState, header: &SampleHeader) -> Result<bool, PoseRefused> {
        let attitude = state.attitude.rotation();
        let Some(attitude) = attitude.filter(|_| is_usable(state) && header.capture.is_set()) else {
            return Err(PoseRefused::Invalid);
        };
        let mut moved = self.resets.is_some_and(|resets| resets != state.estimator_resets);
        if let Some(newest) = self.entries.get(self.newest) {
            let step_s = header.capture.seconds_since(newest.time);
            if step_s <= 0.0 && step_s > -REWIND_S && !moved {
                return Err(PoseRefused::OutOfOrder {
                    capture: header.capture,
                    newest: newest.time,
                });
            }
            moved |= step_s <= 0.0;
        }
        self.resets = Some(state.estimator_resets);
        if moved {
            self.entries.clear();
            self.newest = 0;
        }
        let rates = state.rates.vector();
        let entry = Entry {
            time: header.capture,
            pose: Pose {
                position: state.position.vector(),
                attitude,
            },
            velocity: state.velocity.vector(),
            rates,
        };
        if self.entries.len() < POSES {
            self.newest = self.entries.len();
            self.entries.push(entry);
        } else {
            self.newest = (self.newest + 1) % POSES;
            self.entries[self.newest] = entry;
        }
        Ok(moved)
    }

    /// When the newest state was valid.
    pub fn newest(&self) -> Timestamp {
        self.entries
            .get(self.newest)
            .map_or(Timestamp::NEVER, |entry| entry.time)
    }

    /// The pose at `time`: between two states interpolated, shortly after the newest one predicted, otherwise `None`.
    pub fn at(&self, time: Timestamp) -> Option<Pose> {
        let newest = self.entries.get(self.newest)?;
        let ahead_s = time.seconds_since(newest.time);
        if ahead_s >= 0.0 {
            return (ahead_s <= PREDICTION_S).then(|| Pose {
                position: newest.pose.position + newest.velocity * ahead_s,
                attitude: newest.pose.attitude * UnitQuaternion::from_scaled_axis(newest.rates * ahead_s),
            });
        }
        let mut later = newest;
        for back in 1..self.entries.len() {
            let index = (self.newest + self.entries.len() - back) % self.entries.len();
            let earlier = &self.entries[index];
            if earlier.time <= time {
                return between(earlier, later, time);
            }
            later = earlier;
        }
        None
    }
}

fn between(earlier: &Entry, later: &Entry, time: Timestamp) -> Option<Pose> {
    let gap_s = later.time.seconds_since(earlier.time);
    if gap_s > GAP_S {
        return None;
    }
    let share = time.seconds_since(earlier.time) / gap_s;
    Some(earlier.pose.toward(&later.pose, share))
}

fn is_usable(state: &VehicleState) -> bool {
    /// Farther from the origin than this, or faster, no multicopter is: keeps sums far from overflow.
    const SANE: f64 = 1e6;
    let rates = state.rates.vector();
    state.position_valid.is_set()
        && state.position.vector().norm() < SANE
        && state.velocity.vector().norm() < SANE
        && rates.norm() < SANE
}

#[cfg(test)]
mod tests {
    use super::{PoseRefused, Poses};
    use jink_shared_types::frames::{AngularRate, Attitude};
    use jink_shared_types::vehicle::VehicleState;
    use jink_shared_types::{Flag, Point, SampleHeader, Timestamp, Velocity};
    use nalgebra::UnitQuaternion;

    fn state(x_m: f64, yaw_rad: f64) -> VehicleState {
        VehicleState {
            position: Point::new(x_m, 0.0, -2.0),
            velocity: Velocity::new(2.0, 0.0, 0.0),
            attitude: Attitude::from_rotation(UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad)),
            rates: AngularRate::new(0.0, 0.0, 1.0),
            position_valid: Flag::YES,
            ..VehicleState::default()
        }
    }

    fn at(seconds: f64) -> SampleHeader {
        SampleHeader::at(Timestamp::from_seconds(seconds))
    }

    #[test]
    fn a_pose_between_two_states_lies_between_them() {
        let mut poses = Poses::new();
        for i in 0..300 {
            let t = 10.0 + 0.02 * f64::from(i);
            poses.push(&state(2.0 * t, t), &at(t)).unwrap();
        }
        for t in [14.0, 14.507, 15.99] {
            let pose = poses.at(Timestamp::from_seconds(t)).unwrap();
            assert!((pose.position.x - 2.0 * t).abs() < 1e-6);
            let expected = jink_shared_types::frames::wrap_pi(t);
            assert!((jink_shared_types::frames::wrap_pi(pose.yaw_rad() - expected)).abs() < 1e-4);
        }
        let ahead = poses.at(Timestamp::from_seconds(16.05)).unwrap();
        assert!(
            (ahead.position.x - 32.1).abs() < 1e-6,
            "predicted with its velocity"
        );
        assert!(poses.at(Timestamp::from_seconds(16.3)).is_none(), "too far ahead");
        assert!(poses.at(Timestamp::from_seconds(10.0)).is_none(), "forgotten");
    }

    #[test]
    fn an_origin_that_moved_empties_the_history() {
        let mut poses = Poses::new();
        poses.push(&state(0.0, 0.0), &at(1.0)).unwrap();
        let moved = VehicleState {
            estimator_resets: 1,
            ..state(5.0, 0.0)
        };
        assert_eq!(poses.push(&moved, &at(1.02)), Ok(true));
        assert!(poses.at(Timestamp::from_seconds(1.01)).is_none());
    }

    #[test]
    fn late_and_invalid_states_are_refused() {
        let mut poses = Poses::new();
        poses.push(&state(0.0, 0.0), &at(1.0)).unwrap();
        assert!(matches!(
            poses.push(&state(0.0, 0.0), &at(0.99)),
            Err(PoseRefused::OutOfOrder { .. })
        ));
        for bad in [
            VehicleState {
                position_valid: Flag::NO,
                ..state(0.0, 0.0)
            },
            VehicleState {
                position: Point::UNSET,
                ..state(0.0, 0.0)
            },
            VehicleState {
                attitude: Attitude::new(0.0, 0.0, 0.0, 0.0),
                ..state(0.0, 0.0)
            },
        ] {
            assert_eq!(poses.push(&bad, &at(1.1)), Err(PoseRefused::Invalid));
        }
    }

    #[test]
    fn a_stamp_from_the_far_future_does_not_block_the_history_for_good() {
        let mut poses = Poses::new();
        poses
            .push(&state(0.0, 0.0), &SampleHeader::at(Timestamp::from_ns(u64::MAX)))
            .unwrap();
        assert_eq!(poses.push(&state(1.0, 0.0), &at(2.0)), Ok(true));
        assert!(poses.at(Timestamp::from_seconds(2.01)).is_some());
    }
}
