//! The committed trajectory: whether it is flown, whether it belongs to the newest map, and whether an obstacle has
//! come into its tube (rule I3).

use super::Planner;
use crate::speed_tiers::{CRAWL_TIER, LAST_TIER};
use jink_shared_types::Timestamp;
use jink_shared_types::motion::{Trajectory, TrajectoryMode};
use nalgebra::Vector3;

/// Time between two checked points of the committed trajectory (s).
const RECHECK_STEP_S: f64 = 0.03;
/// Coming nearer by less than this (m) from one of these points to the next is rounding.
const NEARER_M: f64 = 1e-6;

impl Planner {
    /// Whether the last plan on this map is being flown: the near part of it may still be too close to the obstacle
    /// that is to be left.
    pub(super) fn is_planned_on_this_map(&self, committed: Option<&Trajectory>) -> bool {
        self.planned_id != 0 && committed.is_some_and(|committed| committed.route_id == self.planned_id)
    }

    /// Whether an obstacle that stands still has come into the tube of the committed trajectory from `now` on.
    pub(super) fn is_blocked(&mut self, now: Timestamp, committed: Option<&Trajectory>) -> bool {
        let Some(committed) = committed.filter(|trajectory| is_flown(trajectory)) else {
            return false;
        };
        if !self.space.is_loaded() || !self.hits(now, committed) {
            return false;
        }
        // Without what moves the map has to be inflated again: only where something is hit.
        if self.moving.is_empty() || self.moving_hidden {
            return true;
        }
        self.hide_moving();
        self.hits(now, committed)
    }

    /// Whether anything in the map is in the tube of `committed` from `now` on.
    fn hits(&mut self, now: Timestamp, committed: &Trajectory) -> bool {
        let end = committed.end();
        // At rest there is no tracking error.
        let tier = if now < end {
            self.tier_of(committed.limits.tube_m)
        } else {
            LAST_TIER
        };
        let mut time = now;
        // What the vehicle is too near to already is left by going on, as long as that brings it no nearer.
        let mut leaving_m = Some(0.0);
        loop {
            let Some(state) = committed.at(time) else {
                return false;
            };
            let place = state.position.vector();
            leaving_m = match (leaving_m, self.is_hit(tier, &place)) {
                (_, false) => None,
                (None, true) => return true,
                (Some(before_m), true) => {
                    let away_m = self.space.hit_distance_m(tier, &place);
                    if away_m < before_m {
                        return true;
                    }
                    Some(away_m - NEARER_M)
                }
            };
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
    pub(super) fn tier_of(&self, tube_m: f64) -> usize {
        self.limits
            .iter()
            .position(|limits| limits.tube_m <= tube_m + 1e-9)
            .unwrap_or(LAST_TIER)
    }
}

/// Whether a trajectory is one the vehicle flies (not a mirrored or an empty one).
pub(super) fn is_flown(trajectory: &Trajectory) -> bool {
    trajectory.mode.get() != TrajectoryMode::Mirror && trajectory.is_sound()
}
