//! SET_POSITION_TARGET_LOCAL_NED and _GLOBAL_INT as ArduCopter reads them.
//!
//! * Any ignore bit of a group (position, velocity, acceleration) ignores the whole group.
//! * What remains decides: position and velocity (with or without acceleration), velocity (with or without acceleration),
//!   acceleration, position. Anything else, an unknown frame, or the force bit with an acceleration is "stop".
//! * A velocity that is not finite is "stop". **Anything else that is not finite in a group that counts ends the autopilot's
//!   process** with a floating point exception: [`NotFinite`].

// Frames 8 and 9 are deprecated, and what ArduCopter understands.
#![allow(deprecated)]

use super::position_control::Motion;
use jink_simulated_world::vehicle::estimator::Estimate;
use mavlink::dialect::{MavFrame, PositionTargetTypemask as Mask, SET_POSITION_TARGET_LOCAL_NED_DATA};
use nalgebra::{Rotation2, Vector3};

/// What a message asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Request {
    /// Not understood: stop, with the controller started anew.
    Stop,
    /// Position and velocity, perhaps acceleration.
    Motion(Motion, YawRequest),
    /// Velocity, perhaps acceleration; the position is void.
    Velocity(Motion, YawRequest),
    /// Acceleration alone.
    Acceleration(Motion, YawRequest),
    /// Position alone.
    Place(Vector3<f64>, YawRequest),
}

/// The heading it asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum YawRequest {
    /// As WP_YAW_BEHAVIOR says.
    Default,
    /// Turned by this from what is held now (rad).
    Relative(f64),
    /// This (rad), turning on at this rate (rad/s).
    Angle(f64, f64),
    /// Turning at this rate (rad/s).
    Rate(f64),
}

/// A number that ends the process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotFinite {
    /// Which group it is in.
    pub group: &'static str,
}

/// Reads a message for a vehicle at `estimate`.
///
/// # Errors
/// [`NotFinite`] where the real autopilot's process ends.
pub fn read(message: &SET_POSITION_TARGET_LOCAL_NED_DATA, estimate: &Estimate) -> Result<Request, NotFinite> {
    let mask = message.type_mask;
    let Some(frame) = Frame::of(message.coordinate_frame) else {
        return Ok(Request::Stop);
    };
    let has = |group: Mask| !mask.intersects(group);
    let (position, velocity, acceleration) = (
        has(position_bits()),
        has(velocity_bits()),
        has(acceleration_bits()),
    );
    if mask.contains(Mask::POSITION_TARGET_TYPEMASK_FORCE_SET) && acceleration {
        return Ok(Request::Stop);
    }
    let given = |given: bool, xyz: [f32; 3]| {
        if given {
            Vector3::from(xyz.map(f64::from))
        } else {
            Vector3::zeros()
        }
    };
    let mut motion = Motion {
        position: given(position, [message.x, message.y, message.z]),
        velocity: given(velocity, [message.vx, message.vy, message.vz]),
        acceleration: given(acceleration, [message.afx, message.afy, message.afz]),
    };
    if !is_finite(&motion.velocity) {
        return Ok(Request::Stop);
    }
    let kind = match (position, velocity, acceleration) {
        (true, true, _) => Request::Motion,
        (false, true, _) => Request::Velocity,
        (false, false, true) => Request::Acceleration,
        (true, false, false) => |motion: Motion, yaw| Request::Place(motion.position, yaw),
        (true, false, true) | (false, false, false) => return Ok(Request::Stop),
    };
    let yaw = read_yaw(message, frame.is_body);
    check(&motion, &yaw)?;
    frame.apply(&mut motion, position, estimate);
    Ok(kind(motion, yaw))
}

/// How a frame differs from local NED.
#[derive(Clone, Copy)]
struct Frame {
    /// Axes of the vehicle.
    is_body: bool,
    /// Positions from the vehicle.
    is_offset: bool,
}

