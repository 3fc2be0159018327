//! How the committed trajectory is replaced by a stop: because the vehicle is to rest before it could come to its goal,
//! or because of an obstacle on the path (rule I3).

use super::Planner;
use crate::departure::{Departure, MOVING_MPS};
use crate::speed_tiers::{LAST_TIER, TIERS};
use crate::stops;
use jink_shared_types::events;
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::motion::{BezierPiece, MotionLimits, Route, RouteMode, Trajectory, TrajectoryMode};
use jink_shared_types::vehicle::DesiredPath;
use jink_shared_types::{Coded, Flag, Timestamp};

/// A lost certificate is not reported again within this time (s).
const LOSS_REPORT_PERIOD_S: f64 = 10.0;
/// Length of a smooth stop over v^2 / a: it lasts 1.5 v / a for a greatest deceleration a, at half the speed on
/// average.
const STOP_SHAPE: f64 = 0.75;

impl Planner {
    /// Whether the vehicle is to rest at a place that it would pass: then it stops where it can, and comes back from
    /// there.
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

    /// Plans the certified stop, if there is one; else the committed trajectory runs to its own stop.
    pub(super) fn stop_certified(&mut self, departure: &Departure, route: &mut Route) {
        self.hide_moving();
        let stop = (0..TIERS).find_map(|tier| {
            self.space.prepare(tier);
            stops::brisk(&self.space, &self.tracking, tier, &departure.state).map(|stop| (tier, stop))
        });
        if let Some((tier, stop)) = stop {
            self.write_stop(departure, self.limits[tier], stop, route);
        }
    }

    /// I3: a certified stop if there is one, else the hardest braking allowed, with an event. At rest there is nothing
    /// to brake.
    pub(super) fn stop_or_brake(&mut self, now: Timestamp, departure: &Departure, route: &mut Route) {
        if departure.is_at_rest() {
            return;
        }
        self.hide_moving();
        let tier = (0..TIERS).find_map(|tier| {
            self.space.prepare(tier);
            stops::certified(&self.space, &self.tracking, tier, &departure.state).map(|stop| (tier, stop))
        });
        let (limits, stop) = match tier {
            Some((tier, stop)) => (self.limits[tier], stop),
            None => {
                if !self.loss_reported_at.is_set()
                    || now.seconds_since(self.loss_reported_at) > LOSS_REPORT_PERIOD_S
                {
                    self.report_event(&events::CERTIFICATE_LOST);
                }
                self.loss_reported_at = now;
                (
                    self.limits[LAST_TIER],
                    stops::hardest(&departure.state, &self.tracking),
                )
            }
        };
        self.write_stop(departure, limits, stop, route);
        route.must_leave = Flag::YES;
    }

    pub(super) fn write_stop(
        &mut self,
        departure: &Departure,
        limits: MotionLimits,
        stop: BezierPiece,
        route: &mut Route,
    ) {
        self.proposals.use_own_path();
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

/// Whether the trajectory only brings the vehicle to rest.
pub(super) fn is_stop(trajectory: &Trajectory) -> bool {
    matches!(
        trajectory.mode.get(),
        TrajectoryMode::Stop | TrajectoryMode::Brake
    )
}
