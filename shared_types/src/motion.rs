//! Routes and trajectories: what the planner asks for, what the generator makes of it, what the guard approves.
//!
//! A [`Trajectory`] always ends at rest. It is never changed, only replaced, and a replacement says from which one it
//! departs ([`Trajectory::base_id`]) and when ([`Trajectory::splice`]): up to the splice it repeats the old one, so a
//! reader may switch to it at any time before that.

mod route;
mod trajectory;

pub use route::{Route, RouteMode};
pub use trajectory::{ApprovedTrajectory, GuardReason, Trajectory, TrajectoryMode, Verdict};

use crate::bezier::{self, End, QUINTIC};
use crate::frames::{Acceleration, LocalNed, Point, Velocity, wrap_pi};
use crate::reserved::Reserved;
use crate::tracking::Tracking;
use nalgebra::Vector3;

/// Most vertices of a guide path.
pub const GUIDE_POINTS: usize = 32;
/// Most polytopes of a corridor.
pub const CORRIDOR_POLYTOPES: usize = 8;
/// Most half-spaces of a polytope.
pub const POLYTOPE_PLANES: usize = 24;
/// Most pieces of a trajectory: what is left of the old one, up to eight corridor pieces, and a stop.
pub const TRAJECTORY_PIECES: usize = 20;
/// Share by which a curve may exceed a limit and still counts as keeping it. Generator and guard use the same value, or
/// one would refuse what the other approves. What is solved for stays below its limits; what the start of a curve fixes
/// does not: its first control points follow from the speed and the acceleration that are flown, for a piece of another
/// duration than the one that was certified, and curves are cut at times rounded to 0.1 ms. The path of a curve is
/// certified by itself; 1 % more acceleration widens the tracking tube (0.41 m per m/s^2) by 4 mm in the highest speed
/// tier.
pub const LIMIT_TOLERANCE: f64 = 0.01;
/// The same, absolute (m/s, m/s^2, m/s^3, rad/s), for a limit of zero: what rounding makes of a rest.
pub const LIMIT_SLACK: f64 = 1e-3;

/// How far ahead a new plan departs from the committed one (s): planner, generator, guard and the transport between
/// them take some 10 ms; 100 ms leave time for a restart of any of them.
pub const SPLICE_LEAD_S: f64 = 0.10;
/// From one plan to the next that is flown (s): the period of maps, and the time by which a plan departs ahead.
pub const REPLANNED_S: f64 = 0.1 + SPLICE_LEAD_S;

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
        pub reserved: Reserved<4>,
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

    /// Whether it has as many half-spaces as it has room for, one at least, and all their numbers are finite.
    pub fn is_sound(&self) -> bool {
        let count_fits = (1..=POLYTOPE_PLANES).contains(&(self.len as usize));
        let is_finite =
            |plane: &HalfSpace| plane.offset_m.is_finite() && plane.normal.iter().all(|x| x.is_finite());
        count_fits && self.planes().iter().all(is_finite)
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
    pub struct MotionLimits: 80 {
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
        /// Acceleration of the pieces that brake to rest at the end (m/s^2); across their direction they keep
        /// [`MotionLimits::across_mps2`].
        pub braking_mps2: f64,
        /// Jerk of these pieces (m/s^3).
        pub braking_jerk_mps3: f64,
    }
}

/// Acceleration that a stop may reach, as a share of the hardest braking: half of it more for what the vehicle
/// accelerates when it begins to stop.
const STOP_ACCELERATION: f64 = 1.5;
/// Jerk that a stop may reach, the same: a straight one from steady flight is shaped with half of it.
pub const STOP_JERK: f64 = 2.0;

impl MotionLimits {
    /// Whether all of them are finite and none is negative.
    pub fn is_sound(&self) -> bool {
        let limits = [
            self.speed_mps,
            self.climb_mps,
            self.descent_mps,
            self.acceleration_mps2,
            self.jerk_mps3,
            self.yaw_rate_radps,
            self.tube_m,
            self.overshoot_m,
            self.braking_mps2,
            self.braking_jerk_mps3,
        ];
        limits.iter().all(|limit| limit.is_finite() && *limit >= 0.0)
    }

