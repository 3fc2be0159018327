//! Motions for tests of limits: what certifies them and what admits them are held to the same ones.

use jink_shared_types::bezier::{
    End, derivative, derivative_scalar, evaluate, evaluate_scalar, quintic_between,
};
use jink_shared_types::motion::{BezierPiece, MotionLimits};
use nalgebra::Vector3;
use proptest::prelude::*;

/// A way up and one down, at rest between, the heading turning all the while.
pub fn hop() -> impl Strategy<Value = [BezierPiece; 2]> {
    let leg = (
        (-2.0..2.0f64, -2.0..2.0f64, 0.5..2.0f64),
        (0.3..2.0f64, any::<bool>()),
        2.0..5.0f64,
    );
    [leg.clone(), leg].prop_map(|[up, down]| {
        let rest = |position| End {
            position,
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
        };
        let mut from = Vector3::new(0.0, 0.0, -20.0);
        let mut yaw = 0.0;
        [(up, -1.0), (down, 1.0)].map(|(((x, y, z), (turn, left), duration_s), sign)| {
            let to = from + Vector3::new(x, y, sign * z);
            let points = quintic_between(&rest(from), &rest(to), duration_s);
            let yaw_to = yaw + if left { -turn } else { turn };
            let [a, b] = [yaw, yaw_to].map(|yaw| rest(Vector3::new(yaw, 0.0, 0.0)));
            let heading = quintic_between(&a, &b, duration_s).map(|point| point.x);
            (from, yaw) = (to, yaw_to);
            BezierPiece::new(&points, heading, duration_s)
        })
    })
}

/// The largest speed, climb, descent, acceleration, jerk and heading rate: of the motion itself, or of the control points.
pub fn extremes(pieces: &[BezierPiece], of_the_hull: bool) -> [f64; 6] {
    let mut most = [0.0f64; 6];
    for piece in pieces {
        let velocity: [_; 5] = derivative(&piece.points(), piece.duration_s);
        let acceleration: [_; 4] = derivative(&velocity, piece.duration_s);
        let jerk: [_; 3] = derivative(&acceleration, piece.duration_s);
        let yaw_rate: [f64; 5] = derivative_scalar(&piece.yaw_rad, piece.duration_s);
        let mut see = |v: Vector3<f64>, a: Vector3<f64>, j: Vector3<f64>, rate: f64| {
            for (most, value) in most
                .iter_mut()
                .zip([v.norm(), -v.z, v.z, a.norm(), j.norm(), rate.abs()])
            {
                *most = most.max(value);
            }
        };
        if of_the_hull {
            for i in 0..5 {
                see(velocity[i], acceleration[i.min(3)], jerk[i.min(2)], yaw_rate[i]);
            }
        } else {
            for i in 0..=400 {
                let u = f64::from(i) / 400.0;
                let rate = evaluate_scalar(&yaw_rate, u);
                see(
                    evaluate(&velocity, u),
                    evaluate(&acceleration, u),
                    evaluate(&jerk, u),
                    rate,
                );
            }
        }
    }
    most
}

/// Limits of those six values.
pub fn limits_of(values: [f64; 6]) -> MotionLimits {
    let [
        speed_mps,
        climb_mps,
        descent_mps,
        acceleration_mps2,
        jerk_mps3,
        yaw_rate_radps,
    ] = values;
    MotionLimits {
        speed_mps,
        climb_mps,
        descent_mps,
        acceleration_mps2,
        jerk_mps3,
        yaw_rate_radps,
        ..MotionLimits::default()
    }
}
