//! Turns a route and its corridor into Bezier pieces with bounded speed, acceleration and jerk, continuous with what is
//! being flown, ending at rest.
//!
//! | in | out |
//! |---|---|
//! | route, the trajectory it departs from | a [`Trajectory`], certified, or nothing |
//!
//! The new trajectory repeats its base up to the splice, then follows the route's corridor. It is published only with a
//! certificate, computed from the finished pieces: every control point of a piece inside one polytope of the corridor,
//! and by the hull of the derivatives' control points speed, climb, descent, acceleration, jerk and heading rate within
//! the limits. Failing is safe: the base continues and ends at rest. When no curve is found, only a route that must be
//! left is answered with its stop, which the planner has certified.

mod heading;
mod interior_point;
pub mod problem;
pub mod profile;
mod service;

pub use service::GeneratorService;

use crate::problem::{CurveSolver, Infeasible, PieceSpec};
use crate::profile::{LegPiece, cut};
use jink_shared_types::bezier::{QUINTIC, derivative, derivative_scalar, hull_keeps};
use jink_shared_types::motion::{
    BezierPiece, CORRIDOR_POLYTOPES, MotionLimits, Polytope, Route, RouteMode, Trajectory, TrajectoryMode,
    across,
};
use jink_shared_types::tracking::Tracking;
use jink_shared_types::{Coded, Timestamp};
use nalgebra::Vector3;

/// Time scales of the profile that are tried one after the other: a slower curve is farther from its limits, a shorter
/// first piece fits a moving start into a narrow corridor.
const STRETCHES: [f64; 5] = [1.0, 1.15, 1.4, 1.8, 0.8];
/// How much of its base a trajectory repeats before now (s): the gateway dates its curves back by 10 ms, and a reader
/// that lags still finds the present time in it.
const PREFIX_S: f64 = 0.15;
/// A trajectory that would be ready later than this before its splice is not sent (s).
const READY_BEFORE_S: f64 = 0.005;
/// Rounding allowed when a finished curve is checked against its corridor (m).
const CORRIDOR_TOLERANCE_M: f64 = 1e-4;
/// How often the heading rate is halved before its hull counts as its extent: in a turn from rest to rest the middle
/// control point is 2.7 times as fast as the turn. Position needs none: the solver keeps its control points themselves
/// within the limits.
const HEADING_HALVINGS: u32 = 2;
/// Most pieces of a plan: one per polytope, and four more for legs that take long. What it repeats of its base fits beside them into a
/// trajectory.
const PIECES_MAX: usize = CORRIDOR_POLYTOPES + 4;

/// Why no trajectory was made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NoTrajectory {
    /// The route asks for none.
    NotAsked,
    /// The route departs from a trajectory that is not the one being flown.
    WrongBase {
        /// What the route departs from.
        wanted: u64,
        /// What is being flown.
        flown: u64,
    },
    /// The splice is over, or too near.
    Late {
        /// Time left until the splice (s).
        left_s: f64,
    },
    /// The route's corridor or its numbers are not consistent.
    BadRoute,
    /// The old part and the new part together have too many pieces.
    TooManyPieces,
    /// No curve within corridor and limits was found.
    Infeasible(Infeasible),
    /// A curve was found but is not certified.
    NotCertified,
}

/// The generator.
#[derive(Debug)]
pub struct Generator {
    next_id: u64,
    solver: CurveSolver,
    curves: Vec<[Vector3<f64>; QUINTIC]>,
}

impl Generator {
    /// A generator whose trajectories carry `generation` in their ids.
    pub fn new(generation: u32) -> Self {
        Self {
            next_id: u64::from(generation) << 32 | 1,
            solver: CurveSolver::with_capacity(PIECES_MAX),
            curves: Vec::with_capacity(PIECES_MAX),
        }
    }

