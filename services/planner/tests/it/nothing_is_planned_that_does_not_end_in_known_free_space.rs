//! The planner's promises at its border: what it answers to which inputs.

use crate::common::{HEIGHT_M, hovering, map, now, to};
use jink_planner::speed_tiers::planned_mps;
use jink_planner::{Planner, PlannerInputs};
use jink_shared_types::events;
use jink_shared_types::frames::{LocalNed, Point, Velocity};
use jink_shared_types::layout::Layout;
use jink_shared_types::map::{CELL_M, LocalMap, cell_of, declared_as};
use jink_shared_types::motion::{
    ApprovedTrajectory, BezierPiece, MotionState, Route, RouteMode, Trajectory, TrajectoryMode,
};
use jink_shared_types::params::{OA_SPD_MAX, ParamSet};
use jink_shared_types::tracking::Tracking;
use jink_shared_types::vehicle::{
    COMMAND_LAND, COMMAND_LOITER, COMMAND_TAKEOFF, DesiredPath, NavMode, VehicleState,
};
use jink_shared_types::{Coded, Flag, Reading, SampleHeader, Stamped};
use nalgebra::Vector3;
use proptest::prelude::*;

/// One step with everything fresh unless given as `None`.
fn answer(
    planner: &mut Planner,
    map: Option<&LocalMap>,
    state: Option<&VehicleState>,
    desired: &DesiredPath,
    approved: Option<&ApprovedTrajectory>,
) -> Route {
    let header = SampleHeader::at(now());
    fn fresh<'a, T>(sample: Option<&'a T>, header: &'a SampleHeader) -> Reading<'a, T> {
        sample.map_or(Reading::Stale { age_s: 1.0 }, |sample| {
            Reading::Fresh(Stamped { sample, header })
        })
    }
    let inputs = PlannerInputs {
        far: Reading::Never,
        moving: Reading::Never,
        map: fresh(map, &header),
        state: fresh(state, &header),
        desired: fresh(Some(desired), &header),
        approved,
        is_guard_silent: false,
        proposal: Reading::Never,
    };
    let mut route = Route::default();
    planner.step(now(), &inputs, &mut route);
    assert!(route.is_plausible(), "{route:?}");
    route
}

fn planner() -> Planner {
    Planner::new(&ParamSet::default(), 1)
}

/// A trajectory that flies straight north at 2 m/s for `length_m` and then stops at once (for re-checks only).
fn flying_north(length_m: f64) -> ApprovedTrajectory {
    let speed = 2.0;
    let duration_s = length_m / speed;
    let points = std::array::from_fn(|i| Vector3::new(length_m * i as f64 / 5.0, 0.0, -HEIGHT_M));
    let mut trajectory = Trajectory {
        id: 77,
        start: now().plus_seconds(-0.05),
        mode: Coded::new(TrajectoryMode::Plan),
        limits: jink_planner::speed_tiers::speed_tiers(&ParamSet::default(), &Tracking::PX4_TRAJECTORY)[0],
        ..Trajectory::default()
    };
    assert!(trajectory.push(BezierPiece::new(&points, [0.0; 6], duration_s)));
    ApprovedTrajectory {
        trajectory,
        ..ApprovedTrajectory::default()
    }
}

#[test]
fn a_mission_leg_in_the_open_is_planned_to_its_goal_or_to_the_edge_of_what_is_known() {
    let map = map(10.0, |_| false);
    let near = answer(&mut planner(), Some(&map), Some(&hovering()), &to(4.0, 1.0), None);
    assert_eq!(near.mode.get(), RouteMode::Plan);
    assert!(near.target_is_goal.is_set());
    assert_eq!(near.target, Point::new(4.0, 1.0, -HEIGHT_M));
    let far = answer(
        &mut planner(),
        Some(&map),
        Some(&hovering()),
        &to(60.0, 0.0),
        None,
    );
    assert_eq!(far.mode.get(), RouteMode::Plan);
    assert!(!far.target_is_goal.is_set());
    assert!(far.target.x_m > 6.0 && far.target.x_m < 9.5, "{:?}", far.target);
    assert_eq!(far.base_id, 0, "it starts from rest");
    assert!(far.splice > now());
}

