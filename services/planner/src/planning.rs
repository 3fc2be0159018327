//! How a plan is made: along the best path over the speed tiers, else out of a narrow place, else to a viewpoint.

use super::Planner;
use crate::departure::Departure;
use crate::path_choice::{DEAD_END_S, PathChoice, is_near_enough};
use crate::progress::Obstruction;
use crate::search::{PathEnd, SearchResult};
use crate::speed_tiers::{CRAWL_TIER, LAST_TIER, SLOW_TIER};
use crate::stopping::is_stop;
use crate::viewpoint_moves::HeadingCheck;
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::map::cell_of;
use jink_shared_types::motion::{MotionLimits, Route, Trajectory};
use jink_shared_types::vehicle::DesiredPath;

/// Lower speed tiers are tried when the path in the higher one costs this much more than the straight line.
const DETOUR_WORTH_A_TIER: f32 = 1.25;
/// Time that a path in a lower speed tier must save to slow down for it, rather than take another one at once (s).
const SLOWING_S: f64 = 2.0;
/// Viewpoints, and turns toward the paths to them, that are tried per minute for a path in a higher speed tier before a
/// path in the lowest tiers is taken.
const VIEWPOINTS_BEFORE_CRAWLING: usize = 2;
/// A vehicle that is to rest, in a place that is narrow only because its surroundings are not known, stays where it is
/// if the place to rest at is no farther than this (m): a take-off that ends below its height, a hold in a gust.
const NEAR_REST_M: f64 = 1.0;

