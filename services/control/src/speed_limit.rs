//! The limit of the speed in force, and its cause: what is allowed, known space, the goal, the room, the end of the trajectory, a stop, a
//! brake.

use crate::planned_speed::PlannedSpeed;
use jink_shared_types::Timestamp;
use jink_shared_types::motion::{
    ApprovedTrajectory, REPLANNED_S, Route, Trajectory, TrajectoryMode, Verdict, stoppable_speed_mps,
};

/// Speeds that differ by less are shown as the same: two of one decimal (m/s).
const SPEED_SLACK_MPS: f64 = 0.06;
/// A trajectory that ends within this time is about to rest (s).
const SOON_S: f64 = 1.0;

/// Whether a planned motion is approved that has not ended at `now`.
pub fn flies(approved: &ApprovedTrajectory, now: Timestamp) -> bool {
    approved.verdict != Verdict::Hold
        && approved.trajectory.mode != TrajectoryMode::Mirror
        && approved.trajectory.end() > now
}

/// Why the speed is not higher.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// `OA_SPD_MAX`, or the mission's own speed.
    Allowed,
    /// Plans end at rest in known space, braking no harder than the vehicle follows.
    KnownSpace,
    /// The vehicle is to rest at the goal.
    Goal,
    /// The corridor is narrow: what moves slower is followed more closely.
    Room,
    /// What is approved ends, and nothing new is certified yet.
    Ends,
    /// A certified stop is flown.
    Stop,
    /// Maximum braking: the certificate is lost.
    Brake,
}

impl Cause {
    /// Every cause.
    pub const ALL: [Self; 7] = [
        Self::Allowed,
        Self::KnownSpace,
        Self::Goal,
        Self::Room,
        Self::Ends,
        Self::Stop,
        Self::Brake,
    ];

    /// For people, a few words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Allowed => "what is allowed",
            Self::KnownSpace => "the way to rest in known space",
            Self::Goal => "the way to rest at the goal",
            Self::Room => "the room here",
            Self::Ends => "the end of what is approved",
            Self::Stop => "a certified stop",
            Self::Brake => "maximum braking, certificate lost",
        }
    }
}

/// A limit in force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedLimit {
    /// Why.
    pub cause: Cause,
    /// How much (m/s).
    pub limit_mps: f64,
    planned: PlannedSpeed,
    ends_in_s: f64,
}

impl SpeedLimit {
    /// Of what is planned and approved at `now`; `None` where no planned motion is flown, or the planner does not know yet how closely
    /// the vehicle follows.
    pub fn of(route: &Route, approved: &ApprovedTrajectory, now: Timestamp) -> Option<Self> {
        let trajectory = &approved.trajectory;
        let ends_in_s = trajectory.end().seconds_since(now);
        if !flies(approved, now) {
            return None;
        }
        let planned = PlannedSpeed::of(route)?;
        let PlannedSpeed {
            reached_mps,
            allowed_mps,
            ..
        } = planned;
        let room_mps = trajectory.limits.speed_mps;
        let held_mps = held_mps(trajectory, now);
        let (cause, limit_mps) = match trajectory.mode.get() {
            TrajectoryMode::Stop => (Cause::Stop, room_mps),
            TrajectoryMode::Brake => (Cause::Brake, room_mps),
            _ if ends_in_s < SOON_S => (Cause::Ends, room_mps),
            _ if room_mps < reached_mps - SPEED_SLACK_MPS => (Cause::Room, room_mps),
            _ if held_mps >= room_mps - SPEED_SLACK_MPS => (Cause::Allowed, allowed_mps),
            _ if trajectory.reaches_goal.is_set() => (Cause::Goal, held_mps),
            _ => (Cause::KnownSpace, held_mps),
        };
        Some(Self {
            cause,
            limit_mps,
            planned,
            ends_in_s,
        })
    }

