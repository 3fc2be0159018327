//! Requests to the autopilot, and its answers.
//!
//! | request | how | why |
//! |---|---|---|
//! | its version | MAV_CMD_REQUEST_MESSAGE | whether the profile fits |
//! | TRAJECTORY_REPRESENTATION_WAYPOINTS, at its own rate (`px4_trajectory`) | MAV_CMD_SET_MESSAGE_INTERVAL | a PX4 without the interface rejects it in any mode |
//! | parameters by name | PARAM_REQUEST_READ | those that affect what jink does |
//! | streams that do not come by themselves | as the gateway does ([`Streams`]) | whether the line carries them |
//! | the time | TIMESYNC, as the gateway does ([`ClockMap`]) | whether it answers, and how soon |
//!
//! Nothing here changes a parameter, a mode or the motors. Each request is repeated, and given up after the third time.

use super::limits::{ATTEMPTS_MAX, REQUEST_PAUSE_S, RETRY_S};
use jink_mavlink_link::autopilot_type::AutopilotType;
use jink_mavlink_link::clock_map::nanoseconds;
use jink_mavlink_link::clock_map::{ClockMap, SEARCHING_HZ};
use jink_mavlink_link::encoding::Encoding;
use jink_mavlink_link::fit::TRAJECTORY_SWITCH;
use jink_mavlink_link::fit::{OVERRIDE_BITS, OVERRIDE_SPEED};
use jink_mavlink_link::message::{COMPONENT_AUTOPILOT, COMPONENT_ONBOARD_COMPUTER};
use jink_mavlink_link::profile_name::ProfileName;
use jink_mavlink_link::streams::{StreamRate, Streams};
use jink_mavlink_link::ticker::Ticker;
use jink_mavlink_link::version::FirmwareVersion;
use jink_shared_types::Timestamp;
use jink_shared_types::vehicle::NavMode;
#[allow(deprecated)] // Gone from PX4 1.16 on: that is what is found out with it.
use mavlink::dialect::TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA;
use mavlink::dialect::{
    AUTOPILOT_VERSION_DATA, COMMAND_ACK_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA, MavCmd, MavMessage,
    MavResult, PARAM_REQUEST_READ_DATA, TIMESYNC_DATA,
};
use mavlink::{Message, MessageData};

/// Interval of the desired path (us): PX4's own.
const DESIRED_PATH_US: f32 = 200_000.0;

/// The subject of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ProbeItem {
    Version,
    DesiredPath,
    Parameter(&'static str),
}

/// The result of a request.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ProbeResult {
    /// Not answered yet.
    Pending,
    /// Given up.
    Unanswered,
    /// Answered with no.
    Denied,
    /// Answered with yes.
    Accepted,
    /// The parameter's value.
    Value(f64),
}

#[derive(Clone, Copy, Debug)]
struct ProbeRequest {
    item: ProbeItem,
    attempts: u8,
    retry_at: Timestamp,
    result: ProbeResult,
}

/// The parameters that affect flights with `profile`. Of those that were renamed both names are requested.
pub fn parameters(profile: ProfileName) -> &'static [&'static str] {
    match profile {
        ProfileName::Px4Trajectory => &[
            "COM_OBS_AVOID",
            "MPC_XY_CRUISE",
            "MPC_ACC_HOR",
            "MPC_JERK_AUTO",
            "NAV_ACC_RAD",
            "CP_DIST",
            "MPC_POS_MODE",
        ],
        ProfileName::Px4Offboard => &[
            "COM_OBS_AVOID",
            "COM_OF_LOSS_T",
            "COM_OBL_RC_ACT",
            "COM_OBL_ACT",
            "MPC_XY_VEL_MAX",
            "CP_DIST",
            OVERRIDE_SPEED,
            OVERRIDE_BITS,
        ],
        ProfileName::Px4Deviation => &[
            "EAV_EN",
            "EAV_TIMEOUT",
            "NAV_ACC_RAD",
            "MPC_XY_VEL_MAX",
            "CP_DIST",
        ],
        ProfileName::ArdupilotGuided => &[
            "GUID_TIMEOUT",
            "GUID_OPTIONS",
            "WPNAV_SPEED",
            "WP_SPD",
            "WPNAV_ACCEL",
            "WP_ACC",
            "PSC_JERK_XY",
            "PSC_JERK_NE",
            "ANGLE_MAX",
            "ATC_ANGLE_MAX",
            "MIS_RESTART",
            "PRX1_TYPE",
            "PRX_FILT",
            "AVOID_ENABLE",
            "OA_TYPE",
            "FS_GCS_ENABLE",
        ],
    }
}

/// The conversation with one autopilot.
#[derive(Debug)]
pub struct ActiveProbe {
    system_id: u8,
    /// Its last heartbeat.
    pub heartbeat: HEARTBEAT_DATA,
    /// Its last message.
    pub last: Timestamp,
    /// The version that it reports.
    pub version: Option<FirmwareVersion>,
    profile: Option<ProfileName>,
    since: Timestamp,
    requests: Vec<ProbeRequest>,
    next_request: Timestamp,
    streams: Streams,
    streams_begun: bool,
    clock: ClockMap,
    timesync: Ticker,
    answers: u32,
}

