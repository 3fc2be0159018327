//! What joins what is flown, in time, within its limits and on fresh data, passes; everything else is refused with its
//! reason, and what was flown continues.

use crate::common::{
    VehiclePose, World, end, guard, hovering_guard, look, on, ring, step, straight, successor, time,
    trajectory,
};
use jink_collision_guard::guard::{Guard, GuardInputs};
use jink_collision_guard::ring::Ring;
use jink_shared_types::motion::{ApprovedTrajectory, GuardReason, Trajectory, TrajectoryMode, Verdict};
use jink_shared_types::{Coded, Reading, events};

const NOW_S: f64 = 10.0;

/// A guard that flies trajectory 7 (straight north at 3 m/s, for 30 m) since `NOW_S`, in the open.
fn flying() -> (Guard, Ring, Trajectory) {
    let (mut guard, ring) = hovering_guard(NOW_S);
    let first = straight(7, NOW_S, 3.0, 2.0, 30.0);
    let (out, step_events) = step(&mut guard, NOW_S, Some(&first), &ring, VehiclePose::at(0.0, 0.0));
    assert_eq!(out.verdict, Verdict::Passed, "{:?}", out.reason);
    assert!(step_events.events().is_empty());
    (guard, ring, first)
}

fn refused(
    guard: &mut Guard,
    ring: &Ring,
    at_s: f64,
    candidate: &Trajectory,
    flown: &Trajectory,
) -> GuardReason {
    let (out, _) = step(guard, at_s, Some(candidate), ring, on(flown, at_s));
    assert_eq!(out.verdict, Verdict::Kept);
    assert_eq!(out.trajectory.id, flown.id, "the one before goes on");
    out.reason.get()
}

/// One step with a state that is too old.
fn blind_step(
    guard: &mut Guard,
    at_s: f64,
    candidate: Option<&Trajectory>,
    ring: &Ring,
) -> ApprovedTrajectory {
    let mut out = ApprovedTrajectory::default();
    let inputs = GuardInputs {
        trajectory: candidate,
        state: Reading::Stale { age_s: 0.2 },
        ring,
        moving: Reading::Never,
    };
    guard.step(time(at_s), &inputs, &mut out);
    out
}

#[test]
fn a_successor_that_fits_passes() {
    let (mut guard, mut ring, first) = flying();
    let t = NOW_S + 0.2;
    look(&mut ring, &World::default(), on(&first, t), t);
    let next = successor(&first, 8, t, t + 0.15);
    let (out, _) = step(&mut guard, t, Some(&next), &ring, on(&first, t));
    assert_eq!(
        (out.verdict.get(), out.reason.get()),
        (Verdict::Passed, GuardReason::None)
    );
    assert_eq!(out.trajectory, next);
}

#[test]
fn what_is_approved_is_published_on_every_call_and_rests_after_its_end() {
    let (mut guard, ring, first) = flying();
    for t in [NOW_S + 0.1, NOW_S + 100.0] {
        let (out, _) = step(&mut guard, t, None, &ring, VehiclePose::at(0.0, 0.0));
        assert_eq!(out.trajectory, first);
    }
    let rest = first.at(time(NOW_S + 100.0)).unwrap();
    assert_eq!(rest.velocity.vector().norm(), 0.0);
}

#[test]
fn the_same_trajectory_again_is_nothing_new() {
    let (mut guard, ring, first) = flying();
    let (out, _) = step(
        &mut guard,
        NOW_S + 0.1,
        Some(&first),
        &ring,
        on(&first, NOW_S + 0.1),
    );
    assert_eq!(out.verdict, Verdict::Passed);
}