#[test]
fn a_vehicle_that_nobody_has_planned_for_is_taken_over_as_it_moves() {
    let map = map(10.0, |_| false);
    let moving = |speed_mps: f64| VehicleState {
        velocity: Velocity::new(speed_mps, 0.0, 0.0),
        ..hovering()
    };
    let taken_over = |speed_mps: f64, desired: &DesiredPath| {
        let mut planner = planner();
        let route = answer(&mut planner, Some(&map), Some(&moving(speed_mps)), desired, None);
        let reported = planner
            .events()
            .iter()
            .any(|event| event.id == events::CERTIFICATE_LOST.id);
        (route, reported)
    };
    let (planned, _) = taken_over(2.0, &to(8.0, 0.0));
    assert_eq!((planned.mode.get(), planned.base_id), (RouteMode::Plan, 0));
    assert_eq!(planned.start.velocity.vector().x, 2.0);
    let ahead_m = 2.0 * jink_shared_types::motion::SPLICE_LEAD_S;
    assert!((planned.start.position.x_m - ahead_m).abs() < 1e-9);
    assert!(planned.must_leave.is_set(), "if no curve is found it is stopped");

    let (stopped, reported) = taken_over(4.0, &to(8.0, 0.0));
    assert_eq!(stopped.mode.get(), RouteMode::Stop, "too fast to plan for");
    assert_eq!(stopped.stop.at(0.0).velocity.vector().x, 4.0);
    assert!(!reported, "the stop ends in known-free space");
    let (stopped, reported) = taken_over(9.0, &to(8.0, 0.0));
    assert_eq!(stopped.mode.get(), RouteMode::Stop);
    assert!(
        reported,
        "too fast to stop in what is known: the pilot is notified"
    );

    let (slow, _) = taken_over(0.3, &to(8.0, 0.0));
    assert_eq!(
        slow.start.velocity.vector().norm(),
        0.0,
        "hardly moving is at rest"
    );
}

#[test]
fn a_vehicle_in_unplanned_motion_is_stopped_when_nothing_can_be_seen() {
    let mut blind = map(10.0, |_| false);
    blind.ranges_fresh = Flag::NO;
    let moving = VehicleState {
        velocity: Velocity::new(2.0, 0.0, 0.0),
        ..hovering()
    };
    let route = answer(&mut planner(), Some(&blind), Some(&moving), &to(8.0, 0.0), None);
    assert_eq!(route.mode.get(), RouteMode::Stop);
}

#[test]
fn what_jink_does_not_plan_is_mirrored() {
    let map = map(10.0, |_| false);
    for mode in [NavMode::Manual, NavMode::Position, NavMode::Unknown] {
        let state = VehicleState {
            mode: Coded::new(mode),
            ..hovering()
        };
        let route = answer(&mut planner(), Some(&map), Some(&state), &to(9.0, 0.0), None);
        assert_eq!(route.mode.get(), RouteMode::Mirror, "{mode}");
    }
    for command in [COMMAND_TAKEOFF, COMMAND_LAND] {
        let mut desired = to(9.0, 0.0);
        desired.points[0].command = command;
        let route = answer(&mut planner(), Some(&map), Some(&hovering()), &desired, None);
        assert_eq!(route.mode.get(), RouteMode::Mirror, "command {command}");
    }
    let disarmed = VehicleState {
        armed: Flag::NO,
        ..hovering()
    };
    let route = answer(&mut planner(), Some(&map), Some(&disarmed), &to(9.0, 0.0), None);
    assert_eq!(route.mode.get(), RouteMode::Mirror);
}

/// The same in another mode.
fn in_mode(mode: NavMode, desired: DesiredPath, state: VehicleState) -> (DesiredPath, VehicleState) {
    let mode = Coded::new(mode);
    (DesiredPath { mode, ..desired }, VehicleState { mode, ..state })
}

