//! Turns map and desired path into a route with a certified corridor. No motion is planned that does not end at rest in
//! space known to be free.
//!
//! | in | out |
//! |---|---|
//! | local map, vehicle state, desired path, the trajectory being flown | [`Route`], events |
//! | a path that another program proposes | its answer |
//!
//! In every cycle the planner checks the committed trajectory. If the newest map shows an obstacle in its tube (rule
//! I3), the trajectory must be left: by a new plan, else by a certified stop, else by braking as hard as allowed.
//! Otherwise a new plan is made for every new map, and once more on the same map only if none was found or if what must
//! be left is still being flown. A plan departs from the state that the committed trajectory will have in
//! [`SPLICE_LEAD_S`], and replaces it only if it is certified (rule I2). Without fresh ranges or a valid state nothing
//! new is committed (rule I4).
//!
//! A vehicle that is to rest at a place (a hold, a landing) and is too fast to stop there stops first and comes back
//! from rest. A goal that cannot be reached (an obstacle, a closed wall, a height that is not allowed) is approached as
//! far as that is safe; there the vehicle rests, and after OA_BLOCKED_T without [`progress`] the reason is reported to
//! the gateway and the pilot.
//!
//! A plan is a guide through the inflated map ([`search`]), cut where known-free space ends ([`guide`]), and convex
//! pieces of certified space around it ([`corridor`]), in the highest [speed tier](mod@speed_tiers) that is worth it.
//! The guide may also be one that another program proposes ([`proposed_path`]).

pub mod bit_layer;
pub mod configuration_space;
pub mod corridor;
mod detours;
pub mod guide;
mod path_choice;
pub mod progress;
mod proposals;
pub mod proposed_path;
pub mod search;
mod sensor_coverage;
mod service;
pub mod speed_tiers;
mod stopping;
pub mod stops;
mod viewpoint_moves;
pub mod viewpoints;

pub use service::PlannerService;

use crate::configuration_space::{Clearance, ConfigurationSpace};
use crate::corridor::CorridorBuilder;
use crate::guide::Guide;
use crate::path_choice::{DEAD_END_S, PathChoice, is_near_enough};
use crate::progress::{GoalProgress, Obstruction};
use crate::proposals::Proposals;
use crate::search::{Path, PathEnd, Search, SearchResult};
use crate::sensor_coverage::SensorCoverage;
use crate::speed_tiers::{CRAWL_TIER, LAST_TIER, SLOW_TIER, TIERS, creep, speed_tiers};
use crate::stopping::is_stop;
use crate::viewpoint_moves::HeadingCheck;
use crate::viewpoints::Viewpoints;
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::far_map::FarMap;
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::map::{LocalMap, cell_of};
use jink_shared_types::motion::{
    ApprovedTrajectory, MotionLimits, MotionState, Route, RouteMode, Trajectory, TrajectoryMode,
};
use jink_shared_types::params::{self, ParamSet};
use jink_shared_types::proposal::{Proposal, ProposalAnswer};
use jink_shared_types::vehicle::{DesiredPath, NavMode, VehicleState};
use jink_shared_types::view::FieldOfView;
use jink_shared_types::{Coded, Flag, Reading, Stamped, Timestamp};
use nalgebra::Vector3;

/// How far ahead a new plan departs from the committed one (s): planner, generator, guard and the transport between
/// them take some 10 ms; 100 ms leave time for a restart of any of them.
pub const SPLICE_LEAD_S: f64 = 0.10;
/// Longest guide (m): three seconds of flight and the stop behind them at the speeds the tubes allow; more would be
/// re-planned before it is flown.
const GUIDE_MAX_M: f64 = 11.0;
/// Highest speed tier while a range sensor is silent: half the speed.
const DEGRADED_TIER: usize = 1;

