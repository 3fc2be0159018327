//! Turns map and desired path into a route with a certified corridor. No motion is planned that does not end at rest in
//! space known to be free.
//!
//! | in | out |
//! |---|---|
//! | local map, what moves in it, vehicle state, desired path, the trajectory being flown | [`Route`], events |
//! | a path that another program proposes | its answer |
//!
//! In every cycle the planner checks the committed trajectory. If the newest map shows an obstacle in its tube (rule
//! I3), the trajectory must be left: by a new plan, else by a certified stop, else by braking as hard as allowed.
//! Otherwise a new plan is made for every new map, and once more on the same map only if none was found or if what must
//! be left is still being flown. A plan departs from the state that the committed trajectory will have in
//! [`SPLICE_LEAD_S`](jink_shared_types::motion::SPLICE_LEAD_S), and replaces it only if it is certified (rule I2). Without
//! fresh ranges or a valid state nothing new is committed (rule I4).
//!
//! A vehicle that is to rest at a place (a hold, a landing) and is too fast to stop there stops first and comes back
//! from rest. A goal that cannot be reached (an obstacle, a closed wall, a height that is not allowed) is approached as
//! far as that is safe; there the vehicle rests, and after OA_BLOCKED_T without `progress` the reason is reported to
//! the gateway and the pilot. Time in which the guard is silent does not count.
//!
//! What moves is kept out of the way of by its prediction: a plan leads past the places where the vehicle could meet
//! it, a committed trajectory that would is left like a blocked one, and a vehicle at rest gives way
//! (`evasion`). That is no part of the certificate, whose obstacles stand still: who moves may turn.
//!
//! A plan is a guide through the inflated map (`search`), cut where known-free space ends (`guide`), and convex
//! pieces of certified space around it (`corridor`), in the highest [speed tier](mod@speed_tiers) that is worth it.
//! The guide may also be one that another program proposes (`proposed_path`).

mod bit_layer;
mod certified_route;
mod committed_trajectory;
pub mod configuration_space;
mod corridor;
mod departure;
mod detours;
mod evasion;
mod following;
mod goal;
mod guide;
mod landing;
mod map_inputs;
mod moving;
mod path_choice;
mod planning;
mod progress;
mod proposals;
mod proposed_path;
mod reports;
mod search;
mod sensor_coverage;
mod service;
pub mod speed_tiers;
mod stopping;
mod stops;
mod tracking;
mod unflown;
mod viewpoint_moves;
mod viewpoints;

pub use service::PlannerService;

use crate::configuration_space::{Clearance, ConfigurationSpace};
use crate::corridor::CorridorBuilder;
use crate::departure::{departure, is_at};
use crate::following::Following;
use crate::guide::Guide;
use crate::moving::Predictions;
use crate::path_choice::FoundPaths;
use crate::progress::{GoalProgress, Obstruction};
use crate::proposals::Proposals;
use crate::search::{Path, Search};
use crate::sensor_coverage::SensorCoverage;
use crate::speed_tiers::{CRAWL_TIER, TIERS, creep, speed_tiers};
use crate::stopping::is_stop;
use crate::unflown::UnflownPlans;
use crate::viewpoints::Viewpoints;
use jink_shared_types::events::EventSample;
use jink_shared_types::far_map::FarMap;
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::map::LocalMap;
use jink_shared_types::motion::{ApprovedTrajectory, MotionLimits, Route, RouteMode};
use jink_shared_types::moving::MovingObstacles;
use jink_shared_types::params::{self, ParamSet};
use jink_shared_types::proposal::{Proposal, ProposalAnswer};
use jink_shared_types::tracking::Tracking;
use jink_shared_types::vehicle::{DesiredPath, VehicleState};
use jink_shared_types::view::FieldOfView;
use jink_shared_types::{Coded, Flag, Reading, Timestamp};

/// Where no path is known, the search is repeated at this period (s): every search that fails expands as much as it
/// may.
const RETRY_S: f64 = 0.5;
/// A height that differs by this from the requested one is another one (m): PX4 accepts up to 0.8 m (NAV_MC_ALT_RAD).
const HEIGHT_OFF_M: f64 = 0.7;

