//! Whatever another program proposes: a route is made of it under the rules of every route, or the planner uses its own
//! path and reports why.

use crate::common::{HEIGHT_M, hovering, map, now, to};
use jink_planner::speed_tiers::planned_mps;
use jink_planner::{Planner, PlannerInputs};
use jink_shared_types::events::{PROPOSAL_ENDED, PROPOSAL_FLOWN, PROPOSAL_REFUSED};
use jink_shared_types::frames::{LocalNed, Point, Velocity};
use jink_shared_types::layout::Layout;
use jink_shared_types::map::LocalMap;
use jink_shared_types::motion::{
    ApprovedTrajectory, BezierPiece, MotionLimits, Route, RouteMode, Trajectory, TrajectoryMode,
};
use jink_shared_types::params::ParamSet;
use jink_shared_types::proposal::{PROPOSAL_WAYPOINTS, Proposal, ProposalAnswer, ProposalVerdict};
use jink_shared_types::tracking::Tracking;
use jink_shared_types::vehicle::{DesiredPath, NavMode, VehicleState};
use jink_shared_types::{Coded, Reading, SampleHeader, Stamped, Timestamp};
use nalgebra::Vector3;
use proptest::prelude::*;

/// A planner with everything it reads, step by step.
struct TestPlanner {
    planner: Planner,
    map: Box<LocalMap>,
    state: VehicleState,
    desired: DesiredPath,
    approved: Option<ApprovedTrajectory>,
    now: Timestamp,
    events: Vec<u16>,
}

impl TestPlanner {
    fn new(map: Box<LocalMap>, desired: DesiredPath) -> Self {
        Self {
            planner: Planner::new(&ParamSet::default(), 1),
            map,
            state: hovering(),
            desired,
            approved: None,
            now: now(),
            events: Vec::new(),
        }
    }

    /// One cycle with a new map.
    fn step(&mut self, proposal: Option<&Proposal>) -> (Route, Option<ProposalAnswer>) {
        let header = SampleHeader::at(self.now);
        fn fresh<'a, T>(sample: &'a T, header: &'a SampleHeader) -> Reading<'a, T> {
            Reading::Fresh(Stamped { sample, header })
        }
        let inputs = PlannerInputs {
            far: Reading::Never,
            moving: Reading::Never,
            map: fresh(&*self.map, &header),
            state: fresh(&self.state, &header),
            desired: fresh(&self.desired, &header),
            approved: self.approved.as_ref(),
            is_guard_silent: false,
            proposal: proposal.map_or(Reading::Never, |proposal| fresh(proposal, &header)),
        };
        let mut route = Route::default();
        self.planner.step(self.now, &inputs, &mut route);
        assert!(route.is_plausible(), "{route:?}");
        let answer = self.planner.proposal_answer().copied();
        assert!(answer.is_none_or(|answer| answer.is_plausible()), "{answer:?}");
        self.events
            .extend(self.planner.events().iter().map(|event| event.id));
        self.now = self.now.plus_seconds(0.1);
        (route, answer)
    }

    /// `route` is committed, and the vehicle does not move.
    fn commit(&mut self, route: &Route) {
        let mut trajectory = Trajectory {
            id: route.id,
            route_id: route.id,
            start: self.now.plus_seconds(-0.05),
            mode: Coded::new(TrajectoryMode::Plan),
            limits: route.limits,
            ..Trajectory::default()
        };
        let here = self.state.position.vector();
        assert!(trajectory.push(BezierPiece::new(&[here; 6], [0.0; 6], 1.0)));
        self.approved = Some(ApprovedTrajectory {
            trajectory,
            ..ApprovedTrajectory::default()
        });
    }
}

fn at(north_m: f64, east_m: f64) -> Point<LocalNed> {
    Point::new(north_m, east_m, -HEIGHT_M)
}

fn goal_of(desired: &DesiredPath) -> Point<LocalNed> {
    desired.points[1].position
}