// A plan that gains less than this is not worth committing (m).
const PROGRESS_MIN_M: f64 = 0.25;
/// Lower speed tiers are tried when the path in the higher one costs this much more than the straight line.
const DETOUR_WORTH_A_TIER: f32 = 1.25;
/// Time that a path in a lower speed tier must save to slow down for it, rather than take another one at once (s).
const SLOWING_S: f64 = 2.0;
/// Viewpoints, and turns toward the paths to them, that are tried per minute for a path in a higher speed tier before a
/// path in the lowest tiers is taken.
const VIEWPOINTS_BEFORE_CRAWLING: usize = 2;
/// How long planning must fail while the vehicle stands before the pilot is notified (s).
const NO_PATH_AFTER_S: f64 = 1.5;
/// A vehicle without a plan that is faster than this is in motion (m/s): below, its stopping distance stays within the
/// tube.
const MOVING_MPS: f64 = 0.5;
/// Time between two checked points of the committed trajectory (s).
const RECHECK_STEP_S: f64 = 0.03;
/// Where no path is known, the search is repeated at this period (s): every search that fails expands as much as it
/// may.
const RETRY_S: f64 = 0.5;
/// A vehicle that is to rest, in a place that is narrow only because its surroundings are not known, stays where it is
/// if the place to rest at is no farther than this (m): a take-off that ends below its height, a hold in a gust.
const NEAR_REST_M: f64 = 1.0;
/// A height that differs by this from the requested one is another one (m): PX4 accepts up to 0.8 m (NAV_MC_ALT_RAD).
const HEIGHT_OFF_M: f64 = 0.7;

/// The planner's inputs.
#[derive(Clone, Copy, Debug)]
pub struct PlannerInputs<'a> {
    /// The newest map.
    pub map: Reading<'a, LocalMap>,
    /// Obstacles farther away, and what was seen before.
    pub far: Reading<'a, FarMap>,
    /// The vehicle.
    pub state: Reading<'a, VehicleState>,
    /// The path that the autopilot wants.
    pub desired: Reading<'a, DesiredPath>,
    /// The trajectory being flown, however old: it outlives its producer.
    pub approved: Option<&'a ApprovedTrajectory>,
    /// A path that another program proposes.
    pub proposal: Reading<'a, Proposal>,
}

/// The planner.
#[derive(Debug)]
pub struct Planner {
    limits: [MotionLimits; TIERS],
    /// The limits on the way out of a place that is too narrow for every speed tier.
    creep: MotionLimits,
    goal_radius_m: f64,
    height_range_m: (f64, f64),
    yaw_along_path: bool,
    space: ConfigurationSpace,
    search: Search,
    best_path: Path,
    /// The same in the lowest speed tiers.
    crawl_path: Path,
    guide: Guide,
    corridor: CorridorBuilder,
    /// Range sensors that should contribute to the map; 0 = not known.
    sensors: u16,
    /// The highest speed tier that may be flown with those that do.
    top_tier: usize,
    route_id: u64,
    /// The last plan on this map; 0 = none yet.
    planned_id: u64,
    map_publish: Timestamp,
    /// The goal of the last planning, whether it succeeded or not.
    planned_goal: Option<Point<LocalNed>>,
    failing_since: Option<Timestamp>,
    no_path_reported: bool,
    blocked_reported: bool,
    loss_reported_at: Timestamp,
    progress: GoalProgress,
    /// Why the last plan did not reach the goal.
    obstruction: Option<Obstruction>,
    /// The reason that was reported when the goal counted as out of reach.
    blocked_by: Option<Obstruction>,
    /// Cost of the path that was found last (m); `None` if none was.
    remaining_m: Option<f64>,
    retry: Timestamp,
    coverage: SensorCoverage,
    viewpoints: Viewpoints,
    /// The speed tier of the path that was planned last.
    path_tier: usize,
    /// The last route that was a turn before a motion; 0 = none yet.
    turn_id: u64,
    view: FieldOfView,
    /// The last desired path was for setpoints that the autopilot follows.
    follows_setpoints: bool,
    proposals: Proposals,
    events: Vec<EventSample>,
}

