//! Routes and trajectories: what the planner asks for, what the generator makes of it, what the guard lets through.
//!
//! A [`Trajectory`] always ends at rest. It is never changed, only replaced, and a replacement says from which one it
//! departs ([`Trajectory::base_id`]) and when ([`Trajectory::splice`]): up to the splice it repeats the old one, so a
//! reader may switch to it at any time before that.

use crate::bezier::{self, End, QUINTIC};
use crate::clock::Timestamp;
use crate::coded::{Coded, Flag};
use crate::frames::{Acceleration, LocalNed, Point, Velocity, wrap_pi};
use nalgebra::Vector3;

/// Most vertices of a guide path.
pub const GUIDE_POINTS: usize = 32;
/// Most polytopes of a corridor.
pub const CORRIDOR_POLYTOPES: usize = 8;
/// Most half-spaces of a polytope.
pub const POLYTOPE_PLANES: usize = 24;
/// Most pieces of a trajectory: what is left of the old one, up to eight corridor pieces, and a stop.
pub const TRAJECTORY_PIECES: usize = 20;

crate::sample! {
    /// The half-space `normal . p <= offset_m`; `normal` has unit length.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct HalfSpace: 32 {
        /// Outward normal.
        pub normal: [f64; 3],
        /// Distance of the plane from the local origin along the normal (m).
        pub offset_m: f64,
    }
}

impl HalfSpace {
    /// How far `point` lies inside (m); negative outside.
    pub fn depth_m(&self, point: &Vector3<f64>) -> f64 {
        self.offset_m - Vector3::from(self.normal).dot(point)
    }
}

crate::sample! {
    /// A convex piece of certified space: everywhere inside it the vehicle's centre may be, tube and radius already
    /// taken off.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct Polytope: 776 {
        /// Half-spaces in use.
        pub len: u32,
        /// Explicit padding, zero.
        pub reserved: u32,
        /// The half-spaces.
        pub planes: [HalfSpace; POLYTOPE_PLANES],
    }
}

impl Polytope {
    /// The half-spaces in use.
    pub fn planes(&self) -> &[HalfSpace] {
        &self.planes[..(self.len as usize).min(POLYTOPE_PLANES)]
    }

    /// Adds a half-space; `false` if there is no room left.
    pub fn push(&mut self, plane: HalfSpace) -> bool {
        match self.planes.get_mut(self.len as usize) {
            Some(slot) => {
                *slot = plane;
                self.len += 1;
                true
            }
            None => false,
        }
    }

    /// How deep `point` lies inside all half-spaces (m); negative outside.
    pub fn depth_m(&self, point: &Vector3<f64>) -> f64 {
        self.planes()
            .iter()
            .map(|plane| plane.depth_m(point))
            .fold(f64::INFINITY, f64::min)
    }
}

crate::sample! {
    /// What a motion may not exceed. All limits hold for the Euclidean norm of the whole vector unless stated.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct MotionLimits: 64 {
        /// Speed (m/s).
        pub speed_mps: f64,
        /// Speed upwards (m/s).
        pub climb_mps: f64,
        /// Speed downwards (m/s).
        pub descent_mps: f64,
        /// Acceleration (m/s^2).
        pub acceleration_mps2: f64,
        /// Jerk (m/s^3).
        pub jerk_mps3: f64,
        /// Heading rate (rad/s).
        pub yaw_rate_radps: f64,
        /// Tracking tube: how far the vehicle may be from the reference within these limits (m).
        pub tube_m: f64,
        /// How far it may run past the end of a stop within these limits (m).
        pub overshoot_m: f64,
    }
}

crate::sample! {
    /// A state of motion of the reference.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct MotionState: 88 {
        /// Position.
        pub position: Point<LocalNed>,
        /// Velocity.
        pub velocity: Velocity<LocalNed>,
        /// Acceleration.
        pub acceleration: Acceleration<LocalNed>,
        /// Heading (rad).
        pub yaw_rad: f64,
        /// Heading rate (rad/s).
        pub yaw_rate_radps: f64,
    }
}

