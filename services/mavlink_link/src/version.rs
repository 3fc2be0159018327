//! The firmware's version, and which of them a profile fits.
//!
//! | profile | first | last | why |
//! |---|---|---|---|
//! | `px4_trajectory` | 1.11 | 1.15 | TRAJECTORY_REPRESENTATION_BEZIER came with 1.11; 1.16 removed the interface |
//! | `px4_offboard` | 1.13 and its development | none | OFFBOARD with position, velocity and acceleration in one setpoint |
//! | `ardupilot_guided` | 4.0 | none | GUIDED as it was observed |

use crate::profile_name::ProfileName;
use std::fmt;

/// A version as AUTOPILOT_VERSION reports it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FirmwareVersion {
    major: u8,
    minor: u8,
    patch: u8,
    kind: u8,
}

/// FIRMWARE_VERSION_TYPE of a release.
const RELEASE: u8 = 255;
/// The first one that is an alpha version; below it is development.
const ALPHA: u8 = 64;

impl FirmwareVersion {
    /// From `flight_sw_version`; `None` if it is not set.
    pub fn of(flight_sw_version: u32) -> Option<Self> {
        let [major, minor, patch, kind] = flight_sw_version.to_be_bytes();
        (flight_sw_version != 0).then_some(Self {
            major,
            minor,
            patch,
            kind,
        })
    }

    /// Its first two numbers.
    pub fn numbers(self) -> (u8, u8) {
        (self.major, self.minor)
    }

    /// Built between two releases.
    pub fn is_development(self) -> bool {
        self.kind < ALPHA
    }
}

impl fmt::Display for FirmwareVersion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = match self.kind {
            RELEASE => "",
            0..ALPHA => " (development)",
            ALPHA..128 => " (alpha)",
            128..192 => " (beta)",
            _ => " (release candidate)",
        };
        write!(f, "{}.{}.{}{kind}", self.major, self.minor, self.patch)
    }
}

/// The first and, where there is one, the last version that `profile` fits.
pub fn fitting(profile: ProfileName) -> ((u8, u8), Option<(u8, u8)>) {
    match profile {
        ProfileName::Px4Trajectory => ((1, 11), Some((1, 15))),
        ProfileName::Px4Offboard => ((1, 13), None),
        // The proposal was made for the version in work then.
        ProfileName::Px4Deviation => ((1, 17), None),
        ProfileName::ArdupilotGuided => ((4, 0), None),
    }
}

/// Whether `version` is older than every one that `profile` fits. What is in development counts as the release it
/// becomes: PX4 names it after the release before.
pub fn is_too_old(version: FirmwareVersion, profile: ProfileName) -> bool {
    let (major, minor) = version.numbers();
    let becomes = (major, minor + u8::from(version.is_development()));
    becomes < fitting(profile).0
}

#[cfg(test)]
mod tests {
    use super::{FirmwareVersion, is_too_old};
    use crate::profile_name::ProfileName;

    #[test]
    fn development_counts_as_the_release_it_becomes() {
        let is_old = |number, profile| is_too_old(FirmwareVersion::of(number).unwrap(), profile);
        assert!(!is_old(0x010c_0000, ProfileName::Px4Offboard));
        assert!(is_old(0x010c_00ff, ProfileName::Px4Offboard));
        assert!(is_old(0x010b_0000, ProfileName::Px4Offboard));
        assert!(!is_old(0x010d_00ff, ProfileName::Px4Offboard));
    }

    #[test]
    fn versions_are_printed_as_their_vendors_write_them() {
        let text = |number| FirmwareVersion::of(number).map(|version| version.to_string());
        assert_eq!(text(0x010f_02ff).as_deref(), Some("1.15.2"));
        assert_eq!(text(0x010d_0000).as_deref(), Some("1.13.0 (development)"));
        assert_eq!(text(0x0406_01c0).as_deref(), Some("4.6.1 (release candidate)"));
        assert_eq!(text(0), None);
    }
}