/// Where the next plan departs from: a committed motion, or the vehicle as it moves or rests.
#[derive(Clone, Copy, Debug)]
struct Departure {
    base_id: u64,
    splice: Timestamp,
    state: MotionState,
}

impl Departure {
    /// Whether the vehicle moves without a plan, as when a pilot switches to the mission in flight: if none is found it
    /// must be stopped.
    fn is_unplanned_motion(&self) -> bool {
        self.base_id == 0 && self.state.velocity.vector().norm() > 0.0
    }

    fn is_at_rest(&self) -> bool {
        self.state.velocity.vector().norm() < RESTING_MPS
    }
}

impl Planner {
    /// A planner with the given parameters; `generation` keeps its route ids apart from those of earlier starts.
    pub fn new(params: &ParamSet, generation: u32) -> Self {
        let limits = speed_tiers(params);
        let clearance = Clearance::from_params(params);
        Self {
            coverage: SensorCoverage::new(params, clearance.footprint_m + limits[CRAWL_TIER].tube_m),
            limits,
            creep: creep(params),
            goal_radius_m: params.get(&params::OA_GOAL_RAD),
            height_range_m: (params.get(&params::OA_ALT_MIN), params.get(&params::OA_ALT_MAX)),
            yaw_along_path: params.get(&params::OA_YAW_MODE) == 1.0,
            space: ConfigurationSpace::new(&limits, clearance),
            search: Search::default(),
            best_path: Path::default(),
            crawl_path: Path::default(),
            guide: Guide::default(),
            corridor: CorridorBuilder::default(),
            sensors: 0,
            top_tier: 0,
            route_id: u64::from(generation) << 32,
            planned_id: 0,
            map_publish: Timestamp::NEVER,
            planned_goal: None,
            failing_since: None,
            no_path_reported: false,
            blocked_reported: false,
            loss_reported_at: Timestamp::NEVER,
            progress: GoalProgress::new(params.get(&params::OA_BLOCKED_T)),
            obstruction: None,
            blocked_by: None,
            remaining_m: None,
            retry: Timestamp::NEVER,
            viewpoints: Viewpoints::default(),
            path_tier: 0,
            turn_id: 0,
            view: FieldOfView::default(),
            follows_setpoints: false,
            proposals: Proposals::default(),
            events: Vec::with_capacity(8),
        }
    }

    /// Takes the parameters that apply at once; the others must be those of the start. What was learned is kept, and
    /// the committed trajectory stays: it was certified within the limits that it carries. A vehicle that is faster
    /// than a new limit allows flies its committed trajectory to its end, at rest, and continues from there.
    pub fn on_params_changed(&mut self, params: &ParamSet) {
        self.limits = speed_tiers(params);
        self.creep = creep(params);
        self.space
            .set_standoff(&self.limits, Clearance::from_params(params));
        self.goal_radius_m = params.get(&params::OA_GOAL_RAD);
        self.height_range_m = (params.get(&params::OA_ALT_MIN), params.get(&params::OA_ALT_MAX));
        self.yaw_along_path = params.get(&params::OA_YAW_MODE) == 1.0;
        // A refusal on this map may have been due to the old values.
        self.map_publish = Timestamp::NEVER;
    }

    /// Sets the number of range sensors of the vehicle: while only some of them contribute to the map, it flies in what
    /// they see, and slower.
    pub fn with_sensors(mut self, sensors: u16) -> Self {
        self.sensors = sensors;
        self
    }

    /// The events of the last step for the pilot.
    pub fn events(&self) -> &[EventSample] {
        &self.events
    }

    /// The answer to the proposed path, if one is due after the last step.
    pub fn proposal_answer(&self) -> Option<&ProposalAnswer> {
        self.proposals.answer()
    }

