//! Which autopilots are flown with which profile.

use crate::campaign::{Cell, setup};
use crate::lockstep::{FlightSetup, LockStep};
use jink_emulated_ground_station::Make;
use jink_mavlink_link::profile_name::ProfileName;
use jink_shared_types::vehicle::NavMode;
use jink_simulator::autopilot::AutopilotConfig;

/// An autopilot and the profile it is flown with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pairing {
    /// Its name in the configuration.
    pub autopilot: &'static str,
    /// The profile.
    pub profile: ProfileName,
    /// Whose firmware it is.
    pub make: Make,
    /// Parameter of the autopilot that is not at its default.
    parameter: Option<(&'static str, f64)>,
}

/// PX4 up to v1.15, asking for trajectories.
pub const PX4_TRAJECTORY: Pairing = Pairing {
    autopilot: "px4",
    profile: ProfileName::Px4Trajectory,
    make: Make::Px4,
    parameter: None,
};
/// Current PX4 in OFFBOARD.
pub const PX4_CURRENT: Pairing = Pairing {
    autopilot: "px4_current",
    profile: ProfileName::Px4Offboard,
    ..PX4_TRAJECTORY
};
/// PX4 of 2021 in OFFBOARD.
pub const PX4_2021_OFFBOARD: Pairing = Pairing {
    profile: ProfileName::Px4Offboard,
    parameter: Some(("COM_OBS_AVOID", 0.0)),
    ..PX4_TRAJECTORY
};
/// Current PX4 in its own mission, with velocities and accelerations taken in, as proposed for it.
pub const PX4_DEVIATION: Pairing = Pairing {
    profile: ProfileName::Px4Deviation,
    parameter: Some(("EAV_EN", 1.0)),
    ..PX4_CURRENT
};
/// ArduCopter in GUIDED.
pub const COPTER: Pairing = Pairing {
    autopilot: "ardupilot",
    profile: ProfileName::ArdupilotGuided,
    make: Make::ArduCopter,
    parameter: None,
};
/// Short names, as the commands have them.
const NAMES: [(&str, Pairing); 5] = [
    ("px4_trajectory", PX4_TRAJECTORY),
    ("px4_offboard", PX4_CURRENT),
    ("px4_2021_offboard", PX4_2021_OFFBOARD),
    ("px4_deviation", PX4_DEVIATION),
    ("ardupilot_guided", COPTER),
];
/// Those that only follow setpoints.
pub const FOLLOWERS: [Pairing; 3] = [PX4_CURRENT, PX4_2021_OFFBOARD, COPTER];

impl Pairing {
    /// The short names.
    pub fn names() -> impl Iterator<Item = &'static str> {
        NAMES.iter().map(|(short, _)| *short)
    }

    /// By its short name; `None` for one that means nothing.
    pub fn named(name: &str) -> Option<Self> {
        let mut all = NAMES.into_iter();
        all.find(|(short, _)| *short == name).map(|(_, pairing)| pairing)
    }

    /// Its short name; of the autopilot if it has none.
    pub fn name(self) -> &'static str {
        let mut all = NAMES.into_iter();
        all.find(|(_, pairing)| *pairing == self)
            .map_or(self.autopilot, |(short, _)| short)
    }

    /// A flight through the forest of `seed` at 3 m/s.
    ///
    /// # Errors
    /// A text naming what cannot be built.
    pub fn forest(self, seed: u64) -> Result<FlightSetup, String> {
        let cell = Cell::forest()?;
        self.fly(setup(&cell, seed)?)
    }

    /// The same flight with this autopilot and its profile.
    ///
    /// # Errors
    /// A text naming what cannot be built.
    pub fn fly(self, setup: FlightSetup) -> Result<FlightSetup, String> {
        let name = self.autopilot;
        let autopilot = AutopilotConfig::named(name).ok_or_else(|| format!("no autopilot {name:?}"))?;
        let autopilot = match self.parameter {
            Some((name, value)) => autopilot.with_parameter(name, value),
            None => autopilot,
        };
        Ok(FlightSetup {
            profile: self.profile,
            autopilot,
            ..setup
        })
    }

    /// Somebody besides the ground station commands a mode; nothing happens if the make has none like it.
    pub fn command_mode(self, flight: &mut LockStep, mode: NavMode) {
        if let Some(command) = self.make.mode_command(mode, 1) {
            flight.send(command);
        }
    }
}
