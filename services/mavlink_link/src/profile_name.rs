//! The profiles: ways to command an autopilot, by their names in the configuration.

use crate::autopilot_type::AutopilotType;
use jink_shared_types::tracking::Tracking;
use std::fmt;
use std::str::FromStr;

/// The profiles there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProfileName {
    /// PX4 1.11 to 1.15 with `COM_OBS_AVOID=1`: TRAJECTORY_REPRESENTATION_BEZIER or _WAYPOINTS.
    Px4Trajectory,
    /// PX4 1.13 and later in OFFBOARD: SET_POSITION_TARGET_LOCAL_NED.
    Px4Offboard,
    /// PX4 in its own mission with `EAV_EN=1`, as proposed for it: velocities and accelerations in
    /// SET_POSITION_TARGET_LOCAL_NED.
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

/// Rate of the stream of positions, velocities and accelerations (Hz): the reference flights were flown with it;
/// nothing smooths between two of them.
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

/// The word in the configuration that lets jink choose the profile by the autopilot's type.
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
    /// Its name in the configuration.
    pub fn name(self) -> &'static str {
        let row = NAMES.iter().find(|(_, profile)| *profile == self);
        row.map_or("", |(name, _)| name)
    }

    /// Whose autopilots it is for.
    pub fn autopilot_type(self) -> AutopilotType {
        match self {
            Self::Px4Trajectory | Self::Px4Offboard | Self::Px4Deviation => AutopilotType::Px4,
            Self::ArdupilotGuided => AutopilotType::ArduPilot,
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

    /// Whether jink reads the mission to know the path: the autopilot does not report it.
    pub fn reads_the_mission(self) -> bool {
        self != ProfileName::Px4Trajectory
    }

    /// How closely the autopilot follows what is sent. Nobody has measured it for the deviation interface.
    pub fn tracking(self) -> Tracking {
        match self {
            ProfileName::Px4Trajectory | ProfileName::Px4Deviation => Tracking::PX4_TRAJECTORY,
            ProfileName::Px4Offboard => Tracking::PX4_OFFBOARD,
            ProfileName::ArdupilotGuided => Tracking::ARDUPILOT_GUIDED,
        }
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
