//! Where the vehicle was when a ray was measured.
//!
//! | in | out |
//! |---|---|
//! | vehicle states with their times of validity | the pose at any moment no further than [`MAX_GAP_S`] from a state, or nothing |
//!
//! Between two states the position follows the cubic Hermite polynomial through both positions and velocities
//! (error of fourth order in the interval: below 1 mm at 50 Hz even at 30 m/s2 of changing acceleration) and the
//! attitude the great arc between both (Shoemake, "Animating rotation with quaternion curves", 1985). After the
//! newest state the velocity and the body rates are carried on.

use crate::rebase::Estimate;
use jink_shared_types::Timestamp;
use jink_shared_types::vehicle::VehicleState;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// States kept: 2.5 s at 50 Hz, several times the oldest range sample that can still arrive.
const STATES: usize = 128;

/// Furthest moment from a measured state for which a pose is given (s): the deadline of the vehicle state. At 3 m/s2
/// of unknown acceleration 100 ms cost 15 mm, 200 ms would cost 60 mm, over half of what `OA_MAP_ERR` allows.
pub(crate) const MAX_GAP_S: f64 = 0.1;

/// A step back in time by more than this (s) means that the newest state had a wrong time, not that this one is late:
/// late samples are bounded by the topic's buffer (16 states, 0.32 s).
pub(crate) const CLOCK_STEP_S: f64 = 1.0;

/// Largest coordinate taken for a position (m): a local plane is meaningless long before.
const MAX_POSITION_M: f64 = 1e6;
/// Largest speed component taken for one of a multicopter (m/s).
const MAX_SPEED_MPS: f64 = 200.0;
/// Largest body rate taken for one of a multicopter (rad/s): rate gyros saturate at 2000 deg/s = 35 rad/s.
const MAX_RATE_RADPS: f64 = 50.0;

/// `local_T_body`: takes body coordinates to local ones.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pose {
    /// `local_R_body`.
    pub rotation: Matrix3<f64>,
    /// Position of the body's origin in the local frame (m).
    pub position_m: Vector3<f64>,
}

impl Pose {
    /// The angle between this attitude and that of `other` (rad).
    pub fn turned_rad(&self, other: &Pose) -> f64 {
        let cosine = 0.5 * (self.rotation.component_mul(&other.rotation).sum() - 1.0);
        cosine.clamp(-1.0, 1.0).acos()
    }

    /// The pose at `fraction` (0..1) of the way to `to`, component by component. Only for neighbours: between poses
    /// `a` radians apart the matrix is short of a rotation by `a^2 / 8`.
    fn blend(&self, to: &Pose, fraction: f64) -> Pose {
        Pose {
            rotation: self.rotation + (to.rotation - self.rotation) * fraction,
            position_m: self.position_m + (to.position_m - self.position_m) * fraction,
        }
    }
}

#[derive(Clone, Copy)]
struct StateSample {
    at: Timestamp,
    position_m: Vector3<f64>,
    velocity_mps: Vector3<f64>,
    local_q_body: UnitQuaternion<f64>,
    rates_radps: Vector3<f64>,
}

/// How the time of a sample compares with the newest one known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Order {
    /// Later: take it.
    Newer,
    /// Not later: a repetition or a straggler.
    Late,
    /// Earlier by so much that the newest one's time was wrong.
    ClockStep,
}

impl Order {
    /// Judges `at` against `newest`; an unset time is always late, anything set is newer than an unset newest.
    pub fn judge(at: Timestamp, newest: Timestamp) -> Self {
        if !at.is_set() {
            Order::Late
        } else if at > newest {
            Order::Newer
        } else if newest.seconds_since(at) > CLOCK_STEP_S {
            Order::ClockStep
        } else {
            Order::Late
        }
    }
}

/// The last [`STATES`] vehicle states, in order of time.
pub(crate) struct PoseHistory {
    ring: Box<[StateSample; STATES]>,
    /// States ever pushed since the last clear; the newest lives at `pushed - 1` modulo the size.
    pushed: usize,
}

