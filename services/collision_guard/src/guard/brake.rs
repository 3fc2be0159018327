//! The guard's own brake: from a moving state to rest, straight ahead, as hard as allowed.
//!
//! Three phases of constant jerk: the acceleration is changed to full braking against the direction of motion, held,
//! and changed to zero as the speed vanishes. Each phase is a cubic, which a quintic between its ends reproduces
//! exactly. From a steady speed `v` the stopping distance is `v a / 2j + v^2 / 2a`, which
//! [`jink_shared_types::motion::stopping_distance_m`] assumes.
//!
//! With an acceleration `a0` at the start (a curve, say) the first phase also has to remove that. During a phase of
//! duration `t1` that changes the acceleration linearly from `a0` to `a1` the velocity becomes `v0 + a0 t1 / 2 + a1 t1
//! / 2`. It is parallel to `a1`, and the rest of the brake straight, if `a1` points against `v0 + a0 t1 / 2`; `t1`
//! itself follows from `a1` and the jerk, so both are found by iteration.

use jink_shared_types::bezier::{End, derivative, quintic_between, split_scalar};
use jink_shared_types::motion::{
    BezierPiece, MotionLimits, MotionState, Trajectory, TrajectoryMode, stopping_distance_m,
};
use jink_shared_types::tracking::Tracking;
use jink_shared_types::{Coded, Flag, Timestamp};
use nalgebra::Vector3;

/// The brake begins this long after now (s): one period of a setpoint stream of 20 Hz, so that a reader that is at most
/// one period late is still on the common part. A longer lead costs stopping distance.
pub const LEAD_S: f64 = 0.05;
/// Phases shorter than this (s) are left out: their derivatives would be noise.
const SHORTEST_S: f64 = 2e-3;
/// Halvings of the interval in which the deceleration is sought: a billionth of it remains.
const BISECTIONS: u32 = 30;

/// The limits of a brake.
#[derive(Clone, Copy, Debug)]
pub struct BrakeLimits {
    /// Deceleration (m/s2).
    pub deceleration_mps2: f64,
    /// Jerk (m/s3).
    pub jerk_mps3: f64,
}

/// How hard the vehicle can brake.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Braking {
    /// Deceleration that is counted on in any case (m/s2), and the most that is allowed (m/s2).
    pub range_mps2: (f64, f64),
    /// How the autopilot follows; `None` as long as that is not known.
    pub tracking: Option<Tracking>,
}

impl Braking {
    /// The shortest brake from `speed_mps` out of a motion with the jerk `jerk_mps3`: how hard, and how far past its end the
    /// vehicle runs for braking harder than is counted on in any case (m).
    pub fn shortest(&self, speed_mps: f64, jerk_mps3: f64) -> (BrakeLimits, f64) {
        let (least_mps2, most_mps2) = self.range_mps2;
        let Some(tracking) = self.tracking else {
            let limits = BrakeLimits {
                deceleration_mps2: least_mps2,
                jerk_mps3,
            };
            return (limits, 0.0);
        };
        let (hardest_mps2, jerk_mps3) = tracking.shortest_stop(speed_mps, (least_mps2, jerk_mps3));
        let deceleration_mps2 = hardest_mps2.min(most_mps2);
        let limits = BrakeLimits {
            deceleration_mps2,
            jerk_mps3,
        };
        (
            limits,
            tracking.overshoot_m((deceleration_mps2 - least_mps2).max(0.0)),
        )
    }

    /// The distance (m) of that brake, with a reaction time of `delay_s` (s) before it.
    pub fn distance_m(&self, speed_mps: f64, delay_s: f64, jerk_mps3: f64) -> f64 {
        let (limits, overshoot_m) = self.shortest(speed_mps, jerk_mps3);
        overshoot_m + stopping_distance_m(speed_mps, delay_s, limits.deceleration_mps2, limits.jerk_mps3)
    }
}

