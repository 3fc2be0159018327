//! Trajectories that meet something that moves.
//!
//! One is in conflict only where the vehicle is better off if it brakes now: what moves may come too near to a vehicle
//! that stands as well, and who gives way must not be braked for it.

use super::lookahead::LookaheadDemand;
use jink_shared_types::Timestamp;
use jink_shared_types::motion::{MotionState, Trajectory};
use jink_shared_types::moving::MovingObstacle;
use nalgebra::Vector3;

/// How far ahead what moves is predicted (s): the longest stop and the reaction before it.
const MOVING_S: f64 = 2.0;
/// Time between two predictions (s).
const MOVING_STEP_S: f64 = 0.1;
/// By how much a vehicle must be better off braking (m): more than the error of a track.
const BETTER_M: f64 = 0.1;

/// What moves, as of now.
#[derive(Clone, Copy, Debug, Default)]
pub struct MovingNow<'a> {
    /// The obstacles.
    pub obstacles: &'a [MovingObstacle],
    /// Their age (s).
    pub age_s: f64,
}

/// How near something comes (m), and which obstacle.
type Nearest = (f64, usize);

impl MovingNow<'_> {
    /// Horizontal distance from the vehicle's centre at `place` to the surface of each after `ahead_s` (m).
    fn distances(
        &self,
        ahead_s: f64,
        place: Vector3<f64>,
        clearance_m: f64,
    ) -> impl Iterator<Item = Nearest> + '_ {
        (0..).zip(self.obstacles).map(move |(index, obstacle)| {
            let away = place - obstacle.after(self.age_s + ahead_s);
            let is_beside = away.z.abs() <= obstacle.half_height_m + clearance_m;
            let distance_m = if is_beside {
                away.xy().norm() - obstacle.radius_m
            } else {
                f64::INFINITY
            };
            (distance_m, index)
        })
    }

    /// The smallest such distance until [`MOVING_S`], of a vehicle that moves as `place_at` says.
    fn nearest(&self, clearance_m: f64, place_at: impl Fn(f64) -> Vector3<f64>) -> Nearest {
        let steps = (MOVING_S / MOVING_STEP_S) as u32;
        let distances = (0..=steps).flat_map(|step| {
            let ahead_s = f64::from(step) * MOVING_STEP_S;
            self.distances(ahead_s, place_at(ahead_s), clearance_m)
        });
        distances.fold((f64::INFINITY, 0), |nearest, next| {
            if next.0 < nearest.0 { next } else { nearest }
        })
    }

    /// How far away is now (m, horizontally, from the vehicle's centre to its surface) what a vehicle that follows `trajectory` comes
    /// nearer to than `demand` allows, and than it would if it braked now; `None`: nothing.
    pub fn met_m(
        &self,
        now: Timestamp,
        trajectory: &Trajectory,
        start: &MotionState,
        demand: &LookaheadDemand,
    ) -> Option<f64> {
        if self.obstacles.is_empty() {
            return None;
        }
        let last = trajectory.end();
        let (following_m, met) = self.nearest(demand.clearance_m, |ahead_s| {
            let state = trajectory.at(now.plus_seconds(ahead_s).min(last));
            state.unwrap_or(*start).position.vector()
        });
        if following_m >= demand.clearance_m {
            return None;
        }
        let (from, velocity) = (start.position.vector(), start.velocity.vector());
        let (brake, _) = demand
            .braking
            .shortest(velocity.norm(), trajectory.limits.jerk_mps3);
        let stop_s = velocity.norm() / brake.deceleration_mps2;
        let (braking_m, _) = self.nearest(demand.clearance_m, |ahead_s| {
            let braked_s = (ahead_s - demand.delay_s).clamp(0.0, stop_s);
            let moved_s = ahead_s.min(demand.delay_s) + braked_s * (1.0 - 0.5 * braked_s / stop_s.max(1e-9));
            from + velocity * moved_s
        });
        // Whatever its height is now, it is there.
        let (distance_m, _) = self.distances(0.0, from, f64::INFINITY).nth(met)?;
        (following_m + BETTER_M < braking_m).then(|| distance_m.max(0.0))
    }
}
