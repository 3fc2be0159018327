//! Routes along paths that another program proposes ([`Proposal`]).
//!
//! A proposal takes the place of the planner's own guide and of nothing else: the certified space, the tubes, the
//! limits and the stop at the end are those of every plan. The planner's own search continues beside it. It computes
//! the remaining cost to the goal, and its path is flown as soon as there is no proposal, or none that can be
//! certified.
//!
//! No proposal keeps the vehicle from its goal. Routes along proposals must advance along them and must bring the goal
//! nearer by the own search's measure; else only paths of the own search are flown for [`PAUSE_S`], and twice as long
//! each next time. So the time without proposals grows until it is long enough, whatever is proposed.

use super::Planner;
use crate::certified_route::{GUIDE_MAX_M, PROGRESS_MIN_M};
use crate::configuration_space::ConfigurationSpace;
use crate::departure::Departure;
use crate::path_choice::HIGHER_TIER_MIN_M;
use crate::proposed_path::{ProposalFailure, ProposedPath};
use crate::speed_tiers::CRAWL_TIER;
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::layout::Layout;
use jink_shared_types::motion::{MotionLimits, Route, Trajectory, stopping_distance_m};
use jink_shared_types::proposal::{Proposal, ProposalAnswer, ProposalVerdict};
use jink_shared_types::vehicle::DesiredPath;
use jink_shared_types::{Added, Coded, Reading, Timestamp};

/// A goal that is this near to the desired one is the same (m): positions travel in single precision, and a program may
/// have computed its own from a latitude and a longitude.
const SAME_GOAL_M: f64 = 0.5;
/// A remaining cost that is smaller by this is progress (m), as in [`crate::progress`].
const PROGRESS_M: f64 = 0.5;
/// A path that is longer than the one before by this is another one (m): a detour that was found in flight.
const OTHER_PATH_M: f64 = 2.0;
/// How long routes may be made of proposals without progress along them (s): longer than a hard turn or a change of the
/// speed tier takes.
const IDLE_MAX_S: f64 = 5.0;
/// How long without progress to the goal (s): a detour along all sides of the map's window takes it.
const DETOUR_MAX_S: f64 = 60.0;
/// How long only the own search is flown after that, the first time (s).
const PAUSE_S: f64 = 10.0;
/// So many routes along proposals in a row that are not flown (of ten in a second) are not feasible.
const NOT_FLOWN_MAX: u32 = 3;
/// How long only the own search is then flown (s): long enough to reach another place, from where the proposed path may
/// be feasible.
const INFEASIBLE_S: f64 = 2.0;
/// The numbers in the answer to a proposal are published at this period while it is flown (s).
const NUMBERS_S: f64 = 1.0;
/// Shortest period of events about proposals (s).
const EVENT_S: f64 = 5.0;
/// The longest gap between two cycles that counts as flown (s).
const CYCLE_MAX_S: f64 = 0.2;
/// A requested speed is not lower than this (m/s), as for the speed that a mission asks for.
const SPEED_MIN_MPS: f64 = 0.3;
/// A requested speed limits how far ahead is planned (s), and the distance for slowing down is planned with this margin
/// (1): so that a faster vehicle slows down at once.
const REQUESTED_AHEAD_S: f64 = 2.0;
const SLOWING_MARGIN: f64 = 1.3;

/// What was last reported to the pilot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ReportedStatus {
    OwnPath,
    Flown,
    Refused(ProposalVerdict),
}

/// State of the proposals.
#[derive(Debug)]
pub(super) struct Proposals {
    /// The newest one; it counts while it is fresh.
    current: Proposal,
    is_fresh: bool,
    is_plausible: bool,
    /// When the path was proposed first.
    proposed: Timestamp,
    /// A plan may be made of it in this cycle, between these heights (smallest and largest down coordinate).
    is_admitted: bool,
    down_range_m: (f64, f64),
    way: ProposedPath,
    /// Where the last plan has joined the path (m along it).
    along_m: Option<f64>,
    /// Where the path leaves known-free space.
    end: Option<ProposalFailure>,
    /// The last plan was made of a proposal.
    is_flown: bool,
    /// The first route made of the current path; 0 = none.
    first_route: u64,
    /// The last one, until it appears in the committed trajectory; 0 = none.
    pending_route: u64,
    not_flown: u32,
    /// Until then no plan is made of a proposal, for this reason.
    pause: Option<(Timestamp, ProposalVerdict)>,
    next_pause_s: f64,
    goal: Point<LocalNed>,
    /// The smallest remaining cost by the own search (m), and how long a proposal has been flown without less (s).
    min_m: f64,
    detour_s: f64,
    /// The same along the proposed paths.
    least_along_m: f64,
    idle_s: f64,
    cycle: Timestamp,
    decided: Option<ProposalAnswer>,
    answer: ProposalAnswer,
    answered: Timestamp,
    is_answer_due: bool,
    reported: ReportedStatus,
    reported_at: Timestamp,
}