    /// One cycle at `now`; the result is written into `route`.
    pub fn step(&mut self, now: Timestamp, inputs: &PlannerInputs<'_>, route: &mut Route) {
        self.events.clear();
        let committed = inputs.approved.map(|approved| &approved.trajectory);
        self.proposals.begin_cycle(&inputs.proposal, committed);
        if !self.advance(now, inputs, route) {
            self.proposals.on_not_planning();
        }
        route.unseen = Coded::new(self.coverage.unseen());
        self.proposals.end_cycle(now, self.remaining_m, &mut self.events);
    }

    /// The cycle without the events about proposals. Returns whether plans to the goal are made.
    fn advance(&mut self, now: Timestamp, inputs: &PlannerInputs<'_>, route: &mut Route) -> bool {
        self.route_id += 1;
        *route = Route {
            id: self.route_id,
            ..Route::default()
        };
        let new_map = self.load_map(inputs);
        let Some(state) = inputs.state.fresh() else {
            return false; // I4: without a state nothing new is committed; Keep.
        };
        if state.mode_pending.is_set() {
            return false; // The gateway has just been restarted: the committed trajectory continues.
        }
        self.watch_sensors(now, &state, inputs.map.fresh().map(|map| map.sample));
        let Some(desired) = self.desired_path(&state, inputs) else {
            route.mode = Coded::new(RouteMode::Mirror);
            self.planned_goal = None;
            self.search.reset();
            self.progress.reset();
            self.failing_since = None;
            return false;
        };
        let Some(desired) = desired else {
            return false; // The desired path is stale: keep what is committed.
        };
        let goal = self.clamped_goal(&desired, &state);
        let committed = inputs.approved.map(|approved| &approved.trajectory);
        let departure = departure(now, committed, &state);
        let blocked = self.is_blocked(now, committed);
        let must_leave = blocked || departure.is_unplanned_motion();
        route.goal = goal;
        if inputs.map.fresh().is_none_or(|map| !map.ranges_fresh.is_set()) || !state.position_valid.is_set() {
            self.progress.pause(now);
            if must_leave {
                self.stop_or_brake(now, &departure, route);
            }
            return false; // I4: without ranges the committed trajectory runs to its own stop.
        }
        if let Some(map) = inputs.map.fresh() {
            self.update_top_tier(map.live_sensors);
        }
        let goal_moved = self
            .planned_goal
            .is_none_or(|old| (old.vector() - goal.vector()).norm() > 0.1);
        if goal_moved {
            self.obstruction = None;
            self.remaining_m = None;
            self.retry = now;
            self.viewpoints.reset();
        }
        let mut planning = true;
        if is_at(&departure.state, &goal) {
            planning = false;
            let off_m = (desired.points[1].position.z_m - goal.z_m).abs();
            self.obstruction = (off_m > HEIGHT_OFF_M).then_some(Obstruction::Height);
            self.remaining_m = Some(off_m);
            self.report_path(now, true, &state, &goal);
        } else if !must_leave && self.stops_first(&departure, &desired, &goal) {
            planning = false;
            if !committed.is_some_and(is_stop) {
                self.stop_certified(&departure, route);
            }
            self.report_path(now, true, &state, &goal);
        } else if goal_moved
            || must_leave && !self.is_planned_on_this_map(committed)
            || now >= self.retry && (new_map || self.failing_since.is_some())
        {
            let requested = &desired.points[1].position;
            let heights_m = self.down_range_m(&state);
            self.proposals.admit(now, must_leave, requested, heights_m);
            self.update_detours(inputs, &departure, &goal);
            let planned = self.plan(&departure, &desired, &goal, committed, must_leave, route);
            if !planned && departure.is_at_rest() {
                self.retry = now.plus_seconds(RETRY_S);
            }
            self.report_path(now, planned, &state, &goal);
            if planned {
                self.planned_id = route.id;
            }
            if !planned && must_leave {
                self.stop_or_brake(now, &departure, route);
            }
        }
        self.check_progress(now, &state, &goal, &desired.points[1].position);
        route.must_leave = Flag::from(must_leave);
        self.report_blocked(blocked);
        planning
    }