impl Frame {
    fn of(frame: MavFrame) -> Option<Self> {
        let (is_body, is_offset) = match frame {
            MavFrame::MAV_FRAME_LOCAL_NED => (false, false),
            MavFrame::MAV_FRAME_LOCAL_OFFSET_NED => (false, true),
            MavFrame::MAV_FRAME_BODY_NED | MavFrame::MAV_FRAME_BODY_OFFSET_NED => (true, true),
            _ => return None,
        };
        Some(Self { is_body, is_offset })
    }

    fn apply(self, motion: &mut Motion, has_position: bool, estimate: &Estimate) {
        if self.is_body {
            let turn = Rotation2::new(estimate.attitude.yaw_rad());
            for v in [
                &mut motion.position,
                &mut motion.velocity,
                &mut motion.acceleration,
            ] {
                let level = turn * v.xy();
                *v = Vector3::new(level.x, level.y, v.z);
            }
        }
        if self.is_offset && has_position {
            motion.position += estimate.position.vector();
        }
    }
}

fn read_yaw(message: &SET_POSITION_TARGET_LOCAL_NED_DATA, is_body: bool) -> YawRequest {
    let mask = message.type_mask;
    let angle = !mask.contains(Mask::POSITION_TARGET_TYPEMASK_YAW_IGNORE);
    let rate = !mask.contains(Mask::POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE);
    let (yaw_rad, rate_radps) = (f64::from(message.yaw), f64::from(message.yaw_rate));
    match (angle, rate) {
        (true, _) if is_body => YawRequest::Relative(yaw_rad),
        (true, true) => YawRequest::Angle(yaw_rad, rate_radps),
        (true, false) => YawRequest::Angle(yaw_rad, 0.0),
        (false, true) => YawRequest::Rate(rate_radps),
        (false, false) => YawRequest::Default,
    }
}

fn check(motion: &Motion, yaw: &YawRequest) -> Result<(), NotFinite> {
    let yaw_is_finite = match yaw {
        YawRequest::Default => true,
        YawRequest::Relative(value) | YawRequest::Rate(value) => value.is_finite(),
        YawRequest::Angle(yaw_rad, rate_radps) => yaw_rad.is_finite() && rate_radps.is_finite(),
    };
    let groups = [
        ("position", is_finite(&motion.position)),
        ("acceleration", is_finite(&motion.acceleration)),
        ("yaw", yaw_is_finite),
    ];
    match groups.into_iter().find(|(_, finite)| !finite) {
        Some((group, _)) => Err(NotFinite { group }),
        None => Ok(()),
    }
}

fn is_finite(v: &Vector3<f64>) -> bool {
    v.iter().all(|c| c.is_finite())
}

/// Position's ignore bits.
pub fn position_bits() -> Mask {
    Mask::POSITION_TARGET_TYPEMASK_X_IGNORE
        | Mask::POSITION_TARGET_TYPEMASK_Y_IGNORE
        | Mask::POSITION_TARGET_TYPEMASK_Z_IGNORE
}

/// Velocity's ignore bits.
pub fn velocity_bits() -> Mask {
    Mask::POSITION_TARGET_TYPEMASK_VX_IGNORE
        | Mask::POSITION_TARGET_TYPEMASK_VY_IGNORE
        | Mask::POSITION_TARGET_TYPEMASK_VZ_IGNORE
}

/// Acceleration's ignore bits.
pub fn acceleration_bits() -> Mask {
    Mask::POSITION_TARGET_TYPEMASK_AX_IGNORE
        | Mask::POSITION_TARGET_TYPEMASK_AY_IGNORE
        | Mask::POSITION_TARGET_TYPEMASK_AZ_IGNORE
}

/// The ignore bits of heading and heading rate.
pub fn yaw_bits() -> Mask {
    Mask::POSITION_TARGET_TYPEMASK_YAW_IGNORE | Mask::POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
}

#[cfg(test)]
mod tests {
    use super::*;
    use jink_simulated_world::vehicle::estimator::{Estimator, EstimatorConfig};
    use jink_simulated_world::vehicle::{Vehicle, VehicleConfig};
    use proptest::prelude::*;

