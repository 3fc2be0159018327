//! Keeping out of the way of what moves: plans that do not meet it, a committed trajectory that would, and evading what
//! comes to a vehicle that is at rest, or too near to plan.

use super::Planner;
use crate::committed_trajectory::is_flown;
use crate::configuration_space::Meeting;
use crate::departure::Departure;
use crate::moving::{EVADED_S, HORIZON_S};
use crate::speed_tiers::TIERS;
use crate::stops;
use jink_shared_types::Timestamp;
use jink_shared_types::events;
use jink_shared_types::motion::{BezierPiece, MotionLimits, MotionState, Route, Trajectory};
use jink_shared_types::tracking::Tracking;
use nalgebra::Vector3;

/// Time between two predicted moments that plans keep out of (s).
const PAINT_STEP_S: f64 = 0.25;
/// A plan may be so much earlier or later at a place (s).
const PAINT_SLACK_S: f64 = 0.3;
/// A plan is at least so fast, as a share of the highest speed, once it has sped up for [`SPEED_UP_S`].
const SLOWEST_SHARE: f64 = 0.4;
const SPEED_UP_S: f64 = 1.0;
/// How far beside the place where it would stop a vehicle evades to (m), the shortest first, and in how many directions.
const BESIDE_M: [f64; 5] = [0.6, 1.0, 1.5, 2.2, 3.0];
const DIRECTIONS: u32 = 16;
/// A vehicle slower than this does not plan before it evades (m/s).
const SLOW_MPS: f64 = 0.4;
/// A vehicle that evades keeps this distance beside its radius (m) if it can.
const KEEP_M: f64 = 0.35;
/// Evading is worth it if it leaves so much more distance (m).
const WORTH_M: f64 = 0.15;
/// Evading is not reported again within this time (s).
const REPORT_PERIOD_S: f64 = 5.0;

impl Planner {
    /// Radius of the vehicle, with the errors of the map (m).
    fn footprint_m(&self) -> f64 {
        self.space.footprint_m()
    }

    /// Whether the vehicle flies out of the way of something.
    pub(super) fn is_evading(&self, now: Timestamp, committed: Option<&Trajectory>) -> bool {
        let evasion = committed.filter(|committed| committed.route_id == self.evasion_id);
        self.evasion_id != 0 && evasion.is_some_and(|committed| now < committed.end())
    }

    /// Whether the vehicle would meet something that moves on the committed trajectory.
    pub(super) fn meets_something(&self, now: Timestamp, committed: Option<&Trajectory>) -> bool {
        let Some(committed) = committed.filter(|trajectory| is_flown(trajectory)) else {
            return false;
        };
        let footprint_m = self.footprint_m();
        self.moving.nearest_along_m(now, committed, footprint_m) < footprint_m
    }

    /// Paints what moves for the plan that departs now: it keeps out of where the vehicle could meet it.
    pub(super) fn paint_moving(&mut self, departure: &Departure) {
        if self.moving.is_empty() {
            return;
        }
        let fastest_mps = self.limits[self.top_tier]
            .speed_mps
            .max(departure.state.velocity.vector().norm());
        let steps = (HORIZON_S / PAINT_STEP_S) as u32;
        let Self { moving, space, .. } = self;
        let meetings = (0..=steps).flat_map(|step| {
            let ahead_s = f64::from(step) * PAINT_STEP_S;
            let nearest_m = (ahead_s - PAINT_SLACK_S - SPEED_UP_S).max(0.0) * SLOWEST_SHARE * fastest_mps;
            let farthest_m = (ahead_s + PAINT_SLACK_S) * fastest_mps;
            moving
                .at(departure.splice.plus_seconds(ahead_s))
                .map(move |cylinder| Meeting {
                    cylinder,
                    between_m: [nearest_m, farthest_m],
                })
        });
        space.paint(&departure.state.position.vector(), meetings);
    }