    /// Makes a trajectory for `route`; `flown` is the active trajectory. On success `out` holds the new one.
    ///
    /// # Errors
    /// [`NoTrajectory`]: `out` is then not to be used.
    pub fn step(
        &mut self,
        now: Timestamp,
        route: &Route,
        flown: Option<&Trajectory>,
        out: &mut Trajectory,
    ) -> Result<(), NoTrajectory> {
        *out = Trajectory {
            id: self.next_id,
            base_id: route.base_id,
            route_id: route.id,
            splice: route.splice,
            ..Trajectory::default()
        };
        match route.mode.get() {
            RouteMode::Keep => return Err(NoTrajectory::NotAsked),
            RouteMode::Mirror => {
                out.base_id = 0;
                out.start = now;
                out.mode = Coded::new(TrajectoryMode::Mirror);
            }
            RouteMode::Plan => {
                prefix(now, route, flown, out)?;
                match self.plan(route, out) {
                    Err(_) if route.must_leave.is_set() && route.has_stop.is_set() => {
                        prefix(now, route, flown, out)?;
                        append_stop(route, out)?;
                    }
                    result => result?,
                }
            }
            RouteMode::Stop => {
                prefix(now, route, flown, out)?;
                append_stop(route, out)?;
            }
            RouteMode::Turn => {
                prefix(now, route, flown, out)?;
                append_turn(route, out)?;
            }
        }
        self.next_id += 1;
        Ok(())
    }

    fn plan(&mut self, route: &Route, out: &mut Trajectory) -> Result<(), NoTrajectory> {
        let legs = route.corridor().len();
        if legs == 0 || route.guide().len() != legs + 1 {
            return Err(NoTrajectory::BadRoute);
        }
        let mut failure = NoTrajectory::BadRoute;
        for stretch in STRETCHES {
            let mut specs = [PieceSpec {
                duration_s: 0.0,
                polytope: &route.corridor[0],
                guide: Vector3::zeros(),
                brakes: false,
                across: None,
            }; PIECES_MAX];
            let count = specify(route, stretch, &mut specs);
            let specs = &mut specs[..count];
            match self.solve_straight(route, specs) {
                Ok(()) => match self.append_curves(route, specs, out) {
                    Err(NoTrajectory::NotCertified) => failure = NoTrajectory::NotCertified,
                    result => return result,
                },
                Err(cause) => failure = NoTrajectory::Infeasible(cause),
            }
        }
        Err(failure)
    }

