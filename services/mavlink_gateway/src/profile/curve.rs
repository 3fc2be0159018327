//! The curve that one setpoint carries: five control points, so a quartic in position and heading.
//!
//! A long plan of quintics is sent as a stream of short quartics, each cut from the *plan* and never from the curve
//! before, so errors do not add up. A quartic has five conditions: position, velocity and acceleration at its start,
//! position and velocity at its end. In between it leaves the plan by at most `0.03456 / 120 * |x^(5)| * T^5` where the
//! plan is one polynomial; across joints there is no such bound, so the error is sampled and the curve made shorter
//! while it is larger than [`WORST_ERROR_M`]. What is flown is mostly the first tenth, where the error is 4 % of its
//! largest value. (Bound: Hermite interpolation with nodes 0, 0, 0, 1, 1, whose largest node polynomial is 0.03456.)

use crate::vehicle::MAX_COORDINATE_M;
use jink_shared_types::Timestamp;
use jink_shared_types::bezier;
use jink_shared_types::frames::wrap_pi;
use jink_shared_types::motion::{MotionState, Trajectory};
use nalgebra::Vector3;

/// Control points of a curve: as many as TRAJECTORY_REPRESENTATION_BEZIER carries.
pub const CONTROL_POINTS: usize = 5;
/// A curve that leaves the plan by more than this is made shorter (m): small beside every tracking tube.
pub const WORST_ERROR_M: f64 = 0.02;
/// No curve is shorter than this (s): six periods at 20 Hz.
pub const SHORTEST_S: f64 = 0.3;
/// Headings beyond this (rad) are no headings: 160 turns.
pub const MAX_YAW_RAD: f64 = 1e3;

/// Points at which a curve is compared with its plan.
const SAMPLES: usize = 8;
/// PX4 wraps every heading to within half a turn of the first: a curve must not turn further than this (rad).
const WIDEST_TURN_RAD: f64 = 3.0;
/// A curve whose control points are all this near to its end is at rest (m). (f32 resolves 0.06 mm at 1 km.)
const REST_M: f64 = 1e-3;
/// A curve that is nowhere farther from another than this says the same (m): that is what a curve may leave its own plan by, and as
/// much again.
const SAME_M: f64 = 2.0 * WORST_ERROR_M;
/// The same for headings (rad).
const SAME_RAD: f64 = 0.1;
/// The same as for positions, at rest, for headings (rad).
const REST_RAD: f64 = 1e-3;
/// A plan is continued backwards by at most this much before its start (s): what back-dating and one late cycle need.
const BEFORE_START_S: f64 = 0.1;

/// A curve in time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Curve {
    /// When it starts.
    pub start: Timestamp,
    /// How long it lasts (s).
    pub duration_s: f64,
    /// Control points of the position in the local frame (m).
    pub position: [Vector3<f64>; CONTROL_POINTS],
    /// Control points of the heading (rad), not wrapped; the first is within [-pi, pi).
    pub yaw_rad: [f64; CONTROL_POINTS],
}

impl Curve {
    /// Stands still.
    pub fn constant(start: Timestamp, duration_s: f64, position: Vector3<f64>, yaw_rad: f64) -> Self {
        Self {
            start,
            duration_s,
            position: [position; CONTROL_POINTS],
            yaw_rad: [wrap_pi(yaw_rad); CONTROL_POINTS],
        }
    }

    /// Moves with `velocity` (m/s) along a line that is at `position` at time `at`.
    pub fn line(
        start: Timestamp,
        duration_s: f64,
        position: Vector3<f64>,
        at: Timestamp,
        velocity: Vector3<f64>,
        yaw_rad: f64,
    ) -> Self {
        let first = position + velocity * start.seconds_since(at);
        let step = velocity * (duration_s / (CONTROL_POINTS - 1) as f64);
        Self {
            start,
            duration_s,
            position: std::array::from_fn(|i| first + step * i as f64),
            yaw_rad: [wrap_pi(yaw_rad); CONTROL_POINTS],
        }
    }