#[test]
fn a_target_is_planned_to_in_every_automatic_mode() {
    let map = map(10.0, |_| false);
    for mode in [
        NavMode::Takeoff,
        NavMode::Mission,
        NavMode::Hold,
        NavMode::Return,
        NavMode::Land,
    ] {
        let (mut desired, state) = in_mode(mode, to(4.0, 0.0), hovering());
        desired.points[0].command = COMMAND_LOITER;
        desired.points[1].command = COMMAND_LOITER;
        let route = answer(&mut planner(), Some(&map), Some(&state), &desired, None);
        assert_eq!(route.mode.get(), RouteMode::Plan, "{mode}");
        assert!(route.target_is_goal.is_set(), "{mode}");
        // The desired path of the mode before does not count.
        let route = answer(&mut planner(), Some(&map), Some(&hovering()), &desired, None);
        let expected = if mode == NavMode::Mission {
            RouteMode::Plan
        } else {
            RouteMode::Keep
        };
        assert_eq!(route.mode.get(), expected, "{mode}");
    }
}

#[test]
fn who_is_to_rest_at_a_place_that_is_passed_stops_first_and_stops_once() {
    let map = map(12.0, |_| false);
    let flown = flying_north(9.0);
    for mode in [NavMode::Hold, NavMode::Land] {
        let (desired, state) = in_mode(mode, to(0.0, 0.0), hovering());
        let route = answer(&mut planner(), Some(&map), Some(&state), &desired, Some(&flown));
        assert_eq!(route.mode.get(), RouteMode::Stop, "{mode}");
        assert_eq!(route.base_id, flown.trajectory.id);
        assert!(!route.must_leave.is_set());
        let mut stopping = flown;
        stopping.trajectory.mode = Coded::new(TrajectoryMode::Stop);
        let route = answer(
            &mut planner(),
            Some(&map),
            Some(&state),
            &desired,
            Some(&stopping),
        );
        assert_eq!(
            route.mode.get(),
            RouteMode::Keep,
            "{mode}: a stop goes on to its end"
        );
        let (far, _) = in_mode(mode, to(9.0, 0.0), hovering());
        let route = answer(&mut planner(), Some(&map), Some(&state), &far, Some(&flown));
        assert_eq!(route.mode.get(), RouteMode::Plan, "{mode}: far enough ahead");
    }
    let (desired, state) = in_mode(NavMode::Mission, to(0.0, 0.0), hovering());
    let route = answer(&mut planner(), Some(&map), Some(&state), &desired, Some(&flown));
    assert_ne!(
        route.mode.get(),
        RouteMode::Stop,
        "a waypoint is no place to rest at"
    );
}

#[test]
fn before_the_mode_is_known_what_is_flown_goes_on() {
    let map = map(10.0, |_| false);
    let untold = VehicleState {
        mode: Coded::new(NavMode::Unknown),
        armed: Flag::NO,
        mode_pending: Flag::YES,
        ..hovering()
    };
    let flown = flying_north(9.0);
    let route = answer(
        &mut planner(),
        Some(&map),
        Some(&untold),
        &to(9.0, 0.0),
        Some(&flown),
    );
    assert_eq!(route.mode.get(), RouteMode::Keep);
}

#[test]
fn without_map_ranges_state_or_position_nothing_new_is_committed() {
    let good = map(10.0, |_| false);
    let mut blind = map(10.0, |_| false);
    blind.ranges_fresh = Flag::NO;
    let lost = VehicleState {
        position_valid: Flag::NO,
        ..hovering()
    };
    for (map, state) in [
        (None, Some(&hovering())),
        (Some(&*good), None),
        (Some(&*blind), Some(&hovering())),
        (Some(&*good), Some(&lost)),
    ] {
        let route = answer(&mut planner(), map, state, &to(9.0, 0.0), None);
        assert_eq!(route.mode.get(), RouteMode::Keep);
    }
}

