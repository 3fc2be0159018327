//! The planner allocates nothing once it is made: not for a plan, not where none is found, not before what moves.

use crate::common::{HEIGHT_M, hovering, map, now, to};
use allocation_counter::measure;
use jink_planner::{Planner, PlannerInputs};
use jink_shared_types::far_map::FarMap;
use jink_shared_types::frames::{Point, Velocity};
use jink_shared_types::map::LocalMap;
use jink_shared_types::motion::{Route, RouteMode};
use jink_shared_types::moving::{MovingObstacle, MovingObstacles};
use jink_shared_types::params::ParamSet;
use jink_shared_types::{Reading, SampleHeader, Stamped};
use nalgebra::Vector3;

/// Cycles at 10 Hz: longer than a goal may stay without progress.
const CYCLES: u32 = 400;

fn fresh<'a, T>(sample: &'a T, header: &'a SampleHeader) -> Reading<'a, T> {
    Reading::Fresh(Stamped { sample, header })
}

/// Trees of 0.6 m on a grid that is no square, none around the vehicle.
fn forest() -> Box<LocalMap> {
    map(11.0, |p| {
        let near = |along: f64, apart: f64| (along.rem_euclid(apart) - 0.5 * apart).abs() < 0.3;
        p.xy().norm() > 1.5 && near(p.x + 0.4 * p.y, 4.0) && near(p.y, 3.2)
    })
}

/// Four walls and a ceiling: no way out.
fn closed_room() -> Box<LocalMap> {
    map(9.0, |p| p.xy().amax() > 3.0 || p.z < -5.0)
}

/// Somebody who walks towards the vehicle from where it wants to go.
fn walker(seconds: f64) -> MovingObstacles {
    let mut moving = MovingObstacles::default();
    moving.push(MovingObstacle {
        position: Point::new(6.0 - 0.5 * seconds, 0.3, -HEIGHT_M),
        velocity: Velocity::new(-0.5, 0.0, 0.0),
        radius_m: 0.4,
        half_height_m: 0.9,
        ..MovingObstacle::default()
    });
    moving
}

/// How many cycles have planned, and how often they asked for memory.
fn flown(map: &LocalMap, far: &FarMap, with_walker: bool) -> (u32, u64) {
    let mut planner = Planner::new(&ParamSet::default(), 1);
    let mut route = Route::default();
    let mut planned = 0;
    let asked = measure(|| {
        for cycle in 0..CYCLES {
            let seconds = 0.1 * f64::from(cycle);
            let time = now().plus_seconds(seconds);
            let header = SampleHeader::at(time);
            let (state, desired) = (hovering(), to(60.0, 0.0));
            let moving = walker(seconds);
            let inputs = PlannerInputs {
                far: fresh(far, &header),
                moving: match with_walker {
                    true => fresh(&moving, &header),
                    false => Reading::Never,
                },
                map: fresh(map, &header),
                state: fresh(&state, &header),
                desired: fresh(&desired, &header),
                approved: None,
                is_guard_silent: false,
                proposal: Reading::Never,
            };
            planner.step(time, &inputs, &mut route);
            planned += u32::from(route.mode == RouteMode::Plan);
        }
    });
    (planned, asked.count_total)
}

#[test]
fn plans_and_searches_without_one_allocate_nothing() {
    let far = FarMap::boxed();
    let in_new = measure(|| drop(Planner::new(&ParamSet::default(), 1)));
    assert!(in_new.count_total > 0, "the counter counts");
    let open = map(12.0, |_: Vector3<f64>| false);
    for (name, map, with_walker, plans) in [
        ("open", &open, false, CYCLES..=CYCLES),
        ("forest", &forest(), false, CYCLES..=CYCLES),
        // Until it is said to be out of reach.
        ("closed room", &closed_room(), false, 1..=CYCLES - 1),
        ("walker", &open, true, 1..=CYCLES),
    ] {
        let (planned, asked) = flown(map, &far, with_walker);
        assert!(plans.contains(&planned), "{name}: {planned} planned");
        assert_eq!(asked, 0, "{name}, {planned} of {CYCLES} cycles planned");
    }
}
