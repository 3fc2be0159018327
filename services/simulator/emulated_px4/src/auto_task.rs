//! The flight task of all automatic modes: waypoints become a smooth setpoint, through the companion if there is one.
//!
//! | in | out |
//! |---|---|
//! | triplet of waypoints, estimate | position, velocity, acceleration, heading for the controller |
//! | the companion's data ([`AvoidanceConsumer`]) | what it is asked about ([`DesiredPoints`]), demands for Hold |
//!
//! In each cycle: target and heading from the waypoints, the companion's setpoint instead of the own one where there is
//! a companion, and a smooth motion towards it ([`SmoothTrajectory`]).

use super::avoidance::{AvoidanceConsumer, HoldCause};
use super::heading::Heading;
use super::parameters::{Parameter as P, Parameters};
use super::setpoint::{CurrentPoint, MotionSetpoint, PointKind, SpeedCaps, Triplet, is_finite, unset};
use super::track::Track;
use super::trajectory::{Aim, SmoothTrajectory};
use jink_shared_types::vehicle::NavMode;
use jink_simulated_world::vehicle::estimator::Estimate;
use nalgebra::Vector3;

/// Climb demand that counts as the wish to take off (m/s).
const TAKEOFF_DEMAND_MPS: f64 = 0.3;
/// Speed with which the trajectory waits on the ground, downwards (m/s): the climb then starts softly.
const GROUND_SINK_MPS: f64 = 0.7;

/// What the task needs in a cycle.
pub struct AutoInput<'a> {
    /// Boot time (us).
    pub now_us: u64,
    /// Since the last cycle (s).
    pub dt_s: f64,
    /// Mode in force.
    pub mode: NavMode,
    /// Where the vehicle believes to be.
    pub estimate: &'a Estimate,
    /// Where it is to go.
    pub triplet: &'a Triplet,
    /// Height above home (m).
    pub height_m: f64,
    /// Parameters in force.
    pub parameters: &'a Parameters,
}

/// What the task wants.
#[derive(Clone, Copy, Debug)]
pub struct AutoOutput {
    /// For the controller.
    pub setpoint: MotionSetpoint,
    /// For the controller.
    pub caps: SpeedCaps,
    /// It wants to leave the ground.
    pub want_takeoff: bool,
    /// The companion failed: the mode must become Hold.
    pub hold: Option<HoldCause>,
}

/// What a companion is asked about: the three points of TRAJECTORY_REPRESENTATION_WAYPOINTS.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DesiredPoints {
    /// Boot time of the question (us); 0 without a waypoint.
    pub time_us: u64,
    /// The setpoint of this cycle.
    pub setpoint: (Vector3<f64>, Vector3<f64>),
    /// Purpose of the current waypoint.
    pub kind: PointKind,
    /// Current waypoint with heading and heading rate.
    pub current: Option<(Vector3<f64>, f64, f64)>,
    /// Next waypoint with heading.
    pub next: Option<(Vector3<f64>, f64)>,
}

/// The task's memory.
#[derive(Clone, Debug)]
pub struct AutoTask {
    trajectory: SmoothTrajectory,
    track: Track,
    heading: Heading,
    setpoint: MotionSetpoint,
    kind: PointKind,
    kind_before: PointKind,
    cruise_mps: f64,
    desired: DesiredPoints,
}

impl AutoTask {
    /// A task that has not run yet.
    pub fn new() -> Self {
        Self {
            trajectory: SmoothTrajectory::default(),
            track: Track::default(),
            heading: Heading::default(),
            setpoint: MotionSetpoint::unset(),
            kind: PointKind::Idle,
            kind_before: PointKind::Idle,
            cruise_mps: 0.0,
            desired: DesiredPoints {
                time_us: 0,
                setpoint: (unset(), unset()),
                kind: PointKind::Idle,
                current: None,
                next: None,
            },
        }
    }

