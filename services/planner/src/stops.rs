//! The stop family: motions to rest from a moving state, in closed form.
//!
//! Every stop is a quintic that ends at rest. With the end half of `v T` ahead and no initial acceleration its speed
//! falls as `v (1 - 3 u^2 + 2 u^3)`: the deceleration peaks at `1.5 v / T` half way and the jerk at `6 v / T^2` at both
//! ends, which gives the shortest duration for given limits.

use crate::configuration_space::ConfigurationSpace;
use jink_shared_types::bezier::{End, QUINTIC, derivative, evaluate, quintic_between};
use jink_shared_types::motion::{BezierPiece, MotionState, STOP_JERK};
use jink_shared_types::tracking::Tracking;
use nalgebra::{Rotation3, Vector3};

/// Decelerations tried, gentle first: shares of the hardest braking.
const DECELERATIONS: [f64; 4] = [0.4, 0.6, 0.8, 1.0];
/// Deceleration of a stop that is to be short, the same: with 3 m/s2 from 3 m/s in 3.8 m.
const BRISK: f64 = 0.6;
/// Hardest acceleration (m/s2) and jerk (m/s3) of a motion aside, however hard the autopilot brakes: PX4's MPC_ACC_HOR.
const ASIDE_MPS2: f64 = 3.0;
const ASIDE_JERK_MPS3: f64 = 12.0;
/// Changes of direction tried (degrees), straight first.
const TURNS_DEG: [f64; 7] = [0.0, 15.0, -15.0, 30.0, -30.0, 50.0, -50.0];
/// Points checked along a stop.
const SAMPLES: usize = 40;
/// Durations tried for a motion aside (s): from the shortest, each longer by this factor, to the longest. What takes
/// longer comes too late for a person who is predicted for three seconds.
const ASIDE_MIN_S: f64 = 0.6;
const ASIDE_STEP: f64 = 1.12;
const ASIDE_MAX_S: f64 = 4.0;
/// Share of the jerk that such a motion uses: between two of the points compared it may be a little greater.
const ASIDE_SHARE: f64 = 0.95;
/// Points at which it is compared with its limits.
const SAMPLES_OF_LIMITS: u32 = 12;

/// The stop from `start` with peak deceleration `deceleration_mps2`, its end turned by `turn_rad` about the vertical, of a
/// vehicle that follows as `tracking` says.
pub fn stop(start: &MotionState, tracking: &Tracking, deceleration_mps2: f64, turn_rad: f64) -> BezierPiece {
    /// Shortest stop; a duration of zero would divide by zero.
    const SHORTEST_S: f64 = 0.3;
    let velocity = start.velocity.vector();
    let speed = velocity.norm();
    let acceleration = start.acceleration.vector().norm();
    let (_, jerk_mps3) = tracking.hardest_stop();
    let most_mps3 = STOP_JERK * jerk_mps3;
    // The jerk begins with `turning v / T^2 - 4 a / T`, and a turn needs much: no guard would accept it from a slow
    // flight.
    let turning = (30.0 * turn_rad.cos() - 36.0).hypot(30.0 * turn_rad.sin()) * speed;
    let turned_s = (4.0 * acceleration
        + (16.0 * acceleration * acceleration + 4.0 * most_mps3 * turning).sqrt())
        / (2.0 * most_mps3);
    let duration_s = (1.5 * speed / deceleration_mps2)
        .max((6.0 * speed / jerk_mps3).sqrt())
        .max((2.0 * acceleration / jerk_mps3).max(SHORTEST_S))
        .max(turned_s);
    let ahead = Rotation3::from_axis_angle(&Vector3::z_axis(), turn_rad) * velocity * (0.5 * duration_s);
    // What the initial acceleration adds while it decays: the quintic's own share of it over one duration.
    let drift = start.acceleration.vector() * (duration_s * duration_s / 12.0);
    let end = End {
        position: start.position.vector() + ahead + drift,
        velocity: Vector3::zeros(),
        acceleration: Vector3::zeros(),
    };
    let points = quintic_between(&start.end(), &end, duration_s);
    // The yaw rate decays as the speed does.
    let yaw_end = start.yaw_rad + 0.5 * start.yaw_rate_radps * duration_s;
    BezierPiece::new(&points, yaw_between(start, yaw_end, duration_s), duration_s)
}

