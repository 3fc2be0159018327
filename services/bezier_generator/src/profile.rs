//! How long each piece should take: a speed profile along the guide.
//!
//! Speeds at the vertices are limited by the turn there, by braking to rest at the end and by what can be reached from
//! the start (a forward and a backward pass); between two vertices the profile is a trapezoid. The curve that is fitted
//! afterwards needs a margin, so the profile uses only a share of the acceleration.

use jink_shared_types::motion::PROFILE_ACCELERATION_SHARE;
use nalgebra::Vector3;

/// Shortest piece (s): shorter ones only amplify rounding in the derivatives.
pub const PIECE_MIN_S: f64 = 0.25;
/// Turns below this do not limit the speed (rad).
const TURN_FREE_RAD: f64 = 0.05;

/// Writes the duration (s) of every leg of the guide `vertices` into `durations_s` (one less than vertices), for a
/// start with `start_velocity` (m/s) and an end at rest, within `speed_mps` and `acceleration_mps2`.
pub fn durations(
    vertices: &[Vector3<f64>],
    start_velocity: &Vector3<f64>,
    speed_mps: f64,
    acceleration_mps2: f64,
    durations_s: &mut [f64],
) {
    let a = PROFILE_ACCELERATION_SHARE * acceleration_mps2;
    let legs = vertices.len().saturating_sub(1);
    let leg = |i: usize| vertices[i + 1] - vertices[i];
    let mut speed = [0.0; 64];
    if legs == 0 || legs >= speed.len() || durations_s.len() < legs {
        return;
    }
    let first = leg(0);
    speed[0] = if first.norm() > 1e-6 {
        (start_velocity.dot(&first) / first.norm()).clamp(0.0, speed_mps)
    } else {
        0.0
    };
    for (i, limit) in speed.iter_mut().enumerate().take(legs).skip(1) {
        *limit = speed_mps.min(turning_speed_mps(&leg(i - 1), &leg(i), a));
    }
    for i in (1..legs).rev() {
        speed[i] = speed[i].min((speed[i + 1].powi(2) + 2.0 * a * leg(i).norm()).sqrt());
    }
    for i in 1..=legs {
        speed[i] = speed[i].min((speed[i - 1].powi(2) + 2.0 * a * leg(i - 1).norm()).sqrt());
    }
    for i in 0..legs {
        durations_s[i] = leg_time_s(leg(i).norm(), speed[i], speed[i + 1], speed_mps, a).max(PIECE_MIN_S);
    }
}

/// The speed at which a turn from `before` to `after` needs no more than `a`, if the change of direction may take half
/// of both legs.
fn turning_speed_mps(before: &Vector3<f64>, after: &Vector3<f64>, a: f64) -> f64 {
    let turn_rad = before.angle(after);
    if turn_rad < TURN_FREE_RAD {
        return f64::INFINITY;
    }
    let available_m = 0.5 * (before.norm() + after.norm());
    (a * available_m / turn_rad).sqrt()
}

/// Time for `length_m` from speed `from` to speed `to`, not faster than `top`, with acceleration `a` at most.
fn leg_time_s(length_m: f64, from: f64, to: f64, top: f64, a: f64) -> f64 {
    let peak = ((from * from + to * to) / 2.0 + a * length_m)
        .sqrt()
        .min(top)
        .max(from)
        .max(to)
        .max(1e-3);
    let speeding_m = (peak * peak - from * from) / (2.0 * a);
    let braking_m = (peak * peak - to * to) / (2.0 * a);
    let cruising_m = (length_m - speeding_m - braking_m).max(0.0);
    (peak - from) / a + (peak - to) / a + cruising_m / peak
}

#[cfg(test)]
mod tests {
    use super::durations;
    use nalgebra::Vector3;

    #[test]
    fn a_long_straight_is_flown_at_top_speed() {
        let vertices: Vec<_> = (0..6)
            .map(|i| Vector3::new(f64::from(i) * 3.0, 0.0, 0.0))
            .collect();
        let mut times = [0.0; 5];
        durations(&vertices, &Vector3::new(3.0, 0.0, 0.0), 3.0, 1.2, &mut times);
        assert!(
            (times[0] - 1.0).abs() < 1e-6 && (times[1] - 1.0).abs() < 1e-6,
            "{times:?}"
        );
        assert!(times[4] > 1.8, "the last leg brakes: {times:?}");
    }

    #[test]
    fn a_corner_is_taken_slowly() {
        let turn = [
            Vector3::zeros(),
            Vector3::new(3.0, 0.0, 0.0),
            Vector3::new(3.0, 3.0, 0.0),
        ];
        let straight = [
            Vector3::zeros(),
            Vector3::new(3.0, 0.0, 0.0),
            Vector3::new(6.0, 0.0, 0.0),
        ];
        let (mut slow, mut fast) = ([0.0; 2], [0.0; 2]);
        let start = Vector3::new(3.0, 0.0, 0.0);
        durations(&turn, &start, 3.0, 1.2, &mut slow);
        durations(&straight, &start, 3.0, 1.2, &mut fast);
        assert!(slow[0] > fast[0]);
    }
}