/// Makes `out` the brake of `active`: the same until `now` plus [`LEAD_S`], then to rest.
pub fn brake(active: &Trajectory, now: Timestamp, braking: &Braking, id: u64, out: &mut Trajectory) {
    let mut begin = now.plus_seconds(LEAD_S);
    let room = jink_shared_types::motion::TRAJECTORY_PIECES - PHASES;
    let fits = out.take_prefix(active, now, begin) && out.pieces().len() <= room;
    if !fits || out.len == 0 {
        // Nothing to repeat (at rest, or not started yet), or pieces too small to keep: brake from now.
        out.len = 0;
        out.start = now;
        begin = now;
    }
    let (start, yaw_rad) = match out.pieces().last() {
        Some(last) => (last.at(last.duration_s), last.yaw_rad[last.yaw_rad.len() - 1]),
        None => {
            let state = active.at(begin).unwrap_or_default();
            (state, state.yaw_rad)
        }
    };
    let speed_mps = start.velocity.vector().norm();
    let (shortest, _) = braking.shortest(speed_mps, active.limits.jerk_mps3);
    let brake_limits = BrakeLimits {
        deceleration_mps2: shortest.deceleration_mps2.max(present_deceleration_mps2(&start)),
        ..shortest
    };
    let legs = BrakePhases::new(&start, brake_limits);
    legs.append(&start, yaw_rad, out);
    out.id = id;
    out.base_id = active.id;
    out.route_id = active.route_id;
    out.splice = begin;
    out.limits = active.limits;
    out.limits.acceleration_mps2 = active
        .limits
        .acceleration_mps2
        .max(brake_limits.deceleration_mps2)
        .max(start.acceleration.vector().norm());
    out.limits.jerk_mps3 = active.limits.jerk_mps3.max(brake_limits.jerk_mps3);
    out.mode = Coded::new(TrajectoryMode::Brake);
    out.reaches_goal = Flag::NO;
}

/// A motion that brakes harder already must not brake less.
fn present_deceleration_mps2(state: &MotionState) -> f64 {
    let velocity = state.velocity.vector();
    let speed_mps = velocity.norm();
    if speed_mps > 1e-6 {
        -state.acceleration.vector().dot(&velocity) / speed_mps
    } else {
        0.0
    }
}

/// Most phases of a brake.
const PHASES: usize = 3;

/// The phases of a brake: where each ends, and how long it takes.
struct BrakePhases {
    ends: [End; PHASES],
    durations_s: [f64; PHASES],
    len: usize,
}

impl BrakePhases {
    fn new(start: &MotionState, brake_limits: BrakeLimits) -> Self {
        Self::three_phases(&start.end(), brake_limits)
            .unwrap_or_else(|| Self::one_quintic(&start.end(), brake_limits))
    }

    /// `None` if the speed is too small for the phases to have a direction.
    fn three_phases(start: &End, brake_limits: BrakeLimits) -> Option<Self> {
        let BrakeLimits {
            deceleration_mps2,
            jerk_mps3,
        } = brake_limits;
        let mut lead_in = LeadIn::to(start, deceleration_mps2, jerk_mps3)?;
        if lead_in.spare_mps < 0.0 {
            let (mut low, mut high) = (0.0, deceleration_mps2);
            for _ in 0..BISECTIONS {
                let middle = 0.5 * (low + high);
                match LeadIn::to(start, middle, jerk_mps3) {
                    Some(tried) if tried.spare_mps >= 0.0 => {
                        low = middle;
                        lead_in = tried;
                    }
                    _ => high = middle,
                }
            }
        }
        if lead_in.spare_mps < 0.0 || lead_in.deceleration.norm() < 1e-3 {
            return None;
        }
        let full = lead_in.deceleration.norm();
        let mut legs = Self {
            ends: [*start; PHASES],
            durations_s: [0.0; PHASES],
            len: 0,
        };
        let mut at = *start;
        for (duration_s, acceleration) in [
            (lead_in.duration_s, lead_in.deceleration),
            (lead_in.spare_mps / full, lead_in.deceleration),
            (full / jerk_mps3, Vector3::zeros()),
        ] {
            if duration_s > SHORTEST_S {
                at = after(&at, &acceleration, duration_s);
                legs.push(at, duration_s);
            }
        }
        legs.end_at_rest();
        legs.keep(start, brake_limits).then_some(legs)
    }

    /// One quintic, for speeds too small for phases: as long as it takes to stay within the limits.
    fn one_quintic(start: &End, brake_limits: BrakeLimits) -> Self {
        /// Doubled at most this often; from the shortest that is an hour, more than any state within the limits takes.
        const LENGTHENINGS: u32 = 60;
        let mut duration_s = 0.1;
        let mut legs = Self::quintic_of(start, duration_s);
        for _ in 0..LENGTHENINGS {
            if legs.keep(start, brake_limits) {
                break;
            }
            duration_s *= 1.2;
            legs = Self::quintic_of(start, duration_s);
        }
        legs
    }

    fn quintic_of(start: &End, duration_s: f64) -> Self {
        // The end that a quintic reaches with the least jerk: half of speed times duration, and what its acceleration
        // adds.
        let end = End {
            position: start.position
                + start.velocity * (0.5 * duration_s)
                + start.acceleration * (duration_s * duration_s / 12.0),
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
        };
        let mut legs = Self {
            ends: [end; PHASES],
            durations_s: [0.0; PHASES],
            len: 0,
        };
        legs.push(end, duration_s);
        legs
    }

