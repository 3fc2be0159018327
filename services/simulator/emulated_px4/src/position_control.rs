//! Position and velocity control: a motion setpoint becomes an attitude and a thrust.
//!
//! * position: `v_sp = K_p (p_sp - p) + v_ff`, limited horizontally so that the position's part comes first;
//! * velocity: `a_sp = P (v_sp - v) + I - D v' + a_ff`, with `v'` the filtered derivative of the estimate;
//! * acceleration: body z along `(a_x, a_y, -g)`, tilt limited, thrust so that the vertical part is right;
//! * saturation: vertical thrust before horizontal except for a margin, and an integrator that unwinds by what the
//!   saturation took (anti-reset windup, L. Rundqwist 1990).
//!
//! Structure and gains are those of PX4 1.12; thrust is in its normalised unit. The controller believes in a hover thrust
//! ([`BELIEVED_HOVER_THRUST`]) that is nearly right; the integral makes up the rest, as long as there is a velocity
//! setpoint.

use super::parameters::{Parameter as P, Parameters};
use super::setpoint::{MotionSetpoint, SpeedCaps, is_finite};
use jink_emulated_autopilot::attitude::attitude_for;
use jink_simulated_world::vehicle::estimator::Estimate;
use jink_simulated_world::vehicle::{ActuatorCommand, GRAVITY_MPS2, HOVER_THRUST};
use nalgebra::{Vector2, Vector3};

/// One percent less than the truth: PX4 was seen to sink with nearly 0.1 m/s^2 when nothing commands its vertical axis.
const BELIEVED_HOVER_THRUST: f64 = 0.99 * HOVER_THRUST;
/// Smallest thrust that still has a direction.
const THRUST_FLOOR: f64 = 10e-4;

/// What is allowed in this cycle.
#[derive(Clone, Copy, Debug)]
pub struct ControlLimits {
    /// Speeds; upwards may be negative during the take-off ramp.
    pub speed: SpeedCaps,
    /// Tilt (rad).
    pub tilt_rad: f64,
    /// Smallest thrust.
    pub thrust_min: f64,
}

/// The controller's memory.
#[derive(Clone, Debug)]
pub struct PositionController {
    integral: Vector3<f64>,
    derivative: Vector3<f64>,
    last_velocity: Option<Vector3<f64>>,
    followed: MotionSetpoint,
    thrust: Vector3<f64>,
}

impl Default for PositionController {
    fn default() -> Self {
        Self {
            integral: Vector3::zeros(),
            derivative: Vector3::zeros(),
            last_velocity: None,
            followed: MotionSetpoint::unset(),
            thrust: Vector3::zeros(),
        }
    }
}

impl PositionController {
    /// Forgets the integral: on the ground it would only wind up.
    pub fn reset_integral(&mut self) {
        self.integral = Vector3::zeros();
    }

    /// The setpoints as followed: velocity with the position's part and limits, acceleration as demanded.
    pub fn followed(&self) -> &MotionSetpoint {
        &self.followed
    }

    /// One cycle of `dt_s`. `None` if the setpoint leaves an axis without anything to follow.
    pub fn step(
        &mut self,
        setpoint: &MotionSetpoint,
        estimate: &Estimate,
        limits: &ControlLimits,
        parameters: &Parameters,
        dt_s: f64,
    ) -> Option<ActuatorCommand> {
        let position = estimate.position.vector();
        let velocity = estimate.velocity.vector();
        self.differentiate(&velocity, parameters.get(P::MPC_VELD_LP), dt_s);
        if !is_followable(setpoint) {
            return None;
        }
        let mut followed = *setpoint;
        followed.velocity = velocity_setpoint(setpoint, &position, &limits.speed, parameters);
        let gains = Gains::new(parameters);
        let error = followed.velocity - velocity;
        let feedback =
            error.component_mul(&gains.p) + self.integral - self.derivative.component_mul(&gains.d);
        followed.acceleration = add_given(&setpoint.acceleration, &feedback);
        if !is_finite(&followed.acceleration) {
            return None;
        }
        let wanted = thrust_vector(&followed.acceleration, limits);
        let thrust_max = parameters.get(P::MPC_THR_MAX);
        self.thrust = saturate(wanted, thrust_max, parameters.get(P::MPC_THR_XY_MARG));
        self.integrate(error, &followed, &wanted, limits, thrust_max, &gains, dt_s);

        let yaw_rad = if followed.yaw_rad.is_finite() {
            followed.yaw_rad
        } else {
            estimate.attitude.yaw_rad()
        };
        if !followed.yaw_rate_radps.is_finite() {
            followed.yaw_rate_radps = 0.0;
        }
        followed.yaw_rad = yaw_rad;
        self.followed = followed;
        Some(ActuatorCommand {
            attitude: attitude_for(&self.thrust, yaw_rad),
            yaw_rate_radps: followed.yaw_rate_radps,
            thrust: self.thrust.norm(),
        })
    }