#[test]
fn with_a_silent_sensor_it_goes_on_slower_and_reports_once() {
    let mut map = map(10.0, |_| false);
    let mut planner = planner().with_sensors(2);
    let mut speed_and_events = |map: &LocalMap, publish_s: f64| {
        let header = SampleHeader::at(now().plus_seconds(publish_s));
        let (state, desired) = (hovering(), to(4.0, 1.0));
        let inputs = PlannerInputs {
            far: Reading::Never,
            moving: Reading::Never,
            map: Reading::Fresh(Stamped {
                sample: map,
                header: &header,
            }),
            state: Reading::Fresh(Stamped {
                sample: &state,
                header: &header,
            }),
            desired: Reading::Fresh(Stamped {
                sample: &desired,
                header: &header,
            }),
            approved: None,
            is_guard_silent: false,
            proposal: Reading::Never,
        };
        let mut route = Route::default();
        planner.step(now(), &inputs, &mut route);
        assert_eq!(route.mode.get(), RouteMode::Plan);
        let reported: Vec<u16> = planner.events().iter().map(|event| event.id).collect();
        (route.limits.speed_mps, reported)
    };
    map.live_sensors = 2;
    let (full_mps, reported) = speed_and_events(&map, 0.0);
    assert!(reported.is_empty());
    map.live_sensors = 1;
    let (slow_mps, reported) = speed_and_events(&map, 0.1);
    assert_eq!(reported, [events::SENSOR_LOST.id]);
    let allowed_mps = ParamSet::default().get(&OA_SPD_MAX);
    assert!(slow_mps <= 0.5 * allowed_mps && full_mps > 0.9 * allowed_mps);
    assert!(speed_and_events(&map, 0.2).1.is_empty());
    map.live_sensors = 2;
    let (again_mps, reported) = speed_and_events(&map, 0.3);
    assert_eq!((again_mps, reported), (full_mps, vec![events::SENSOR_BACK.id]));
}

#[test]
fn an_unknown_neighbourhood_is_not_entered() {
    let map = map(0.6, |_| false);
    let route = answer(&mut planner(), Some(&map), Some(&hovering()), &to(9.0, 0.0), None);
    assert_eq!(route.mode.get(), RouteMode::Keep);
}

#[test]
fn a_new_obstacle_on_the_committed_way_is_evaded_or_stopped_for() {
    let clear = map(11.0, |_| false);
    let flown = flying_north(9.0);
    let mut planner = planner();
    let route = answer(
        &mut planner,
        Some(&clear),
        Some(&hovering()),
        &to(60.0, 0.0),
        Some(&flown),
    );
    assert!(!route.must_leave.is_set());
    let post = map(11.0, |p| (p.x - 6.0).hypot(p.y) < 0.3);
    let route = answer(
        &mut self::planner(),
        Some(&post),
        Some(&hovering()),
        &to(60.0, 0.0),
        Some(&flown),
    );
    assert!(route.must_leave.is_set());
    assert_eq!(route.base_id, 77);
    assert!(matches!(route.mode.get(), RouteMode::Plan | RouteMode::Stop));
    assert!(route.has_stop.is_set());
}

#[test]
fn a_hit_beside_the_vehicle_that_the_committed_way_leaves_behind_does_not_stop_it() {
    let flown = flying_north(6.0);
    let here_m = flown.trajectory.at(now()).unwrap().position.x_m;
    // A cell within what the highest speed tier keeps away from: so far ahead, half a metre beside and above.
    let leaves = |ahead_m: f64| {
        let hit = Vector3::new(here_m + ahead_m, 0.5, -HEIGHT_M - 0.3);
        let map = map(10.0, move |p| (p - hit).amax() < 0.1);
        let route = answer(
            &mut planner(),
            Some(&map),
            Some(&hovering()),
            &to(60.0, 0.0),
            Some(&flown),
        );
        route.must_leave.is_set()
    };
    assert!(
        !leaves(-0.4),
        "it lies behind, and what leads on brings the vehicle no nearer"
    );
    assert!(leaves(0.6), "it comes nearer");
    assert!(leaves(2.0));
}

#[test]
fn a_wall_out_of_nowhere_is_braked_for_and_reported() {
    let wall = map(11.0, |p| (p.x - 1.4).abs() < 0.2);
    let mut state = hovering();
    state.velocity = Velocity::new(2.0, 0.0, 0.0);
    let mut planner = planner();
    let route = answer(
        &mut planner,
        Some(&wall),
        Some(&state),
        &to(60.0, 0.0),
        Some(&flying_north(9.0)),
    );
    assert_eq!(route.mode.get(), RouteMode::Stop);
    assert!(
        planner
            .events()
            .iter()
            .any(|event| event.id == events::CERTIFICATE_LOST.id)
    );
    let end = route.stop.at(route.stop.duration_s);
    assert!(end.velocity.vector().norm() < 1e-6);
    assert!(end.position.x_m < 1.9, "{:?}", end.position);
}