    /// The limits of a stop out of a motion within these: as hard as an autopilot that follows as `tracking` says can
    /// brake, and not slower than `speed_mps` at its start.
    #[must_use]
    pub fn of_a_stop(self, tracking: &Tracking, speed_mps: f64) -> Self {
        let (braking_mps2, jerk_mps3) = tracking.hardest_stop();
        Self {
            speed_mps: self.speed_mps.max(speed_mps),
            acceleration_mps2: STOP_ACCELERATION * braking_mps2,
            jerk_mps3: STOP_JERK * jerk_mps3,
            ..self
        }
    }

    /// The limits of pieces that brake; across their way they keep [`Self::across_mps2`] of these.
    #[must_use]
    pub fn of_braking(self) -> Self {
        Self {
            acceleration_mps2: self.braking_mps2,
            jerk_mps3: self.braking_jerk_mps3,
            ..self
        }
    }

    /// With a stop at the end as gentle as everything else: of an autopilot that follows as `tracking` says.
    #[must_use]
    pub fn with_gentle_stop(self, tracking: &Tracking) -> Self {
        Self {
            overshoot_m: tracking.overshoot_m(self.acceleration_mps2),
            braking_mps2: self.acceleration_mps2,
            braking_jerk_mps3: self.jerk_mps3,
            ..self
        }
    }

    /// Acceleration across its direction (m/s^2) that a piece which brakes may reach, sideways and vertically: both
    /// together are what the tube holds.
    pub fn across_mps2(&self) -> f64 {
        self.acceleration_mps2 * std::f64::consts::FRAC_1_SQRT_2
    }

    /// The largest value that counts as within `limit`, one of these limits or what takes its place, in the same unit.
    pub fn allowed(limit: f64) -> f64 {
        limit * (1.0 + LIMIT_TOLERANCE) + LIMIT_SLACK
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

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        self.position.is_finite()
            && self.velocity.is_finite()
            && self.acceleration.is_finite()
            && self.yaw_rad.is_finite()
            && self.yaw_rate_radps.is_finite()
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

    /// Whether its acceleration across the way from its start to its end is at most `most_mps2` (m/s^2) sideways and vertically, or
    /// what it is in `start`: by the hull of its control points.
    pub fn is_straight(&self, most_mps2: f64, start: &MotionState) -> bool {
        let points = self.points();
        let Some(across) = across(&(points[QUINTIC - 1] - points[0])) else {
            return true;
        };
        let velocity: [_; 5] = bezier::derivative(&points, self.duration_s);
        let acceleration: [_; 4] = bezier::derivative(&velocity, self.duration_s);
        across.iter().all(|normal| {
            let inherited_mps2 = start.acceleration.vector().dot(normal).abs();
            let most_mps2 = MotionLimits::allowed(most_mps2.max(inherited_mps2));
            acceleration.iter().all(|a| a.dot(normal).abs() <= most_mps2)
        })
    }

    /// Whether every number is finite and the duration positive.
    pub fn is_sound(&self) -> bool {
        self.position.iter().all(|p| p.is_finite())
            && self.yaw_rad.iter().all(|y| y.is_finite())
            && self.duration_s.is_finite()
            && self.duration_s > 0.0
    }
}

/// The unit vectors across `way`, sideways and vertical; `None` for none. Of a vertical way north and east.
pub fn across(way: &Vector3<f64>) -> Option<[Vector3<f64>; 2]> {
    let along = way.try_normalize(1e-6)?;
    let sideways = Vector3::new(-along.y, along.x, 0.0)
        .try_normalize(1e-3)
        .unwrap_or(Vector3::y());
    Some([sideways, along.cross(&sideways).normalize()])
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
mod tests;
