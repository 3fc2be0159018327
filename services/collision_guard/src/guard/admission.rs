//! What a trajectory must be, independent of obstacles: sound, within its own limits, at rest at its end, and a
//! continuation of what is being flown.
//!
//! Limits are tested on the control points of the derivatives: a curve lies in the hull of its control points, so a
//! bound that holds for them holds for the curve (see [`jink_shared_types::bezier`]). The hull is larger than the
//! curve; where it exceeds a limit the curve is cut in halves, twice at most, which removes fifteen sixteenths of the
//! excess. How much a limit may be exceeded is the same for the generator
//! ([`jink_shared_types::motion::LIMIT_TOLERANCE`]).

use jink_shared_types::Timestamp;
use jink_shared_types::bezier::{derivative, derivative_scalar, hull_keeps};
use jink_shared_types::motion::{BezierPiece, GuardReason, MotionLimits, MotionState, Trajectory};
use nalgebra::Vector3;

/// How far two states that should be equal may differ. The prefix of a new trajectory is cut out of the old one at
/// times rounded to 0.1 ms (`Trajectory::take_prefix`): at 20 m/s, 15 m/s2 and 60 m/s3 that is 2 mm, 1.5 mm/s and 6
/// mm/s2. The tolerances allow ten times that, for sums and for generators that match the splice by iteration, and are
/// still below what affects an autopilot's controller: its position noise, and a change of tilt by half a degree.
const SAME_POSITION_M: f64 = 0.02;
const SAME_VELOCITY_MPS: f64 = 0.05;
const SAME_ACCELERATION_MPS2: f64 = 0.1;
/// How often a curve is halved before its hull counts as its extent.
const HALVINGS: u32 = 2;
/// Pieces cut shorter than this (s) are rounding errors.
const NEGLIGIBLE_S: f64 = 1e-4;
/// Limits beyond these are damaged data: what the parameter table allows, and a jerk beyond any multicopter's.
const PLAUSIBLE_SPEED_MPS: f64 = 25.0;
const PLAUSIBLE_ACCELERATION_MPS2: f64 = 20.0;
const PLAUSIBLE_JERK_MPS3: f64 = 500.0;
const PLAUSIBLE_YAW_RATE_RADPS: f64 = 20.0;

/// Whether `candidate` is a valid trajectory: sound, continuous from piece to piece, at rest at its end, and after its
/// departure within its own limits.
///
/// # Errors
/// [`GuardReason::Unsound`] or, for a jump between pieces, [`GuardReason::Discontinuous`].
pub fn examine(candidate: &Trajectory) -> Result<(), GuardReason> {
    // Identity zero means "none": a successor could not name it as its base.
    if !candidate.is_sound() || candidate.id == 0 || !are_plausible(&candidate.limits) {
        return Err(GuardReason::Unsound);
    }
    let pieces = candidate.pieces();
    for (before, after) in pieces.iter().zip(pieces.iter().skip(1)) {
        if !are_same(&before.at(before.duration_s), &after.at(0.0)) {
            return Err(GuardReason::Discontinuous);
        }
    }
    let ends_at_rest = pieces.last().is_some_and(|last| {
        let end = last.at(last.duration_s);
        are_same(&end, &MotionState::at_rest(end.position, end.yaw_rad))
    });
    if !ends_at_rest || !keeps_its_limits(candidate) {
        return Err(GuardReason::Unsound);
    }
    Ok(())
}

/// The time at which `trajectory` departs from what was flown before.
pub fn departure(trajectory: &Trajectory) -> Timestamp {
    if trajectory.splice.is_set() {
        trajectory.splice
    } else {
        trajectory.start
    }
}

/// Whether `candidate` equals `active` from `now` to its departure, and departs there without a jump.
///
/// # Errors
/// [`GuardReason::Discontinuous`].
pub fn joins(candidate: &Trajectory, active: &Trajectory, now: Timestamp) -> Result<(), GuardReason> {
    /// A reader may switch at any time up to the splice, so more than both ends is compared.
    const COMPARED: usize = 5;
    let span_s = departure(candidate).seconds_since(now).max(0.0);
    for i in 0..COMPARED {
        let time = now.plus_seconds(span_s * i as f64 / (COMPARED - 1) as f64);
        let same = match (candidate.at(time), active.at(time)) {
            (Some(new), Some(old)) => are_same(&new, &old),
            _ => false,
        };
        if !same {
            return Err(GuardReason::Discontinuous);
        }
    }
    Ok(())
}

