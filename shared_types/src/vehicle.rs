//! What the gateway knows of the vehicle and of its mission.

use crate::clock::Timestamp;
use crate::coded::{Coded, Flag};
use crate::frames::{AngularRate, Attitude, BodyFrd, LocalNed, Point, Velocity};
use crate::reserved::Reserved;
use crate::tracking::Tracking;

crate::wire_enum! {
    /// What the autopilot is doing, independent of its make.
    pub enum NavMode {
        /// Not known: no heartbeat yet, or a mode this build has no name for.
        Unknown = 0 "unknown",
        /// The pilot flies (any mode in which jink must not plan).
        Manual = 1 "manual",
        /// Position hold under sticks.
        Position = 2 "position",
        /// Automatic take-off.
        Takeoff = 3 "takeoff",
        /// Automatic mission.
        Mission = 4 "mission",
        /// Automatic hold (loiter).
        Hold = 5 "hold",
        /// Automatic return.
        Return = 6 "return",
        /// Automatic landing.
        Land = 7 "land",
        /// External setpoints (PX4 OFFBOARD, ArduPilot GUIDED).
        Offboard = 8 "offboard",
        /// Circles around a place (PX4 orbit, ArduPilot CIRCLE).
        Orbit = 9 "orbit",
        /// Follows somebody (PX4 follow me, ArduPilot FOLLOW).
        Follow = 10 "follow",
    }
}

impl NavMode {
    /// Whether this is one of PX4's automatic modes, in which it asks its companion for setpoints.
    pub fn is_automatic(self) -> bool {
        matches!(
            self,
            NavMode::Takeoff | NavMode::Mission | NavMode::Hold | NavMode::Return | NavMode::Land
        )
    }
}

crate::sample! {
    /// The vehicle as the autopilot estimates it; validity time in the header's `capture`.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct VehicleState: 192 {
        /// Position of the centre of gravity.
        pub position: Point<LocalNed>,
        /// Velocity.
        pub velocity: Velocity<LocalNed>,
        /// `local_q_body`.
        pub attitude: Attitude,
        /// Body rates.
        pub rates: AngularRate<BodyFrd>,
        /// Height of the home position above the local origin, as down coordinate (m); NaN unknown.
        pub home_down_m: f64,
        /// Distance to the ground below, if the autopilot reports it (m); NaN unknown.
        pub ground_distance_m: f64,
        /// Counts horizontal and vertical position resets of the estimator.
        pub estimator_resets: u32,
        /// The vehicle's MAVLink system id; 0 unknown.
        pub system_id: u8,
        /// Mode.
        pub mode: Coded<NavMode>,
        /// Motors armed.
        pub armed: Flag,
        /// On the ground, as the autopilot says.
        pub landed: Flag,
        /// Horizontal and vertical position may be used.
        pub position_valid: Flag,
        /// The autopilot has been seen within the last 1.5 s.
        pub autopilot_alive: Flag,
        /// No heartbeat has reported mode and arming yet (for at most a second after a start of the gateway): what they
        /// say here means nothing, and what is being flown goes on.
        pub mode_pending: Flag,
        /// Explicit padding, zero.
        pub reserved: Reserved<5>,
        /// Time of the position measurement, before any propagation to `capture`.
        pub position_time: Timestamp,
        /// How closely the autopilot follows what jink sends in the profile that is flown.
        pub tracking: Tracking,
        /// Room for later fields, zero.
        pub reserved_tail: Reserved<16>,
    }
    plausible if Self::is_consistent
}

impl VehicleState {
    /// Whether a position that may be used is one, and comes with a motion and an attitude.
    pub fn is_consistent(&self) -> bool {
        let moves = || self.position.is_finite() && self.velocity.is_finite() && self.rates.is_finite();
        !self.position_valid.is_set() || moves() && self.attitude.is_rotation()
    }
}

/// MAV_CMD of a desired point that is a take-off.
pub const COMMAND_TAKEOFF: u16 = 22;
/// MAV_CMD of a desired point that is a hold.
pub const COMMAND_LOITER: u16 = 17;
/// MAV_CMD of a desired point that is a landing.
pub const COMMAND_LAND: u16 = 21;
/// The value PX4 puts where a desired point has no command (a plain waypoint).
pub const COMMAND_NONE: u16 = u16::MAX;