impl Default for Proposals {
    fn default() -> Self {
        Self {
            current: Proposal::default(),
            is_fresh: false,
            is_plausible: false,
            proposed: Timestamp::NEVER,
            is_admitted: false,
            down_range_m: (0.0, 0.0),
            way: ProposedPath::default(),
            along_m: None,
            end: None,
            is_flown: false,
            first_route: 0,
            pending_route: 0,
            not_flown: 0,
            pause: None,
            next_pause_s: PAUSE_S,
            goal: Point::UNSET,
            min_m: f64::INFINITY,
            detour_s: 0.0,
            least_along_m: f64::INFINITY,
            idle_s: 0.0,
            cycle: Timestamp::NEVER,
            decided: None,
            answer: ProposalAnswer::default(),
            answered: Timestamp::NEVER,
            is_answer_due: false,
            reported: ReportedStatus::OwnPath,
            reported_at: Timestamp::NEVER,
        }
    }
}

impl Proposals {
    /// Begins a cycle with the newest proposal, while `committed` is flown.
    pub(super) fn begin_cycle(&mut self, proposal: &Reading<'_, Proposal>, committed: Option<&Trajectory>) {
        if committed.is_some_and(|committed| committed.route_id == self.pending_route) {
            self.pending_route = 0;
            self.not_flown = 0;
        }
        self.decided = None;
        self.is_answer_due = false;
        self.is_admitted = false;
        let newest = proposal.fresh();
        self.is_fresh = newest.is_some();
        let Some(newest) = newest else {
            // If it is proposed again, it counts as new.
            self.proposed = Timestamp::NEVER;
            return;
        };
        if !self.proposed.is_set() || !is_same(&self.current, newest.sample) {
            self.along_m = None;
            self.first_route = 0;
            self.proposed = newest.header.publish;
            self.current = *newest.sample;
        }
        self.is_plausible = self.current.is_plausible();
    }

    /// Checks what needs no map: whether a plan to `requested` may be made of the proposal now, within the heights of
    /// `down_range_m`.
    pub(super) fn admit(
        &mut self,
        now: Timestamp,
        must_leave: bool,
        requested: &Point<LocalNed>,
        down_range_m: (f64, f64),
    ) {
        self.set_goal(requested);
        if !self.is_fresh {
            return;
        }
        self.down_range_m = down_range_m;
        let is_other_goal = (self.current.goal.vector() - requested.vector()).norm() > SAME_GOAL_M;
        let pause = self.pause.filter(|(until, _)| now < *until);
        let refusal = if !self.is_plausible {
            Some(ProposalVerdict::Implausible)
        } else if is_other_goal {
            Some(ProposalVerdict::OtherGoal)
        } else if let Some((_, verdict)) = pause {
            Some(verdict)
        } else {
            must_leave.then_some(ProposalVerdict::Evading)
        };
        match refusal {
            Some(verdict) => self.decide(verdict, None),
            None => self.is_admitted = true,
        }
    }

    /// Nothing is planned in this cycle, whatever is proposed.
    pub(super) fn on_not_planning(&mut self) {
        if self.is_fresh {
            self.decide(ProposalVerdict::NotPlanning, None);
        }
    }

    /// The planner uses its own path out of a narrow place.
    pub(super) fn on_evading(&mut self) {
        if self.is_admitted {
            self.decide(ProposalVerdict::Evading, None);
        }
    }

    /// Whether the last plan was made of a proposal.
    pub(super) fn is_flown(&self) -> bool {
        self.is_flown
    }

    /// The planner uses its own path. Returns whether it did not before.
    pub(super) fn use_own_path(&mut self) -> bool {
        self.pending_route = 0;
        std::mem::take(&mut self.is_flown)
    }

    /// Builds the proposed path from the departure on, up to where it leaves known-free space; the slowest speed tier
    /// must be prepared.
    fn build_path(
        &mut self,
        space: &ConfigurationSpace,
        departure: &Departure,
        goal: &Point<LocalNed>,
    ) -> Result<(), ProposalFailure> {
        let start = departure.state.position.vector();
        let speed_mps = departure.state.velocity.vector().norm();
        let way = &mut self.way;
        let along_m = way.join(
            space,
            &self.current,
            &start,
            speed_mps,
            &goal.vector(),
            self.along_m,
        )?;
        self.along_m = Some(along_m);
        let failure = way
            .leaves_heights(self.down_range_m)
            .or_else(|| way.obstacle(space));
        if let Some(failure) = failure {
            return Err(failure);
        }
        if way.is_whole() && !way.ends_at_goal() && way.length_m() < PROGRESS_MIN_M {
            return Err(way.at_end(ProposalVerdict::Ended));
        }
        self.end = way.unknown(space);
        Ok(())
    }

