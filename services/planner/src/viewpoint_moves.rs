//! Motions to viewpoints, where no plan is found because the path has not been seen.

use super::Planner;
use crate::departure::Departure;
use crate::speed_tiers::{CRAWL_TIER, LAST_TIER};
use crate::viewpoints::{DWELL_S, REACH_M, Viewpoint};
use jink_shared_types::Coded;
use jink_shared_types::frames::{LocalNed, Point, wrap_pi};
use jink_shared_types::map::cell_of;
use jink_shared_types::motion::{Route, RouteMode, Trajectory};
use jink_shared_types::vehicle::DesiredPath;

/// A route that has not become a trajectory within this time (s) is refused.
const REFUSED_S: f64 = 0.5;
/// A heading rate slower than this rests (rad/s).
const RESTING_RADPS: f64 = 0.02;

/// A motion that leads less far to any side (m) needs no turn before it: the vehicle itself has been in most of the
/// space it sweeps.
const ASIDE_M: f64 = 0.3;
/// A path that leaves the field of view by less than this is flown while the heading follows (rad).
const EDGE_RAD: f64 = 0.17;
/// A path that leads farther aside than this (rad) is not begun in motion.
const ABOUT_RAD: f64 = 1.05;

/// What has to be done before a motion whose first direction is not in view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum HeadingCheck {
    /// Nothing.
    Aligned,
    /// To turn to this heading (rad), or to end a turn.
    Turn(f64),
    /// To come to rest.
    Stop,
}

impl Planner {
    /// What has to be done before the motion along the guide: with sensors that do not see all around, the vehicle
    /// faces where it goes.
    pub(super) fn check_heading(&self, departure: &Departure) -> HeadingCheck {
        if self.view.is_empty() || self.view.is_all_around() {
            return HeadingCheck::Aligned;
        }
        let start = departure.state.position.vector();
        let away = |vertex: &nalgebra::Vector3<f64>| (vertex - start).xy().norm();
        let vertices = self.guide.vertices();
        let Some(toward) = vertices.iter().find(|vertex| away(vertex) >= ASIDE_M) else {
            return HeadingCheck::Aligned;
        };
        let way = toward - start;
        let heading_rad = way.y.atan2(way.x);
        let aside_rad = wrap_pi(heading_rad - departure.state.yaw_rad);
        let [left_rad, right_rad] = self.view.aside_rad();
        let seen_rad = if aside_rad < 0.0 { left_rad } else { right_rad };
        // Where nothing answers from ahead, in the open, the field of view is not known to reach aside at all.
        if aside_rad.abs() <= (seen_rad - EDGE_RAD).max(EDGE_RAD) {
            HeadingCheck::Aligned
        } else if departure.is_at_rest() {
            HeadingCheck::Turn(heading_rad)
        } else if aside_rad.abs() > seen_rad.max(ABOUT_RAD) {
            HeadingCheck::Stop
        } else {
            HeadingCheck::Aligned
        }
    }

    /// Turns to `heading_rad` where the vehicle rests, unless it is turning already: a turn is completed.
    pub(super) fn turn_first(
        &mut self,
        departure: &Departure,
        heading_rad: f64,
        committed: Option<&Trajectory>,
        route: &mut Route,
    ) {
        let is_turning = committed.is_some_and(|committed| {
            committed.route_id == self.turn_id && committed.end() > departure.splice
        });
        if !is_turning && departure.state.yaw_rate_radps.abs() <= RESTING_RADPS {
            let viewpoint = Viewpoint {
                cell: cell_of(departure.state.position),
                yaw_rad: heading_rad,
            };
            self.write_turn(departure, &viewpoint, route);
            self.turn_id = route.id;
        }
    }

    /// Plans to a viewpoint for what is missing on the path to `goal` in `tier`; `false` if there is none. While a
    /// viewpoint is in progress, and shortly after it, nothing else is done. It is started only while fewer than
    /// `viewpoints_max` were started in the last minute.
    pub(super) fn move_to_viewpoint(
        &mut self,
        tier: usize,
        viewpoints_max: usize,
        departure: &Departure,
        desired: &DesiredPath,
        goal: &Point<LocalNed>,
        committed: Option<&Trajectory>,
        route: &mut Route,
    ) -> bool {
        let time = departure.splice;
        if let Some((route_id, since)) = self.viewpoints.in_progress() {
            let flown = committed.filter(|committed| committed.route_id == route_id);
            let until = match flown {
                Some(flown) => flown.end().plus_seconds(DWELL_S),
                None => since.plus_seconds(REFUSED_S),
            };
            if time < until {
                return true;
            }
        }
        if !departure.is_at_rest() || departure.state.yaw_rate_radps.abs() > RESTING_RADPS {
            return false;
        }
        if self.viewpoints.started_recently(time) >= viewpoints_max {
            return false;
        }
        self.space.prepare(tier);
        if self.find(tier, departure, goal).is_none() {
            return false;
        }
        if !self.viewpoints.collect_missing(&self.space, self.search.path()) {
            return false;
        }
        let start = self.space.cell_of(tier, &departure.state.position.vector());
        let yaw_rad = departure.state.yaw_rad;
        let z_range = if self.space.has_band() {
            self.heights(tier, departure, goal)
        } else {
            (i32::MIN, i32::MAX)
        };
        self.search.reachable_cells(
            &self.space,
            tier,
            start,
            REACH_M,
            z_range,
            &mut self.viewpoints.places,
        );
        let Some(viewpoint) = self
            .viewpoints
            .best(&self.space, tier, &self.view, start, yaw_rad, time)
        else {
            return false;
        };
        if viewpoint.cell == start {
            self.viewpoints.record(viewpoint, route.id, time);
            self.write_turn(departure, &viewpoint, route);
            return true;
        }
        self.search.path_to(&self.space, viewpoint.cell);
        self.guide.build(
            &self.space,
            tier,
            &departure.state.position.vector(),
            self.search.path(),
            Some(&self.space.center_of(tier, viewpoint.cell)),
            &self.guide_length(tier, departure),
        );
        if let HeadingCheck::Turn(heading_rad) = self.check_heading(departure) {
            self.viewpoints.record_turn(route.id, time);
            let toward = Viewpoint {
                cell: start,
                yaw_rad: heading_rad,
            };
            self.write_turn(departure, &toward, route);
            return true;
        }
        self.viewpoints.record(viewpoint, route.id, time);
        if !self.write_plan(tier, departure, desired, false, route) {
            return false;
        }
        if wrap_pi(viewpoint.yaw_rad - yaw_rad).abs() > 1e-9 {
            route.goal_yaw_rad = viewpoint.yaw_rad;
        }
        true
    }

    /// The same in the lowest speed tiers.
    pub(super) fn move_to_viewpoint_crawling(
        &mut self,
        departure: &Departure,
        desired: &DesiredPath,
        goal: &Point<LocalNed>,
        committed: Option<&Trajectory>,
        route: &mut Route,
    ) -> bool {
        (CRAWL_TIER..=LAST_TIER)
            .any(|tier| self.move_to_viewpoint(tier, usize::MAX, departure, desired, goal, committed, route))
    }

    fn write_turn(&self, departure: &Departure, viewpoint: &Viewpoint, route: &mut Route) {
        route.base_id = departure.base_id;
        route.splice = departure.splice;
        route.start = departure.state;
        route.limits = self.limits[LAST_TIER];
        route.target = departure.state.position;
        route.goal_yaw_rad = viewpoint.yaw_rad;
        route.mode = Coded::new(RouteMode::Turn);
    }
}