impl MotionState {
    /// At rest at `position` with heading `yaw_rad`.
    pub fn at_rest(position: Point<LocalNed>, yaw_rad: f64) -> Self {
        Self {
            position,
            yaw_rad,
            ..Self::default()
        }
    }

    /// As an end condition of a curve.
    pub fn end(&self) -> End {
        End {
            position: self.position.vector(),
            velocity: self.velocity.vector(),
            acceleration: self.acceleration.vector(),
        }
    }
}

crate::sample! {
    /// One quintic Bezier piece, position and heading over the same duration.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct BezierPiece: 200 {
        /// Control points of the position.
        pub position: [Point<LocalNed>; QUINTIC],
        /// Control points of the heading (rad), continuous (not wrapped).
        pub yaw_rad: [f64; QUINTIC],
        /// Duration (s), positive.
        pub duration_s: f64,
    }
}

impl BezierPiece {
    /// From position control points, heading control points and duration.
    pub fn new(position: &[Vector3<f64>; QUINTIC], yaw_rad: [f64; QUINTIC], duration_s: f64) -> Self {
        Self {
            position: position.map(Point::from_vector),
            yaw_rad,
            duration_s,
        }
    }

    /// The position control points as vectors.
    pub fn points(&self) -> [Vector3<f64>; QUINTIC] {
        self.position.map(Point::vector)
    }

    /// The state `t_s` seconds into the piece, clamped to its ends.
    pub fn at(&self, t_s: f64) -> MotionState {
        let u = (t_s / self.duration_s).clamp(0.0, 1.0);
        let points = self.points();
        let velocity: [_; 5] = bezier::derivative(&points, self.duration_s);
        let acceleration: [_; 4] = bezier::derivative(&velocity, self.duration_s);
        let yaw_rate: [_; 5] = bezier::derivative_scalar(&self.yaw_rad, self.duration_s);
        MotionState {
            position: Point::from_vector(bezier::evaluate(&points, u)),
            velocity: Velocity::from_vector(bezier::evaluate(&velocity, u)),
            acceleration: Acceleration::from_vector(bezier::evaluate(&acceleration, u)),
            yaw_rad: wrap_pi(bezier::evaluate_scalar(&self.yaw_rad, u)),
            yaw_rate_radps: bezier::evaluate_scalar(&yaw_rate, u),
        }
    }

    /// The parts before and after `t_s` seconds into the piece; `t_s` must lie strictly inside.
    pub fn split(&self, t_s: f64) -> (Self, Self) {
        let u = (t_s / self.duration_s).clamp(0.0, 1.0);
        let (before, after) = bezier::split(&self.points(), u);
        let (yaw_before, yaw_after) = bezier::split_scalar(&self.yaw_rad, u);
        (
            Self::new(&before, yaw_before, self.duration_s * u),
            Self::new(&after, yaw_after, self.duration_s * (1.0 - u)),
        )
    }

    /// Whether every number is finite and the duration positive.
    pub fn is_sound(&self) -> bool {
        self.position.iter().all(|p| p.is_finite())
            && self.yaw_rad.iter().all(|y| y.is_finite())
            && self.duration_s.is_finite()
            && self.duration_s > 0.0
    }
}

crate::wire_enum! {
    /// What the planner wants.
    pub enum RouteMode {
        /// Nothing new: keep flying what is committed.
        Keep = 0 "keep",
        /// A new motion through the corridor.
        Plan = 1 "plan",
        /// A new stop, because the committed trajectory has lost its certificate or its purpose.
        Stop = 2 "stop",
        /// Send the autopilot's own setpoint back.
        Mirror = 3 "mirror",
    }
}

