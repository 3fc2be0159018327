//! How closely the vehicle follows what it is sent, fitted in flight to what it does.
//!
//! | in | out |
//! |---|---|
//! | where the vehicle is, and where it should be | corner cutting and overshoot ([`Tracking`]), once there is enough to tell |
//!
//! The vehicle is where the reference `r` was a `delay` ago, moved along the acceleration of the reference, and a random part:
//!
//! ```text
//! p(t) - r(t) = -delay v(t) + shift a(t) + random
//! ```
//!
//! Who is only late stays on the curve: to second order `r(t - delay) = r - delay v + delay^2/2 a`. So what it leaves the
//! curve by is `|shift - delay^2/2| a`, and the random part, of which twice the standard deviation across the motion counts. Both
//! numbers are a least-squares fit over the last minute or so, the horizontal axes together, by the normal equations of two
//! unknowns.
//!
//! A stop is over when the reference has rested for two seconds; how far the vehicle went beyond its end, per greatest deceleration
//! before it, is its overshoot. Of all stops the second worst counts: one may be a leap of the estimator.

use jink_shared_types::motion::MotionState;
use jink_shared_types::tracking::{TUBE_BASE_M, Tracking};
use jink_shared_types::{LocalNed, Point, Timestamp};
use nalgebra::{Matrix2, Vector2};

/// What was seen longer ago than this counts for less than a third (s).
const REMEMBERED_S: f64 = 60.0;
/// The sum of squared accelerations times time (m2/s3) that a fit needs: ten seconds of turns with 0.7 m/s2.
const EXCITED: f64 = 5.0;
/// The acceleration (m/s2) at which the random part is given room: that of the highest speed tier of the loosest autopilot.
const AT_MPS2: f64 = 1.04;
/// A reference slower than this rests (m/s), one faster has a direction.
const RESTING_MPS: f64 = 0.02;
const MOVING_MPS: f64 = 0.3;
/// A stop without this deceleration (m/s2) says little of overshoot.
const BRAKING_MPS2: f64 = 0.4;
/// How long the reference rests until a stop is over (s): by then the vehicle has turned back.
const SETTLED_S: f64 = 2.0;
/// Two states farther apart than this (s) belong to two flights, or to none.
const GAP_S: f64 = 0.5;
/// A vehicle farther from its reference than this (m) does not follow it.
const LOST_M: f64 = 3.0;

/// A stop that is flown or has just been flown.
#[derive(Clone, Copy, Debug)]
struct Stop {
    /// Direction of the reference before it rested.
    ahead: Vector2<f64>,
    /// Greatest deceleration of the reference so far (m/s2).
    deceleration_mps2: f64,
    /// How far the vehicle has been beyond the end (m).
    beyond_m: f64,
    /// Since when the reference rests.
    rests: Option<Timestamp>,
}

/// The fit.
#[derive(Clone, Debug, Default)]
pub struct Following {
    last: Timestamp,
    /// Sums over the last minute: of the products of `[-v, a]`, of those with the error, and of time.
    products: Matrix2<f64>,
    moments: Vector2<f64>,
    /// Sum of the squared random part across the motion, and the time that it was summed over (s).
    random_m2s: f64,
    random_s: f64,
    stop: Option<Stop>,
    /// Overshoot per deceleration of the two worst stops (s2), worst first.
    worst_s2: [f64; 2],
}

impl Following {
    /// Adds that the vehicle was at `position` while it should have been at `reference`, at `time`.
    pub fn add(&mut self, time: Timestamp, position: &Point<LocalNed>, reference: &MotionState) {
        let passed_s = time.seconds_since(self.last);
        let is_first = !self.last.is_set() || passed_s > GAP_S;
        if !is_first && passed_s <= 0.0 {
            return;
        }
        self.last = time;
        let error = (position.vector() - reference.position.vector()).xy();
        if is_first || !error.norm().is_finite() || error.norm() > LOST_M {
            self.stop = None;
            return;
        }
        let (velocity, acceleration) = (
            reference.velocity.vector().xy(),
            reference.acceleration.vector().xy(),
        );
        self.fit(passed_s, &error, &velocity, &acceleration);
        self.watch_stop(time, &error, &velocity, &acceleration);
    }

    /// Nothing is followed at the moment.
    pub fn pause(&mut self) {
        self.last = Timestamp::NEVER;
        self.stop = None;
    }