#[test]
fn what_departs_from_another_one_is_refused() {
    let (mut guard, ring, first) = flying();
    let t = NOW_S + 0.2;
    let mut unknown_peer = successor(&first, 8, t, t + 0.15);
    unknown_peer.base_id = 6;
    assert_eq!(
        refused(&mut guard, &ring, t, &unknown_peer, &first),
        GuardReason::WrongBase
    );
    let mut from_rest = straight(9, t, 1.0, 2.0, 3.0);
    from_rest.base_id = 0;
    assert_eq!(
        refused(&mut guard, &ring, t, &from_rest, &first),
        GuardReason::WrongBase
    );
}

#[test]
fn what_comes_after_its_splice_is_refused() {
    let (mut guard, ring, first) = flying();
    let next = successor(&first, 8, NOW_S + 0.1, NOW_S + 0.15);
    assert_eq!(
        refused(&mut guard, &ring, NOW_S + 0.16, &next, &first),
        GuardReason::Late
    );
}

#[test]
fn a_jump_at_the_splice_is_refused() {
    let (mut guard, ring, first) = flying();
    let t = NOW_S + 0.2;
    let fitting = successor(&first, 8, t, t + 0.15);
    for (shift_m, expected) in [(0.01, Verdict::Passed), (0.05, Verdict::Kept)] {
        let mut shifted = fitting;
        for piece in &mut shifted.pieces {
            for point in &mut piece.position {
                point.y_m += shift_m;
            }
        }
        let (out, _) = step(&mut guard.clone(), t, Some(&shifted), &ring, on(&first, t));
        assert_eq!(out.verdict, expected, "shifted by {shift_m}");
    }
    let mut early = fitting;
    early.start = time(t - 0.05);
    assert_eq!(
        refused(&mut guard, &ring, t, &early, &first),
        GuardReason::Discontinuous
    );
}

#[test]
fn a_jump_between_pieces_is_refused() {
    let (mut guard, ring, first) = flying();
    let t = NOW_S + 0.2;
    let mut torn = successor(&first, 8, t, t + 0.15);
    let last = torn.len as usize - 1;
    for point in &mut torn.pieces[last].position {
        point.z_m -= 0.1;
    }
    assert_eq!(
        refused(&mut guard, &ring, t, &torn, &first),
        GuardReason::Discontinuous
    );
}

#[test]
fn what_breaks_its_own_limits_is_refused() {
    let (mut guard, ring, first) = flying();
    // Steady flight: what exceeds a limit has not been inherited.
    let t = NOW_S + 3.0;
    let fitting = successor(&first, 8, t, t + 0.15);
    let over = |change: &dyn Fn(&mut Trajectory)| {
        let mut made = fitting;
        change(&mut made);
        made
    };
    let last = fitting.len as usize - 1;
    for (what, candidate) in [
        ("acceleration", over(&|t| t.limits.acceleration_mps2 = 0.5)),
        ("jerk", over(&|t| t.limits.jerk_mps3 = 0.5)),
        (
            "yaw rate",
            over(&|t| t.pieces[last].yaw_rad = [0.0, 5.0, 10.0, 15.0, 20.0, 25.0]),
        ),
        (
            "limits without a number",
            over(&|t| t.limits.speed_mps = f64::NAN),
        ),
        (
            "limits beyond any vehicle",
            over(&|t| t.limits.acceleration_mps2 = 1e9),
        ),
        ("a number", over(&|t| t.pieces[0].position[2].x_m = f64::INFINITY)),
        ("a duration", over(&|t| t.pieces[0].duration_s = 0.0)),
        ("identity", over(&|t| t.id = 0)),
        ("pieces", over(&|t| t.len = 0)),
        ("room", over(&|t| t.len = 99)),
        ("rest at the end", over(&|t| t.len -= 1)),
    ] {
        let (out, _) = step(&mut guard, t, Some(&candidate), &ring, on(&first, t));
        assert_eq!(
            (out.verdict.get(), out.reason.get()),
            (Verdict::Kept, GuardReason::Unsound),
            "{what}"
        );
        assert_eq!(out.trajectory.id, 7);
    }
}

