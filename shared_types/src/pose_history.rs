//! Where the vehicle was when a ray was measured.
//!
//! | in | out |
//! |---|---|
//! | vehicle states with their times of validity | the pose at any moment that is within reach of a state, or nothing |
//!
//! Between two states the position follows the cubic Hermite polynomial through both positions and velocities
//! (error of fourth order in the interval: below 1 mm at 50 Hz even at 30 m/s2 of changing acceleration) and the
//! attitude the great arc between both (Shoemake, "Animating rotation with quaternion curves", 1985). After the
//! newest state the velocity and the body rates are carried on.

use crate::clock::{Order, Timestamp};
use crate::frames::Attitude;
use crate::vehicle::VehicleState;
use nalgebra::{UnitQuaternion, Vector3};

/// States kept: 2.5 s at 50 Hz, several times the oldest range sample that can still arrive.
const STATES: usize = 128;

/// Largest coordinate taken for a position (m): a local plane is meaningless long before.
const MAX_POSITION_M: f64 = 1e6;
/// Largest speed component taken for one of a multicopter (m/s).
const MAX_SPEED_MPS: f64 = 200.0;
/// Largest body rate taken for one of a multicopter (rad/s): rate gyros saturate at 2000 deg/s = 35 rad/s.
const MAX_RATE_RADPS: f64 = 50.0;

/// Position and attitude at one moment: `local_T_body`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Position of the body's origin in the local frame (m).
    pub position_m: Vector3<f64>,
    /// Takes body coordinates to local ones.
    pub local_q_body: UnitQuaternion<f64>,
}

impl Pose {
    /// The pose `share` (0 to 1) of the way to `other`, both components straight. Only for neighbours: the attitude does not turn at a
    /// constant rate.
    pub fn toward(&self, other: &Self, share: f64) -> Self {
        // The two quaternions of one rotation differ in sign: take the nearer one, or the mean would be nonsense.
        let from = self.local_q_body;
        let to = if from.coords.dot(&other.local_q_body.coords) < 0.0 {
            UnitQuaternion::new_unchecked(-other.local_q_body.into_inner())
        } else {
            other.local_q_body
        };
        Self {
            position_m: self.position_m.lerp(&other.position_m, share),
            local_q_body: from.nlerp(&to, share),
        }
    }

    /// Heading (rad), clockwise from north.
    pub fn yaw_rad(&self) -> f64 {
        Attitude::from_rotation(self.local_q_body).yaw_rad()
    }
}

/// A pose and how it changes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Position in the local frame (m).
    pub position_m: Vector3<f64>,
    /// Velocity in the local frame (m/s).
    pub velocity_mps: Vector3<f64>,
    /// `local_q_body`.
    pub local_q_body: UnitQuaternion<f64>,
    /// Body rates (rad/s).
    pub rates_radps: Vector3<f64>,
}

impl Estimate {
    /// What `state` estimates; nothing if its position may not be used, or it cannot be one of a flying vehicle.
    pub fn of(state: &VehicleState) -> Option<Self> {
        let within = |v: Vector3<f64>, limit: f64| v.iter().all(|c| c.abs() <= limit);
        let local_q_body = state.attitude.rotation()?;
        let estimate = Self {
            position_m: state.position.vector(),
            velocity_mps: state.velocity.vector(),
            local_q_body,
            rates_radps: state.rates.vector(),
        };
        let is_plausible = state.position_valid.is_set()
            && within(estimate.position_m, MAX_POSITION_M)
            && within(estimate.velocity_mps, MAX_SPEED_MPS)
            && within(estimate.rates_radps, MAX_RATE_RADPS);
        is_plausible.then_some(estimate)
    }

    fn carried_on(&self, since_s: f64) -> Pose {
        let turn = UnitQuaternion::from_scaled_axis(self.rates_radps * since_s);
        Pose {
            position_m: self.position_m + self.velocity_mps * since_s,
            local_q_body: self.local_q_body * turn,
        }
    }

    /// The pose `since_s` after this estimate, `step_s` before `to`.
    fn toward(&self, to: &Self, since_s: f64, step_s: f64) -> Option<Pose> {
        let s = since_s / step_s;
        let rest = 1.0 - s;
        let position_m = self.position_m * ((1.0 + 2.0 * s) * rest * rest)
            + self.velocity_mps * (step_s * s * rest * rest)
            + to.position_m * (s * s * (3.0 - 2.0 * s))
            - to.velocity_mps * (step_s * s * s * rest);
        // Half a turn between two states has no shortest arc: nothing is known of the attitude in between.
        let local_q_body = self.local_q_body.try_slerp(&to.local_q_body, s, 1e-9)?;
        Some(Pose {
            position_m,
            local_q_body,
        })
    }
}