    /// Solves for the pieces. Across which way one that brakes is bounded is known only when it is found: if that is not the way of
    /// its guide, it is solved for once more.
    fn solve_straight(&mut self, route: &Route, specs: &mut [PieceSpec<'_>]) -> Result<(), Infeasible> {
        let target = route.target.vector();
        self.solver
            .solve(&route.start, specs, &target, &route.limits, &mut self.curves)?;
        let most_mps2 = route.limits.across_mps2();
        let is_bent = |(points, spec): (&[Vector3<f64>; QUINTIC], &PieceSpec<'_>)| {
            let piece = BezierPiece::new(points, [0.0; QUINTIC], spec.duration_s);
            spec.brakes && !piece.is_straight(most_mps2, &route.start)
        };
        if !self.curves.iter().zip(specs.iter()).any(is_bent) {
            return Ok(());
        }
        for (points, spec) in self.curves.iter().zip(specs.iter_mut()) {
            if spec.brakes {
                spec.across = across(&(points[QUINTIC - 1] - points[0]));
            }
        }
        self.solver
            .solve(&route.start, specs, &target, &route.limits, &mut self.curves)
    }

    /// Appends the curves to `out`, or leaves it as it is if they are not certified.
    fn append_curves(
        &self,
        route: &Route,
        specs: &[PieceSpec<'_>],
        out: &mut Trajectory,
    ) -> Result<(), NoTrajectory> {
        let prefix = out.len;
        let [going, braking] = [route.limits, route.limits.of_braking()]
            .map(|limits| CertificateBounds::new(&limits, route.start.yaw_rate_radps));
        let mut heading =
            heading::HeadingProfile::new(&route.start, route.goal_yaw_rad, route.limits.yaw_rate_radps);
        for (points, spec) in self.curves.iter().zip(specs) {
            let yaw_rad = heading.piece(points, spec.duration_s);
            let piece = BezierPiece::new(points, yaw_rad, spec.duration_s);
            let (bounds, fits) = match spec.brakes {
                true => (&braking, out.push_braking(piece)),
                false => (&going, out.push(piece)),
            };
            if !fits {
                return Err(NoTrajectory::TooManyPieces);
            }
            let is_straight = !spec.brakes || piece.is_straight(route.limits.across_mps2(), &route.start);
            if !is_straight || !bounds.certify(&piece, spec.polytope) {
                out.truncate(prefix);
                return Err(NoTrajectory::NotCertified);
            }
        }
        out.limits = route.limits;
        out.declarations = route.declarations;
        out.mode = Coded::new(TrajectoryMode::Plan);
        out.reaches_goal = route.target_is_goal;
        if out.is_sound() {
            Ok(())
        } else {
            Err(NoTrajectory::BadRoute)
        }
    }
}

/// Copies what is left of the base until the splice into `out`.
fn prefix(
    now: Timestamp,
    route: &Route,
    flown: Option<&Trajectory>,
    out: &mut Trajectory,
) -> Result<(), NoTrajectory> {
    let left_s = route.splice.seconds_since(now);
    if left_s < READY_BEFORE_S {
        return Err(NoTrajectory::Late { left_s });
    }
    out.truncate(0);
    out.start = route.splice;
    if route.base_id == 0 {
        return Ok(());
    }
    match flown {
        Some(base) if base.id == route.base_id => {
            // A base that has ended is at rest: nothing of it needs repeating.
            if base.end() <= now {
                return Ok(());
            }
            let fits = out.take_prefix(
                base,
                now.plus_seconds(-PREFIX_S).max(base.start),
                route.splice.min(base.end()),
            );
            if !fits {
                return Err(NoTrajectory::TooManyPieces);
            }
            hold_until_splice(route, base, out)
        }
        other => Err(NoTrajectory::WrongBase {
            wanted: route.base_id,
            flown: other.map_or(0, |trajectory| trajectory.id),
        }),
    }
}

/// A base that ends before the splice rests until then.
fn hold_until_splice(route: &Route, base: &Trajectory, out: &mut Trajectory) -> Result<(), NoTrajectory> {
    let rest_s = route.splice.seconds_since(base.end());
    if rest_s <= 0.0 {
        return Ok(());
    }
    let Some(end) = base.at(base.end()) else {
        return Err(NoTrajectory::BadRoute);
    };
    let still = BezierPiece::new(&[end.position.vector(); QUINTIC], [end.yaw_rad; QUINTIC], rest_s);
    if out.push(still) {
        Ok(())
    } else {
        Err(NoTrajectory::TooManyPieces)
    }
}

fn append_stop(route: &Route, out: &mut Trajectory) -> Result<(), NoTrajectory> {
    if !route.has_stop.is_set() || !out.push(route.stop) {
        return Err(NoTrajectory::BadRoute);
    }
    let tracking = route.tracking.known().unwrap_or(Tracking::PX4_TRAJECTORY);
    out.limits = route
        .limits
        .of_a_stop(&tracking, route.start.velocity.vector().norm());
    out.mode = Coded::new(TrajectoryMode::Stop);
    if out.is_sound() {
        Ok(())
    } else {
        Err(NoTrajectory::BadRoute)
    }
}

/// A turn where the vehicle rests. Only from rest: a reference that moves would jump.
fn append_turn(route: &Route, out: &mut Trajectory) -> Result<(), NoTrajectory> {
    let start = &route.start;
    let allowed = MotionLimits::allowed;
    let rests = start.velocity.vector().norm() <= allowed(0.0)
        && start.acceleration.vector().norm() <= allowed(0.0)
        && start.yaw_rate_radps.abs() <= allowed(0.0);
    if !rests || !route.goal_yaw_rad.is_finite() || route.limits.yaw_rate_radps <= 0.0 {
        return Err(NoTrajectory::BadRoute);
    }
    let (yaw_rad, duration_s) = heading::turn(start, route.goal_yaw_rad, route.limits.yaw_rate_radps);
    if !out.push(BezierPiece::new(
        &[start.position.vector(); QUINTIC],
        yaw_rad,
        duration_s,
    )) {
        return Err(NoTrajectory::TooManyPieces);
    }
    out.limits = route.limits;
    out.mode = Coded::new(TrajectoryMode::Plan);
    if out.is_sound() {
        Ok(())
    } else {
        Err(NoTrajectory::BadRoute)
    }
}

/// Pieces for the route's legs.
fn specify<'a>(route: &'a Route, stretch: f64, specs: &mut [PieceSpec<'a>; PIECES_MAX]) -> usize {
    let legs = route.corridor().len();
    let mut vertices = [Vector3::zeros(); CORRIDOR_POLYTOPES + 1];
    for (vertex, point) in vertices.iter_mut().zip(route.guide()) {
        *vertex = point.vector();
    }
    let mut pieces = [LegPiece::default(); PIECES_MAX];
    let velocity = route.start.velocity.vector();
    let count = cut(&vertices[..=legs], &velocity, &route.limits, stretch, &mut pieces);
    for (spec, piece) in specs.iter_mut().zip(&pieces[..count]) {
        *spec = PieceSpec {
            duration_s: piece.duration_s,
            polytope: &route.corridor[piece.leg],
            guide: piece.end,
            brakes: piece.brakes,
            across: across(&(vertices[piece.leg + 1] - vertices[piece.leg])).filter(|_| piece.brakes),
        };
    }
    // A start that brakes harder than a plan lets go of the brake first.
    specs[0].brakes |=
        route.start.acceleration.vector().norm() > MotionLimits::allowed(route.limits.acceleration_mps2);
    count
}

/// The largest values that a certified piece may reach.
struct CertificateBounds {
    speed_mps: f64,
    climb_mps: f64,
    descent_mps: f64,
    acceleration_mps2: f64,
    jerk_mps3: f64,
    yaw_rate_radps: f64,
}

impl CertificateBounds {
    /// A heading rate that exceeds the limit at the start (`yaw_rate_radps`), as after the guard's brake, can only
    /// decay; it must not grow. For the other limits such a start is infeasible.
    fn new(limits: &MotionLimits, yaw_rate_radps: f64) -> Self {
        let allowed = MotionLimits::allowed;
        Self {
            speed_mps: allowed(limits.speed_mps),
            climb_mps: allowed(limits.climb_mps),
            descent_mps: allowed(limits.descent_mps),
            acceleration_mps2: allowed(limits.acceleration_mps2),
            jerk_mps3: allowed(limits.jerk_mps3),
            yaw_rate_radps: allowed(limits.yaw_rate_radps.max(yaw_rate_radps.abs())),
        }
    }

    /// The certificate of one finished piece, from its control points alone.
    fn certify(&self, piece: &BezierPiece, polytope: &Polytope) -> bool {
        let points = piece.points();
        let velocity: [_; 5] = derivative(&points, piece.duration_s);
        let acceleration: [_; 4] = derivative(&velocity, piece.duration_s);
        let jerk: [_; 3] = derivative(&acceleration, piece.duration_s);
        let yaw_rate: [f64; 5] = derivative_scalar(&piece.yaw_rad, piece.duration_s);
        points
            .iter()
            .all(|point| polytope.depth_m(point) >= -CORRIDOR_TOLERANCE_M)
            && velocity
                .iter()
                .all(|v| v.norm() <= self.speed_mps && -v.z <= self.climb_mps && v.z <= self.descent_mps)
            && acceleration.iter().all(|a| a.norm() <= self.acceleration_mps2)
            && jerk.iter().all(|j| j.norm() <= self.jerk_mps3)
            && hull_keeps(
                &yaw_rate.map(|rate| Vector3::new(rate, 0.0, 0.0)),
                HEADING_HALVINGS,
                &|rate: &Vector3<f64>| rate.x.abs() <= self.yaw_rate_radps,
            )
    }
}

#[cfg(test)]
mod tests {
    use super::{CORRIDOR_TOLERANCE_M, CertificateBounds, Generator, NoTrajectory};
    use jink_shared_types::bezier::{End, quintic_between};
    use jink_shared_types::frames::{Acceleration, Point, Velocity};
    use jink_shared_types::motion::{
        BezierPiece, HalfSpace, LIMIT_SLACK, LIMIT_TOLERANCE, MotionLimits, MotionState, Polytope, Route,
        RouteMode, Trajectory, TrajectoryMode,
    };
    use jink_shared_types::{Coded, Flag, Timestamp};
    use jink_testkit::motions::{extremes, hop, limits_of};
    use nalgebra::Vector3;
    use proptest::prelude::*;

    const LIMITS: MotionLimits = MotionLimits {
        speed_mps: 3.0,
        climb_mps: 1.5,
        descent_mps: 1.0,
        acceleration_mps2: 1.2,
        jerk_mps3: 2.5,
        yaw_rate_radps: 0.5,
        tube_m: 0.45,
        overshoot_m: 0.56,
        braking_mps2: 1.2,
        braking_jerk_mps3: 2.5,
    };

    fn now() -> Timestamp {
        Timestamp::from_seconds(100.0)
    }

    /// A box around the segment from `a` to `b`, `side_m` to each side.
    fn around(a: &Vector3<f64>, b: &Vector3<f64>, side_m: f64) -> Polytope {
        let (low, high) = (a.inf(b).add_scalar(-side_m), a.sup(b).add_scalar(side_m));
        let mut polytope = Polytope::default();
        for axis in 0..3 {
            for sign in [1.0, -1.0] {
                let mut normal = [0.0; 3];
                normal[axis] = sign;
                let offset_m = if sign > 0.0 { high[axis] } else { -low[axis] };
                polytope.push(HalfSpace { normal, offset_m });
            }
        }
        polytope
    }

    fn route(vertices: &[Vector3<f64>], velocity: Vector3<f64>, side_m: f64) -> Route {
        let mut route = Route {
            id: 7,
            mode: Coded::new(RouteMode::Plan),
            splice: now().plus_seconds(0.1),
            start: MotionState {
                position: Point::from_vector(vertices[0]),
                velocity: Velocity::from_vector(velocity),
                acceleration: Acceleration::ZERO,
                ..MotionState::default()
            },
            target: Point::from_vector(*vertices.last().unwrap()),
            limits: LIMITS,
            ..Route::default()
        };
        for (i, vertex) in vertices.iter().enumerate() {
            route.guide[i] = Point::from_vector(*vertex);
            route.guide_len += 1;
        }
        for (i, pair) in vertices.windows(2).enumerate() {
            route.corridor[i] = around(&pair[0], &pair[1], side_m);
            route.corridor_len += 1;
        }
        route
    }

    fn zigzag() -> Vec<Vector3<f64>> {
        vec![
            Vector3::new(0.0, 0.0, -2.5),
            Vector3::new(3.0, 0.5, -2.5),
            Vector3::new(5.5, 2.0, -2.5),
            Vector3::new(8.5, 2.0, -2.5),
            Vector3::new(10.0, 0.5, -2.5),
        ]
    }

    fn are_certified(pieces: &[BezierPiece], limits: &MotionLimits) -> bool {
        // No planes: all of space.
        let everywhere = Polytope::default();
        let bounds = CertificateBounds::new(limits, 0.0);
        pieces.iter().all(|piece| bounds.certify(piece, &everywhere))
    }

    proptest! {
        #[test]
        fn what_breaks_any_one_limit_is_not_certified_and_what_keeps_all_is(
            pieces in hop(), broken in 0usize..6, excess in 1e-6..0.5f64,
        ) {
            let mut values = extremes(&pieces, true);
            prop_assert!(are_certified(&pieces, &limits_of(values)));
            let reached = extremes(&pieces, false)[broken];
            values[broken] = (reached * (1.0 - excess) - LIMIT_SLACK) / (1.0 + LIMIT_TOLERANCE);
            prop_assert!(!are_certified(&pieces, &limits_of(values)), "{values:?}, {reached} reached");
        }
    }

    proptest! {
        #[test]
        fn what_leaves_its_polytope_is_not_certified(
            pieces in hop(), direction in proptest::array::uniform3(-1.0..1.0f64), outside_m in 1e-6..0.5f64,
        ) {
            let normal = Vector3::from(direction);
            prop_assume!(normal.norm() > 0.1);
            let normal = normal.normalize();
            let bounds = CertificateBounds::new(&limits_of(extremes(&pieces, true)), 0.0);
            for piece in &pieces {
                let reach_m = piece.points().iter().map(|point| normal.dot(point)).fold(f64::NEG_INFINITY, f64::max);
                let is_certified = |offset_m: f64| {
                    let mut polytope = Polytope::default();
                    polytope.push(HalfSpace { normal: normal.into(), offset_m });
                    bounds.certify(piece, &polytope)
                };
                prop_assert!(is_certified(reach_m + 1e-9));
                prop_assert!(!is_certified(reach_m - CORRIDOR_TOLERANCE_M - outside_m));
            }
        }
    }

    #[test]
    fn from_rest_the_target_is_reached_at_a_reasonable_speed() {
        let mut out = Trajectory::default();
        let route = route(&zigzag(), Vector3::zeros(), 0.7);
        Generator::new(1).step(now(), &route, None, &mut out).unwrap();
        let end = out.at(out.end()).unwrap();
        assert!(
            (end.position.vector() - route.target.vector()).norm() < 0.3,
            "{:?}",
            end.position
        );
        assert!(end.velocity.vector().norm() < 1e-6);
        assert!(out.duration_s() < 9.0, "{} s", out.duration_s());
        assert_eq!((out.base_id, out.route_id), (0, 7));
    }

    #[test]
    fn a_moving_start_is_joined_with_continuous_motion() {
        let mut generator = Generator::new(1);
        let (mut first, mut second) = (Trajectory::default(), Trajectory::default());
        let slalom = zigzag();
        generator
            .step(now(), &route(&slalom, Vector3::zeros(), 0.7), None, &mut first)
            .unwrap();
        let later = now().plus_seconds(2.0);
        let splice = later.plus_seconds(0.1);
        let state = first.at(splice).unwrap();
        let mut vertices = vec![state.position.vector()];
        vertices.extend(slalom.iter().filter(|v| v.x > state.position.x_m + 0.5));
        let next = Route {
            base_id: first.id,
            splice,
            start: state,
            ..route(&vertices, state.velocity.vector(), 0.9)
        };
        generator.step(later, &next, Some(&first), &mut second).unwrap();
        assert_ne!(first.id, second.id);
        let a = second.at(splice.plus_seconds(-1e-6)).unwrap();
        let b = second.at(splice.plus_seconds(1e-6)).unwrap();
        assert!((a.position.vector() - b.position.vector()).norm() < 1e-4);
        assert!((a.velocity.vector() - b.velocity.vector()).norm() < 1e-3);
        assert!((a.acceleration.vector() - b.acceleration.vector()).norm() < 1e-2);
        for i in 0..10 {
            let time = later.plus_seconds(0.01 * f64::from(i));
            let (a, b) = (first.at(time).unwrap(), second.at(time).unwrap());
            assert!(
                (a.position.vector() - b.position.vector()).norm() < 1e-6,
                "the old part is repeated"
            );
        }
    }

    #[test]
    fn a_stop_is_put_out_when_no_curve_exists_and_the_old_one_must_be_left() {
        let mut generator = Generator::new(1);
        let (mut base, mut out) = (Trajectory::default(), Trajectory::default());
        generator
            .step(now(), &route(&zigzag(), Vector3::zeros(), 0.7), None, &mut base)
            .unwrap();
        let splice = now().plus_seconds(3.1);
        let state = base.at(splice).unwrap();
        // A corridor far away from where the vehicle is cannot be entered.
        let mut hopeless = route(
            &[Vector3::new(50.0, 0.0, -2.5), Vector3::new(53.0, 0.0, -2.5)],
            Vector3::zeros(),
            0.5,
        );
        hopeless.base_id = base.id;
        hopeless.splice = splice;
        hopeless.start = state;
        let later = now().plus_seconds(3.0);
        let refused = generator.step(later, &hopeless, Some(&base), &mut out);
        assert!(matches!(refused, Err(NoTrajectory::Infeasible(_))), "{refused:?}");
        hopeless.must_leave = Flag::YES;
        hopeless.has_stop = Flag::YES;
        // Harder than any plan: 2 m/s in 1.2 s.
        let speed_mps = state.velocity.vector().norm();
        let duration_s = 0.6 * speed_mps;
        let end = End {
            position: state.position.vector() + state.velocity.vector() * (0.5 * duration_s),
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
        };
        let points = quintic_between(&state.end(), &end, duration_s);
        hopeless.stop = BezierPiece::new(&points, [state.yaw_rad; 6], duration_s);
        generator.step(later, &hopeless, Some(&base), &mut out).unwrap();
        assert_eq!(out.mode.get(), TrajectoryMode::Stop);
        let reached = limits_of(extremes(&[hopeless.stop], false));
        assert!(reached.acceleration_mps2 > MotionLimits::allowed(LIMITS.acceleration_mps2));
        assert!(
            reached.acceleration_mps2 <= out.limits.acceleration_mps2,
            "{reached:?}"
        );
        assert!(reached.jerk_mps3 <= out.limits.jerk_mps3, "{reached:?}");
        assert!(reached.speed_mps <= out.limits.speed_mps, "{reached:?}");
    }

    #[test]
    fn a_late_or_foreign_route_is_refused() {
        let mut out = Trajectory::default();
        let mut generator = Generator::new(1);
        let mut late = route(&zigzag(), Vector3::zeros(), 0.7);
        late.splice = now();
        assert!(matches!(
            generator.step(now(), &late, None, &mut out),
            Err(NoTrajectory::Late { .. })
        ));
        let mut foreign = route(&zigzag(), Vector3::zeros(), 0.7);
        foreign.base_id = 99;
        assert_eq!(
            generator.step(now(), &foreign, None, &mut out),
            Err(NoTrajectory::WrongBase { wanted: 99, flown: 0 })
        );
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn whatever_is_put_out_keeps_its_corridor_and_its_limits(
            turns in proptest::collection::vec((1.0..3.0f64, -0.9..0.9f64, -0.5..0.5f64), 1..7),
            speed in 0.0..2.9f64, side in 0.3..1.2f64, yaw in -3.1..3.1f64, yaw_rate in -0.5..0.5f64,
        ) {
            let mut vertices = vec![Vector3::new(0.0, 0.0, -2.5)];
            let mut direction = 0.0f64;
            for (length, turn, slope) in turns {
                direction += turn;
                let last = *vertices.last().unwrap();
                vertices.push(last + Vector3::new(direction.cos(), direction.sin(), slope) * length);
            }
            let direction = (vertices[1] - vertices[0]).normalize();
            let mut route = route(&vertices, direction * speed, side);
            (route.start.yaw_rad, route.start.yaw_rate_radps) = (yaw, yaw_rate);
            let mut out = Trajectory::default();
            if Generator::new(1).step(now(), &route, None, &mut out).is_ok() {
                let mut time = out.start;
                while time <= out.end() {
                    let state = out.at(time).unwrap();
                    let inside = route.corridor().iter().any(|p| p.depth_m(&state.position.vector()) > -1e-3);
                    prop_assert!(inside, "{:?} at {}", state.position, time.seconds_since(out.start));
                    time = time.plus_seconds(0.01);
                }
                let reached = limits_of(extremes(out.pieces(), false));
                let allowed = MotionLimits::allowed;
                prop_assert!(reached.speed_mps <= allowed(LIMITS.speed_mps), "{reached:?}");
                prop_assert!(reached.climb_mps <= allowed(LIMITS.climb_mps), "{reached:?}");
                prop_assert!(reached.descent_mps <= allowed(LIMITS.descent_mps), "{reached:?}");
                prop_assert!(reached.acceleration_mps2 <= allowed(LIMITS.acceleration_mps2), "{reached:?}");
                prop_assert!(reached.jerk_mps3 <= allowed(LIMITS.jerk_mps3), "{reached:?}");
                prop_assert!(reached.yaw_rate_radps <= allowed(LIMITS.yaw_rate_radps), "{reached:?}");
                prop_assert!(out.at(out.end()).unwrap().velocity.vector().norm() < 1e-6);
            }
        }
    }

    #[test]
    fn a_stop_beside_its_guide_is_found_at_the_second_try() {
        let limits = MotionLimits {
            speed_mps: 8.0,
            acceleration_mps2: 3.9,
            jerk_mps3: 9.4,
            braking_mps2: 6.0,
            braking_jerk_mps3: 20.0,
            ..LIMITS
        };
        // Speed (m/s), first leg (m), bend (degrees), second leg over speed (s), half width of the corridor (m).
        for (speed_mps, corner_m, bend_deg, long_s, side_m) in [
            (5.0, 0.5, 20.0f64, 0.7, 1.0),
            (5.0, 1.5, 40.0, 1.3, 0.5),
            (6.0, 0.5, 20.0, 0.7, 3.0),
            (6.0, 0.5, 30.0, 1.3, 3.0),
        ] {
            let (sin, cos) = bend_deg.to_radians().sin_cos();
            let corner = Vector3::new(corner_m, 0.0, -2.5);
            let end = corner + long_s * speed_mps * Vector3::new(cos, sin, 0.0);
            let vertices = [Vector3::new(0.0, 0.0, -2.5), corner, end];
            let mut route = route(&vertices, Vector3::new(speed_mps, 0.0, 0.0), side_m);
            route.limits = limits;
            let mut out = Trajectory::default();
            let made = Generator::new(1).step(now(), &route, None, &mut out);
            assert_eq!(made, Ok(()), "{speed_mps} {bend_deg}");
        }
    }
}