impl ActiveProbe {
    /// For the autopilot of `system_id`, whose first `heartbeat` was received at `since`. `profile`: `None` while it is
    /// not known which one is checked.
    pub fn new(
        system_id: u8,
        heartbeat: HEARTBEAT_DATA,
        since: Timestamp,
        profile: Option<ProfileName>,
    ) -> Self {
        let fitting = profile.filter(|profile| autopilot_type(&heartbeat) == Some(profile.autopilot_type()));
        let mut items = vec![ProbeItem::Version];
        if fitting == Some(ProfileName::Px4Trajectory) {
            items.push(ProbeItem::DesiredPath);
        }
        if let Some(profile) = fitting {
            items.extend(parameters(profile).iter().map(|name| ProbeItem::Parameter(name)));
        }
        let open = |item| ProbeRequest {
            item,
            attempts: 0,
            retry_at: Timestamp::NEVER,
            result: ProbeResult::Pending,
        };
        Self {
            system_id,
            heartbeat,
            last: since,
            version: None,
            profile,
            since,
            requests: items.into_iter().map(open).collect(),
            next_request: Timestamp::NEVER,
            streams: Streams::new(profile.unwrap_or(ProfileName::Px4Trajectory)),
            streams_begun: false,
            clock: ClockMap::default(),
            timesync: Ticker::new(SEARCHING_HZ),
            answers: 0,
        }
    }

    /// Its system id.
    pub fn system_id(&self) -> u8 {
        self.system_id
    }

    /// The type of its firmware; `None` = neither PX4 nor ArduPilot.
    pub fn autopilot_type(&self) -> Option<AutopilotType> {
        autopilot_type(&self.heartbeat)
    }

    /// Whether it is of the type that the profile is for.
    pub fn matches_profile(&self) -> bool {
        self.profile
            .is_some_and(|profile| self.autopilot_type() == Some(profile.autopilot_type()))
    }

    /// The mode it is in.
    pub fn mode(&self) -> NavMode {
        let autopilot = self.autopilot_type();
        autopilot.map_or(NavMode::Unknown, |autopilot| {
            autopilot.nav_mode(self.heartbeat.custom_mode)
        })
    }

    /// How long ago it was first received (s).
    pub fn age_s(&self, now: Timestamp) -> f64 {
        now.seconds_since(self.since)
    }

    /// How many of our requests of any kind it has answered.
    pub fn answers(&self) -> u32 {
        self.answers + self.clock.samples()
    }

    /// Requests answered or given up, and all requests.
    pub fn progress(&self) -> (usize, usize) {
        let done = self
            .requests
            .iter()
            .filter(|request| request.result != ProbeResult::Pending);
        (done.count(), self.requests.len())
    }

    /// The clocks.
    pub fn clock(&self) -> &ClockMap {
        &self.clock
    }

    /// Whether the desired path may be had ([`ProbeResult::Accepted`]).
    pub fn desired_path(&self) -> ProbeResult {
        self.result(ProbeItem::DesiredPath)
    }

    /// The value of a parameter.
    pub fn parameter(&self, name: &'static str) -> ProbeResult {
        self.result(ProbeItem::Parameter(name))
    }

    /// Whether any parameter could be read.
    pub fn reads_parameters(&self) -> bool {
        self.requests
            .iter()
            .any(|request| matches!(request.result, ProbeResult::Value(_)))
    }

    /// The streams as they came last, without those that this mode does not have.
    pub fn streams(&self) -> impl Iterator<Item = StreamRate> {
        let automatic = self.mode().is_automatic();
        let is_off = self.parameter(TRAJECTORY_SWITCH) == ProbeResult::Value(0.0);
        #[allow(deprecated)]
        let is_asked_for = move |rate: &StreamRate| {
            rate.message_id != TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA::ID || automatic && !is_off
        };
        self.streams.rates().filter(is_asked_for)
    }

    /// Whether nothing more is to be learned.
    pub fn is_settled(&self) -> bool {
        let answered = self
            .requests
            .iter()
            .all(|request| request.result != ProbeResult::Pending);
        if !self.matches_profile() {
            return answered;
        }
        let mut streams = self.streams().peekable();
        let flow = streams.peek().is_some() && streams.all(|rate| !rate.is_short);
        answered && flow && self.clock.is_converged()
    }

    fn result(&self, item: ProbeItem) -> ProbeResult {
        let found = self.requests.iter().find(|request| request.item == item);
        found.map_or(ProbeResult::Unanswered, |request| request.result)
    }

    fn settle(&mut self, item: ProbeItem, result: ProbeResult) {
        let open = self
            .requests
            .iter_mut()
            .find(|request| request.item == item && request.attempts > 0);
        if let Some(request) = open {
            request.result = result;
            self.answers += 1;
        }
    }