/// How far from what was measured a pose is still given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    /// From the nearest state (s): before it, between two, or after the newest.
    pub state_s: f64,
    /// Longest gap between two states in which anything is said (s).
    pub gap_s: f64,
}

/// The last vehicle states, in order of time. All its memory is taken at the beginning.
#[derive(Clone, Debug)]
pub struct PoseHistory {
    reach: Reach,
    ring: Box<[(Timestamp, Estimate); STATES]>,
    /// States ever pushed since the last clear; the newest lives at `pushed - 1` modulo the size.
    pushed: usize,
}

impl PoseHistory {
    /// Empty.
    pub fn new(reach: Reach) -> Self {
        let nowhere = Estimate {
            position_m: Vector3::zeros(),
            velocity_mps: Vector3::zeros(),
            local_q_body: UnitQuaternion::identity(),
            rates_radps: Vector3::zeros(),
        };
        Self {
            reach,
            ring: Box::new([(Timestamp::NEVER, nowhere); STATES]),
            pushed: 0,
        }
    }

    /// Forgets every state.
    pub fn clear(&mut self) {
        self.pushed = 0;
    }

    /// Time of the newest state; never if there is none.
    pub fn newest(&self) -> Timestamp {
        self.newest_estimate().map_or(Timestamp::NEVER, |(at, _)| at)
    }

    /// The newest state with its time; nothing if there is none.
    pub fn newest_estimate(&self) -> Option<(Timestamp, Estimate)> {
        (self.pushed > 0).then(|| *self.back(0))
    }

    /// Appends what was estimated for `at`; `false`, and nothing changes, if that is not [`Order::Newer`] than the newest.
    pub fn push(&mut self, estimate: Estimate, at: Timestamp) -> bool {
        if Order::judge(at, self.newest()) != Order::Newer {
            return false;
        }
        self.ring[self.pushed % STATES] = (at, estimate);
        self.pushed += 1;
        true
    }

    /// The pose at `at`; nothing if that is before the oldest state, or out of reach.
    pub fn at(&self, at: Timestamp) -> Option<Pose> {
        let kept = self.pushed.min(STATES);
        let before = (0..kept).find(|&age| self.back(age).0 <= at)?;
        let (from_at, from) = self.back(before);
        let since_s = at.seconds_since(*from_at);
        if before == 0 {
            return (since_s <= self.reach.state_s).then(|| from.carried_on(since_s));
        }
        let (to_at, to) = self.back(before - 1);
        let step_s = to_at.seconds_since(*from_at);
        let is_far = since_s > self.reach.state_s && to_at.seconds_since(at) > self.reach.state_s;
        if is_far || step_s > self.reach.gap_s {
            return None;
        }
        from.toward(to, since_s, step_s)
    }

    /// Moves every state by `jump_m` (local).
    pub fn shift(&mut self, jump_m: &Vector3<f64>) {
        self.ring
            .iter_mut()
            .for_each(|(_, state)| state.position_m += jump_m);
    }

    /// The state pushed `age` pushes before the newest.
    fn back(&self, age: usize) -> &(Timestamp, Estimate) {
        &self.ring[(self.pushed + STATES - 1 - age) % STATES]
    }
}

#[cfg(test)]
mod tests {
    use super::{Estimate, Pose, PoseHistory, Reach, STATES};
    use crate::frames::{AngularRate, Attitude};
    use crate::vehicle::VehicleState;
    use crate::{Flag, Point, Timestamp, Velocity};
    use nalgebra::{UnitQuaternion, Vector3};
    use proptest::prelude::*;

    const START_S: f64 = 100.0;
    const REACH: Reach = Reach {
        state_s: 0.1,
        gap_s: f64::INFINITY,
    };

    fn at(t_s: f64) -> Timestamp {
        Timestamp::from_seconds(START_S + t_s)
    }

    fn local(pose: &Pose, body_m: &Vector3<f64>) -> Vector3<f64> {
        pose.local_q_body * body_m + pose.position_m
    }

    fn state(position: Vector3<f64>, velocity: Vector3<f64>, attitude: UnitQuaternion<f64>) -> VehicleState {
        VehicleState {
            position: Point::from_vector(position),
            velocity: Velocity::from_vector(velocity),
            attitude: Attitude::from_rotation(attitude),
            rates: AngularRate::new(0.5, -0.2, 2.0),
            position_valid: Flag::YES,
            ..VehicleState::default()
        }
    }

