//! How the guide is cut into pieces of time: a speed profile along it.
//!
//! Speeds at the vertices are limited by the turn there, by braking to rest at the end and by what can be reached from
//! the start (a forward and a backward pass); between two vertices the profile is a trapezoid. Its acceleration is the
//! mean one that acceleration and jerk allow; a curve that needs more ends a little short of the guide. The stop at the
//! end brakes with the limits for that, and so begins as late as it can: it is flown where nothing longer is planned before.
//! Every leg is cut into pieces of equal and not too long time: one polynomial of fifth degree cannot brake evenly for long.

use jink_shared_types::motion::{MotionLimits, REPLANNED_S, stoppable_speed_mps, stopping_distance_m};
use nalgebra::Vector3;

/// Shortest piece (s): shorter ones only amplify rounding in the derivatives.
pub const PIECE_MIN_S: f64 = 0.25;
/// Longest piece (s), as long as there are not too many of them.
const PIECE_MAX_S: f64 = 0.7;
/// Turns below this do not limit the speed (rad).
const TURN_FREE_RAD: f64 = 0.05;
/// A profile whose top is below this is made as if it were this (m/s).
const TOP_MIN_MPS: f64 = 0.3;
/// Most legs of a guide.
const LEGS_MAX: usize = 63;

/// A piece of a leg.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LegPiece {
    /// Number of the leg.
    pub leg: usize,
    /// Duration (s).
    pub duration_s: f64,
    /// Where the profile is at its end.
    pub end: Vector3<f64>,
    /// It belongs to the stop at the end.
    pub brakes: bool,
}

/// A leg of the profile: it speeds up from one speed to the peak and brakes to the other.
#[derive(Clone, Copy, Debug, Default)]
struct LegProfile {
    length_m: f64,
    from_mps: f64,
    peak_mps: f64,
    to_mps: f64,
    acceleration_mps2: f64,
    braking_mps2: f64,
}

impl LegProfile {
    fn speeding_s(&self) -> f64 {
        (self.peak_mps - self.from_mps) / self.acceleration_mps2
    }

    fn braking_s(&self) -> f64 {
        (self.peak_mps - self.to_mps) / self.braking_mps2
    }

    fn cruising_s(&self) -> f64 {
        let speeding_m = 0.5 * (self.peak_mps + self.from_mps) * self.speeding_s();
        let braking_m = 0.5 * (self.peak_mps + self.to_mps) * self.braking_s();
        (self.length_m - speeding_m - braking_m).max(0.0) / self.peak_mps
    }

    fn duration_s(&self) -> f64 {
        self.speeding_s() + self.cruising_s() + self.braking_s()
    }

    /// How far (m) along the leg the profile is after `time_s` of it.
    fn at_m(&self, time_s: f64) -> f64 {
        let [speeding_s, cruising_s, braking_s] = [self.speeding_s(), self.cruising_s(), self.braking_s()];
        let speeding_t = time_s.min(speeding_s);
        let cruising_t = (time_s - speeding_s).clamp(0.0, cruising_s);
        let braking_t = (time_s - speeding_s - cruising_s).clamp(0.0, braking_s);
        (self.from_mps + 0.5 * self.acceleration_mps2 * speeding_t) * speeding_t
            + self.peak_mps * cruising_t
            + (self.peak_mps - 0.5 * self.braking_mps2 * braking_t) * braking_t
    }
}

