//! GUIDED: what the last setpoint asks for, until it is too old.
//!
//! A setpoint starts its own submode; within it, targets are **extrapolated** in every step (`p += v dt`, `v += a dt`). After
//! GUID_TIMEOUT without a new one velocity and acceleration become zero and the position freezes where the extrapolation has
//! brought it, up to 13.5 m ahead at 4.5 m/s and the default of 3 s: the vehicle overshoots it and flies back. The mode stays,
//! nothing is said.

use super::auto_yaw::AutoYaw;
use super::avoid::Avoid;
use super::parameters::{Parameter as P, Parameters};
use super::position_control::{Limits, Motion, PositionControl};
use super::proximity::Proximity;
use super::setpoint::{Request, acceleration_bits, position_bits, velocity_bits, yaw_bits};
use super::takeoff::{Takeoff, TakeoffStep};
use jink_simulated_world::vehicle::estimator::Estimate;
use mavlink::dialect::PositionTargetTypemask as Mask;
use nalgebra::Vector3;

/// What is followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Submode {
    /// NAV_TAKEOFF.
    TakeOff,
    /// A position alone.
    Place,
    /// Position and velocity, perhaps acceleration.
    Motion,
    /// Velocity, perhaps acceleration. Also: nothing, stop.
    Velocity,
    /// Acceleration alone.
    Acceleration,
}

impl Submode {
    /// `type_mask` with which POSITION_TARGET_LOCAL_NED reports it: the only sign that a setpoint was not taken.
    pub fn mask(self) -> Mask {
        yaw_bits()
            | match self {
                Submode::Motion => Mask::empty(),
                Submode::TakeOff | Submode::Place => velocity_bits() | acceleration_bits(),
                Submode::Velocity => position_bits(),
                Submode::Acceleration => position_bits() | velocity_bits(),
            }
    }
}

/// What a step of GUIDED leads to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GuidedStep {
    /// Motors idle on the ground.
    Idle,
    /// The reference is to be followed.
    Fly,
}

/// What a step looks at.
#[derive(Clone, Copy, Debug)]
pub struct GuidedInput<'a> {
    /// Time since boot (us).
    pub now_us: u64,
    /// Standing on the ground.
    pub landed: bool,
    /// Where the vehicle is.
    pub estimate: &'a Estimate,
    /// Values in force.
    pub parameters: &'a Parameters,
    /// What is known of obstacles.
    pub proximity: &'a Proximity,
}

/// The mode's state.
#[derive(Clone, Debug)]
pub struct Guided {
    submode: Submode,
    target: Motion,
    updated_us: u64,
    paused: bool,
    takeoff: Takeoff,
    /// The height of the take-off is reached; its submode stays until something else is asked for.
    has_climbed: bool,
}

impl Default for Guided {
    fn default() -> Self {
        Self {
            submode: Submode::Velocity,
            target: Motion::default(),
            updated_us: 0,
            paused: false,
            takeoff: Takeoff::default(),
            has_climbed: false,
        }
    }
}

impl Guided {
    /// Enters the mode, or "stop": the controller starts anew and brings the vehicle to rest.
    pub fn enter(
        &mut self,
        now_us: u64,
        estimate: &Estimate,
        parameters: &Parameters,
        control: &mut PositionControl,
        yaw: &mut AutoYaw,
    ) {
        *self = Self {
            updated_us: now_us,
            ..Self::default()
        };
        control.start(estimate, Limits::automatic(parameters));
        yaw.hold(estimate.attitude.yaw_rad());
        yaw.set_default(parameters);
    }

    /// Takes a setpoint.
    pub fn receive(
        &mut self,
        request: &Request,
        now_us: u64,
        estimate: &Estimate,
        parameters: &Parameters,
        control: &mut PositionControl,
        yaw: &mut AutoYaw,
    ) {
        let (submode, target, heading) = match *request {
            Request::Stop => return self.enter(now_us, estimate, parameters, control, yaw),
            Request::Motion(motion, heading) => (Submode::Motion, motion, heading),
            Request::Velocity(motion, heading) => (Submode::Velocity, motion, heading),
            Request::Acceleration(motion, heading) => (Submode::Acceleration, motion, heading),
            Request::Place(place, heading) => (Submode::Place, Motion::at(place), heading),
        };
        if self.submode != submode {
            control.start(estimate, Limits::automatic(parameters));
            yaw.hold(estimate.attitude.yaw_rad());
            self.submode = submode;
        }
        yaw.request(heading, parameters);
        self.target = target;
        self.updated_us = now_us;
    }

