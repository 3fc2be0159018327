//! Where the vehicle was at every moment of a frame.
//!
//! A sweep takes its whole period, and the vehicle moves meanwhile: each ray needs the pose of its own time.
//! Between two recorded poses the position is linear and the attitude turns at a constant rate (slerp: K. Shoemake,
//! "Animating Rotation with Quaternion Curves", SIGGRAPH 1985, here as an axis and an angle).

use jink_shared_types::{BodyFrd, LocalNed, Point, Timestamp};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use std::collections::VecDeque;

/// Position and attitude of the vehicle's body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Position of the centre of gravity.
    pub position: Point<LocalNed>,
    /// `local_q_body`: takes body components to local ones.
    pub attitude: UnitQuaternion<f64>,
}

impl Pose {
    /// Level at `position`, heading `yaw_rad` (clockwise from north).
    pub fn level(position: Point<LocalNed>, yaw_rad: f64) -> Self {
        Self {
            position,
            attitude: UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad),
        }
    }

    /// A point of the body in local coordinates.
    pub fn to_local(&self, point: Point<BodyFrd>) -> Point<LocalNed> {
        Point::from_vector(self.position.vector() + self.attitude * point.vector())
    }
}

/// The recent poses of a vehicle, oldest first; full, it forgets the oldest.
#[derive(Clone, Debug)]
pub struct PoseTrack {
    poses: VecDeque<(Timestamp, Pose)>,
    capacity: usize,
}

impl PoseTrack {
    /// Room for `span_s` seconds of poses recorded every `step_s` seconds. The span must cover the longest frame
    /// ([`super::SensorRig::longest_frame_s`]) and one step.
    pub fn new(span_s: f64, step_s: f64) -> Self {
        let capacity = (span_s / step_s).ceil() as usize + 2;
        Self {
            poses: VecDeque::with_capacity(capacity),
            capacity,
        }
    }

    /// Records the pose at `time`; times must rise, one that does not is left out.
    pub fn push(&mut self, time: Timestamp, pose: Pose) {
        if self.poses.back().is_some_and(|(last, _)| *last >= time) {
            return;
        }
        if self.poses.len() == self.capacity {
            self.poses.pop_front();
        }
        self.poses.push_back((time, pose));
    }

    /// The pose at `time`: interpolated, held before the first and after the last; `None` while nothing is
    /// recorded.
    pub fn at(&self, time: Timestamp) -> Option<Pose> {
        Some(self.cursor()?.at(time))
    }

    /// For many times close together, rising or not; `None` while nothing is recorded.
    pub fn cursor(&self) -> Option<PoseCursor<'_>> {
        let first = self.poses.front()?;
        Some(PoseCursor {
            track: self,
            segment: Segment::between(first, first),
        })
    }

    fn segment(&self, time: Timestamp, held: &Segment) -> Segment {
        let after = self.poses.partition_point(|(at, _)| *at <= time);
        let (begin, end) = (self.poses.get(after.saturating_sub(1)), self.poses.get(after));
        match (begin, end) {
            (Some(begin), Some(end)) => Segment::between(begin, end),
            (Some(only), None) => Segment::between(only, only),
            (None, _) => *held,
        }
    }
}

/// Looks poses up in a [`PoseTrack`], keeping the segment it is in.
#[derive(Clone, Debug)]
pub struct PoseCursor<'a> {
    track: &'a PoseTrack,
    segment: Segment,
}

impl PoseCursor<'_> {
    /// As [`PoseTrack::at`].
    pub fn at(&mut self, time: Timestamp) -> Pose {
        if !(self.segment.begin <= time && time < self.segment.end) {
            self.segment = self.track.segment(time, &self.segment);
        }
        self.segment.at(time)
    }
}

/// Straight, steady motion between two recorded poses.
#[derive(Clone, Copy, Debug)]
struct Segment {
    begin: Timestamp,
    end: Timestamp,
    from: Pose,
    way: Vector3<f64>,
    axis: Vector3<f64>,
    half_angle_rad: f64,
}

