//! How setpoints are spoken: one trait, chosen by configuration, never mixed within one flight.

pub mod curve;
pub mod lead;
pub mod pilot;
pub mod position_target;
pub mod px4_trajectory;

use pilot::{Nearness, Source};
use position_target::PositionTarget;
use px4_trajectory::Px4Trajectory;

use crate::make::Make;
use crate::vehicle::Present;
use jink_shared_types::motion::ApprovedTrajectory;
use jink_shared_types::vehicle::{DesiredPath, NavMode};
use jink_shared_types::{Reading, SampleHeader, Timestamp};
use mavlink::dialects::ardupilotmega::MavMessage;
use std::fmt;
use std::str::FromStr;

/// Everything a setpoint may depend on.
#[derive(Clone, Copy, Debug)]
pub struct Situation<'a> {
    /// Now.
    pub now: Timestamp,
    /// Where the vehicle is; `None` before the first position.
    pub vehicle: Option<Present>,
    /// Its system id.
    pub system_id: u8,
    /// Mode in force.
    pub mode: NavMode,
    /// It has taken off, as the autopilot says.
    pub in_air: bool,
    /// What is sent is flown ([`Profile::listens`]), or is about to be.
    pub is_flown: bool,
    /// With which velocity PX4 corrects each metre beside the reference (1/s): its `MPC_XY_P`, and that of who does it in its stead.
    pub position_gain_per_s: f64,
    /// A radio carries what is sent: what says nothing new waits for the beat of the stream.
    pub spares_radio: bool,
    /// What the autopilot wants, if that was asked for in the mode in force by an autopilot that is alive.
    pub desired: Option<&'a DesiredPath>,
    /// What the guard lets through.
    pub approved: Reading<'a, ApprovedTrajectory>,
}

/// A setpoint ready to be sent.
#[derive(Clone, Debug)]
pub struct Setpoint {
    /// The message.
    pub message: MavMessage,
    /// What it was made from.
    pub source: Source,
    /// Of the approved trajectory, if this is the first setpoint cut from it.
    pub first_of: Option<SampleHeader>,
}

/// A way of speaking to an autopilot.
pub trait Profile: fmt::Debug + Send {
    /// Whether the autopilot flies in this mode what it is sent. It may in one that is not known yet, or has no name here.
    fn listens(&self, mode: NavMode) -> bool;

    /// Takes note of the inputs, at every step. Returns `true` if there is a new trajectory that should not wait
    /// for the beat of the stream.
    fn observe(&mut self, situation: &Situation<'_>) -> bool;

    /// Of the trajectory observed last, if the autopilot flies what it says already, so that nothing of it need be sent.
    fn told(&self) -> Option<SampleHeader> {
        None
    }

    /// The setpoint for now; `None` only while no position was ever known, for a moment after the start in which the
    /// guard may yet be heard, and before the vehicle is in the air if it [waits for that](Profile::waits_for_air).
    fn setpoint(&mut self, situation: &Situation<'_>) -> Option<Setpoint>;

    /// Whether nothing is sent before the vehicle is in the air: the first setpoint would break its take-off off.
    fn waits_for_air(&self) -> bool {
        false
    }

    /// How what was sent last lies to the vehicle.
    fn nearness(&self) -> Nearness {
        Nearness::Apart
    }

    /// What an autopilot must hear once before the first setpoint.
    fn greeting(&self) -> Option<MavMessage> {
        None
    }

    /// The autopilot has started anew: every coordinate held so far means nothing any more.
    fn reset(&mut self);
}

/// The profiles there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProfileName {
    /// PX4 1.11 to 1.15 with `COM_OBS_AVOID=1`: TRAJECTORY_REPRESENTATION_BEZIER or _WAYPOINTS.
    Px4Trajectory,
    /// PX4 1.13 and later in OFFBOARD: SET_POSITION_TARGET_LOCAL_NED.
    Px4Offboard,
    /// PX4 in its own mission with `EAV_EN=1`, as proposed for it: velocities and accelerations in SET_POSITION_TARGET_LOCAL_NED.
    Px4Deviation,
    /// ArduCopter in GUIDED: SET_POSITION_TARGET_LOCAL_NED.
    ArdupilotGuided,
}

/// Which of the two messages `px4_trajectory` sends: one for the whole flight, never both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Representation {
    /// Curves in time: the motion itself.
    #[default]
    Bezier,
    /// Points with a velocity: the target of PX4's own smoothing.
    Waypoints,
}

/// Every profile with its name in the configuration.
const NAMES: [(&str, ProfileName); 4] = [
    ("px4_trajectory", ProfileName::Px4Trajectory),
    ("px4_offboard", ProfileName::Px4Offboard),
    ("px4_deviation", ProfileName::Px4Deviation),
    ("ardupilot_guided", ProfileName::ArdupilotGuided),
];

/// Rate of the stream of positions, velocities and accelerations (Hz): the reference flights were flown with it; nothing smooths
/// between two of them.
const FOLLOWED_RATE_HZ: f64 = 50.0;

