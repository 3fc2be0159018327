//! Position mode: sticks command a velocity, released sticks hold the place.
//!
//! Horizontal and vertical velocities follow the sticks through the same jerk-limited trajectories as automatic modes,
//! with the larger limits of manual flight; their positions are what the controller holds on to.

use super::parameters::{Parameter as P, Parameters};
use super::setpoint::{MotionSetpoint, SpeedCaps};
use super::smoothing::{Axis, AxisLimits};
use crate::vehicle::estimator::Estimate;
use mavlink::dialects::ardupilotmega::MANUAL_CONTROL_DATA;
use nalgebra::{Rotation2, Vector2, Vector3};

/// Deflection that counts as none.
const DEAD_ZONE: f64 = 0.1;
/// Climb demand that counts as the wish to take off, share of full stick.
const TAKEOFF_STICK: f64 = 0.15;

/// Stick deflections, -1 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sticks {
    /// Forward.
    pub forward: f64,
    /// Right.
    pub right: f64,
    /// Up.
    pub up: f64,
    /// Turn clockwise.
    pub turn: f64,
}

impl Sticks {
    /// From MANUAL_CONTROL: 1000 is full deflection; throttle rests at 500.
    pub fn from_message(message: &MANUAL_CONTROL_DATA) -> Self {
        let stick = |value: f64| {
            let value = value.clamp(-1.0, 1.0);
            if value.abs() < DEAD_ZONE { 0.0 } else { value }
        };
        Self {
            forward: stick(f64::from(message.x) / 1_000.0),
            right: stick(f64::from(message.y) / 1_000.0),
            up: stick(f64::from(message.z) / 500.0 - 1.0),
            turn: stick(f64::from(message.r) / 1_000.0),
        }
    }

    /// Whether they ask the vehicle to leave the ground.
    pub fn want_takeoff(&self) -> bool {
        self.up > TAKEOFF_STICK
    }
}

/// Position mode's memory.
#[derive(Clone, Debug, Default)]
pub struct PositionTask {
    axes: [Axis; 3],
    yaw_rad: f64,
}

impl PositionTask {
    /// Takes over from the vehicle's present motion.
    pub fn activate(&mut self, estimate: &Estimate) {
        let (position, velocity) = (estimate.position.vector(), estimate.velocity.vector());
        for (i, axis) in self.axes.iter_mut().enumerate() {
            axis.reset(position[i], velocity[i], 0.0);
        }
        self.yaw_rad = estimate.attitude.yaw_rad();
    }

    /// The estimate jumped: the trajectory continues from the new position.
    pub fn position_reset(&mut self, estimate: &Estimate) {
        let position = estimate.position.vector();
        for (i, axis) in self.axes.iter_mut().enumerate() {
            axis.position_m = position[i];
        }
    }

    /// One cycle.
    pub fn step(
        &mut self,
        sticks: &Sticks,
        estimate: &Estimate,
        parameters: &Parameters,
        dt_s: f64,
    ) -> (MotionSetpoint, SpeedCaps) {
        let get = |p| parameters.get(p);
        let yaw_now_rad = estimate.attitude.yaw_rad();
        let mut stick = Vector2::new(sticks.forward, sticks.right);
        if stick.norm() > 1.0 {
            stick.normalize_mut();
        }
        let level = Rotation2::new(yaw_now_rad) * stick * get(P::MPC_VEL_MANUAL);
        let vertical = if sticks.up > 0.0 {
            -sticks.up * get(P::MPC_Z_VEL_MAX_UP)
        } else {
            -sticks.up * get(P::MPC_Z_VEL_MAX_DN)
        };
        let limits = |speed: P, acceleration: P| AxisLimits {
            speed_mps: get(speed),
            acceleration_mps2: get(acceleration),
            jerk_mps3: get(P::MPC_JERK_MAX),
        };
        let horizontal = limits(P::MPC_XY_VEL_MAX, P::MPC_ACC_HOR_MAX);
        let upright = limits(P::MPC_Z_VEL_MAX_UP, P::MPC_ACC_UP_MAX);
        for axis in &mut self.axes {
            axis.advance(dt_s);
        }
        self.axes[0].plan(level.x, &horizontal);
        self.axes[1].plan(level.y, &horizontal);
        self.axes[2].plan(vertical, &upright);

        let turning = sticks.turn != 0.0;
        if turning {
            self.yaw_rad = yaw_now_rad;
        }
        let along = |pick: fn(&Axis) -> f64| Vector3::from_fn(|i, _| pick(&self.axes[i]));
        let setpoint = MotionSetpoint {
            position: along(|a| a.position_m),
            velocity: along(|a| a.velocity_mps),
            acceleration: along(|a| a.acceleration_mps2),
            yaw_rad: if turning { f64::NAN } else { self.yaw_rad },
            yaw_rate_radps: sticks.turn * parameters.radians(P::MPC_MAN_Y_MAX),
        };
        let caps = SpeedCaps {
            horizontal_mps: get(P::MPC_XY_VEL_MAX),
            up_mps: get(P::MPC_Z_VEL_MAX_UP),
            down_mps: get(P::MPC_Z_VEL_MAX_DN),
        };
        (setpoint, caps)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicle::estimator::{Estimator, EstimatorConfig};
    use crate::vehicle::{Vehicle, VehicleConfig};

    fn fly(sticks: Sticks, seconds: f64, task: &mut PositionTask, estimate: &Estimate) -> MotionSetpoint {
        let parameters = Parameters::default();
        let mut setpoint = MotionSetpoint::unset();
        for _ in 0..(seconds / 0.008) as usize {
            setpoint = task.step(&sticks, estimate, &parameters, 0.008).0;
        }
        setpoint
    }

    #[test]
    fn sticks_command_a_velocity_in_the_direction_of_the_heading_and_released_ones_a_stop() {
        let config = VehicleConfig {
            heading_rad: std::f64::consts::FRAC_PI_2,
            ..VehicleConfig::default()
        };
        let vehicle = Vehicle::new(&config);
        let estimate = Estimator::new(&EstimatorConfig::default(), vehicle.truth()).step(vehicle.truth());
        let mut task = PositionTask::default();
        task.activate(&estimate);
        let forward = Sticks {
            forward: 0.5,
            up: 1.0,
            ..Sticks::default()
        };
        let moving = fly(forward, 6.0, &mut task, &estimate);
        assert!((moving.velocity - Vector3::new(0.0, 5.0, -3.0)).norm() < 0.01);
        assert!((moving.yaw_rad - std::f64::consts::FRAC_PI_2).abs() < 1e-9);
        let stopped = fly(Sticks::default(), 6.0, &mut task, &estimate);
        assert!(stopped.velocity.norm() < 0.01 && stopped.position.y > 20.0);
    }

    #[test]
    fn small_deflections_are_none_and_throttle_rests_in_the_middle() {
        let message = MANUAL_CONTROL_DATA {
            x: 1_000,
            y: -80,
            z: 500,
            r: -500,
            ..MANUAL_CONTROL_DATA::default()
        };
        let sticks = Sticks::from_message(&message);
        assert_eq!(
            (sticks.forward, sticks.right, sticks.up, sticks.turn),
            (1.0, 0.0, 0.0, -0.5)
        );
        assert!(!sticks.want_takeoff());
    }
}
