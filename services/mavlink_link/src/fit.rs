//! Whether the autopilot on the link takes what the profile sends, and which profile is for it.
//!
//! | autopilot | parameters | profile for it |
//! |---|---|---|
//! | ArduPilot | are not looked at | `ardupilot_guided` |
//! | PX4 | `COM_OBS_AVOID` is not 0 | `px4_trajectory` |
//! | PX4 | else `EAV_EN` is not 0 | `px4_deviation` |
//! | PX4 | else, where it can be flown in OFFBOARD (1.13 and its development, and later) | `px4_offboard` |
//!
//! A profile that is configured is held against the same params; what is found is a [`ProfileFit`]. Nothing is taken
//! for granted: until the parameters are known the profile is not proven, no setpoint leaves and component 196 is not
//! ACTIVE. A parameter counts as absent when the autopilot says so, or when it leaves a request unanswered several
//! times while it answers about another one. Desired paths prove `px4_trajectory` by
//! themselves.
//!
//! What was chosen stays for the whole run. If the parameters change, the profile does not fit any more, which is value; it
//! fits again when they change back.

use crate::autopilot_type::AutopilotType;
use crate::encoding::Encoding;
use crate::profile_name::ProfileName;
use crate::version::{FirmwareVersion, is_too_old};
use jink_shared_types::Timestamp;
use jink_shared_types::link::ProfileFit;
use mavlink::MessageData;
use mavlink::dialect::{
    AUTOPILOT_VERSION_DATA, COMMAND_LONG_DATA, MavAutopilot, MavCmd, MavMessage, PARAM_REQUEST_READ_DATA,
};

/// PX4 up to 1.15 asks a companion for trajectories if this is not 0.
pub const TRAJECTORY_SWITCH: &str = "COM_OBS_AVOID";
/// A PX4 with external avoidance takes velocities in its missions if this is not 0.
pub const DEVIATION_SWITCH: &str = "EAV_EN";
/// Stick speed with which a pilot takes over from OFFBOARD; negative: never.
pub const OVERRIDE_SPEED: &str = "MAN_OVERRIDE_SPD";
/// The same in older versions: bit 1 is OFFBOARD.
pub const OVERRIDE_BITS: &str = "COM_RC_OVERRIDE";
/// OFFBOARD in [`OVERRIDE_BITS`].
pub const OVERRIDE_IN_OFFBOARD: i64 = 1 << 1;
/// PX4's own collision prevention is on while this is above 0.
const PREVENTION: &str = "CP_DIST";
/// Every PX4 has this one: it is asked for as long as no other is answered. If one is answered and others are not, those do not exist.
const PROBE: usize = 3;
/// The questions of a round, in this order.
const FIT_QUERIES: [FitQuery; 5] = [
    FitQuery::Version,
    FitQuery::Parameter(0),
    FitQuery::Parameter(1),
    FitQuery::Parameter(2),
    FitQuery::Parameter(3),
];
/// The parameters asked for.
const NAMES: [&str; 4] = [TRAJECTORY_SWITCH, DEVIATION_SWITCH, PREVENTION, "MAV_SYS_ID"];
/// Pause between two questions (s): five of them and their answers in 0.25 s are a third of a line of 57600 bit/s.
const PAUSE_S: f64 = 0.05;
/// Pause between two rounds while the parameters are not known (s): longer than the way there and back on a slow line.
const ROUND_S: f64 = 0.4;
/// The same when they are, and do not fit (s): a correction on the ground is noticed soon.
const MENDED_S: f64 = 2.0;
/// A request left open in so many rounds in which another was answered concerns what does not exist.
const ROUNDS_TO_DENY: u8 = 3;

/// What is known of one parameter.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum ParamState {
    /// Not answered yet.
    #[default]
    Open,
    /// It has no such parameter.
    Absent,
    /// Its value.
    Value(f64),
}

impl ParamState {
    fn is_on(self) -> bool {
        matches!(self, Self::Value(value) if value != 0.0)
    }

    fn is_known(self) -> bool {
        self != Self::Open
    }
}

#[derive(Clone, Copy, Debug)]
enum FitQuery {
    Parameter(usize),
    Version,
}

/// Which profile is for the autopilot, as far as its answers query_message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MatchingProfile {
    /// Not known yet.
    Open,
    /// This one.
    Profile(ProfileName),
    /// None: neither PX4 nor ArduPilot, or too old.
    None,
}