    /// Comes to rest from `velocity` (m/s) within `duration_s`: the speed falls as 1 - 3u^2 + 2u^3, so the deceleration begins and ends
    /// with zero and is 1.5 times the mean at its peak; half of `velocity * duration_s` is travelled.
    pub fn stop(
        start: Timestamp,
        duration_s: f64,
        position: Vector3<f64>,
        velocity: Vector3<f64>,
        yaw_rad: f64,
    ) -> Self {
        // The integral of that, u - u^3 + u^4 / 2, as a Bezier curve.
        const SHARES: [f64; CONTROL_POINTS] = [0.0, 0.25, 0.5, 0.5, 0.5];
        Self {
            start,
            duration_s,
            position: SHARES.map(|share| position + velocity * (duration_s * share)),
            yaw_rad: [wrap_pi(yaw_rad); CONTROL_POINTS],
        }
    }

    /// The same curve elsewhere (m).
    pub fn moved_by(mut self, by: Vector3<f64>) -> Self {
        for point in &mut self.position {
            *point += by;
        }
        self
    }

    /// The part of `plan` from `start` on, `longest_s` long or as much shorter as the error demands, but not below
    /// `shortest_s`. `None` if the plan holds numbers that cannot be sent.
    pub fn cut(plan: &Trajectory, start: Timestamp, longest_s: f64, shortest_s: f64) -> Option<Self> {
        let mut duration_s = longest_s;
        loop {
            let (curve, faithful) = Self::fit(plan, start, duration_s)?;
            if faithful || duration_s <= shortest_s {
                return curve.is_sendable().then_some(curve.with_bounded_turn());
            }
            duration_s = (duration_s / 2.0).max(shortest_s);
        }
    }

    /// The quartic over `duration_s`, and whether it is near enough to the plan.
    fn fit(plan: &Trajectory, start: Timestamp, duration_s: f64) -> Option<(Self, bool)> {
        let first = state_at(plan, start)?;
        let last = state_at(plan, start.plus_seconds(duration_s))?;
        let position = bezier::quartic_between(
            &first.end(),
            last.position.vector(),
            last.velocity.vector(),
            duration_s,
        );
        let mut worst_m: f64 = 0.0;
        let mut turned_rad = 0.0;
        let mut before_rad = first.yaw_rad;
        for i in 1..=SAMPLES {
            let u = i as f64 / SAMPLES as f64;
            let there = state_at(plan, start.plus_seconds(u * duration_s))?;
            let error_m = (bezier::evaluate(&position, u) - there.position.vector()).norm();
            worst_m = worst_m.max(error_m);
            turned_rad += wrap_pi(there.yaw_rad - before_rad);
            before_rad = there.yaw_rad;
        }
        let rates = (first.yaw_rate_radps, last.yaw_rate_radps);
        let yaw_rad = yaw_points(wrap_pi(first.yaw_rad), turned_rad, rates, duration_s);
        let widest_rad = yaw_rad
            .iter()
            .map(|yaw| (yaw - yaw_rad[0]).abs())
            .fold(0.0, f64::max);
        let curve = Self {
            start,
            duration_s,
            position,
            yaw_rad,
        };
        Some((
            curve.settled(),
            worst_m <= WORST_ERROR_M && widest_rad <= WIDEST_TURN_RAD,
        ))
    }

    /// Exactly at rest where it is at rest but for rounding.
    fn settled(mut self) -> Self {
        let end = self.position[CONTROL_POINTS - 1];
        if self.position.iter().all(|p| (p - end).norm() <= REST_M) {
            self.position = [end; CONTROL_POINTS];
        }
        let end_rad = self.yaw_rad[CONTROL_POINTS - 1];
        if self.yaw_rad.iter().all(|yaw| (yaw - end_rad).abs() <= REST_RAD) {
            self.yaw_rad = [wrap_pi(end_rad); CONTROL_POINTS];
        }
        self
    }