/// False for NaN.
fn are_same(a: &MotionState, b: &MotionState) -> bool {
    (a.position.vector() - b.position.vector()).norm() <= SAME_POSITION_M
        && (a.velocity.vector() - b.velocity.vector()).norm() <= SAME_VELOCITY_MPS
        && (a.acceleration.vector() - b.acceleration.vector()).norm() <= SAME_ACCELERATION_MPS2
}

fn are_plausible(limits: &MotionLimits) -> bool {
    let positive = |value: f64, most: f64| value > 0.0 && value <= most;
    positive(limits.speed_mps, PLAUSIBLE_SPEED_MPS)
        && positive(limits.climb_mps, PLAUSIBLE_SPEED_MPS)
        && positive(limits.descent_mps, PLAUSIBLE_SPEED_MPS)
        && positive(limits.acceleration_mps2, PLAUSIBLE_ACCELERATION_MPS2)
        && positive(limits.jerk_mps3, PLAUSIBLE_JERK_MPS3)
        && (0.0..=PLAUSIBLE_ACCELERATION_MPS2).contains(&limits.braking_mps2)
        && (0.0..=PLAUSIBLE_JERK_MPS3).contains(&limits.braking_jerk_mps3)
        && (0.0..=PLAUSIBLE_YAW_RATE_RADPS).contains(&limits.yaw_rate_radps)
}

/// Only what comes after the departure is checked: the prefix was checked when it was approved, perhaps under other
/// limits. For the same reason the state at the departure may exceed a limit (a brake is harder than a plan); the rest
/// must not exceed it further.
fn keeps_its_limits(candidate: &Trajectory) -> bool {
    let skip_s = departure(candidate).seconds_since(candidate.start).max(0.0);
    let Some(start) = candidate.at(candidate.start.plus_seconds(skip_s)) else {
        return false;
    };
    let limits = &candidate.limits;
    let [going, braking] = [*limits, limits.of_braking()].map(|limits| AdmissionBounds::new(&limits, &start));
    let mut piece_start_s = 0.0;
    for (number, piece) in candidate.pieces().iter().enumerate() {
        let cut_s = skip_s - piece_start_s;
        piece_start_s += piece.duration_s;
        if cut_s > piece.duration_s - NEGLIGIBLE_S {
            continue;
        }
        let after = if cut_s > NEGLIGIBLE_S {
            piece.split(cut_s).1
        } else {
            *piece
        };
        let is_kept = match candidate.is_braking(number) {
            true => braking.hold_for(&after) && after.is_straight(limits.across_mps2(), &start),
            false => going.hold_for(&after),
        };
        if !is_kept {
            return false;
        }
    }
    true
}

struct AdmissionBounds {
    speed_mps: f64,
    climb_mps: f64,
    descent_mps: f64,
    acceleration_mps2: f64,
    jerk_mps3: f64,
    yaw_rate_radps: f64,
}

impl AdmissionBounds {
    fn new(limits: &MotionLimits, start: &MotionState) -> Self {
        let bound = |limit: f64, inherited: f64| MotionLimits::allowed(limit.max(inherited));
        Self {
            speed_mps: bound(limits.speed_mps, start.velocity.vector().norm()),
            climb_mps: bound(limits.climb_mps, -start.velocity.z_mps),
            descent_mps: bound(limits.descent_mps, start.velocity.z_mps),
            acceleration_mps2: bound(limits.acceleration_mps2, start.acceleration.vector().norm()),
            jerk_mps3: bound(limits.jerk_mps3, 0.0),
            yaw_rate_radps: bound(limits.yaw_rate_radps, start.yaw_rate_radps.abs()),
        }
    }