impl PoseHistory {
    pub fn new() -> Self {
        let empty = StateSample {
            at: Timestamp::NEVER,
            position_m: Vector3::zeros(),
            velocity_mps: Vector3::zeros(),
            local_q_body: UnitQuaternion::identity(),
            rates_radps: Vector3::zeros(),
        };
        Self {
            ring: Box::new([empty; STATES]),
            pushed: 0,
        }
    }

    /// Forgets every state.
    pub fn clear(&mut self) {
        self.pushed = 0;
    }

    /// Time of the newest state; never if there is none.
    pub fn newest(&self) -> Timestamp {
        if self.pushed == 0 {
            Timestamp::NEVER
        } else {
            self.back(0).at
        }
    }

    /// Appends a state that is [`Order::Newer`]; `false` if it cannot be one of a flying vehicle.
    pub fn push(&mut self, state: &VehicleState, at: Timestamp) -> bool {
        let Some(local_q_body) = state.attitude.rotation().filter(|_| is_plausible(state)) else {
            return false;
        };
        self.ring[self.pushed % STATES] = StateSample {
            at,
            position_m: state.position.vector(),
            velocity_mps: state.velocity.vector(),
            local_q_body,
            rates_radps: state.rates.vector(),
        };
        self.pushed += 1;
        true
    }

    /// The pose at `at`; nothing if that is before the oldest state or further than [`MAX_GAP_S`] from any.
    pub fn at(&self, at: Timestamp) -> Option<Pose> {
        let kept = self.pushed.min(STATES);
        let before = (0..kept).find(|&age| self.back(age).at <= at)?;
        let from = self.back(before);
        let since_s = at.seconds_since(from.at);
        if before == 0 {
            return (since_s <= MAX_GAP_S).then(|| carried_on(from, since_s));
        }
        let to = self.back(before - 1);
        if since_s > MAX_GAP_S && to.at.seconds_since(at) > MAX_GAP_S {
            return None;
        }
        between(from, to, since_s)
    }

    /// The newest state and its time; nothing if there is none.
    pub fn newest_estimate(&self) -> Option<(Estimate, Timestamp)> {
        (self.pushed > 0).then(|| {
            let newest = self.back(0);
            let estimate = Estimate {
                position_m: newest.position_m,
                velocity_mps: newest.velocity_mps,
                local_q_body: newest.local_q_body,
                rates_radps: newest.rates_radps,
            };
            (estimate, newest.at)
        })
    }

    /// Moves every state by `jump_m` (local).
    pub fn shift(&mut self, jump_m: &Vector3<f64>) {
        self.ring.iter_mut().for_each(|state| state.position_m += jump_m);
    }

    /// The state pushed `age` pushes before the newest.
    fn back(&self, age: usize) -> &StateSample {
        &self.ring[(self.pushed + STATES - 1 - age) % STATES]
    }
}

/// What `state` estimates; nothing if it cannot be one of a flying vehicle.
pub(crate) fn estimate_of(state: &VehicleState) -> Option<Estimate> {
    let local_q_body = state.attitude.rotation().filter(|_| is_plausible(state))?;
    Some(Estimate {
        position_m: state.position.vector(),
        velocity_mps: state.velocity.vector(),
        local_q_body,
        rates_radps: state.rates.vector(),
    })
}

fn is_plausible(state: &VehicleState) -> bool {
    let within = |v: Vector3<f64>, limit: f64| v.iter().all(|c| c.abs() <= limit);
    state.position_valid.is_set()
        && within(state.position.vector(), MAX_POSITION_M)
        && within(state.velocity.vector(), MAX_SPEED_MPS)
        && within(state.rates.vector(), MAX_RATE_RADPS)
}

fn carried_on(from: &StateSample, since_s: f64) -> Pose {
    let turn = UnitQuaternion::from_scaled_axis(from.rates_radps * since_s);
    Pose {
        rotation: (from.local_q_body * turn).to_rotation_matrix().into_inner(),
        position_m: from.position_m + from.velocity_mps * since_s,
    }
}