    /// Whether the vehicle is slow enough to evade at once, or evades already.
    pub(super) fn evades_first(
        &self,
        now: Timestamp,
        departure: &Departure,
        committed: Option<&Trajectory>,
    ) -> bool {
        departure.state.velocity.vector().norm() <= SLOW_MPS || self.is_evading(now, committed)
    }

    /// Evades what comes, if that is worth it: a motion to rest beside the place where the vehicle would stop, the
    /// nearest that stays far enough from everything that moves, or else the one that stays farthest. Returns whether
    /// it is written into `route`.
    pub(super) fn evade(
        &mut self,
        now: Timestamp,
        departure: &Departure,
        committed: Option<&Trajectory>,
        route: &mut Route,
    ) -> bool {
        if self.moving.is_empty() {
            return false;
        }
        let above_m = self.footprint_m();
        let enough_m = above_m + KEEP_M;
        let going_on_m = self.going_on_m(now, departure, committed);
        if going_on_m >= enough_m {
            return false;
        }
        self.hide_moving();
        let fastest_mps = self.limits[self.top_tier].speed_mps;
        let mut best: Option<(f64, usize, BezierPiece)> = None;
        for piece in evasions(&departure.state, &self.tracking, fastest_mps) {
            let nearest_m = self
                .moving
                .nearest_m(departure.splice, EVADED_S, above_m, |ahead_s| {
                    piece.at(ahead_s.min(piece.duration_s)).position.vector()
                });
            let least_m = best.as_ref().map_or(going_on_m, |(best_m, ..)| *best_m);
            if nearest_m < least_m + WORTH_M {
                continue;
            }
            if let Some(tier) = self.tier_of_piece(&piece) {
                best = Some((nearest_m, tier, piece));
                if nearest_m >= enough_m {
                    break;
                }
            }
        }
        let Some((_, tier, piece)) = best else {
            return false;
        };
        let limits = MotionLimits {
            speed_mps: fastest_mps,
            ..self.limits[tier]
        };
        self.write_stop(departure, limits, piece, route);
        self.evasion_id = route.id;
        if !self.evasion_reported.is_set() || now.seconds_since(self.evasion_reported) > REPORT_PERIOD_S {
            self.report_event(&events::GIVES_WAY);
        }
        self.evasion_reported = now;
        true
    }

    /// How near the vehicle comes to what moves if it goes on as it does, and rests then (m).
    fn going_on_m(&self, now: Timestamp, departure: &Departure, committed: Option<&Trajectory>) -> f64 {
        let here = departure.state.position.vector();
        let flown = committed.filter(|trajectory| is_flown(trajectory));
        self.moving
            .nearest_m(now, HORIZON_S, self.footprint_m(), |ahead_s| {
                let state = flown.and_then(|flown| flown.at(now.plus_seconds(ahead_s).min(flown.end())));
                state.map_or(here, |state| state.position.vector())
            })
    }

    /// The highest tier in which `piece` is safe.
    fn tier_of_piece(&mut self, piece: &BezierPiece) -> Option<usize> {
        (self.top_tier..TIERS).find(|tier| {
            self.space.prepare(*tier);
            stops::is_safe(&self.space, *tier, piece)
        })
    }
}

/// Motions to rest beside the place where a vehicle in `start` would stop, the shortest first.
fn evasions(
    start: &MotionState,
    tracking: &Tracking,
    fastest_mps: f64,
) -> impl Iterator<Item = BezierPiece> + use<> {
    let stop = stops::hardest(start, tracking);
    let stopped = stop.at(stop.duration_s).position.vector();
    let beside = BESIDE_M.into_iter().flat_map(move |away_m| {
        (0..DIRECTIONS).map(move |direction| {
            let angle_rad = std::f64::consts::TAU * f64::from(direction) / f64::from(DIRECTIONS);
            stopped + Vector3::new(angle_rad.cos(), angle_rad.sin(), 0.0) * away_m
        })
    });
    let start = *start;
    std::iter::once(stop)
        .chain(beside.filter_map(move |place| stops::to_rest_at(&start, &place, fastest_mps)))
}