impl Planner {
    /// Finds the best path over the speed tiers and writes a plan along it into `route`; `false` if there is none.
    ///
    /// A path may need a low speed tier somewhere (a gap) and still be flown in a higher one up to there: for each
    /// tier's path the guide is cut where the flown tier stops being safe, and the lower tier takes over when the
    /// vehicle is slow enough. A vehicle that is not slow enough yet slows down first, rather than take another path
    /// that is much longer, or one that ends before the goal.
    pub(super) fn plan(
        &mut self,
        departure: &Departure,
        desired: &DesiredPath,
        goal: &Point<LocalNed>,
        committed: Option<&Trajectory>,
        must_leave: bool,
        route: &mut Route,
    ) -> bool {
        let start = departure.state.position.vector();
        let speed_mps = departure.state.velocity.vector().norm();
        let is_creeping = departure.is_at_rest()
            || self.space.is_narrow() && speed_mps <= MotionLimits::allowed(self.creep.speed_mps);
        let has_plan = departure.base_id != 0;
        self.space.set_departure(&start, SLOW_TIER, is_creeping, has_plan);
        self.found.clear();
        // Once the goal counts as out of reach, nothing is looked for any more.
        let looks = !self.progress.is_blocked();
        if self.space.is_narrow() {
            if desired.is_to_rest()
                && (goal.vector() - start).norm() < NEAR_REST_M
                && !self.space.is_narrowed_by_obstacle()
            {
                // It may as well rest where it is: it comes no nearer to the unknown around it.
                return true;
            }
            self.proposals.on_evading();
            self.proposals.use_own_path();
            if self.plan_escape(departure, desired, route) {
                return true;
            }
            let Some(PathChoice { flown, found, .. }) = self.choose_crawling(departure, goal) else {
                if looks && self.move_to_viewpoint_crawling(departure, desired, goal, committed, route) {
                    return true;
                }
                self.space.set_departure(&start, LAST_TIER, is_creeping, has_plan);
                self.found.clear();
                return self.plan_escape(departure, desired, route);
            };
            self.search.swap_path(&mut self.crawl_path);
            let target_is_goal = self.build_guide(flown, departure, goal, &found);
            if self.progress.is_blocked() && !target_is_goal {
                return false;
            }
            return self.write_plan(flown, departure, desired, target_is_goal, route);
        }
        // A passage that flickers while the vehicle comes nearer is one; where it comes nowhere, none.
        if let Some(tier) = self.path_followed.take()
            && self.progress.is_stalled(departure.splice)
        {
            self.space.prepare(tier);
            self.search.record_failed_passage(
                &self.space,
                self.found.last_path(tier),
                &start,
                departure.splice,
            );
        }
        self.paint_moving(departure);
        let straight_m = (goal.vector() - start).norm()
            + f64::from(self.search.detour_m(cell_of(departure.state.position)));
        let mut best: Option<PathChoice> = None;
        // The time (s) and the speed tier of a path that the vehicle is too fast for.
        let mut too_fast_for: Option<(f64, usize)> = None;
        let mut seen: Option<SearchResult> = None;
        let mut next = Some(self.top_tier);
        while let Some(tier) = next {
            next = (tier < SLOW_TIER).then_some(tier + 1);
            self.space.prepare(tier);
            let Some(found) = self.find(tier, departure, goal) else {
                continue;
            };
            let is_short = found.end == PathEnd::NearestPoint;
            if seen.is_none_or(|before| before.end == PathEnd::NearestPoint) {
                seen = Some(found);
            }
            let time_s = self.time_s(tier, &found);
            if best.is_none_or(|best| time_s < best.time_s)
                && !(is_short && is_near_enough(departure, goal, &found))
            {
                if let Some(flown) = self.flown_tier(tier, departure, goal, &found) {
                    best = Some(PathChoice {
                        time_s,
                        way: tier,
                        flown,
                        found,
                    });
                    self.search.swap_path(&mut self.best_path);
                } else if !self.can_begin(tier, departure) && self.space.is_safe_at(tier, &start) {
                    too_fast_for = Some((time_s, tier));
                }
            }
            let direct = !is_short && found.cost_m <= DETOUR_WORTH_A_TIER * straight_m as f32;
            if best.is_some() && direct {
                break;
            }
            // Where the lowest of these speed tiers finds no path, none between does.
            if is_short && tier == self.top_tier {
                next = next.map(|_| SLOW_TIER);
            }
        }
        let crawls = committed.is_some_and(|committed| self.tier_of(committed.limits.tube_m) >= CRAWL_TIER);
        let is_detour =
            |best: PathChoice| f64::from(best.found.cost_m) > f64::from(DETOUR_WORTH_A_TIER) * straight_m;
        let mut last = None;
        if best.is_none_or(is_detour) && (departure.is_at_rest() || crawls) {
            last = self.choose_crawling(departure, goal);
        }
        let seen_s = seen.map_or(DEAD_END_S, |seen| self.time_s(self.top_tier, &seen));
        if let (Some(other), Some(crawling)) = (best, last) {
            if crawling.time_s + SLOWING_S < other.time_s {
                best = None;
            } else {
                last = None;
            }
        }
        if let Some(last) = last
            && last.found.end != PathEnd::NearestPoint
        {
            seen = Some(last.found);
        }
        self.remaining_m = seen.map(|found| f64::from(found.cost_m));
        let is_planned = best.is_some() || last.is_some();
        let falls_short = seen.is_none_or(|found| found.end == PathEnd::NearestPoint) || !is_planned;
        self.obstruction = falls_short.then(|| Obstruction::of(seen.as_ref()));
        if self.plan_proposed(departure, desired, goal, route) {
            return true;
        }
        if self.proposals.use_own_path() && self.progress.is_blocked() {
            // The vehicle is somewhere else now, and progress is measured anew from there.
            self.progress.reset();
        }
        let viewpoints_max = match last {
            // A viewpoint could hardly reveal a faster path.
            Some(last) if last.time_s + SLOWING_S < seen_s => 0,
            Some(_) => VIEWPOINTS_BEFORE_CRAWLING,
            None => usize::MAX,
        };
        if best.is_none()
            && looks
            && self.move_to_viewpoint(
                SLOW_TIER,
                viewpoints_max,
                departure,
                desired,
                goal,
                committed,
                route,
            )
        {
            return true;
        }
        let Some(chosen) = best.or(last) else {
            return looks && self.move_to_viewpoint_crawling(departure, desired, goal, committed, route);
        };
        let PathChoice { flown, found, .. } = chosen;
        if best.is_none() {
            self.search.swap_path(&mut self.crawl_path);
        } else {
            self.search.swap_path(&mut self.best_path);
        }
        let target_is_goal = self.build_guide(flown, departure, goal, &found);
        if self.progress.is_blocked() && !target_is_goal && !departure.is_unplanned_motion() {
            // Once the goal counts as out of reach, the vehicle departs only for a path that is known to its end, or as short
            // as any was before there was none, or where none was flown.
            let is_open_now = found.end != PathEnd::NearestPoint
                && match self.blocked_by {
                    Some(Obstruction::Occupied | Obstruction::Enclosed) => {
                        departure.is_at_rest() && self.progress.is_as_short(f64::from(found.cost_m))
                    }
                    why => why == Some(Obstruction::Unflown),
                };
            if !is_open_now {
                return false;
            }
            self.progress.resume(departure.splice);
        }
        self.search.prefer_path(&self.space);
        if let Some((slow_s, way)) = too_fast_for
            && slow_s < DEAD_END_S
            && slow_s + SLOWING_S < chosen.time_s
            && !must_leave
            && !departure.is_unplanned_motion()
        {
            // The committed trajectory along the same path ends where that becomes narrow.
            if self.path_tier != way && !committed.is_some_and(is_stop) {
                self.stop_certified(departure, route);
            }
            return true;
        }
        self.path_tier = chosen.way;
        self.path_followed = Some(chosen.way);
        match self.check_heading(departure) {
            HeadingCheck::Aligned => {
                self.write_plan_along(flown, departure, desired, goal, &found, target_is_goal, route)
            }
            HeadingCheck::Turn(heading_rad) => {
                self.turn_first(departure, heading_rad, committed, route);
                true
            }
            HeadingCheck::Stop => {
                if !committed.is_some_and(is_stop) {
                    self.stop_certified(departure, route);
                }
                true
            }
        }
    }

    /// Plans out of a place that is too narrow for a speed tier, to the nearest that is not; from there planning
    /// continues as usual. `false` if there is no such path, or the place is not too narrow.
    fn plan_escape(&mut self, departure: &Departure, desired: &DesiredPath, route: &mut Route) -> bool {
        let Some(tier) = self.space.narrow_tier() else {
            return false;
        };
        let start = departure.state.position.vector();
        let here = self.space.cell_of(tier, &start);
        if !self.search.escape_path(&self.space, tier, here) {
            return false;
        }
        let Some(end) = self.search.path().cells.last().copied() else {
            return false;
        };
        self.guide.build(
            &self.space,
            tier,
            &start,
            self.search.path(),
            Some(&self.space.center_of(tier, end)),
            &self.guide_length(tier, departure),
        );
        self.write_plan(tier, departure, desired, false, route)
    }
}
