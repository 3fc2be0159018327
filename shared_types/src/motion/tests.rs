use super::*;
use crate::clock::Timestamp;
use proptest::prelude::*;

fn piece(from: f64, to: f64, duration_s: f64) -> BezierPiece {
    let rest = |x: f64| End {
        position: Vector3::new(x, 0.0, -2.0),
        velocity: Vector3::zeros(),
        acceleration: Vector3::zeros(),
    };
    BezierPiece::new(
        &bezier::quintic_between(&rest(from), &rest(to), duration_s),
        [0.0; 6],
        duration_s,
    )
}

fn two_pieces() -> Trajectory {
    let mut trajectory = Trajectory {
        id: 1,
        start: Timestamp::from_seconds(100.0),
        ..Trajectory::default()
    };
    assert!(trajectory.push(piece(0.0, 3.0, 2.0)));
    assert!(trajectory.push(piece(3.0, 5.0, 1.0)));
    trajectory
}

proptest! {
    #[test]
    fn a_prefix_traces_its_base(from in 0.0..2.8f64, span in 0.01..2.5f64, u in 0.0..1.0f64) {
        let base = two_pieces();
        let begin = base.start.plus_seconds(from);
        let until = base.start.plus_seconds((from + span).min(3.0));
        let mut prefix = Trajectory::default();
        prop_assert!(prefix.take_prefix(&base, begin, until));
        let time = begin.plus_seconds(u * until.seconds_since(begin));
        let (a, b) = (base.at(time).unwrap(), prefix.at(time).unwrap());
        prop_assert!((a.position.vector() - b.position.vector()).norm() < 1e-6);
        prop_assert!((a.velocity.vector() - b.velocity.vector()).norm() < 1e-4);
        prop_assert!((prefix.end().seconds_since(until)).abs() < 2e-4);
    }

    #[test]
    fn the_stoppable_speed_is_the_inverse_of_the_stopping_distance(
        speed in 0.0..20.0f64, delay in 0.0..1.0f64, a in 0.5..15.0f64, j in 1.0..40.0f64,
    ) {
        let distance = stopping_distance_m(speed, delay, a, j);
        prop_assert!((stoppable_speed_mps(distance, delay, a, j) - speed).abs() < 1e-6);
    }
}

#[test]
fn after_its_end_a_trajectory_is_at_rest() {
    let trajectory = two_pieces();
    let late = trajectory.at(trajectory.end().plus_seconds(10.0)).unwrap();
    assert!((late.position.x_m - 5.0).abs() < 1e-9);
    assert_eq!(late.velocity.vector().norm(), 0.0);
}

#[test]
fn an_empty_trajectory_has_no_state_and_is_not_sound() {
    let empty = Trajectory::default();
    assert!(empty.at(Timestamp::from_seconds(1.0)).is_none());
    assert!(!empty.is_sound());
}

#[test]
fn a_corrupted_length_is_no_panic() {
    let mut trajectory = two_pieces();
    trajectory.len = u32::MAX;
    assert!(!trajectory.is_sound());
    assert_eq!(trajectory.pieces().len(), TRAJECTORY_PIECES);
}