    /// Turning no further than can be sent: a plan that turns half round within the shortest curve is not flown in its heading, and
    /// PX4 would take the other way round.
    fn with_bounded_turn(mut self) -> Self {
        let first_rad = self.yaw_rad[0];
        let turns = self.yaw_rad.map(|yaw| (yaw - first_rad).abs());
        let widest_rad = turns.into_iter().fold(0.0, f64::max);
        if widest_rad > WIDEST_TURN_RAD {
            let share = WIDEST_TURN_RAD / widest_rad;
            self.yaw_rad = self.yaw_rad.map(|yaw| first_rad + (yaw - first_rad) * share);
        }
        self
    }

    /// Whether every number is finite and of a size that an autopilot can use.
    pub fn is_sendable(&self) -> bool {
        self.duration_s.is_finite()
            && self.duration_s > 0.0
            && self
                .position
                .iter()
                .all(|p| p.iter().all(|c| c.abs() <= MAX_COORDINATE_M))
            && self.yaw_rad.iter().all(|yaw| yaw.abs() <= MAX_YAW_RAD)
    }

    /// Whether it leads where `plan` leads, from `now` on for `ahead_s`.
    pub fn agrees_with(&self, plan: &Trajectory, now: Timestamp, ahead_s: f64) -> bool {
        (0..=SAMPLES).all(|i| {
            let time = now.plus_seconds(ahead_s * i as f64 / SAMPLES as f64);
            time <= self.start.plus_seconds(self.duration_s)
                && state_at(plan, time).is_some_and(|there| {
                    (self.position_at(time) - there.position.vector()).norm() <= SAME_M
                        && wrap_pi(self.yaw_at(time) - there.yaw_rad).abs() <= SAME_RAD
                })
        })
    }

    /// Where it is at `time` (m); its ends before and after.
    pub fn position_at(&self, time: Timestamp) -> Vector3<f64> {
        bezier::evaluate(&self.position, self.progress(time))
    }

    /// Its velocity at `time` (m/s); none before and after.
    pub fn velocity_at(&self, time: Timestamp) -> Vector3<f64> {
        let velocity: [_; CONTROL_POINTS - 1] = bezier::derivative(&self.position, self.duration_s);
        match self.is_over(time) {
            true => Vector3::zeros(),
            false => bezier::evaluate(&velocity, self.progress(time)),
        }
    }

    /// Its acceleration at `time` (m/s^2); none before and after.
    pub fn acceleration_at(&self, time: Timestamp) -> Vector3<f64> {
        let velocity: [_; CONTROL_POINTS - 1] = bezier::derivative(&self.position, self.duration_s);
        let acceleration: [_; CONTROL_POINTS - 2] = bezier::derivative(&velocity, self.duration_s);
        match self.is_over(time) {
            true => Vector3::zeros(),
            false => bezier::evaluate(&acceleration, self.progress(time)),
        }
    }

    /// Rate of its heading at `time` (rad/s); none before and after.
    pub fn yaw_rate_at(&self, time: Timestamp) -> f64 {
        let rate: [_; CONTROL_POINTS - 1] = bezier::derivative_scalar(&self.yaw_rad, self.duration_s);
        match self.is_over(time) {
            true => 0.0,
            false => bezier::evaluate_scalar(&rate, self.progress(time)),
        }
    }

    /// Its heading at `time` (rad), not wrapped.
    pub fn yaw_at(&self, time: Timestamp) -> f64 {
        bezier::evaluate_scalar(&self.yaw_rad, self.progress(time))
    }

    fn is_over(&self, time: Timestamp) -> bool {
        !(0.0..=self.duration_s).contains(&time.seconds_since(self.start))
    }

    fn progress(&self, time: Timestamp) -> f64 {
        (time.seconds_since(self.start) / self.duration_s).clamp(0.0, 1.0)
    }
}