    fn estimate(heading_rad: f64) -> Estimate {
        let vehicle = Vehicle::new(&VehicleConfig {
            heading_rad,
            ..VehicleConfig::default()
        });
        let config = EstimatorConfig {
            position_sigma_m: 0.0,
            velocity_sigma_mps: 0.0,
            ..EstimatorConfig::default()
        };
        Estimator::new(&config, vehicle.truth()).step(vehicle.truth())
    }

    fn message(mask: u16, frame: MavFrame) -> SET_POSITION_TARGET_LOCAL_NED_DATA {
        SET_POSITION_TARGET_LOCAL_NED_DATA {
            x: 1.0,
            vx: 2.0,
            afx: 3.0,
            yaw: 0.5,
            yaw_rate: 0.1,
            type_mask: Mask::from_bits_retain(mask),
            coordinate_frame: frame,
            ..SET_POSITION_TARGET_LOCAL_NED_DATA::default()
        }
    }

    proptest! {
        #[test]
        fn every_mask_is_read_and_a_partly_ignored_group_is_ignored(mask in 0u16..4096) {
            let local = MavFrame::MAV_FRAME_LOCAL_NED;
            let request = read(&message(mask, local), &estimate(0.0)).unwrap();
            let whole = [7u16, 56, 448].map(|group| mask & group == 0);
            let filled = [7u16, 56, 448].iter().fold(mask, |m, g| if m & g == 0 { m } else { m | g });
            prop_assert_eq!(request, read(&message(filled, local), &estimate(0.0)).unwrap());
            let forced = mask & 512 != 0 && whole[2];
            let expected = match whole {
                _ if forced => "stop",
                [true, true, _] => "motion",
                [false, true, _] => "velocity",
                [false, false, true] => "acceleration",
                [true, false, false] => "place",
                _ => "stop",
            };
            let is = match request {
                Request::Stop => "stop",
                Request::Motion(..) => "motion",
                Request::Velocity(..) => "velocity",
                Request::Acceleration(..) => "acceleration",
                Request::Place(..) => "place",
            };
            prop_assert_eq!(is, expected);
        }
    }

    #[test]
    fn body_frames_turn_with_the_vehicle_and_unknown_frames_stop() {
        let east = estimate(std::f64::consts::FRAC_PI_2);
        for frame in [MavFrame::MAV_FRAME_BODY_NED, MavFrame::MAV_FRAME_BODY_OFFSET_NED] {
            let Request::Motion(motion, yaw) = read(&message(0, frame), &east).unwrap() else {
                panic!("no motion");
            };
            assert!((motion.position - Vector3::new(0.0, 1.0, 0.0)).norm() < 1e-9);
            assert!((motion.velocity - Vector3::new(0.0, 2.0, 0.0)).norm() < 1e-9);
            assert_eq!(yaw, YawRequest::Relative(0.5));
        }
        for frame in [
            MavFrame::MAV_FRAME_BODY_FRD,
            MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT,
            MavFrame::MAV_FRAME_LOCAL_FRD,
            MavFrame::MAV_FRAME_GLOBAL,
        ] {
            assert_eq!(read(&message(0, frame), &east), Ok(Request::Stop));
        }
    }

    #[test]
    fn a_number_that_is_none_ends_the_process_only_where_it_counts() {
        let local = MavFrame::MAV_FRAME_LOCAL_NED;
        let with = |mask: u16, change: fn(&mut SET_POSITION_TARGET_LOCAL_NED_DATA)| {
            let mut message = message(mask, local);
            change(&mut message);
            read(&message, &estimate(0.0))
        };
        assert_eq!(with(0, |m| m.x = f32::NAN), Err(NotFinite { group: "position" }));
        assert_eq!(
            with(0, |m| m.afx = f32::NAN),
            Err(NotFinite {
                group: "acceleration"
            })
        );
        assert_eq!(with(0, |m| m.yaw = f32::NAN), Err(NotFinite { group: "yaw" }));
        assert_eq!(with(0, |m| m.vx = f32::NAN), Ok(Request::Stop));
        assert!(with(0o7, |m| m.x = f32::NAN).is_ok());
        assert!(with(0o700, |m| m.afy = f32::NAN).is_ok());
        assert!(with(1024, |m| m.yaw = f32::NAN).is_ok());
    }
}
