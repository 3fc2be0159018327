//! The part of a proposed path that the next plan may follow: from the departure to the path, along it as far as one
//! route reaches, and which part of it is not certified.

use crate::configuration_space::ConfigurationSpace;
use crate::speed_tiers::CRAWL_TIER;
use jink_shared_types::proposal::{PROPOSAL_WAYPOINTS, Proposal, ProposalVerdict};
use nalgebra::Vector3;

/// A vehicle that is farther from the path does not join it (m): the path was made for another place.
const JOIN_MAX_M: f64 = 5.0;
/// How far ahead of its nearest point the path is joined (m), at rest, and in addition per speed (s): a vehicle in
/// motion cannot turn at once.
const JOIN_AHEAD_M: f64 = 0.5;
const JOIN_AHEAD_S: f64 = 0.8;
/// How far a vehicle may have moved back or forward along the same path since the last plan (m).
const BACK_M: f64 = 2.0;
const ON_M: f64 = 12.0;
/// How much of the path is checked from the departure on (m): the longest guide and the longest overshoot, and a
/// margin.
const HORIZON_M: f64 = 14.0;
/// A path that ends this near to the goal is meant to end at it (m).
const GOAL_NEAR_M: f64 = 1.0;
/// Points nearer to each other than this are one (m).
const NEGLIGIBLE_M: f64 = 0.05;
/// Rounding of a height allowed (m).
const HEIGHT_SLACK_M: f64 = 1e-3;
/// How far beyond the first point too near to an obstacle the path is checked for leading through it (m).
const THROUGH_M: f64 = 3.0;

/// Where and why a path is not certified.
#[derive(Clone, Copy, Debug)]
pub struct ProposalFailure {
    /// Why.
    pub verdict: ProposalVerdict,
    /// Where.
    pub place: Vector3<f64>,
    /// The waypoint that ends the leg.
    pub waypoint: u32,
    /// Length of the path up to there (m).
    pub after_m: f64,
}

/// Reusable memory of the part that is checked.
#[derive(Debug)]
pub struct ProposedPath {
    /// The departure first.
    points: Vec<Vector3<f64>>,
    /// The waypoint that ends the leg to each point.
    waypoints: Vec<u32>,
    ends_at_goal: bool,
    is_whole: bool,
    remaining_m: f64,
}

impl Default for ProposedPath {
    fn default() -> Self {
        Self {
            points: Vec::with_capacity(PROPOSAL_WAYPOINTS + 4),
            waypoints: Vec::with_capacity(PROPOSAL_WAYPOINTS + 4),
            ends_at_goal: false,
            is_whole: false,
            remaining_m: 0.0,
        }
    }
}

/// The point of a path that is nearest to something.
#[derive(Clone, Copy, Debug)]
struct NearestPoint {
    away_m: f64,
    along_m: f64,
    point: Vector3<f64>,
    waypoint: u32,
}

impl ProposedPath {
    /// The points, the departure first.
    pub fn points(&self) -> &[Vector3<f64>] {
        &self.points
    }

    /// The last point is the goal.
    pub fn ends_at_goal(&self) -> bool {
        self.ends_at_goal
    }

    /// The last point is the end of the proposal.
    pub fn is_whole(&self) -> bool {
        self.is_whole
    }

    /// Length that is left to the end of the proposal, and straight from there to the goal (m).
    pub fn remaining_m(&self) -> f64 {
        self.remaining_m
    }

    /// Length of the points (m).
    pub fn length_m(&self) -> f64 {
        self.points
            .windows(2)
            .map(|pair| (pair[1] - pair[0]).norm())
            .sum()
    }

    /// Takes the part of `proposal` that begins at the departure (`start`, at `speed_mps`); `along_m` is where the last
    /// plan joined the path, `None` for another path. Returns where this one joins it.
    ///
    /// # Errors
    /// The vehicle is too far away.
    pub fn join(
        &mut self,
        space: &ConfigurationSpace,
        proposal: &Proposal,
        start: &Vector3<f64>,
        speed_mps: f64,
        goal: &Vector3<f64>,
        along_m: Option<f64>,
    ) -> Result<f64, ProposalFailure> {
        let nearest = nearest(proposal, start, along_m);
        if nearest.away_m > JOIN_MAX_M {
            return Err(ProposalFailure {
                verdict: ProposalVerdict::TooFar,
                place: nearest.point,
                waypoint: nearest.waypoint,
                after_m: 0.0,
            });
        }
        self.points.clear();
        self.waypoints.clear();
        self.points.push(*start);
        self.waypoints.push(nearest.waypoint);
        let ahead_m = (JOIN_AHEAD_M + JOIN_AHEAD_S * speed_mps).max(nearest.away_m);
        let from_m = [1.0, 0.5, 0.0]
            .map(|share| nearest.along_m + share * ahead_m)
            .into_iter()
            .find(|from_m| space.segment_is_safe(CRAWL_TIER, start, &point_at(proposal, *from_m).0))
            .unwrap_or(nearest.along_m);
        self.follow(proposal, from_m);
        self.end_at(proposal, goal);
        self.cut_at_horizon();
        Ok(nearest.along_m)
    }