#[test]
fn a_parameter_changed_in_flight_counts_from_the_next_plan_and_nothing_is_forgotten() {
    let map = map(10.0, |_| false);
    let mut planner = planner();
    let first = answer(&mut planner, Some(&map), Some(&hovering()), &to(8.0, 0.0), None);
    let mut params = ParamSet::default();
    for (name, value) in [("OA_SPD_MAX", 1.5), ("OA_ALT_MAX", 2.0), ("OA_YAW_MODE", 0.0)] {
        params.set(name, value).unwrap();
    }
    planner.on_params_changed(&params);
    let next = answer(&mut planner, Some(&map), Some(&hovering()), &to(8.0, 0.0), None);
    assert_eq!(next.mode.get(), RouteMode::Plan);
    let speeds_mps = (first.limits.speed_mps, next.limits.speed_mps);
    let planned_mps = |allowed_mps| planned_mps(allowed_mps, first.limits.acceleration_mps2);
    assert_eq!(speeds_mps, (planned_mps(3.0), planned_mps(1.5)));
    assert_eq!((first.goal.z_m, next.goal.z_m), (-HEIGHT_M, -2.0));
    assert_eq!(next.id, first.id + 1, "the routes are numbered on");
}

#[test]
fn who_flies_faster_than_a_new_limit_keeps_the_commitment_that_ends_at_rest() {
    let map = map(10.0, |_| false);
    let mut planner = planner();
    let flown = flying_north(6.0);
    let mut params = ParamSet::default();
    params.set("OA_SPD_MAX", 0.5).unwrap();
    planner.on_params_changed(&params);
    let route = answer(
        &mut planner,
        Some(&map),
        Some(&hovering()),
        &to(8.0, 0.0),
        Some(&flown),
    );
    assert_eq!(route.mode.get(), RouteMode::Keep);
    assert!(!route.must_leave.is_set());
}

#[test]
fn a_declared_band_is_flown_level_never_over_what_stands_in_the_way() {
    let highest_m = |declarations: u8| {
        let mut map = map(10.0, |p| (4.0..4.4).contains(&p.x) && p.z > -2.9);
        map.declarations = declarations;
        let route = answer(&mut planner(), Some(&map), Some(&hovering()), &to(8.0, 0.0), None);
        assert_eq!(route.mode.get(), RouteMode::Plan);
        let heights_m = route.guide().iter().map(|vertex| -vertex.z_m);
        heights_m.fold(0.0, f64::max)
    };
    assert!(highest_m(0) > HEIGHT_M + 0.8);
    assert!(highest_m(declared_as::BAND) < HEIGHT_M + CELL_M);
}

#[test]
fn heights_that_contradict_each_other_do_not_stop_the_planner() {
    let map = map(10.0, |_| false);
    let mut params = ParamSet::default();
    params.set("OA_ALT_MIN", 50.0).unwrap();
    params.set("OA_ALT_MAX", 2.0).unwrap();
    let mut planner = planner();
    planner.on_params_changed(&params);
    let route = answer(&mut planner, Some(&map), Some(&hovering()), &to(4.0, 0.0), None);
    assert_eq!(route.goal.z_m, -2.0);
}

/// Between two walls, so long that there is no path out of them near.
fn between_walls(first: i32, cells: i32) -> Box<LocalMap> {
    map(9.0, |p| {
        let [_, y, _] = cell_of(Point::<LocalNed>::from_vector(p));
        p.x.abs() < 7.0 && !(first..first + cells).contains(&y)
    })
}

