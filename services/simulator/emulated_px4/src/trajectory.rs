//! From a setpoint to a smooth motion: velocity target, jerk limits, and a clock that waits for the vehicle.
//!
//! A position setpoint yields a velocity target: the direction to it times the speed from which PX4 can stop there
//! ([`speed_rules`]); a velocity given with it is added; a velocity alone is the target. The target is reached through
//! one jerk-limited trajectory per axis ([`smoothing`](super::smoothing)), whose clock slows down with the distance the
//! vehicle has fallen behind.

use super::avoidance::is_modified;
use super::parameters::{Parameter as P, Parameters};
use super::setpoint::{MotionSetpoint, PointKind};
use super::smoothing::{Axis, AxisLimits, synchronise};
use super::speed_rules::{self, SpeedLimits};
use super::track::Track;
use jink_simulated_world::vehicle::estimator::Estimate;
use nalgebra::{Vector2, Vector3};

/// Cosine of the angle between motion and target below which PX4 calls it a turn (11.5 degrees).
const TURN_COSINE: f64 = 0.98;
/// Below this speed nothing turns (m/s).
const TURN_SPEED_MIN_MPS: f64 = 0.2;
/// Look-ahead of the guidance onto the leg during a turn (m).
const LOOK_AHEAD_MIN_M: f64 = 5.0;
/// Speeds below this are clamped without scaling the other axes (m/s).
const CLAMP_ACCURACY_MPS: f64 = 0.5;

/// What the trajectory is to do in a cycle.
pub struct Aim<'a> {
    /// Position and velocity wanted: the flight task's own or the companion's.
    pub setpoint: &'a MotionSetpoint,
    /// The flight task's own target, and what comes after it.
    pub track: &'a Track,
    /// Purpose of the current waypoint.
    pub kind: PointKind,
    /// Cruise speed (m/s).
    pub cruise_mps: f64,
    /// Where the vehicle is.
    pub vehicle: Vector3<f64>,
    /// Its height above home (m).
    pub height_m: f64,
    /// Parameters in force.
    pub parameters: &'a Parameters,
}

/// The trajectory of the three axes.
#[derive(Clone, Debug, Default)]
pub struct SmoothTrajectory {
    axes: [Axis; 3],
    climbing: bool,
    speed_before_turn_mps: f64,
}

impl SmoothTrajectory {
    /// Takes over from whatever flew before: its setpoint where given, the vehicle's state elsewhere.
    pub fn take_over(&mut self, last: &MotionSetpoint, estimate: &Estimate) {
        let (position, velocity) = (estimate.position.vector(), estimate.velocity.vector());
        let or = |given: f64, own: f64| if given.is_finite() { given } else { own };
        for (i, axis) in self.axes.iter_mut().enumerate() {
            let x = or(last.position[i], position[i]);
            let v = or(last.velocity[i], velocity[i]);
            axis.reset(x, v, or(last.acceleration[i], 0.0));
        }
    }

    /// Starts from the vehicle's position with this velocity.
    pub fn start(&mut self, position: &Vector3<f64>, velocity: &Vector3<f64>) {
        for (i, axis) in self.axes.iter_mut().enumerate() {
            axis.reset(position[i], velocity[i], 0.0);
        }
    }

    /// Continues from another position with the same motion.
    pub fn relocate(&mut self, position: &Vector3<f64>) {
        for (i, axis) in self.axes.iter_mut().enumerate() {
            axis.position_m = position[i];
        }
    }

    fn along(&self, pick: fn(&Axis) -> f64) -> Vector3<f64> {
        Vector3::from_fn(|i, _| pick(&self.axes[i]))
    }

    /// The velocity the trajectory should take.
    pub fn velocity_target(&mut self, aim: &Aim) -> Vector3<f64> {
        let here = self.along(|a| a.position_m);
        let wanted = aim.setpoint.position;
        let mut by_position = super::setpoint::unset();
        if wanted.x.is_finite() && wanted.y.is_finite() {
            let turning = self.is_turning(&here, aim.track);
            let mut speed_mps = horizontal_speed_mps(&here, aim);
            if turning {
                speed_mps = speed_mps.min(self.speed_before_turn_mps);
            } else {
                self.speed_before_turn_mps = speed_mps;
            }
            let to_point = crossing_point(&here, turning, aim) - here;
            if wanted.z.is_finite() {
                let climb_mps = self.vertical_speed_mps(&here, aim);
                by_position =
                    to_point.try_normalize(f64::EPSILON).unwrap_or_default() * speed_mps.hypot(climb_mps);
                clamp_horizontal(&mut by_position, speed_mps);
                clamp_vertical(&mut by_position, climb_mps);
            } else {
                let level = to_point.xy().try_normalize(f64::EPSILON).unwrap_or_default() * speed_mps;
                by_position = Vector3::new(level.x, level.y, f64::NAN);
            }
        } else if wanted.z.is_finite() {
            by_position.z = (wanted.z - here.z).signum() * self.vertical_speed_mps(&here, aim);
        }
        by_position.zip_map(&aim.setpoint.velocity, |own, given| {
            match (own.is_finite(), given.is_finite()) {
                (true, true) => own + given,
                (true, false) => own,
                _ => given,
            }
        })
    }

