//! What moves: a vehicle at rest leaves the way of what comes, and stays where it is if that passes by; a plan leads
//! past where it could meet what crosses.

use crate::common::{HEIGHT_M, hovering, map, now, to};
use jink_planner::{Planner, PlannerInputs};
use jink_shared_types::events;
use jink_shared_types::frames::{Point, Velocity};
use jink_shared_types::layout::Layout;
use jink_shared_types::map::LocalMap;
use jink_shared_types::motion::{Route, RouteMode};
use jink_shared_types::moving::{MovingObstacle, MovingObstacles};
use jink_shared_types::params::ParamSet;
use jink_shared_types::vehicle::DesiredPath;
use jink_shared_types::{Reading, SampleHeader, Stamped};
use nalgebra::Vector3;
use proptest::prelude::*;

/// Radius of what moves, and of the vehicle with the map's errors (m).
const WALKER_M: f64 = 0.3;
const VEHICLE_M: f64 = 0.35;

fn walker(place: [f64; 2], velocity: [f64; 2]) -> MovingObstacle {
    MovingObstacle {
        position: Point::new(place[0], place[1], -HEIGHT_M),
        velocity: Velocity::new(velocity[0], velocity[1], 0.0),
        radius_m: WALKER_M,
        half_height_m: 1.0,
        ..MovingObstacle::default()
    }
}

/// One step of a vehicle that hovers at the origin.
fn answer(planner: &mut Planner, map: &LocalMap, desired: &DesiredPath, walkers: &[MovingObstacle]) -> Route {
    let header = SampleHeader::at(now());
    let mut moving = MovingObstacles::default();
    walkers.iter().for_each(|walker| moving.push(*walker));
    let state = hovering();
    let inputs = PlannerInputs {
        far: Reading::Never,
        moving: fresh(&moving, &header),
        map: fresh(map, &header),
        state: fresh(&state, &header),
        desired: fresh(desired, &header),
        approved: None,
        is_guard_silent: false,
        proposal: Reading::Never,
    };
    let mut route = Route::default();
    planner.step(now(), &inputs, &mut route);
    assert!(route.is_plausible(), "{route:?}");
    route
}

fn fresh<'a, T>(sample: &'a T, header: &'a SampleHeader) -> Reading<'a, T> {
    Reading::Fresh(Stamped { sample, header })
}

/// The smallest distance between the vehicle's centre, which follows the stop of `route`, and the surface of `walker`
/// (m).
fn nearest_m(route: &Route, walker: &MovingObstacle) -> f64 {
    let begin_s = route.splice.seconds_since(now());
    let distances = (0..40).map(|i| {
        let ahead_s = 0.1 * f64::from(i);
        let flown_s = (ahead_s - begin_s).clamp(0.0, route.stop.duration_s);
        let away = route.stop.at(flown_s).position.vector() - walker.after(ahead_s);
        away.xy().norm() - WALKER_M
    });
    distances.fold(f64::INFINITY, f64::min)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn a_vehicle_at_rest_leaves_the_way_of_what_comes(
        from_rad in 0.0..std::f64::consts::TAU, away_m in 3.5..5.0f64, speed_mps in 0.8..1.5f64, aside_m in -0.2..0.2f64,
    ) {
        let ahead = [-from_rad.cos(), -from_rad.sin()];
        let walker = walker(
            [-ahead[0] * away_m - ahead[1] * aside_m, -ahead[1] * away_m + ahead[0] * aside_m],
            ahead.map(|part| part * speed_mps),
        );
        // A post beside it, which must not be flown into.
        let post = Vector3::new(-ahead[1], ahead[0], 0.0) * 1.2;
        let map = map(10.0, |p| (p - post).xy().norm() < 0.2);
        let mut planner = Planner::new(&ParamSet::default(), 1);
        let route = answer(&mut planner, &map, &to(0.0, 0.0), &[walker]);
        let reported = planner.events().iter().any(|event| event.id == events::GIVES_WAY.id);
        let comes_to_it = away_m - speed_mps * 3.0 < WALKER_M + VEHICLE_M;
        prop_assert_eq!(route.mode.get() == RouteMode::Stop, reported);
        if comes_to_it {
            prop_assert!(reported);
            prop_assert!(nearest_m(&route, &walker) > VEHICLE_M, "{}", nearest_m(&route, &walker));
            let end = route.stop.at(route.stop.duration_s).position.vector();
            prop_assert!((end - post).xy().norm() > 0.2 + VEHICLE_M);
            prop_assert_eq!(route.stop.at(route.stop.duration_s).velocity.vector().norm(), 0.0);
        }
    }
}

#[test]
fn who_passes_by_or_above_moves_nobody() {
    let map = map(10.0, |_| false);
    for (place, velocity, up_m) in [
        ([4.0, 1.5], [-1.5, 0.0], 0.0),
        ([-2.0, 0.0], [-1.0, 0.3], 0.0),
        ([3.0, 0.0], [-1.5, 0.0], 2.0),
    ] {
        let mut walker = walker(place, velocity);
        walker.position.z_m -= up_m;
        let mut planner = Planner::new(&ParamSet::default(), 1);
        let route = answer(&mut planner, &map, &to(0.0, 0.0), &[walker]);
        assert_eq!(route.mode.get(), RouteMode::Keep, "{place:?}");
    }
}

#[test]
fn a_plan_passes_behind_what_crosses_and_a_straight_one_is_made_where_nothing_does() {
    let map = map(10.0, |_| false);
    let farthest_aside_m = |walkers: &[MovingObstacle]| {
        let mut planner = Planner::new(&ParamSet::default(), 1);
        let route = answer(&mut planner, &map, &to(6.0, 0.0), walkers);
        assert_eq!(route.mode.get(), RouteMode::Plan);
        let aside_m = route.guide().iter().map(|point| point.y_m);
        aside_m.fold(
            0.0,
            |most: f64, y_m| if y_m.abs() > most.abs() { y_m } else { most },
        )
    };
    assert!(farthest_aside_m(&[]).abs() < 0.2);
    // It is at the line of flight, 3 m ahead, after two seconds.
    let crossing = walker([3.0, -3.0], [0.0, 1.5]);
    assert!(
        farthest_aside_m(&[crossing]).abs() > 0.4,
        "{}",
        farthest_aside_m(&[crossing])
    );
    // It has long left when the vehicle comes.
    let gone = walker([3.0, 2.5], [0.0, 1.5]);
    assert!(farthest_aside_m(&[gone]).abs() < 0.2);
}