fn between(from: &StateSample, to: &StateSample, since_s: f64) -> Option<Pose> {
    let step_s = to.at.seconds_since(from.at);
    let s = since_s / step_s;
    let rest = 1.0 - s;
    let position_m = from.position_m * ((1.0 + 2.0 * s) * rest * rest)
        + from.velocity_mps * (step_s * s * rest * rest)
        + to.position_m * (s * s * (3.0 - 2.0 * s))
        - to.velocity_mps * (step_s * s * s * rest);
    // Half a turn between two states has no shortest arc: nothing is known of the attitude in between.
    let rotation = from.local_q_body.try_slerp(&to.local_q_body, s, 1e-9)?;
    Some(Pose {
        rotation: rotation.to_rotation_matrix().into_inner(),
        position_m,
    })
}

/// log2 of the units of 10 us between two knots: a knot every 1.28 ms. In that time 10 rad/s turn by 13 mrad, which
/// puts a blended point at 60 m off by 1.2 mm, and 20 m/s2 bend a path by 4 um.
const KNOT_SHIFT: u32 = 7;
const UNITS_PER_KNOT: u16 = 1 << KNOT_SHIFT;
const NS_PER_UNIT: u64 = 10_000;
/// Every offset a point can have lies before the last knot.
const KNOTS: usize = (1 << (16 - KNOT_SHIFT)) + 1;

#[derive(Clone, Copy)]
enum Knot {
    NotAsked,
    Refused,
    Known(Pose),
}

/// The poses during one sweep, by offset from its first point: full interpolation at knots, made when first asked
/// for, and a blend between neighbours, so that a hundred thousand points cost a hundred interpolations.
pub(crate) struct SweepPoses {
    first: Timestamp,
    knots: Box<[Knot; KNOTS]>,
}

impl SweepPoses {
    pub fn new() -> Self {
        Self {
            first: Timestamp::NEVER,
            knots: Box::new([Knot::NotAsked; KNOTS]),
        }
    }

    /// Starts a sweep whose first point was measured at `first`.
    pub fn begin(&mut self, first: Timestamp) {
        self.first = first;
        self.knots.fill(Knot::NotAsked);
    }

    /// The pose `offset_10us` after the first point, if `history` knows it.
    pub fn at(&mut self, offset_10us: u16, history: &PoseHistory) -> Option<Pose> {
        let index = usize::from(offset_10us >> KNOT_SHIFT);
        let rest = offset_10us & (UNITS_PER_KNOT - 1);
        let from = self.knot(index, history)?;
        if rest == 0 {
            return Some(from);
        }
        let to = self.knot(index + 1, history)?;
        Some(from.blend(&to, f64::from(rest) / f64::from(UNITS_PER_KNOT)))
    }