    /// A circle of 3 m radius at 1.5 rad/s while turning about two axes.
    fn circle(t_s: f64) -> (Vector3<f64>, Vector3<f64>, UnitQuaternion<f64>) {
        let (sin, cos) = (1.5 * t_s).sin_cos();
        let attitude = UnitQuaternion::from_euler_angles(0.3, 0.2, 0.0)
            * UnitQuaternion::from_scaled_axis(Vector3::new(0.5, -0.2, 2.0) * t_s);
        (
            Vector3::new(3.0 * cos, 3.0 * sin, -2.0 + 0.5 * t_s),
            Vector3::new(-4.5 * sin, 4.5 * cos, 0.5),
            attitude,
        )
    }

    fn on_circle(t_s: f64) -> Estimate {
        let (position, velocity, attitude) = circle(t_s);
        Estimate::of(&state(position, velocity, attitude)).unwrap()
    }

    fn history(states: usize) -> PoseHistory {
        let mut history = PoseHistory::new(REACH);
        for i in 0..states {
            let t_s = i as f64 * 0.02;
            assert!(history.push(on_circle(t_s), at(t_s)));
        }
        history
    }

    fn error_m(history: &PoseHistory, t_s: f64, body: Vector3<f64>) -> f64 {
        let (position, _, attitude) = circle(t_s);
        let pose = history.at(at(t_s)).unwrap();
        (local(&pose, &body) - (attitude * body + position)).norm()
    }

    fn vector(size: f64) -> impl Strategy<Value = Vector3<f64>> {
        [-size..size, -size..size, -size..size].prop_map(Vector3::from)
    }

    proptest! {
        #[test]
        fn constant_velocity_and_rates_are_followed_exactly(
            start in vector(1e3), velocity in vector(30.0), rates in vector(6.0), tilt in vector(3.0),
            step_s in 0.01..0.3f64, t_s in 0.0..1.0f64,
        ) {
            let estimate = |t_s: f64| Estimate {
                position_m: start + velocity * t_s,
                velocity_mps: velocity,
                local_q_body: UnitQuaternion::from_scaled_axis(tilt) * UnitQuaternion::from_scaled_axis(rates * t_s),
                rates_radps: rates,
            };
            let mut history = PoseHistory::new(Reach { state_s: 0.15, gap_s: 0.3 });
            let mut last_s = 0.0;
            while last_s < 1.0 && history.push(estimate(last_s), at(last_s)) {
                last_s += step_s;
            }
            // Only the newest states are remembered.
            let newest_s = last_s - step_s;
            let t_s = newest_s - t_s * newest_s.min((STATES - 2) as f64 * step_s);
            // To the nanoseconds of the clock: 1e-9 s are 30 nm.
            let pose = history.at(at(t_s)).unwrap();
            let expected = estimate(t_s);
            prop_assert!((pose.position_m - expected.position_m).norm() < 1e-6, "{pose:?}");
            prop_assert!(pose.local_q_body.angle_to(&expected.local_q_body) < 1e-6, "{pose:?}");
        }

        #[test]
        fn nothing_is_reported_out_of_reach(
            steps_s in proptest::collection::vec(0.001..0.5f64, 1..200), asked_s in -0.5..120.0f64,
            state_s in 0.0..0.3f64, gap_s in 0.0..0.6f64,
        ) {
            let mut history = PoseHistory::new(Reach { state_s, gap_s });
            let mut times = vec![];
            let mut t_s = 0.0;
            for step_s in steps_s {
                t_s += step_s;
                assert!(history.push(on_circle(t_s), at(t_s)));
                times.push(at(t_s));
            }
            let times = &times[times.len().saturating_sub(STATES)..];
            let asked = at(asked_s);
            let after = times.partition_point(|time| *time <= asked);
            let since_s = (after > 0).then(|| asked.seconds_since(times[after - 1]));
            let until_s = times.get(after).map(|time| time.seconds_since(asked));
            let may_say = match (since_s, until_s) {
                (None, _) => false,
                (Some(since_s), None) => since_s <= state_s,
                (Some(since_s), Some(until_s)) => {
                    times[after].seconds_since(times[after - 1]) <= gap_s && since_s.min(until_s) <= state_s
                }
            };
            prop_assert_eq!(history.at(asked).is_some(), may_say);
        }

        #[test]
        fn whatever_is_pushed_poses_are_finite(
            numbers in proptest::collection::vec(prop_oneof![4 => -2.0..2.0f64, 1 => any::<f64>()], 13..=13),
            length in 0.98..1.02f64, asked_s in 0.0..0.1f64,
        ) {
            let three = |first: usize| Vector3::new(numbers[first], numbers[first + 1], numbers[first + 2]);
            let turn = UnitQuaternion::from_scaled_axis(three(6)).into_inner() * length;
            let pushed = VehicleState {
                attitude: Attitude::new(turn.w, turn.i, turn.j, turn.k),
                rates: AngularRate::from_vector(three(9)),
                ..state(three(0), three(3), UnitQuaternion::identity())
            };
            let mut history = history(10);
            if let Some(estimate) = Estimate::of(&pushed) {
                assert!(history.push(estimate, at(0.2)));
            }
            for pose in [history.at(at(asked_s)), history.at(at(0.19)), history.at(at(0.2 + asked_s))].into_iter().flatten() {
                prop_assert!(pose.position_m.iter().chain(pose.local_q_body.coords.iter()).all(|c| c.is_finite()));
            }
        }

        #[test]
        fn between_states_the_pose_follows_the_flown_curve(t_s in 0.0..1.98f64) {
            prop_assert!(error_m(&history(100), t_s, Vector3::new(10.0, 0.0, 0.0)) < 1e-3);
        }

        #[test]
        fn after_the_newest_state_velocity_and_rates_carry_on(late_s in 0.0..0.0999f64) {
            // What is left is the unknown acceleration: v^2 / r = 6.75 m/s2, a t^2 / 2 = 34 mm at 100 ms.
            let error = error_m(&history(50), 0.98 + late_s, Vector3::new(10.0, 0.0, 0.0));
            prop_assert!(error < 3.5 * late_s * late_s + 1e-6, "{error}");
        }

        #[test]
        fn of_two_neighbours_the_one_toward_the_other_is_between_them(
            share in 0.0..1.0f64, tilt in vector(3.0), turn in vector(0.1), way in vector(1.0), flip in any::<bool>(),
        ) {
            let from = Pose { position_m: Vector3::zeros(), local_q_body: UnitQuaternion::from_scaled_axis(tilt) };
            let turned = from.local_q_body * UnitQuaternion::from_scaled_axis(turn);
            let sign = if flip { -1.0 } else { 1.0 };
            let to = Pose { position_m: way, local_q_body: UnitQuaternion::new_unchecked(turned.into_inner() * sign) };
            let between = from.toward(&to, share);
            let expected = from.local_q_body * UnitQuaternion::from_scaled_axis(turn * share);
            prop_assert!((between.position_m - way * share).norm() < 1e-12);
            prop_assert!(between.local_q_body.angle_to(&expected) < 2e-4);
        }
    }