crate::sample! {
    /// The planner's answer: guide, corridor, limits, and a stop that is always in hand.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Route: 7424 {
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
        /// Limits under which the corridor was certified.
        pub limits: MotionLimits,
        /// The stop from `start`, certified; used when `has_stop` is set.
        pub stop: BezierPiece,
        /// What is wanted.
        pub mode: Coded<RouteMode>,
        /// `stop` is valid.
        pub has_stop: Flag,
        /// The committed trajectory must be left: if no curve is found, fly the stop.
        pub must_leave: Flag,
        /// The target is the goal itself, not a step on the way.
        pub target_is_goal: Flag,
        /// Vertices of the guide in use; the first is the start.
        pub guide_len: u32,
        /// Polytopes in use; polytope `i` holds guide vertices `i` and `i + 1`.
        pub corridor_len: u32,
        /// Explicit padding, zero.
        pub reserved: u32,
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
            reserved: 0,
            guide: [Point::ZERO; GUIDE_POINTS],
            corridor: [Polytope::default(); CORRIDOR_POLYTOPES],
        }
    }
}

impl Route {
    /// Whether its parts fit together and what is in use is finite.
    pub fn is_consistent(&self) -> bool {
        let plan = self.mode == RouteMode::Plan;
        let lengths_fit = self.guide_len as usize <= GUIDE_POINTS
            && self.corridor_len as usize <= CORRIDOR_POLYTOPES
            && (!plan || self.corridor_len > 0 && self.guide_len == self.corridor_len + 1);
        let stop_fits = !self.has_stop.is_set() || self.stop.is_sound();
        lengths_fit
            && stop_fits
            && self
                .guide()
                .iter()
                .all(|vertex| vertex.vector().iter().all(|x| x.is_finite()))
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

crate::wire_enum! {
    /// What a trajectory is for.
    pub enum TrajectoryMode {
        /// No trajectory: the gateway sends the autopilot's own setpoint back.
        Mirror = 0 "mirror",
        /// A planned motion that ends at rest.
        Plan = 1 "plan",
        /// A certified stop.
        Stop = 2 "stop",
        /// Maximum braking, certificate lost.
        Brake = 3 "brake",
    }
}

crate::sample! {
    /// Bezier pieces with a start time, ending at rest.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct Trajectory: 4120 {
        /// Identity; unique over restarts: the high half is the maker's generation.
        pub id: u64,
        /// The trajectory it departs from; 0 = from rest.
        pub base_id: u64,
        /// The route it was made for.
        pub route_id: u64,
        /// When piece 0 starts.
        pub start: Timestamp,
        /// When it departs from its base; before, both are the same.
        pub splice: Timestamp,
        /// Limits it keeps, tube included.
        pub limits: MotionLimits,
        /// Purpose.
        pub mode: Coded<TrajectoryMode>,
        /// It ends at the goal.
        pub reaches_goal: Flag,
        /// Explicit padding, zero.
        pub reserved: [u8; 2],
        /// Pieces in use.
        pub len: u32,
        /// Explicit padding, zero.
        pub reserved2: u64,
        /// The pieces.
        pub pieces: [BezierPiece; TRAJECTORY_PIECES],
    }
    plausible if Self::is_consistent
}

impl Trajectory {
    /// The pieces in use.
    pub fn pieces(&self) -> &[BezierPiece] {
        &self.pieces[..(self.len as usize).min(TRAJECTORY_PIECES)]
    }

    /// Appends a piece; `false` if there is no room left.
    pub fn push(&mut self, piece: BezierPiece) -> bool {
        match self.pieces.get_mut(self.len as usize) {
            Some(slot) => {
                *slot = piece;
                self.len += 1;
                true
            }
            None => false,
        }
    }

    /// Total duration (s).
    pub fn duration_s(&self) -> f64 {
        self.pieces().iter().map(|piece| piece.duration_s).sum()
    }

    /// When the vehicle comes to rest.
    pub fn end(&self) -> Timestamp {
        self.start.plus_seconds(self.duration_s())
    }

    /// The reference at `time`: the start before it begins, rest at the end after it. `None` without pieces.
    pub fn at(&self, time: Timestamp) -> Option<MotionState> {
        let last = self.pieces().last()?;
        let mut t_s = time.seconds_since(self.start).max(0.0);
        for piece in self.pieces() {
            if t_s <= piece.duration_s {
                return Some(piece.at(t_s));
            }
            t_s -= piece.duration_s;
        }
        let end = last.at(last.duration_s);
        Some(MotionState::at_rest(end.position, end.yaw_rad))
    }

