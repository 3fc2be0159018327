//! Map and desired path to a route with a certified corridor: never a motion that does not end at rest in space known to
//! be free.
//!
//! | in | out |
//! |---|---|
//! | local map, vehicle state, desired path, the trajectory being flown | [`Route`], events |
//! | a way that another program proposes | its answer |
//!
//! In every cycle the planner looks at what is committed. If the newest map shows an obstacle in its tube (rule I3), it
//! must be left: by a new plan, else by a certified stop, else by braking as hard as allowed. Otherwise a new plan is
//! made for every new map, and once more on the same map only if none was found or if what must be left is still being
//! flown. It departs from the state that the committed trajectory will have in [`SPLICE_LEAD_S`], and replaces it only if it
//! is certified (rule I2). Without fresh ranges or a valid state nothing new is committed (rule I4).
//!
//! Where the vehicle is to rest (a hold, a landing) and is too fast to come to rest there, it stops first and comes back from rest.
//! A goal that it cannot come to (an obstacle, a closed wall, a height that is not allowed) is approached as far as that is
//! safe; there it rests, and after OA_BLOCKED_T without [`progress`] the gateway and the pilot are told why.
//!
//! A plan is: a guide through the inflated map ([`search`]), cut where known-free space ends ([`guide`]), and convex
//! pieces of certified space around it ([`corridor`]); tried in the highest [gear](mod@gears) that is worth it. The guide may
//! also be one that another program proposes ([`proposed_way`]).

pub mod corridor;
mod far;
mod fitness;
pub mod gears;
pub mod guide;
pub mod layer;
mod looking;
pub mod looks;
pub mod progress;
mod proposals;
pub mod proposed_way;
pub mod search;
mod service;
pub mod space;
mod stopping;
pub mod stops;
mod ways;

pub use service::PlannerService;

use crate::corridor::CorridorBuilder;
use crate::fitness::Fitness;
use crate::gears::{CRAWL_GEAR, GEARS, LAST_GEAR, SLOW_GEAR, creep, gears};
use crate::guide::Guide;
use crate::looking::Before;
use crate::looks::Looks;
use crate::progress::{Obstruction, Progress};
use crate::proposals::Proposals;
use crate::search::{Found, Path, PathEnd, Search};
use crate::space::{Room, Space};
use crate::stopping::is_stop;
use crate::ways::{Choice, DEAD_END_S, is_near_enough};
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

/// How far ahead a new plan departs from the committed one (s): planning, curves, guard and their hand-overs take some
/// 10 ms; 100 ms leave room for a restart of any of them in between.
pub const SPLICE_LEAD_S: f64 = 0.10;
/// Longest guide (m): three seconds of flight and the stop behind them at the speeds the tubes allow; more would be
/// re-planned before it is flown.
const GUIDE_MAX_M: f64 = 11.0;
/// Highest gear while a range sensor is silent: half the speed.
const DEGRADED_GEAR: usize = 1;

// A plan that gains less than this is not worth committing (m).
const PROGRESS_MIN_M: f64 = 0.25;
/// Lower gears are looked at when the way in the higher one is this much dearer than the straight line.
const DETOUR_WORTH_A_GEAR: f32 = 1.25;
/// Time that a way in a lower gear must save to slow down for it, rather than take another one at once (s).
const SLOWING_S: f64 = 2.0;
/// Looks for a way in a higher gear, and turns toward the ways to them, in a minute, before a way in the lowest gears is taken.
const LOOKS_BEFORE_CRAWLING: usize = 2;
/// How long planning must fail while the vehicle stands before the pilot is told (s).
const NO_PATH_AFTER_S: f64 = 1.5;
/// A vehicle that nobody has planned for and that is faster than this is in motion (m/s): slower, its way to rest stays
/// within the tube.
const MOVING_MPS: f64 = 0.5;
/// Distance between two looks at the committed trajectory (s).
const RECHECK_STEP_S: f64 = 0.03;
/// Where no way is known, it is looked for so often (s): every search that fails expands all it may.
const RETRY_S: f64 = 0.5;
/// A vehicle that is to rest, in a place that is narrow only because not all around it is known, stays where it is if the place to
/// rest at is no farther than this (m): a take-off that ends below its height, a hold in a gust.
const NEAR_REST_M: f64 = 1.0;
/// A height that is this far from the one asked for is another one (m): PX4 accepts up to 0.8 m (NAV_MC_ALT_RAD).
const HEIGHT_OFF_M: f64 = 0.7;

