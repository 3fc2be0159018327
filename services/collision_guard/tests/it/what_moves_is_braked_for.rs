//! What moves: a trajectory that meets it is braked and a new one refused, unless the vehicle is no better off braking.

use crate::common::{DOWN_M, VehiclePose, World, hovering_guard, look, on, step, step_among, straight};
use jink_shared_types::frames::{Point, Velocity};
use jink_shared_types::motion::{GuardReason, TrajectoryMode, Verdict};
use jink_shared_types::moving::{MovingObstacle, MovingObstacles};

const NOW_S: f64 = 10.0;

fn walker(place: [f64; 2], velocity: [f64; 2]) -> MovingObstacles {
    let mut moving = MovingObstacles::default();
    moving.push(MovingObstacle {
        position: Point::new(place[0], place[1], DOWN_M),
        velocity: Velocity::new(velocity[0], velocity[1], 0.0),
        radius_m: 0.3,
        half_height_m: 1.0,
        ..MovingObstacle::default()
    });
    moving
}

/// The answer to a vehicle that flies north at 3 m/s, two seconds after its start, to `moving`, relative to it, and the pilot's texts.
fn answer_at_speed(place: [f64; 2], velocity: [f64; 2]) -> (TrajectoryMode, Vec<String>) {
    let (mut guard, mut ring) = hovering_guard(NOW_S);
    let flown = straight(7, NOW_S, 3.0, 2.0, 30.0);
    let (out, _) = step(&mut guard, NOW_S, Some(&flown), &ring, VehiclePose::at(0.0, 0.0));
    assert_eq!(out.verdict, Verdict::Passed);
    let t = NOW_S + 2.0;
    let here = on(&flown, t);
    let moving = walker([here.position[0] + place[0], place[1]], velocity);
    look(&mut ring, &World::default(), here, t);
    let (out, step_events) = step_among(&mut guard, t, None, &ring, here, &moving);
    let texts = step_events.events().iter().map(|event| event.text()).collect();
    (out.trajectory.mode.get(), texts)
}

#[test]
fn a_trajectory_is_braked_for_what_will_be_on_it_and_not_for_what_will_be_gone() {
    let mode = |place, velocity| answer_at_speed(place, velocity).0;
    // Half a second farther than the vehicle could stop, with somebody who comes to meet it.
    assert_eq!(mode([6.0, 0.0], [-2.0, 0.0]), TrajectoryMode::Brake);
    assert_eq!(mode([5.0, -2.4], [0.0, 1.5]), TrajectoryMode::Brake);
    assert_eq!(mode([5.0, 0.5], [0.0, 1.5]), TrajectoryMode::Plan);
    assert_eq!(mode([8.0, 0.0], [2.0, 0.0]), TrajectoryMode::Plan);
}

#[test]
fn the_pilot_reads_that_it_moves_and_how_far_away_it_is() {
    // Its surface is 0.3 m nearer than its middle.
    let (_, texts) = answer_at_speed([6.0, 0.0], [-2.0, 0.0]);
    assert_eq!(texts, ["jink: guard brakes, something moving 5.7 m ahead"]);
}

#[test]
fn a_start_into_the_way_of_somebody_is_refused_and_one_out_of_it_passes() {
    let verdict = |place, velocity| {
        let (mut guard, ring) = hovering_guard(NOW_S);
        let start = straight(7, NOW_S, 2.0, 1.5, 10.0);
        let moving = walker(place, velocity);
        let here = VehiclePose::at(0.0, 0.0);
        let (out, _) = step_among(&mut guard, NOW_S, Some(&start), &ring, here, &moving);
        (out.verdict.get(), out.reason.get())
    };
    let refused = (Verdict::Hold, GuardReason::Obstacle);
    let passed = (Verdict::Passed, GuardReason::None);
    assert_eq!(verdict([1.5, -2.5], [0.0, 1.6]), refused);
    // Whoever stays is hit from behind.
    assert_eq!(verdict([-2.5, 0.0], [1.5, 0.0]), passed);
    assert_eq!(verdict([1.5, 2.5], [0.0, 1.6]), passed);
}
