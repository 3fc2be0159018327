//! A pilot who sees the vehicle leave its straight way, or stop, is told why.

use crate::common::{HEIGHT_M, hovering, map, now, to};
use jink_planner::{Planner, PlannerInputs};
use jink_shared_types::events;
use jink_shared_types::frames::Point;
use jink_shared_types::map::LocalMap;
use jink_shared_types::motion::Route;
use jink_shared_types::params::ParamSet;
use jink_shared_types::vehicle::{DesiredPath, NavMode, VehicleState};
use jink_shared_types::{Coded, Flag, Reading, SampleHeader, Stamped};
use nalgebra::Vector3;

/// What is reported in a step `s` seconds later, of the events about what jink does.
fn reported(
    planner: &mut Planner,
    s: f64,
    map: &LocalMap,
    state: &VehicleState,
    desired: &DesiredPath,
) -> Vec<u16> {
    let header = SampleHeader::at(now().plus_seconds(s));
    fn fresh<'a, T>(sample: &'a T, header: &'a SampleHeader) -> Reading<'a, T> {
        Reading::Fresh(Stamped { sample, header })
    }
    let inputs = PlannerInputs {
        far: Reading::Never,
        moving: Reading::Never,
        map: fresh(map, &header),
        state: fresh(state, &header),
        desired: fresh(desired, &header),
        approved: None,
        is_guard_silent: false,
        proposal: Reading::Never,
    };
    planner.step(now().plus_seconds(s), &inputs, &mut Route::default());
    let ids = planner.events().iter().map(|event| event.id);
    let about = [
        events::GOING_ROUND.id,
        events::GOAL_REACHED.id,
        events::PLACE_NOT_FREE.id,
    ];
    ids.filter(|id| about.contains(id)).collect()
}

#[test]
fn an_obstacle_that_is_gone_round_is_reported_once_and_open_space_never() {
    let open = map(12.0, |_| false);
    let wall = map(12.0, |p| (4.0..4.6).contains(&p.x) && p.y.abs() < 1.5);
    for (map, expected) in [(&open, vec![]), (&wall, vec![events::GOING_ROUND.id])] {
        let mut planner = Planner::new(&ParamSet::default(), 1);
        let steps = (0..10).map(|step| f64::from(step) * 0.2);
        let all: Vec<u16> = steps
            .flat_map(|s| reported(&mut planner, s, map, &hovering(), &to(9.0, 0.0)))
            .collect();
        assert_eq!(all, expected);
    }
}

#[test]
fn an_obstacle_beside_the_way_is_not_reported() {
    let beside = map(12.0, |p| (4.0..4.6).contains(&p.x) && (2.0..6.0).contains(&p.y));
    let mut planner = Planner::new(&ParamSet::default(), 1);
    assert_eq!(
        reported(&mut planner, 0.0, &beside, &hovering(), &to(9.0, 0.0)),
        [0; 0]
    );
}

#[test]
fn the_arrival_is_reported_once_and_not_where_the_mission_goes_on_or_nobody_went() {
    let open = map(12.0, |_| false);
    let there = VehicleState {
        position: Point::new(5.0, 0.0, -HEIGHT_M),
        ..hovering()
    };
    let last = |north_m| {
        let mut desired = to(north_m, 0.0);
        desired.points[2].valid = Flag::NO;
        desired
    };
    let mut planner = Planner::new(&ParamSet::default(), 1);
    let mut flown =
        |s, state: &VehicleState, desired: &DesiredPath| reported(&mut planner, s, &open, state, desired);
    assert_eq!(flown(0.0, &hovering(), &last(5.0)), [0; 0]);
    assert_eq!(flown(1.0, &there, &last(5.0)), [events::GOAL_REACHED.id]);
    assert_eq!(flown(2.0, &there, &last(5.0)), [0; 0]);
    assert_eq!(flown(3.0, &there, &last(5.4)), [0; 0], "held, and drifted");
    assert_eq!(flown(4.0, &there, &last(5.0)), [0; 0]);
    assert_eq!(flown(5.0, &hovering(), &to(5.0, 0.0)), [0; 0]);
    assert_eq!(flown(6.0, &there, &to(5.0, 0.0)), [0; 0], "the mission goes on");
}

#[test]
fn a_place_to_land_that_is_not_level_is_reported_once_a_landing() {
    let landing = VehicleState {
        mode: Coded::new(NavMode::Land),
        ..hovering()
    };
    let landed = VehicleState {
        landed: Flag::YES,
        ..landing
    };
    let not_free = events::PLACE_NOT_FREE.id;
    let box_under_one_side = |p: Vector3<f64>| p.z > -1.0 && p.x > 0.5 && p.y.abs() < 1.0;
    let post = |p: Vector3<f64>| p.z > -1.0 && (0.4..0.6).contains(&p.x) && (0.0..0.2).contains(&p.y);
    let slope = |p: Vector3<f64>| p.z > -0.15 * (p.x + 1.0);
    let aside = |p: Vector3<f64>| p.z > -1.0 && p.x > 2.0;
    for (what, map, expected) in [
        ("box", map(12.0, box_under_one_side), vec![not_free]),
        ("post", map(12.0, post), vec![not_free]),
        ("level", map(12.0, |_| false), vec![]),
        ("slope", map(12.0, slope), vec![]),
        ("aside", map(12.0, aside), vec![]),
        ("unseen", map(1.0, box_under_one_side), vec![]),
    ] {
        let mut planner = Planner::new(&ParamSet::default(), 1);
        let mut flown = |s, state: &VehicleState| reported(&mut planner, s, &map, state, &to(0.0, 0.0));
        assert_eq!(flown(0.0, &hovering()), [0; 0], "{what}: it does not land");
        let said: Vec<u16> = [0.2, 0.4, 0.6]
            .into_iter()
            .flat_map(|s| flown(s, &landing))
            .collect();
        assert_eq!(said, expected, "{what}");
        assert_eq!(flown(0.8, &landed), [0; 0], "{what}: it has landed");
        assert_eq!(flown(1.0, &landing), expected, "{what}: another landing");
    }
}