    /// Whether the last plan on this map is being flown: the near part of it may still be too close to the obstacle
    /// that is to be left.
    fn is_planned_on_this_map(&self, committed: Option<&Trajectory>) -> bool {
        self.planned_id != 0 && committed.is_some_and(|committed| committed.route_id == self.planned_id)
    }

    fn load_map(&mut self, inputs: &PlannerInputs<'_>) -> bool {
        let Some(map) = inputs.map.fresh() else {
            return false;
        };
        if map.header.publish == self.map_publish {
            return false;
        }
        self.map_publish = map.header.publish;
        self.planned_id = 0;
        self.space.load(map.sample);
        self.view = map.view;
        true
    }

    /// Updates the detours to `goal` from the far map, if there is one of the same epoch as the map.
    fn update_detours(&mut self, inputs: &PlannerInputs<'_>, departure: &Departure, goal: &Point<LocalNed>) {
        let epoch = inputs.map.fresh().map(|map| map.sample.epoch);
        match inputs.far.fresh().filter(|far| Some(far.sample.epoch) == epoch) {
            Some(far) => {
                let here = &departure.state.position;
                let sees_all_around = self.view.is_all_around();
                self.search.detours_mut().make(
                    far.sample,
                    far.header.publish.ns,
                    goal,
                    here,
                    sees_all_around,
                );
            }
            None => self.search.detours_mut().reset(),
        }
    }

    /// What only one sensor has seen becomes old sooner where it does not look, so there is less time to stop.
    fn update_top_tier(&mut self, live: u16) {
        let top_tier = if live < self.sensors { DEGRADED_TIER } else { 0 };
        if top_tier == self.top_tier {
            return;
        }
        self.top_tier = top_tier;
        let event = if top_tier > 0 {
            &events::SENSOR_LOST
        } else {
            &events::SENSOR_BACK
        };
        let numbers = [f64::from(live), f64::from(self.sensors)];
        self.events.push(EventSample::new(event, "planner", numbers));
    }

    /// `None`: mirror. `Some(None)`: plan, but the desired path is stale. `Some(Some(_))`: plan.
    fn desired_path(
        &mut self,
        state: &VehicleState,
        inputs: &PlannerInputs<'_>,
    ) -> Option<Option<DesiredPath>> {
        let desired = inputs.desired.fresh();
        if let Some(desired) = &desired {
            self.follows_setpoints = desired.mode.get() == NavMode::Offboard;
        }
        let planned_mode = match state.mode.get() {
            // Setpoints of another program may be followed as well.
            NavMode::Offboard => self.follows_setpoints,
            mode => mode.is_automatic(),
        };
        if !planned_mode || !state.armed.is_set() {
            return None;
        }
        match desired {
            // It belongs to the mode before; that of this mode comes next.
            Some(desired) if desired.mode.get().is_automatic() && desired.mode != state.mode => Some(None),
            Some(desired) => desired.wants_planning().then_some(Some(*desired.sample)),
            None => Some(None),
        }
    }

    /// The waypoint, kept between the heights allowed.
    fn clamped_goal(&self, desired: &DesiredPath, state: &VehicleState) -> Point<LocalNed> {
        let waypoint = desired.points[1].position;
        let (highest_m, lowest_m) = self.down_range_m(state);
        Point::new(
            waypoint.x_m,
            waypoint.y_m,
            waypoint.z_m.clamp(highest_m, lowest_m),
        )
    }

    /// Smallest and largest down coordinate allowed (m). Never empty: two parameters that contradict each other leave
    /// the greatest height.
    fn down_range_m(&self, state: &VehicleState) -> (f64, f64) {
        let home_m = if state.home_down_m.is_finite() {
            state.home_down_m
        } else {
            0.0
        };
        let (highest_m, lowest_m) = (home_m - self.height_range_m.1, home_m - self.height_range_m.0);
        (highest_m, lowest_m.max(state.position.z_m).max(highest_m))
    }