/// The planner's inputs.
#[derive(Clone, Copy, Debug)]
pub struct PlannerInputs<'a> {
    /// The newest map.
    pub map: Reading<'a, LocalMap>,
    /// Obstacles farther away, and what was seen before.
    pub far: Reading<'a, FarMap>,
    /// What moves in the map.
    pub moving: Reading<'a, MovingObstacles>,
    /// The vehicle.
    pub state: Reading<'a, VehicleState>,
    /// The path that the autopilot wants.
    pub desired: Reading<'a, DesiredPath>,
    /// The trajectory being flown, however old: it outlives its producer.
    pub approved: Option<&'a ApprovedTrajectory>,
    /// The guard has not approved anything for longer than it may: nothing that is planned is flown.
    pub is_guard_silent: bool,
    /// A path that another program proposes.
    pub proposal: Reading<'a, Proposal>,
}

/// The planner.
#[derive(Debug)]
pub struct Planner {
    params: ParamSet,
    /// How closely the autopilot follows; the loosest before that is known.
    tracking: Tracking,
    /// What is known of the profile that is flown; `None` before that is known.
    profile_tracking: Option<Tracking>,
    following: Following,
    /// When what is learned may be reported again.
    learned_after: Timestamp,
    /// The speed that plans reach, and the one that is allowed, as reported (m/s).
    speed_reported: Option<[f64; 2]>,
    limits: [MotionLimits; TIERS],
    /// The limits on the way out of a place that is too narrow for every speed tier.
    creep: MotionLimits,
    goal_radius_m: f64,
    height_range_m: (f64, f64),
    yaw_along_path: bool,
    space: ConfigurationSpace,
    moving: Predictions,
    /// What moves is taken out of the map.
    moving_hidden: bool,
    /// The last route out of the way of something; 0 = none yet.
    evasion_id: u64,
    /// When that was reported.
    evasion_reported: Timestamp,
    search: Search,
    found: FoundPaths,
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
    landing_reported: bool,
    /// An obstacle stood in the straight way then.
    detour_seen: Timestamp,
    /// The vehicle has been away from its goal since it was at one.
    is_away: bool,
    loss_reported_at: Timestamp,
    progress: GoalProgress,
    unflown: UnflownPlans,
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
    /// The speed tier of the path that the last plan follows; `None` if it follows none.
    path_followed: Option<usize>,
    /// The last route that was a turn before a motion; 0 = none yet.
    turn_id: u64,
    view: FieldOfView,
    /// The last desired path was for setpoints that the autopilot follows.
    follows_setpoints: bool,
    proposals: Proposals,
    events: Vec<EventSample>,
}