    /// A route was made of the proposal.
    fn on_route_made(&mut self, route: &Route, is_shortened: bool) {
        if self.first_route == 0 {
            self.first_route = route.id;
        }
        self.pending_route = route.id;
        self.is_flown = true;
        let remaining_m = self.way.remaining_m();
        if remaining_m < self.least_along_m - PROGRESS_M {
            self.least_along_m = remaining_m;
            self.idle_s = 0.0;
        } else if remaining_m > self.least_along_m + OTHER_PATH_M {
            self.least_along_m = remaining_m;
        }
        match self.end.filter(|_| is_shortened) {
            Some(end) => self.decide(ProposalVerdict::Shortened, Some(end)),
            None => self.decide(ProposalVerdict::Accepted, None),
        }
        if let Some(decided) = &mut self.decided {
            let legs = route.guide().windows(2);
            decided.certified_m = legs.map(|leg| (leg[1].vector() - leg[0].vector()).norm()).sum();
            decided.speed_mps = route.limits.speed_mps;
            decided.route_id = self.first_route;
        }
    }

    /// Whether the routes made of proposals are not flown: then the own search is flown.
    fn is_infeasible(&mut self) -> bool {
        if self.pending_route == 0 {
            return false;
        }
        self.not_flown += 1;
        if self.not_flown < NOT_FLOWN_MAX {
            return false;
        }
        self.not_flown = 0;
        let until = self.cycle.plus_seconds(INFEASIBLE_S);
        self.pause = Some((until, ProposalVerdict::Infeasible));
        true
    }

    /// Another goal ends the pause.
    fn set_goal(&mut self, goal: &Point<LocalNed>) {
        let moved_m = (self.goal.vector() - goal.vector()).norm();
        // The first goal counts as another one.
        if moved_m.is_nan() || moved_m > SAME_GOAL_M {
            self.goal = *goal;
            self.pause = None;
            self.next_pause_s = PAUSE_S;
            self.reset_progress();
            self.min_m = f64::INFINITY;
        }
    }

    /// Ends a cycle in which the own search has found the remaining cost `remaining_m`.
    pub(super) fn end_cycle(
        &mut self,
        now: Timestamp,
        remaining_m: Option<f64>,
        events: &mut Vec<EventSample>,
    ) {
        self.watch_progress(now, remaining_m);
        self.cycle = now;
        self.write_answer(now);
        self.report_events(now, events);
    }

    fn watch_progress(&mut self, now: Timestamp, remaining_m: Option<f64>) {
        if let Some(remaining_m) = remaining_m.filter(|remaining_m| *remaining_m < self.min_m - PROGRESS_M) {
            self.min_m = remaining_m;
            self.detour_s = 0.0;
        }
        if !self.is_flown {
            return;
        }
        let flown_s = now.seconds_since(self.cycle).clamp(0.0, CYCLE_MAX_S);
        self.idle_s += flown_s;
        self.detour_s += flown_s;
        if self.idle_s > IDLE_MAX_S || self.detour_s > DETOUR_MAX_S {
            let until = now.plus_seconds(self.next_pause_s);
            self.pause = Some((until, ProposalVerdict::NoProgress));
            self.next_pause_s *= 2.0;
            self.reset_progress();
        }
    }

    fn reset_progress(&mut self) {
        self.least_along_m = f64::INFINITY;
        self.idle_s = 0.0;
        self.detour_s = 0.0;
    }

    fn decide(&mut self, verdict: ProposalVerdict, failure: Option<ProposalFailure>) {
        self.decided = Some(ProposalAnswer {
            place: failure.map_or(Point::UNSET, |failure| Point::from_vector(failure.place)),
            waypoint: failure.map_or(self.current.len, |failure| failure.waypoint),
            certified_m: failure.map_or(0.0, |failure| failure.after_m),
            verdict: Coded::new(verdict),
            ..ProposalAnswer::default()
        });
    }