    /// Adds the path from `from_m` on.
    fn follow(&mut self, proposal: &Proposal, from_m: f64) {
        let (point, waypoint) = point_at(proposal, from_m);
        self.push(point, waypoint);
        for (index, next) in proposal.waypoints().iter().enumerate().skip(waypoint as usize) {
            self.push(next.vector(), index as u32);
        }
    }

    fn end_at(&mut self, proposal: &Proposal, goal: &Vector3<f64>) {
        let end = proposal.waypoints().last().map_or(*goal, |end| end.vector());
        let beyond_m = (goal - end).norm();
        self.ends_at_goal = beyond_m <= GOAL_NEAR_M;
        self.remaining_m = self.length_m() + beyond_m;
        if self.ends_at_goal {
            // No further point right beside it.
            if beyond_m < NEGLIGIBLE_M && self.points.len() > 1 {
                self.points.pop();
                self.waypoints.pop();
            }
            self.points.push(*goal);
            self.waypoints.push(proposal.waypoints().len() as u32);
        }
    }

    fn push(&mut self, point: Vector3<f64>, waypoint: u32) {
        let is_new = self
            .points
            .last()
            .is_none_or(|last| (point - last).norm() > NEGLIGIBLE_M);
        if is_new {
            self.points.push(point);
            self.waypoints.push(waypoint);
        }
    }

    fn cut_at_horizon(&mut self) {
        self.is_whole = true;
        let mut remaining_m = HORIZON_M;
        for index in 1..self.points.len() {
            let leg = self.points[index] - self.points[index - 1];
            if leg.norm() > remaining_m {
                self.points[index] = self.points[index - 1] + leg * (remaining_m / leg.norm());
                self.points.truncate(index + 1);
                self.waypoints.truncate(index + 1);
                self.is_whole = false;
                self.ends_at_goal = false;
                return;
            }
            remaining_m -= leg.norm();
        }
    }

    /// Whether a point lies outside of the heights allowed (smallest and largest down coordinate).
    pub fn leaves_heights(&self, down_range_m: (f64, f64)) -> Option<ProposalFailure> {
        let allowed = down_range_m.0 - HEIGHT_SLACK_M..=down_range_m.1 + HEIGHT_SLACK_M;
        let mut after_m = 0.0;
        for index in 1..self.points.len() {
            if !allowed.contains(&self.points[index].z) {
                return Some(self.failure(ProposalVerdict::HeightNotAllowed, index, 1.0, after_m));
            }
            after_m += (self.points[index] - self.points[index - 1]).norm();
        }
        None
    }

    /// Where it comes too near to a known obstacle for the slowest speed tier, which must be prepared.
    pub fn obstacle(&self, space: &ConfigurationSpace) -> Option<ProposalFailure> {
        let slowest = CRAWL_TIER;
        let mut after_m = 0.0;
        for (index, leg) in self.points.windows(2).enumerate() {
            let way = leg[1] - leg[0];
            let is_hit = |space: &ConfigurationSpace, cell| space.is_hit_inside(slowest, cell);
            let hit = space.first_in(slowest, &leg[0], &leg[1], is_hit);
            if let Some(t) = hit {
                let narrow = self.failure(ProposalVerdict::TooNarrow, index + 1, t, after_m);
                return Some(
                    self.inside_obstacle(space, index + 1, t, narrow.after_m)
                        .unwrap_or(narrow),
                );
            }
            after_m += way.norm();
        }
        None
    }