impl Planner {
    /// A planner with the given parameters; `generation` keeps its route ids apart from those of earlier starts.
    pub fn new(params: &ParamSet, generation: u32) -> Self {
        let tracking = Tracking::PX4_TRAJECTORY;
        let limits = speed_tiers(params, &tracking);
        let clearance = Clearance::from_params(params);
        Self {
            coverage: SensorCoverage::new(params, clearance.footprint_m + limits[CRAWL_TIER].tube_m),
            params: params.clone(),
            tracking,
            profile_tracking: None,
            following: Following::default(),
            learned_after: Timestamp::NEVER,
            speed_reported: None,
            limits,
            creep: creep(params, &tracking),
            goal_radius_m: params.get(&params::OA_GOAL_RAD),
            height_range_m: (params.get(&params::OA_ALT_MIN), params.get(&params::OA_ALT_MAX)),
            yaw_along_path: params.get(&params::OA_YAW_MODE) == 1.0,
            space: ConfigurationSpace::new(&limits, clearance),
            moving: Predictions::new(),
            moving_hidden: false,
            evasion_id: 0,
            evasion_reported: Timestamp::NEVER,
            search: Search::default(),
            found: FoundPaths::default(),
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
            landing_reported: false,
            detour_seen: Timestamp::NEVER,
            is_away: false,
            loss_reported_at: Timestamp::NEVER,
            progress: GoalProgress::new(params.get(&params::OA_BLOCKED_T)),
            unflown: UnflownPlans::default(),
            obstruction: None,
            blocked_by: None,
            remaining_m: None,
            retry: Timestamp::NEVER,
            viewpoints: Viewpoints::default(),
            path_tier: 0,
            path_followed: None,
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
        self.params.clone_from(params);
        self.update_limits();
        self.goal_radius_m = params.get(&params::OA_GOAL_RAD);
        self.height_range_m = (params.get(&params::OA_ALT_MIN), params.get(&params::OA_ALT_MAX));
        self.yaw_along_path = params.get(&params::OA_YAW_MODE) == 1.0;
        // A refusal on this map may have been due to the old values.
        self.map_publish = Timestamp::NEVER;
    }

    fn update_limits(&mut self) {
        self.limits = speed_tiers(&self.params, &self.tracking);
        self.creep = creep(&self.params, &self.tracking);
        let clearance = Clearance::from_params(&self.params);
        self.space.fit(&self.limits, clearance.standoff_m);
    }

    /// Sets the number of range sensors of the vehicle: while only some of them contribute to the map, it flies in what
    /// they see, and slower.
    pub fn with_sensors(mut self, sensors: u16) -> Self {
        self.sensors = sensors;
        self
    }

    /// Adds the directions at which one of them looks by its model.
    pub fn with_nominal_view(mut self, view: &FieldOfView) -> Self {
        self.coverage.add_nominal(view);
        self
    }

    /// The events of the last step for the pilot.
    pub fn events(&self) -> &[EventSample] {
        &self.events
    }

    /// How closely plans assume that the vehicle follows.
    pub fn tracking(&self) -> Tracking {
        self.tracking
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
        if self.profile_tracking.is_some() {
            route.tracking = self.tracking;
            [route.reached_mps, route.allowed_mps] = self.speeds_mps().map(|speed_mps| speed_mps as f32);
        }
        self.proposals.end_cycle(now, self.remaining_m, &mut self.events);
    }

    /// The cycle without the events about proposals. Returns whether plans to the goal are made.
    fn advance(&mut self, now: Timestamp, inputs: &PlannerInputs<'_>, route: &mut Route) -> bool {
        self.route_id += 1;
        *route = Route {
            id: self.route_id,
            ..Route::default()
        };
        self.moving.load(inputs.moving.fresh());
        let new_map = self.load_map(inputs);
        self.space.unpaint();
        let Some(state) = inputs.state.fresh() else {
            return false; // I4: without a state nothing new is committed; Keep.
        };
        if state.mode_pending.is_set() {
            return false; // The gateway has just been restarted: the committed trajectory continues.
        }
        self.take_tracking(&state);
        self.learn(&state, inputs.approved);
        self.watch_sensors(now, &state, inputs.map.fresh().map(|map| map.sample));
        self.watch_landing(
            &state,
            inputs.map.fresh().filter(|_| new_map).map(|map| map.sample),
        );
        let Some(desired) = self.desired_path(&state, inputs) else {
            route.mode = Coded::new(RouteMode::Mirror);
            self.planned_goal = None;
            self.search.reset();
            self.progress.reset();
            self.unflown.reset();
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
        let is_evading = self.is_evading(now, committed);
        let meets = !is_evading && self.meets_something(now, committed);
        let must_stop = blocked || departure.is_unplanned_motion();
        let must_leave = must_stop || meets;
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
            self.search.forget_failed_passages();
            self.path_followed = None;
        }
        let away_m = (departure.state.position.vector() - goal.vector()).norm();
        self.report_arrival(away_m, &desired);
        let mut planning = true;
        let evades =
            self.evades_first(now, &departure, committed) && self.evade(now, &departure, committed, route);
        if evades || is_evading && !must_leave {
            planning = false;
            self.progress.pause(now);
        } else if is_at(&departure.state, &goal) {
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
            self.update_detours(inputs, &departure, &goal, false);
            self.show_moving(inputs);
            let planned = self.plan(&departure, &desired, &goal, committed, must_leave, route);
            if !planned && departure.is_at_rest() {
                self.retry = now.plus_seconds(RETRY_S);
            }
            self.report_path(now, planned, &state, &goal);
            if planned {
                self.report_detour(now, &departure.state.position.vector(), &goal);
                self.planned_id = route.id;
                if route.mode != RouteMode::Keep {
                    self.unflown.give_out(route.id, now);
                }
            }
            if !planned && must_leave && !self.evade(now, &departure, committed, route) && must_stop {
                self.stop_or_brake(now, &departure, route);
            }
        } else {
            // Between two maps there is time for it.
            self.update_detours(inputs, &departure, &goal, true);
        }
        if inputs.is_guard_silent {
            self.progress.pause(now);
        }
        let is_unflown = self.unflown.are_there(now, committed);
        self.check_progress(now, &state, &goal, &desired.points[1].position, is_unflown);
        route.must_leave = Flag::from(must_leave);
        self.report_blocked(blocked || meets);
        planning
    }
}