    fn push(&mut self, end: End, duration_s: f64) {
        if let (Some(slot), Some(duration)) =
            (self.ends.get_mut(self.len), self.durations_s.get_mut(self.len))
        {
            *slot = end;
            *duration = duration_s;
            self.len += 1;
        }
    }

    /// Speed and acceleration that rounding and omitted phases leave are set to zero.
    fn end_at_rest(&mut self) {
        if let Some(last) = self.len.checked_sub(1).and_then(|index| self.ends.get_mut(index)) {
            last.velocity = Vector3::zeros();
            last.acceleration = Vector3::zeros();
        }
    }

    fn legs(&self) -> impl Iterator<Item = (&End, f64)> {
        self.ends.iter().zip(self.durations_s).take(self.len)
    }

    /// Whether no phase brakes harder than allowed, or than it starts with.
    fn keep(&self, start: &End, brake_limits: BrakeLimits) -> bool {
        let most_mps2 = MotionLimits::allowed(brake_limits.deceleration_mps2.max(start.acceleration.norm()));
        let most_mps3 = MotionLimits::allowed(brake_limits.jerk_mps3);
        let mut from = *start;
        self.len > 0
            && self.legs().all(|(end, duration_s)| {
                let points = quintic_between(&from, end, duration_s);
                from = *end;
                let velocity: [_; 5] = derivative(&points, duration_s);
                let acceleration: [_; 4] = derivative(&velocity, duration_s);
                let jerk: [_; 3] = derivative(&acceleration, duration_s);
                acceleration.iter().all(|a| a.norm() <= most_mps2)
                    && jerk.iter().all(|j| j.norm() <= most_mps3)
            })
    }

    /// Appends the phases to `out`. The yaw rate decays as the speed does.
    fn append(&self, start: &MotionState, yaw_rad: f64, out: &mut Trajectory) {
        let total_s: f64 = self.legs().map(|(_, duration_s)| duration_s).sum();
        let turn = |yaw_rad: f64, rate_radps: f64| End {
            position: Vector3::new(yaw_rad, 0.0, 0.0),
            velocity: Vector3::new(rate_radps, 0.0, 0.0),
            acceleration: Vector3::zeros(),
        };
        let yaw_end_rad = yaw_rad + 0.5 * start.yaw_rate_radps * total_s;
        let mut yaw = quintic_between(
            &turn(yaw_rad, start.yaw_rate_radps),
            &turn(yaw_end_rad, 0.0),
            total_s,
        )
        .map(|p| p.x);
        let mut left_s = total_s;
        let mut from = start.end();
        for (end, duration_s) in self.legs() {
            let (before, after) = split_scalar(&yaw, (duration_s / left_s).min(1.0));
            let points = quintic_between(&from, end, duration_s);
            if !out.push(BezierPiece::new(&points, before, duration_s)) {
                return;
            }
            yaw = after;
            left_s -= duration_s;
            from = *end;
        }
    }
}

/// The first phase of a brake.
struct LeadIn {
    /// Acceleration at its end.
    deceleration: Vector3<f64>,
    duration_s: f64,
    /// Speed left for the second phase; negative if the third one would need more than there is.
    spare_mps: f64,
}

impl LeadIn {
    /// To a deceleration of `full_mps2`. `None` if no direction can be found.
    fn to(start: &End, full_mps2: f64, jerk_mps3: f64) -> Option<Self> {
        /// The iteration contracts by `a a0 / (2 j v)` per round; where that is not well below one the speed is so
        /// small that the caller uses one quintic.
        const ROUNDS: usize = 24;
        let mut duration_s = 0.0;
        let mut deceleration = Vector3::zeros();
        for _ in 0..ROUNDS {
            let toward = (start.velocity + start.acceleration * (0.5 * duration_s)).try_normalize(1e-6)?;
            deceleration = -toward * full_mps2;
            duration_s = (deceleration - start.acceleration).norm() / jerk_mps3;
        }
        let carried_mps = (start.velocity + start.acceleration * (0.5 * duration_s)).norm();
        Some(Self {
            deceleration,
            duration_s,
            spare_mps: carried_mps - 0.5 * full_mps2 * duration_s - 0.5 * full_mps2 * full_mps2 / jerk_mps3,
        })
    }
}

/// The state after a phase of constant jerk that leads the acceleration to `acceleration`.
fn after(start: &End, acceleration: &Vector3<f64>, t_s: f64) -> End {
    let change = acceleration - start.acceleration;
    End {
        position: start.position
            + start.velocity * t_s
            + start.acceleration * (0.5 * t_s * t_s)
            + change * (t_s * t_s / 6.0),
        velocity: start.velocity + (start.acceleration + change * 0.5) * t_s,
        acceleration: *acceleration,
    }
}