/// Cuts the guide `vertices` into pieces, for a start with `start_velocity` (m/s) and an end at rest within `limits`; the
/// times of the profile are multiplied by `stretch`. Returns how many of `pieces` were written: as many as there are legs
/// at least, none if there is no room for those.
pub fn cut(
    vertices: &[Vector3<f64>],
    start_velocity: &Vector3<f64>,
    limits: &MotionLimits,
    stretch: f64,
    pieces: &mut [LegPiece],
) -> usize {
    let legs = vertices.len().saturating_sub(1);
    if legs == 0 || legs > LEGS_MAX || legs > pieces.len() {
        return 0;
    }
    let mut profile = [LegProfile::default(); LEGS_MAX];
    let profile = &mut profile[..legs];
    let (going_mps2, going_mps3) = (limits.acceleration_mps2, limits.jerk_mps3);
    let (braking_mps2, braking_mps3) = (
        limits.braking_mps2.max(going_mps2),
        limits.braking_jerk_mps3.max(going_mps3),
    );
    // It speeds up no more than so that the next plan is flown before it brakes.
    let length_m = vertices.windows(2).map(|leg| (leg[1] - leg[0]).norm()).sum();
    let held_mps = stoppable_speed_mps(length_m, REPLANNED_S, braking_mps2, braking_mps3);
    let speed_mps = limits
        .speed_mps
        .min(held_mps.max(start_velocity.norm()).max(TOP_MIN_MPS));
    let mut top_mps = speed_mps;
    for _ in 0..2 {
        let fastest_mps = top_mps.max(TOP_MIN_MPS);
        let accelerations_mps2 = [
            mean_acceleration_mps2(fastest_mps, going_mps2, going_mps3),
            mean_acceleration_mps2(fastest_mps, braking_mps2, braking_mps3),
        ];
        make(vertices, start_velocity, speed_mps, accelerations_mps2, profile);
        top_mps = profile.iter().map(|leg| leg.peak_mps).fold(0.0, f64::max);
    }
    let mut piece_max_s = PIECE_MAX_S;
    let parts = |leg: &LegProfile, piece_max_s: f64| {
        ((stretch * leg.duration_s() / piece_max_s).ceil() as usize).max(1)
    };
    while profile.iter().map(|leg| parts(leg, piece_max_s)).sum::<usize>() > pieces.len() {
        piece_max_s *= 1.2;
    }
    let mut count = 0;
    for (index, leg) in profile.iter().enumerate() {
        let parts = parts(leg, piece_max_s);
        let stops = leg.braking_mps2 > leg.acceleration_mps2;
        let (from, to) = (vertices[index], vertices[index + 1]);
        for part in 1..=parts {
            let share = part as f64 / parts as f64;
            let end_s = leg.duration_s() * share;
            let along = leg.at_m(end_s) / leg.length_m.max(1e-9);
            pieces[count] = LegPiece {
                leg: index,
                duration_s: (stretch * leg.duration_s() / parts as f64).max(PIECE_MIN_S),
                end: if part == parts {
                    to
                } else {
                    from + (to - from) * along.min(1.0)
                },
                brakes: stops && end_s > leg.speeding_s() + leg.cruising_s(),
            };
            count += 1;
        }
    }
    count
}

/// The mean acceleration (m/s2) of a stop from `speed_mps` within acceleration and jerk.
fn mean_acceleration_mps2(speed_mps: f64, acceleration_mps2: f64, jerk_mps3: f64) -> f64 {
    let stop_m = stopping_distance_m(speed_mps, 0.0, acceleration_mps2, jerk_mps3);
    speed_mps * speed_mps / (2.0 * stop_m)
}

