//! Jerk-limited velocity trajectories, one axis each, synchronised in time: what PX4 puts between a setpoint and the
//! controller in every automatic mode.
//!
//! From acceleration `a0` the velocity is changed by `dv` with jerk `j` towards the goal for `T1`, constant
//! acceleration for `T2`, and jerk `-j` for `T3`, after which the acceleration is zero. With the peak acceleration `a1`,
//!
//! * `T1 = (a1 - a0) / j`, `T3 = a1 / j`, and without a plateau `dv = (2 a1^2 - a0^2) / (2 j)`;
//! * where that asks for more than the limit, `a1` is the limit and `T2` makes up the rest;
//! * given the total time `T`, `T2 = T - T1 - T3` turns `dv` into a quadratic in `T1`.
//!
//! The plan is renewed in every cycle; only its first instant is ever flown.

/// Below this an acceleration counts as zero (m/s^2) (single precision, as PX4 computes).
const EPSILON: f64 = f32::EPSILON as f64;

/// What one axis may do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisLimits {
    /// Speed (m/s).
    pub speed_mps: f64,
    /// Acceleration (m/s^2).
    pub acceleration_mps2: f64,
    /// Jerk (m/s^3).
    pub jerk_mps3: f64,
}

/// The trajectory of one axis.
#[derive(Clone, Copy, Debug, Default)]
pub struct Axis {
    /// Position (m).
    pub position_m: f64,
    /// Velocity (m/s).
    pub velocity_mps: f64,
    /// Acceleration (m/s^2).
    pub acceleration_mps2: f64,
    plan: Plan,
}

/// Jerk and duration of the three phases.
#[derive(Clone, Copy, Debug, Default)]
struct Plan {
    jerk_mps3: f64,
    rise_s: f64,
    hold_s: f64,
    fall_s: f64,
    target_mps: f64,
    acceleration_max_mps2: f64,
}

impl Plan {
    fn duration_s(&self) -> f64 {
        self.rise_s + self.hold_s + self.fall_s
    }
}

impl Axis {
    /// Starts anew from a state, with nothing planned.
    pub fn reset(&mut self, position_m: f64, velocity_mps: f64, acceleration_mps2: f64) {
        *self = Self {
            position_m,
            velocity_mps,
            acceleration_mps2,
            plan: Plan::default(),
        };
    }

    /// Follows the plan for `dt_s`.
    pub fn advance(&mut self, dt_s: f64) {
        let plan = self.plan;
        let phases = [
            (plan.rise_s, plan.jerk_mps3),
            (plan.hold_s, 0.0),
            (plan.fall_s, -plan.jerk_mps3),
        ];
        let mut left_s = dt_s;
        for (duration_s, jerk) in phases {
            let t = left_s.min(duration_s);
            self.move_on(t, jerk);
            left_s -= t;
            if left_s <= 0.0 {
                return;
            }
        }
        self.acceleration_mps2 = 0.0;
        self.move_on(left_s, 0.0);
    }

    fn move_on(&mut self, t: f64, jerk: f64) {
        let (v, a) = (self.velocity_mps, self.acceleration_mps2);
        self.position_m += t * (v + t * (a / 2.0 + t * jerk / 6.0));
        self.velocity_mps += t * (a + t * jerk / 2.0);
        self.acceleration_mps2 += t * jerk;
    }

    /// Plans the quickest way to the velocity `target_mps`.
    pub fn plan(&mut self, target_mps: f64, limits: &AxisLimits) {
        let target_mps = target_mps.clamp(-limits.speed_mps, limits.speed_mps);
        let jerk_mps3 = self.direction(target_mps, limits.jerk_mps3) * limits.jerk_mps3;
        self.plan = Plan {
            jerk_mps3,
            target_mps,
            acceleration_max_mps2: limits.acceleration_mps2,
            ..Plan::default()
        };
        if jerk_mps3.abs() <= EPSILON {
            return;
        }
        let a0 = self.acceleration_mps2;
        let dv = target_mps - self.velocity_mps;
        let peak_squared = jerk_mps3 * dv + a0 * a0 / 2.0;
        let mut rise_s = 0.0;
        if peak_squared >= 0.0 {
            rise_s = (peak_squared.sqrt().copysign(jerk_mps3) - a0) / jerk_mps3;
        }
        self.plan.rise_s = self.limit_rise_s(rise_s.max(0.0)).max(0.0);
        self.plan.fall_s = (a0 / jerk_mps3 + self.plan.rise_s).max(0.0);
        let (t1, t3) = (self.plan.rise_s, self.plan.fall_s);
        let peak = a0 + jerk_mps3 * t1;
        if peak.abs() > EPSILON {
            let dv_rise = t1 * (a0 + jerk_mps3 * t1 / 2.0);
            let dv_fall = t3 * (peak - jerk_mps3 * t3 / 2.0);
            self.plan.hold_s = ((dv - dv_rise - dv_fall) / peak).max(0.0);
        }
    }

    /// Towards which side jerk has to start: it depends on the velocity that is left once the acceleration is
    /// brought back to zero.
    fn direction(&self, target_mps: f64, jerk_max: f64) -> f64 {
        let a0 = self.acceleration_mps2;
        let mut coasting_mps = self.velocity_mps;
        if a0.abs() > EPSILON {
            coasting_mps += a0 * a0.abs() / (2.0 * jerk_max);
        }
        let sign = |x: f64| if x == 0.0 { 0.0 } else { x.signum() };
        match sign(target_mps - coasting_mps) {
            0.0 => sign(a0),
            direction => direction,
        }
    }