    fn knot(&mut self, index: usize, history: &PoseHistory) -> Option<Pose> {
        if let Knot::NotAsked = self.knots[index] {
            let after_ns = index as u64 * u64::from(UNITS_PER_KNOT) * NS_PER_UNIT;
            let at = Timestamp::from_ns(self.first.ns.saturating_add(after_ns));
            self.knots[index] = history.at(at).map_or(Knot::Refused, Knot::Known);
        }
        match self.knots[index] {
            Knot::Known(pose) => Some(pose),
            Knot::Refused | Knot::NotAsked => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{MAX_GAP_S, Order, Pose, PoseHistory, STATES, SweepPoses};
    use jink_shared_types::frames::{AngularRate, Attitude, Point, Velocity};
    use jink_shared_types::vehicle::VehicleState;
    use jink_shared_types::{Flag, Timestamp};
    use nalgebra::{UnitQuaternion, Vector3};
    use proptest::prelude::*;

    const START_S: f64 = 100.0;

    fn local(pose: &Pose, body_m: &Vector3<f64>) -> Vector3<f64> {
        pose.rotation * body_m + pose.position_m
    }

    /// A circle of 3 m radius at 1.5 rad/s while turning about two axes.
    fn truth(t_s: f64) -> (Vector3<f64>, Vector3<f64>, UnitQuaternion<f64>) {
        let (sin, cos) = (1.5 * t_s).sin_cos();
        let attitude = UnitQuaternion::from_euler_angles(0.3, 0.2, 0.0)
            * UnitQuaternion::from_scaled_axis(Vector3::new(0.5, -0.2, 2.0) * t_s);
        (
            Vector3::new(3.0 * cos, 3.0 * sin, -2.0 + 0.5 * t_s),
            Vector3::new(-4.5 * sin, 4.5 * cos, 0.5),
            attitude,
        )
    }

    fn state(t_s: f64) -> VehicleState {
        let (position, velocity, attitude) = truth(t_s);
        VehicleState {
            position: Point::from_vector(position),
            velocity: Velocity::from_vector(velocity),
            attitude: Attitude::from_rotation(attitude),
            rates: AngularRate::new(0.5, -0.2, 2.0),
            position_valid: Flag::YES,
            ..VehicleState::default()
        }
    }

    fn at(t_s: f64) -> Timestamp {
        Timestamp::from_seconds(START_S + t_s)
    }

    fn history(states: usize) -> PoseHistory {
        let mut history = PoseHistory::new();
        for i in 0..states {
            let t_s = i as f64 * 0.02;
            assert!(history.push(&state(t_s), at(t_s)));
        }
        history
    }

    fn error_m(history: &PoseHistory, t_s: f64, body: Vector3<f64>) -> f64 {
        let (position, _, attitude) = truth(t_s);
        let pose = history.at(at(t_s)).unwrap();
        (local(&pose, &body) - (attitude * body + position)).norm()
    }

    proptest! {
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
        fn a_sweep_agrees_with_the_history(offset in 0u16..60_000) {
            let history = history(100);
            let mut sweep = SweepPoses::new();
            sweep.begin(at(0.5));
            let body = Vector3::new(8.0, -3.0, 1.0);
            let exact = history.at(at(0.5 + f64::from(offset) * 1e-5)).unwrap();
            let swept = sweep.at(offset, &history).unwrap();
            prop_assert!((local(&exact, &body) - local(&swept, &body)).norm() < 2e-4);
        }
    }

    #[test]
    fn too_old_too_new_and_in_a_long_gap_there_is_no_pose() {
        let mut history = history(10);
        assert!(history.at(at(-0.001)).is_none());
        assert!(history.at(at(0.18 + MAX_GAP_S + 0.001)).is_none());
        assert!(history.push(&state(1.0), at(1.0)));
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
    fn a_sweep_that_leaves_the_history_refuses_only_what_lies_outside() {
        let history = history(10);
        let mut sweep = SweepPoses::new();
        sweep.begin(at(0.1));
        assert!(sweep.at(10_000, &history).is_some());
        assert!(sweep.at(25_000, &history).is_none());
        assert!(sweep.at(10_000, &history).is_some());
    }

    #[test]
    fn stragglers_differ_from_a_clock_that_was_wrong() {
        assert_eq!(Order::judge(at(0.1), at(0.0)), Order::Newer);
        assert_eq!(Order::judge(at(0.1), Timestamp::NEVER), Order::Newer);
        assert_eq!(Order::judge(at(0.0), at(0.0)), Order::Late);
        assert_eq!(Order::judge(at(0.0), at(0.9)), Order::Late);
        assert_eq!(Order::judge(at(0.0), at(1.1)), Order::ClockStep);
        assert_eq!(Order::judge(Timestamp::NEVER, at(1.1)), Order::Late);
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
        let mut history = PoseHistory::new();
        for (i, break_it) in broken.iter().enumerate() {
            let mut state = state(0.0);
            break_it(&mut state);
            assert!(!history.push(&state, at(0.0)), "{i}");
        }
        assert!(!history.newest().is_set());
        assert!(history.push(&state(0.0), at(0.0)));
    }
}
