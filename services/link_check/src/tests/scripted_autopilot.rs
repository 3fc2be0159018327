//! An autopilot as a script, on a clock that is only counted.

use crate::{Counts, Finding, LinkCheck, Plan};
use jink_mavlink_link::message::{Body, Content, Received};
use jink_mavlink_link::profile_name::ProfileName;
use jink_runtime::config::Config;
use jink_shared_types::Timestamp;
use mavlink::dialect::{
    AUTOPILOT_VERSION_DATA, COMMAND_ACK_DATA, HEARTBEAT_DATA, MavAutopilot, MavCmd, MavMessage, MavModeFlag,
    MavParamType, MavResult, MavState, MavType, PARAM_VALUE_DATA, TIMESYNC_DATA,
};
use mavlink::{MavHeader, Message, MessageData};
use std::path::Path;

const BEGIN_S: f64 = 1000.0;
const STEP_S: f64 = 0.01;
const PATIENCE_S: f64 = 15.0;

/// An autopilot as a script, with other senders.
#[derive(Clone)]
pub(super) struct ScriptedAutopilot {
    pub(super) config: String,
    pub(super) system_id: u8,
    pub(super) heartbeat: Option<HEARTBEAT_DATA>,
    /// The heartbeats end at this time (s).
    pub(super) silent_from_s: f64,
    pub(super) answers: bool,
    pub(super) version: u32,
    /// Streams with their rates (Hz); what is not here does not exist.
    pub(super) streams: Vec<(u32, f64)>,
    pub(super) parameters: Vec<(&'static str, f64)>,
    /// How many requests for the time are answered.
    pub(super) timesync_answers: u32,
    pub(super) round_trip_s: f64,
    /// Other senders, each with a message that it sends once a second.
    pub(super) others: Vec<(u32, u8, MavMessage)>,
    pub(super) counts: Counts,
    pub(super) failure: Option<&'static str>,
}

pub(super) fn heartbeat(mavtype: MavType, autopilot: MavAutopilot) -> HEARTBEAT_DATA {
    HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype,
        autopilot,
        base_mode: MavModeFlag::empty(),
        system_status: MavState::MAV_STATE_STANDBY,
        mavlink_version: 3,
    }
}

pub(super) fn quadrotor(autopilot: MavAutopilot) -> Option<HEARTBEAT_DATA> {
    Some(heartbeat(MavType::MAV_TYPE_QUADROTOR, autopilot))
}