/// The path through `waypoints` to where `desired` wants to.
fn proposal(desired: &DesiredPath, waypoints: &[Point<LocalNed>]) -> Proposal {
    let mut proposal = Proposal {
        id: 7,
        goal: goal_of(desired),
        len: waypoints.len() as u32,
        ..Proposal::default()
    };
    proposal.waypoints[..waypoints.len()].copy_from_slice(waypoints);
    proposal
}

/// Distance of a point from a path (m).
fn away_m(point: &Vector3<f64>, way: &[Point<LocalNed>]) -> f64 {
    way.windows(2)
        .map(|leg| {
            let (a, b) = (leg[0].vector(), leg[1].vector());
            let t = ((point - a).dot(&(b - a)) / (b - a).norm_squared()).clamp(0.0, 1.0);
            (a + (b - a) * t - point).norm()
        })
        .fold(f64::INFINITY, f64::min)
}

/// What a first step answers to a path proposed on `map`; the route must be the planner's own if the path is refused.
fn verdict(
    map: impl Fn() -> Box<LocalMap>,
    desired: DesiredPath,
    waypoints: &[Point<LocalNed>],
) -> (Route, ProposalAnswer) {
    let own = TestPlanner::new(map(), desired).step(None).0;
    let mut bench = TestPlanner::new(map(), desired);
    let (route, answer) = bench.step(Some(&proposal(&desired, waypoints)));
    let answer = answer.unwrap();
    assert_eq!(answer.proposal_id, 7);
    if answer.verdict.get().is_flown() {
        assert_eq!(answer.route_id, route.id);
    } else {
        assert_eq!(format!("{route:?}"), format!("{own:?}"), "the planner's own");
        assert_eq!(answer.route_id, 0);
    }
    (route, answer)
}

/// East first, though the goal is north.
const ASIDE: [(f64, f64); 3] = [(0.0, 0.0), (0.0, 6.0), (30.0, 6.0)];

fn aside() -> Vec<Point<LocalNed>> {
    ASIDE
        .iter()
        .map(|(north_m, east_m)| at(*north_m, *east_m))
        .collect()
}

#[test]
fn a_path_that_can_be_certified_is_the_route() {
    let (route, answer) = verdict(|| map(12.0, |_| false), to(60.0, 0.0), &aside());
    assert_eq!(answer.verdict.get(), ProposalVerdict::Accepted);
    assert_eq!(route.mode.get(), RouteMode::Plan);
    assert!(route.target.y_m > 4.0, "{:?}", route.target);
    assert!(!route.target_is_goal.is_set());
    for vertex in route.guide() {
        assert!(away_m(&vertex.vector(), &aside()) < 0.8, "{vertex:?}");
    }
    assert!((12.0..16.1).contains(&answer.certified_m), "{answer:?}");
    assert_eq!(answer.speed_mps, route.limits.speed_mps);
}

#[test]
fn a_path_to_the_goal_ends_at_it() {
    let way = [at(0.0, 0.0), at(2.0, 3.0), at(4.0, 0.2)];
    let (route, answer) = verdict(|| map(12.0, |_| false), to(4.0, 0.0), &way);
    assert_eq!(answer.verdict.get(), ProposalVerdict::Accepted);
    assert!(route.target_is_goal.is_set());
    assert_eq!(
        route.target,
        at(4.0, 0.0),
        "not where the way ends, 0.2 m beside it"
    );
}

#[test]
fn a_path_through_a_tree_is_refused_with_the_place() {
    let tree = || map(12.0, |p| (p.x - 0.1).hypot(p.y - 4.0) < 0.4);
    let (_, answer) = verdict(tree, to(60.0, 0.0), &aside());
    assert_eq!(answer.verdict.get(), ProposalVerdict::Occupied);
    assert_eq!(answer.waypoint, 1);
    assert!((answer.place.y_m - 3.6).abs() < 0.25, "{answer:?}");
    assert!((2.0..3.2).contains(&answer.certified_m), "{answer:?}");
}