/// The plan's state at `time`; shortly before its start continued backwards, so that a back-dated curve joins it smoothly.
fn state_at(plan: &Trajectory, time: Timestamp) -> Option<MotionState> {
    let mut state = plan.at(time)?;
    let early_s = plan.start.seconds_since(time).clamp(0.0, BEFORE_START_S);
    if early_s > 0.0 {
        let velocity = state.velocity.vector();
        let acceleration = state.acceleration.vector();
        let position =
            state.position.vector() - velocity * early_s + acceleration * (0.5 * early_s * early_s);
        state.position = jink_shared_types::Point::from_vector(position);
        state.velocity = jink_shared_types::Velocity::from_vector(velocity - acceleration * early_s);
        state.yaw_rad = wrap_pi(state.yaw_rad - state.yaw_rate_radps * early_s);
    }
    Some(state)
}

/// Control points of the heading: the cubic that meets angle and rate at both ends, raised to degree four.
fn yaw_points(
    first_rad: f64,
    turned_rad: f64,
    (first_radps, last_radps): (f64, f64),
    duration_s: f64,
) -> [f64; CONTROL_POINTS] {
    let last_rad = first_rad + turned_rad;
    let c1 = first_rad + first_radps * duration_s / 3.0;
    let c2 = last_rad - last_radps * duration_s / 3.0;
    [
        first_rad,
        (first_rad + 3.0 * c1) / 4.0,
        (c1 + c2) / 2.0,
        (3.0 * c2 + last_rad) / 4.0,
        last_rad,
    ]
}

#[cfg(test)]
mod tests {
    use super::{CONTROL_POINTS, Curve, SHORTEST_S, WORST_ERROR_M, state_at};
    use jink_shared_types::bezier::{self, End};
    use jink_shared_types::motion::{BezierPiece, Trajectory};
    use jink_shared_types::{Timestamp, frames::wrap_pi};
    use nalgebra::Vector3;
    use proptest::prelude::*;

    const START_S: f64 = 50.0;

    fn vector(range: f64) -> impl Strategy<Value = Vector3<f64>> {
        (-range..range, -range..range, -range..range).prop_map(|(x, y, z)| Vector3::new(x, y, z))
    }

    /// Two pieces joined in position, velocity and acceleration, at rest at the end, turning on the way.
    fn plan() -> impl Strategy<Value = Trajectory> {
        (vector(20.0), vector(3.0), vector(2.0), 1.5..3.0f64, -2.0..2.0f64).prop_map(
            |(from, velocity, acceleration, duration_s, turn_rad)| {
                let end = |position, velocity, acceleration| End {
                    position,
                    velocity,
                    acceleration,
                };
                let zero = Vector3::zeros();
                let first = end(from, velocity, acceleration);
                let middle = end(from + velocity * (0.8 * duration_s), velocity * 0.7, zero);
                let last = end(middle.position + velocity * (0.35 * duration_s), zero, zero);
                let mut plan = Trajectory {
                    id: 1,
                    start: Timestamp::from_seconds(START_S),
                    ..Trajectory::default()
                };
                let yaw = |a: f64, b: f64| [a, a, a + 0.3 * (b - a), a + 0.7 * (b - a), b, b];
                plan.push(BezierPiece::new(
                    &bezier::quintic_between(&first, &middle, duration_s),
                    yaw(3.0, 3.0 + turn_rad),
                    duration_s,
                ));
                plan.push(BezierPiece::new(
                    &bezier::quintic_between(&middle, &last, duration_s),
                    yaw(3.0 + turn_rad, 3.0),
                    duration_s,
                ));
                plan
            },
        )
    }

