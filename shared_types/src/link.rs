//! What the gateway knows of its link, for people and for the supervisor.

use crate::STAGE_ROOM;
use crate::coded::{Coded, Flag};
use crate::health::{Histogram, Name};
use crate::reserved::Reserved;

/// Links one gateway can have: the autopilot's and three more.
pub const LINKS: usize = 4;

/// Classes of what is sent, the most urgent first; each has its place in the arrays of [`LinkTraffic`].
pub const CLASSES: [&str; 7] = [
    "heartbeats",
    "setpoints",
    "answers",
    "obstacles",
    "texts",
    "parameters",
    "forwarded",
];

crate::wire_enum! {
    /// What the avoidance heartbeat (component 196) says; numbers are MAV_STATE.
    pub enum AvoidanceState {
        /// Nothing sent yet.
        Uninit = 0 "uninit",
        /// Starting.
        Boot = 1 "boot",
        /// Ready, not every input there yet.
        Standby = 3 "standby",
        /// The whole chain is healthy.
        Active = 4 "active",
        /// A part of the chain is missing.
        Critical = 5 "critical",
        /// Given up.
        Termination = 8 "termination",
    }
}

crate::wire_enum! {
    /// Whether the autopilot on the link takes what the profile sends.
    pub enum ProfileFit {
        /// Not known yet.
        Unknown = 0 "not known",
        /// It does.
        Fits = 1 "fits",
        /// The profile is for another make of autopilot.
        OtherAutopilot = 2 "for another autopilot",
        /// The autopilot is set up for another profile.
        OtherInterface = 3 "for another setting",
        /// This firmware has no such interface.
        NoInterface = 4 "not in this firmware",
        /// It has, and it is switched off.
        SwitchedOff = 5 "switched off",
        /// The firmware is older than what the profile is for.
        TooOld = 6 "firmware too old",
    }
}

crate::wire_enum! {
    /// Whether a pilot's sticks pass through the guard in OFFBOARD or GUIDED.
    pub enum AssistState {
        /// They do not.
        Off = 0 "off",
        /// It was chosen, and the autopilot has not changed its mode yet.
        Engaging = 1 "engaging",
        /// They do.
        On = 2 "on",
        /// Sticks or ranges are missing: the vehicle holds its place.
        Holds = 3 "holds",
        /// The autopilot is asked for its own mode.
        Leaving = 4 "leaving",
    }
}

crate::wire_enum! {
    /// What becomes of the telemetry log.
    pub enum TelemetryLog {
        /// None is asked for.
        None = 0 "none",
        /// It is written.
        Written = 1 "written",
        /// It cannot be begun, or has ended: its disk is full or gone.
        Lost = 2 "full",
    }
}

crate::sample! {
    /// One link's traffic since the gateway's start.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct LinkTraffic: 200 {
        /// Its name; empty = there is no such link.
        pub name: Name,
        /// Bytes sent, per class.
        pub sent_bytes: [u64; CLASSES.len()],
        /// Messages left out because the link is too slow, per class.
        pub dropped: [u64; CLASSES.len()],
        /// Messages that others sent and that left here unchanged.
        pub forwarded: u64,
        /// Messages refused: the signature does not fit the key.
        pub signature_refused: u64,
        /// Messages refused: signed, but not newer than what was received.
        pub replayed: u64,
        /// Messages refused: not signed, where that is asked for.
        pub unsigned_refused: u64,
        /// Datagrams and connections of those who are not among the peers.
        pub unknown_peers: u64,
        /// Bytes that belonged to no message.
        pub garbage_bytes: u64,
        /// Times the link was opened again.
        pub reopened: u64,
        /// It is not open: its device is not there.
        pub is_waited_for: Flag,
        /// Explicit padding, zero.
        pub reserved: Reserved<7>,
    }
}

