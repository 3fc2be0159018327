//! A guard that has just started holds until it knows what is flown, and takes it over without a jump.

use crate::common::{VehiclePose, World, guard, looking, on, step, straight, successor, time};
use jink_collision_guard::guard::Guard;
use jink_collision_guard::ring::Ring;
use jink_shared_types::motion::{GuardReason, Trajectory, Verdict};

const NOW_S: f64 = 10.0;

/// A new guard in the middle of a flight along `first`, at `t`, and the successor that comes to it.
fn restarted(t: f64) -> (Guard, Ring, Trajectory, Trajectory) {
    let first = straight(7, NOW_S, 3.0, 2.0, 30.0);
    let ring = looking(&World::default(), on(&first, t), t);
    let next = successor(&first, 8, t - 0.02, t + 0.1);
    (guard(), ring, first, next)
}

#[test]
fn it_holds_until_a_trajectory_that_covers_now_comes() {
    let t = NOW_S + 3.0;
    let (mut guard, ring, first, next) = restarted(t);
    let (out, _) = step(&mut guard, t, None, &ring, on(&first, t));
    assert_eq!((out.verdict.get(), out.trajectory.len), (Verdict::Hold, 0));
    let (out, _) = step(&mut guard, t, Some(&next), &ring, on(&first, t));
    assert_eq!(
        (out.verdict.get(), out.trajectory.id),
        (Verdict::Passed, 8),
        "{:?}",
        out.reason
    );
}

#[test]
fn it_takes_none_that_has_departed_already() {
    let t = NOW_S + 3.0;
    let (mut guard, ring, first, next) = restarted(t);
    let (out, _) = step(&mut guard, t + 0.11, Some(&next), &ring, on(&first, t + 0.11));
    assert_eq!(
        (out.verdict.get(), out.reason.get()),
        (Verdict::Hold, GuardReason::Late)
    );
}

#[test]
fn it_takes_none_that_the_vehicle_is_not_on() {
    let t = NOW_S + 3.0;
    let (mut guard, ring, _, next) = restarted(t);
    let (out, _) = step(&mut guard, t, Some(&next), &ring, VehiclePose::at(0.0, 0.0));
    assert_eq!(
        (out.verdict.get(), out.reason.get()),
        (Verdict::Hold, GuardReason::Discontinuous)
    );
}

#[test]
fn it_takes_none_that_has_not_begun() {
    let t = NOW_S + 3.0;
    let (mut guard, ring, first, mut next) = restarted(t);
    next.start = time(t + 0.05);
    let (out, _) = step(&mut guard, t, Some(&next), &ring, on(&first, t));
    assert_eq!(
        (out.verdict.get(), out.reason.get()),
        (Verdict::Hold, GuardReason::WrongBase)
    );
}
