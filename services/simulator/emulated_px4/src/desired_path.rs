//! TRAJECTORY_REPRESENTATION_WAYPOINTS: what the companion is asked in automatic modes.

// Deprecated for the very reason this emulator knows two firmwares: current PX4 has dropped it.
#![allow(deprecated)]

use super::Px4;
use super::setpoint::PointKind;
use jink_shared_types::vehicle::{COMMAND_LAND, COMMAND_LOITER, COMMAND_NONE, COMMAND_TAKEOFF};
use mavlink::dialect as m;
use mavlink::dialect::MavMessage;

impl Px4 {
    /// What the companion is asked, in automatic modes only.
    pub(super) fn trajectory(&self) -> Option<MavMessage> {
        let asking =
            self.parameters.avoidance_enabled() && self.commander.mode().is_automatic() && self.is_ready();
        if !asking {
            return None;
        }
        let desired = self.auto_task.desired();
        let mut message = unset_waypoints();
        message.time_usec = desired.time_us;
        let command = command_of(desired.kind);
        let (position, velocity) = desired.setpoint;
        [message.pos_x[0], message.pos_y[0], message.pos_z[0]] = position.map(|c| c as f32).into();
        [message.vel_x[0], message.vel_y[0], message.vel_z[0]] = velocity.map(|c| c as f32).into();
        message.command[0] = command;
        message.valid_points = 1;
        if let Some((position, yaw_rad, yaw_rate_radps)) = desired.current {
            [message.pos_x[1], message.pos_y[1], message.pos_z[1]] = position.map(|c| c as f32).into();
            message.pos_yaw[1] = yaw_rad as f32;
            message.vel_yaw[1] = yaw_rate_radps as f32;
            message.command[1] = command;
            message.valid_points += 1;
        }
        if let Some((position, yaw_rad)) = desired.next {
            [message.pos_x[2], message.pos_y[2], message.pos_z[2]] = position.map(|c| c as f32).into();
            message.pos_yaw[2] = yaw_rad as f32;
            message.valid_points += 1;
        }
        Some(MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(message))
    }
}

/// MAV_CMD of a waypoint's kind.
fn command_of(kind: PointKind) -> u16 {
    match kind {
        PointKind::Takeoff => COMMAND_TAKEOFF,
        PointKind::Loiter => COMMAND_LOITER,
        PointKind::Land => COMMAND_LAND,
        PointKind::Position | PointKind::Idle => COMMAND_NONE,
    }
}

fn unset_waypoints() -> m::TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA {
    let unset = [f32::NAN; 5];
    m::TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA {
        pos_x: unset,
        pos_y: unset,
        pos_z: unset,
        vel_x: unset,
        vel_y: unset,
        vel_z: unset,
        acc_x: unset,
        acc_y: unset,
        acc_z: unset,
        pos_yaw: unset,
        vel_yaw: unset,
        command: [COMMAND_NONE; 5],
        ..m::TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA::default()
    }
}