/// What the planner reads.
#[derive(Clone, Copy, Debug)]
pub struct Inputs<'a> {
    /// The newest map.
    pub map: Reading<'a, LocalMap>,
    /// What stands farther away, and what was seen before.
    pub far: Reading<'a, FarMap>,
    /// The vehicle.
    pub state: Reading<'a, VehicleState>,
    /// What the autopilot wants.
    pub desired: Reading<'a, DesiredPath>,
    /// What is being flown, however old: it outlives its producer.
    pub approved: Option<&'a ApprovedTrajectory>,
    /// A way that another program proposes.
    pub proposal: Reading<'a, Proposal>,
}

/// The planner.
#[derive(Debug)]
pub struct Planner {
    limits: [MotionLimits; GEARS],
    /// Those on the way out of a place that is too narrow for every gear.
    creep: MotionLimits,
    goal_radius_m: f64,
    height_range_m: (f64, f64),
    yaw_along_path: bool,
    space: Space,
    search: Search,
    best_path: Path,
    /// The same in the lowest gears.
    last_path: Path,
    guide: Guide,
    corridor: CorridorBuilder,
    /// Range sensors that should contribute to the map; 0 = not known.
    sensors: u16,
    /// The highest gear that may be flown with those that do.
    top_gear: usize,
    route_id: u64,
    /// The last plan on this map; 0 = none yet.
    planned_id: u64,
    map_publish: Timestamp,
    /// The goal that was planned to last, in vain or not.
    planned_goal: Option<Point<LocalNed>>,
    failing_since: Option<Timestamp>,
    no_path_told: bool,
    blocked_told: bool,
    lost_told: Timestamp,
    progress: Progress,
    /// Why the goal was not reached by the last plan.
    obstruction: Option<Obstruction>,
    /// The same when the goal was told to be out of reach.
    blocked_by: Option<Obstruction>,
    /// Price of the way that was found last (m); `None` none was.
    left_m: Option<f64>,
    retry: Timestamp,
    fitness: Fitness,
    looks: Looks,
    /// The gear of the way that was planned last.
    way_gear: usize,
    /// The last route that was a turn before a motion; 0 = none yet.
    turn_id: u64,
    view: FieldOfView,
    /// The last wish was for setpoints that the autopilot follows.
    sets_points: bool,
    proposals: Proposals,
    events: Vec<EventSample>,
}

/// A committed motion, or the vehicle as it moves or rests: where the next plan departs from.
#[derive(Clone, Copy, Debug)]
struct Departure {
    base_id: u64,
    splice: Timestamp,
    state: MotionState,
}