    /// Where it leads through an obstacle whose surroundings it enters on the leg to point `first`, at its share `t`.
    fn inside_obstacle(
        &self,
        space: &ConfigurationSpace,
        first: usize,
        t: f64,
        after_m: f64,
    ) -> Option<ProposalFailure> {
        let mut from_m = after_m;
        let mut from = self.points[first - 1] + (self.points[first] - self.points[first - 1]) * t;
        for index in first..self.points.len() {
            let way = self.points[index] - from;
            let remaining_m = after_m + THROUGH_M - from_m;
            let share = (remaining_m / way.norm().max(1e-9)).min(1.0);
            let to = from + way * share;
            if let Some(t) = space.first_cell(&from, &to, ConfigurationSpace::is_occupied) {
                return Some(ProposalFailure {
                    verdict: ProposalVerdict::Occupied,
                    place: from + (to - from) * t,
                    waypoint: self.waypoints[index],
                    after_m,
                });
            }
            let is_left = space.first_in(CRAWL_TIER, &from, &to, |space, cell| {
                !space.is_hit(CRAWL_TIER, cell)
            });
            if share < 1.0 || is_left.is_some() {
                return None;
            }
            from_m += way.norm();
            from = self.points[index];
        }
        None
    }

    /// Where it leaves what is known to be free, for the slowest speed tier, which must be prepared.
    pub fn unknown(&self, space: &ConfigurationSpace) -> Option<ProposalFailure> {
        let mut after_m = 0.0;
        for (index, leg) in self.points.windows(2).enumerate() {
            let is_unsafe = |space: &ConfigurationSpace, cell| !space.is_safe(CRAWL_TIER, cell);
            let end = space.first_in(CRAWL_TIER, &leg[0], &leg[1], is_unsafe);
            if let Some(t) = end {
                return Some(self.failure(ProposalVerdict::Unknown, index + 1, t, after_m));
            }
            after_m += (leg[1] - leg[0]).norm();
        }
        None
    }

    /// At its last point.
    pub fn at_end(&self, verdict: ProposalVerdict) -> ProposalFailure {
        ProposalFailure {
            verdict,
            place: self.points.last().copied().unwrap_or_default(),
            waypoint: self.waypoints.last().copied().unwrap_or_default(),
            after_m: self.length_m(),
        }
    }

    fn failure(&self, verdict: ProposalVerdict, index: usize, t: f64, after_m: f64) -> ProposalFailure {
        let way = self.points[index] - self.points[index - 1];
        ProposalFailure {
            verdict,
            place: self.points[index - 1] + way * t,
            waypoint: self.waypoints[index],
            after_m: after_m + t * way.norm(),
        }
    }
}

/// The point of the path nearest to `start`; on a path that was joined at `along_m` before, one not far from there.
fn nearest(proposal: &Proposal, start: &Vector3<f64>, along_m: Option<f64>) -> NearestPoint {
    let range_m = along_m.map_or(0.0..=f64::INFINITY, |m| m - BACK_M..=m + ON_M);
    let waypoints = proposal.waypoints();
    let first = waypoints.first().map_or(*start, |first| first.vector());
    let mut best = NearestPoint {
        away_m: f64::INFINITY,
        along_m: 0.0,
        point: first,
        waypoint: 0,
    };
    if range_m.contains(&0.0) {
        best.away_m = (first - start).norm();
    }
    let mut before_m = 0.0;
    for (index, leg) in waypoints.windows(2).enumerate() {
        let (a, way) = (leg[0].vector(), leg[1].vector() - leg[0].vector());
        let length_m = way.norm();
        // The part of the leg that lies in the range.
        let low = ((range_m.start() - before_m) / length_m.max(1e-9)).clamp(0.0, 1.0);
        let high = ((range_m.end() - before_m) / length_m.max(1e-9)).clamp(0.0, 1.0);
        let is_in_range = before_m <= *range_m.end() && before_m + length_m >= *range_m.start();
        if is_in_range && length_m > 0.0 {
            let t = ((start - a).dot(&way) / (length_m * length_m)).clamp(low, high);
            let point = a + way * t;
            let away_m = (point - start).norm();
            if away_m < best.away_m {
                best = NearestPoint {
                    away_m,
                    along_m: before_m + t * length_m,
                    point,
                    waypoint: index as u32 + 1,
                };
            }
        }
        before_m += length_m;
    }
    best
}

/// The point `along_m` along the path, or its end, and the next waypoint from there.
fn point_at(proposal: &Proposal, along_m: f64) -> (Vector3<f64>, u32) {
    let waypoints = proposal.waypoints();
    let first = waypoints.first().map_or(Vector3::zeros(), |first| first.vector());
    let (mut remaining_m, mut last) = (along_m, first);
    if along_m <= 0.0 {
        return (first, 0);
    }
    for (index, next) in waypoints.iter().enumerate().skip(1) {
        let way = next.vector() - last;
        if way.norm() > remaining_m {
            return (last + way * (remaining_m / way.norm()), index as u32);
        }
        remaining_m -= way.norm();
        last = next.vector();
    }
    (last, waypoints.len().saturating_sub(1) as u32)
}