    fn fit(
        &mut self,
        passed_s: f64,
        error: &Vector2<f64>,
        velocity: &Vector2<f64>,
        acceleration: &Vector2<f64>,
    ) {
        let speed_mps = velocity.norm();
        if speed_mps < MOVING_MPS {
            return;
        }
        let kept = (-passed_s / REMEMBERED_S).exp();
        self.products *= kept;
        self.moments *= kept;
        self.random_m2s *= kept;
        self.random_s *= kept;
        let (late, shifted) = (-velocity, *acceleration);
        let product = late.dot(&shifted);
        self.products +=
            Matrix2::new(late.norm_squared(), product, product, shifted.norm_squared()) * passed_s;
        self.moments += Vector2::new(late.dot(error), shifted.dot(error)) * passed_s;
        if let Some([delay_s, shift_s2]) = self.solved() {
            let random = error - (late * delay_s + shifted * shift_s2);
            let across_m = random.perp(velocity) / speed_mps;
            self.random_m2s += across_m * across_m * passed_s;
            self.random_s += passed_s;
        }
    }

    /// Delay (s) and shift (s2); `None` before there is enough to tell them.
    fn solved(&self) -> Option<[f64; 2]> {
        if self.products[(1, 1)] < EXCITED {
            return None;
        }
        let solution = self.products.cholesky()?.solve(&self.moments);
        Some([solution.x, solution.y])
    }

    fn watch_stop(
        &mut self,
        time: Timestamp,
        error: &Vector2<f64>,
        velocity: &Vector2<f64>,
        acceleration: &Vector2<f64>,
    ) {
        let speed_mps = velocity.norm();
        if speed_mps > MOVING_MPS {
            let ahead = velocity / speed_mps;
            let deceleration_mps2 = -acceleration.dot(&ahead);
            // It speeds up again: another stop begins.
            let before_mps2 = self
                .stop
                .filter(|stop| deceleration_mps2 > 0.0 && stop.rests.is_none())
                .map_or(0.0, |stop| stop.deceleration_mps2);
            self.stop = Some(Stop {
                ahead,
                deceleration_mps2: deceleration_mps2.max(before_mps2),
                beyond_m: 0.0,
                rests: None,
            });
            return;
        }
        let Some(stop) = &mut self.stop else {
            return;
        };
        if speed_mps > RESTING_MPS {
            return;
        }
        stop.beyond_m = stop.beyond_m.max(error.dot(&stop.ahead));
        let since = *stop.rests.get_or_insert(time);
        if time.seconds_since(since) < SETTLED_S {
            return;
        }
        if stop.deceleration_mps2 > BRAKING_MPS2 {
            let overshoot_s2 = stop.beyond_m / stop.deceleration_mps2;
            let [worst, second] = self.worst_s2;
            self.worst_s2 = [worst.max(overshoot_s2), second.max(overshoot_s2.min(worst))];
        }
        self.stop = None;
    }

