//! Plans that are not flown: the vehicle stands where it is while the guard or the generator is gone or refuses, and
//! departs when its plans pass again, however long that took.

use crate::common::{HEIGHT_M, hovering, map, now, to};
use jink_planner::{Planner, PlannerInputs};
use jink_shared_types::events::GOAL_BLOCKED;
use jink_shared_types::map::LocalMap;
use jink_shared_types::motion::{ApprovedTrajectory, GuardReason, Route, RouteMode, Verdict};
use jink_shared_types::params::{OA_BLOCKED_T, ParamSet};
use jink_shared_types::{Coded, Reading, SampleHeader, Stamped};
use nalgebra::Vector3;

/// How long nothing passes (s): longer than a goal may stay without progress.
const GONE_S: f64 = 45.0;
const CYCLE_S: f64 = 0.1;

/// What a planner says whose vehicle does not move for [`GONE_S`], while the guard answers its last route as `approved`
/// says, or says nothing new: whether it still plans at the end, and the names in what it has reported of the goal.
fn after_a_long_time(
    map: &LocalMap,
    approved: impl Fn(u64) -> Option<ApprovedTrajectory>,
    is_guard_silent: bool,
) -> (bool, Vec<String>) {
    fn fresh<'a, T>(sample: &'a T, header: &'a SampleHeader) -> Reading<'a, T> {
        Reading::Fresh(Stamped { sample, header })
    }
    let mut planner = Planner::new(&ParamSet::default(), 1);
    let mut reported = Vec::new();
    let mut route = Route::default();
    for cycle in 0..(GONE_S / CYCLE_S) as u32 {
        let time = now().plus_seconds(f64::from(cycle) * CYCLE_S);
        let header = SampleHeader::at(time);
        let (state, desired) = (hovering(), to(60.0, 0.0));
        let answer = approved(route.id);
        let inputs = PlannerInputs {
            far: Reading::Never,
            moving: Reading::Never,
            map: fresh(map, &header),
            state: fresh(&state, &header),
            desired: fresh(&desired, &header),
            approved: answer.as_ref(),
            is_guard_silent,
            proposal: Reading::Never,
        };
        planner.step(time, &inputs, &mut route);
        let blocked = planner
            .events()
            .iter()
            .filter(|event| event.id == GOAL_BLOCKED.id);
        reported.extend(blocked.map(|event| event.name.as_str().to_owned()));
    }
    (route.mode == RouteMode::Plan, reported)
}

#[test]
fn while_the_guard_is_silent_the_time_does_not_count() {
    assert!(GONE_S > ParamSet::default().get(&OA_BLOCKED_T));
    let open = map(10.0, |_| false);
    for approved in [None, Some(ApprovedTrajectory::default())] {
        let (plans, reported) = after_a_long_time(&open, |_| approved, true);
        assert!(plans && reported.is_empty(), "{plans} {reported:?}");
    }
}

#[test]
fn plans_that_are_refused_are_reported_and_made_again() {
    let open = map(10.0, |_| false);
    let refusal = ApprovedTrajectory {
        verdict: Coded::new(Verdict::Hold),
        reason: Coded::new(GuardReason::Obstacle),
        ..ApprovedTrajectory::default()
    };
    let (plans, reported) = after_a_long_time(&open, |_| Some(refusal), false);
    assert!(plans, "{reported:?}");
    assert_eq!(reported, ["plans not flown"]);
}

#[test]
fn what_is_closed_is_still_reported_as_closed() {
    let closed = map(10.0, |place: Vector3<f64>| {
        let away = place + Vector3::z() * HEIGHT_M;
        (3.0..3.6).contains(&away.norm())
    });
    let passed = |route_id| {
        let mut passed = ApprovedTrajectory {
            verdict: Coded::new(Verdict::Passed),
            ..ApprovedTrajectory::default()
        };
        passed.trajectory.route_id = route_id;
        Some(passed)
    };
    let (plans, reported) = after_a_long_time(&closed, passed, false);
    assert!(!plans, "{reported:?}");
    assert_eq!(reported, ["no way round"]);
}
