//! Writes a plan into the route: the guide along the path found, certified space around it, the limits, and a stop.

use super::Planner;
use crate::departure::Departure;
use crate::guide::GuideLength;
use crate::search::{PathEnd, SearchResult};
use crate::speed_tiers::planned_mps;
use crate::stops;
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::motion::{MotionLimits, Route, RouteMode};
use jink_shared_types::vehicle::DesiredPath;
use jink_shared_types::{Coded, Flag};

/// Longest guide (m): as far as rays clear the map ahead of a vehicle in motion (OA_CARVE_RNG), less the clearance around its end
/// and what the vehicle runs past it.
pub(super) const GUIDE_MAX_M: f64 = 16.0;
/// A plan that gains less than this is not worth committing (m).
pub(super) const PROGRESS_MIN_M: f64 = 0.25;

impl Planner {
    /// Builds the guide along the path that was found last. Returns whether it ends at the goal.
    pub(super) fn build_guide(
        &mut self,
        tier: usize,
        departure: &Departure,
        goal: &Point<LocalNed>,
        found: &SearchResult,
    ) -> bool {
        let goal = goal.vector();
        let start = departure.state.position.vector();
        self.guide.build(
            &self.space,
            tier,
            &start,
            self.search.path(),
            (found.end == PathEnd::Goal).then_some(&goal),
            &self.guide_length(tier, departure),
        )
    }

    /// The lengths of a guide in `tier`.
    pub(super) fn guide_length(&self, tier: usize, departure: &Departure) -> GuideLength {
        let limits = self.limits_of(tier);
        let speed_mps = departure.state.velocity.vector().norm();
        GuideLength {
            max_m: GUIDE_MAX_M,
            margin_m: limits.overshoot_m,
            stop_m: speed_mps * speed_mps / (2.0 * limits.acceleration_mps2),
            velocity: departure.state.velocity.vector(),
            acceleration_mps2: limits.acceleration_mps2,
            jerk_mps3: limits.jerk_mps3,
        }
    }

    /// The limits in `tier`.
    fn limits_of(&self, tier: usize) -> &MotionLimits {
        match self.space.narrow_tier() == Some(tier) {
            true => &self.creep,
            false => &self.limits[tier],
        }
    }

    /// Writes a plan along the guide to the path that was found last into `route`; from rest, if what is certified of its
    /// straight legs is not worth flying, from cell to cell. `false` if not even the first leg has certified space around it.
    /// In motion the committed trajectory goes on, and the next map is another try.
    pub(super) fn write_plan_along(
        &mut self,
        tier: usize,
        departure: &Departure,
        desired: &DesiredPath,
        goal: &Point<LocalNed>,
        found: &SearchResult,
        target_is_goal: bool,
        route: &mut Route,
    ) -> bool {
        let is_worth_it = |route: &Route| route.target_is_goal.is_set() || length_m(route) >= PROGRESS_MIN_M;
        let written = self.write_plan(tier, departure, desired, target_is_goal, route);
        if !departure.is_at_rest() || written && is_worth_it(route) {
            return written;
        }
        let target_is_goal = self.guide.build_in_steps(
            &self.space,
            tier,
            &departure.state.position.vector(),
            self.search.path(),
            (found.end == PathEnd::Goal).then_some(&goal.vector()),
            self.limits[tier].overshoot_m,
        );
        let written = self.write_plan(tier, departure, desired, target_is_goal, route);
        if !written {
            // What is left of the first try is no plan.
            route.mode = Coded::new(RouteMode::Keep);
        }
        written
    }

    /// Writes a plan along the guide into `route`; `false` if not even its first leg has certified space around it.
    pub(super) fn write_plan(
        &mut self,
        tier: usize,
        departure: &Departure,
        desired: &DesiredPath,
        target_is_goal: bool,
        route: &mut Route,
    ) -> bool {
        let down_range_m = {
            let heights = self.guide.vertices().iter().map(|v| v.z);
            let (low, high) = heights.fold((f64::MAX, f64::MIN), |(a, b), z| (a.min(z), b.max(z)));
            (low - 1.0, high + 0.3)
        };
        route.guide_len = 0;
        route.corridor_len = 0;
        for (index, vertex) in self.guide.vertices().iter().enumerate() {
            route.guide[index] = Point::from_vector(*vertex);
            route.guide_len += 1;
        }
        for index in 1..self.guide.vertices().len() {
            let (a, b) = (self.guide.vertices()[index - 1], self.guide.vertices()[index]);
            // Where a leg has no polytope the plan ends before it: the vehicle rests there, and the next plan sees
            // more.
            let Some(polytope) = self.corridor.polytope(&self.space, tier, &a, &b, down_range_m) else {
                route.guide_len = index as u32;
                break;
            };
            route.corridor[index - 1] = polytope;
            route.corridor_len += 1;
        }
        if route.corridor_len == 0 {
            return false;
        }
        route.declarations = self
            .space
            .declarations(tier, &self.guide.vertices()[..route.guide_len as usize]);
        route.base_id = departure.base_id;
        route.splice = departure.splice;
        route.start = departure.state;
        route.limits = *self.limits_of(tier);
        if !self.guide.has_margin() {
            route.limits = route.limits.with_gentle_stop(&self.tracking);
        }
        if desired.mission_speed_mps.is_finite() {
            let asked_mps = desired.mission_speed_mps.max(0.3);
            let planned_mps = planned_mps(asked_mps, route.limits.acceleration_mps2);
            route.limits.speed_mps = route.limits.speed_mps.min(planned_mps);
        }
        route.target = route.guide[route.guide_len as usize - 1];
        let whole = route.corridor_len as usize + 1 == self.guide.vertices().len();
        route.target_is_goal = Flag::from(target_is_goal && whole);
        // Sensors that do not see all around have to face the motion, whatever the mission asks.
        let faces_ahead = self.yaw_along_path || !self.view.is_all_around() && !self.view.is_empty();
        route.goal_yaw_rad = if faces_ahead {
            f64::NAN
        } else {
            f64::from(desired.points[1].yaw_rad)
        };
        route.mode = Coded::new(RouteMode::Plan);
        if let Some(stop) = stops::certified(&self.space, &self.tracking, tier, &departure.state) {
            route.stop = stop;
            route.has_stop = Flag::YES;
        }
        true
    }
}

/// Length of the part of the guide that has certified space around it (m).
fn length_m(route: &Route) -> f64 {
    let guide = &route.guide[..route.guide_len as usize];
    let legs = guide.windows(2);
    legs.map(|leg| (leg[1].vector() - leg[0].vector()).norm()).sum()
}