    /// Whether an obstacle has come into the tube of the committed trajectory from `now` on.
    fn is_blocked(&mut self, now: Timestamp, committed: Option<&Trajectory>) -> bool {
        let Some(committed) = committed.filter(|trajectory| is_flown(trajectory)) else {
            return false;
        };
        if !self.space.is_loaded() {
            return false;
        }
        let end = committed.end();
        // At rest there is no tracking error.
        let tier = if now < end {
            self.tier_of(committed.limits.tube_m)
        } else {
            LAST_TIER
        };
        let mut time = now;
        loop {
            let Some(state) = committed.at(time) else {
                return false;
            };
            if self.is_hit(tier, &state.position.vector()) {
                return true;
            }
            if time >= end {
                return false;
            }
            time = time.plus_seconds(RECHECK_STEP_S).min(end);
        }
    }

    /// Whether an obstacle is known too near to `place` for `tier`. Half cells are checked only where whole ones do not
    /// suffice.
    fn is_hit(&mut self, tier: usize, place: &Vector3<f64>) -> bool {
        (tier.min(CRAWL_TIER)..=tier).all(|tier| {
            self.space.prepare(tier);
            self.space.is_hit_at(tier, place)
        })
    }

    /// The widest speed tier whose tube is not wider than `tube_m`.
    fn tier_of(&self, tube_m: f64) -> usize {
        self.limits
            .iter()
            .position(|limits| limits.tube_m <= tube_m + 1e-9)
            .unwrap_or(LAST_TIER)
    }