    /// First-order low-pass of the difference quotient.
    fn differentiate(&mut self, velocity: &Vector3<f64>, cutoff_hz: f64, dt_s: f64) {
        if let Some(last) = self.last_velocity {
            let b = std::f64::consts::TAU * cutoff_hz * dt_s;
            let share = b / (1.0 + b);
            self.derivative += ((velocity - last) / dt_s - self.derivative) * share;
        }
        self.last_velocity = Some(*velocity);
    }

    #[allow(clippy::too_many_arguments)]
    fn integrate(
        &mut self,
        mut error: Vector3<f64>,
        followed: &MotionSetpoint,
        wanted: &Vector3<f64>,
        limits: &ControlLimits,
        thrust_max: f64,
        gains: &Gains,
        dt_s: f64,
    ) {
        let too_weak = wanted.z >= -limits.thrust_min.max(THRUST_FLOOR) && error.z >= 0.0;
        let too_strong = wanted.z <= -thrust_max && error.z <= 0.0;
        if too_weak || too_strong {
            error.z = 0.0;
        }
        let produced = self.thrust.xy() * (GRAVITY_MPS2 / BELIEVED_HOVER_THRUST);
        let asked = followed.acceleration.xy();
        if asked.norm_squared() > produced.norm_squared() {
            let unwind = (asked - produced) * (2.0 / gains.p.x);
            error.x -= unwind.x;
            error.y -= unwind.y;
        }
        error.apply(|e| {
            if !e.is_finite() {
                *e = 0.0;
            }
        });
        self.integral += error.component_mul(&gains.i) * dt_s;
        self.integral.z = self.integral.z.clamp(-GRAVITY_MPS2, GRAVITY_MPS2);
    }
}

struct Gains {
    p: Vector3<f64>,
    i: Vector3<f64>,
    d: Vector3<f64>,
}

impl Gains {
    fn new(parameters: &Parameters) -> Self {
        let axes = |xy: P, z: P| {
            let (xy, z) = (parameters.get(xy), parameters.get(z));
            Vector3::new(xy, xy, z)
        };
        Self {
            p: axes(P::MPC_XY_VEL_P_ACC, P::MPC_Z_VEL_P_ACC),
            i: axes(P::MPC_XY_VEL_I_ACC, P::MPC_Z_VEL_I_ACC),
            d: axes(P::MPC_XY_VEL_D_ACC, P::MPC_Z_VEL_D_ACC),
        }
    }
}

/// Every axis needs something, and north and east come in pairs.
fn is_followable(setpoint: &MotionSetpoint) -> bool {
    let kinds = [&setpoint.position, &setpoint.velocity, &setpoint.acceleration];
    let every_axis = (0..3).all(|axis| kinds.iter().any(|v| v[axis].is_finite()));
    every_axis && kinds.iter().all(|v| v.x.is_finite() == v.y.is_finite())
}

fn velocity_setpoint(
    setpoint: &MotionSetpoint,
    position: &Vector3<f64>,
    caps: &SpeedCaps,
    parameters: &Parameters,
) -> Vector3<f64> {
    let (xy, z) = (parameters.get(P::MPC_XY_P), parameters.get(P::MPC_Z_P));
    let by_position = (setpoint.position - position).component_mul(&Vector3::new(xy, xy, z));
    let wanted = add_given(&setpoint.velocity, &by_position);
    let by_position = by_position.map(|c| if c.is_finite() { c } else { 0.0 });
    let horizontal = limit_keeping_first(by_position.xy(), (wanted - by_position).xy(), caps.horizontal_mps);
    // Not `clamp`: during the take-off ramp the lower bound lies above the upper one, and the lower one holds.
    let vertical = if wanted.z < -caps.up_mps {
        -caps.up_mps
    } else {
        wanted.z.min(caps.down_mps)
    };
    let vertical = if wanted.z.is_finite() { vertical } else { wanted.z };
    Vector3::new(horizontal.x, horizontal.y, vertical)
}

