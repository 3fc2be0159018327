//! Every fault there is a sentence for.

use super::scene::{Scene, heartbeat, quadrotor};
use crate::{Counts, Grade};
use jink_mavlink_link::profile_name::ProfileName;
use mavlink::dialects::ardupilotmega::{
    MavAutopilot, MavMessage, MavModeFlag, MavType, SET_POSITION_TARGET_LOCAL_NED_DATA,
};

/// A fault, the profile it is played with, and what must be told.
pub(super) type Case = (&'static str, ProfileName, fn(&mut Scene), Grade);

/// A switch chooses assisted flight.
const ASSISTED: &str = "[params]\nCP_DIST = 2.0\nOA_ASSIST_CH = 7\n";

pub(super) fn cases() -> Vec<Case> {
    use Grade::{Blocker, Good, Warning};
    use ProfileName::{
        ArdupilotGuided as Guided, Px4Deviation as Deviation, Px4Offboard as Offboard,
        Px4Trajectory as Trajectory,
    };
    vec![
        (
            "nothing arrives on udpin:127.0.0.1:14540",
            Trajectory,
            |scene| {
                scene.nobody();
                scene.counts = Counts::default();
            },
            Blocker,
        ),
        (
            "3 datagrams or connections on udpin:127.0.0.1:14540 came from addresses that are not in link.peers",
            Trajectory,
            |scene| {
                scene.nobody();
                scene.counts = Counts {
                    strangers: 3,
                    ..Counts::default()
                };
            },
            Blocker,
        ),
        (
            "9000 bytes arrive on serial:/dev/ttyS9:57600, but no MAVLink message",
            Trajectory,
            |scene| {
                scene.nobody();
                scene.link("address = \"serial:/dev/ttyS9:57600\"\n");
                scene.counts = Counts {
                    garbage_bytes: 9000,
                    ..Counts::default()
                };
            },
            Blocker,
        ),
        (
            "40 bytes arrive on udpin:127.0.0.1:14540, too few to tell",
            Trajectory,
            |scene| {
                scene.nobody();
                scene.counts = Counts {
                    garbage_bytes: 40,
                    ..Counts::default()
                };
            },
            Blocker,
        ),
        (
            "no such device",
            Trajectory,
            |scene| {
                scene.nobody();
                scene.failure = Some("/dev/ttyS9: no such device");
            },
            Blocker,
        ),
        (
            "17 % of the bytes on udpin:127.0.0.1:14540 belong to no message",
            Trajectory,
            |scene| {
                scene.counts.garbage_bytes = 20_000;
            },
            Warning,
        ),
        (
            "9 % of the autopilot's messages are lost before udpin:127.0.0.1:14540",
            Trajectory,
            |scene| {
                scene.counts.lost = 200;
            },
            Warning,
        ),
        (
            "the autopilot speaks MAVLink 1 only",
            Trajectory,
            |scene| {
                scene.counts = Counts {
                    version_1: 2000,
                    version_2: 0,
                    ..scene.counts
                };
            },
            Blocker,
        ),
        (
            "link.signing = \"require\", and what arrives is not signed: 50 messages refused",
            Trajectory,
            |scene| {
                scene.nobody();
                scene.counts.unsigned_refused = 50;
            },
            Blocker,
        ),
        (
            "70 messages are signed with another key",
            Trajectory,
            |scene| {
                scene.nobody();
                scene.counts = Counts {
                    signature_refused: 70,
                    signed: 70,
                    ..scene.counts
                };
            },
            Blocker,
        ),
        (
            "5 signed messages were refused as not newer",
            Trajectory,
            |scene| {
                scene.counts = Counts {
                    replayed: 5,
                    signed: 2000,
                    ..scene.counts
                };
            },
            Warning,
        ),
        (
            "the autopilot signs and answers nothing that is not signed, and jink has no key",
            Trajectory,
            |scene| {
                scene.answers = false;
                scene.counts.signed = 2000;
            },
            Blocker,
        ),
        (
            "the autopilot signs, and jink does not look at it",
            Trajectory,
            |scene| {
                scene.counts.signed = 2000;
            },
            Warning,
        ),
        (
            "MAVLink arrives, but no autopilot's heartbeat: only a ground station (255/190), a gimbal (1/154)",
            Trajectory,
            |scene| {
                scene.nobody();
                for (system_id, component_id, kind) in [
                    (255, 190, MavType::MAV_TYPE_GCS),
                    (1, 154, MavType::MAV_TYPE_GIMBAL),
                ] {
                    let beat = heartbeat(kind, MavAutopilot::MAV_AUTOPILOT_INVALID);
                    scene
                        .others
                        .push((system_id, component_id, MavMessage::HEARTBEAT(beat)));
                }
            },
            Blocker,
        ),
        (
            "the autopilot (system 1) was heard and is silent for",
            Trajectory,
            |scene| scene.silent_from_s = 3.0,
            Blocker,
        ),
        (
            "link.system_id = 7, and the autopilot that is heard has system id 1",
            Trajectory,
            |scene| {
                scene.link("system_id = 7\n");
            },
            Blocker,
        ),
        (
            "autopilots of systems 1 and 9 are heard, and link.system_id = 0",
            Trajectory,
            |scene| {
                let rival = quadrotor(MavAutopilot::MAV_AUTOPILOT_PX4).unwrap();
                scene.others.push((9, 1, MavMessage::HEARTBEAT(rival)));
            },
            Blocker,
        ),
        (
            "the autopilot is PX4, and link.profile = \"ardupilot_guided\" is for ArduPilot",
            Guided,
            |scene| {
                scene.heartbeat = quadrotor(MavAutopilot::MAV_AUTOPILOT_PX4);
            },
            Blocker,
        ),
        (
            "the autopilot is ArduPilot, and link.profile = \"px4_trajectory\" is for PX4",
            Trajectory,
            |scene| {
                scene.heartbeat = quadrotor(MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA);
            },
            Blocker,
        ),
        (
            "the autopilot is ArduPilot, and link.profile = \"px4_offboard\" is for PX4",
            Offboard,
            |scene| {
                scene.heartbeat = quadrotor(MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA);
            },
            Blocker,
        ),
        (
            "the autopilot is neither PX4 nor ArduPilot",
            Trajectory,
            |scene| {
                scene.heartbeat = quadrotor(MavAutopilot::MAV_AUTOPILOT_GENERIC);
            },
            Blocker,
        ),
        (
            "the vehicle is no multicopter: fixed wing",
            Trajectory,
            |scene| {
                scene.heartbeat = Some(heartbeat(
                    MavType::MAV_TYPE_FIXED_WING,
                    MavAutopilot::MAV_AUTOPILOT_PX4,
                ));
            },
            Blocker,
        ),
        (
            "the motors are armed",
            Trajectory,
            |scene| {
                let beat = scene.heartbeat.as_mut().unwrap();
                beat.base_mode = MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;
            },
            Warning,
        ),
        (
            "PX4 1.10.1 is too old for link.profile = \"px4_trajectory\" (PX4 1.11 to 1.15)",
            Trajectory,
            |scene| {
                scene.version = 0x010a_01ff;
            },
            Blocker,
        ),
        (
            "PX4 1.12.3 is too old for link.profile = \"px4_offboard\" (PX4 1.13 and later)",
            Offboard,
            |scene| {
                scene.version = 0x010c_03ff;
            },
            Blocker,
        ),
        (
            "ArduPilot 3.6.12 is too old",
            Guided,
            |scene| scene.version = 0x0306_0cff,
            Blocker,
        ),
        (
            "PX4 1.16.0 has no trajectory interface any more",
            Trajectory,
            |scene| scene.version = 0x0110_00ff,
            Blocker,
        ),
        (
            "this PX4 refuses TRAJECTORY_REPRESENTATION_WAYPOINTS",
            Trajectory,
            |scene| scene.without(332),
            Blocker,
        ),
        (
            "this PX4 has no parameter COM_OBS_AVOID",
            Trajectory,
            |scene| {
                scene.parameters.retain(|(name, _)| *name != "COM_OBS_AVOID");
            },
            Blocker,
        ),
        (
            "the autopilot does not tell its version",
            Trajectory,
            |scene| scene.version = 0,
            Warning,
        ),
        (
            "the autopilot is heard, but answers nothing",
            Guided,
            |scene| scene.answers = false,
            Blocker,
        ),
        (
            "the autopilot tells no parameter",
            Guided,
            |scene| scene.parameters.clear(),
            Warning,
        ),
        (
            "LOCAL_POSITION_NED does not come, and not when asked for",
            Offboard,
            |scene| scene.without(32),
            Blocker,
        ),
        (
            "HOME_POSITION does not come, and not when asked for",
            Guided,
            |scene| scene.without(242),
            Warning,
        ),
        (
            "EXTENDED_SYS_STATE does not come, and not when asked for",
            Offboard,
            |scene| scene.without(245),
            Warning,
        ),
        (
            "TRAJECTORY_REPRESENTATION_WAYPOINTS does not come",
            Trajectory,
            |scene| {
                scene.streams.retain(|(id, _)| *id != 332);
                scene.streams.push((332, 0.0));
                scene.heartbeat.as_mut().unwrap().custom_mode = 4 << 16 | 4 << 24;
            },
            Blocker,
        ),
        (
            "ATTITUDE_QUATERNION comes 20.0 times a second, and 50 are needed",
            Guided,
            |scene| {
                scene.without(31);
                scene.streams.push((31, 20.0));
            },
            Warning,
        ),
        (
            "ATTITUDE_QUATERNION comes 4.0 times a second, and 50 are needed",
            Trajectory,
            |scene| {
                scene.without(31);
                scene.streams.push((31, 4.0));
            },
            Blocker,
        ),
        (
            "the autopilot does not answer TIMESYNC",
            Trajectory,
            |scene| scene.timesync_answers = 0,
            Warning,
        ),
        (
            "time is not synchronised: only 10 answers",
            Trajectory,
            |scene| scene.timesync_answers = 10,
            Warning,
        ),
        (
            "the shortest round trip is 30.0 ms, and PX4 synchronises below 10 ms only",
            Offboard,
            |scene| {
                scene.round_trip_s = 0.03;
            },
            Warning,
        ),
        (
            "COM_OBS_AVOID = 0: PX4 flies its missions without asking jink",
            Trajectory,
            |scene| {
                scene.parameter("COM_OBS_AVOID", 0.0);
            },
            Blocker,
        ),
        (
            "COM_OBS_AVOID = 1: in automatic modes PX4 waits for trajectories",
            Offboard,
            |scene| {
                scene.version = 0x010e_00ff;
                scene.parameter("COM_OBS_AVOID", 1.0);
            },
            Blocker,
        ),
        (
            "the vehicle's system id is 4, and PX4 addresses its own demand for Hold to system 1",
            Trajectory,
            |scene| scene.system_id = 4,
            Warning,
        ),
        (
            "MPC_XY_CRUISE lets the vehicle fly 5.0 m/s, and jink plans for 8.0",
            Trajectory,
            |scene| {
                scene.config += "[params]\nOA_SPD_MAX = 8.0\n";
            },
            Blocker,
        ),
        (
            "WPNAV_SPEED lets the vehicle fly 2.0 m/s, and jink plans for 3.0",
            Guided,
            |scene| {
                scene.parameter("WPNAV_SPEED", 200.0);
            },
            Blocker,
        ),
        (
            "MPC_ACC_HOR = 1.5 m/s2: PX4 smooths curves more",
            Trajectory,
            |scene| {
                scene.parameter("MPC_ACC_HOR", 1.5);
            },
            Warning,
        ),
        (
            "CP_DIST = 4.0 m has no effect",
            Trajectory,
            |scene| scene.parameter("CP_DIST", 4.0),
            Warning,
        ),
        (
            "CP_DIST = 4.0 m: in Position mode PX4 keeps away from what jink sees",
            Offboard,
            |_| {},
            Good,
        ),
        (
            "COM_OF_LOSS_T = 0.10 s: a restart of the gateway may end OFFBOARD",
            Offboard,
            |scene| {
                scene.parameter("COM_OF_LOSS_T", 0.1);
            },
            Warning,
        ),
        (
            "COM_OF_LOSS_T = 5.0 s: if the board dies, PX4 flies the last setpoint on",
            Offboard,
            |scene| {
                scene.parameter("COM_OF_LOSS_T", 5.0);
            },
            Warning,
        ),
        (
            "EAV_EN = 0: PX4 flies its missions without looking",
            Deviation,
            |scene| {
                scene.parameter("EAV_EN", 0.0);
            },
            Blocker,
        ),
        (
            "EAV_TIMEOUT = 0.10 s: while the gateway restarts",
            Deviation,
            |scene| {
                scene.parameter("EAV_TIMEOUT", 0.1);
            },
            Warning,
        ),
        (
            "COM_OBL_RC_ACT = 0: if the board dies, without a remote control the vehicle climbs",
            Offboard,
            |scene| {
                scene.parameter("COM_OBL_RC_ACT", 0.0);
            },
            Warning,
        ),
        (
            "COM_OBL_RC_ACT = 4: if the board dies, the vehicle lands where it is",
            Offboard,
            |scene| {
                scene.parameter("COM_OBL_RC_ACT", 4.0);
            },
            Warning,
        ),
        (
            "COM_OBL_RC_ACT = 7: if the board dies, PX4 stops the motors in the air",
            Offboard,
            |scene| {
                scene.parameter("COM_OBL_RC_ACT", 7.0);
            },
            Blocker,
        ),
        (
            "MAN_OVERRIDE_SPD = 1.0: sticks that move end OFFBOARD",
            Offboard,
            |scene| {
                scene.config += ASSISTED;
                scene.parameter("MAN_OVERRIDE_SPD", 1.0);
            },
            Warning,
        ),
        (
            "COM_RC_OVERRIDE = 3 has bit 1",
            Offboard,
            |scene| {
                scene.config += ASSISTED;
                scene.parameter("COM_RC_OVERRIDE", 3.0);
            },
            Warning,
        ),
        (
            "WPNAV_ACCEL lets ArduCopter brake with 2.5 m/s2, and collision prevention counts on MPC_ACC_HOR = 3.0",
            Guided,
            |scene| {
                scene.config += ASSISTED;
                scene.parameter("WPNAV_ACCEL", 250.0);
            },
            Warning,
        ),
        (
            "PSC_JERK_XY lets ArduCopter brake with 5.0 m/s3, and collision prevention counts on MPC_JERK_MAX = 8.0",
            Guided,
            |scene| {
                scene.config += ASSISTED;
                scene.parameter("PSC_JERK_XY", 5.0);
            },
            Warning,
        ),
        (
            "GUID_TIMEOUT = 0.05 s is too short",
            Guided,
            |scene| scene.parameter("GUID_TIMEOUT", 0.05),
            Blocker,
        ),
        (
            "GUID_TIMEOUT = 3.0 s is too long",
            Guided,
            |scene| scene.parameter("GUID_TIMEOUT", 3.0),
            Warning,
        ),
        (
            "this ArduCopter has no GUID_TIMEOUT",
            Guided,
            |scene| {
                scene.parameters.retain(|(name, _)| *name != "GUID_TIMEOUT");
            },
            Warning,
        ),
        (
            "GUID_OPTIONS = 48: ArduCopter does not correct errors",
            Guided,
            |scene| {
                scene.parameter("GUID_OPTIONS", 48.0);
            },
            Blocker,
        ),
        (
            "GUID_OPTIONS = 64: positions are flown to as waypoints",
            Guided,
            |scene| {
                scene.parameter("GUID_OPTIONS", 64.0);
            },
            Warning,
        ),
        (
            "the autopilot plans ways around obstacles itself",
            Guided,
            |scene| scene.parameter("OA_TYPE", 1.0),
            Warning,
        ),
        (
            "the autopilot leaves GUIDED within 5 s",
            Guided,
            |scene| scene.parameter("FS_GCS_ENABLE", 1.0),
            Warning,
        ),
        (
            "somebody else speaks as obstacle avoidance (1/196)",
            Trajectory,
            |scene| {
                let beat = heartbeat(
                    MavType::MAV_TYPE_ONBOARD_CONTROLLER,
                    MavAutopilot::MAV_AUTOPILOT_INVALID,
                );
                scene.others.push((1, 196, MavMessage::HEARTBEAT(beat)));
            },
            Blocker,
        ),
        (
            "somebody (1/195) sends setpoints, too: SET_POSITION_TARGET_LOCAL_NED",
            Offboard,
            |scene| {
                let setpoint = SET_POSITION_TARGET_LOCAL_NED_DATA::default();
                scene
                    .others
                    .push((1, 195, MavMessage::SET_POSITION_TARGET_LOCAL_NED(setpoint)));
            },
            Blocker,
        ),
    ]
}
