//! What is reported to the pilot and the gateway: no path, a goal that stays out of reach, a blocked trajectory.

use super::Planner;
use crate::certified_route::GUIDE_MAX_M;
use crate::configuration_space::ConfigurationSpace;
use crate::progress::Obstruction;
use crate::speed_tiers::{DEGRADED_TIER, reached_mps};
use jink_shared_types::Timestamp;
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::params;
use jink_shared_types::vehicle::{DesiredPath, NavMode, VehicleState};
use nalgebra::Vector3;

/// A goal that was no farther than this (m) is none to arrive at: a hold in a gust is left and reached again.
const AWAY_M: f64 = 2.0;
/// A guide that leaves the straight line by less (m) goes round nothing.
const ROUND_M: f64 = 0.5;
/// Nearer than this (m) is beside the vehicle.
const NEAR_M: f64 = 1.0;
/// An obstacle that has been out of the way for no longer than this (s) is the same.
const SAME_DETOUR_S: f64 = 3.0;
/// How long planning must fail while the vehicle stands before the pilot is notified (s).
const NO_PATH_AFTER_S: f64 = 1.5;

impl Planner {
    /// Remembers the goal of a planning, and reports when none has succeeded for too long and when one does again.
    pub(super) fn report_path(
        &mut self,
        now: Timestamp,
        planned: bool,
        state: &VehicleState,
        goal: &Point<LocalNed>,
    ) {
        let at_goal = (state.position.vector() - goal.vector()).norm() <= self.goal_radius_m;
        if planned || at_goal {
            self.planned_goal = Some(*goal);
            self.failing_since = None;
            if self.no_path_reported {
                self.no_path_reported = false;
                self.report_event(&events::PATH_FOUND);
            }
            return;
        }
        self.planned_goal = Some(*goal);
        let since = *self.failing_since.get_or_insert(now);
        let standing = state.velocity.vector().norm() < 0.3;
        if standing && !self.no_path_reported && now.seconds_since(since) > NO_PATH_AFTER_S {
            self.no_path_reported = true;
            self.report_event(&events::NO_PATH);
        }
    }

    /// Reports that the goal has been out of reach for too long, and repeats it after the same time.
    pub(super) fn check_progress(
        &mut self,
        now: Timestamp,
        state: &VehicleState,
        goal: &Point<LocalNed>,
        requested: &Point<LocalNed>,
        is_unflown: bool,
    ) {
        let away_m = (state.position.vector() - goal.vector()).norm();
        if away_m <= self.goal_radius_m && self.obstruction != Some(Obstruction::Height) {
            self.progress.reset();
            return;
        }
        let leads_on = matches!(self.obstruction, None | Some(Obstruction::Unseen));
        let detour_mps = if leads_on {
            // As fast as the path that was planned last, where that is slow.
            let tier = self.path_tier.max(DEGRADED_TIER);
            self.limits[tier].speed_mps
        } else {
            0.0
        };
        if self.proposals.is_flown() {
            self.progress.pause(now);
        }
        if leads_on {
            self.progress.explore(now, &state.position);
        }
        // A path that ends before the goal says nothing about what it costs to reach it.
        let remaining_m = self.remaining_m.filter(|_| leads_on);
        let place = &state.position;
        if self.progress.step(now, goal, place, remaining_m, detour_mps) {
            let unknown = if is_unflown {
                Obstruction::Unflown
            } else {
                Obstruction::NotFound
            };
            let why = self.obstruction.unwrap_or(unknown);
            self.blocked_by = Some(why);
            let away_m = (state.position.vector() - requested.vector()).norm();
            let event = EventSample::new(&events::GOAL_BLOCKED, why.text(), [away_m, 0.0]);
            self.events.push(event);
        } else if leads_on
            && self.failing_since.is_none()
            && let Some(searched_s) = self.progress.search_to_report_s(now)
        {
            let numbers = [searched_s.round(), 0.0];
            self.events
                .push(EventSample::new(&events::WAY_SEARCHED, "planner", numbers));
        }
    }

    /// The speed that plans reach, and the one that is allowed (m/s).
    pub(super) fn speeds_mps(&self) -> [f64; 2] {
        [
            reached_mps(&self.limits[0], GUIDE_MAX_M),
            self.params.get(&params::OA_SPD_MAX),
        ]
    }

    /// Reports once by how much plans stay below the highest speed that is allowed, where that is more than what a vehicle
    /// needs to catch up with them.
    pub(super) fn report_speed(&mut self) {
        let speeds = self.speeds_mps();
        if self.speed_reported == Some(speeds) {
            return;
        }
        self.speed_reported = Some(speeds);
        if speeds[0] < self.limits[0].speed_mps {
            self.events
                .push(EventSample::new(&events::SPEED_CUT, "planner", speeds));
        }
    }

    /// Reports when the straight way to the goal leads into an obstacle and the guide just planned passes it, once for each obstacle.
    pub(super) fn report_detour(&mut self, now: Timestamp, from: &Vector3<f64>, goal: &Point<LocalNed>) {
        let way = goal.vector() - from;
        let Some(along) = way.try_normalize(NEAR_M) else {
            return;
        };
        let off_m = |vertex: &Vector3<f64>| (vertex - from).cross(&along).norm();
        if !self.space.is_ready(self.path_tier)
            || self.guide.vertices().iter().all(|vertex| off_m(vertex) < ROUND_M)
        {
            return;
        }
        // What stands beside the vehicle is not ahead.
        let [begin, end] = [NEAR_M, way.norm().min(GUIDE_MAX_M)].map(|m| from + along * m);
        let is_hit = |space: &ConfigurationSpace, cell| space.is_hit(self.path_tier, cell);
        if self
            .space
            .first_in(self.path_tier, &begin, &end, is_hit)
            .is_none()
        {
            return;
        }
        let before = std::mem::replace(&mut self.detour_seen, now);
        if !before.is_set() || now.seconds_since(before) > SAME_DETOUR_S {
            self.report_event(&events::GOING_ROUND);
        }
    }

    /// Reports that the vehicle has come to a goal of the autopilot's own mission behind which there is none. What jink flies itself the
    /// gateway reports.
    pub(super) fn report_arrival(&mut self, away_m: f64, desired: &DesiredPath) {
        if away_m > AWAY_M {
            self.is_away = true;
        } else if away_m <= self.goal_radius_m && std::mem::take(&mut self.is_away) {
            let goes_on = desired.points[2].valid.is_set();
            if !goes_on && desired.mode == NavMode::Mission {
                self.report_event(&events::GOAL_REACHED);
            }
        }
    }

    pub(super) fn report_blocked(&mut self, blocked: bool) {
        if blocked && !self.blocked_reported {
            self.report_event(&events::COMMITMENT_CHANGED);
        }
        self.blocked_reported = blocked;
    }

    pub(super) fn report_event(&mut self, event: &events::Event) {
        self.events.push(EventSample::new(event, "planner", [0.0, 0.0]));
    }
}