    /// What was learned; zeros where there is not enough to tell yet.
    pub fn learned(&self) -> Tracking {
        let cut_s2 = self
            .solved()
            .filter(|_| self.random_s > 0.0)
            .map(|[delay_s, shift_s2]| {
                let random_m = 2.0 * (self.random_m2s / self.random_s).sqrt();
                let across_s2 = (shift_s2 - 0.5 * delay_s * delay_s).abs();
                across_s2.max((across_s2 * AT_MPS2 + random_m - TUBE_BASE_M) / AT_MPS2)
            });
        Tracking {
            cut_s2: cut_s2.unwrap_or(0.0),
            overshoot_s2: self.worst_s2[1],
            ..Tracking::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Following;
    use jink_shared_types::frames::{Acceleration, Point, Velocity};
    use jink_shared_types::motion::MotionState;
    use jink_shared_types::tracking::Tracking;
    use jink_shared_types::{LocalNed, Timestamp};
    use nalgebra::Vector3;
    use proptest::prelude::*;

    /// A wave about north at 2 m/s: 0.8 m to both sides in 4 s, with 2 m/s2 at most.
    fn wave(t_s: f64) -> MotionState {
        let (rate, wide_m) = (std::f64::consts::FRAC_PI_2, 0.8);
        let (sin, cos) = (rate * t_s).sin_cos();
        MotionState {
            position: Point::new(2.0 * t_s, wide_m * sin, -3.0),
            velocity: Velocity::new(2.0, wide_m * rate * cos, 0.0),
            acceleration: Acceleration::new(0.0, -wide_m * rate * rate * sin, 0.0),
            ..MotionState::default()
        }
    }

    fn point(vector: Vector3<f64>) -> Point<LocalNed> {
        Point::from_vector(vector)
    }

    fn time(step: u32) -> (f64, Timestamp) {
        let t_s = 0.033 * f64::from(step);
        (t_s, Timestamp::from_seconds(10.0 + t_s))
    }

    proptest! {
        /// Who is late and cuts corners besides is known by what he cuts; how late he is does not matter.
        #[test]
        fn what_is_cut_is_told_from_what_is_late(delay_s in 0.0..0.2f64, cut_s2 in 0.0..0.25f64) {
            let mut following = Following::default();
            for step in 0..900 {
                let (t_s, time) = time(step);
                let late = wave(t_s - delay_s);
                following.add(time, &point(late.position.vector() + late.acceleration.vector() * cut_s2), &wave(t_s));
            }
            let learned_s2 = following.learned().cut_s2;
            // The series is cut after its second term; what is left counts as random, which is on the safe side.
            let beyond_s2 = 0.02 + 2.5 * delay_s * cut_s2;
            prop_assert!((-0.02..beyond_s2).contains(&(learned_s2 - cut_s2)), "{learned_s2}");
        }
    }

    #[test]
    fn a_random_part_counts_where_it_is_more_than_every_tube_holds() {
        let cut_s2 = |stray_m: f64| {
            let mut following = Following::default();
            for step in 0..900 {
                let (t_s, time) = time(step);
                let aside = Vector3::new(0.0, if step / 7 % 2 == 0 { stray_m } else { -stray_m }, 0.0);
                following.add(time, &point(wave(t_s).position.vector() + aside), &wave(t_s));
            }
            following.learned().cut_s2
        };
        assert!(cut_s2(0.02) < 0.01, "{}", cut_s2(0.02));
        assert!((0.2..0.4).contains(&cut_s2(0.2)), "{}", cut_s2(0.2));
    }

    #[test]
    fn on_a_straight_nothing_is_learned_of_corners() {
        let mut following = Following::default();
        for step in 0..3_000 {
            let (t_s, time) = time(step);
            let reference = MotionState {
                position: Point::new(2.0 * t_s, 0.0, -3.0),
                velocity: Velocity::new(2.0, 0.0, 0.0),
                ..MotionState::default()
            };
            following.add(
                time,
                &point(reference.position.vector() + Vector3::y() * 0.3),
                &reference,
            );
        }
        assert_eq!(following.learned().cut_s2, 0.0);
    }

    /// A stop from 2 m/s with 1 m/s2, after which the vehicle runs `beyond_m` farther and comes back.
    fn stop(following: &mut Following, from_s: f64, beyond_m: f64) {
        for step in 0..180 {
            let t_s = 0.033 * f64::from(step);
            let speed_mps = (2.0 - t_s).max(0.0);
            let braking_mps2 = if speed_mps > 0.0 { 1.0 } else { 0.0 };
            let gone_m = 0.5 * (4.0 - speed_mps * speed_mps);
            let over_m = beyond_m * (-(t_s - 2.5).powi(2)).exp();
            let reference = MotionState {
                position: Point::new(gone_m, 0.0, -3.0),
                velocity: Velocity::new(speed_mps, 0.0, 0.0),
                acceleration: Acceleration::new(-braking_mps2, 0.0, 0.0),
                ..MotionState::default()
            };
            let time = Timestamp::from_seconds(from_s + t_s);
            following.add(time, &Point::new(gone_m + over_m, 0.0, -3.0), &reference);
        }
        following.pause();
    }

    #[test]
    fn of_all_stops_the_second_worst_counts() {
        let mut following = Following::default();
        for (number, beyond_m) in [0.2, 0.9, 0.3, 0.1].into_iter().enumerate() {
            stop(&mut following, 100.0 * (number as f64 + 1.0), beyond_m);
        }
        let overshoot_s2 = following.learned().overshoot_s2;
        assert!((overshoot_s2 - 0.3).abs() < 0.02, "{overshoot_s2}");
    }

    #[test]
    fn leaps_gaps_and_what_is_no_number_teach_nothing() {
        let mut following = Following::default();
        for step in 0..900 {
            let (t_s, now) = time(step);
            let wild = [f64::NAN, f64::INFINITY, 50.0][step as usize % 3];
            following.add(now, &Point::new(wild, 0.0, -3.0), &wave(t_s));
        }
        for step in 0..900 {
            let (t_s, _) = time(step);
            let now = Timestamp::from_seconds(100.0 + 30.0 * t_s);
            following.add(now, &Point::new(2.0 * t_s, 0.0, -3.0), &wave(t_s));
        }
        assert_eq!(following.learned(), Tracking::default());
    }
}