#[test]
fn a_gap_narrower_than_the_vehicle_needs_is_refused() {
    let gap = || map(12.0, |p| (p.y - 4.0).abs() < 0.2 && !(-0.4..0.4).contains(&p.x));
    let (_, answer) = verdict(gap, to(60.0, 0.0), &aside());
    assert_eq!(answer.verdict.get(), ProposalVerdict::TooNarrow);
    assert_eq!(answer.waypoint, 1);
}

#[test]
fn a_path_into_the_unknown_is_flown_as_far_as_is_known() {
    let (route, answer) = verdict(|| map(6.0, |_| false), to(60.0, 0.0), &aside());
    assert_eq!(answer.verdict.get(), ProposalVerdict::Shortened);
    assert!((4.0..6.0).contains(&answer.place.y_m), "{answer:?}");
    assert!(route.target.y_m < answer.place.y_m, "it stops short of it");
    assert!(route.target.y_m > 2.0);
    let (_, answer) = verdict(|| map(1.1, |_| false), to(60.0, 0.0), &aside());
    assert_eq!(answer.verdict.get(), ProposalVerdict::Unknown);
}

#[test]
fn what_makes_no_sense_or_does_not_fit_is_refused_in_one_word() {
    let open = || map(12.0, |_| false);
    let desired = to(60.0, 0.0);
    let refusal = |waypoints: &[Point<LocalNed>]| verdict(open, desired, waypoints).1;
    let implausible = refusal(&[at(0.0, 0.0), at(f64::NAN, 0.0)]);
    assert_eq!(implausible.verdict.get(), ProposalVerdict::Implausible);
    assert_eq!(refusal(&[]).verdict.get(), ProposalVerdict::Implausible);
    let far = refusal(&[at(8.0, 2.0), at(20.0, 2.0)]);
    assert_eq!(far.verdict.get(), ProposalVerdict::TooFar);
    assert_eq!((far.place, far.waypoint), (at(8.0, 2.0), 0));
    let high = refusal(&[at(0.0, 0.0), Point::new(5.0, 0.0, -500.0)]);
    assert_eq!(
        (high.verdict.get(), high.waypoint),
        (ProposalVerdict::Shortened, 1),
        "it leaves the heights far beyond one route"
    );
    let high = refusal(&[at(0.0, 0.0), Point::new(5.0, 0.0, 0.5)]);
    assert_eq!(
        (high.verdict.get(), high.waypoint),
        (ProposalVerdict::HeightNotAllowed, 1)
    );
    let ended = refusal(&[at(-3.0, 0.0), at(0.0, 0.1)]);
    assert_eq!(ended.verdict.get(), ProposalVerdict::Ended);
    let other = verdict(open, desired, &aside());
    assert_eq!(other.1.verdict.get(), ProposalVerdict::Accepted);
    let mut bench = TestPlanner::new(open(), desired);
    let mut elsewhere = proposal(&desired, &aside());
    elsewhere.goal = at(40.0, 0.0);
    let answer = bench.step(Some(&elsewhere)).1.unwrap();
    assert_eq!(answer.verdict.get(), ProposalVerdict::OtherGoal);
}

#[test]
fn where_nothing_is_planned_it_is_reported() {
    let desired = to(60.0, 0.0);
    let proposal = proposal(&desired, &aside());
    let manual = |bench: &mut TestPlanner| bench.state.mode = Coded::new(NavMode::Manual);
    let blind = |bench: &mut TestPlanner| bench.map.ranges_fresh = false.into();
    for change in [manual as fn(&mut TestPlanner), blind] {
        let mut bench = TestPlanner::new(map(12.0, |_| false), desired);
        change(&mut bench);
        let (route, answer) = bench.step(Some(&proposal));
        assert_ne!(route.mode.get(), RouteMode::Plan);
        assert_eq!(answer.unwrap().verdict.get(), ProposalVerdict::NotPlanning);
    }
}

