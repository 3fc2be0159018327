//! How far a trajectory is free, by the ring as it is now.
//!
//! The reference is followed from now to its end in steps of at most [`STEP_M`]. It meets a conflict at the first place
//!
//! * that is nearer to an obstacle point than the required clearance (horizontally; the obstacles are the ring's
//!   points, not the arcs of its sectors, so that sectors that are wide far away do no harm), or
//! * that was not seen to be free.
//!
//! A trajectory on which the vehicle would meet something that moves is in conflict at once ([`MovingNow`]).
//!
//! A vehicle that is already nearer to something than it should be may leave: as long as it is too near, its path must
//! not bring it nearer.

use super::brake::Braking;
use super::moving::MovingNow;
use crate::ring::{RingQuery, SENSORS, SLOTS, Visibility};
use jink_shared_types::bezier::{self, derivative};
use jink_shared_types::motion::{BezierPiece, GuardReason, Trajectory};
use jink_shared_types::{Timestamp, motion::MotionState};
use nalgebra::Vector3;

/// Longest step along the path (m): an eighth of the smallest reasonable clearance, so that between two steps the
/// reference is at most 1 mm nearer to an obstacle point than at the nearer one of them.
const STEP_M: f64 = 0.05;
/// How far ahead is checked (m); beyond counts as unseen. No range sensor of a multicopter sees farther.
const FARTHEST_M: f64 = 60.0;
/// Steps after which the check ends, and the rest counts as unseen: bounds the time for an implausible trajectory. A
/// plausible one takes at most two steps for [`STEP_M`], because the hull of its velocity is larger than its speed.
const STEPS: usize = 4_000;
/// How much nearer a vehicle that is too near already may come (m): the noise of a lidar from one sweep to the next.
const LEAVING_SLACK_M: f64 = 0.05;

/// What the guard requires of a path.
#[derive(Clone, Copy, Debug)]
pub struct LookaheadDemand {
    /// Clearance that the vehicle itself needs around the reference (m): so much has to be known to be free.
    pub clearance_m: f64,
    /// Distance between the reference and any obstacle point (m); not less than that.
    pub standoff_m: f64,
    /// Reaction time (s).
    pub delay_s: f64,
    /// How hard the guard's own brake may be.
    pub braking: Braking,
    /// For how long from now no brake may become necessary (s): zero for the active trajectory, more for a new one.
    pub horizon_s: f64,
    /// Whether places in the field of view of a sensor that no longer answers count as unseen.
    pub loss_counts: bool,
    /// Whether the user declares that space above a free place is free.
    pub no_overhang: bool,
}

/// The result of following a trajectory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LookaheadResult {
    /// Distance along the path to the first conflict (m), and to what moves as it is now; infinity for none.
    pub free_distance_m: f64,
    /// What the conflict is; [`GuardReason::None`] for none.
    pub conflict: GuardReason,
    /// The conflict is with something that moves.
    pub is_moving: bool,
    /// Stopping distance from the present speed (m).
    pub stopping_m: f64,
    /// Distance that has to be free (m): to stop before the conflict from any time within the horizon.
    pub needed_m: f64,
}

impl LookaheadResult {
    /// Whether the conflict is too near to stop before it.
    pub fn is_blocked(&self) -> bool {
        self.free_distance_m < self.needed_m
    }
}

/// Follows trajectories through the ring. Holds the memory for the obstacle points.
#[derive(Clone, Debug)]
pub struct Lookahead {
    /// Obstacle points relative to `anchor_m`, one array per axis so that they are compared several at a time.
    north_m: Vec<f32>,
    east_m: Vec<f32>,
    anchor_m: [f64; 2],
}

impl Lookahead {
    /// Allocates all its memory.
    pub fn new() -> Self {
        Self {
            north_m: Vec::with_capacity(SENSORS * SLOTS),
            east_m: Vec::with_capacity(SENSORS * SLOTS),
            anchor_m: [0.0; 2],
        }
    }