/// `first + second`, shortened to `limit` by taking from `second` first.
fn limit_keeping_first(first: Vector2<f64>, second: Vector2<f64>, limit: f64) -> Vector2<f64> {
    let sum = first + second;
    let norm = sum.norm();
    if norm <= limit || norm.is_nan() {
        return sum;
    }
    let Some(direction) = second.try_normalize(0.001) else {
        return first.normalize() * limit;
    };
    if first.norm() >= limit {
        return first.normalize() * limit;
    }
    // |first + s direction| = limit, the positive root.
    let along = direction.dot(&first);
    let s = -along + (along * along - first.norm_squared() + limit * limit).sqrt();
    first + direction * s
}

/// The sum where both are given, the given one where only one is.
fn add_given(a: &Vector3<f64>, b: &Vector3<f64>) -> Vector3<f64> {
    a.zip_map(b, |a, b| match (a.is_finite(), b.is_finite()) {
        (true, true) => a + b,
        (false, true) => b,
        _ => a,
    })
}

fn thrust_vector(acceleration: &Vector3<f64>, limits: &ControlLimits) -> Vector3<f64> {
    let wanted_z = Vector3::new(-acceleration.x, -acceleration.y, GRAVITY_MPS2).normalize();
    let body_z = limit_tilt(&wanted_z, limits.tilt_rad);
    let vertical = acceleration.z * (BELIEVED_HOVER_THRUST / GRAVITY_MPS2) - BELIEVED_HOVER_THRUST;
    body_z * (vertical / body_z.z).min(-limits.thrust_min.max(THRUST_FLOOR))
}

fn limit_tilt(body_z: &Vector3<f64>, limit_rad: f64) -> Vector3<f64> {
    let tilt_rad = body_z.z.clamp(-1.0, 1.0).acos();
    match body_z.xy().try_normalize(f64::EPSILON) {
        Some(side) if tilt_rad > limit_rad => {
            let (sine, cosine) = limit_rad.sin_cos();
            Vector3::new(side.x * sine, side.y * sine, cosine)
        }
        _ => *body_z,
    }
}

fn saturate(wanted: Vector3<f64>, max: f64, horizontal_margin: f64) -> Vector3<f64> {
    let horizontal = wanted.xy().norm();
    let reserved = horizontal.min(horizontal_margin);
    let z = wanted.z.max(-(max * max - reserved * reserved).max(0.0).sqrt());
    let left = (max * max - z * z).max(0.0).sqrt();
    if horizontal > left {
        let xy = wanted.xy() * (left / horizontal);
        return Vector3::new(xy.x, xy.y, z);
    }
    Vector3::new(wanted.x, wanted.y, z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::setpoint::unset;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_limit_holds_and_takes_from_the_feed_forward_first(
            ax in -6.0..6.0f64, ay in -6.0..6.0f64, bx in -6.0..6.0f64, by in -6.0..6.0f64,
        ) {
            let (first, second) = (Vector2::new(ax, ay), Vector2::new(bx, by));
            let limited = limit_keeping_first(first, second, 5.0);
            prop_assert!(limited.norm() <= 5.0 + 1e-9);
            if (first + second).norm() <= 5.0 {
                prop_assert_eq!(limited, first + second);
            } else if first.norm() < 5.0 && second.norm() > 0.01 {
                // What was taken, was taken along the feed-forward.
                let taken = limited - first;
                prop_assert!(taken.perp(&second).abs() < 1e-9);
            }
        }

        #[test]
        fn thrust_never_exceeds_the_maximum_and_keeps_the_margin(x in -3.0..3.0f64, y in -3.0..3.0f64, z in -3.0..-0.1f64) {
            let thrust = saturate(Vector3::new(x, y, z), 1.0, 0.3);
            prop_assert!(thrust.norm() <= 1.0 + 1e-9);
            let wanted = x.hypot(y);
            prop_assert!(thrust.xy().norm() >= wanted.min(0.3) - 1e-9);
        }
    }

    #[test]
    fn an_axis_without_anything_to_follow_is_refused() {
        let mut setpoint = MotionSetpoint::unset();
        assert!(!is_followable(&setpoint));
        setpoint.velocity = Vector3::zeros();
        assert!(is_followable(&setpoint));
        setpoint.velocity = unset();
        setpoint.position = Vector3::new(0.0, f64::NAN, 0.0);
        assert!(!is_followable(&setpoint));
        assert!(is_followable(&MotionSetpoint::idle()));
    }
}
