//! What the autopilot is asked, and what it has answered.
//!
//! | asked for | how | why |
//! |---|---|---|
//! | its version | MAV_CMD_REQUEST_MESSAGE | whether the profile fits |
//! | TRAJECTORY_REPRESENTATION_WAYPOINTS, at its own rate (`px4_trajectory`) | MAV_CMD_SET_MESSAGE_INTERVAL | a PX4 without the interface refuses it in any mode |
//! | parameters by name | PARAM_REQUEST_READ | those that bear on what jink does |
//! | streams that do not come by themselves | as the gateway does ([`Streams`]) | whether the line carries them |
//! | the time | TIMESYNC, as the gateway does ([`ClockMap`]) | whether it answers, and how soon |
//!
//! Nothing here changes a parameter, a mode or the motors. Each question is repeated, and given up after the third time.

use super::limits::{ASK_AGAIN_S, ASK_PAUSE_S, ASKS_MAX};
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
use mavlink::dialects::ardupilotmega::TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA;
use mavlink::dialects::ardupilotmega::{
    AUTOPILOT_VERSION_DATA, COMMAND_ACK_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA, MavCmd, MavMessage,
    MavResult, PARAM_REQUEST_READ_DATA, TIMESYNC_DATA,
};
use mavlink::{Message, MessageData};

/// Interval of the desired path (us): PX4's own.
const DESIRED_PATH_US: f32 = 200_000.0;

/// One question.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ask {
    Version,
    DesiredPath,
    Parameter(&'static str),
}

/// What became of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Answer {
    /// Not answered yet.
    Open,
    /// Given up.
    None,
    /// Answered with no.
    Refused,
    /// Answered with yes.
    Granted,
    /// The parameter's value.
    Value(f64),
}

#[derive(Clone, Copy, Debug)]
struct Question {
    ask: Ask,
    asked: u8,
    again_at: Timestamp,
    answer: Answer,
}

/// The parameters that bear on what jink does beside `profile`. Of those that were renamed both names are asked for.
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
pub struct Interview {
    system_id: u8,
    /// Its last heartbeat.
    pub heartbeat: HEARTBEAT_DATA,
    /// Its last message.
    pub last: Timestamp,
    /// What it says of its version.
    pub version: Option<FirmwareVersion>,
    profile: Option<ProfileName>,
    since: Timestamp,
    questions: Vec<Question>,
    next_question: Timestamp,
    streams: Streams,
    streams_begun: bool,
    clock: ClockMap,
    timesync: Ticker,
    answers: u32,
}

impl Interview {
    /// With the autopilot of `system_id`, which was first heard at `since` saying `heartbeat`. `profile`: `None` while it is not
    /// known which one is examined.
    pub fn new(
        system_id: u8,
        heartbeat: HEARTBEAT_DATA,
        since: Timestamp,
        profile: Option<ProfileName>,
    ) -> Self {
        let fitting = profile.filter(|profile| make(&heartbeat) == Some(profile.autopilot_type()));
        let mut asks = vec![Ask::Version];
        if fitting == Some(ProfileName::Px4Trajectory) {
            asks.push(Ask::DesiredPath);
        }
        if let Some(profile) = fitting {
            asks.extend(parameters(profile).iter().map(|name| Ask::Parameter(name)));
        }
        let open = |ask| Question {
            ask,
            asked: 0,
            again_at: Timestamp::NEVER,
            answer: Answer::Open,
        };
        Self {
            system_id,
            heartbeat,
            last: since,
            version: None,
            profile,
            since,
            questions: asks.into_iter().map(open).collect(),
            next_question: Timestamp::NEVER,
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

    /// Whose firmware it is; `None` = of neither.
    pub fn make(&self) -> Option<AutopilotType> {
        make(&self.heartbeat)
    }

    /// Whether it is of the make that the profile is for.
    pub fn is_of_fitting_make(&self) -> bool {
        self.profile
            .is_some_and(|profile| self.make() == Some(profile.autopilot_type()))
    }

    /// The mode it is in.
    pub fn mode(&self) -> NavMode {
        let make = self.make();
        make.map_or(NavMode::Unknown, |make| make.nav_mode(self.heartbeat.custom_mode))
    }

    /// How long it has been known (s).
    pub fn age_s(&self, now: Timestamp) -> f64 {
        now.seconds_since(self.since)
    }

    /// How many of our questions of any kind it has answered.
    pub fn answers(&self) -> u32 {
        self.answers + self.clock.samples()
    }

    /// Parameters read or given up, and all that are asked for.
    pub fn progress(&self) -> (usize, usize) {
        let done = self
            .questions
            .iter()
            .filter(|question| question.answer != Answer::Open);
        (done.count(), self.questions.len())
    }

    /// The clocks.
    pub fn clock(&self) -> &ClockMap {
        &self.clock
    }

    /// Whether the desired path may be had ([`Answer::Granted`]).
    pub fn desired_path(&self) -> Answer {
        self.answer(Ask::DesiredPath)
    }

    /// The value of a parameter.
    pub fn parameter(&self, name: &'static str) -> Answer {
        self.answer(Ask::Parameter(name))
    }

    /// Whether any parameter could be read.
    pub fn reads_parameters(&self) -> bool {
        self.questions
            .iter()
            .any(|question| matches!(question.answer, Answer::Value(_)))
    }

    /// The streams as they came last, without those that this mode does not have.
    pub fn streams(&self) -> impl Iterator<Item = StreamRate> {
        let automatic = self.mode().is_automatic();
        let is_off = self.parameter(TRAJECTORY_SWITCH) == Answer::Value(0.0);
        #[allow(deprecated)]
        let is_asked_for = move |rate: &StreamRate| {
            rate.message_id != TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA::ID || automatic && !is_off
        };
        self.streams.rates().filter(is_asked_for)
    }

    /// Whether nothing more is to be learned.
    pub fn is_settled(&self) -> bool {
        let answered = self
            .questions
            .iter()
            .all(|question| question.answer != Answer::Open);
        if !self.is_of_fitting_make() {
            return answered;
        }
        let mut streams = self.streams().peekable();
        let flow = streams.peek().is_some() && streams.all(|rate| !rate.is_short);
        answered && flow && self.clock.is_converged()
    }

    fn answer(&self, ask: Ask) -> Answer {
        let asked = self.questions.iter().find(|question| question.ask == ask);
        asked.map_or(Answer::None, |question| question.answer)
    }

    fn settle(&mut self, ask: Ask, answer: Answer) {
        let open = self
            .questions
            .iter_mut()
            .find(|question| question.ask == ask && question.asked > 0);
        if let Some(question) = open {
            question.answer = answer;
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
                self.settle(Ask::Version, Answer::Granted);
            }
            MavMessage::COMMAND_ACK(ack) => self.take_ack(time, ack),
            MavMessage::PARAM_VALUE(value) => {
                let encoding = Encoding::of(self.heartbeat.autopilot);
                if let Some(name) = self.asked_parameter(value.param_id.to_str().ok())
                    && let Ok(number) = encoding.take(value.param_type, value.param_value)
                {
                    self.settle(Ask::Parameter(name), Answer::Value(number));
                }
            }
            MavMessage::PARAM_ERROR(error) => {
                if let Some(name) = self.asked_parameter(error.param_id.to_str().ok()) {
                    self.settle(Ask::Parameter(name), Answer::Refused);
                }
            }
            MavMessage::TIMESYNC(sync) if sync.tc1 != 0 => self.clock.on_response(time, sync.tc1, sync.ts1),
            _ => {}
        }
    }

    fn asked_parameter(&self, told: Option<&str>) -> Option<&'static str> {
        let names = self.profile.map_or(&[][..], parameters).iter();
        names.copied().find(|name| Some(*name) == told)
    }

