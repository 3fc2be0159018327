//! Which PX4 is emulated, and what that decides.
//!
//! | firmware | companion | source |
//! |---|---|---|
//! | [`Firmware::Trajectory`] | flies automatic modes through TRAJECTORY_REPRESENTATION_* | PX4 of July 2021, up to v1.15 by its variant |
//! | [`Firmware::Current`] | flies OFFBOARD; the trajectory interface is gone | PX4 main of August 2026 |
//!
//! Where the two behave differently, one of the predicates below decides, and nothing else does.

use super::avoidance::Variant;

/// Which firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Firmware {
    /// With the trajectory interface, v1.11 to v1.15.
    Trajectory(Variant),
    /// Without it, after v1.16.
    Current,
}

impl Default for Firmware {
    fn default() -> Self {
        Self::Trajectory(Variant::default())
    }
}

impl Firmware {
    /// It asks a companion for trajectories in automatic modes, and its commander judges that companion.
    pub fn has_trajectory_interface(self) -> bool {
        matches!(self, Self::Trajectory(_))
    }

    /// Its commander remembers the mode somebody wanted through a failsafe, and goes back to it: a stream that comes back
    /// re-enters OFFBOARD. While disarmed it therefore takes any wish for a mode, and refuses to arm in it instead.
    pub fn remembers_wishes(self) -> bool {
        self == Self::Current
    }

    /// Hold begins at the point where a gentle stop ends, not at the point where it was commanded.
    pub fn holds_where_it_can_stop(self) -> bool {
        self == Self::Current
    }

    /// It says when a return begins, and how high it will be.
    pub fn announces_returns(self) -> bool {
        self == Self::Current
    }

    /// The mode changes to Hold when the mission is done; otherwise it stays, and its last waypoint is held in it.
    pub fn leaves_finished_missions(self) -> bool {
        self == Self::Current
    }

    /// A place to go to is taken in Hold only, or if the command asks for that mode; otherwise it is kept for the next Hold.
    pub fn forgets_repositions(self) -> bool {
        self == Self::Current
    }

    /// OFFBOARD is no flight task: whoever flies after it starts from the vehicle's motion, not from the last setpoint.
    pub fn forgets_offboard_setpoint(self) -> bool {
        self == Self::Current
    }

    /// MISSION_CURRENT says how many items there are, which mission that is and how far it has come, and is sent without one, too.
    pub fn describes_missions(self) -> bool {
        self == Self::Current
    }

    /// Refuses setpoints it cannot use in words; the older one drops them silently.
    pub fn explains_bad_setpoints(self) -> bool {
        self == Self::Current
    }

    /// Position mode flies accelerations against drag, with collision prevention in it.
    pub fn flies_sticks_by_acceleration(self) -> bool {
        self == Self::Current
    }

    /// `flight_sw_version` of AUTOPILOT_VERSION: 1.13 and 1.17, both in development.
    pub fn version(self) -> u32 {
        match self {
            Self::Trajectory(_) => 1 << 24 | 13 << 16,
            Self::Current => 1 << 24 | 17 << 16,
        }
    }
}
