//! The judge of commitments: everything that is approved is laid into the true world, with nothing of the planner's but the
//! curve, and must not touch it.

use crate::lockstep::LockStep;
use jink_shared_types::motion::{TrajectoryMode, Verdict};
use jink_shared_types::{Point, Timestamp};
use jink_simulated_world::world::World;
use nalgebra::Vector3;

/// Along a curve every so many seconds: 8 cm at 8 m/s.
const EVERY_S: f64 = 0.01;
/// What a curve may lack of its room (m): the steps between two looks, and the noise of the estimate.
const TOLERANCE_M: f64 = 0.05;

/// What was seen of a flight's commitments.
#[derive(Clone, Debug, Default)]
pub struct Judge {
    last: u64,
    /// Commitments that were looked at.
    pub commitments: u32,
    /// Those along which the hull would touch something that stands still.
    pub touching: u32,
    /// Smallest distance between the hull on a committed curve and what stands still (m); infinity before the first.
    pub least_m: f64,
    /// The reference's acceleration at the last look (m/s2).
    last_acceleration: Option<(Timestamp, Vector3<f64>)>,
    jerk_sum_mps3: f64,
    jerks: u32,
}

impl Judge {
    /// Nothing seen yet.
    pub fn new() -> Self {
        Self {
            least_m: f64::INFINITY,
            ..Self::default()
        }
    }

    /// After a step: a new commitment is laid into `world`, where nothing moves.
    pub fn look(&mut self, flight: &LockStep, world: &World) {
        self.feel_jerk(flight);
        let approved = flight.approved();
        let trajectory = &approved.trajectory;
        let is_certified = matches!(approved.verdict.get(), Verdict::Passed)
            && matches!(trajectory.mode.get(), TrajectoryMode::Plan | TrajectoryMode::Stop);
        if !is_certified || trajectory.id == self.last {
            return;
        }
        self.last = trajectory.id;
        self.commitments += 1;
        // The curve is where the vehicle believes that it is; the world is where it is.
        let autopilot = flight.autopilot();
        let shift = autopilot.truth().position.vector() - autopilot.estimate().position.vector();
        let hull_m = flight.truth().hull_radius_m;
        let now = flight.now();
        let left_s = trajectory.end().seconds_since(now).max(0.0);
        let looks = (left_s / EVERY_S).ceil() as u32;
        let states =
            (0..=looks).filter_map(|look| trajectory.at(now.plus_seconds(EVERY_S * f64::from(look))));
        let least_m = states
            .map(|state| {
                let place = Point::from_vector(state.position.vector() + shift);
                world.clearance_to_obstacles_m(place) - hull_m
            })
            .fold(f64::INFINITY, f64::min);
        self.least_m = self.least_m.min(least_m);
        self.touching += u32::from(least_m < -TOLERANCE_M);
    }

    /// Mean jerk of what was flown (m/s3); zero if nothing was.
    pub fn mean_jerk_mps3(&self) -> f64 {
        self.jerk_sum_mps3 / f64::from(self.jerks.max(1))
    }

    fn feel_jerk(&mut self, flight: &LockStep) {
        let Some(reference) = flight.reference() else {
            self.last_acceleration = None;
            return;
        };
        let (now, acceleration) = (flight.now(), reference.acceleration.vector());
        let Some((before, last)) = self.last_acceleration else {
            self.last_acceleration = Some((now, acceleration));
            return;
        };
        let passed_s = now.seconds_since(before);
        if passed_s >= EVERY_S {
            self.jerk_sum_mps3 += (acceleration - last).norm() / passed_s;
            self.jerks += 1;
            self.last_acceleration = Some((now, acceleration));
        }
    }
}