crate::sample! {
    /// One of the three points of PX4's desired path. NaN means "not given", in every field.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct DesiredPoint: 64 {
        /// Position; z is NaN while landing.
        pub position: Point<LocalNed>,
        /// Velocity; only z is given, and only while landing.
        pub velocity: Velocity<LocalNed>,
        /// Heading (rad).
        pub yaw_rad: f32,
        /// Heading rate (rad/s).
        pub yaw_rate_radps: f32,
        /// MAV_CMD of the mission item, [`COMMAND_NONE`] if none.
        pub command: u16,
        /// Whether the autopilot marked the point as valid.
        pub valid: Flag,
        /// Explicit padding, zero.
        pub reserved: Reserved<5>,
    }
}

impl Default for DesiredPoint {
    fn default() -> Self {
        Self {
            position: Point::UNSET,
            velocity: Velocity::UNSET,
            yaw_rad: f32::NAN,
            yaw_rate_radps: f32::NAN,
            command: COMMAND_NONE,
            valid: Flag::NO,
            reserved: Reserved::ZERO,
        }
    }
}

crate::sample! {
    /// What the autopilot wants to do: PX4's TRAJECTORY_REPRESENTATION_WAYPOINTS, or a goal in its shape.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct DesiredPath: 232 {
        /// 0: the present setpoint, adapted to its type; 1: the current waypoint; 2: the next waypoint.
        pub points: [DesiredPoint; 3],
        /// Speed the mission asks for (m/s); NaN not known.
        pub mission_speed_mps: f64,
        /// The autopilot's own time stamp, microseconds of its clock.
        pub autopilot_time_us: u64,
        /// Mode in which this was asked for.
        pub mode: Coded<NavMode>,
        /// Explicit padding, zero.
        pub reserved: Reserved<7>,
        /// Room for later fields, zero.
        pub reserved_tail: Reserved<16>,
    }
    plausible if Self::is_consistent
}

impl Default for DesiredPath {
    fn default() -> Self {
        Self {
            points: [DesiredPoint::default(); 3],
            mission_speed_mps: f64::NAN,
            autopilot_time_us: 0,
            mode: Coded::new(NavMode::Unknown),
            reserved: Reserved::ZERO,
            reserved_tail: Reserved::ZERO,
        }
    }
}

impl DesiredPoint {
    /// Whether every number is given and finite, or not given.
    fn is_consistent(&self) -> bool {
        let (position, velocity) = (self.position.vector(), self.velocity.vector());
        let mut numbers = position.iter().chain(&velocity);
        numbers.all(|x| !x.is_infinite()) && !self.yaw_rad.is_infinite() && !self.yaw_rate_radps.is_infinite()
    }
}

impl DesiredPath {
    /// Whether what is given is finite. NaN is not given, in every field.
    pub fn is_consistent(&self) -> bool {
        let speed_is_one =
            self.mission_speed_mps.is_nan() || (0.0..f64::INFINITY).contains(&self.mission_speed_mps);
        speed_is_one && self.points.iter().all(DesiredPoint::is_consistent)
    }

    /// Whether this asks for a motion that jink plans itself; everything else is mirrored back.
    ///
    /// Planned: every finite target in an automatic mode, be it a waypoint, a go-to, a place to hold or a leg of a return, and
    /// what is wanted of external setpoints. Mirrored: what goes straight up or down at the vehicle's place (take-off and
    /// landing, also as mission items), and anything without a finite target. A take-off or a landing elsewhere is made a
    /// plain target by the gateway until the vehicle is there.
    pub fn wants_planning(&self) -> bool {
        let mode = self.mode.get();
        let planned_mode = mode.is_automatic() || mode == NavMode::Offboard;
        let [target, waypoint, _] = &self.points;
        let is_level = |point: &DesiredPoint| !matches!(point.command, COMMAND_TAKEOFF | COMMAND_LAND);
        planned_mode
            && is_level(target)
            && is_level(waypoint)
            && target.position.is_finite()
            && waypoint.position.is_finite()
    }

    /// Whether this asks for a place to stay at or to come to, however the vehicle moves now: a hold or a landing, where
    /// coming to rest counts more than being there soon.
    pub fn is_to_rest(&self) -> bool {
        matches!(self.mode.get(), NavMode::Hold | NavMode::Land)
    }
}
