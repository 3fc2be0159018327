//! Position mode: sticks command a motion, released sticks hold the place.
//!
//! | firmware | horizontal | vertical |
//! |---|---|---|
//! | PX4 of 2021 | a velocity, through the jerk-limited trajectories of automatic modes with the limits of manual flight | the same |
//! | current PX4 | an acceleration against drag, see `stick_acceleration`; collision prevention may change it | as before |
//!
//! The trajectories' positions are what the controller holds on to. The PX4 of 2021 has no collision prevention here,
//! whatever CP_DIST says: in the mode it flies by default (MPC_POS_MODE 4) it was seen to ignore it and to fly through
//! the wall. It had one in MPC_POS_MODE 3, another one, of 36 bins; MPC_POS_MODE does not exist in the emulator.

use super::firmware::Firmware;
use super::parameters::{Parameter as P, Parameters};
use super::setpoint::{MotionSetpoint, SpeedCaps};
use super::smoothing::{Axis, AxisLimits};
use super::stick_acceleration::{StickAcceleration, StickInput};
use jink_simulated_world::vehicle::estimator::Estimate;
use mavlink::dialect::MANUAL_CONTROL_DATA;
use nalgebra::{Rotation2, Vector2, Vector3};

/// Deflection that counts as none.
const DEAD_ZONE: f64 = 0.1;
/// Share of the cube in the curve between a stick and what it asks for, in current PX4.
const EXPONENTIAL: f64 = 0.6;
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
        let stick = |value: f64| value.clamp(-1.0, 1.0);
        Self {
            forward: stick(f64::from(message.x) / 1_000.0),
            right: stick(f64::from(message.y) / 1_000.0),
            up: stick(f64::from(message.z) / 500.0 - 1.0),
            turn: stick(f64::from(message.r) / 1_000.0),
        }
    }

    fn each(&self, change: impl Fn(f64) -> f64) -> Self {
        Self {
            forward: change(self.forward),
            right: change(self.right),
            up: change(self.up),
            turn: change(self.turn),
        }
    }

    /// Nothing where they are hardly deflected.
    fn cut(&self) -> Self {
        self.each(|value| if value.abs() < DEAD_ZONE { 0.0 } else { value })
    }

    /// Along current PX4's curve: nothing within `dead_zone`, from there on a mixture of the deflection and its cube.
    fn curved(&self, dead_zone: f64) -> Self {
        self.each(|value| {
            let beyond = ((value.abs() - dead_zone) / (1.0 - dead_zone)).clamp(0.0, 1.0);
            let asked = (1.0 - EXPONENTIAL) * beyond + EXPONENTIAL * beyond.powi(3);
            if beyond > 0.0 { asked.copysign(value) } else { 0.0 }
        })
    }

    /// Whether they ask the vehicle to leave the ground.
    pub fn want_takeoff(&self) -> bool {
        self.up > TAKEOFF_STICK
    }
}

/// What a cycle is flown from.
#[derive(Clone, Copy, Debug)]
pub struct PositionInput<'a> {
    /// Duration of the cycle (s).
    pub dt_s: f64,
    /// Sticks as they are.
    pub sticks: &'a Sticks,
    /// Where the vehicle is, and how it moves.
    pub estimate: &'a Estimate,
    /// Parameters.
    pub parameters: &'a Parameters,
    /// The horizontal velocity that the controller followed in the last cycle (m/s).
    pub followed_mps: Vector2<f64>,
    /// Tilt limit (rad).
    pub tilt_limit_rad: f64,
}

/// Position mode's memory.
#[derive(Clone, Debug, Default)]
pub struct PositionTask {
    axes: [Axis; 3],
    yaw_rad: f64,
    /// Where the firmware flies it so.
    by_acceleration: Option<StickAcceleration>,
}

impl PositionTask {
    /// As `firmware` flies it.
    pub fn new(firmware: Firmware) -> Self {
        Self {
            by_acceleration: firmware
                .flies_sticks_by_acceleration()
                .then(StickAcceleration::default),
            ..Self::default()
        }
    }

    /// Takes over: from the vehicle's present motion, and horizontally, where sticks are accelerations, from the last
    /// setpoint if it gave one.
    pub fn activate(&mut self, last: &MotionSetpoint, estimate: &Estimate) {
        let (position, velocity) = (estimate.position.vector(), estimate.velocity.vector());
        for (i, axis) in self.axes.iter_mut().enumerate() {
            axis.reset(position[i], velocity[i], 0.0);
        }
        self.yaw_rad = estimate.attitude.yaw_rad();
        if let Some(sticks) = &mut self.by_acceleration {
            let given = last.velocity.xy();
            let from = if given.iter().all(|v| v.is_finite()) {
                given
            } else {
                velocity.xy()
            };
            sticks.take_over(from, last.acceleration.xy());
        }
    }

    /// The estimate jumped: the trajectory continues from the new position.
    pub fn position_reset(&mut self, estimate: &Estimate) {
        let position = estimate.position.vector();
        for (i, axis) in self.axes.iter_mut().enumerate() {
            axis.position_m = position[i];
        }
        if let Some(sticks) = &mut self.by_acceleration {
            sticks.position_reset();
        }
    }