    /// For people, a sentence.
    pub fn text(&self) -> String {
        let PlannedSpeed {
            reached_mps,
            allowed_mps,
            ..
        } = self.planned;
        let words = self.cause.words();
        let plans = format!("plans reach {reached_mps:.1} of {allowed_mps:.1} m/s");
        match self.cause {
            Cause::Allowed => format!("limited by {words}: {allowed_mps:.1} m/s"),
            Cause::KnownSpace | Cause::Goal | Cause::Room => {
                format!("limited to {:.1} m/s by {words}; {plans}", self.limit_mps)
            }
            Cause::Ends => format!(
                "it comes to rest in {:.1} s unless a new plan is certified",
                self.ends_in_s
            ),
            Cause::Stop => format!("{words} is flown"),
            Cause::Brake => words.to_owned(),
        }
    }
}

/// The speed (m/s) at which the vehicle can wait for the next plan and still come to rest at the end of `trajectory`.
fn held_mps(trajectory: &Trajectory, now: Timestamp) -> f64 {
    let limits = &trajectory.limits;
    // A recording may hold a trajectory without these limits.
    let [braking_mps2, jerk_mps3] =
        [limits.braking_mps2, limits.braking_jerk_mps3].map(|limit| limit.max(1e-3));
    stoppable_speed_mps(trajectory.way_left_m(now), REPLANNED_S, braking_mps2, jerk_mps3)
}

#[cfg(test)]
mod tests {
    use super::{Cause, SpeedLimit};
    use jink_shared_types::Timestamp;
    use jink_shared_types::coded::{Coded, Flag};
    use jink_shared_types::motion::{ApprovedTrajectory, BezierPiece, Route, TrajectoryMode, Verdict};
    use jink_shared_types::tracking::Tracking;

    #[test]
    fn the_tightest_limit_is_the_one_that_is_said() {
        let route = Route {
            tracking: Tracking::PX4_OFFBOARD,
            reached_mps: 2.5,
            allowed_mps: 3.0,
            ..Route::default()
        };
        let mut approved = ApprovedTrajectory {
            verdict: Coded::new(Verdict::Passed),
            ..ApprovedTrajectory::default()
        };
        let trajectory = &mut approved.trajectory;
        trajectory.start = Timestamp::from_seconds(10.0);
        trajectory.mode = Coded::new(TrajectoryMode::Plan);
        trajectory.limits.speed_mps = 1.0;
        assert!(trajectory.push(BezierPiece {
            duration_s: 4.0,
            ..BezierPiece::default()
        }));
        let at = |approved: &ApprovedTrajectory, s: f64| {
            SpeedLimit::of(&route, approved, Timestamp::from_seconds(s))
                .map(|limit| (limit.cause, limit.text()))
        };
        let (cause, text) = at(&approved, 10.0).unwrap();
        assert_eq!(cause, Cause::Room);
        assert!(text.contains("1.0 m/s by the room here"), "{text}");
        let (cause, text) = at(&approved, 13.6).unwrap();
        assert_eq!(cause, Cause::Ends);
        assert!(text.contains("comes to rest in 0.4 s"), "{text}");
        assert_eq!(at(&approved, 14.5), None, "it rests");
        approved.trajectory.limits.speed_mps = 3.0;
        let (cause, text) = at(&approved, 10.0).unwrap();
        assert_eq!(cause, Cause::KnownSpace);
        assert!(text.contains("plans reach 2.5 of 3.0 m/s"), "{text}");
        approved.trajectory.reaches_goal = Flag::YES;
        assert_eq!(at(&approved, 10.0).unwrap().0, Cause::Goal);
        for (i, place) in approved.trajectory.pieces[0].position.iter_mut().enumerate() {
            place.x_m = 8.0 * i as f64 / 5.0;
        }
        approved.trajectory.limits.braking_mps2 = 6.0;
        approved.trajectory.limits.braking_jerk_mps3 = 20.0;
        let (cause, text) = at(&approved, 10.0).unwrap();
        assert_eq!(cause, Cause::Allowed, "8 m are enough to stop from 3 m/s");
        assert_eq!(text, "limited by what is allowed: 3.0 m/s");
        approved.trajectory.mode = Coded::new(TrajectoryMode::Brake);
        assert_eq!(at(&approved, 10.0).unwrap().0, Cause::Brake);
        approved.verdict = Coded::new(Verdict::Hold);
        assert_eq!(at(&approved, 10.0), None, "nothing is approved");
    }
}