    /// Takes one of its messages.
    pub fn take(&mut self, time: Timestamp, message: &MavMessage) {
        self.last = time;
        if self.streams_begun {
            self.streams.arrived(message.message_id());
        }
        match message {
            MavMessage::HEARTBEAT(heartbeat) => self.heartbeat = heartbeat.clone(),
            MavMessage::AUTOPILOT_VERSION(version) => {
                self.version = FirmwareVersion::of(version.flight_sw_version);
                self.settle(ProbeItem::Version, ProbeResult::Accepted);
            }
            MavMessage::COMMAND_ACK(ack) => self.take_ack(time, ack),
            MavMessage::PARAM_VALUE(value) => {
                let encoding = Encoding::of(self.heartbeat.autopilot);
                if let Some(name) = self.asked_parameter(value.param_id.to_str().ok())
                    && let Ok(number) = encoding.take(value.param_type, value.param_value)
                {
                    self.settle(ProbeItem::Parameter(name), ProbeResult::Value(number));
                }
            }
            MavMessage::PARAM_ERROR(error) => {
                if let Some(name) = self.asked_parameter(error.param_id.to_str().ok()) {
                    self.settle(ProbeItem::Parameter(name), ProbeResult::Denied);
                }
            }
            MavMessage::TIMESYNC(sync) if sync.tc1 != 0 => self.clock.on_response(time, sync.tc1, sync.ts1),
            _ => {}
        }
    }

    fn asked_parameter(&self, reported: Option<&str>) -> Option<&'static str> {
        let names = self.profile.map_or(&[][..], parameters).iter();
        names.copied().find(|name| Some(*name) == reported)
    }

    /// Before the streams are requested an answer to a command belongs to a request, from then on to the streams.
    fn take_ack(&mut self, now: Timestamp, ack: &COMMAND_ACK_DATA) {
        if ack.target_component != 0 && ack.target_component != OWN_COMPONENT {
            return;
        }
        if self.streams_begun {
            self.answers += 1;
            self.streams.answered(now, ack);
            return;
        }
        let granted = ack.result == MavResult::MAV_RESULT_ACCEPTED;
        match ack.command {
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL if granted => {
                self.settle(ProbeItem::DesiredPath, ProbeResult::Accepted);
            }
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => self.settle(ProbeItem::DesiredPath, ProbeResult::Denied),
            MavCmd::MAV_CMD_REQUEST_MESSAGE if !granted => {
                self.settle(ProbeItem::Version, ProbeResult::Denied);
            }
            _ => {}
        }
    }

    /// Appends what is to be sent now.
    pub fn send(&mut self, now: Timestamp, out: &mut Vec<MavMessage>) {
        if let Some(message) = self.next_request(now) {
            out.push(message);
        }
        if !self.matches_profile() {
            return;
        }
        if self.timesync.take(now) {
            self.clock.request(now);
            out.push(MavMessage::TIMESYNC(TIMESYNC_DATA {
                tc1: 0,
                ts1: nanoseconds(now),
                target_system: self.system_id,
                target_component: COMPONENT_AUTOPILOT,
            }));
        }
        let is_command = |request: &ProbeRequest| !matches!(request.item, ProbeItem::Parameter(_));
        self.streams_begun |= !self
            .requests
            .iter()
            .any(|request| is_command(request) && request.result == ProbeResult::Pending);
        if self.streams_begun {
            let mode = self.mode();
            out.extend(
                self.streams
                    .request(now, mode, (self.system_id, COMPONENT_AUTOPILOT)),
            );
        }
    }

    fn next_request(&mut self, now: Timestamp) -> Option<MavMessage> {
        if now < self.next_request {
            return None;
        }
        let due = self
            .requests
            .iter_mut()
            .find(|request| request.result == ProbeResult::Pending && now >= request.retry_at)?;
        if due.attempts == ATTEMPTS_MAX {
            due.result = ProbeResult::Unanswered;
            return None;
        }
        due.attempts += 1;
        due.retry_at = now.plus_seconds(RETRY_S);
        self.next_request = now.plus_seconds(REQUEST_PAUSE_S);
        let item = due.item;
        Some(self.message_for(item))
    }

    #[allow(deprecated)]
    fn message_for(&self, item: ProbeItem) -> MavMessage {
        let command = |command, param1, param2| {
            MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
                command,
                param1,
                param2,
                target_system: self.system_id,
                target_component: COMPONENT_AUTOPILOT,
                ..COMMAND_LONG_DATA::default()
            })
        };
        match item {
            ProbeItem::Version => command(
                MavCmd::MAV_CMD_REQUEST_MESSAGE,
                AUTOPILOT_VERSION_DATA::ID as f32,
                0.0,
            ),
            ProbeItem::DesiredPath => command(
                MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
                TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA::ID as f32,
                DESIRED_PATH_US,
            ),
            ProbeItem::Parameter(name) => MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
                param_index: -1,
                target_system: self.system_id,
                target_component: COMPONENT_AUTOPILOT,
                param_id: name.into(),
            }),
        }
    }
}

/// The component id of the check: it is no obstacle avoidance, so that no autopilot takes it for one.
pub const OWN_COMPONENT: u8 = COMPONENT_ONBOARD_COMPUTER;

fn autopilot_type(heartbeat: &HEARTBEAT_DATA) -> Option<AutopilotType> {
    AutopilotType::of(heartbeat.autopilot)
}
