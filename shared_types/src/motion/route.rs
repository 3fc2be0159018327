//! What the planner asks for.

use super::{BezierPiece, CORRIDOR_POLYTOPES, GUIDE_POINTS, MotionLimits, MotionState, Polytope};
use crate::clock::Timestamp;
use crate::coded::{Coded, Flag};
use crate::frames::{LocalNed, Point};
use crate::reserved::{Added, Reserved};
use crate::tracking::Tracking;
use crate::view::Missing;

crate::wire_enum! {
    /// What the planner wants.
    pub enum RouteMode {
        /// Nothing new: keep flying the committed trajectory.
        Keep = 0 "keep",
        /// A new motion through the corridor.
        Plan = 1 "plan",
        /// A new stop, because the committed trajectory has lost its certificate or its purpose.
        Stop = 2 "stop",
        /// Send the autopilot's own setpoint back.
        Mirror = 3 "mirror",
        /// Turn to `goal_yaw_rad` where the vehicle rests, to see in that direction.
        Turn = 4 "turn",
    }
}

crate::sample! {
    /// The planner's result: guide, corridor, limits, and a stop.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Route: 7488 {
        /// Counts routes; the high half is the planner's generation.
        pub id: u64,
        /// The trajectory this route departs from; 0 = from rest where the vehicle is.
        pub base_id: u64,
        /// When it departs.
        pub splice: Timestamp,
        /// The state at that moment: the base trajectory's, or the vehicle's own.
        pub start: MotionState,
        /// Where the last corridor piece should end, if it can.
        pub target: Point<LocalNed>,
        /// Final goal behind it.
        pub goal: Point<LocalNed>,
        /// Heading wanted at the end (rad); NaN = along the path.
        pub goal_yaw_rad: f64,
        /// Limits under which the corridor was certified; the stop keeps [`MotionLimits::of_a_stop`] of them.
        pub limits: MotionLimits,
        /// The stop from `start`, certified; used when `has_stop` is set.
        pub stop: BezierPiece,
        /// What is wanted.
        pub mode: Coded<RouteMode>,
        /// `stop` is valid.
        pub has_stop: Flag,
        /// The committed trajectory must be left: if no curve is found, fly the stop.
        pub must_leave: Flag,
        /// The target is the goal itself, not a step toward it.
        pub target_is_goal: Flag,
        /// Vertices of the guide in use; the first is the start.
        pub guide_len: u32,
        /// Polytopes in use; polytope `i` holds guide vertices `i` and `i + 1`.
        pub corridor_len: u32,
        /// Declarations of the user that the corridor depends on, bits of [`crate::map::declared_as`].
        pub declarations: u8,
        /// What no sensor sees, so that no motion can be certified.
        pub unseen: Coded<Missing>,
        /// Explicit padding, zero.
        pub reserved: Reserved<2>,
        /// The proposal that the guide follows; absent of the planner's own.
        pub proposal_id: Added<u64>,
        /// How closely the vehicle follows, as plans allow for it; zeros before that is known.
        pub tracking: Tracking,
        /// The highest speed that plans reach (m/s); 0 before that is known.
        pub reached_mps: f32,
        /// The highest speed that is allowed (m/s); 0 before the other is known.
        pub allowed_mps: f32,
        /// The guide.
        pub guide: [Point<LocalNed>; GUIDE_POINTS],
        /// The corridor.
        pub corridor: [Polytope; CORRIDOR_POLYTOPES],
    }
    plausible if Self::is_consistent
}

impl Default for Route {
    fn default() -> Self {
        Self {
            id: 0,
            base_id: 0,
            splice: Timestamp::NEVER,
            start: MotionState::default(),
            target: Point::ZERO,
            goal: Point::ZERO,
            goal_yaw_rad: f64::NAN,
            limits: MotionLimits::default(),
            stop: BezierPiece::default(),
            mode: Coded::new(RouteMode::Keep),
            has_stop: Flag::NO,
            must_leave: Flag::NO,
            target_is_goal: Flag::NO,
            guide_len: 0,
            corridor_len: 0,
            declarations: 0,
            unseen: Coded::new(Missing::Nothing),
            reserved: Reserved::ZERO,
            proposal_id: Added::default(),
            tracking: Tracking::default(),
            reached_mps: 0.0,
            allowed_mps: 0.0,
            guide: [Point::ZERO; GUIDE_POINTS],
            corridor: [Polytope::default(); CORRIDOR_POLYTOPES],
        }
    }
}

impl Route {
    /// Whether its parts fit together and what is in use is finite.
    pub fn is_consistent(&self) -> bool {
        let lengths_fit =
            self.guide_len as usize <= GUIDE_POINTS && self.corridor_len as usize <= CORRIDOR_POLYTOPES;
        let stop_fits = !self.has_stop.is_set() || self.stop.is_sound();
        lengths_fit
            && stop_fits
            && self.guide().iter().all(|vertex| vertex.is_finite())
            && self.corridor().iter().all(Polytope::is_sound)
            && (self.mode != RouteMode::Plan || self.is_plan())
            && (self.mode != RouteMode::Turn || self.is_turn())
    }

    /// Whether a turn can be asked for: from a state, to a heading, within limits.
    fn is_turn(&self) -> bool {
        self.start.is_finite() && self.goal_yaw_rad.is_finite() && self.limits.is_sound()
    }

    /// Whether a curve can be asked for: from a state, through a corridor, within limits.
    fn is_plan(&self) -> bool {
        self.corridor_len > 0
            && self.guide_len == self.corridor_len + 1
            && self.start.is_finite()
            && self.target.is_finite()
            && self.limits.is_sound()
    }

    /// The guide's vertices in use.
    pub fn guide(&self) -> &[Point<LocalNed>] {
        &self.guide[..(self.guide_len as usize).min(GUIDE_POINTS)]
    }

    /// The polytopes in use.
    pub fn corridor(&self) -> &[Polytope] {
        &self.corridor[..(self.corridor_len as usize).min(CORRIDOR_POLYTOPES)]
    }
}