#[test]
fn what_speeds_up_beyond_its_own_limit_is_refused_and_what_slows_down_to_it_is_not() {
    let (mut guard, mut ring, first) = flying();
    let t = NOW_S + 3.0;
    look(&mut ring, &World::default(), on(&first, t), t);
    let slower = {
        let mut made = successor(&first, 8, t, t + 0.15);
        made.limits.speed_mps = 1.0;
        made
    };
    let (out, _) = step(&mut guard.clone(), t, Some(&slower), &ring, on(&first, t));
    assert_eq!(
        out.verdict,
        Verdict::Passed,
        "the speed at the splice is not its fault: {:?}",
        out.reason
    );
    let mut faster = straight(8, NOW_S, 3.0, 2.0, 30.0);
    faster.base_id = 7;
    faster.splice = time(NOW_S + 3.0);
    let far = faster.len as usize - 1;
    // Twice as far in the same time.
    let from = faster.pieces[far].at(0.0).end();
    let to = end([from.position.x + 8.0, 0.0], [0.0, 0.0]);
    faster.pieces[far] = jink_shared_types::motion::BezierPiece::new(
        &jink_shared_types::bezier::quintic_between(&from, &to, 2.0),
        [0.0; 6],
        2.0,
    );
    faster.limits.acceleration_mps2 = 20.0;
    faster.limits.jerk_mps3 = 100.0;
    assert_eq!(
        refused(&mut guard, &ring, t, &faster, &first),
        GuardReason::Unsound
    );
}

#[test]
fn a_motion_from_rest_must_start_where_the_vehicle_is() {
    let (guard, ring) = hovering_guard(NOW_S);
    let start = straight(7, NOW_S + 0.1, 2.0, 2.0, 10.0);
    for (x, expected) in [
        (0.9, (Verdict::Passed, GuardReason::None)),
        (1.1, (Verdict::Hold, GuardReason::Discontinuous)),
    ] {
        let (out, _) = step(
            &mut guard.clone(),
            NOW_S,
            Some(&start),
            &ring,
            VehiclePose::at(x, 0.0),
        );
        assert_eq!((out.verdict.get(), out.reason.get()), expected, "{x} m away");
    }
}

#[test]
fn a_motion_that_continues_none_must_start_as_the_vehicle_moves() {
    let (guard, ring) = hovering_guard(NOW_S);
    let moving = VehiclePose {
        velocity: nalgebra::Vector3::new(2.0, 0.0, 0.0),
        ..VehiclePose::at(0.0, 0.0)
    };
    let stop = |speed: f64| {
        let to_rest = [(end([speed, 0.0], [0.0, 0.0]), 2.0)];
        trajectory(7, NOW_S + 0.1, end([0.2, 0.0], [speed, 0.0]), &to_rest)
    };
    for (speed, expected) in [
        (2.0, (Verdict::Passed, GuardReason::None)),
        (0.6, (Verdict::Passed, GuardReason::None)),
        (0.4, (Verdict::Hold, GuardReason::Discontinuous)),
        (3.6, (Verdict::Hold, GuardReason::Discontinuous)),
    ] {
        let (out, _) = step(&mut guard.clone(), NOW_S, Some(&stop(speed)), &ring, moving);
        assert_eq!((out.verdict.get(), out.reason.get()), expected, "{speed} m/s");
    }
}

#[test]
fn from_rest_again_after_the_end() {
    let (mut guard, mut ring, first) = flying();
    let t = first.end().seconds() + 1.0;
    let place = VehiclePose::at(30.0, 0.0);
    look(&mut ring, &World::default(), place, t);
    let again = trajectory(
        9,
        t,
        end([30.0, 0.0], [0.0, 0.0]),
        &[(end([33.0, 0.0], [0.0, 0.0]), 4.0)],
    );
    let (out, _) = step(&mut guard, t, Some(&again), &ring, place);
    assert_eq!(
        (out.verdict.get(), out.trajectory.id),
        (Verdict::Passed, 9),
        "{:?}",
        out.reason
    );
}