    /// Takes over from whatever flew before: its last setpoint where given, the vehicle's state elsewhere.
    pub fn activate(&mut self, last: &MotionSetpoint, estimate: &Estimate) {
        self.trajectory.take_over(last, estimate);
        let yaw_rad = estimate.attitude.yaw_rad();
        self.heading.reset(if last.yaw_rad.is_finite() {
            last.yaw_rad
        } else {
            yaw_rad
        });
        self.setpoint.yaw_rad = yaw_rad;
        self.setpoint.yaw_rate_radps = 0.0;
    }

    /// Before flight the trajectory stays with the vehicle; it starts sinking slightly so that the ramp is soft.
    pub fn wait_on_ground(&mut self, estimate: &Estimate) {
        self.activate(&MotionSetpoint::unset(), estimate);
        let sink = Vector3::new(0.0, 0.0, GROUND_SINK_MPS);
        self.trajectory.start(&estimate.position.vector(), &sink);
    }

    /// The estimate jumped: the trajectory continues from the new position.
    pub fn position_reset(&mut self, estimate: &Estimate) {
        self.trajectory.relocate(&estimate.position.vector());
    }

    /// What the companion was asked in the last cycle.
    pub fn desired(&self) -> &DesiredPoints {
        &self.desired
    }

    /// One cycle.
    pub fn step(&mut self, input: &AutoInput, avoidance: &mut AvoidanceConsumer) -> AutoOutput {
        let position = input.estimate.position.vector();
        let mut caps = default_caps(input.parameters);
        self.follow_triplet(input, &position, caps.horizontal_mps);
        let mut hold = None;
        if self.kind_before == PointKind::Idle {
            self.setpoint.acceleration = unset();
        }
        self.prepare(input, caps.down_mps);
        if input.parameters.avoidance_enabled() {
            self.desired.setpoint = (self.setpoint.position, self.setpoint.velocity);
            hold = avoidance.inject(input.now_us, input.mode, &position, &mut self.setpoint);
        }
        let want_takeoff = self.generate(input, &position, &mut caps);
        if !self.setpoint.yaw_rad.is_finite() && !self.setpoint.yaw_rate_radps.is_finite() {
            let to_target = (self.track.target - position).xy();
            self.setpoint.yaw_rad = self.heading.along(self.setpoint.velocity.xy(), to_target);
        }
        (self.setpoint.yaw_rad, self.setpoint.yaw_rate_radps) = self.heading.limit(
            self.setpoint.yaw_rad,
            self.setpoint.yaw_rate_radps,
            input.parameters,
            input.dt_s,
        );
        self.kind_before = self.kind;
        AutoOutput {
            setpoint: self.setpoint,
            caps,
            want_takeoff,
            hold,
        }
    }

    /// Takes target, kind, speed and heading from the triplet, and writes down what the companion is asked.
    fn follow_triplet(&mut self, input: &AutoInput, position: &Vector3<f64>, default_cruise_mps: f64) {
        let yaw_now_rad = input.estimate.attitude.yaw_rad();
        let Some(current) = input.triplet.current else {
            self.track.stay(position);
            self.kind = PointKind::Loiter;
            self.setpoint.yaw_rad = yaw_now_rad;
            self.setpoint.yaw_rate_radps = f64::NAN;
            self.ask(input, None);
            return;
        };
        self.kind = current.kind;
        let speed_max_mps = input.parameters.get(P::MPC_XY_VEL_MAX);
        self.cruise_mps = if current.cruise_mps >= 0.0 {
            current.cruise_mps.min(speed_max_mps)
        } else {
            default_cruise_mps.min(speed_max_mps)
        };
        if self.track.update(input.triplet, &current, position) {
            self.heading.unlock();
        }
        self.ask(input, Some(current));
        let own_heading = current.kind != PointKind::Takeoff && current.yaw_rad.is_finite();
        self.setpoint.yaw_rad = if own_heading {
            current.yaw_rad
        } else {
            let to_target = (self.track.target - position).xy();
            self.heading.towards(
                to_target,
                self.track.acceptance_m,
                self.setpoint.yaw_rad,
                yaw_now_rad,
            )
        };
        self.setpoint.yaw_rate_radps = f64::NAN;
    }