    proptest! {
        #[test]
        fn a_stop_begins_as_the_vehicle_moves_and_ends_at_rest_without_ever_turning_back(
            from in vector(50.0), velocity in vector(8.0), duration_s in 0.3..5.0f64,
        ) {
            let start = Timestamp::from_seconds(START_S);
            let stop = Curve::stop(start, duration_s, from, velocity, 0.3);
            prop_assert!((stop.position_at(start) - from).norm() < 1e-9);
            prop_assert!((stop.velocity_at(start) - velocity).norm() < 1e-9);
            prop_assert!(stop.acceleration_at(start).norm() < 1e-9);
            let end = start.plus_seconds(duration_s);
            prop_assert!((stop.position_at(end) - from - velocity * (0.5 * duration_s)).norm() < 1e-6);
            prop_assert!(stop.velocity_at(end.plus_seconds(-1e-6)).norm() < 1e-3 && stop.velocity_at(end.plus_seconds(0.1)).norm() == 0.0);
            let mut before = velocity.norm();
            for i in 0..=100 {
                let at = start.plus_seconds(duration_s * f64::from(i) / 100.0);
                let speed = stop.velocity_at(at).norm();
                prop_assert!(speed <= before + 1e-9 && stop.velocity_at(at).dot(&velocity) >= -1e-9);
                prop_assert!(stop.acceleration_at(at).norm() <= 1.5 * velocity.norm() / duration_s + 1e-6);
                before = speed;
            }
        }

        #[test]
        fn a_cut_curve_stays_within_two_centimetres_of_its_plan(plan in plan(), at in 0.0..7.0f64) {
            let start = plan.start.plus_seconds(at);
            let curve = Curve::cut(&plan, start, 0.8, SHORTEST_S).unwrap();
            for i in 0..=50 {
                let time = start.plus_seconds(curve.duration_s * f64::from(i) / 50.0);
                let error_m = (curve.position_at(time) - plan.at(time).unwrap().position.vector()).norm();
                // Between the samples the error may be a little larger than at them.
                prop_assert!(error_m <= 1.1 * WORST_ERROR_M || curve.duration_s <= SHORTEST_S, "{error_m} m");
            }
        }

        #[test]
        fn no_curve_turns_so_far_that_px4_would_take_the_other_way_round(
            mut plan in plan(), yaw_rad in prop::array::uniform6(-900.0..900.0f64), at in 0.0..7.0f64,
        ) {
            plan.pieces[0].yaw_rad = yaw_rad;
            if let Some(curve) = Curve::cut(&plan, plan.start.plus_seconds(at), 0.8, SHORTEST_S) {
                prop_assert!(curve.yaw_rad.iter().all(|yaw| (yaw - curve.yaw_rad[0]).abs() < 3.1), "{:?}", curve.yaw_rad);
            }
        }

        #[test]
        fn a_cut_curve_starts_and_ends_in_the_plans_state(plan in plan(), at in 0.0..7.0f64) {
            let start = plan.start.plus_seconds(at);
            let curve = Curve::cut(&plan, start, 0.8, SHORTEST_S).unwrap();
            let velocity: [_; 4] = bezier::derivative(&curve.position, curve.duration_s);
            let yaw_rate: [_; 4] = bezier::derivative_scalar(&curve.yaw_rad, curve.duration_s);
            let first = plan.at(start).unwrap();
            let last = plan.at(start.plus_seconds(curve.duration_s)).unwrap();
            for (u, state) in [(0.0, first), (1.0, last)] {
                prop_assert!((bezier::evaluate(&curve.position, u) - state.position.vector()).norm() < 2e-3);
                prop_assert!((bezier::evaluate(&velocity, u) - state.velocity.vector()).norm() < 0.02);
                prop_assert!(wrap_pi(bezier::evaluate_scalar(&curve.yaw_rad, u) - state.yaw_rad).abs() < 2e-3);
                prop_assert!((bezier::evaluate_scalar(&yaw_rate, u) - state.yaw_rate_radps).abs() < 0.02);
            }
        }

        #[test]
        fn consecutive_cuts_of_one_plan_join_within_the_error_bound(plan in plan(), at in 0.0..7.0f64) {
            let cut = |s: f64| Curve::cut(&plan, plan.start.plus_seconds(s), 0.8, SHORTEST_S).unwrap();
            let (before, after) = (cut(at), cut(at + 0.05));
            let jump_m = (before.position_at(after.start) - after.position[0]).norm();
            prop_assert!(jump_m < WORST_ERROR_M, "{jump_m} m");
        }

        #[test]
        fn headings_are_continuous_and_wrapped_only_at_the_start(plan in plan(), at in 0.0..7.0f64) {
            let curve = Curve::cut(&plan, plan.start.plus_seconds(at), 0.8, SHORTEST_S).unwrap();
            prop_assert!(curve.yaw_rad[0].abs() <= std::f64::consts::PI);
            for pair in curve.yaw_rad.windows(2) {
                prop_assert!((pair[1] - pair[0]).abs() < 1.5);
            }
        }

        #[test]
        fn no_plan_makes_a_control_point_that_is_not_finite(
            numbers in proptest::collection::vec(any::<f64>(), 24), duration in any::<f64>(), ns in any::<u64>(),
        ) {
            let mut plan = Trajectory { start: Timestamp::from_ns(ns), ..Trajectory::default() };
            let point = |i: usize| Vector3::new(numbers[3 * i], numbers[3 * i + 1], numbers[3 * i + 2]);
            plan.push(BezierPiece::new(&std::array::from_fn(point), std::array::from_fn(|i| numbers[18 + i]), duration));
            for at in [ns / 2, ns, ns.saturating_add(200_000_000)] {
                if let Some(curve) = Curve::cut(&plan, Timestamp::from_ns(at), 0.8, SHORTEST_S) {
                    prop_assert!(curve.position.iter().all(|p| p.iter().all(|c| (*c as f32).is_finite())));
                    prop_assert!(curve.yaw_rad.iter().all(|yaw| (*yaw as f32).is_finite()));
                }
            }
        }
    }

