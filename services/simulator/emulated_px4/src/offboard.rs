//! OFFBOARD: setpoints of SET_POSITION_TARGET_LOCAL_NED go to the controller as they are, without smoothing.
//!
//! Frames LOCAL_NED and BODY_NED (velocity and acceleration turned by the heading, position dropped). NaN means "not
//! given", as a bit of the mask does. What cannot be used does not keep OFFBOARD alive.

// MAV_FRAME_BODY_NED is deprecated, and the only body frame PX4 takes here.
#![allow(deprecated)]

use super::setpoint::{MotionSetpoint, unset};
use mavlink::dialect::{MavFrame, PositionTargetTypemask as Mask, SET_POSITION_TARGET_LOCAL_NED_DATA};
use nalgebra::{Rotation2, Vector3};

/// Why a setpoint is not used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BadSetpoint {
    /// The frame with this number is neither of the two.
    Frame(u8),
    /// It gives nothing.
    Empty,
}

impl std::fmt::Display for BadSetpoint {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Frame(frame) => write!(f, "coordinate frame {frame} unsupported"),
            Self::Empty => write!(f, "SET_POSITION_TARGET_LOCAL_NED invalid"),
        }
    }
}
impl std::error::Error for BadSetpoint {}

/// The last setpoint of the stream.
#[derive(Clone, Debug)]
pub struct Offboard {
    setpoint: MotionSetpoint,
    received_us: Option<u64>,
}

impl Default for Offboard {
    fn default() -> Self {
        Self {
            setpoint: MotionSetpoint::unset(),
            received_us: None,
        }
    }
}

impl Offboard {
    /// Takes a message.
    ///
    /// # Errors
    /// Why it is not used.
    pub fn receive(
        &mut self,
        now_us: u64,
        yaw_rad: f64,
        message: &SET_POSITION_TARGET_LOCAL_NED_DATA,
    ) -> Result<(), BadSetpoint> {
        self.setpoint = setpoint_of(message, yaw_rad)?;
        self.received_us = Some(now_us);
        Ok(())
    }

    /// Whether the stream is younger than `timeout_s`.
    pub fn is_alive(&self, now_us: u64, timeout_s: f64) -> bool {
        self.received_us
            .is_some_and(|at_us| (now_us - at_us) as f64 * 1e-6 <= timeout_s)
    }

    /// The last setpoint.
    pub fn setpoint(&self) -> &MotionSetpoint {
        &self.setpoint
    }

    /// Whether it lies above, or leads upwards from, down coordinate `down_m`.
    pub fn wants_takeoff(&self, down_m: f64) -> bool {
        let Self { setpoint, .. } = self;
        setpoint.position.z < down_m || setpoint.velocity.z < 0.0 || setpoint.acceleration.z < 0.0
    }
}

fn setpoint_of(
    message: &SET_POSITION_TARGET_LOCAL_NED_DATA,
    yaw_rad: f64,
) -> Result<MotionSetpoint, BadSetpoint> {
    let mask = message.type_mask;
    let pick = |ignored: Mask, value: f32| {
        if mask.contains(ignored) {
            f64::NAN
        } else {
            f64::from(value)
        }
    };
    let vector = |flags: [Mask; 3], values: [f32; 3]| Vector3::from_fn(|i, _| pick(flags[i], values[i]));
    let mut setpoint = MotionSetpoint {
        position: vector(
            [
                Mask::POSITION_TARGET_TYPEMASK_X_IGNORE,
                Mask::POSITION_TARGET_TYPEMASK_Y_IGNORE,
                Mask::POSITION_TARGET_TYPEMASK_Z_IGNORE,
            ],
            [message.x, message.y, message.z],
        ),
        velocity: vector(
            [
                Mask::POSITION_TARGET_TYPEMASK_VX_IGNORE,
                Mask::POSITION_TARGET_TYPEMASK_VY_IGNORE,
                Mask::POSITION_TARGET_TYPEMASK_VZ_IGNORE,
            ],
            [message.vx, message.vy, message.vz],
        ),
        acceleration: vector(
            [
                Mask::POSITION_TARGET_TYPEMASK_AX_IGNORE,
                Mask::POSITION_TARGET_TYPEMASK_AY_IGNORE,
                Mask::POSITION_TARGET_TYPEMASK_AZ_IGNORE,
            ],
            [message.afx, message.afy, message.afz],
        ),
        yaw_rad: pick(Mask::POSITION_TARGET_TYPEMASK_YAW_IGNORE, message.yaw),
        yaw_rate_radps: pick(Mask::POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE, message.yaw_rate),
    };
    match message.coordinate_frame {
        MavFrame::MAV_FRAME_LOCAL_NED => {}
        MavFrame::MAV_FRAME_BODY_NED => {
            let turn = Rotation2::new(yaw_rad);
            setpoint.position = unset();
            for v in [&mut setpoint.velocity, &mut setpoint.acceleration] {
                let xy = turn * v.xy();
                *v = Vector3::new(xy.x, xy.y, v.z);
            }
        }
        other => return Err(BadSetpoint::Frame(other as u8)),
    }
    let given = [&setpoint.position, &setpoint.velocity, &setpoint.acceleration];
    if given.iter().all(|v| v.iter().all(|c| !c.is_finite())) {
        return Err(BadSetpoint::Empty);
    }
    Ok(setpoint)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message() -> SET_POSITION_TARGET_LOCAL_NED_DATA {
        SET_POSITION_TARGET_LOCAL_NED_DATA {
            x: 1.0,
            vx: 2.0,
            afx: 3.0,
            yaw: 0.5,
            coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
            ..SET_POSITION_TARGET_LOCAL_NED_DATA::default()
        }
    }

    #[test]
    fn ignored_fields_are_not_given() {
        let mut offboard = Offboard::default();
        let mut message = message();
        message.type_mask =
            Mask::POSITION_TARGET_TYPEMASK_X_IGNORE | Mask::POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE;
        assert_eq!(offboard.receive(1_000_000, 0.0, &message), Ok(()));
        let setpoint = offboard.setpoint();
        assert!(setpoint.position.x.is_nan() && setpoint.yaw_rate_radps.is_nan());
        assert_eq!(
            (setpoint.velocity.x, setpoint.acceleration.x, setpoint.yaw_rad),
            (2.0, 3.0, 0.5)
        );
        assert!(offboard.is_alive(1_900_000, 1.0) && !offboard.is_alive(2_100_000, 1.0));
    }

    #[test]
    fn body_frame_turns_with_the_heading_and_other_frames_are_refused() {
        let mut offboard = Offboard::default();
        let mut message = message();
        message.coordinate_frame = MavFrame::MAV_FRAME_BODY_NED;
        assert_eq!(offboard.receive(0, std::f64::consts::FRAC_PI_2, &message), Ok(()));
        assert!((offboard.setpoint().velocity - Vector3::new(0.0, 2.0, 0.0)).norm() < 1e-9);
        assert!(offboard.setpoint().position.x.is_nan());
        message.coordinate_frame = MavFrame::MAV_FRAME_BODY_OFFSET_NED;
        assert_eq!(offboard.receive(0, 0.0, &message), Err(BadSetpoint::Frame(9)));
        message.coordinate_frame = MavFrame::MAV_FRAME_LOCAL_NED;
        message.type_mask = Mask::all();
        assert_eq!(offboard.receive(0, 0.0, &message), Err(BadSetpoint::Empty));
    }
}