    fn limit_rise_s(&self, rise_s: f64) -> f64 {
        let Plan {
            jerk_mps3,
            acceleration_max_mps2: limit,
            ..
        } = self.plan;
        let peak = self.acceleration_mps2 + jerk_mps3 * rise_s;
        if peak.abs() <= limit {
            return rise_s;
        }
        (limit.copysign(peak) - self.acceleration_mps2) / jerk_mps3
    }

    /// Stretches the plan to take `total_s`.
    fn stretch(&mut self, total_s: f64) {
        let j = self.plan.jerk_mps3;
        if j.abs() <= EPSILON {
            return;
        }
        let a0 = self.acceleration_mps2;
        let dv = self.plan.target_mps - self.velocity_mps;
        // -j t^2 + (j T - a0) t + (a0 T - a0^2 / 2j - dv) = 0, both roots held at zero or above.
        let b = j * total_s - a0;
        let discriminant = (j * total_s).powi(2) + 2.0 * total_s * a0 * j - a0 * a0 - 4.0 * j * dv;
        let mut rise_s = 0.0;
        if discriminant >= 0.0 {
            let root = discriminant.sqrt();
            let fits = |t: f64| {
                let fall_s = a0 / j + t;
                fall_s >= 0.0 && t + fall_s <= total_s
            };
            let first = ((b - root) / (2.0 * j)).max(0.0);
            let second = ((b + root) / (2.0 * j)).max(0.0);
            if fits(first) {
                rise_s = first;
            } else if fits(second) {
                rise_s = second;
            }
            rise_s = self.limit_rise_s(rise_s);
        }
        self.plan.rise_s = rise_s;
        self.plan.fall_s = (a0 / j + rise_s).max(0.0);
        self.plan.hold_s = (total_s - rise_s - self.plan.fall_s).max(0.0);
    }
}

/// Makes all axes arrive together: the slowest keeps its plan, the others take as long.
pub fn synchronise(axes: &mut [Axis; 3]) {
    let mut longest = 0;
    for i in 1..axes.len() {
        if axes[i].plan.duration_s() > axes[longest].plan.duration_s() {
            longest = i;
        }
    }
    let total_s = axes[longest].plan.duration_s();
    if total_s <= EPSILON {
        return;
    }
    for (i, axis) in axes.iter_mut().enumerate() {
        if i != longest && axis.plan.duration_s() < total_s {
            axis.stretch(total_s);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMITS: AxisLimits = AxisLimits {
        speed_mps: 12.0,
        acceleration_mps2: 3.0,
        jerk_mps3: 4.0,
    };
    const DT_S: f64 = 0.008;

    fn axis(velocity_mps: f64, acceleration_mps2: f64) -> Axis {
        let mut axis = Axis::default();
        axis.reset(0.0, velocity_mps, acceleration_mps2);
        axis
    }

    proptest! {
        #[test]
        fn the_target_is_reached_within_acceleration_and_jerk(v0 in -6.0..6.0f64, a0 in -3.0..3.0f64, target in -12.0..12.0f64) {
            let mut axis = axis(v0, a0);
            let mut before = a0;
            for _ in 0..1_500 {
                axis.plan(target, &LIMITS);
                axis.advance(DT_S);
                prop_assert!(axis.acceleration_mps2.abs() <= LIMITS.acceleration_mps2 + 1e-9);
                prop_assert!((axis.acceleration_mps2 - before).abs() <= LIMITS.jerk_mps3 * DT_S + 1e-9);
                before = axis.acceleration_mps2;
            }
            prop_assert!((axis.velocity_mps - target).abs() < 1e-6);
            prop_assert!(axis.acceleration_mps2.abs() < 1e-6);
        }

        #[test]
        fn renewing_the_plan_changes_nothing(v0 in -6.0..6.0f64, a0 in -3.0..3.0f64, target in -12.0..12.0f64) {
            let mut once = axis(v0, a0);
            once.plan(target, &LIMITS);
            let mut often = once;
            for _ in 0..60 {
                often.plan(target, &LIMITS);
                often.advance(DT_S);
            }
            once.advance(60.0 * DT_S);
            prop_assert!((once.position_m - often.position_m).abs() < 1e-4);
            prop_assert!((once.velocity_mps - often.velocity_mps).abs() < 1e-4);
        }

        #[test]
        fn synchronised_axes_from_rest_arrive_together(x in -6.0..6.0f64, y in -6.0..6.0f64, z in -3.0..3.0f64) {
            let mut axes = [axis(0.0, 0.0); 3];
            for (axis, target) in axes.iter_mut().zip([x, y, z]) {
                axis.plan(target, &LIMITS);
            }
            let total = axes.iter().map(|a| a.plan.duration_s()).fold(0.0, f64::max);
            synchronise(&mut axes);
            for (axis, target) in axes.iter_mut().zip([x, y, z]) {
                prop_assert!((axis.plan.duration_s() - total).abs() < 1e-9);
                axis.advance(total);
                prop_assert!((axis.velocity_mps - target).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn a_velocity_step_to_cruise_takes_the_time_the_limits_allow() {
        // 5 m/s with 3 m/s^2 and 4 m/s^3: 5/3 s of acceleration and 3/4 s of ramps.
        let mut axis = axis(0.0, 0.0);
        axis.plan(5.0, &LIMITS);
        assert!((axis.plan.duration_s() - (5.0 / 3.0 + 0.75)).abs() < 1e-9);
    }
}