    #[test]
    fn too_old_too_new_and_in_a_long_gap_there_is_no_pose() {
        let mut history = history(10);
        assert!(history.at(at(-0.001)).is_none());
        assert!(history.at(at(0.18 + REACH.state_s + 0.001)).is_none());
        assert!(history.push(on_circle(1.0), at(1.0)));
        assert!(history.at(at(0.25)).is_some());
        assert!(
            history.at(at(0.5)).is_none(),
            "0.32 s from the one, 0.5 s from the other"
        );
        assert!(history.at(at(0.95)).is_some());
    }

    #[test]
    fn the_ring_forgets_the_oldest() {
        let history = history(STATES + 20);
        assert!(history.at(at(19.5 * 0.02)).is_none());
        assert!(history.at(at(20.5 * 0.02)).is_some());
        assert_eq!(history.newest(), at((STATES + 19) as f64 * 0.02));
    }

    #[test]
    fn what_is_not_newer_is_not_taken() {
        let mut history = history(10);
        for late in [Timestamp::NEVER, at(0.18), at(0.1)] {
            assert!(!history.push(on_circle(0.0), late));
        }
        assert_eq!(history.newest(), at(0.18));
    }

    #[test]
    fn what_no_vehicle_does_is_refused() {
        let broken: [fn(&mut VehicleState); 8] = [
            |state| state.position_valid = Flag::NO,
            |state| state.position.y_m = f64::NAN,
            |state| state.position.z_m = 2e6,
            |state| state.velocity.x_mps = f64::NAN,
            |state| state.velocity.y_mps = 1e3,
            |state| state.rates.z_radps = -1e3,
            |state| state.attitude.w = f64::INFINITY,
            |state| state.attitude = Attitude::new(0.0, 0.0, 0.0, 0.0),
        ];
        let (position, velocity, attitude) = circle(0.0);
        for (i, break_it) in broken.iter().enumerate() {
            let mut state = state(position, velocity, attitude);
            break_it(&mut state);
            assert_eq!(Estimate::of(&state), None, "{i}");
        }
    }
}