#[test]
fn six_cells_between_two_walls_are_enough_and_five_are_not() {
    // In every cell of a corridor the vehicle keeps its radius and the tube from every cell that is occupied, to the
    // millimetre.
    for (first, east_m) in [(-3, 0.0), (-3, 0.05), (-3, -0.08), (4, 1.4), (-9, -1.25)] {
        let map = between_walls(first, 6);
        let state = VehicleState {
            position: Point::new(0.0, east_m, -HEIGHT_M),
            ..hovering()
        };
        let route = answer(&mut planner(), Some(&map), Some(&state), &to(12.0, east_m), None);
        assert_eq!(route.mode.get(), RouteMode::Plan, "from {east_m}");
        assert!(route.target.x_m > 3.0, "{:?}", route.target);
        let radius_m = 0.3 + 0.1 + route.limits.tube_m;
        let (remaining_m, right_m) = (0.2 * f64::from(first), 0.2 * f64::from(first + 6));
        for step in 0..10_000 {
            let [x, y, z] = [0.37, 0.71, 0.13].map(|stride| (f64::from(step) * stride).fract());
            let p = Vector3::new(7.0 * x, remaining_m + 1.2 * y, -HEIGHT_M - 1.0 + 2.0 * z);
            if route
                .corridor()
                .iter()
                .any(|polytope| polytope.depth_m(&p) >= 0.0)
            {
                assert!(
                    p.y - remaining_m > radius_m - 1e-6 && right_m - p.y > radius_m - 1e-6,
                    "{p}"
                );
            }
        }
    }
    let map = between_walls(-3, 5);
    let state = VehicleState {
        position: Point::new(0.0, -0.1, -HEIGHT_M),
        ..hovering()
    };
    let route = answer(&mut planner(), Some(&map), Some(&state), &to(12.0, -0.1), None);
    assert_ne!(route.mode.get(), RouteMode::Plan);
}

#[test]
fn at_the_goal_there_is_nothing_to_plan() {
    let map = map(10.0, |_| false);
    let route = answer(&mut planner(), Some(&map), Some(&hovering()), &to(0.0, 0.0), None);
    assert_eq!(route.mode.get(), RouteMode::Keep);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]
    #[test]
    fn every_point_of_every_corridor_is_far_from_obstacles_and_from_the_unknown(
        trees in proptest::collection::vec((1.5..9.0f64, -6.0..6.0f64), 0..10),
        goal in (6.0..60.0f64, -8.0..8.0f64),
        samples in proptest::collection::vec((-1.0..11.0f64, -8.0..8.0f64, -4.0..-1.0f64), 600),
    ) {
        let tree = |p: &Vector3<f64>| trees.iter().map(|(x, y)| (p.x - x).hypot(p.y - y)).fold(f64::MAX, f64::min);
        let map = map(10.0, |p| tree(&p) < 0.3);
        let route = answer(&mut planner(), Some(&map), Some(&hovering()), &to(goal.0, goal.1), None);
        let min_distance_m = 0.3 + 0.1 + route.limits.tube_m;
        for (x, y, z) in samples {
            let p = Vector3::new(x, y, z);
            if route.corridor().iter().any(|polytope| polytope.depth_m(&p) >= 0.0) {
                prop_assert!(tree(&p) > 0.3 + min_distance_m - 0.15, "{p} is {} m from a tree", tree(&p));
                prop_assert!((p - Vector3::new(0.0, 0.0, -HEIGHT_M)).norm() < 10.0 - min_distance_m + 0.2, "{p} is unknown");
            }
        }
        for (polytope, leg) in route.corridor().iter().zip(route.guide().windows(2)) {
            prop_assert!(polytope.depth_m(&leg[0].vector()) > 0.0 && polytope.depth_m(&leg[1].vector()) > 0.0);
        }
    }
}

#[test]
fn the_same_inputs_give_the_same_route_to_the_bit() {
    let map = map(10.0, |p| (p.x - 4.0).hypot(p.y - 0.2) < 0.3);
    let run = || {
        answer(
            &mut planner(),
            Some(&map),
            Some(&hovering()),
            &to(60.0, 3.0),
            None,
        )
    };
    assert_eq!(format!("{:?}", run()), format!("{:?}", run()));
    assert_eq!(
        run().start,
        MotionState::at_rest(Point::new(0.0, 0.0, -HEIGHT_M), 0.0)
    );
}