/// What decides whether a profile fits, put together from the autopilot's answers.
#[derive(Clone, Debug, Default)]
pub struct Fit {
    autopilot_type: Option<Option<AutopilotType>>,
    autopilot: Option<MavAutopilot>,
    params: [ParamState; NAMES.len()],
    /// Rounds in which a request stayed open while another was answered.
    denied: [u8; NAMES.len()],
    version: Option<FirmwareVersion>,
    wants_trajectories: bool,
    next: usize,
    due: Timestamp,
    is_answered: bool,
}

impl Fit {
    /// Takes a message of the autopilot.
    #[allow(deprecated)] // TRAJECTORY_REPRESENTATION_WAYPOINTS is gone from PX4 1.16 on: its presence shows the version.
    pub fn take(&mut self, message: &MavMessage) {
        match message {
            MavMessage::HEARTBEAT(heartbeat) => {
                let autopilot_type = AutopilotType::of(heartbeat.autopilot);
                if self.autopilot_type.is_some_and(|before| before != autopilot_type) {
                    *self = Self::default();
                }
                self.autopilot_type = Some(autopilot_type);
                self.autopilot = Some(heartbeat.autopilot);
            }
            MavMessage::TRAJECTORY_REPRESENTATION_WAYPOINTS(_) => self.wants_trajectories = true,
            MavMessage::AUTOPILOT_VERSION(version) => {
                self.version = FirmwareVersion::of(version.flight_sw_version);
            }
            MavMessage::PARAM_VALUE(answer) => {
                let encoding = self.autopilot.map(Encoding::of);
                let value =
                    encoding.and_then(|encoding| encoding.take(answer.param_type, answer.param_value).ok());
                if let (Some(index), Some(value)) = (index_of(answer.param_id.to_str().ok()), value) {
                    self.is_answered = true;
                    self.wants_trajectories &= NAMES[index] != TRAJECTORY_SWITCH || value != 0.0;
                    self.params[index] = ParamState::Value(value);
                }
            }
            MavMessage::PARAM_ERROR(error) => {
                if let Some(index) = index_of(error.param_id.to_str().ok()) {
                    self.params[index] = ParamState::Absent;
                }
            }
            _ => {}
        }
    }

    /// The autopilot has started anew, perhaps with another firmware.
    pub fn restart(&mut self) {
        *self = Self {
            autopilot_type: self.autopilot_type,
            autopilot: self.autopilot,
            ..Self::default()
        };
    }

    /// The next question to the autopilot `target`, if one is due; `fits` is what is known of the profile so far.
    pub fn question(&mut self, now: Timestamp, fits: ProfileFit, target: (u8, u8)) -> Option<MavMessage> {
        if !self.is_asking(fits) || now < self.due {
            return None;
        }
        while let Some(question) = FIT_QUERIES.get(self.next) {
            self.next += 1;
            if self.is_worth_asking(*question, fits) {
                self.due = now.plus_seconds(PAUSE_S);
                return Some(query_message(*question, target));
            }
        }
        self.end_round();
        let is_mended = !matches!(fits, ProfileFit::Unknown | ProfileFit::Fits);
        self.due = now.plus_seconds(if is_mended { MENDED_S } else { ROUND_S });
        None
    }

    /// When [`Self::question`] has something to query_message next; `None` = never.
    pub fn next_wake(&self, fits: ProfileFit) -> Option<Timestamp> {
        self.is_asking(fits).then_some(self.due)
    }

    fn is_asking(&self, fits: ProfileFit) -> bool {
        let is_known = fits == ProfileFit::Fits && self.param(PREVENTION).is_known();
        self.autopilot_type == Some(Some(AutopilotType::Px4)) && !is_known
    }

    fn is_worth_asking(&self, question: FitQuery, fits: ProfileFit) -> bool {
        match question {
            // A value that did not fit may have been corrected.
            FitQuery::Parameter(index) => {
                let may_be_mended = !matches!(fits, ProfileFit::Unknown | ProfileFit::Fits);
                may_be_mended || index == self.probe() || !self.params[index].is_known()
            }
            FitQuery::Version => self.version.is_none(),
        }
    }

    /// The parameter that is asked for in each round, so that an answer shows that questions arrive: one that was answered before.
    fn probe(&self) -> usize {
        let has_value = |param: &ParamState| matches!(param, ParamState::Value(_));
        self.params.iter().position(has_value).unwrap_or(PROBE)
    }

