//! Which autopilot in which profile.

use jink_emulated_ground_station::Make;
use std::fmt;
use std::str::FromStr;

/// An autopilot whose build is looked for by path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Autopilot {
    /// PX4 of 2021: the last line that has the trajectory interface.
    Px4Of2021,
    /// PX4 of today.
    Px4,
    /// ArduCopter.
    ArduCopter,
}

impl Autopilot {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Px4Of2021, Self::Px4, Self::ArduCopter];

    /// The name of its option and of its line in `builds.toml`.
    pub fn option(self) -> &'static str {
        match self {
            Self::Px4Of2021 => "px4-2021",
            Self::Px4 => "px4",
            Self::ArduCopter => "ardupilot",
        }
    }

    /// Whose modes and commands it uses.
    pub fn make(self) -> Make {
        match self {
            Self::ArduCopter => Make::ArduCopter,
            _ => Make::Px4,
        }
    }
}

/// An autopilot and the profile that jink uses with it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Setup {
    /// PX4 of 2021, curves.
    Bezier,
    /// PX4 of 2021, points.
    Waypoints,
    /// PX4 of 2021, OFFBOARD.
    Offboard2021,
    /// PX4 of today, OFFBOARD.
    Offboard,
    /// PX4 of today with EAV_EN.
    Deviation,
    /// ArduCopter, GUIDED.
    Guided,
}

impl Setup {
    /// All of them, in the order of the table.
    pub const ALL: [Self; 6] = [
        Self::Bezier,
        Self::Waypoints,
        Self::Offboard2021,
        Self::Offboard,
        Self::Deviation,
        Self::Guided,
    ];

    /// The name in `--only`, in the table and in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bezier => "px4-2021/bezier",
            Self::Waypoints => "px4-2021/waypoints",
            Self::Offboard2021 => "px4-2021/offboard",
            Self::Offboard => "px4/offboard",
            Self::Deviation => "px4/deviation",
            Self::Guided => "ardupilot/guided",
        }
    }

    /// Its autopilot.
    pub fn autopilot(self) -> Autopilot {
        match self {
            Self::Bezier | Self::Waypoints | Self::Offboard2021 => Autopilot::Px4Of2021,
            Self::Offboard | Self::Deviation => Autopilot::Px4,
            Self::Guided => Autopilot::ArduCopter,
        }
    }

    /// Whether the autopilot follows jink in a mode of its own, which jink asks for.
    pub fn has_setpoint_mode(self) -> bool {
        matches!(self, Self::Offboard2021 | Self::Offboard | Self::Guided)
    }

    /// What jink's configuration says: `section.key=value`.
    pub fn overrides(self) -> &'static [&'static str] {
        match self {
            Self::Bezier => &["link.profile=px4_trajectory", "link.output=bezier"],
            Self::Waypoints => &["link.profile=px4_trajectory", "link.output=waypoints"],
            Self::Offboard2021 | Self::Offboard => &["link.profile=px4_offboard"],
            Self::Deviation => &["link.profile=px4_deviation"],
            Self::Guided => &["link.profile=ardupilot_guided"],
        }
    }

    /// The autopilot's parameters as the page of its profile asks for them.
    pub fn parameters(self) -> &'static [(&'static str, f64)] {
        match self {
            Self::Bezier | Self::Waypoints => &[("COM_OBS_AVOID", 1.0)],
            Self::Offboard2021 => &[
                ("COM_OBS_AVOID", 0.0),
                ("COM_OBL_ACT", 2.0),
                ("COM_OBL_RC_ACT", 5.0),
            ],
            // SIH's own drag of 1 N/(m/s) on 1 kg is that of a parachute.
            Self::Offboard => &[("COM_OBL_RC_ACT", 5.0), ("SIH_KDV", 0.1)],
            Self::Deviation => &[
                ("COM_OBL_RC_ACT", 5.0),
                ("SIH_KDV", 0.1),
                ("EAV_EN", 1.0),
                ("MPC_XY_CRUISE", 3.0),
            ],
            Self::Guided => &[
                ("GUID_TIMEOUT", 0.5),
                ("GUID_OPTIONS", 0.0),
                ("PRX1_TYPE", 2.0),
                ("PRX_FILT", 0.0),
                ("AVOID_ENABLE", 3.0),
                ("OA_TYPE", 0.0),
                ("FS_GCS_ENABLE", 0.0),
            ],
        }
    }
}

impl fmt::Display for Setup {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Setup {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|setup| setup.name() == text)
            .ok_or_else(|| format!("no setup is called {text:?}"))
    }
}