    /// Moves on by `dt_s` and then turns towards `target`. Returns position, velocity and acceleration, and the climb speed
    /// allowed from now on (m/s).
    pub fn follow(&mut self, target: &Vector3<f64>, aim: &Aim, dt_s: f64) -> ([Vector3<f64>; 3], f64) {
        let stretched_s = dt_s * self.time_stretch(&aim.vehicle, aim.parameters.get(P::MPC_XY_ERR_MAX));
        for axis in &mut self.axes {
            axis.advance(stretched_s);
        }
        let motion = [
            self.along(|a| a.position_m),
            self.along(|a| a.velocity_mps),
            self.along(|a| a.acceleration_mps2),
        ];
        self.climbing = target.z < 0.0;
        let vertical = self.vertical_limits(aim);
        let horizontal = AxisLimits {
            speed_mps: aim.parameters.get(P::MPC_XY_VEL_MAX),
            acceleration_mps2: aim.parameters.get(P::MPC_ACC_HOR),
            jerk_mps3: aim.parameters.get(P::MPC_JERK_AUTO),
        };
        self.axes[0].plan(target.x, &horizontal);
        self.axes[1].plan(target.y, &horizontal);
        self.axes[2].plan(target.z, &vertical);
        synchronise(&mut self.axes);
        let climb_mps = if self.climbing {
            vertical.speed_mps
        } else {
            aim.parameters.get(P::MPC_Z_VEL_MAX_UP)
        };
        (motion, climb_mps)
    }

    /// PX4 judges turns by its own target, also when a companion's is flown.
    fn is_turning(&self, here: &Vector3<f64>, track: &Track) -> bool {
        let velocity = self.along(|a| a.velocity_mps).xy();
        let to_target = (track.target - here).xy();
        let unit = |v: Vector2<f64>| v.try_normalize(f64::EPSILON).unwrap_or_default();
        velocity.norm() > TURN_SPEED_MIN_MPS
            && unit(velocity).dot(&unit(to_target)) < TURN_COSINE
            && to_target.norm() > track.acceptance_m
    }

    fn vertical_speed_mps(&self, here: &Vector3<f64>, aim: &Aim) -> f64 {
        let get = |p| aim.parameters.get(p);
        let distance_m = (aim.setpoint.position.z - here.z).abs();
        let (speed_max_mps, acceleration) = if self.climbing {
            (get(P::MPC_Z_VEL_MAX_UP), get(P::MPC_ACC_UP_MAX))
        } else {
            (get(P::MPC_Z_VEL_MAX_DN), get(P::MPC_ACC_DOWN_MAX))
        };
        speed_rules::before_stop_mps(get(P::MPC_JERK_AUTO), acceleration, distance_m, 0.0).min(speed_max_mps)
    }

    /// How much of the cycle the trajectory moves on: less, the further the vehicle lags behind it.
    fn time_stretch(&self, vehicle: &Vector3<f64>, error_max_m: f64) -> f64 {
        let ahead = (self.along(|a| a.position_m) - vehicle).xy();
        let velocity = self.along(|a| a.velocity_mps).xy();
        if ahead.dot(&velocity) < 0.0 {
            return 1.0;
        }
        1.0 - (ahead.norm() / error_max_m).clamp(0.0, 1.0)
    }

    /// Near the ground a take-off climbs slowly, and its height setpoint is the vehicle's own height.
    fn vertical_limits(&mut self, aim: &Aim) -> AxisLimits {
        let get = |p| aim.parameters.get(p);
        let jerk_mps3 = get(P::MPC_JERK_AUTO);
        if !self.climbing {
            return AxisLimits {
                speed_mps: get(P::MPC_Z_VEL_MAX_DN),
                acceleration_mps2: get(P::MPC_ACC_DOWN_MAX),
                jerk_mps3,
            };
        }
        let mut limits = AxisLimits {
            speed_mps: get(P::MPC_Z_VEL_MAX_UP),
            acceleration_mps2: get(P::MPC_ACC_UP_MAX),
            jerk_mps3,
        };
        if aim.kind == PointKind::Takeoff && aim.height_m < get(P::MPC_LAND_ALT1) {
            limits.speed_mps = get(P::MPC_TKO_SPEED);
            let ramped = get(P::MPC_TKO_SPEED) / get(P::MPC_TKO_RAMP_T);
            limits.acceleration_mps2 = limits.acceleration_mps2.min(ramped);
            self.axes[2].position_m = aim.vehicle.z;
        }
        limits
    }
}