    /// An answer is due when it differs from the last one, and periodically for its numbers.
    fn write_answer(&mut self, now: Timestamp) {
        let Some(decided) = self.decided else {
            return;
        };
        let is_same = (self.answer.proposal_id, self.answer.proposed) == (self.current.id, self.proposed);
        let both_flown = decided.verdict.get().is_flown() && self.answer.verdict.get().is_flown();
        let is_same_answer =
            both_flown || (decided.verdict, decided.waypoint) == (self.answer.verdict, self.answer.waypoint);
        let has_old_numbers = both_flown && now.seconds_since(self.answered) >= NUMBERS_S;
        if is_same && is_same_answer && !has_old_numbers {
            return;
        }
        self.answer = ProposalAnswer {
            proposal_id: self.current.id,
            proposed: self.proposed,
            ..decided
        };
        self.answered = now;
        self.is_answer_due = true;
    }

    /// The answer to be published in this cycle.
    pub(super) fn answer(&self) -> Option<&ProposalAnswer> {
        self.is_answer_due.then_some(&self.answer)
    }

    /// Reports once, and not too often, when routes begin and cease to come from proposals.
    fn report_events(&mut self, now: Timestamp, events: &mut Vec<EventSample>) {
        let is = match self.decided.map(|decided| decided.verdict.get()) {
            _ if !self.is_fresh => ReportedStatus::OwnPath,
            Some(ProposalVerdict::Accepted | ProposalVerdict::Shortened) => ReportedStatus::Flown,
            Some(ProposalVerdict::Ended) => ReportedStatus::OwnPath,
            None
            | Some(ProposalVerdict::NotPlanning | ProposalVerdict::OtherGoal | ProposalVerdict::Evading) => {
                return;
            }
            Some(verdict) => ReportedStatus::Refused(verdict),
        };
        let is_too_soon = self.reported_at.is_set() && now.seconds_since(self.reported_at) < EVENT_S;
        if is == self.reported || is_too_soon {
            return;
        }
        let event = match (self.reported, is) {
            (_, ReportedStatus::Flown) => Some((&events::PROPOSAL_FLOWN, "")),
            (_, ReportedStatus::Refused(verdict)) => Some((&events::PROPOSAL_REFUSED, text(verdict))),
            (ReportedStatus::Flown, ReportedStatus::OwnPath) => Some((&events::PROPOSAL_ENDED, "")),
            (_, ReportedStatus::OwnPath) => None,
        };
        self.reported = is;
        if let Some((event, name)) = event {
            self.reported_at = now;
            events.push(EventSample::new(event, name, [0.0, 0.0]));
        }
    }
}

/// The text for the pilot.
fn text(verdict: ProposalVerdict) -> &'static str {
    match verdict {
        ProposalVerdict::Implausible => "bad numbers",
        ProposalVerdict::TooFar => "starts elsewhere",
        ProposalVerdict::Occupied => "obstacle there",
        ProposalVerdict::TooNarrow => "too narrow",
        ProposalVerdict::Unknown => "way not seen",
        ProposalVerdict::HeightNotAllowed => "height not allowed",
        ProposalVerdict::Infeasible => "no curve",
        ProposalVerdict::NoProgress => "no progress",
        _ => "refused",
    }
}

/// Whether two proposals are the same to the bit: a NaN equals itself here.
fn is_same(a: &Proposal, b: &Proposal) -> bool {
    let bits = |point: &Point<LocalNed>| [point.x_m, point.y_m, point.z_m].map(f64::to_bits);
    let path_choice = a.waypoints().iter().map(bits).eq(b.waypoints().iter().map(bits));
    let speeds = a.speed_mps.to_bits() == b.speed_mps.to_bits();
    (a.id, a.len) == (b.id, b.len) && path_choice && speeds && bits(&a.goal) == bits(&b.goal)
}

impl Planner {
    /// Writes a plan along the proposal into `route`; `false` if there is none, or it cannot be certified.
    pub(super) fn plan_proposed(
        &mut self,
        departure: &Departure,
        desired: &DesiredPath,
        goal: &Point<LocalNed>,
        route: &mut Route,
    ) -> bool {
        if !self.proposals.is_admitted {
            return false;
        }
        if self.proposals.is_infeasible() {
            self.proposals.decide(ProposalVerdict::Infeasible, None);
            return false;
        }
        self.space.prepare(CRAWL_TIER);
        if let Err(failure) = self.proposals.build_path(&self.space, departure, goal) {
            self.proposals.decide(failure.verdict, Some(failure));
            return false;
        }
        let speed_mps = departure.state.velocity.vector().norm();
        let requested_mps = self.requested_mps();
        let Some((tier, at_end)) = self.follow_proposed(departure, speed_mps, requested_mps) else {
            self.proposals.refuse_start(departure);
            return false;
        };
        let at_goal = at_end && self.proposals.way.ends_at_goal();
        if !self.write_plan(tier, departure, desired, at_goal, route) {
            self.proposals.refuse_start(departure);
            return false;
        }
        // A faster vehicle slows down on a shorter path.
        route.limits.speed_mps = route.limits.speed_mps.min(requested_mps.max(speed_mps));
        let length_max_m = self.proposed_max_m(tier, speed_mps, requested_mps);
        let end_m = self.proposals.end.map_or(f64::INFINITY, |end| end.after_m);
        let is_shortened = end_m < length_max_m + self.limits[tier].overshoot_m;
        route.proposal_id = Added::new(self.proposals.current.id);
        self.proposals.on_route_made(route, is_shortened);
        true
    }