#[test]
fn a_requested_speed_slows_and_never_speeds_up() {
    let fly = |speed_mps: f64, flown_mps: f64| {
        let desired = to(60.0, 0.0);
        let mut bench = TestPlanner::new(map(12.0, |_| false), desired);
        let wished = Proposal {
            speed_mps,
            ..proposal(&desired, &[at(-1.0, 0.0), at(40.0, 1.0)])
        };
        bench.commit(&bench.route_of_a_plan());
        if flown_mps > 0.0 {
            let trajectory = &mut bench.approved.as_mut().unwrap().trajectory;
            let points = std::array::from_fn(|i| Vector3::new(9.0 * i as f64 / 5.0, 0.0, -HEIGHT_M));
            trajectory.pieces[0] = BezierPiece::new(&points, [0.0; 6], 9.0 / flown_mps);
        }
        let (route, answer) = bench.step(Some(&wished));
        assert!(answer.unwrap().verdict.get().is_flown(), "{answer:?}");
        route
    };
    let top_mps = planned_mps(3.0, 1.04);
    assert_eq!(fly(0.0, 0.0).limits.speed_mps, top_mps);
    assert_eq!(fly(50.0, 0.0).limits.speed_mps, top_mps);
    assert_eq!(fly(1.2, 0.0).limits.speed_mps, 1.2);
    assert_eq!(fly(0.01, 0.0).limits.speed_mps, 0.3);
    // A vehicle at 2.5 m/s cannot be at 1 m/s at once, but its path is no longer than slowing down takes.
    let slowing = fly(1.0, 2.5);
    assert!(
        (slowing.limits.speed_mps - 2.5).abs() < 1e-6,
        "{:?}",
        slowing.limits
    );
    let length_m = (slowing.target.vector() - slowing.start.position.vector()).norm();
    assert!((3.0..8.0).contains(&length_m), "{length_m}");
}

impl TestPlanner {
    /// A route with the limits of a plan, for whoever commits something.
    fn route_of_a_plan(&self) -> Route {
        Route {
            id: 99,
            limits: MotionLimits {
                speed_mps: 3.0,
                tube_m: 0.5,
                ..MotionLimits::default()
            },
            ..Route::default()
        }
    }
}

#[test]
fn a_proposal_that_is_silent_is_followed_by_the_own_path_at_once() {
    let desired = to(60.0, 0.0);
    let mut bench = TestPlanner::new(map(12.0, |_| false), desired);
    let way = proposal(&desired, &aside());
    assert!(bench.step(Some(&way)).0.target.y_m > 4.0);
    let (route, answer) = bench.step(None);
    assert_eq!(route.mode.get(), RouteMode::Plan);
    assert!(route.target.y_m.abs() < 1.0, "{:?}", route.target);
    assert!(answer.is_none());
    for _ in 0..60 {
        bench.step(None);
    }
    assert_eq!(bench.events, [PROPOSAL_FLOWN.id, PROPOSAL_ENDED.id]);
}

#[test]
fn an_answer_comes_once_and_anew_when_it_changes() {
    let desired = to(60.0, 0.0);
    let tree = map(12.0, |p| (p.x - 0.1).hypot(p.y - 4.0) < 0.4);
    let mut bench = TestPlanner::new(tree, desired);
    let mut way = proposal(&desired, &aside());
    let answers = (0..20).filter_map(|_| bench.step(Some(&way)).1).count();
    assert_eq!(answers, 1);
    way.id += 1;
    let answer = bench.step(Some(&way)).1.unwrap();
    assert_eq!(
        (answer.proposal_id, answer.verdict.get()),
        (8, ProposalVerdict::Occupied)
    );
    assert_eq!(bench.events, [PROPOSAL_REFUSED.id]);
}

