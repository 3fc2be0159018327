//! Which vehicle states the guard believes, and how far from them a pose is still good enough for it.

use jink_shared_types::Timestamp;
use jink_shared_types::clock::Order;
use jink_shared_types::pose_history::{Estimate, Pose, PoseHistory, Reach};
use jink_shared_types::sample::SampleHeader;
use jink_shared_types::vehicle::VehicleState;
use std::fmt;

const REACH: Reach = Reach {
    // The state's own deadline and one period of it: at 5 m/s2 what is carried on from the newest one is then 6 cm wrong, less than the
    // guard's margin.
    state_s: 0.15,
    // Both states within reach from anywhere between them.
    gap_s: 0.3,
};

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

/// The pose history.
#[derive(Clone, Debug)]
pub struct Poses {
    history: PoseHistory,
    resets: Option<u32>,
}

impl Poses {
    /// Empty, with all its memory.
    pub fn new() -> Self {
        Self {
            history: PoseHistory::new(REACH),
            resets: None,
        }
    }

    /// Adds a state. `Ok(true)` if the estimator has moved its origin since the one before, or whoever stamped that one was wrong:
    /// everything that was placed in local coordinates is then worthless, the history included.
    pub fn push(&mut self, state: &VehicleState, header: &SampleHeader) -> Result<bool, PoseRefused> {
        let capture = header.capture;
        let estimate = Estimate::of(state).filter(|_| capture.is_set());
        let estimate = estimate.ok_or(PoseRefused::Invalid)?;
        let newest = self.history.newest();
        let reset = self.resets.is_some_and(|resets| resets != state.estimator_resets);
        let moved = match Order::judge(capture, newest) {
            Order::Newer => reset,
            Order::ClockStep => true,
            Order::Late if reset => true,
            Order::Late => return Err(PoseRefused::OutOfOrder { capture, newest }),
        };
        self.resets = Some(state.estimator_resets);
        if moved {
            self.history.clear();
        }
        self.history.push(estimate, capture);
        Ok(moved)
    }

    /// When the newest state was valid.
    pub fn newest(&self) -> Timestamp {
        self.history.newest()
    }

    /// The pose at `time`; nothing if the states do not say.
    pub fn at(&self, time: Timestamp) -> Option<Pose> {
        self.history.at(time)
    }
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
            assert!((pose.position_m.x - 2.0 * t).abs() < 1e-6);
            let expected = jink_shared_types::frames::wrap_pi(t);
            assert!((jink_shared_types::frames::wrap_pi(pose.yaw_rad() - expected)).abs() < 1e-4);
        }
        let ahead = poses.at(Timestamp::from_seconds(16.05)).unwrap();
        assert!(
            (ahead.position_m.x - 32.1).abs() < 1e-6,
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