    /// An answer to a command belongs to the question before the streams are asked for, and to them from then on.
    fn take_ack(&mut self, now: Timestamp, ack: &COMMAND_ACK_DATA) {
        if ack.target_component != 0 && ack.target_component != ASKER {
            return;
        }
        if self.streams_begun {
            self.answers += 1;
            self.streams.answered(now, ack);
            return;
        }
        let granted = ack.result == MavResult::MAV_RESULT_ACCEPTED;
        match ack.command {
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL if granted => self.settle(Ask::DesiredPath, Answer::Granted),
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => self.settle(Ask::DesiredPath, Answer::Refused),
            MavCmd::MAV_CMD_REQUEST_MESSAGE if !granted => self.settle(Ask::Version, Answer::Refused),
            _ => {}
        }
    }

    /// Appends what is to be sent now.
    pub fn speak(&mut self, now: Timestamp, out: &mut Vec<MavMessage>) {
        if let Some(message) = self.next_question(now) {
            out.push(message);
        }
        if !self.is_of_fitting_make() {
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
        let is_command = |question: &Question| !matches!(question.ask, Ask::Parameter(_));
        self.streams_begun |= !self
            .questions
            .iter()
            .any(|question| is_command(question) && question.answer == Answer::Open);
        if self.streams_begun {
            let mode = self.mode();
            out.extend(
                self.streams
                    .request(now, mode, (self.system_id, COMPONENT_AUTOPILOT)),
            );
        }
    }

    fn next_question(&mut self, now: Timestamp) -> Option<MavMessage> {
        if now < self.next_question {
            return None;
        }
        let due = self
            .questions
            .iter_mut()
            .find(|question| question.answer == Answer::Open && now >= question.again_at)?;
        if due.asked == ASKS_MAX {
            due.answer = Answer::None;
            return None;
        }
        due.asked += 1;
        due.again_at = now.plus_seconds(ASK_AGAIN_S);
        self.next_question = now.plus_seconds(ASK_PAUSE_S);
        let ask = due.ask;
        Some(self.say(ask))
    }

    #[allow(deprecated)]
    fn say(&self, ask: Ask) -> MavMessage {
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
        match ask {
            Ask::Version => command(
                MavCmd::MAV_CMD_REQUEST_MESSAGE,
                AUTOPILOT_VERSION_DATA::ID as f32,
                0.0,
            ),
            Ask::DesiredPath => command(
                MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
                TRAJECTORY_REPRESENTATION_WAYPOINTS_DATA::ID as f32,
                DESIRED_PATH_US,
            ),
            Ask::Parameter(name) => MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
                param_index: -1,
                target_system: self.system_id,
                target_component: COMPONENT_AUTOPILOT,
                param_id: name.into(),
            }),
        }
    }
}

/// The component that asks: it is no obstacle avoidance, so that no autopilot takes it for one.
pub const ASKER: u8 = COMPONENT_ONBOARD_COMPUTER;

fn make(heartbeat: &HEARTBEAT_DATA) -> Option<AutopilotType> {
    AutopilotType::of(heartbeat.autopilot)
}
