//! How what is committed is left for a stop: because the vehicle is to rest before it could come to its goal, or because something
//! stands on the way (rule I3).

use super::{Departure, MOVING_MPS, Planner};
use crate::gears::{GEARS, LAST_GEAR};
use crate::stops;
use jink_shared_types::events;
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::motion::{BezierPiece, MotionLimits, Route, RouteMode, Trajectory, TrajectoryMode};
use jink_shared_types::vehicle::DesiredPath;
use jink_shared_types::{Coded, Flag, Timestamp};

/// A certificate that is lost again within this time (s) is not told again.
const LOST_AGAIN_S: f64 = 10.0;
/// Length of a smooth stop over v^2 / a: it lasts 1.5 v / a for a greatest deceleration a, at half the speed on average.
const STOP_SHAPE: f64 = 0.75;

impl Planner {
    /// Whether the vehicle is to rest, and at a place that it would pass: then it stops where it can, and comes back from there.
    pub(super) fn stops_first(
        &self,
        departure: &Departure,
        desired: &DesiredPath,
        goal: &Point<LocalNed>,
    ) -> bool {
        let velocity = departure.state.velocity.vector();
        let speed_mps = velocity.norm();
        if !desired.is_to_rest() || speed_mps <= MOVING_MPS {
            return false;
        }
        let ahead_m = (goal.vector() - departure.state.position.vector()).dot(&velocity) / speed_mps;
        ahead_m < STOP_SHAPE * speed_mps * speed_mps / self.limits[0].acceleration_mps2
    }

    /// The certified stop, if there is one; else what is committed runs to its own.
    pub(super) fn stop_certified(&mut self, departure: &Departure, route: &mut Route) {
        let stop = (0..GEARS).find_map(|gear| {
            self.space.prepare(gear);
            stops::brisk(&self.space, gear, &departure.state).map(|stop| (gear, stop))
        });
        if let Some((gear, stop)) = stop {
            self.write_stop(departure, self.limits[gear], stop, route);
        }
    }

    /// I3: a certified stop if there is one, else the hardest braking allowed, and say so. At rest there is nothing to brake.
    pub(super) fn leave(&mut self, now: Timestamp, departure: &Departure, route: &mut Route) {
        if departure.is_at_rest() {
            return;
        }
        let gear = (0..GEARS).find_map(|gear| {
            self.space.prepare(gear);
            stops::certified(&self.space, gear, &departure.state).map(|stop| (gear, stop))
        });
        let (limits, stop) = match gear {
            Some((gear, stop)) => (self.limits[gear], stop),
            None => {
                if !self.lost_told.is_set() || now.seconds_since(self.lost_told) > LOST_AGAIN_S {
                    self.tell(&events::CERTIFICATE_LOST);
                }
                self.lost_told = now;
                (
                    self.limits[LAST_GEAR],
                    stops::stop(&departure.state, stops::HARDEST_MPS2, 0.0),
                )
            }
        };
        self.write_stop(departure, limits, stop, route);
        route.must_leave = Flag::YES;
    }

    fn write_stop(
        &mut self,
        departure: &Departure,
        limits: MotionLimits,
        stop: BezierPiece,
        route: &mut Route,
    ) {
        self.proposals.leave();
        route.base_id = departure.base_id;
        route.splice = departure.splice;
        route.start = departure.state;
        route.limits = limits;
        route.stop = stop;
        route.has_stop = Flag::YES;
        route.target = stop.at(stop.duration_s).position;
        route.mode = Coded::new(RouteMode::Stop);
    }
}

/// Whether it only brings the vehicle to rest.
pub(super) fn is_stop(trajectory: &Trajectory) -> bool {
    matches!(
        trajectory.mode.get(),
        TrajectoryMode::Stop | TrajectoryMode::Brake
    )
}
