//! What each profile may send as a setpoint, field by field.

use jink_mavlink_gateway::{COMPONENT_AUTOPILOT, GatewayConfig, ProfileName, Representation};
use mavlink::dialect::*;

/// Whether `message` is what the profile may send: a setpoint without anything that it forbids, or none.
pub(super) fn judge_setpoint(config: &GatewayConfig, is_setpoint: bool, message: &MavMessage) {
    use ProfileName::{ArdupilotGuided, Px4Deviation, Px4Offboard, Px4Trajectory};
    use Representation::{Bezier, Waypoints};
    match (message, config.profile, config.representation) {
        (MavMessage::TRAJECTORY_REPRESENTATION_BEZIER(curve), Px4Trajectory, Bezier) => {
            judge_curve(curve);
        }
        (MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(announcement), Px4Trajectory, Bezier) => {
            assert!(!is_setpoint && announcement.valid_points == 0, "{announcement:?}");
            assert!(announcement.pos_x.iter().all(|x| x.is_nan()), "{announcement:?}");
        }
        (MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(waypoints), Px4Trajectory, Waypoints) => {
            judge_waypoints(waypoints);
        }
        (MavMessage::SET_POSITION_TARGET_LOCAL_NED(target), Px4Offboard | ArdupilotGuided, _) => {
            judge_assisted_or_whole(config.profile, target);
        }
        (MavMessage::SET_POSITION_TARGET_LOCAL_NED(target), Px4Deviation, _) => judge_deviation(target),
        (
            MavMessage::TRAJECTORY_REPRESENTATION_BEZIER(_)
            | MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(_)
            | MavMessage::SET_POSITION_TARGET_LOCAL_NED(_),
            profile,
            _,
        ) => panic!("{profile:?} never sends {message:?}"),
        _ => assert!(!is_setpoint, "{message:?}"),
    }
}

fn judge_curve(curve: &TRAJECTORY_REPRESENTATION_BEZIER_DATA) {
    assert_eq!(curve.valid_points, 5);
    let numbers = [curve.pos_x, curve.pos_y, curve.pos_z, curve.pos_yaw, curve.delta];
    assert!(numbers.iter().flatten().all(|n| n.is_finite()), "{curve:?}");
    assert!(curve.delta[4] > 0.0, "{curve:?}");
    let turned = curve.pos_yaw.map(|yaw| (yaw - curve.pos_yaw[0]).abs());
    assert!(
        turned.iter().all(|turned| *turned < 3.2),
        "PX4 would unwrap {turned:?}"
    );
}

fn judge_waypoints(waypoints: &TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA) {
    assert_eq!(waypoints.valid_points, 1);
    let position = [waypoints.pos_x, waypoints.pos_y, waypoints.pos_z];
    let velocity = [waypoints.vel_x, waypoints.vel_y, waypoints.vel_z];
    let acceleration = [waypoints.acc_x, waypoints.acc_y, waypoints.acc_z];
    let heading = [waypoints.pos_yaw, waypoints.vel_yaw];
    for axis in 0..3 {
        let (p, v) = (position[axis][0], velocity[axis][0]);
        assert!(
            p.is_finite() || v.is_finite(),
            "axis {axis} is nowhere: {waypoints:?}"
        );
    }
    let given = position.iter().chain(&velocity).chain(&heading);
    assert!(
        given.clone().all(|field| !field[0].is_infinite()),
        "{waypoints:?}"
    );
    assert!(
        given.clone().all(|field| field[1..].iter().all(|n| n.is_nan())),
        "{waypoints:?}"
    );
    assert!(acceleration.iter().flatten().all(|n| n.is_nan()), "{waypoints:?}");
    assert_eq!(waypoints.command, [u16::MAX; 5]);
}

fn judge_deviation(target: &SET_POSITION_TARGET_LOCAL_NED_DATA) {
    let whole = SET_POSITION_TARGET_LOCAL_NED_DATA {
        type_mask: PositionTargetTypemask::empty(),
        ..target.clone()
    };
    judge_target(&whole);
    // Positions and headings are not given, velocities and accelerations are; where a pilot steers, the horizontal ones.
    let masks = [0b1100_0000_0111, 0b1101_0010_0111];
    assert!(masks.contains(&target.type_mask.bits()), "{target:?}");
}

/// Everything is given; where a pilot is assisted, but for the place and the heading: ArduCopter ignores the whole group.
fn judge_assisted_or_whole(profile: ProfileName, target: &SET_POSITION_TARGET_LOCAL_NED_DATA) {
    let place = match profile {
        ProfileName::ArdupilotGuided => 0b111,
        _ => 0b011,
    };
    let heading = 0b100_0000_0000;
    let masks = [0, heading, place, place | heading];
    assert!(masks.contains(&target.type_mask.bits()), "{target:?}");
    judge_target(&SET_POSITION_TARGET_LOCAL_NED_DATA {
        type_mask: PositionTargetTypemask::empty(),
        ..target.clone()
    });
}

fn judge_target(target: &SET_POSITION_TARGET_LOCAL_NED_DATA) {
    let numbers = [
        target.x,
        target.y,
        target.z,
        target.vx,
        target.vy,
        target.vz,
        target.afx,
        target.afy,
        target.afz,
        target.yaw,
        target.yaw_rate,
    ];
    assert!(numbers.iter().all(|n| n.is_finite()), "{target:?}");
    assert_eq!(target.type_mask, PositionTargetTypemask::empty());
    assert_eq!(target.coordinate_frame, MavFrame::MAV_FRAME_LOCAL_NED);
    assert_eq!(target.target_component, COMPONENT_AUTOPILOT);
}