    /// Follows `trajectory` from `now` on.
    pub fn follow(
        &mut self,
        now: Timestamp,
        trajectory: &Trajectory,
        query: &RingQuery<'_>,
        moving: &MovingNow<'_>,
        demand: &LookaheadDemand,
    ) -> LookaheadResult {
        let Some(start) = trajectory.at(now) else {
            return LookaheadResult {
                free_distance_m: f64::INFINITY,
                conflict: GuardReason::None,
                is_moving: false,
                stopping_m: 0.0,
                needed_m: 0.0,
            };
        };
        if let Some(met_m) = moving.met_m(now, trajectory, &start, demand) {
            return LookaheadResult {
                free_distance_m: met_m,
                conflict: GuardReason::Obstacle,
                is_moving: true,
                stopping_m: 0.0,
                needed_m: f64::INFINITY,
            };
        }
        self.gather(&start, query);
        let stopping_m = stopping_m(&start, trajectory.limits.jerk_mps3, demand);
        let mut walk = PathWalk {
            way_m: 0.0,
            last: start.position.vector(),
            best_clearance_m: self.clearance_m([start.position.x_m, start.position.y_m]),
            clear_until_m: 0.0,
            steps: 0,
            reach_m: stopping_m,
            longest_stop_m: stopping_m,
        };
        let mut skip_s = now.seconds_since(trajectory.start).max(0.0);
        let mut ahead_s = trajectory.start.seconds_since(now).max(0.0);
        for piece in trajectory.pieces() {
            if skip_s >= piece.duration_s {
                skip_s -= piece.duration_s;
                continue;
            }
            let begin_s = skip_s;
            skip_s = 0.0;
            let steps = steps_for(piece, begin_s);
            let step_s = (piece.duration_s - begin_s) / steps as f64;
            for step in 1..=steps {
                let t_s = begin_s + step_s * step as f64;
                ahead_s += step_s;
                let conflict = self.step(&mut walk, piece, t_s, query, demand);
                if conflict != GuardReason::None {
                    return walk.end(conflict, ahead_s <= demand.horizon_s, stopping_m);
                }
                if ahead_s <= demand.horizon_s {
                    walk.must_stop_from(&piece.at(t_s), trajectory.limits.jerk_mps3, demand);
                }
            }
        }
        LookaheadResult {
            free_distance_m: f64::INFINITY,
            conflict: GuardReason::None,
            is_moving: false,
            stopping_m,
            needed_m: stopping_m,
        }
    }

    fn step(
        &self,
        walk: &mut PathWalk,
        piece: &BezierPiece,
        t_s: f64,
        query: &RingQuery<'_>,
        demand: &LookaheadDemand,
    ) -> GuardReason {
        let position = bezier::evaluate(&piece.points(), t_s / piece.duration_s);
        walk.way_m += (position - walk.last).norm();
        walk.last = position;
        walk.steps += 1;
        let place_m = [position.x, position.y];
        if walk.way_m >= walk.clear_until_m && !self.is_clear(walk, place_m, demand) {
            return GuardReason::Obstacle;
        }
        if walk.way_m > FARTHEST_M || walk.steps > STEPS {
            return GuardReason::Unseen;
        }
        // Nothing else can be where the vehicle is.
        if query.is_here(place_m, demand.clearance_m) {
            return GuardReason::None;
        }
        match query.visibility(place_m, position.z, demand.clearance_m, demand.no_overhang) {
            Visibility::Free => GuardReason::None,
            Visibility::Lost if !demand.loss_counts => GuardReason::None,
            Visibility::Lost | Visibility::Unseen => GuardReason::Unseen,
        }
    }

    /// Whether the place (north, east) has the required clearance.
    fn is_clear(&self, walk: &mut PathWalk, place_m: [f64; 2], demand: &LookaheadDemand) -> bool {
        let clearance_m = self.clearance_m(place_m);
        if walk.best_clearance_m < demand.standoff_m {
            let asked_m = walk.best_clearance_m - LEAVING_SLACK_M;
            walk.best_clearance_m = walk.best_clearance_m.max(clearance_m);
            return clearance_m >= asked_m;
        }
        // The clearance shrinks no faster than the path advances: it need not be computed again before.
        walk.clear_until_m = walk.way_m + clearance_m - demand.standoff_m;
        clearance_m >= demand.standoff_m
    }