    /// The requested speed; infinite if none is.
    fn requested_mps(&self) -> f64 {
        let requested_mps = self.proposals.current.speed_mps;
        if requested_mps > 0.0 {
            requested_mps.max(SPEED_MIN_MPS)
        } else {
            f64::INFINITY
        }
    }

    /// Builds the guide along the proposed path in the highest speed tier that is safe far enough, else in the one that
    /// is safe farthest; a lower tier is fast enough for a low speed and needs less clearance. Returns the tier, and
    /// whether the guide ends where the path does; `None` if no tier is safe far enough to be worth committing.
    fn follow_proposed(
        &mut self,
        departure: &Departure,
        speed_mps: f64,
        requested_mps: f64,
    ) -> Option<(usize, bool)> {
        // A vehicle that has just begun to fly in a higher tier accelerates too hard for a lower one.
        let acceleration_mps2 = departure.state.acceleration.vector().norm();
        let can_begin = |limits: &MotionLimits| {
            speed_mps <= MotionLimits::allowed(limits.speed_mps)
                && acceleration_mps2 <= MotionLimits::allowed(limits.acceleration_mps2)
        };
        let fast_enough = (0..=CRAWL_TIER)
            .rev()
            .find(|tier| self.limits[*tier].speed_mps >= requested_mps);
        let wanted = fast_enough.unwrap_or(0).max(self.top_tier);
        let first = (self.top_tier..=wanted)
            .rev()
            .find(|tier| can_begin(&self.limits[*tier]))
            .unwrap_or(wanted);
        let mut best: Option<(f64, usize)> = None;
        for tier in first..=CRAWL_TIER {
            self.space.prepare(tier);
            if !can_begin(&self.limits[tier])
                || !self.space.is_safe_at(tier, &departure.state.position.vector())
            {
                continue;
            }
            let at_end = self.build_proposed(tier, speed_mps, requested_mps);
            let length_m = self.guide.length_m();
            if at_end || length_m >= HIGHER_TIER_MIN_M {
                return Some((tier, at_end));
            }
            if length_m >= best.map_or(PROGRESS_MIN_M, |(best_m, _)| best_m) {
                best = Some((length_m, tier));
            }
        }
        let (_, tier) = best?;
        Some((tier, self.build_proposed(tier, speed_mps, requested_mps)))
    }

    fn build_proposed(&mut self, tier: usize, speed_mps: f64, requested_mps: f64) -> bool {
        let length_max_m = self.proposed_max_m(tier, speed_mps, requested_mps);
        let way = self.proposals.way.points();
        let overshoot_m = self.limits[tier].overshoot_m;
        self.guide
            .follow(&self.space, tier, way, length_max_m, overshoot_m)
    }

    /// The longest guide along a proposed path (m): with a requested speed, the distance to slow down in and two
    /// seconds at that speed.
    fn proposed_max_m(&self, tier: usize, speed_mps: f64, requested_mps: f64) -> f64 {
        let MotionLimits {
            acceleration_mps2,
            jerk_mps3,
            ..
        } = self.limits[tier];
        if requested_mps.is_infinite() {
            return GUIDE_MAX_M;
        }
        let stop_m = stopping_distance_m(speed_mps.max(requested_mps), 0.0, acceleration_mps2, jerk_mps3);
        (SLOWING_MARGIN * stop_m + REQUESTED_AHEAD_S * requested_mps).clamp(HIGHER_TIER_MIN_M, GUIDE_MAX_M)
    }
}

impl Proposals {
    /// No tier can follow the path from the departure on.
    fn refuse_start(&mut self, departure: &Departure) {
        let start = ProposalFailure {
            verdict: ProposalVerdict::TooNarrow,
            place: departure.state.position.vector(),
            waypoint: 0,
            after_m: 0.0,
        };
        let failure = self.end.unwrap_or(start);
        self.decide(failure.verdict, Some(failure));
    }
}