    #[test]
    fn after_the_end_the_curve_is_constant_to_the_bit() {
        let rest = |x: f64| End {
            position: Vector3::new(x, 1.0, -2.0),
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
        };
        let mut plan = Trajectory {
            start: Timestamp::from_seconds(START_S),
            ..Trajectory::default()
        };
        plan.push(BezierPiece::new(
            &bezier::quintic_between(&rest(0.0), &rest(4.0), 2.0),
            [0.5; 6],
            2.0,
        ));
        let curve = Curve::cut(&plan, Timestamp::from_seconds(START_S + 30.0), 0.8, SHORTEST_S).unwrap();
        assert_eq!(curve.position, [Vector3::new(4.0, 1.0, -2.0); CONTROL_POINTS]);
        assert_eq!(curve.yaw_rad, [0.5; CONTROL_POINTS]);
    }

    #[test]
    fn a_joint_that_a_quartic_cannot_follow_shortens_the_curve() {
        let end = |x: f64, v: f64, a: f64| End {
            position: Vector3::new(x, 0.0, 0.0),
            velocity: Vector3::new(v, 0.0, 0.0),
            acceleration: Vector3::new(a, 0.0, 0.0),
        };
        let mut plan = Trajectory {
            start: Timestamp::from_seconds(START_S),
            ..Trajectory::default()
        };
        let pieces = [
            (end(0.0, 5.0, 0.0), end(1.8, 3.0, -10.0), 0.4),
            (end(1.8, 3.0, -10.0), end(2.4, 0.0, 0.0), 0.5),
        ];
        for (from, to, duration_s) in pieces {
            plan.push(BezierPiece::new(
                &bezier::quintic_between(&from, &to, duration_s),
                [0.0; 6],
                duration_s,
            ));
        }
        let curve = Curve::cut(&plan, plan.start, 0.8, SHORTEST_S).unwrap();
        assert!(curve.duration_s < 0.8);
    }

    #[test]
    fn shortly_before_its_start_a_moving_plan_is_continued_backwards() {
        let end = |x: f64| End {
            position: Vector3::new(x, 0.0, 0.0),
            velocity: Vector3::new(3.0, 0.0, 0.0),
            acceleration: Vector3::zeros(),
        };
        let mut plan = Trajectory {
            start: Timestamp::from_seconds(START_S),
            ..Trajectory::default()
        };
        plan.push(BezierPiece::new(
            &bezier::quintic_between(&end(0.0), &end(3.0), 1.0),
            [0.0; 6],
            1.0,
        ));
        let state = state_at(&plan, Timestamp::from_seconds(START_S - 0.01)).unwrap();
        assert!((state.position.x_m + 0.03).abs() < 1e-6);
        assert!((state.velocity.x_mps - 3.0).abs() < 1e-9);
    }
}
