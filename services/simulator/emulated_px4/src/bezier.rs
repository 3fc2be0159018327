//! Evaluation of the curves a companion sends, independent of the code it made them with.
//!
//! N control points are a polynomial of degree N - 1 over its whole duration. De Casteljau's scheme is run on pairs of
//! value and derivative: with `u` the share of the duration, `d/du ((1-u) p + u q) = q - p + (1-u) p' + u q'`.

use jink_shared_types::frames::wrap_pi;
use nalgebra::Vector3;

/// Most control points of TRAJECTORY_REPRESENTATION_BEZIER.
pub const POINTS_MAX: usize = 5;

/// One control point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ControlPoint {
    /// Position, local NED (m).
    pub position: Vector3<f64>,
    /// Heading (rad); NaN = none.
    pub yaw_rad: f64,
}

/// A curve with its place in time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Curve {
    /// Control points; those in use come first.
    pub points: [ControlPoint; POINTS_MAX],
    /// Points in use.
    pub len: usize,
    /// Start, boot time (us). Signed: a companion's clock can map to before boot.
    pub start_us: i64,
    /// `delta` of the last point in use (s): the whole duration.
    pub duration_s: f64,
}

/// A curve at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurveState {
    /// Position (m).
    pub position: Vector3<f64>,
    /// Velocity (m/s).
    pub velocity: Vector3<f64>,
    /// Heading (rad); NaN if any control point has none.
    pub yaw_rad: f64,
    /// Heading rate (rad/s); NaN if any control point has no heading.
    pub yaw_rate_radps: f64,
}

impl Curve {
    /// Seconds since its start; negative before.
    pub fn age_s(&self, now_us: u64) -> f64 {
        (now_us as i64 - self.start_us) as f64 * 1e-6
    }

    /// The state at `now_us`; `None` outside the curve's time, without points, or with a duration that is none.
    pub fn at(&self, now_us: u64) -> Option<CurveState> {
        let share = self.age_s(now_us) / self.duration_s;
        let usable = self.len > 0 && self.duration_s.is_finite() && self.duration_s > 0.0;
        if !usable || !(0.0..=1.0).contains(&share) {
            return None;
        }
        // Headings relative to the first, so that a curve through south does not turn the long way round.
        let first_yaw_rad = self.points[0].yaw_rad;
        let mut work = self.points.map(|p| {
            let yaw_rad = wrap_pi(p.yaw_rad - first_yaw_rad);
            (p.position.push(yaw_rad), nalgebra::Vector4::zeros())
        });
        for level in (1..self.len).rev() {
            for i in 0..level {
                let ((p, p_slope), (q, q_slope)) = (work[i], work[i + 1]);
                work[i] = (
                    p * (1.0 - share) + q * share,
                    q - p + p_slope * (1.0 - share) + q_slope * share,
                );
            }
        }
        let (value, slope) = (work[0].0, work[0].1 / self.duration_s);
        Some(CurveState {
            position: value.xyz(),
            velocity: slope.xyz(),
            yaw_rad: wrap_pi(value.w + first_yaw_rad),
            yaw_rate_radps: slope.w,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn curve(positions: &[Vector3<f64>], yaws: &[f64], duration_s: f64) -> Curve {
        let mut points = [ControlPoint::default(); POINTS_MAX];
        for (point, (position, yaw)) in points.iter_mut().zip(positions.iter().zip(yaws)) {
            *point = ControlPoint {
                position: *position,
                yaw_rad: *yaw,
            };
        }
        Curve {
            points,
            len: positions.len(),
            start_us: 1_000_000,
            duration_s,
        }
    }

    proptest! {
        #[test]
        fn the_value_is_the_bernstein_sum_and_the_velocity_its_slope(
            xs in proptest::array::uniform5(-20.0..20.0f64), share in 0.01..0.99f64, duration in 0.2..5.0f64,
        ) {
            let positions = xs.map(|x| Vector3::new(x, -x, 1.0));
            let curve = curve(&positions, &[0.0; 5], duration);
            let bernstein = |u: f64| {
                let binomial = [1.0, 4.0, 6.0, 4.0, 1.0];
                (0..5).map(|i| binomial[i] * u.powi(i as i32) * (1.0 - u).powi(4 - i as i32) * xs[i]).sum::<f64>()
            };
            let now_us = 1_000_000 + (share * duration * 1e6) as u64;
            let exact = curve.age_s(now_us) / duration;
            let state = curve.at(now_us).unwrap();
            prop_assert!((state.position.x - bernstein(exact)).abs() < 1e-9);
            let h = 1e-6;
            let slope = (bernstein(exact + h) - bernstein(exact - h)) / (2.0 * h * duration);
            prop_assert!((state.velocity.x - slope).abs() < 1e-4);
        }
    }

    #[test]
    fn two_points_are_a_straight_line_and_headings_take_the_short_way() {
        let curve = curve(
            &[Vector3::zeros(), Vector3::new(4.0, 0.0, 0.0)],
            &[3.0, -3.0],
            2.0,
        );
        let state = curve.at(2_000_000).unwrap();
        assert!((state.position.x - 2.0).abs() < 1e-12);
        assert!((state.velocity.x - 2.0).abs() < 1e-12);
        assert!(state.yaw_rad.abs() > 3.1);
        assert!((state.yaw_rate_radps - (std::f64::consts::TAU - 6.0) / 2.0).abs() < 1e-9);
    }

    #[test]
    fn outside_its_time_or_without_points_a_curve_says_nothing() {
        let good = curve(&[Vector3::zeros(); 3], &[0.0; 3], 1.0);
        assert!(good.at(999_999).is_none());
        assert!(good.at(1_000_000).is_some() && good.at(2_000_000).is_some());
        assert!(good.at(2_000_001).is_none());
        assert!(Curve { len: 0, ..good }.at(1_500_000).is_none());
        assert!(
            Curve {
                duration_s: f64::NAN,
                ..good
            }
            .at(1_500_000)
            .is_none()
        );
    }
}