    fn ask(&mut self, input: &AutoInput, current: Option<CurrentPoint>) {
        let given = current.is_some();
        self.desired.time_us = if given { input.now_us } else { 0 };
        self.desired.kind = self.kind;
        self.desired.current = given.then(|| {
            let yaw = (self.setpoint.yaw_rad, self.setpoint.yaw_rate_radps);
            (self.track.waypoint(), yaw.0, yaw.1)
        });
        let next_yaw_rad = input.triplet.next.map_or(f64::NAN, |n| n.yaw_rad);
        self.desired.next = given.then(|| (self.track.next_waypoint(), next_yaw_rad));
    }

    /// The setpoint by the waypoint's kind.
    fn prepare(&mut self, input: &AutoInput, descent_mps: f64) {
        match self.kind {
            PointKind::Idle => {
                let idle = MotionSetpoint::idle();
                self.setpoint.position = idle.position;
                self.setpoint.velocity = idle.velocity;
                self.setpoint.acceleration = idle.acceleration;
            }
            PointKind::Land => {
                let place = self.track.waypoint();
                self.setpoint.position = Vector3::new(place.x, place.y, f64::NAN);
                let speed_mps = landing_speed_mps(input.height_m, descent_mps, input.parameters);
                self.setpoint.velocity = Vector3::new(f64::NAN, f64::NAN, speed_mps);
            }
            PointKind::Position | PointKind::Loiter | PointKind::Takeoff => {
                self.setpoint.position = self.track.target;
                self.setpoint.velocity = unset();
            }
        }
    }

    /// From the setpoint to the trajectory's. Returns whether it wants to leave the ground.
    fn generate(&mut self, input: &AutoInput, position: &Vector3<f64>, caps: &mut SpeedCaps) -> bool {
        let aim = Aim {
            setpoint: &self.setpoint,
            track: &self.track,
            kind: self.kind,
            cruise_mps: self.cruise_mps,
            vehicle: *position,
            height_m: input.height_m,
            parameters: input.parameters,
        };
        let target = self.trajectory.velocity_target(&aim);
        // With an axis that nobody commands the setpoint goes to the controller as it is.
        if is_finite(&target) {
            let (motion, climb_mps) = self.trajectory.follow(&target, &aim, input.dt_s);
            [
                self.setpoint.position,
                self.setpoint.velocity,
                self.setpoint.acceleration,
            ] = motion;
            caps.up_mps = climb_mps;
        }
        target.z < -TAKEOFF_DEMAND_MPS
    }
}

fn default_caps(parameters: &Parameters) -> SpeedCaps {
    SpeedCaps {
        // In automatic modes the controller itself is held to cruise speed, whatever the trajectory asks.
        horizontal_mps: parameters
            .get(P::MPC_XY_VEL_MAX)
            .min(parameters.get(P::MPC_XY_CRUISE)),
        up_mps: parameters.get(P::MPC_Z_VEL_MAX_UP),
        down_mps: parameters.get(P::MPC_Z_VEL_MAX_DN),
    }
}

/// Full descent speed high up, landing speed near the ground, linear between.
fn landing_speed_mps(height_m: f64, full_mps: f64, parameters: &Parameters) -> f64 {
    let slow_mps = parameters.get(P::MPC_LAND_SPEED);
    let low_m = parameters.get(P::MPC_LAND_ALT2);
    let high_m = parameters.get(P::MPC_LAND_ALT1).max(low_m + f64::EPSILON);
    let share = ((height_m - low_m) / (high_m - low_m)).clamp(0.0, 1.0);
    slow_mps + share * (full_mps - slow_mps)
}

impl Default for AutoTask {
    fn default() -> Self {
        Self::new()
    }
}