/// Everything as it should be.
pub(super) fn good(profile: ProfileName) -> ScriptedAutopilot {
    let (autopilot, version, parameters): (_, _, &[(&'static str, f64)]) = match profile {
        ProfileName::Px4Trajectory => (
            MavAutopilot::MAV_AUTOPILOT_PX4,
            0x010f_02ff,
            &[
                ("COM_OBS_AVOID", 1.0),
                ("MPC_XY_CRUISE", 5.0),
                ("MPC_ACC_HOR", 3.0),
                ("MPC_JERK_AUTO", 4.0),
                ("CP_DIST", -1.0),
                ("MPC_POS_MODE", 4.0),
            ],
        ),
        ProfileName::Px4Offboard => (
            MavAutopilot::MAV_AUTOPILOT_PX4,
            0x0111_0000,
            &[
                ("COM_OF_LOSS_T", 1.0),
                ("COM_OBL_RC_ACT", 5.0),
                ("MPC_XY_VEL_MAX", 12.0),
                ("CP_DIST", 4.0),
            ],
        ),
        ProfileName::Px4Deviation => (
            MavAutopilot::MAV_AUTOPILOT_PX4,
            0x0111_0000,
            &[
                ("EAV_EN", 1.0),
                ("EAV_TIMEOUT", 0.5),
                ("MPC_XY_VEL_MAX", 12.0),
                ("CP_DIST", 4.0),
            ],
        ),
        ProfileName::ArdupilotGuided => (
            MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
            0x0407_00ff,
            &[
                ("GUID_TIMEOUT", 0.5),
                ("GUID_OPTIONS", 0.0),
                ("WPNAV_SPEED", 1000.0),
                ("PRX1_TYPE", 2.0),
                ("OA_TYPE", 0.0),
                ("FS_GCS_ENABLE", 0.0),
            ],
        ),
    };
    ScriptedAutopilot {
        config: format!("[link]\nprofile = \"{}\"\n", profile.name()),
        system_id: 1,
        heartbeat: quadrotor(autopilot),
        silent_from_s: f64::INFINITY,
        answers: true,
        version,
        streams: [31, 32, 33, 42, 85, 141, 242, 245, 332, 436]
            .map(|id| (id, 50.0))
            .to_vec(),
        parameters: parameters.to_vec(),
        timesync_answers: u32::MAX,
        round_trip_s: 0.002,
        others: Vec::new(),
        counts: Counts {
            frame_bytes: 100_000,
            frames: 2000,
            version_2: 2000,
            ..Counts::default()
        },
        failure: None,
    }
}

impl ScriptedAutopilot {
    pub(super) fn parameter(&mut self, name: &'static str, value: f64) {
        self.parameters.retain(|(known, _)| *known != name);
        self.parameters.push((name, value));
    }

    pub(super) fn without(&mut self, message_id: u32) {
        self.streams.retain(|(known, _)| *known != message_id);
    }

    pub(super) fn link(&mut self, keys: &str) {
        self.config += keys;
    }

    pub(super) fn remove_autopilot(&mut self) {
        self.heartbeat = None;
        self.streams.clear();
    }

    /// The messages sent in the step that ends at step `number`, besides answers.
    pub(super) fn received(&self, number: u32) -> Vec<(u32, u8, MavMessage)> {
        let time_s = f64::from(number) * STEP_S;
        let due = |rate_hz: f64| (time_s * rate_hz).floor() > ((time_s - STEP_S) * rate_hz).floor();
        let mut received = Vec::new();
        if time_s < self.silent_from_s {
            let own = |message| (u32::from(self.system_id), 1, message);
            if let Some(heartbeat) = self.heartbeat.as_ref().filter(|_| due(1.0)) {
                received.push(own(MavMessage::HEARTBEAT(heartbeat.clone())));
            }
            for (id, _) in self.streams.iter().filter(|(_, rate_hz)| due(*rate_hz)) {
                received.push(own(MavMessage::default_message_from_id(*id).unwrap()));
            }
        }
        if due(1.0) {
            received.extend(self.others.iter().cloned());
        }
        received
    }

    /// The autopilot's answer to `sent` at `now`; `asked` counts the requests for the time.
    pub(super) fn answer(&self, sent: &MavMessage, now: Timestamp, asked: u32) -> Option<MavMessage> {
        let is_silent = now.seconds_since(Timestamp::from_seconds(BEGIN_S)) >= self.silent_from_s;
        if !self.answers || is_silent {
            return None;
        }
        match sent {
            MavMessage::COMMAND_LONG(command)
                if command.param1 as u32 == AUTOPILOT_VERSION_DATA::ID && self.version != 0 =>
            {
                Some(MavMessage::AUTOPILOT_VERSION(AUTOPILOT_VERSION_DATA {
                    flight_sw_version: self.version,
                    ..AUTOPILOT_VERSION_DATA::default()
                }))
            }
            MavMessage::COMMAND_LONG(command) => {
                assert!(matches!(
                    command.command,
                    MavCmd::MAV_CMD_REQUEST_MESSAGE | MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL
                ));
                let exists = self.streams.iter().any(|(id, _)| *id == command.param1 as u32);
                let result = match exists {
                    true => MavResult::MAV_RESULT_ACCEPTED,
                    false => MavResult::MAV_RESULT_FAILED,
                };
                Some(MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
                    command: command.command,
                    result,
                    ..COMMAND_ACK_DATA::default()
                }))
            }
            MavMessage::PARAM_REQUEST_READ(request) => {
                let name = request.param_id.to_str().unwrap();
                let (name, value) = self.parameters.iter().find(|(known, _)| *known == name)?;
                Some(MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
                    param_id: (*name).into(),
                    param_value: *value as f32,
                    param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
                    ..PARAM_VALUE_DATA::default()
                }))
            }
            MavMessage::TIMESYNC(request) if asked <= self.timesync_answers => {
                Some(MavMessage::TIMESYNC(TIMESYNC_DATA {
                    tc1: i64::try_from(now.plus_seconds(self.round_trip_s / 2.0).ns).unwrap() - 5_000_000_000,
                    ts1: request.ts1,
                    target_system: 0,
                    target_component: 0,
                }))
            }
            _ => None,
        }
    }

    /// Runs the check to its end; returns the findings, everything that it sent, and its duration (s).
    pub(super) fn run(&self) -> (Vec<Finding>, Vec<(u8, MavMessage)>, f64) {
        let config = Config::parse(Path::new("jink.toml"), &self.config).unwrap();
        let mut check = LinkCheck::new(Plan::of(&config).unwrap(), PATIENCE_S);
        if let Some(cause) = self.failure {
            check.link_failed(0, cause.to_owned());
        }
        let begin = Timestamp::from_seconds(BEGIN_S);
        let (mut out, mut sent) = (Vec::new(), Vec::new());
        let mut answers: Vec<(Timestamp, MavMessage)> = Vec::new();
        let mut asked = 0;
        for number in 0.. {
            let now = begin.plus_seconds(f64::from(number) * STEP_S);
            let message_of = |(system_id, component_id, message), time| Received {
                header: MavHeader {
                    system_id,
                    component_id,
                    sequence: 0,
                },
                content: Content::Message(message),
                time,
                link: 0,
            };
            for message in self.received(number) {
                check.take(&message_of(message, now));
            }
            for (time, message) in answers.extract_if(.., |(time, _)| *time <= now) {
                check.take(&message_of((u32::from(self.system_id), 1, message), time));
            }
            check.set_counts(0, self.counts);
            check.step(now, &mut out);
            for message in out.drain(..) {
                let Body::Message(body) = message.body else {
                    panic!("{message:?}");
                };
                asked += u32::from(matches!(body, MavMessage::TIMESYNC(_)));
                let answer = self.answer(&body, now, asked);
                answers.extend(answer.map(|answer| (now.plus_seconds(self.round_trip_s), answer)));
                sent.push((message.component_id, body));
            }
            if check.is_done(now) {
                return (check.findings(now), sent, f64::from(number) * STEP_S);
            }
        }
        panic!("the check never ends");
    }
}