    fn gather(&mut self, start: &MotionState, query: &RingQuery<'_>) {
        self.anchor_m = [start.position.x_m, start.position.y_m];
        self.north_m.clear();
        self.east_m.clear();
        // The iterator yields at most one point per slot and sensor: never more than the memory holds.
        for [north, east] in query.obstacles().take(SENSORS * SLOTS) {
            self.north_m.push((north - self.anchor_m[0]) as f32);
            self.east_m.push((east - self.anchor_m[1]) as f32);
        }
    }

    /// Horizontal distance from a place (north, east) to the nearest obstacle point (m); infinity for none.
    fn clearance_m(&self, place_m: [f64; 2]) -> f64 {
        let north = (place_m[0] - self.anchor_m[0]) as f32;
        let east = (place_m[1] - self.anchor_m[1]) as f32;
        let nearest_m2 = self
            .north_m
            .iter()
            .zip(&self.east_m)
            .map(|(n, e)| (n - north) * (n - north) + (e - east) * (e - east))
            .fold(
                f32::INFINITY,
                |nearest, m2| if m2 < nearest { m2 } else { nearest },
            );
        f64::from(nearest_m2).sqrt()
    }
}

struct PathWalk {
    way_m: f64,
    last: Vector3<f64>,
    /// The greatest clearance so far, while it is less than required.
    best_clearance_m: f64,
    /// No obstacle can be too near before the path has this length (m).
    clear_until_m: f64,
    steps: usize,
    /// Farthest place to which a stop from any moment within the horizon leads (m).
    reach_m: f64,
    /// Longest of those stops (m).
    longest_stop_m: f64,
}

impl PathWalk {
    fn must_stop_from(&mut self, state: &MotionState, jerk_mps3: f64, demand: &LookaheadDemand) {
        let stop_m = stopping_m(state, jerk_mps3, demand);
        self.reach_m = self.reach_m.max(self.way_m + stop_m);
        self.longest_stop_m = self.longest_stop_m.max(stop_m);
    }

    /// The end of what was seen moves with the vehicle, because it sees farther from there: the longest stop has to fit
    /// in front of it. An obstacle stays: every stop has to end before it. A conflict within the horizon always blocks.
    fn end(&self, conflict: GuardReason, is_within_horizon: bool, stopping_m: f64) -> LookaheadResult {
        let needed_m = if is_within_horizon {
            f64::INFINITY
        } else if conflict == GuardReason::Obstacle {
            self.reach_m
        } else {
            self.longest_stop_m
        };
        LookaheadResult {
            free_distance_m: self.way_m,
            conflict,
            is_moving: false,
            stopping_m,
            needed_m,
        }
    }
}

fn steps_for(piece: &BezierPiece, begin_s: f64) -> usize {
    let velocity: [_; 5] = derivative(&piece.points(), piece.duration_s);
    let fastest_mps = velocity.iter().map(|v| v.norm()).fold(0.0, f64::max);
    let longest_m = fastest_mps * (piece.duration_s - begin_s);
    ((longest_m / STEP_M).ceil() as usize).clamp(1, STEPS)
}

/// Stopping distance from `state`. A reference that is still speeding up first has to reduce its acceleration `a` with
/// the jerk `j`: meanwhile it gains `a^2 / 2j` of speed, over a time `a / j`.
fn stopping_m(state: &MotionState, jerk_mps3: f64, demand: &LookaheadDemand) -> f64 {
    let velocity = state.velocity.vector();
    let speed_mps = velocity.norm();
    let gain_mps2 = if speed_mps > 1e-6 {
        (state.acceleration.vector().dot(&velocity) / speed_mps).max(0.0)
    } else {
        0.0
    };
    let release_s = gain_mps2 / jerk_mps3;
    let top_mps = speed_mps + 0.5 * gain_mps2 * release_s;
    top_mps * release_s + demand.braking.distance_m(top_mps, demand.delay_s, jerk_mps3)
}