#[test]
fn routes_that_are_not_flown_are_not_feasible_and_the_own_path_is_tried() {
    let desired = to(60.0, 0.0);
    let mut bench = TestPlanner::new(map(12.0, |_| false), desired);
    let way = proposal(&desired, &aside());
    let mut verdicts = Vec::new();
    let mut own = 0;
    for _ in 0..20 {
        let (route, answer) = bench.step(Some(&way));
        verdicts.extend(answer.map(|answer| answer.verdict.get()));
        own += u32::from(route.target.y_m.abs() < 1.0);
    }
    assert_eq!(verdicts, [ProposalVerdict::Accepted, ProposalVerdict::Infeasible]);
    assert!(own >= 16, "{own} of 20 are the planner's own");
}

#[test]
fn a_path_that_leads_nowhere_is_left_after_some_seconds_and_for_longer_each_time() {
    let desired = to(60.0, 0.0);
    let mut bench = TestPlanner::new(map(12.0, |_| false), desired);
    let mut way = proposal(&desired, &aside());
    let (mut given_up_s, mut taken_again_s) = (Vec::new(), Vec::new());
    let (mut was_flown, begin) = (false, bench.now);
    for _ in 0..1200 {
        // Another one each time, and still the same.
        way.id += 1;
        let (route, answer) = bench.step(Some(&way));
        bench.commit(&route);
        // A vehicle that does not move plans twice a second once its goal counts as out of reach.
        let Some(verdict) = answer.map(|answer| answer.verdict.get()) else {
            continue;
        };
        let since_s = bench.now.seconds_since(begin);
        if verdict.is_flown() && !was_flown {
            taken_again_s.push(since_s);
        } else if !verdict.is_flown() && was_flown {
            assert_eq!(verdict, ProposalVerdict::NoProgress);
            assert!(route.target.y_m.abs() < 1.0, "its own way: {:?}", route.target);
            given_up_s.push(since_s);
        }
        was_flown = verdict.is_flown();
    }
    assert!(
        (given_up_s[0] - taken_again_s[0] - 5.0).abs() < 0.3,
        "{given_up_s:?}"
    );
    let pauses: Vec<f64> = taken_again_s[1..]
        .iter()
        .zip(&given_up_s)
        .map(|(taken, given_up)| (taken - given_up).round())
        .collect();
    assert_eq!(pauses, [10.0, 20.0, 40.0]);
    // Another goal ends the pause.
    bench.desired = to(60.0, 5.0);
    way.goal = goal_of(&bench.desired);
    let answer = bench.step(Some(&way)).1.unwrap();
    assert!(answer.verdict.get().is_flown());
}

#[test]
fn something_new_on_the_committed_way_is_left_by_the_planners_own_rules() {
    let desired = to(60.0, 0.0);
    let post = map(12.0, |p| (p.x - 6.0).hypot(p.y) < 0.3);
    let mut bench = TestPlanner::new(post, desired);
    bench.commit(&bench.route_of_a_plan());
    let points = std::array::from_fn(|i| Vector3::new(9.0 * i as f64 / 5.0, 0.0, -HEIGHT_M));
    bench.approved.as_mut().unwrap().trajectory.pieces[0] = BezierPiece::new(&points, [0.0; 6], 4.5);
    let (route, answer) = bench.step(Some(&proposal(&desired, &aside())));
    assert!(route.must_leave.is_set());
    assert_eq!(answer.unwrap().verdict.get(), ProposalVerdict::Evading);
}

/// A coordinate as programs propose them: near the vehicle mostly, and nonsense.
fn coordinate() -> impl Strategy<Value = f64> {
    prop_oneof![
        12 => -12.0..12.0f64,
        2 => -1e3..1e3f64,
        1 => any::<f64>(),
        1 => Just(f64::NAN),
    ]
}

