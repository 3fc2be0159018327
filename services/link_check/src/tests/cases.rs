//! Every fault there is a sentence for.

use super::scripted_autopilot::{ScriptedAutopilot, heartbeat, quadrotor};
use crate::{Counts, Severity};
use jink_mavlink_link::profile_name::ProfileName;
use mavlink::dialect::{MavAutopilot, MavMessage, MavModeFlag, MavType, SET_POSITION_TARGET_LOCAL_NED_DATA};

/// A fault, its profile, and the severity of its finding.
pub(super) type Case = (&'static str, ProfileName, fn(&mut ScriptedAutopilot), Severity);

/// A switch chooses assisted flight.
const ASSISTED: &str = "[params]\nCP_DIST = 2.0\nOA_ASSIST_CH = 7\n";

pub(super) fn cases() -> Vec<Case> {
    use ProfileName::{
        ArdupilotGuided as Guided, Px4Deviation as Deviation, Px4Offboard as Offboard,
        Px4Trajectory as Trajectory,
    };
    use Severity::{Blocker, Good, Warning};
    vec![
        (
            "nothing arrives on udpin:127.0.0.1:14540",
            Trajectory,
            |script| {
                script.remove_autopilot();
                script.counts = Counts::default();
            },
            Blocker,
        ),
        (
            "3 datagrams or connections on udpin:127.0.0.1:14540 came from addresses that are not in link.peers",
            Trajectory,
            |script| {
                script.remove_autopilot();
                script.counts = Counts {
                    unknown_peers: 3,
                    ..Counts::default()
                };
            },
            Blocker,
        ),
        (
            "9000 bytes arrive on serial:/dev/ttyS9:57600, but no MAVLink message",
            Trajectory,
            |script| {
                script.remove_autopilot();
                script.link("address = \"serial:/dev/ttyS9:57600\"\n");
                script.counts = Counts {
                    garbage_bytes: 9000,
                    ..Counts::default()
                };
            },
            Blocker,
        ),
        (
            "40 bytes arrive on udpin:127.0.0.1:14540, too few to tell",
            Trajectory,
            |script| {
                script.remove_autopilot();
                script.counts = Counts {
                    garbage_bytes: 40,
                    ..Counts::default()
                };
            },
            Blocker,
        ),
        (
            "no such device",
            Trajectory,
            |script| {
                script.remove_autopilot();
                script.failure = Some("/dev/ttyS9: no such device");
            },
            Blocker,
        ),
        (
            "17 % of the bytes on udpin:127.0.0.1:14540 belong to no message",
            Trajectory,
            |script| {
                script.counts.garbage_bytes = 20_000;
            },
            Warning,
        ),
        (
            "9 % of the autopilot's messages are lost before udpin:127.0.0.1:14540",
            Trajectory,
            |script| {
                script.counts.lost = 200;
            },
            Warning,
        ),
        (
            "the autopilot speaks MAVLink 1 only",
            Trajectory,
            |script| {
                script.counts = Counts {
                    version_1: 2000,
                    version_2: 0,
                    ..script.counts
                };
            },
            Blocker,
        ),
        (
            "link.signing = \"require\", and what arrives is not signed: 50 messages refused",
            Trajectory,
            |script| {
                script.remove_autopilot();
                script.counts.unsigned_refused = 50;
            },
            Blocker,
        ),
        (
            "70 messages are signed with another key",
            Trajectory,
            |script| {
                script.remove_autopilot();
                script.counts = Counts {
                    signature_refused: 70,
                    signed: 70,
                    ..script.counts
                };
            },
            Blocker,
        ),
        (
            "5 signed messages were refused as not newer",
            Trajectory,
            |script| {
                script.counts = Counts {
                    replayed: 5,
                    signed: 2000,
                    ..script.counts
                };
            },
            Warning,
        ),
        (
            "the autopilot signs and answers nothing that is not signed, and jink has no key",
            Trajectory,
            |script| {
                script.answers = false;
                script.counts.signed = 2000;
            },
            Blocker,
        ),
        (
            "the autopilot signs, and jink does not look at it",
            Trajectory,
            |script| {
                script.counts.signed = 2000;
            },
            Warning,
        ),
        (
            "MAVLink arrives, but no autopilot's heartbeat: only a ground station (255/190), a gimbal (1/154)",
            Trajectory,
            |script| {
                script.remove_autopilot();
                for (system_id, component_id, kind) in [
                    (255, 190, MavType::MAV_TYPE_GCS),
                    (1, 154, MavType::MAV_TYPE_GIMBAL),
                ] {
                    let heartbeat = heartbeat(kind, MavAutopilot::MAV_AUTOPILOT_INVALID);
                    script
                        .others
                        .push((system_id, component_id, MavMessage::HEARTBEAT(heartbeat)));
                }
            },
            Blocker,
        ),
        (
            "the autopilot (system 1) was connected and is silent for",
            Trajectory,
            |script| script.silent_from_s = 3.0,
            Blocker,
        ),
        (
            "link.system_id = 7, and the autopilot that is connected has system id 1",
            Trajectory,
            |script| {
                script.link("system_id = 7\n");
            },
            Blocker,
        ),
        (
            "autopilots of systems 1 and 9 are connected, and link.system_id = 0",
            Trajectory,
            |script| {
                let rival = quadrotor(MavAutopilot::MAV_AUTOPILOT_PX4).unwrap();
                script.others.push((9, 1, MavMessage::HEARTBEAT(rival)));
            },
            Blocker,
        ),
        (
            "the autopilot is PX4, and link.profile = \"ardupilot_guided\" is for ArduPilot",
            Guided,
            |script| {
                script.heartbeat = quadrotor(MavAutopilot::MAV_AUTOPILOT_PX4);
            },
            Blocker,
        ),
        (
            "the autopilot is ArduPilot, and link.profile = \"px4_trajectory\" is for PX4",
            Trajectory,
            |script| {
                script.heartbeat = quadrotor(MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA);
            },
            Blocker,
        ),
        (
            "the autopilot is ArduPilot, and link.profile = \"px4_offboard\" is for PX4",
            Offboard,
            |script| {
                script.heartbeat = quadrotor(MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA);
            },
            Blocker,
        ),
        (
            "the autopilot is neither PX4 nor ArduPilot",
            Trajectory,
            |script| {
                script.heartbeat = quadrotor(MavAutopilot::MAV_AUTOPILOT_GENERIC);
            },
            Blocker,
        ),
        (
            "the vehicle is no multicopter: fixed wing",
            Trajectory,
            |script| {
                script.heartbeat = Some(heartbeat(
                    MavType::MAV_TYPE_FIXED_WING,
                    MavAutopilot::MAV_AUTOPILOT_PX4,
                ));
            },
            Blocker,
        ),
        (
            "the motors are armed",
            Trajectory,
            |script| {
                let heartbeat = script.heartbeat.as_mut().unwrap();
                heartbeat.base_mode = MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;
            },
            Warning,
        ),
        (
            "PX4 1.10.1 is too old for link.profile = \"px4_trajectory\" (PX4 1.11 to 1.15)",
            Trajectory,
            |script| {
                script.version = 0x010a_01ff;
            },
            Blocker,
        ),
        (
            "PX4 1.12.3 is too old for link.profile = \"px4_offboard\" (PX4 1.13 and later)",
            Offboard,
            |script| {
                script.version = 0x010c_03ff;
            },
            Blocker,
        ),
        (
            "ArduPilot 3.6.12 is too old",
            Guided,
            |script| script.version = 0x0306_0cff,
            Blocker,
        ),
        (
            "PX4 1.16.0 has no trajectory interface any more",
            Trajectory,
            |script| script.version = 0x0110_00ff,
            Blocker,
        ),
        (
            "this PX4 refuses TRAJECTORY_REPRESENTATION_WAYPOINTS",
            Trajectory,
            |script| script.without(332),
            Blocker,
        ),
        (
            "this PX4 has no parameter COM_OBS_AVOID",
            Trajectory,
            |script| {
                script.parameters.retain(|(name, _)| *name != "COM_OBS_AVOID");
            },
            Blocker,
        ),
        (
            "the autopilot does not tell its version",
            Trajectory,
            |script| script.version = 0,
            Warning,
        ),
        (
            "the autopilot sends, but answers nothing",
            Guided,
            |script| script.answers = false,
            Blocker,
        ),
        (
            "the autopilot reports no parameter",
            Guided,
            |script| script.parameters.clear(),
            Warning,
        ),
        (
            "LOCAL_POSITION_NED does not come, and not when asked for",
            Offboard,
            |script| script.without(32),
            Blocker,
        ),
        (
            "HOME_POSITION does not come, and not when asked for",
            Guided,
            |script| script.without(242),
            Warning,
        ),
        (
            "EXTENDED_SYS_STATE does not come, and not when asked for",
            Offboard,
            |script| script.without(245),
            Warning,
        ),
        (
            "TRAJECTORY_REPRESENTATION_WAYPOINTS does not come",
            Trajectory,
            |script| {
                script.streams.retain(|(id, _)| *id != 332);
                script.streams.push((332, 0.0));
                script.heartbeat.as_mut().unwrap().custom_mode = 4 << 16 | 4 << 24;
            },
            Blocker,
        ),
        (
            "ATTITUDE_QUATERNION comes 20.0 times a second, and 50 are needed",
            Guided,
            |script| {
                script.without(31);
                script.streams.push((31, 20.0));
            },
            Warning,
        ),
        (
            "ATTITUDE_QUATERNION comes 4.0 times a second, and 50 are needed",
            Trajectory,
            |script| {
                script.without(31);
                script.streams.push((31, 4.0));
            },
            Blocker,
        ),
        (
            "the autopilot does not answer TIMESYNC",
            Trajectory,
            |script| script.timesync_answers = 0,
            Warning,
        ),
        (
            "time is not synchronised: only 10 answers",
            Trajectory,
            |script| script.timesync_answers = 10,
            Warning,
        ),
        (
            "the shortest round trip is 30.0 ms, and PX4 synchronises below 10 ms only",
            Offboard,
            |script| {
                script.round_trip_s = 0.03;
            },
            Warning,
        ),
        (
            "COM_OBS_AVOID = 0: PX4 flies its missions without asking jink",
            Trajectory,
            |script| {
                script.parameter("COM_OBS_AVOID", 0.0);
            },
            Blocker,
        ),
        (
            "COM_OBS_AVOID = 1: in automatic modes PX4 waits for trajectories",
            Offboard,
            |script| {
                script.version = 0x010e_00ff;
                script.parameter("COM_OBS_AVOID", 1.0);
            },
            Blocker,
        ),
        (
            "the vehicle's system id is 4, and PX4 addresses its own demand for Hold to system 1",
            Trajectory,
            |script| script.system_id = 4,
            Warning,
        ),
        (
            "MPC_XY_CRUISE lets the vehicle fly 5.0 m/s, and jink plans for 8.0",
            Trajectory,
            |script| {
                script.config += "[params]\nOA_SPD_MAX = 8.0\n";
            },
            Blocker,
        ),
        (
            "WPNAV_SPEED lets the vehicle fly 2.0 m/s, and jink plans for 3.0",
            Guided,
            |script| {
                script.parameter("WPNAV_SPEED", 200.0);
            },
            Blocker,
        ),
        (
            "MPC_ACC_HOR = 1.5 m/s2: PX4 smooths curves more",
            Trajectory,
            |script| {
                script.parameter("MPC_ACC_HOR", 1.5);
            },
            Warning,
        ),
        (
            "CP_DIST = 4.0 m has no effect",
            Trajectory,
            |script| script.parameter("CP_DIST", 4.0),
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
            |script| {
                script.parameter("COM_OF_LOSS_T", 0.1);
            },
            Warning,
        ),
        (
            "COM_OF_LOSS_T = 5.0 s: if the board dies, PX4 flies the last setpoint on",
            Offboard,
            |script| {
                script.parameter("COM_OF_LOSS_T", 5.0);
            },
            Warning,
        ),
        (
            "EAV_EN = 0: PX4 flies its missions without looking",
            Deviation,
            |script| {
                script.parameter("EAV_EN", 0.0);
            },
            Blocker,
        ),
        (
            "EAV_TIMEOUT = 0.10 s: while the gateway restarts",
            Deviation,
            |script| {
                script.parameter("EAV_TIMEOUT", 0.1);
            },
            Warning,
        ),
        (
            "COM_OBL_RC_ACT = 0: if the board dies, without a remote control the vehicle climbs",
            Offboard,
            |script| {
                script.parameter("COM_OBL_RC_ACT", 0.0);
            },
            Warning,
        ),
        (
            "COM_OBL_RC_ACT = 4: if the board dies, the vehicle lands where it is",
            Offboard,
            |script| {
                script.parameter("COM_OBL_RC_ACT", 4.0);
            },
            Warning,
        ),
        (
            "COM_OBL_RC_ACT = 7: if the board dies, PX4 stops the motors in the air",
            Offboard,
            |script| {
                script.parameter("COM_OBL_RC_ACT", 7.0);
            },
            Blocker,
        ),
        (
            "MAN_OVERRIDE_SPD = 1.0: sticks that move end OFFBOARD",
            Offboard,
            |script| {
                script.config += ASSISTED;
                script.parameter("MAN_OVERRIDE_SPD", 1.0);
            },
            Warning,
        ),
        (
            "COM_RC_OVERRIDE = 3 has bit 1",
            Offboard,
            |script| {
                script.config += ASSISTED;
                script.parameter("COM_RC_OVERRIDE", 3.0);
            },
            Warning,
        ),
        (
            "WPNAV_ACCEL lets ArduCopter brake with 2.5 m/s2, and collision prevention counts on MPC_ACC_HOR = 3.0",
            Guided,
            |script| {
                script.config += ASSISTED;
                script.parameter("WPNAV_ACCEL", 250.0);
            },
            Warning,
        ),
        (
            "PSC_JERK_XY lets ArduCopter brake with 5.0 m/s3, and collision prevention counts on MPC_JERK_MAX = 8.0",
            Guided,
            |script| {
                script.config += ASSISTED;
                script.parameter("PSC_JERK_XY", 5.0);
            },
            Warning,
        ),
        (
            "GUID_TIMEOUT = 0.05 s is too short",
            Guided,
            |script| script.parameter("GUID_TIMEOUT", 0.05),
            Blocker,
        ),
        (
            "GUID_TIMEOUT = 3.0 s is too long",
            Guided,
            |script| script.parameter("GUID_TIMEOUT", 3.0),
            Warning,
        ),
        (
            "this ArduCopter has no GUID_TIMEOUT",
            Guided,
            |script| {
                script.parameters.retain(|(name, _)| *name != "GUID_TIMEOUT");
            },
            Warning,
        ),
        (
            "GUID_OPTIONS = 48: ArduCopter does not correct errors",
            Guided,
            |script| {
                script.parameter("GUID_OPTIONS", 48.0);
            },
            Blocker,
        ),
        (
            "GUID_OPTIONS = 64: positions are flown to as waypoints",
            Guided,
            |script| {
                script.parameter("GUID_OPTIONS", 64.0);
            },
            Warning,
        ),
        (
            "the autopilot plans ways around obstacles itself",
            Guided,
            |script| script.parameter("OA_TYPE", 1.0),
            Warning,
        ),
        (
            "the autopilot leaves GUIDED within 5 s",
            Guided,
            |script| script.parameter("FS_GCS_ENABLE", 1.0),
            Warning,
        ),
        (
            "somebody else speaks as obstacle avoidance (1/196)",
            Trajectory,
            |script| {
                let heartbeat = heartbeat(
                    MavType::MAV_TYPE_ONBOARD_CONTROLLER,
                    MavAutopilot::MAV_AUTOPILOT_INVALID,
                );
                script.others.push((1, 196, MavMessage::HEARTBEAT(heartbeat)));
            },
            Blocker,
        ),
        (
            "somebody (1/195) sends setpoints, too: SET_POSITION_TARGET_LOCAL_NED",
            Offboard,
            |script| {
                let setpoint = SET_POSITION_TARGET_LOCAL_NED_DATA::default();
                script
                    .others
                    .push((1, 195, MavMessage::SET_POSITION_TARGET_LOCAL_NED(setpoint)));
            },
            Blocker,
        ),
    ]
}