crate::sample! {
    /// The gateway's counters since its start.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct LinkStatus: 12096 {
        /// Messages received from the autopilot.
        pub received: u64,
        /// Messages that could not be decoded, or came from somebody who does not concern us.
        pub ignored: u64,
        /// Bytes that belonged to no message.
        pub garbage_bytes: u64,
        /// Messages sent.
        pub sent: u64,
        /// Setpoints sent (trajectories and mirrored ones).
        pub setpoints: u64,
        /// Largest time between two setpoints (us).
        pub setpoint_gap_max_us: u32,
        /// The autopilot's system id; 0 = not seen.
        pub system_id: u8,
        /// The autopilot's clock is mapped.
        pub timesync_converged: Flag,
        /// State in our heartbeat.
        pub avoidance: Coded<AvoidanceState>,
        /// The autopilot has been seen within 1.5 s.
        pub autopilot_alive: Flag,
        /// Autopilot clock minus board clock (ns).
        pub clock_offset_ns: i64,
        /// Shortest round trip of a time synchronisation (us).
        pub round_trip_us: u32,
        /// Good samples of the time synchronisation so far.
        pub timesync_samples: u32,
        /// TRAJECTORY_REPRESENTATION_WAYPOINTS received.
        pub desired_paths: u64,
        /// OBSTACLE_DISTANCE sent.
        pub obstacle_distances: u64,
        /// How setpoints are sent; empty = not chosen yet.
        pub profile: Name,
        /// The profile that is for this autopilot; empty = not known, or there is none.
        pub matching_profile: Name,
        /// Whether the one fits.
        pub profile_fit: Coded<ProfileFit>,
        /// Whether a pilot is assisted.
        pub assist: Coded<AssistState>,
        /// Whole numbers travel in parameter messages as floats (PARAM_ENCODE_C_CAST, ArduPilot), not as bytes
        /// (PARAM_ENCODE_BYTEWISE, PX4).
        pub param_c_cast: Flag,
        /// What becomes of the telemetry log.
        pub telemetry_log: Coded<TelemetryLog>,
        /// By how much the autopilot's clock runs faster than the board's (ppm); zero where no difference shows.
        pub clock_rate_ppm: i32,
        /// Room for later fields, zero.
        pub reserved_tail: Reserved<8>,
        /// Every link by itself, the autopilot's first.
        pub links: [LinkTraffic; LINKS],
        /// Capture of the newest range behind a planned setpoint to its bytes handed to the kernel.
        pub capture_to_wire: Histogram,
        /// What each stage added to that, waiting included: from the end of the stage before it to its own end.
        pub stages: [Histogram; STAGE_ROOM],
        /// How much of that was before its begin: the wake-up, and what it was still busy with.
        pub hops: [Histogram; STAGE_ROOM],
    }
    means { CLASSES: texts }
    plausible if Self::is_consistent
}

impl LinkStatus {
    /// Whether its names are texts.
    pub fn is_consistent(&self) -> bool {
        self.profile.is_text()
            && self.matching_profile.is_text()
            && self.links.iter().all(|link| link.name.is_text())
    }
}

crate::sample! {
    /// The autopilot knows what a new trajectory says. The header holds the history of that trajectory, the gateway included.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct Delivery: 16 {
        /// Setpoints sent so far.
        pub setpoints: u64,
        /// A setpoint was sent for it; otherwise the autopilot was sent the same before.
        pub was_sent: Flag,
        /// Explicit padding, zero.
        pub reserved: Reserved<7>,
    }
    plausible if Self::is_counted
}

impl Delivery {
    /// Whether so many setpoints can have been sent: a thousand a second for thirty years are 2^40.
    pub fn is_counted(&self) -> bool {
        self.setpoints < 1 << 40
    }
}

crate::sample! {
    /// The vehicle is to be brought to rest and left to the autopilot: jink is about to be ended.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct StopRequest: 8 {
        /// Process id of who asks.
        pub pid: u64,
    }
    plausible if Self::is_of_a_process
}

impl StopRequest {
    /// Whether it says who asks: Linux counts processes from 1 in 31 bits.
    pub fn is_of_a_process(&self) -> bool {
        self.pid != 0 && i32::try_from(self.pid).is_ok()
    }
}
