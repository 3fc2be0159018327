//! The phases of a flight with their time limits, its progress, and how it ended.

use jink_shared_types::vehicle::NavMode;

macro_rules! phases {
    ($( $(#[$meta:meta])* $name:ident = $text:literal, $limit_s:expr; )*) => {
        /// Where the flight is.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        pub enum Phase {
            $( $(#[$meta])* $name, )*
        }

        impl Phase {
            /// Name in lower case.
            pub fn name(self) -> &'static str {
                match self { $( Self::$name => $text, )* }
            }

            /// Longest time it may take (s).
            pub(super) fn limit_s(self) -> f64 {
                match self { $( Self::$name => $limit_s, )* }
            }
        }
    };
}
phases! {
    /// Waiting for the autopilot's heartbeat.
    Connect = "connect", 60.0;
    /// Waiting for its position.
    Position = "position", 90.0;
    /// Uploading the mission.
    Upload = "upload", 30.0;
    /// Setting the mode in which motors are armed.
    Ready = "ready", 20.0;
    /// Arming; refusals are repeated, their reason is kept.
    Arm = "arm", 120.0;
    /// Climbing.
    Takeoff = "takeoff", 60.0;
    /// Setting and flying the mission. Its limit is the plan's own.
    Mission = "mission", f64::INFINITY;
    /// Coming down.
    Land = "land", 180.0;
    /// Over.
    Done = "done", f64::INFINITY;
}

/// How a flight ended.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// Every item reached, ending as planned.
    Done,
    /// A phase took too long.
    TimedOut {
        /// Which one.
        phase: Phase,
        /// Its limit (s).
        limit_s: f64,
        /// The last thing the autopilot said, or what was missing.
        reason: String,
    },
    /// The autopilot refused the mission.
    MissionRefused {
        /// MAV_MISSION_RESULT.
        result: u32,
    },
}

/// What a person wants to see.
#[derive(Clone, Debug, PartialEq)]
pub struct Progress {
    /// Phase.
    pub phase: Phase,
    /// Mode the autopilot reports.
    pub mode: NavMode,
    /// Waypoints reached.
    pub reached: usize,
    /// Waypoints.
    pub waypoints: usize,
    /// Distance to the last waypoint (m); NaN while unknown.
    pub to_goal_m: f64,
    /// Times the autopilot left the mission unasked.
    pub fell_out: u32,
    /// The last thing the autopilot said.
    pub said: String,
    /// Set when the flight is over.
    pub outcome: Option<Outcome>,
}