    /// Finds the best path over the speed tiers and writes a plan along it into `route`; `false` if there is none.
    ///
    /// A path may need a low speed tier somewhere (a gap) and still be flown in a higher one up to there: for each
    /// tier's path the guide is cut where the flown tier stops being safe, and the lower tier takes over when the
    /// vehicle is slow enough. A vehicle that is not slow enough yet slows down first, rather than take another path
    /// that is much longer.
    fn plan(
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
                if self.move_to_viewpoint_crawling(departure, desired, goal, committed, route) {
                    return true;
                }
                self.space.set_departure(&start, LAST_TIER, is_creeping, has_plan);
                return self.plan_escape(departure, desired, route);
            };
            self.search.swap_path(&mut self.crawl_path);
            let target_is_goal = self.build_guide(flown, departure, goal, &found);
            return self.write_plan(flown, departure, desired, target_is_goal, route);
        }
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
            // A viewpoint could only reveal a longer path.
            Some(last) if last.time_s + SLOWING_S < seen_s => 0,
            Some(_) => VIEWPOINTS_BEFORE_CRAWLING,
            None => usize::MAX,
        };
        if best.is_none()
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
            return self.move_to_viewpoint_crawling(departure, desired, goal, committed, route);
        };
        let PathChoice { flown, found, .. } = chosen;
        if best.is_none() {
            self.search.swap_path(&mut self.crawl_path);
        } else {
            self.search.swap_path(&mut self.best_path);
        }
        let target_is_goal = self.build_guide(flown, departure, goal, &found);
        if self.progress.is_blocked() && !target_is_goal && !departure.is_unplanned_motion() {
            // Once the goal counts as out of reach, the vehicle departs only for a path that is known to its end, or
            // where there was none before.
            let is_open_now = found.end != PathEnd::NearestPoint
                && matches!(
                    self.blocked_by,
                    Some(Obstruction::Occupied | Obstruction::Enclosed)
                );
            if !is_open_now {
                return false;
            }
            self.progress.reset();
        }
        self.search.prefer_path(&self.space);
        if let Some((slow_s, way)) = too_fast_for
            && chosen.time_s < DEAD_END_S
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
        match self.check_heading(departure) {
            HeadingCheck::Aligned => self.write_plan(flown, departure, desired, target_is_goal, route),
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
            GUIDE_MAX_M,
            self.creep.overshoot_m,
        );
        self.write_plan(tier, departure, desired, false, route)
    }

    fn build_guide(
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
            GUIDE_MAX_M,
            self.limits[tier].overshoot_m,
        )
    }

    fn write_plan(
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
        route.limits = if self.space.narrow_tier() == Some(tier) {
            self.creep
        } else {
            self.limits[tier]
        };
        if desired.mission_speed_mps.is_finite() {
            route.limits.speed_mps = route.limits.speed_mps.min(desired.mission_speed_mps.max(0.3));
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
        if let Some(stop) = stops::certified(&self.space, tier, &departure.state) {
            route.stop = stop;
            route.has_stop = Flag::YES;
        }
        true
    }

    fn report_path(&mut self, now: Timestamp, planned: bool, state: &VehicleState, goal: &Point<LocalNed>) {
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
    fn check_progress(
        &mut self,
        now: Timestamp,
        state: &VehicleState,
        goal: &Point<LocalNed>,
        requested: &Point<LocalNed>,
    ) {
        let away_m = (state.position.vector() - goal.vector()).norm();
        if away_m <= self.goal_radius_m && self.obstruction != Some(Obstruction::Height) {
            self.progress.reset();
            return;
        }
        let has_detour = self.obstruction.is_none();
        let detour_mps = if has_detour {
            self.limits[DEGRADED_TIER].speed_mps
        } else {
            0.0
        };
        if self.proposals.is_flown() {
            self.progress.pause(now);
        }
        if self.progress.step(now, goal, self.remaining_m, detour_mps) {
            let why = self.obstruction.unwrap_or(Obstruction::Unseen);
            self.blocked_by = Some(why);
            let away_m = (state.position.vector() - requested.vector()).norm();
            let event = EventSample::new(&events::GOAL_BLOCKED, why.text(), [away_m, 0.0]);
            self.events.push(event);
        }
    }

    fn report_blocked(&mut self, blocked: bool) {
        if blocked && !self.blocked_reported {
            self.report_event(&events::COMMITMENT_CHANGED);
        }
        self.blocked_reported = blocked;
    }

    fn report_event(&mut self, event: &events::Event) {
        self.events.push(EventSample::new(event, "planner", [0.0, 0.0]));
    }
}

/// A reference slower than this rests (m/s).
const RESTING_MPS: f64 = 0.05;

/// Whether the reference rests at `goal` already.
fn is_at(reference: &MotionState, goal: &Point<LocalNed>) -> bool {
    const HERE_M: f64 = 0.05;
    (reference.position.vector() - goal.vector()).norm() < HERE_M
        && reference.velocity.vector().norm() < RESTING_MPS
}

/// Whether a trajectory is one the vehicle flies (not a mirrored or an empty one).
fn is_flown(trajectory: &Trajectory) -> bool {
    trajectory.mode.get() != TrajectoryMode::Mirror && trajectory.is_sound()
}

/// Where the next plan departs from: the committed trajectory a little ahead, or the vehicle at its extrapolated
/// position; at rest where it stands if it hardly moves.
fn departure(now: Timestamp, committed: Option<&Trajectory>, state: &Stamped<'_, VehicleState>) -> Departure {
    let splice = now.plus_seconds(SPLICE_LEAD_S);
    if let Some(committed) = committed.filter(|trajectory| is_flown(trajectory))
        && let Some(reference) = committed.at(splice)
    {
        return Departure {
            base_id: committed.id,
            splice,
            state: reference,
        };
    }
    let mut start = MotionState::at_rest(state.position, state.attitude.yaw_rad());
    let velocity = state.velocity.vector();
    if velocity.norm() > MOVING_MPS {
        let ahead_s = splice.seconds_since(state.header.capture);
        start.position = Point::from_vector(state.position.vector() + velocity * ahead_s);
        start.velocity = state.velocity;
    }
    Departure {
        base_id: 0,
        splice,
        state: start,
    }
}
