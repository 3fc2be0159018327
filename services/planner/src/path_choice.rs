//! Paths to the goal: for which speed tier one is found, in which it can be begun, and how long it is expected to take.

use super::Planner;
use crate::certified_route::PROGRESS_MIN_M;
use crate::departure::Departure;
use crate::search::{Path, PathEnd, SearchQuery, SearchResult};
use crate::speed_tiers::{CRAWL_TIER, LAST_TIER, TIERS};
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::motion::MotionLimits;
use nalgebra::Vector3;

/// A path of a lower speed tier is begun in a higher one if that is safe for at least this far (m); shorter is not
/// worth speeding up.
pub(super) const HIGHER_TIER_MIN_M: f64 = 1.5;
/// Time that slowing down for one speed tier is expected to cost (s): some metres at half the speed.
const TIER_COST_S: f64 = 2.0;
/// Additional cost of a metre that a path round something large is longer than the straight line: nobody has seen how
/// far that reaches, and a vehicle that goes there looks around. A gap that a lower speed tier fits through is tried
/// first.
const ROUND_COST: f32 = 2.0;
/// A path that ends nowhere near the goal is the last choice: it counts as if it took so much longer (s).
pub(super) const DEAD_END_S: f64 = 1e3;
/// Additional cost of a metre of height, for sensors that do not see where a climb leads, and for those that do. Flying
/// round takes less energy than flying over; and what is above the field of view is seen only from farther away.
const HEIGHT_COSTS: [f32; 2] = [2.0, 0.5];
/// How far above the goal a path may lead over an obstacle in between (m).
const DETOUR_UP_M: f64 = 2.0;
/// A vehicle at rest whose distance from the goal is at most this much larger than that of the best reachable place
/// stays where it is (m): the difference is mostly the map's noise.
const NEAR_ENOUGH_M: f64 = 0.5;

/// A path that can be begun.
#[derive(Clone, Copy, Debug)]
pub(super) struct PathChoice {
    /// Time that it is expected to take (s).
    pub time_s: f64,
    /// The speed tier that it was found for.
    pub way: usize,
    /// The speed tier that it is begun in.
    pub flown: usize,
    /// The path.
    pub found: SearchResult,
}

/// The paths that were found for each speed tier from one departure to one goal.
#[derive(Debug, Default)]
pub(super) struct FoundPaths {
    results: [Option<SearchResult>; TIERS],
    paths: [Path; TIERS],
}

impl FoundPaths {
    /// Forgets them: there is another departure, goal or map.
    pub(super) fn clear(&mut self) {
        self.results = [None; TIERS];
    }

    /// The path that was found last for `tier`, also for an earlier departure.
    pub(super) fn last_path(&self, tier: usize) -> &Path {
        &self.paths[tier]
    }
}

impl Planner {
    /// Finds a path in the lowest speed tiers, for places where no other tier has one, or only a much longer one.
    pub(super) fn choose_crawling(
        &mut self,
        departure: &Departure,
        goal: &Point<LocalNed>,
    ) -> Option<PathChoice> {
        let mut best: Option<PathChoice> = None;
        for tier in CRAWL_TIER..=LAST_TIER {
            self.space.prepare(tier);
            let Some(found) = self.find(tier, departure, goal) else {
                continue;
            };
            let is_short = found.end == PathEnd::NearestPoint;
            if is_short && (best.is_some() || is_near_enough(departure, goal, &found)) {
                continue;
            }
            if let Some(flown) = self.flown_tier(tier, departure, goal, &found) {
                best = Some(PathChoice {
                    time_s: self.time_s(tier, &found),
                    way: tier,
                    flown,
                    found,
                });
                self.search.swap_path(&mut self.crawl_path);
            }
            if best.is_some() && !is_short {
                break;
            }
        }
        best
    }

    /// Time that the path found for `tier` is expected to take (s).
    pub(super) fn time_s(&self, tier: usize, found: &SearchResult) -> f64 {
        let dead_end_s = if found.end == PathEnd::NearestPoint {
            DEAD_END_S
        } else {
            0.0
        };
        let counted_m = f64::from(found.cost_m + ROUND_COST * found.round_m);
        counted_m / self.limits[0].speed_mps + TIER_COST_S * tier as f64 + dead_end_s
    }

    /// The highest speed tier in which the path found for `tier` can be begun from this departure; `None` if in none.
    pub(super) fn flown_tier(
        &mut self,
        tier: usize,
        departure: &Departure,
        goal: &Point<LocalNed>,
        found: &SearchResult,
    ) -> Option<usize> {
        (self.top_tier..=tier).find(|flown| {
            // The reduced clearance is only for the path out of a narrow place.
            if self.space.narrow_tier() == Some(*flown)
                || !self.can_begin(*flown, departure)
                || !departure.is_within(self.limits[*flown].tube_m)
                || !self.space.is_safe_at(*flown, &departure.state.position.vector())
            {
                return false;
            }
            let at_goal = self.build_guide(*flown, departure, goal, found);
            let worth_m = if *flown < tier {
                HIGHER_TIER_MIN_M
            } else {
                PROGRESS_MIN_M
            };
            at_goal || self.guide.length_m() >= worth_m
        })
    }

    /// Whether the vehicle is slow enough for `tier`.
    pub(super) fn can_begin(&self, tier: usize, departure: &Departure) -> bool {
        let speed_mps = departure.state.velocity.vector().norm();
        speed_mps <= MotionLimits::allowed(self.limits[tier].speed_mps)
    }

    /// Searches for a path in `tier`, unless it was found in this plan already; afterwards it is the search's path.
    pub(super) fn find(
        &mut self,
        tier: usize,
        departure: &Departure,
        goal: &Point<LocalNed>,
    ) -> Option<SearchResult> {
        if let Some(found) = self.found.results[tier] {
            self.search.set_path(&self.found.paths[tier]);
            return Some(found);
        }
        let query = SearchQuery {
            tier,
            start: self.space.cell_of(tier, &departure.state.position.vector()),
            goal: self.space.cell_of(tier, &goal.vector()),
            z_range: self.heights(tier, departure, goal),
            height_cost: HEIGHT_COSTS[usize::from(self.view.is_high())],
        };
        let found = self.search.run(&self.space, &query)?;
        self.found.results[tier] = Some(found);
        self.found.paths[tier].copy(self.search.path());
        Some(found)
    }

    /// Lowest and highest z of the cells that a path to `goal` may lead through: it may climb over obstacles, but not
    /// where a planar sensor's band is declared. The band holds for the height that was measured; nothing was measured
    /// at the height of a detour.
    pub(super) fn heights(&self, tier: usize, departure: &Departure, goal: &Point<LocalNed>) -> (i32, i32) {
        let here_m = departure.state.position.z_m;
        let detour_m = if self.space.has_band() { 0.0 } else { DETOUR_UP_M };
        // Not above the vehicle: on a detour it would climb further with every plan.
        let top_m = (goal.z_m - detour_m).min(here_m);
        let bottom_m = goal.z_m.max(here_m);
        let level = |down_m| self.space.cell_of(tier, &Vector3::new(0.0, 0.0, down_m))[2];
        let [top, bottom] = [top_m, bottom_m].map(level);
        (top, bottom)
    }
}

/// Whether the path found ends no nearer to the goal than where the vehicle rests already.
pub(super) fn is_near_enough(departure: &Departure, goal: &Point<LocalNed>, found: &SearchResult) -> bool {
    let away_m = (departure.state.position.vector() - goal.vector()).norm();
    departure.is_at_rest() && away_m <= f64::from(found.remaining_m) + NEAR_ENOUGH_M
}
