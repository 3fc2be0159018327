//! What is reported to the pilot and the gateway: no path, a goal that stays out of reach, a blocked trajectory.

use super::Planner;
use crate::certified_route::GUIDE_MAX_M;
use crate::progress::Obstruction;
use crate::speed_tiers::{DEGRADED_TIER, reached_mps};
use jink_shared_types::Timestamp;
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::params;
use jink_shared_types::vehicle::VehicleState;

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
        if self.progress.step(now, goal, remaining_m, detour_mps) {
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