    /// Copies into `self` (whose pieces are dropped) what `base` does from `from` to `until`: whole pieces stay as they
    /// are, the pieces at both ends are cut. Returns `false`, leaving `self` empty, if that does not fit.
    pub fn take_prefix(&mut self, base: &Self, from: Timestamp, until: Timestamp) -> bool {
        /// Shorter than this a cut piece is numerical dust: its derivatives would be noise.
        const DUST_S: f64 = 1e-4;
        self.len = 0;
        self.start = from;
        let first_s = from.seconds_since(base.start);
        let last_s = until.seconds_since(base.start);
        let mut piece_start_s = 0.0;
        let mut started = false;
        for piece in base.pieces() {
            let piece_end_s = piece_start_s + piece.duration_s;
            if piece_end_s > first_s + DUST_S && piece_start_s < last_s - DUST_S {
                let mut part = *piece;
                let mut part_start_s = piece_start_s;
                if !started && first_s > piece_start_s + DUST_S {
                    part = part.split(first_s - piece_start_s).1;
                    part_start_s = first_s;
                }
                if !started {
                    self.start = base.start.plus_seconds(part_start_s);
                    started = true;
                }
                if last_s < piece_end_s - DUST_S {
                    part = part.split(last_s - part_start_s).0;
                }
                if !self.push(part) {
                    self.len = 0;
                    return false;
                }
            }
            piece_start_s = piece_end_s;
        }
        true
    }

    /// Whether it is what its mode says: nothing to fly, or something that can be flown.
    pub fn is_consistent(&self) -> bool {
        self.mode == TrajectoryMode::Mirror || self.is_sound()
    }

    /// Whether it can be flown at all: at least one piece, all numbers finite.
    pub fn is_sound(&self) -> bool {
        self.len as usize <= TRAJECTORY_PIECES
            && self.len > 0
            && self.start.is_set()
            && self.pieces().iter().all(BezierPiece::is_sound)
    }
}

crate::wire_enum! {
    /// What the guard did.
    pub enum Verdict {
        /// Nothing is approved: hold.
        Hold = 0 "hold",
        /// Passed unchanged.
        Passed = 1 "passed",
        /// The new trajectory was refused; the one before goes on.
        Kept = 2 "kept",
        /// Replaced by the guard's own brake.
        Braked = 3 "braked",
    }
}

crate::wire_enum! {
    /// Why the guard decided so.
    pub enum GuardReason {
        /// No reason given.
        None = 0 "none",
        /// An obstacle is nearer than the stopping distance.
        Obstacle = 1 "obstacle",
        /// The way leads where no sensor sees.
        Unseen = 2 "unseen",
        /// Range data are too old.
        RangesStale = 3 "ranges_stale",
        /// The vehicle's state is too old or invalid.
        StateStale = 4 "state_stale",
        /// The new trajectory does not join the one being flown.
        Discontinuous = 5 "discontinuous",
        /// The new trajectory came after its own splice time.
        Late = 6 "late",
        /// The new trajectory breaks its limits or is no trajectory.
        Unsound = 7 "unsound",
        /// The new trajectory departs from another one than is being flown.
        WrongBase = 8 "wrong_base",
    }
}

crate::sample! {
    /// What may leave for the autopilot.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct ApprovedTrajectory: 4144 {
        /// The trajectory.
        pub trajectory: Trajectory,
        /// Way left to the first conflict the guard sees (m); infinity if none.
        pub free_way_m: f64,
        /// Way needed to stop from here (m).
        pub stopping_m: f64,
        /// Decision.
        pub verdict: Coded<Verdict>,
        /// Its reason.
        pub reason: Coded<GuardReason>,
        /// Explicit padding, zero.
        pub reserved: [u8; 6],
    }
    plausible if Self::is_consistent
}

impl ApprovedTrajectory {
    /// Whether what is approved can be flown.
    pub fn is_consistent(&self) -> bool {
        self.verdict == Verdict::Hold || self.trajectory.is_consistent()
    }
}