    /// The first question about the profile that the autopilot has not answered; "anything" if it has answered none.
    pub fn unanswered(&self) -> &'static str {
        let open = self.params.iter().position(|param| !param.is_known());
        match open {
            Some(index) if self.params.iter().any(|param| param.is_known()) => NAMES[index],
            _ => "anything",
        }
    }

    /// What was requested and not answered, while another one was answered, does not exist.
    fn end_round(&mut self) {
        self.next = 0;
        if !std::mem::take(&mut self.is_answered) {
            return;
        }
        for (param, denied) in self.params.iter_mut().zip(&mut self.denied) {
            if *param == ParamState::Open {
                *denied = denied.saturating_add(1);
                if *denied >= ROUNDS_TO_DENY {
                    *param = ParamState::Absent;
                }
            }
        }
    }

    fn param(&self, name: &str) -> ParamState {
        index_of(Some(name)).map_or(ParamState::Open, |index| self.params[index])
    }

    /// The MAV_AUTOPILOT of its heartbeat; `None` before one was received.
    pub fn autopilot(&self) -> Option<MavAutopilot> {
        self.autopilot
    }

    /// Whether the autopilot is a PX4 whose own collision prevention is on.
    pub fn prevents_collisions(&self) -> bool {
        matches!(self.param(PREVENTION), ParamState::Value(distance_m) if distance_m > 0.0)
    }

    /// The profile that is for this autopilot.
    pub fn matching_profile(&self) -> MatchingProfile {
        match self.autopilot_type {
            None => MatchingProfile::Open,
            Some(None) => MatchingProfile::None,
            Some(Some(AutopilotType::ArduPilot)) => MatchingProfile::Profile(ProfileName::ArdupilotGuided),
            Some(Some(AutopilotType::Px4)) => self.matching_px4_profile(),
        }
    }

    fn matching_px4_profile(&self) -> MatchingProfile {
        let [trajectory, deviation] = [TRAJECTORY_SWITCH, DEVIATION_SWITCH].map(|name| self.param(name));
        if self.wants_trajectories || trajectory.is_on() {
            MatchingProfile::Profile(ProfileName::Px4Trajectory)
        } else if !trajectory.is_known() {
            MatchingProfile::Open
        } else if deviation.is_on() {
            MatchingProfile::Profile(ProfileName::Px4Deviation)
        } else if !deviation.is_known() {
            MatchingProfile::Open
        } else if self.is_too_old(ProfileName::Px4Offboard) {
            MatchingProfile::None
        } else {
            MatchingProfile::Profile(ProfileName::Px4Offboard)
        }
    }

    fn is_too_old(&self, profile: ProfileName) -> bool {
        self.version.is_some_and(|version| is_too_old(version, profile))
    }

    /// Whether `profile` fits.
    pub fn of(&self, profile: ProfileName) -> ProfileFit {
        let Some(autopilot_type) = self.autopilot_type else {
            return ProfileFit::Unknown;
        };
        if autopilot_type != Some(profile.autopilot_type()) {
            return ProfileFit::OtherAutopilot;
        }
        let [trajectory, deviation] = [TRAJECTORY_SWITCH, DEVIATION_SWITCH].map(|name| self.param(name));
        let by_switch = |param: ParamState| match param {
            ParamState::Open => ProfileFit::Unknown,
            ParamState::Absent => ProfileFit::NoInterface,
            ParamState::Value(0.0) => ProfileFit::SwitchedOff,
            ParamState::Value(_) => ProfileFit::Fits,
        };
        match profile {
            ProfileName::Px4Trajectory if self.wants_trajectories => ProfileFit::Fits,
            ProfileName::Px4Trajectory => by_switch(trajectory),
            ProfileName::Px4Deviation => by_switch(deviation),
            // With trajectories asked for, PX4 falls to Hold where it is to be taken over.
            ProfileName::Px4Offboard if self.wants_trajectories || trajectory.is_on() => {
                ProfileFit::OtherInterface
            }
            ProfileName::Px4Offboard if self.is_too_old(profile) => ProfileFit::TooOld,
            ProfileName::Px4Offboard if trajectory.is_known() => ProfileFit::Fits,
            ProfileName::Px4Offboard => ProfileFit::Unknown,
            ProfileName::ArdupilotGuided => ProfileFit::Fits,
        }
    }
}

fn index_of(name: Option<&str>) -> Option<usize> {
    NAMES.iter().position(|known| Some(*known) == name)
}

fn query_message(question: FitQuery, (target_system, target_component): (u8, u8)) -> MavMessage {
    match question {
        FitQuery::Parameter(index) => MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
            param_index: -1,
            target_system,
            target_component,
            param_id: NAMES[index].into(),
        }),
        FitQuery::Version => MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command: MavCmd::MAV_CMD_REQUEST_MESSAGE,
            param1: AUTOPILOT_VERSION_DATA::ID as f32,
            target_system,
            target_component,
            ..COMMAND_LONG_DATA::default()
        }),
    }
}