#[test]
fn without_fresh_ranges_nothing_new_passes_but_a_stop_and_a_mirror() {
    let (mut guard, ring, first) = flying();
    let t = NOW_S + 0.4;
    assert!(!ring.is_fresh(time(t)));
    let next = successor(&first, 8, t, t + 0.15);
    assert_eq!(
        refused(&mut guard, &ring, t, &next, &first),
        GuardReason::RangesStale
    );
    let stop = Trajectory {
        mode: Coded::new(TrajectoryMode::Stop),
        ..next
    };
    let (out, _) = step(&mut guard.clone(), t, Some(&stop), &ring, on(&first, t));
    assert_eq!((out.verdict.get(), out.trajectory.id), (Verdict::Passed, 8));
    let mirror = Trajectory::default();
    let (out, _) = step(&mut guard, t, Some(&mirror), &ring, on(&first, t));
    assert_eq!(out.verdict, Verdict::Passed);
    assert_eq!(
        (out.trajectory.mode.get(), out.trajectory.len),
        (TrajectoryMode::Mirror, 0)
    );
}

#[test]
fn without_a_fresh_state_nothing_new_passes_but_a_stop() {
    let (mut guard, ring, first) = flying();
    let t = NOW_S + 0.2;
    let next = successor(&first, 8, t, t + 0.15);
    let out = blind_step(&mut guard, t, Some(&next), &ring);
    assert_eq!(
        (out.verdict.get(), out.reason.get()),
        (Verdict::Kept, GuardReason::StateStale)
    );
    assert_eq!(out.trajectory.id, 7);
    let stop = Trajectory {
        mode: Coded::new(TrajectoryMode::Stop),
        ..next
    };
    assert_eq!(blind_step(&mut guard, t, Some(&stop), &ring).trajectory.id, 8);
}

#[test]
fn a_mirror_forgets_what_was_flown() {
    let (mut guard, ring, first) = flying();
    let t = NOW_S + 0.2;
    step(&mut guard, t, Some(&Trajectory::default()), &ring, on(&first, t));
    let next = successor(&first, 8, t, t + 0.15);
    let (out, _) = step(&mut guard, t, Some(&next), &ring, on(&first, t));
    assert_eq!(
        (out.verdict.get(), out.reason.get()),
        (Verdict::Kept, GuardReason::WrongBase)
    );
    assert_eq!(out.trajectory.mode, TrajectoryMode::Mirror);
}

#[test]
fn a_mirror_with_pieces_is_no_mirror() {
    let (mut guard, ring, first) = flying();
    let damaged = Trajectory {
        id: 8,
        mode: Coded::new(TrajectoryMode::Mirror),
        ..first
    };
    assert_eq!(
        refused(&mut guard, &ring, NOW_S + 0.1, &damaged, &first),
        GuardReason::Unsound
    );
}

#[test]
fn lost_and_returned_ranges_are_reported_once_each() {
    let (mut guard, mut ring, first) = flying();
    let mut reported = Vec::new();
    for i in 1..40 {
        let t = NOW_S + 0.05 * f64::from(i);
        if i > 25 {
            look(&mut ring, &World::default(), on(&first, t), t);
        }
        let (_, step_events) = step(&mut guard, t, None, &ring, on(&first, t));
        reported.extend(step_events.events().iter().map(|event| event.id));
    }
    assert_eq!(reported, [events::RANGES_LOST.id, events::RANGES_BACK.id]);
}

#[test]
fn a_guard_that_has_never_had_ranges_does_not_complain_of_losing_them() {
    let mut guard = guard();
    let (out, step_events) = step(&mut guard, NOW_S, None, &ring(), VehiclePose::at(0.0, 0.0));
    assert!(step_events.events().is_empty());
    assert_eq!((out.verdict.get(), out.trajectory.len), (Verdict::Hold, 0));
}