impl Segment {
    fn between(begin: &(Timestamp, Pose), end: &(Timestamp, Pose)) -> Self {
        let turn = begin.1.attitude.inverse() * end.1.attitude;
        // Of the two ways round the shorter one: q and -q are the same attitude.
        let (scalar, vector) = if turn.w < 0.0 {
            (-turn.w, -turn.imag())
        } else {
            (turn.w, turn.imag())
        };
        let sine = vector.norm();
        Self {
            begin: begin.0,
            end: end.0,
            from: begin.1,
            way: end.1.position.vector() - begin.1.position.vector(),
            axis: if sine > 0.0 { vector / sine } else { vector },
            half_angle_rad: sine.atan2(scalar),
        }
    }

    fn at(&self, time: Timestamp) -> Pose {
        let span_ns = self.end.ns_since(self.begin);
        if span_ns == 0 || time <= self.begin {
            return self.from;
        }
        let share = time.ns_since(self.begin) as f64 / span_ns as f64;
        let (sine, cosine) = (self.half_angle_rad * share).sin_cos();
        let turn = UnitQuaternion::new_unchecked(Quaternion::from_parts(cosine, self.axis * sine));
        Pose {
            position: Point::from_vector(self.from.position.vector() + self.way * share),
            attitude: self.from.attitude * turn,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pose(x: f64, roll: f64, pitch: f64, yaw: f64) -> Pose {
        Pose {
            position: Point::new(x, 2.0 * x, -x),
            attitude: UnitQuaternion::from_euler_angles(roll, pitch, yaw),
        }
    }

    proptest! {
        #[test]
        fn between_two_poses_the_attitude_is_the_slerp(
            roll in -1.0..1.0f64, pitch in -1.0..1.0f64, yaw in -3.0..3.0f64, share in 0.0..1.0f64,
        ) {
            let (begin, end) = (pose(0.0, 0.1, 0.2, 0.3), pose(1.0, roll, pitch, yaw));
            let mut track = PoseTrack::new(1.0, 0.1);
            track.push(Timestamp::from_ns(1_000), begin);
            track.push(Timestamp::from_ns(1_001_000), end);
            let ns = 1_000 + (share * 1e6) as u64;
            let share = (ns - 1_000) as f64 * 1e-6;
            let at = track.at(Timestamp::from_ns(ns)).unwrap();
            prop_assert!(at.attitude.angle_to(&begin.attitude.slerp(&end.attitude, share)) < 1e-7);
            let expected = begin.position.vector().lerp(&end.position.vector(), share);
            prop_assert!((at.position.vector() - expected).norm() < 1e-12);
        }
    }

    #[test]
    fn before_the_first_and_after_the_last_the_pose_is_held() {
        let mut track = PoseTrack::new(0.05, 0.01);
        assert!(track.at(Timestamp::from_ns(5)).is_none());
        for i in 1..=20_u32 {
            track.push(
                Timestamp::from_ns(u64::from(i) * 10),
                pose(f64::from(i), 0.0, 0.0, 0.1 * f64::from(i)),
            );
        }
        // Room for seven: 14 to 20 are left.
        assert_eq!(track.at(Timestamp::from_ns(1)).unwrap().position.x_m, 14.0);
        assert_eq!(
            track.at(Timestamp::from_ns(900)).unwrap(),
            pose(20.0, 0.0, 0.0, 2.0)
        );
        track.push(Timestamp::from_ns(200), pose(99.0, 0.0, 0.0, 0.0));
        assert_eq!(track.at(Timestamp::from_ns(200)).unwrap().position.x_m, 20.0);
        // A cursor answers the same, wherever it was before.
        let mut cursor = track.cursor().unwrap();
        for ns in [145, 199, 150, 1, 177, 300, 140, 200] {
            let time = Timestamp::from_ns(ns);
            assert_eq!(cursor.at(time), track.at(time).unwrap());
        }
    }
}