/// The heading from that of `start` to rest at `end_rad`.
fn yaw_between(start: &MotionState, end_rad: f64, duration_s: f64) -> [f64; QUINTIC] {
    let (from, to) = (
        yaw_state(start.yaw_rad, start.yaw_rate_radps),
        yaw_state(end_rad, 0.0),
    );
    quintic_between(&from, &to, duration_s).map(|point| point.x)
}

fn yaw_state(yaw_rad: f64, rate_radps: f64) -> End {
    End {
        position: Vector3::new(yaw_rad, 0.0, 0.0),
        velocity: Vector3::new(rate_radps, 0.0, 0.0),
        acceleration: Vector3::zeros(),
    }
}

/// The hardest straight stop from `start`.
pub fn hardest(start: &MotionState, tracking: &Tracking) -> BezierPiece {
    stop(start, tracking, tracking.hardest_stop().0, 0.0)
}

/// The first stop of the family, gentle and straight first, all of whose cells are safe in `tier`, and those that the
/// vehicle runs past its end; if there is none, the first that is safe up to its end.
pub fn certified(
    space: &ConfigurationSpace,
    tracking: &Tracking,
    tier: usize,
    start: &MotionState,
) -> Option<BezierPiece> {
    let mut without_overshoot = None;
    let (straight_mps2, _) = tracking.hardest_stop();
    for share in DECELERATIONS {
        for turn_deg in TURNS_DEG {
            let hardest_mps2 = match turn_deg == 0.0 {
                true => straight_mps2,
                false => straight_mps2.min(ASIDE_MPS2),
            };
            let deceleration_mps2 = share * hardest_mps2;
            let piece = stop(start, tracking, deceleration_mps2, turn_deg.to_radians());
            if !is_safe(space, tier, &piece) {
                continue;
            }
            if has_room_behind(space, tier, &piece, tracking.overshoot_m(deceleration_mps2)) {
                return Some(piece);
            }
            without_overshoot.get_or_insert(piece);
        }
    }
    without_overshoot
}

/// The shortest quintic from `start` to rest at `place` (local, m) that keeps the limits of a stop out of a motion with
/// at most `fastest_mps`; `None` if it takes longer than four seconds.
pub fn to_rest_at(start: &MotionState, place: &Vector3<f64>, fastest_mps: f64) -> Option<BezierPiece> {
    let end = End {
        position: *place,
        velocity: Vector3::zeros(),
        acceleration: Vector3::zeros(),
    };
    let fastest_mps = fastest_mps.max(start.velocity.vector().norm());
    let mut duration_s = ASIDE_MIN_S;
    while duration_s <= ASIDE_MAX_S {
        let points = quintic_between(&start.end(), &end, duration_s);
        let velocity: [_; 5] = derivative(&points, duration_s);
        let acceleration: [_; 4] = derivative(&velocity, duration_s);
        let jerk: [_; 3] = derivative(&acceleration, duration_s);
        let within = |value: Vector3<f64>, most: f64| value.norm() <= most;
        let keeps = (0..=SAMPLES_OF_LIMITS).all(|i| {
            let u = f64::from(i) / f64::from(SAMPLES_OF_LIMITS);
            within(evaluate(&jerk, u), ASIDE_SHARE * ASIDE_JERK_MPS3)
                && within(evaluate(&acceleration, u), ASIDE_MPS2)
                && within(evaluate(&velocity, u), fastest_mps)
        });
        if keeps {
            let yaw_end = start.yaw_rad + 0.5 * start.yaw_rate_radps * duration_s;
            return Some(BezierPiece::new(
                &points,
                yaw_between(start, yaw_end, duration_s),
                duration_s,
            ));
        }
        duration_s *= ASIDE_STEP;
    }
    None
}