/// Every representation with its name in the configuration.
const REPRESENTATIONS: [(&str, Representation); 2] = [
    ("bezier", Representation::Bezier),
    ("waypoints", Representation::Waypoints),
];

/// A name in the configuration that means nothing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownName {
    /// What was to be named.
    pub what: &'static str,
    /// What was asked for.
    pub name: String,
    /// What there is.
    pub known: Vec<&'static str>,
}

impl fmt::Display for UnknownName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { what, name, known } = self;
        write!(f, "unknown {what} {name}; there are: {}", known.join(" "))
    }
}
impl std::error::Error for UnknownName {}

fn named<T: Copy>(what: &'static str, text: &str, all: &[(&'static str, T)]) -> Result<T, UnknownName> {
    let found = all.iter().find(|(name, _)| *name == text);
    found.map(|(_, value)| *value).ok_or_else(|| UnknownName {
        what,
        name: text.to_owned(),
        known: all.iter().map(|(name, _)| *name).collect(),
    })
}

impl FromStr for ProfileName {
    type Err = UnknownName;
    fn from_str(text: &str) -> Result<Self, UnknownName> {
        named("profile", text, &NAMES)
    }
}

/// What the configuration says in place of a profile's name to have it chosen by what the autopilot is.
const CHOSEN_BY_JINK: &str = "auto";

/// Which profile is flown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProfileChoice {
    /// The one that is for the autopilot on the link.
    Auto,
    /// This one.
    Fixed(ProfileName),
}

impl FromStr for ProfileChoice {
    type Err = UnknownName;
    fn from_str(text: &str) -> Result<Self, UnknownName> {
        if text == CHOSEN_BY_JINK {
            return Ok(Self::Auto);
        }
        text.parse()
            .map(Self::Fixed)
            .map_err(|error: UnknownName| UnknownName {
                known: std::iter::once(CHOSEN_BY_JINK).chain(error.known).collect(),
                ..error
            })
    }
}

impl FromStr for Representation {
    type Err = UnknownName;
    fn from_str(text: &str) -> Result<Self, UnknownName> {
        named("output", text, &REPRESENTATIONS)
    }
}

impl Representation {
    /// Its name in the configuration.
    pub fn name(self) -> &'static str {
        let known = REPRESENTATIONS.iter().find(|(_, one)| *one == self);
        known.map_or("", |(name, _)| name)
    }
}

impl ProfileName {
    /// The profile; where it speaks in curves, these last `horizon_s`, or down to `shortest_s`.
    pub fn build(self, representation: Representation, horizon_s: f64, shortest_s: f64) -> Box<dyn Profile> {
        match self {
            ProfileName::Px4Trajectory => Box::new(Px4Trajectory::new(representation, horizon_s, shortest_s)),
            ProfileName::Px4Offboard => Box::new(PositionTarget::px4()),
            ProfileName::Px4Deviation => Box::new(PositionTarget::px4_deviation()),
            ProfileName::ArdupilotGuided => Box::new(PositionTarget::arducopter()),
        }
    }

    /// Its name in the configuration.
    pub fn name(self) -> &'static str {
        let row = NAMES.iter().find(|(_, profile)| *profile == self);
        row.map_or("", |(name, _)| name)
    }

    /// Whose autopilots it is for.
    pub fn make(self) -> Make {
        match self {
            Self::Px4Trajectory | Self::Px4Offboard | Self::Px4Deviation => Make::Px4,
            Self::ArdupilotGuided => Make::ArduPilot,
        }
    }

    /// Whether the autopilot only follows setpoints, so that jink flies the mission in its stead.
    pub fn flies_the_mission(self) -> bool {
        matches!(self, ProfileName::Px4Offboard | ProfileName::ArdupilotGuided)
    }

    /// Whether a pilot may steer through jink: the autopilot takes velocities in his modes.
    pub fn steers(self) -> bool {
        self == ProfileName::Px4Deviation
    }

    /// Whether a pilot may be assisted: the autopilot follows setpoints in a mode of its own.
    pub fn assists(self) -> bool {
        self.flies_the_mission()
    }

    /// Whether a station's go-to reaches the autopilot without a change of mode, and shows until the next setpoint.
    pub fn sees_go_to(self) -> bool {
        self == ProfileName::ArdupilotGuided
    }

    /// Whether jink reads the mission to know the way: the autopilot does not tell it.
    pub fn reads_the_mission(self) -> bool {
        self != ProfileName::Px4Trajectory
    }

    /// Rate of the setpoint stream (Hz); `chosen_hz` where the profile leaves the choice.
    pub fn rate_hz(self, chosen_hz: f64) -> f64 {
        match self {
            ProfileName::Px4Trajectory => chosen_hz,
            ProfileName::Px4Offboard | ProfileName::Px4Deviation | ProfileName::ArdupilotGuided => {
                FOLLOWED_RATE_HZ
            }
        }
    }
}