impl Departure {
    /// Whether the vehicle moves without a plan, as when a pilot hands over in flight: if none is found it must be stopped.
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
        let limits = gears(params);
        let room = Room::from_params(params);
        Self {
            fitness: Fitness::new(params, room.body_m + limits[CRAWL_GEAR].tube_m),
            limits,
            creep: creep(params),
            goal_radius_m: params.get(&params::OA_GOAL_RAD),
            height_range_m: (params.get(&params::OA_ALT_MIN), params.get(&params::OA_ALT_MAX)),
            yaw_along_path: params.get(&params::OA_YAW_MODE) == 1.0,
            space: Space::new(&limits, room),
            search: Search::default(),
            best_path: Path::default(),
            last_path: Path::default(),
            guide: Guide::default(),
            corridor: CorridorBuilder::default(),
            sensors: 0,
            top_gear: 0,
            route_id: u64::from(generation) << 32,
            planned_id: 0,
            map_publish: Timestamp::NEVER,
            planned_goal: None,
            failing_since: None,
            no_path_told: false,
            blocked_told: false,
            lost_told: Timestamp::NEVER,
            progress: Progress::new(params.get(&params::OA_BLOCKED_T)),
            obstruction: None,
            blocked_by: None,
            left_m: None,
            retry: Timestamp::NEVER,
            looks: Looks::default(),
            way_gear: 0,
            turn_id: 0,
            view: FieldOfView::default(),
            sets_points: false,
            proposals: Proposals::default(),
            events: Vec::with_capacity(8),
        }
    }

    /// Takes the parameters that apply at once; the others must be those of the start. Nothing that was learned is
    /// forgotten, and what is committed stays: it was certified within the limits that it carries. A vehicle that is faster
    /// than a new limit allows flies its commitment to its end, at rest, and goes on from there.
    pub fn retune(&mut self, params: &ParamSet) {
        self.limits = gears(params);
        self.creep = creep(params);
        self.space.keep(&self.limits, Room::from_params(params));
        self.goal_radius_m = params.get(&params::OA_GOAL_RAD);
        self.height_range_m = (params.get(&params::OA_ALT_MIN), params.get(&params::OA_ALT_MAX));
        self.yaw_along_path = params.get(&params::OA_YAW_MODE) == 1.0;
        // A refusal on this map may have been one of the old values.
        self.map_publish = Timestamp::NEVER;
    }

    /// The same for a vehicle with so many range sensors: while only some of them contribute to the map it flies on
    /// in what they see, and slower.
    pub fn with_sensors(mut self, sensors: u16) -> Self {
        self.sensors = sensors;
        self
    }

    /// What happened in the last step that a pilot should know.
    pub fn events(&self) -> &[EventSample] {
        &self.events
    }

    /// What became of the way that is proposed, if that is to be said after the last step.
    pub fn proposal_answer(&self) -> Option<&ProposalAnswer> {
        self.proposals.answer()
    }

    /// One cycle at `now`; the answer is written into `route`.
    pub fn step(&mut self, now: Timestamp, inputs: &Inputs<'_>, route: &mut Route) {
        self.events.clear();
        let committed = inputs.approved.map(|approved| &approved.trajectory);
        self.proposals.take(&inputs.proposal, committed);
        if !self.advance(now, inputs, route) {
            self.proposals.not_planning();
        }
        route.unseen = Coded::new(self.fitness.unseen());
        self.proposals.conclude(now, self.left_m, &mut self.events);
    }

    /// The cycle without what is said about proposals. Returns whether plans to the goal are made.
    fn advance(&mut self, now: Timestamp, inputs: &Inputs<'_>, route: &mut Route) -> bool {
        self.route_id += 1;
        *route = Route {
            id: self.route_id,
            ..Route::default()
        };
        let new_map = self.take_map(inputs);
        let Some(state) = inputs.state.fresh() else {
            return false; // I4: without a state nothing new; Keep.
        };
        if state.mode_pending.is_set() {
            return false; // The gateway has just been restarted: what is flown goes on.
        }
        self.watch_sensors(now, &state, inputs.map.fresh().map(|map| map.sample));
        let Some(desired) = self.wanted(&state, inputs) else {
            route.mode = Coded::new(RouteMode::Mirror);
            self.planned_goal = None;
            self.search.forget();
            self.progress.forget();
            self.failing_since = None;
            return false;
        };
        let Some(desired) = desired else {
            return false; // The wish is late: keep what is committed.
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
                self.leave(now, &departure, route);
            }
            return false; // I4: blind, the committed trajectory runs to its own stop.
        }
        if let Some(map) = inputs.map.fresh() {
            self.judge_sensors(map.live_sensors);
        }
        let goal_moved = self
            .planned_goal
            .is_none_or(|old| (old.vector() - goal.vector()).norm() > 0.1);
        if goal_moved {
            self.obstruction = None;
            self.left_m = None;
            self.retry = now;
            self.looks.forget();
        }
        let mut planning = true;
        if is_at(&departure.state, &goal) {
            planning = false;
            let off_m = (desired.points[1].position.z_m - goal.z_m).abs();
            self.obstruction = (off_m > HEIGHT_OFF_M).then_some(Obstruction::Height);
            self.left_m = Some(off_m);
            self.report(now, true, &state, &goal);
        } else if !must_leave && self.stops_first(&departure, &desired, &goal) {
            planning = false;
            if !committed.is_some_and(is_stop) {
                self.stop_certified(&departure, route);
            }
            self.report(now, true, &state, &goal);
        } else if goal_moved
            || must_leave && !self.is_heeded(committed)
            || now >= self.retry && (new_map || self.failing_since.is_some())
        {
            let asked_for = &desired.points[1].position;
            let heights_m = self.down_range_m(&state);
            self.proposals.admit(now, must_leave, asked_for, heights_m);
            self.look_far(inputs, &departure, &goal);
            let planned = self.plan(&departure, &desired, &goal, committed, must_leave, route);
            if !planned && departure.is_at_rest() {
                self.retry = now.plus_seconds(RETRY_S);
            }
            self.report(now, planned, &state, &goal);
            if planned {
                self.planned_id = route.id;
            }
            if !planned && must_leave {
                self.leave(now, &departure, route);
            }
        }
        self.judge_progress(now, &state, &goal, &desired.points[1].position);
        route.must_leave = Flag::from(must_leave);
        self.tell_blocked(blocked);
        planning
    }

    /// Whether the last plan on this map is being flown: the near part of it may still lie too close to what is to be left.
    fn is_heeded(&self, committed: Option<&Trajectory>) -> bool {
        self.planned_id != 0 && committed.is_some_and(|committed| committed.route_id == self.planned_id)
    }

    fn take_map(&mut self, inputs: &Inputs<'_>) -> bool {
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

    /// Takes over what the far map says of the way to `goal`, if there is one that belongs to the map.
    fn look_far(&mut self, inputs: &Inputs<'_>, departure: &Departure, goal: &Point<LocalNed>) {
        let epoch = inputs.map.fresh().map(|map| map.sample.epoch);
        match inputs.far.fresh().filter(|far| Some(far.sample.epoch) == epoch) {
            Some(far) => {
                let here = &departure.state.position;
                let sees_all_around = self.view.is_all_around();
                self.search
                    .far_mut()
                    .make(far.sample, far.header.publish.ns, goal, here, sees_all_around);
            }
            None => self.search.far_mut().forget(),
        }
    }

    /// What one sensor alone has seen is old sooner where it does not look, so there is less time to stop in.
    fn judge_sensors(&mut self, live: u16) {
        let top_gear = if live < self.sensors { DEGRADED_GEAR } else { 0 };
        if top_gear == self.top_gear {
            return;
        }
        self.top_gear = top_gear;
        let event = if top_gear > 0 {
            &events::SENSOR_LOST
        } else {
            &events::SENSOR_BACK
        };
        let numbers = [f64::from(live), f64::from(self.sensors)];
        self.events.push(EventSample::new(event, "planner", numbers));
    }

    /// `None`: mirror. `Some(None)`: plan, but the wish is late. `Some(Some(_))`: plan.
    fn wanted(&mut self, state: &VehicleState, inputs: &Inputs<'_>) -> Option<Option<DesiredPath>> {
        let desired = inputs.desired.fresh();
        if let Some(desired) = &desired {
            self.sets_points = desired.mode.get() == NavMode::Offboard;
        }
        let planned_mode = match state.mode.get() {
            // Somebody else's setpoints may be followed as well.
            NavMode::Offboard => self.sets_points,
            mode => mode.is_automatic(),
        };
        if !planned_mode || !state.armed.is_set() {
            return None;
        }
        match desired {
            // Of the mode before: what is wanted in this one comes next.
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

    /// Smallest and largest down coordinate allowed (m). Never empty: two parameters that contradict each other leave the
    /// greatest height.
    fn down_range_m(&self, state: &VehicleState) -> (f64, f64) {
        let home_m = if state.home_down_m.is_finite() {
            state.home_down_m
        } else {
            0.0
        };
        let (highest_m, lowest_m) = (home_m - self.height_range_m.1, home_m - self.height_range_m.0);
        (highest_m, lowest_m.max(state.position.z_m).max(highest_m))
    }

    /// Whether an obstacle has come into the tube of what is committed from `now` on.
    fn is_blocked(&mut self, now: Timestamp, committed: Option<&Trajectory>) -> bool {
        let Some(committed) = committed.filter(|trajectory| is_flown(trajectory)) else {
            return false;
        };
        if !self.space.is_loaded() {
            return false;
        }
        let end = committed.end();
        // At rest nothing is strayed from.
        let gear = if now < end {
            self.gear_of(committed.limits.tube_m)
        } else {
            LAST_GEAR
        };
        let mut time = now;
        loop {
            let Some(state) = committed.at(time) else {
                return false;
            };
            if self.is_hit(gear, &state.position.vector()) {
                return true;
            }
            if time >= end {
                return false;
            }
            time = time.plus_seconds(RECHECK_STEP_S).min(end);
        }
    }

    /// Whether an obstacle is known too near to `place` for `gear`. Half cells are looked at only where whole ones do not do.
    fn is_hit(&mut self, gear: usize, place: &Vector3<f64>) -> bool {
        (gear.min(CRAWL_GEAR)..=gear).all(|gear| {
            self.space.prepare(gear);
            self.space.is_hit_at(gear, place)
        })
    }

    /// The widest gear whose tube is not wider than `tube_m`.
    fn gear_of(&self, tube_m: f64) -> usize {
        self.limits
            .iter()
            .position(|limits| limits.tube_m <= tube_m + 1e-9)
            .unwrap_or(LAST_GEAR)
    }

    /// Finds the best way over the gears and writes a plan along it into `route`; `false` if there is none.
    ///
    /// A way may need a low gear somewhere (a gap) and still be flown in a higher one up to there: for each gear's way the
    /// guide is cut where the flown gear stops being safe, and the lower gear takes over when the vehicle is slow enough. Where it is
    /// not yet, it becomes so first, rather than leave for a way that takes much longer.
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
        let creeps = departure.is_at_rest()
            || self.space.is_narrow() && speed_mps <= MotionLimits::allowed(self.creep.speed_mps);
        let has_plan = departure.base_id != 0;
        self.space.depart_from(&start, SLOW_GEAR, creeps, has_plan);
        if self.space.is_narrow() {
            if desired.is_to_rest()
                && (goal.vector() - start).norm() < NEAR_REST_M
                && !self.space.is_pressed()
            {
                // It may rest as well where it is: what is unknown around comes no nearer.
                return true;
            }
            self.proposals.evade();
            self.proposals.leave();
            if self.plan_way_out(departure, desired, route) {
                return true;
            }
            let Some(Choice { flown, found, .. }) = self.last_resort(departure, goal) else {
                if self.look_crawling(departure, desired, goal, committed, route) {
                    return true;
                }
                self.space.depart_from(&start, LAST_GEAR, creeps, has_plan);
                return self.plan_way_out(departure, desired, route);
            };
            self.search.swap_path(&mut self.last_path);
            let target_is_goal = self.build_guide(flown, departure, goal, &found);
            return self.write_plan(flown, departure, desired, target_is_goal, route);
        }
        let straight_m = (goal.vector() - start).norm()
            + f64::from(self.search.detour_m(cell_of(departure.state.position)));
        let mut best: Option<Choice> = None;
        // The time that a way would take (s) that the vehicle is too fast for, and the gear of it.
        let mut too_fast_for: Option<(f64, usize)> = None;
        let mut seen: Option<Found> = None;
        let mut next = Some(self.top_gear);
        while let Some(gear) = next {
            next = (gear < SLOW_GEAR).then_some(gear + 1);
            self.space.prepare(gear);
            let Some(found) = self.find(gear, departure, goal) else {
                continue;
            };
            let is_short = found.end == PathEnd::Nearest;
            if seen.is_none_or(|before| before.end == PathEnd::Nearest) {
                seen = Some(found);
            }
            let time_s = self.time_s(gear, &found);
            if best.is_none_or(|best| time_s < best.time_s)
                && !(is_short && is_near_enough(departure, goal, &found))
            {
                if let Some(flown) = self.flown_gear(gear, departure, goal, &found) {
                    best = Some(Choice {
                        time_s,
                        way: gear,
                        flown,
                        found,
                    });
                    self.search.swap_path(&mut self.best_path);
                } else if !self.can_begin(gear, departure) && self.space.is_safe_at(gear, &start) {
                    too_fast_for = Some((time_s, gear));
                }
            }
            let direct = !is_short && found.cost_m <= DETOUR_WORTH_A_GEAR * straight_m as f32;
            if best.is_some() && direct {
                break;
            }
            // Where the lowest gear of these finds no way, none between does.
            if is_short && gear == self.top_gear {
                next = next.map(|_| SLOW_GEAR);
            }
        }
        let crawls = committed.is_some_and(|committed| self.gear_of(committed.limits.tube_m) >= CRAWL_GEAR);
        let is_detour =
            |best: Choice| f64::from(best.found.cost_m) > f64::from(DETOUR_WORTH_A_GEAR) * straight_m;
        let mut last = None;
        if best.is_none_or(is_detour) && (departure.is_at_rest() || crawls) {
            last = self.last_resort(departure, goal);
        }
        let seen_s = seen.map_or(DEAD_END_S, |seen| self.time_s(self.top_gear, &seen));
        if let (Some(other), Some(crawling)) = (best, last) {
            if crawling.time_s + SLOWING_S < other.time_s {
                best = None;
            } else {
                last = None;
            }
        }
        if let Some(last) = last
            && last.found.end != PathEnd::Nearest
        {
            seen = Some(last.found);
        }
        self.left_m = seen.map(|found| f64::from(found.cost_m));
        let is_planned = best.is_some() || last.is_some();
        let falls_short = seen.is_none_or(|found| found.end == PathEnd::Nearest) || !is_planned;
        self.obstruction = falls_short.then(|| Obstruction::of(seen.as_ref()));
        if self.plan_proposed(departure, desired, goal, route) {
            return true;
        }
        if self.proposals.leave() && self.progress.is_blocked() {
            // It is somewhere else now, and looks anew from there.
            self.progress.forget();
        }
        let looks_max = match last {
            // What a look could show is a longer way.
            Some(last) if last.time_s + SLOWING_S < seen_s => 0,
            Some(_) => LOOKS_BEFORE_CRAWLING,
            None => usize::MAX,
        };
        if best.is_none() && self.look(SLOW_GEAR, looks_max, departure, desired, goal, committed, route) {
            return true;
        }
        let Some(chosen) = best.or(last) else {
            return self.look_crawling(departure, desired, goal, committed, route);
        };
        let Choice { flown, found, .. } = chosen;
        if best.is_none() {
            self.search.swap_path(&mut self.last_path);
        } else {
            self.search.swap_path(&mut self.best_path);
        }
        let target_is_goal = self.build_guide(flown, departure, goal, &found);
        if self.progress.is_blocked() && !target_is_goal && !departure.is_unplanned_motion() {
            // Once the goal counts as out of reach, only a way that is known to its end is worth leaving for, or one where
            // there was none.
            let is_open_now = found.end != PathEnd::Nearest
                && matches!(
                    self.blocked_by,
                    Some(Obstruction::Occupied | Obstruction::Enclosed)
                );
            if !is_open_now {
                return false;
            }
            self.progress.forget();
        }
        self.search.prefer_path(&self.space);
        if let Some((slow_s, way)) = too_fast_for
            && chosen.time_s < DEAD_END_S
            && slow_s + SLOWING_S < chosen.time_s
            && !must_leave
            && !departure.is_unplanned_motion()
        {
            // What is committed along the same way ends where that becomes narrow.
            if self.way_gear != way && !committed.is_some_and(is_stop) {
                self.stop_certified(departure, route);
            }
            return true;
        }
        self.way_gear = chosen.way;
        match self.before_motion(departure) {
            Before::Go => self.write_plan(flown, departure, desired, target_is_goal, route),
            Before::Turn(heading_rad) => {
                self.turn_first(departure, heading_rad, committed, route);
                true
            }
            Before::Stop => {
                if !committed.is_some_and(is_stop) {
                    self.stop_certified(departure, route);
                }
                true
            }
        }
    }

    /// Out of a place that is too narrow for a gear, to the nearest that is not; from there it is planned as ever. `false` if there is
    /// no such way, or the place is not too narrow.
    fn plan_way_out(&mut self, departure: &Departure, desired: &DesiredPath, route: &mut Route) -> bool {
        let Some(gear) = self.space.narrow_gear() else {
            return false;
        };
        let start = departure.state.position.vector();
        let here = self.space.cell_of(gear, &start);
        if !self.search.way_out(&self.space, gear, here) {
            return false;
        }
        let Some(end) = self.search.path().cells.last().copied() else {
            return false;
        };
        self.guide.build(
            &self.space,
            gear,
            &start,
            self.search.path(),
            Some(&self.space.center_of(gear, end)),
            GUIDE_MAX_M,
            self.creep.overshoot_m,
        );
        self.write_plan(gear, departure, desired, false, route)
    }

    fn build_guide(
        &mut self,
        gear: usize,
        departure: &Departure,
        goal: &Point<LocalNed>,
        found: &Found,
    ) -> bool {
        let goal = goal.vector();
        let start = departure.state.position.vector();
        self.guide.build(
            &self.space,
            gear,
            &start,
            self.search.path(),
            (found.end == PathEnd::Goal).then_some(&goal),
            GUIDE_MAX_M,
            self.limits[gear].overshoot_m,
        )
    }

    fn write_plan(
        &mut self,
        gear: usize,
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
            // Where a leg cannot be surrounded the plan ends before it: it rests there, and the next plan sees more.
            let Some(polytope) = self.corridor.polytope(&self.space, gear, &a, &b, down_range_m) else {
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
            .declarations(gear, &self.guide.vertices()[..route.guide_len as usize]);
        route.base_id = departure.base_id;
        route.splice = departure.splice;
        route.start = departure.state;
        route.limits = if self.space.narrow_gear() == Some(gear) {
            self.creep
        } else {
            self.limits[gear]
        };
        if desired.mission_speed_mps.is_finite() {
            route.limits.speed_mps = route.limits.speed_mps.min(desired.mission_speed_mps.max(0.3));
        }
        route.target = route.guide[route.guide_len as usize - 1];
        let whole = route.corridor_len as usize + 1 == self.guide.vertices().len();
        route.target_is_goal = Flag::from(target_is_goal && whole);
        // Sensors that do not look all around have to look ahead, whatever the mission asks.
        let looks_ahead = self.yaw_along_path || !self.view.is_all_around() && !self.view.is_empty();
        route.goal_yaw_rad = if looks_ahead {
            f64::NAN
        } else {
            f64::from(desired.points[1].yaw_rad)
        };
        route.mode = Coded::new(RouteMode::Plan);
        if let Some(stop) = stops::certified(&self.space, gear, &departure.state) {
            route.stop = stop;
            route.has_stop = Flag::YES;
        }
        true
    }

    fn report(&mut self, now: Timestamp, planned: bool, state: &VehicleState, goal: &Point<LocalNed>) {
        let at_goal = (state.position.vector() - goal.vector()).norm() <= self.goal_radius_m;
        if planned || at_goal {
            self.planned_goal = Some(*goal);
            self.failing_since = None;
            if self.no_path_told {
                self.no_path_told = false;
                self.tell(&events::PATH_FOUND);
            }
            return;
        }
        self.planned_goal = Some(*goal);
        let since = *self.failing_since.get_or_insert(now);
        let standing = state.velocity.vector().norm() < 0.3;
        if standing && !self.no_path_told && now.seconds_since(since) > NO_PATH_AFTER_S {
            self.no_path_told = true;
            self.tell(&events::NO_PATH);
        }
    }

    /// Tells when the goal has been out of reach for too long, and again after the same time each.
    fn judge_progress(
        &mut self,
        now: Timestamp,
        state: &VehicleState,
        goal: &Point<LocalNed>,
        asked_for: &Point<LocalNed>,
    ) {
        let away_m = (state.position.vector() - goal.vector()).norm();
        if away_m <= self.goal_radius_m && self.obstruction != Some(Obstruction::Height) {
            self.progress.forget();
            return;
        }
        let has_detour = self.obstruction.is_none();
        let detour_mps = if has_detour {
            self.limits[DEGRADED_GEAR].speed_mps
        } else {
            0.0
        };
        if self.proposals.is_flown() {
            self.progress.pause(now);
        }
        if self.progress.step(now, goal, self.left_m, detour_mps) {
            let why = self.obstruction.unwrap_or(Obstruction::Unseen);
            self.blocked_by = Some(why);
            let away_m = (state.position.vector() - asked_for.vector()).norm();
            let event = EventSample::new(&events::GOAL_BLOCKED, why.word(), [away_m, 0.0]);
            self.events.push(event);
        }
    }

    fn tell_blocked(&mut self, blocked: bool) {
        if blocked && !self.blocked_told {
            self.tell(&events::COMMITMENT_CHANGED);
        }
        self.blocked_told = blocked;
    }

    fn tell(&mut self, event: &events::Event) {
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

/// Where the next plan departs from: the committed trajectory a little ahead, or the vehicle as it will be then if it goes
/// on as measured; at rest where it stands if it hardly moves.
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