    fn hold_for(&self, piece: &BezierPiece) -> bool {
        let velocity: [_; 5] = derivative(&piece.points(), piece.duration_s);
        let acceleration: [_; 4] = derivative(&velocity, piece.duration_s);
        let jerk: [_; 3] = derivative(&acceleration, piece.duration_s);
        let yaw_rate: [f64; 5] = derivative_scalar(&piece.yaw_rad, piece.duration_s);
        hull_keeps(&velocity, HALVINGS, &|v: &Vector3<f64>| {
            v.norm() <= self.speed_mps && -v.z <= self.climb_mps && v.z <= self.descent_mps
        }) && hull_keeps(&acceleration, HALVINGS, &|a: &Vector3<f64>| {
            a.norm() <= self.acceleration_mps2
        }) && hull_keeps(&jerk, HALVINGS, &|j: &Vector3<f64>| j.norm() <= self.jerk_mps3)
            && hull_keeps(
                &yaw_rate.map(|rate| Vector3::new(rate, 0.0, 0.0)),
                HALVINGS,
                &|rate: &Vector3<f64>| rate.x.abs() <= self.yaw_rate_radps,
            )
    }
}

#[cfg(test)]
mod tests {
    use super::examine;
    use jink_shared_types::Timestamp;
    use jink_shared_types::bezier::{End, quintic_between};
    use jink_shared_types::motion::{
        BezierPiece, GuardReason, LIMIT_SLACK, LIMIT_TOLERANCE, MotionLimits, Trajectory,
    };
    use jink_testkit::motions::{extremes, hop, limits_of};
    use nalgebra::Vector3;
    use proptest::prelude::*;

    fn examined(pieces: &[BezierPiece], limits: MotionLimits) -> Result<(), GuardReason> {
        let mut trajectory = Trajectory {
            id: 1,
            start: Timestamp::from_seconds(100.0),
            limits,
            ..Trajectory::default()
        };
        assert!(pieces.iter().all(|piece| trajectory.push(*piece)));
        examine(&trajectory)
    }

    /// A stop from 4 m/s with 6 m/s2, along x, its end `aside_m` beside that.
    fn stop(aside_m: f64) -> BezierPiece {
        let start = End {
            position: Vector3::zeros(),
            velocity: Vector3::new(4.0, 0.0, 0.0),
            acceleration: Vector3::zeros(),
        };
        let end = End {
            position: Vector3::new(2.0, aside_m, 0.0),
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
        };
        BezierPiece::new(&quintic_between(&start, &end, 1.0), [0.0; 6], 1.0)
    }

    #[test]
    fn only_a_piece_that_brakes_may_brake_hard_and_only_straight_on() {
        let limits = MotionLimits {
            speed_mps: 5.0,
            climb_mps: 1.0,
            descent_mps: 1.0,
            acceleration_mps2: 2.5,
            jerk_mps3: 10.0,
            yaw_rate_radps: 1.0,
            braking_mps2: 7.0,
            braking_jerk_mps3: 30.0,
            ..MotionLimits::default()
        };
        let judged = |aside_m: f64, brakes: bool, limits: MotionLimits| {
            let mut trajectory = Trajectory {
                id: 1,
                start: Timestamp::from_seconds(100.0),
                limits,
                ..Trajectory::default()
            };
            let fits = match brakes {
                true => trajectory.push_braking(stop(aside_m)),
                false => trajectory.push(stop(aside_m)),
            };
            assert!(fits);
            examine(&trajectory)
        };
        assert_eq!(judged(0.0, true, limits), Ok(()));
        assert_eq!(judged(0.0, false, limits), Err(GuardReason::Unsound));
        assert_eq!(judged(0.7, true, limits), Err(GuardReason::Unsound));
        let softer = MotionLimits {
            braking_mps2: 5.0,
            ..limits
        };
        assert_eq!(judged(0.0, true, softer), Err(GuardReason::Unsound));
    }

    proptest! {
        #[test]
        fn what_breaks_any_one_limit_is_refused_and_what_keeps_all_passes(
            pieces in hop(), broken in 0usize..6, excess in 1e-6..0.5f64,
        ) {
            let mut values = extremes(&pieces, true);
            prop_assert_eq!(examined(&pieces, limits_of(values)), Ok(()));
            let reached = extremes(&pieces, false)[broken];
            values[broken] = (reached * (1.0 - excess) - LIMIT_SLACK) / (1.0 + LIMIT_TOLERANCE);
            prop_assert!(values[broken] > 0.0, "refused as too much, not as a limit that is none");
            let refused = examined(&pieces, limits_of(values));
            prop_assert_eq!(refused, Err(GuardReason::Unsound), "{:?}, {} reached", values, reached);
        }
    }
}