#[cfg(test)]
mod tests {
    use super::{LookaheadDemand, PathWalk, stopping_m};
    use crate::guard::brake::Braking;
    use jink_shared_types::frames::{Acceleration, Velocity};
    use jink_shared_types::motion::{GuardReason, MotionState};
    use nalgebra::Vector3;
    use proptest::prelude::*;

    #[test]
    fn every_stop_ends_before_an_obstacle_and_the_longest_one_fits_in_front_of_the_unseen() {
        let walk = PathWalk {
            way_m: 5.0,
            last: Vector3::zeros(),
            best_clearance_m: 1.0,
            clear_until_m: 0.0,
            steps: 100,
            reach_m: 4.0,
            longest_stop_m: 3.0,
        };
        let needed_m = |conflict: GuardReason, is_within_horizon: bool| {
            walk.end(conflict, is_within_horizon, 2.0).needed_m
        };
        assert_eq!(needed_m(GuardReason::Obstacle, false), 4.0);
        assert_eq!(needed_m(GuardReason::Unseen, false), 3.0);
        for conflict in [GuardReason::Obstacle, GuardReason::Unseen] {
            assert_eq!(needed_m(conflict, true), f64::INFINITY);
        }
    }

    /// Distance that a motion with these accelerations at times in a row takes until it is at rest (m), step by step: the acceleration is
    /// released with the jerk, the reaction time passes, and the brake builds up with the same jerk.
    fn flown_m(speed_mps: f64, acceleration_mps2: f64, jerk_mps3: f64, demand: &LookaheadDemand) -> f64 {
        const STEP_S: f64 = 1e-4;
        let (mut speed_mps, mut acceleration_mps2) = (speed_mps, acceleration_mps2);
        let (mut way_m, mut waited_s) = (0.0, 0.0);
        while speed_mps > 0.0 {
            if acceleration_mps2 > 0.0 {
                acceleration_mps2 = (acceleration_mps2 - jerk_mps3 * STEP_S).max(0.0);
            } else if waited_s < demand.delay_s {
                waited_s += STEP_S;
            } else {
                acceleration_mps2 =
                    (acceleration_mps2 - jerk_mps3 * STEP_S).max(-demand.braking.range_mps2.0);
            }
            way_m += speed_mps * STEP_S;
            speed_mps += acceleration_mps2 * STEP_S;
        }
        way_m
    }

    proptest! {
        #[test]
        fn the_stopping_distance_of_a_motion_that_speeds_up_holds_what_it_gains(
            speed_mps in 0.3..6.0f64, gain_mps2 in 0.0..4.0f64, jerk_mps3 in 6.0..15.0f64,
            delay_s in 0.0..0.5f64, brake_mps2 in 1.0..3.0f64,
        ) {
            let demand = LookaheadDemand {
                clearance_m: 0.5,
                standoff_m: 0.5,
                delay_s,
                braking: Braking {
                    range_mps2: (brake_mps2, brake_mps2),
                    tracking: None,
                },
                horizon_s: 0.0,
                loss_counts: true,
                no_overhang: false,
            };
            let state = |acceleration_mps2: f64| MotionState {
                velocity: Velocity::new(0.6 * speed_mps, -0.8 * speed_mps, 0.0),
                acceleration: Acceleration::new(0.6 * acceleration_mps2, -0.8 * acceleration_mps2, 0.0),
                ..MotionState::default()
            };
            let needed_m = stopping_m(&state(gain_mps2), jerk_mps3, &demand);
            let way_m = flown_m(speed_mps, gain_mps2, jerk_mps3, &demand);
            prop_assert!(way_m <= needed_m + 2e-3, "{way_m} m flown, {needed_m} m said");
            // Whoever slows down already is not believed to need less.
            prop_assert!(stopping_m(&state(-gain_mps2), jerk_mps3, &demand) >= stopping_m(&state(0.0), jerk_mps3, &demand) - 1e-9);
        }
    }
}