    /// One cycle. `prevent`: see [`StickAcceleration::step`]; not asked where sticks are velocities.
    pub fn step(
        &mut self,
        input: &PositionInput,
        prevent: impl FnOnce(Vector2<f64>, Vector2<f64>) -> Vector2<f64>,
    ) -> (MotionSetpoint, SpeedCaps) {
        let get = |p| input.parameters.get(p);
        let sticks = if self.by_acceleration.is_some() {
            input.sticks.curved(get(P::MAN_DEADZONE))
        } else {
            input.sticks.cut()
        };
        let yaw_now_rad = input.estimate.attitude.yaw_rad();
        let turning = sticks.turn != 0.0;
        if turning {
            self.yaw_rad = yaw_now_rad;
        }
        let mut stick = Vector2::new(sticks.forward, sticks.right);
        if stick.norm() > 1.0 {
            stick.normalize_mut();
        }
        let mut setpoint = MotionSetpoint {
            yaw_rad: if turning { f64::NAN } else { self.yaw_rad },
            yaw_rate_radps: sticks.turn * input.parameters.radians(P::MPC_MAN_Y_MAX),
            ..self.follow_axes(&(Rotation2::new(yaw_now_rad) * stick), sticks.up, input)
        };
        if let Some(horizontal) = &mut self.by_acceleration {
            let by_stick = StickInput {
                stick: Rotation2::new(self.yaw_rad) * stick,
                position: input.estimate.position.vector().xy(),
                followed_mps: input.followed_mps,
                tilt_limit_rad: input.tilt_limit_rad,
                dt_s: input.dt_s,
            };
            horizontal.step(&by_stick, input.parameters, prevent);
            let held = horizontal.held.unwrap_or(Vector2::repeat(f64::NAN));
            setpoint.position.fixed_rows_mut::<2>(0).copy_from(&held);
            setpoint
                .velocity
                .fixed_rows_mut::<2>(0)
                .copy_from(&horizontal.velocity);
            setpoint
                .acceleration
                .fixed_rows_mut::<2>(0)
                .copy_from(&horizontal.acceleration);
        }
        let caps = SpeedCaps {
            horizontal_mps: get(P::MPC_XY_VEL_MAX),
            up_mps: get(P::MPC_Z_VEL_MAX_UP),
            down_mps: get(P::MPC_Z_VEL_MAX_DN),
        };
        (setpoint, caps)
    }

    /// The jerk-limited trajectories towards the velocities that the sticks ask for.
    fn follow_axes(&mut self, stick: &Vector2<f64>, up: f64, input: &PositionInput) -> MotionSetpoint {
        let get = |p| input.parameters.get(p);
        let level = stick * get(P::MPC_VEL_MANUAL);
        let vertical = if up > 0.0 {
            -up * get(P::MPC_Z_VEL_MAX_UP)
        } else {
            -up * get(P::MPC_Z_VEL_MAX_DN)
        };
        let limits = |speed: P, acceleration: P| AxisLimits {
            speed_mps: get(speed),
            acceleration_mps2: get(acceleration),
            jerk_mps3: get(P::MPC_JERK_MAX),
        };
        let horizontal = limits(P::MPC_XY_VEL_MAX, P::MPC_ACC_HOR_MAX);
        let upright = limits(P::MPC_Z_VEL_MAX_UP, P::MPC_ACC_UP_MAX);
        for axis in &mut self.axes {
            axis.advance(input.dt_s);
        }
        self.axes[0].plan(level.x, &horizontal);
        self.axes[1].plan(level.y, &horizontal);
        self.axes[2].plan(vertical, &upright);
        let along = |pick: fn(&Axis) -> f64| Vector3::from_fn(|i, _| pick(&self.axes[i]));
        MotionSetpoint {
            position: along(|a| a.position_m),
            velocity: along(|a| a.velocity_mps),
            acceleration: along(|a| a.acceleration_mps2),
            ..MotionSetpoint::unset()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use jink_simulated_world::vehicle::estimator::{Estimator, EstimatorConfig};
    use jink_simulated_world::vehicle::{Vehicle, VehicleConfig};

    fn fly(sticks: Sticks, seconds: f64, task: &mut PositionTask, estimate: &Estimate) -> MotionSetpoint {
        let parameters = Parameters::default();
        let mut setpoint = MotionSetpoint::unset();
        let input = PositionInput {
            dt_s: 0.008,
            sticks: &sticks,
            estimate,
            parameters: &parameters,
            followed_mps: Vector2::zeros(),
            tilt_limit_rad: 0.7,
        };
        for _ in 0..(seconds / 0.008) as usize {
            setpoint = task.step(&input, |wanted, _| wanted).0;
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
        task.activate(&MotionSetpoint::unset(), &estimate);
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
        let sticks = Sticks::from_message(&message).cut();
        assert_eq!(
            (sticks.forward, sticks.right, sticks.up, sticks.turn),
            (1.0, 0.0, 0.0, -0.5)
        );
        assert!(!sticks.want_takeoff());
    }

    #[test]
    fn a_stick_of_current_px4_asks_for_nothing_in_the_dead_zone_and_for_everything_at_its_end() {
        let asked = |forward| {
            let sticks = Sticks {
                forward,
                ..Sticks::default()
            };
            sticks.curved(0.1).forward
        };
        assert_eq!([0.05, 1.0, -1.0].map(asked), [0.0, 1.0, -1.0]);
        assert!((asked(0.5) - 0.230).abs() < 0.001);
    }
}