    /// NAV_TAKEOFF to the down coordinate `down_m`.
    pub fn take_off(&mut self, now_us: u64, down_m: f64, estimate: &Estimate, yaw: &mut AutoYaw) {
        self.submode = Submode::TakeOff;
        self.target = Motion::at(estimate.position.vector());
        self.target.position.z = down_m;
        self.takeoff.begin(now_us, down_m);
        self.has_climbed = false;
        yaw.hold(estimate.attitude.yaw_rad());
    }

    /// DO_PAUSE_CONTINUE.
    pub fn pause(&mut self, paused: bool) {
        self.paused = paused;
    }

    /// Climbing after NAV_TAKEOFF.
    pub fn is_taking_off(&self) -> bool {
        self.submode == Submode::TakeOff && !self.has_climbed
    }

    /// What is followed.
    pub fn submode(&self) -> Submode {
        self.submode
    }

    /// The target as extrapolated, with only what the submode reports. A take-off reports a position of zeros.
    pub fn target(&self) -> Motion {
        let t = self.target;
        match self.submode {
            Submode::Motion => t,
            Submode::TakeOff => Motion::default(),
            Submode::Place => Motion::at(t.position),
            Submode::Velocity => Motion {
                position: Vector3::zeros(),
                ..t
            },
            Submode::Acceleration => Motion {
                acceleration: t.acceleration,
                ..Motion::default()
            },
        }
    }

    /// Moves the reference on by a step.
    pub fn step(
        &mut self,
        input: &GuidedInput<'_>,
        control: &mut PositionControl,
        yaw: &mut AutoYaw,
        avoid: &mut Avoid,
    ) -> GuidedStep {
        if self.is_taking_off() {
            return self.climb(input, control);
        }
        if input.landed {
            return GuidedStep::Idle;
        }
        if self.paused {
            control.follow_velocity(Vector3::zeros().xy(), Vector3::zeros().xy());
            control.follow_sink(0.0, 0.0);
            return GuidedStep::Fly;
        }
        let age_s = (input.now_us - self.updated_us) as f64 * 1e-6;
        if age_s > input.parameters.get(P::GUID_TIMEOUT) {
            self.target.velocity = Vector3::zeros();
            self.target.acceleration = Vector3::zeros();
            yaw.time_out();
        }
        match self.submode {
            Submode::Place | Submode::TakeOff => control.follow_place(self.target.position),
            Submode::Motion => {
                control.follow(&self.target);
                control.follow_height(&self.target);
                self.target.extrapolate();
            }
            Submode::Velocity => self.follow_velocity(input, control, avoid),
            Submode::Acceleration => {
                control.follow_acceleration(self.target.acceleration.xy());
                control.follow_sink_acceleration(self.target.acceleration.z);
            }
        }
        GuidedStep::Fly
    }

    /// Only a velocity is kept away from obstacles; it stays reduced until the next message.
    fn follow_velocity(&mut self, input: &GuidedInput<'_>, control: &mut PositionControl, avoid: &mut Avoid) {
        let level = avoid.limit_velocity(
            self.target.velocity.xy(),
            control.limits.horizontal.acceleration_mps2,
            input.estimate,
            input.proximity,
            input.parameters,
        );
        (self.target.velocity.x, self.target.velocity.y) = (level.x, level.y);
        let Motion {
            velocity,
            acceleration,
            ..
        } = self.target;
        control.follow_velocity(velocity.xy(), acceleration.xy());
        control.follow_sink(velocity.z, acceleration.z);
        self.target.extrapolate();
    }

    fn climb(&mut self, input: &GuidedInput<'_>, control: &mut PositionControl) -> GuidedStep {
        match self
            .takeoff
            .step(input.now_us, input.estimate, input.parameters, control)
        {
            TakeoffStep::Wait => return GuidedStep::Idle,
            TakeoffStep::Climb => {}
            TakeoffStep::Done => {
                self.has_climbed = true;
                self.updated_us = input.now_us;
            }
        }
        GuidedStep::Fly
    }
}