/// A stop that is to be short: straight and harder, where its overshoot is safe as well; else one of the family.
pub fn brisk(
    space: &ConfigurationSpace,
    tracking: &Tracking,
    tier: usize,
    start: &MotionState,
) -> Option<BezierPiece> {
    let brisk_mps2 = BRISK * tracking.hardest_stop().0;
    let piece = stop(start, tracking, brisk_mps2, 0.0);
    let fits = is_safe(space, tier, &piece)
        && has_room_behind(space, tier, &piece, tracking.overshoot_m(brisk_mps2));
    fits.then_some(piece)
        .or_else(|| certified(space, tracking, tier, start))
}

/// Whether `overshoot_m` past the end of `piece` are safe in `tier`, in the direction from its start to its end.
fn has_room_behind(space: &ConfigurationSpace, tier: usize, piece: &BezierPiece, overshoot_m: f64) -> bool {
    let end = piece.at(piece.duration_s).position.vector();
    let ahead = (end - piece.at(0.0).position.vector()).try_normalize(1e-6);
    ahead.is_none_or(|ahead| space.segment_is_safe(tier, &end, &(end + ahead * overshoot_m)))
}

/// Whether every cell that `piece` passes is safe in `tier`.
pub fn is_safe(space: &ConfigurationSpace, tier: usize, piece: &BezierPiece) -> bool {
    let mut last = piece.at(0.0).position.vector();
    (1..=SAMPLES).all(|i| {
        let next = piece
            .at(piece.duration_s * i as f64 / SAMPLES as f64)
            .position
            .vector();
        let safe = space.segment_is_safe(tier, &last, &next);
        last = next;
        safe
    })
}

#[cfg(test)]
mod tests {
    use super::{brisk, certified, hardest, stop};
    use crate::configuration_space::tests::{known_map, space_of};
    use crate::speed_tiers::speed_tiers;
    use jink_shared_types::bezier::{derivative, evaluate};
    use jink_shared_types::frames::{Acceleration, Point, Velocity};
    use jink_shared_types::motion::{MotionLimits, MotionState};
    use jink_shared_types::params::ParamSet;
    use jink_shared_types::tracking::Tracking;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    fn moving(speed: f64) -> MotionState {
        MotionState {
            velocity: Velocity::new(speed, 0.0, 0.0),
            ..MotionState::default()
        }
    }

    proptest! {
        #[test]
        fn a_stop_out_of_a_plan_keeps_the_limits_of_a_stop(
            v in proptest::array::uniform3(-1.7..1.7f64), a in proptest::array::uniform3(-0.6..0.6f64),
            deceleration in 1.2..3.0f64, turn_deg in -50.0..50.0f64,
        ) {
            let start = MotionState {
                velocity: Velocity::new(v[0], v[1], v[2]),
                acceleration: Acceleration::new(a[0], a[1], a[2]),
                ..MotionState::default()
            };
            let tracking = Tracking::PX4_TRAJECTORY;
            let limits = speed_tiers(&ParamSet::default(), &tracking)[0].of_a_stop(&tracking, Vector3::from(v).norm());
            let piece = stop(&start, &tracking, deceleration, turn_deg.to_radians());
            let velocity: [_; 5] = derivative(&piece.points(), piece.duration_s);
            let acceleration: [_; 4] = derivative(&velocity, piece.duration_s);
            let jerk: [_; 3] = derivative(&acceleration, piece.duration_s);
            for i in 0..=40 {
                let u = f64::from(i) / 40.0;
                prop_assert!(evaluate(&velocity, u).norm() <= MotionLimits::allowed(limits.speed_mps));
                prop_assert!(evaluate(&acceleration, u).norm() <= MotionLimits::allowed(limits.acceleration_mps2));
                prop_assert!(evaluate(&jerk, u).norm() <= MotionLimits::allowed(limits.jerk_mps3));
            }
        }

        #[test]
        fn a_stop_starts_as_it_must_ends_at_rest_and_brakes_within_its_limit(
            v in proptest::array::uniform3(-4.0..4.0f64), a in proptest::array::uniform3(-1.0..1.0f64),
            deceleration in 1.0..3.0f64,
        ) {
            let start = MotionState {
                velocity: Velocity::new(v[0], v[1], v[2]),
                acceleration: Acceleration::new(a[0], a[1], a[2]),
                ..MotionState::default()
            };
            let piece = stop(&start, &Tracking::PX4_TRAJECTORY, deceleration, 0.0);
            let first = piece.at(0.0);
            prop_assert!((first.velocity.vector() - start.velocity.vector()).norm() < 1e-6);
            prop_assert!((first.acceleration.vector() - start.acceleration.vector()).norm() < 1e-6);
            let last = piece.at(piece.duration_s);
            prop_assert!(last.velocity.vector().norm() < 1e-6 && last.acceleration.vector().norm() < 1e-6);
            for i in 0..=20 {
                let state = piece.at(piece.duration_s * f64::from(i) / 20.0);
                // Some of the initial acceleration adds to the braking.
                prop_assert!(state.acceleration.vector().norm() <= deceleration + 2.0 * Vector3::from(a).norm() + 0.05);
            }
        }
    }