fn any_proposal() -> impl Strategy<Value = Proposal> {
    let near =
        prop::collection::vec((-1.0..11.0f64, -7.0..7.0f64, -3.5..-1.5f64), 1..12).prop_map(|points| {
            points
                .into_iter()
                .map(|(x, y, z)| Point::new(x, y, z))
                .collect::<Vec<_>>()
        });
    let wild = prop::collection::vec((coordinate(), coordinate(), coordinate()), 0..PROPOSAL_WAYPOINTS)
        .prop_map(|points| {
            points
                .into_iter()
                .map(|(x, y, z)| Point::new(x, y, z))
                .collect::<Vec<_>>()
        });
    let speed = prop_oneof![Just(0.0), 0.0..5.0f64, any::<f64>()];
    (prop_oneof![3 => near, 1 => wild], speed, any::<bool>(), 0..100u32).prop_map(
        |(mut points, speed_mps, here, len)| {
            if here && !points.is_empty() {
                points[0] = at(0.0, 0.0);
            }
            let mut proposal = Proposal {
                id: 1,
                goal: at(60.0, 0.0),
                speed_mps,
                len: if len == 0 { u32::MAX } else { points.len() as u32 },
                ..Proposal::default()
            };
            proposal.waypoints[..points.len()].copy_from_slice(&points);
            proposal
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn whatever_is_proposed_every_corridor_is_far_from_obstacles_and_from_the_unknown(
        trees in prop::collection::vec((1.5..9.0f64, -6.0..6.0f64), 0..8),
        proposals in prop::collection::vec(any_proposal(), 1..4),
        velocity in (0.0..3.0f64, -1.5..1.5f64),
        samples in prop::collection::vec((-1.0..11.0f64, -8.0..8.0f64, -4.0..-1.0f64), 600),
    ) {
        let tree = |p: &Vector3<f64>| trees.iter().map(|(x, y)| (p.x - x).hypot(p.y - y)).fold(f64::MAX, f64::min);
        let mut bench = TestPlanner::new(map(10.0, |p| tree(&p) < 0.3), to(60.0, 0.0));
        for (index, proposal) in proposals.iter().enumerate() {
            // The last one meets a vehicle in motion.
            if index > 0 && index + 1 == proposals.len() {
                bench.state.velocity = Velocity::new(velocity.0, velocity.1, 0.0);
            }
            let proposal = Proposal { id: index as u64, ..*proposal };
            let (route, answer) = bench.step(Some(&proposal));
            let answer = answer.unwrap();
            let is_flown = answer.verdict.get().is_flown();
            prop_assert!(!is_flown || proposal.is_plausible() && route.mode == RouteMode::Plan, "{answer:?}");
            prop_assert!(answer.verdict != ProposalVerdict::Refused);
            if route.mode != RouteMode::Plan {
                continue;
            }
            // No limit is raised.
            let own = jink_planner::speed_tiers::speed_tiers(&ParamSet::default(), &Tracking::PX4_TRAJECTORY);
            let tier = own.iter().find(|tier| tier.tube_m == route.limits.tube_m).unwrap();
            prop_assert!(route.limits.speed_mps <= tier.speed_mps);
            let at_full_speed = MotionLimits { speed_mps: tier.speed_mps, ..route.limits };
            let allowed = [*tier, tier.with_gentle_stop(&Tracking::PX4_TRAJECTORY)];
            prop_assert!(allowed.contains(&at_full_speed), "{at_full_speed:?}");
            let min_distance_m = 0.3 + 0.1 + route.limits.tube_m;
            for (x, y, z) in &samples {
                let p = Vector3::new(*x, *y, *z);
                if route.corridor().iter().any(|polytope| polytope.depth_m(&p) >= 0.0) {
                    prop_assert!(tree(&p) > 0.3 + min_distance_m - 0.15, "{p} is {} m from a tree", tree(&p));
                    prop_assert!((p - Vector3::new(0.0, 0.0, -HEIGHT_M)).norm() < 10.0 - min_distance_m + 0.2, "{p} is unknown");
                }
            }
            for (polytope, leg) in route.corridor().iter().zip(route.guide().windows(2)) {
                prop_assert!(polytope.depth_m(&leg[0].vector()) > -1e-5 && polytope.depth_m(&leg[1].vector()) > -1e-5);
            }
            prop_assert_eq!(route.guide()[0].vector(), route.start.position.vector());
        }
    }
}