/// Distance needed to come to rest (m) from `speed_mps`, with a reaction time `delay_s`, a jerk-limited build-up and
/// then constant `deceleration_mps2`: `v tau + v a / (2 j) + v^2 / (2 a)`. The build-up term is the one that PX4 uses
/// in its own speed limits (`computeMaxSpeedFromDistance`), on the safe side of the exact value.
pub fn stopping_distance_m(speed_mps: f64, delay_s: f64, deceleration_mps2: f64, jerk_mps3: f64) -> f64 {
    speed_mps * delay_s
        + speed_mps * deceleration_mps2 / (2.0 * jerk_mps3)
        + speed_mps * speed_mps / (2.0 * deceleration_mps2)
}

/// The speed (m/s) whose [`stopping_distance_m`] is `distance_m`; zero for none.
pub fn stoppable_speed_mps(distance_m: f64, delay_s: f64, deceleration_mps2: f64, jerk_mps3: f64) -> f64 {
    if distance_m <= 0.0 {
        return 0.0;
    }
    let b = delay_s + deceleration_mps2 / (2.0 * jerk_mps3);
    let a = deceleration_mps2;
    -a * b + (a * a * b * b + 2.0 * a * distance_m).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn piece(from: f64, to: f64, duration_s: f64) -> BezierPiece {
        let rest = |x: f64| End {
            position: Vector3::new(x, 0.0, -2.0),
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
        };
        BezierPiece::new(
            &bezier::quintic_between(&rest(from), &rest(to), duration_s),
            [0.0; 6],
            duration_s,
        )
    }

    fn two_pieces() -> Trajectory {
        let mut trajectory = Trajectory {
            id: 1,
            start: Timestamp::from_seconds(100.0),
            ..Trajectory::default()
        };
        assert!(trajectory.push(piece(0.0, 3.0, 2.0)));
        assert!(trajectory.push(piece(3.0, 5.0, 1.0)));
        trajectory
    }

    proptest! {
        #[test]
        fn a_prefix_traces_its_base(from in 0.0..2.8f64, span in 0.01..2.5f64, u in 0.0..1.0f64) {
            let base = two_pieces();
            let begin = base.start.plus_seconds(from);
            let until = base.start.plus_seconds((from + span).min(3.0));
            let mut prefix = Trajectory::default();
            prop_assert!(prefix.take_prefix(&base, begin, until));
            let time = begin.plus_seconds(u * until.seconds_since(begin));
            let (a, b) = (base.at(time).unwrap(), prefix.at(time).unwrap());
            prop_assert!((a.position.vector() - b.position.vector()).norm() < 1e-6);
            prop_assert!((a.velocity.vector() - b.velocity.vector()).norm() < 1e-4);
            prop_assert!((prefix.end().seconds_since(until)).abs() < 2e-4);
        }

        #[test]
        fn the_stoppable_speed_is_the_inverse_of_the_stopping_distance(
            speed in 0.0..20.0f64, delay in 0.0..1.0f64, a in 0.5..15.0f64, j in 1.0..40.0f64,
        ) {
            let distance = stopping_distance_m(speed, delay, a, j);
            prop_assert!((stoppable_speed_mps(distance, delay, a, j) - speed).abs() < 1e-6);
        }
    }

    #[test]
    fn after_its_end_a_trajectory_is_at_rest() {
        let trajectory = two_pieces();
        let late = trajectory.at(trajectory.end().plus_seconds(10.0)).unwrap();
        assert!((late.position.x_m - 5.0).abs() < 1e-9);
        assert_eq!(late.velocity.vector().norm(), 0.0);
    }

    #[test]
    fn an_empty_trajectory_has_no_state_and_is_not_sound() {
        let empty = Trajectory::default();
        assert!(empty.at(Timestamp::from_seconds(1.0)).is_none());
        assert!(!empty.is_sound());
    }

    #[test]
    fn a_corrupted_length_is_no_panic() {
        let mut trajectory = two_pieces();
        trajectory.len = u32::MAX;
        assert!(!trajectory.is_sound());
        assert_eq!(trajectory.pieces().len(), TRAJECTORY_PIECES);
    }
}