    #[test]
    fn a_post_ahead_is_met_by_braking_harder_or_aside() {
        let space = space_of(&known_map(|p| (p.x - 4.6).hypot(p.y) < 0.3));
        let piece = certified(&space, &Tracking::PX4_TRAJECTORY, 1, &moving(3.0)).unwrap();
        let end = piece.at(piece.duration_s).position;
        assert!(end.x_m < 4.0 || end.y_m.abs() > 0.5, "{end:?}");
        assert!(
            certified(&space, &Tracking::PX4_TRAJECTORY, 1, &moving(12.0)).is_none(),
            "too fast for anything"
        );
    }

    #[test]
    fn a_brisk_stop_needs_clearance_for_its_overshoot_else_the_gentle_family_is_tried() {
        let path_m = |wall_m: f64| {
            let space = space_of(&known_map(|p| p.x > wall_m));
            brisk(&space, &Tracking::PX4_TRAJECTORY, 1, &moving(3.0))
                .map(|piece| piece.at(piece.duration_s).position)
        };
        let open = path_m(11.0).unwrap();
        assert!(open.x_m < 4.0 && open.y_m == 0.0, "{open:?}");
        let near = path_m(5.0).unwrap();
        assert!(near != open, "{near:?}");
    }

    #[test]
    fn a_stop_with_room_behind_its_end_is_taken_before_a_gentler_one_without() {
        let end_m = |tracking: &Tracking, wall_m: f64| {
            let space = space_of(&known_map(|p| p.x > wall_m));
            let piece = certified(&space, tracking, 1, &moving(3.0))?;
            Some(piece.at(piece.duration_s).position.x_m)
        };
        let (loose, close) = (Tracking::PX4_TRAJECTORY, Tracking::ARDUPILOT_GUIDED);
        // With 1.2 m/s2 a stop from 3 m/s ends 5.6 m ahead.
        let wall_m = (12..40)
            .map(|i| 0.2 * f64::from(i))
            .find(|wall_m| end_m(&close, *wall_m).is_some_and(|end_m| end_m > 5.0))
            .unwrap();
        assert!(end_m(&loose, wall_m).unwrap() < 5.0);
        assert!(end_m(&loose, wall_m + 0.8).unwrap() > 5.0);
    }

    #[test]
    fn the_hardest_stop_from_three_metres_per_second_is_short() {
        let end = hardest(&moving(3.0), &Tracking::PX4_TRAJECTORY).at(10.0).position;
        assert!(end.vector().x < 3.0 && end != Point::ZERO);
    }
}
