//! What PX4 wants to do: TRAJECTORY_REPRESENTATION_WAYPOINTS as a [`DesiredPath`].
//!
//! NaN keeps its meaning "not given". One quirk is put right: while landing PX4 fills points 1 and 2 with the home
//! altitude as if it were a down coordinate (some hundred metres below ground); that z is no goal and becomes NaN.

use crate::profile::curve::MAX_YAW_RAD;
use crate::px4_mode;
use crate::vehicle::{MAX_COORDINATE_M, MAX_SPEED_MPS};
use jink_shared_types::vehicle::{COMMAND_LAND, DesiredPath, DesiredPoint, NavMode};
use jink_shared_types::{Coded, Flag, Point, Velocity};
#[allow(deprecated)] // The interface is gone from PX4 1.16 on; this profile is for the versions before.
use mavlink::dialects::ardupilotmega::TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA;

/// The path in `message`, asked for in the mode that follows from the last heartbeat's mode (and whether that has a
/// name) and the message's commands, see [`px4_mode::infer`].
#[allow(deprecated)]
pub fn read(
    message: &TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA,
    (heartbeat, named): (NavMode, bool),
) -> DesiredPath {
    let mut points: [DesiredPoint; 3] = std::array::from_fn(|i| DesiredPoint {
        position: Point::new(
            given(message.pos_x[i], MAX_COORDINATE_M),
            given(message.pos_y[i], MAX_COORDINATE_M),
            given(message.pos_z[i], MAX_COORDINATE_M),
        ),
        velocity: Velocity::new(
            given(message.vel_x[i], MAX_SPEED_MPS),
            given(message.vel_y[i], MAX_SPEED_MPS),
            given(message.vel_z[i], MAX_SPEED_MPS),
        ),
        yaw_rad: given_turn(message.pos_yaw[i]),
        yaw_rate_radps: given_turn(message.vel_yaw[i]),
        command: message.command[i],
        valid: Flag::from(i < usize::from(message.valid_points)),
        reserved: [0; 5],
    });
    let [current, waypoint, next] = &mut points;
    let descends = current.position.z_m.is_nan() && current.velocity.z_mps.is_finite();
    if descends || current.command == COMMAND_LAND {
        waypoint.position.z_m = f64::NAN;
        next.position.z_m = f64::NAN;
    }
    DesiredPath {
        points,
        autopilot_time_us: message.time_usec,
        mode: Coded::new(px4_mode::infer(heartbeat, named, &points)),
        ..DesiredPath::default()
    }
}

/// A field that is given and makes sense, else NaN.
fn given(value: f32, largest: f64) -> f64 {
    let value = f64::from(value);
    if value.abs() <= largest { value } else { f64::NAN }
}

/// The same for headings and their rates, to the bit: what is mirrored is what was asked for.
fn given_turn(value: f32) -> f32 {
    if f64::from(value).abs() <= MAX_YAW_RAD {
        value
    } else {
        f32::NAN
    }
}