/// A companion's point is a place to stop at; the own target is flown through if the mission goes on.
fn horizontal_speed_mps(here: &Vector3<f64>, aim: &Aim) -> f64 {
    let get = |p| aim.parameters.get(p);
    let limits = SpeedLimits {
        cruise_mps: aim.cruise_mps,
        acceleration_mps2: get(P::MPC_ACC_HOR),
        jerk_mps3: get(P::MPC_JERK_AUTO),
        corner_share: get(P::MPC_XY_TRAJ_P),
        acceptance_m: aim.track.acceptance_m,
        vertical_acceptance_m: get(P::NAV_MC_ALT_RAD),
    };
    let injected = aim.setpoint.position;
    if is_modified(&aim.track.target, &injected) {
        return speed_rules::along_mps(here, &injected, &injected, &limits);
    }
    speed_rules::along_mps(here, &aim.track.target, &aim.track.onward, &limits)
}

/// Where to aim: at a companion's point strictly; in a turn at the leg, a look-ahead further on.
fn crossing_point(here: &Vector3<f64>, turning: bool, aim: &Aim) -> Vector3<f64> {
    let Track { target, from, .. } = *aim.track;
    if is_modified(&target, &aim.setpoint.position) {
        return aim.setpoint.position;
    }
    if !turning {
        return target;
    }
    let along = (target - from)
        .xy()
        .try_normalize(f64::EPSILON)
        .unwrap_or_default();
    let closest = from.xy() + along * (here - from).xy().dot(&along);
    let cross_m = (closest - here.xy()).norm();
    let look_ahead_m = aim.track.acceptance_m.max(LOOK_AHEAD_MIN_M);
    let ahead_m = (look_ahead_m * look_ahead_m - cross_m * cross_m).max(0.0).sqrt();
    let point = closest + along * ahead_m;
    Vector3::new(point.x, point.y, target.z)
}

fn clamp_horizontal(v: &mut Vector3<f64>, max_mps: f64) {
    let norm = v.xy().norm();
    if norm <= max_mps || norm <= f64::EPSILON {
        return;
    }
    let scale = max_mps / norm;
    v.x *= scale;
    v.y *= scale;
    if max_mps >= CLAMP_ACCURACY_MPS || norm >= CLAMP_ACCURACY_MPS {
        v.z *= scale;
    }
}

fn clamp_vertical(v: &mut Vector3<f64>, max_mps: f64) {
    let norm = v.z.abs();
    if norm <= max_mps || norm <= f64::EPSILON {
        return;
    }
    let scale = max_mps / norm;
    v.z *= scale;
    if max_mps >= CLAMP_ACCURACY_MPS || norm >= CLAMP_ACCURACY_MPS {
        v.x *= scale;
        v.y *= scale;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_trajectory_waits_for_a_vehicle_that_lags_and_not_for_one_that_leads() {
        let mut trajectory = SmoothTrajectory::default();
        trajectory.start(&Vector3::new(1.0, 0.0, -5.0), &Vector3::new(2.0, 0.0, 0.0));
        assert_eq!(trajectory.time_stretch(&Vector3::new(0.0, 0.0, -5.0), 2.0), 0.5);
        assert_eq!(trajectory.time_stretch(&Vector3::new(-2.0, 0.0, -5.0), 2.0), 0.0);
        assert_eq!(trajectory.time_stretch(&Vector3::new(2.0, 0.0, -5.0), 2.0), 1.0);
    }

    #[test]
    fn clamping_one_direction_keeps_the_course() {
        let mut v = Vector3::new(3.0, 4.0, 2.0);
        clamp_horizontal(&mut v, 2.5);
        assert_eq!(v, Vector3::new(1.5, 2.0, 1.0));
        clamp_vertical(&mut v, 0.6);
        assert!((v - Vector3::new(0.9, 1.2, 0.6)).norm() < 1e-12);
        let mut slow = Vector3::new(0.1, 0.0, 1.0);
        clamp_horizontal(&mut slow, 0.05);
        assert_eq!(slow, Vector3::new(0.05, 0.0, 1.0));
    }
}