/// Makes the profile, not faster than `speed_mps`, with the acceleration `a` (m/s2), and `b` (m/s2) in the stop at the end.
fn make(
    vertices: &[Vector3<f64>],
    start_velocity: &Vector3<f64>,
    speed_mps: f64,
    [a, b]: [f64; 2],
    profile: &mut [LegProfile],
) {
    let legs = profile.len();
    let leg = |i: usize| vertices[i + 1] - vertices[i];
    let mut speed = [0.0; LEGS_MAX + 1];
    let first = leg(0);
    speed[0] = if first.norm() > 1e-6 {
        (start_velocity.dot(&first) / first.norm()).clamp(0.0, speed_mps)
    } else {
        0.0
    };
    for (i, limit) in speed.iter_mut().enumerate().take(legs).skip(1) {
        *limit = speed_mps.min(turning_speed_mps(&leg(i - 1), &leg(i), a));
    }
    // The highest speeds from which the stop is possible; behind them nothing else brakes.
    let mut stop = [0.0; LEGS_MAX + 1];
    speed[legs] = speed_mps;
    for i in (0..legs).rev() {
        stop[i] = (stop[i + 1] * stop[i + 1] + 2.0 * b * leg(i).norm()).sqrt();
        if i > 0 {
            speed[i] = speed[i].min((speed[i + 1].powi(2) + 2.0 * a * leg(i).norm()).sqrt());
        }
    }
    for i in 1..=legs {
        let reached_mps = (speed[i - 1].powi(2) + 2.0 * a * leg(i - 1).norm()).sqrt();
        speed[i] = speed[i].min(reached_mps).min(stop[i]);
    }
    for (i, out) in profile.iter_mut().enumerate() {
        let (length_m, from_mps, to_mps) = (leg(i).norm(), speed[i], speed[i + 1]);
        let b = if to_mps >= stop[i + 1] { b } else { a };
        let squares = from_mps * from_mps / a + to_mps * to_mps / b;
        let peak_mps = ((squares + 2.0 * length_m) / (1.0 / a + 1.0 / b)).sqrt();
        *out = LegProfile {
            length_m,
            from_mps,
            peak_mps: peak_mps.min(speed_mps).max(from_mps).max(to_mps).max(1e-3),
            to_mps,
            acceleration_mps2: a,
            braking_mps2: b,
        };
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

#[cfg(test)]
mod tests {
    use super::{LegPiece, PIECE_MAX_S, PIECE_MIN_S, cut};
    use jink_shared_types::motion::{MotionLimits, REPLANNED_S, stoppable_speed_mps};
    use nalgebra::Vector3;

    const LIMITS: MotionLimits = MotionLimits {
        speed_mps: 3.0,
        climb_mps: 2.0,
        descent_mps: 1.0,
        acceleration_mps2: 1.2,
        jerk_mps3: 2.5,
        yaw_rate_radps: 0.5,
        tube_m: 0.5,
        overshoot_m: 0.5,
        braking_mps2: 1.2,
        braking_jerk_mps3: 2.5,
    };

    fn straight(legs: u32) -> Vec<Vector3<f64>> {
        (0..=legs)
            .map(|i| Vector3::new(f64::from(i) * 3.0, 0.0, 0.0))
            .collect()
    }

    /// Pieces of `vertices` from 3 m/s along the first leg.
    fn pieces(vertices: &[Vector3<f64>], most: usize) -> Vec<LegPiece> {
        let mut pieces = vec![LegPiece::default(); most];
        let start = Vector3::new(3.0, 0.0, 0.0);
        let count = cut(vertices, &start, &LIMITS, 1.0, &mut pieces);
        pieces.truncate(count);
        pieces
    }

    fn time_s(pieces: &[LegPiece], leg: usize) -> f64 {
        pieces
            .iter()
            .filter(|piece| piece.leg == leg)
            .map(|piece| piece.duration_s)
            .sum()
    }

    #[test]
    fn a_long_straight_is_flown_at_top_speed_and_the_end_brakes_in_short_pieces() {
        let pieces = pieces(&straight(5), 12);
        assert!(
            (time_s(&pieces, 0) - 1.0).abs() < 1e-6 && (time_s(&pieces, 1) - 1.0).abs() < 1e-6,
            "{pieces:?}"
        );
        assert!(time_s(&pieces, 4) > 1.8, "the last leg brakes: {pieces:?}");
        for pair in pieces.windows(2) {
            assert!(
                pair[1].end.x > pair[0].end.x && pair[1].leg >= pair[0].leg,
                "{pieces:?}"
            );
            assert!(
                (PIECE_MIN_S..=PIECE_MAX_S).contains(&pair[1].duration_s),
                "{pieces:?}"
            );
        }
        assert_eq!(pieces.last().unwrap().end, Vector3::new(15.0, 0.0, 0.0));
    }

    #[test]
    fn the_stop_brakes_late_and_hard_and_nothing_else_does() {
        let hard = MotionLimits {
            braking_mps2: 6.0,
            braking_jerk_mps3: 20.0,
            ..LIMITS
        };
        let vertices = straight(3);
        let start = Vector3::new(3.0, 0.0, 0.0);
        let of = |limits: &MotionLimits| {
            let mut pieces = vec![LegPiece::default(); 12];
            let count = cut(&vertices, &start, limits, 1.0, &mut pieces);
            pieces.truncate(count);
            pieces
        };
        let (gentle, hard) = (of(&LIMITS), of(&hard));
        assert!(gentle.iter().all(|piece| !piece.brakes));
        let first = hard.iter().position(|piece| piece.brakes).unwrap();
        assert!(hard[first..].iter().all(|piece| piece.brakes));
        let lasts_s = |pieces: &[LegPiece]| pieces.iter().map(|piece| piece.duration_s).sum::<f64>();
        assert!(hard[first - 1].end.x > 5.9, "{hard:?}");
        assert!(lasts_s(&hard) < lasts_s(&gentle) - 0.5);
    }

    #[test]
    fn nothing_speeds_up_that_had_to_brake_before_the_next_plan() {
        let mut pieces = vec![LegPiece::default(); 12];
        let slow = Vector3::new(1.0, 0.0, 0.0);
        let count = cut(&straight(1), &slow, &LIMITS, 1.0, &mut pieces);
        let held_mps = stoppable_speed_mps(3.0, REPLANNED_S, LIMITS.acceleration_mps2, LIMITS.jerk_mps3);
        let mut before = Vector3::zeros();
        for piece in &pieces[..count] {
            let mean_mps = (piece.end - before).norm() / piece.duration_s;
            assert!(mean_mps <= held_mps + 1e-9, "{mean_mps} of {held_mps}");
            before = piece.end;
        }
    }

    #[test]
    fn a_corner_is_taken_slowly() {
        let corner = [
            Vector3::zeros(),
            Vector3::new(3.0, 0.0, 0.0),
            Vector3::new(3.0, 3.0, 0.0),
        ];
        assert!(time_s(&pieces(&corner, 12), 0) > time_s(&pieces(&straight(2), 12), 0));
    }

    #[test]
    fn where_there_is_little_room_pieces_are_longer_and_every_leg_has_one() {
        for most in 5..12 {
            let pieces = pieces(&straight(5), most);
            assert!(
                (0..5).all(|leg| pieces.iter().any(|piece| piece.leg == leg)),
                "{pieces:?}"
            );
            assert!(pieces.len() <= most);
        }
        assert_eq!(pieces(&straight(5), 4), []);
    }
}
