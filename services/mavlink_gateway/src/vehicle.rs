//! The vehicle, put together from the messages of the autopilot.
//!
//! | in | out |
//! |---|---|
//! | ATTITUDE_QUATERNION (50 Hz) | one [`VehicleState`] each |
//! | LOCAL_POSITION_NED (30 Hz) | its position, carried on by its velocity to the time of the attitude |
//! | HEARTBEAT, EXTENDED_SYS_STATE, ALTITUDE, HOME_POSITION | mode, armed, landed, ground distance, home |
//!
//! A position that is not where the last one and the velocities in between lead to is a reset of the estimator: the
//! vehicle has not moved, its coordinates have. The sum of these jumps ([`Present::shift`]) lets a held point keep
//! its place in the world.

use crate::landed_state::LandedState;
use jink_mavlink_link::autopilot_type::AutopilotType;
use jink_shared_types::frames::{AngularRate, Attitude, unit_quaternion};
use jink_shared_types::tracking::Tracking;
use jink_shared_types::vehicle::{NavMode, VehicleState};
use jink_shared_types::{Coded, Flag, LocalNed, Point, Timestamp, Velocity};
use mavlink::dialect::{
    ALTITUDE_DATA, ATTITUDE_QUATERNION_DATA, EXTENDED_SYS_STATE_DATA, HEARTBEAT_DATA, HOME_POSITION_DATA,
    LOCAL_POSITION_NED_DATA, MavLandedState, MavModeFlag,
};
use nalgebra::Vector3;

use jink_mavlink_link::vehicle_selector::ALIVE_S;
/// Coordinates beyond this (m) are no position: single precision resolves only decimetres there.
pub const MAX_COORDINATE_M: f64 = 1e6;
/// Speeds beyond this (m/s) are no measurement of a multicopter.
pub const MAX_SPEED_MPS: f64 = 200.0;

/// A position this old (s) is not carried on any further and no longer valid: fifteen periods at 30 Hz.
const POSITION_VALID_S: f64 = 0.5;
/// How long a distance to the ground is believed (s); it comes at 10 Hz.
const GROUND_VALID_S: f64 = 1.0;
/// Between two positions the velocity explains the way up to this much (m): what estimators correct without a reset.
const JUMP_FLOOR_M: f64 = 0.3;
/// And up to what an acceleration of this size could add in between (m/s^2), which matters after lost messages.
const JUMP_ACCELERATION_MPS2: f64 = 10.0;
/// A report of the circle is on its way for this long at most (s): PX4 sends it five times a second.
const ORBIT_REPORT_LATE_S: f64 = 0.5;
/// A stamp this much older than the one before (ms) comes from a new start of the autopilot, or from a packet that is very late.
const REBOOT_BACK_MS: i32 = 1000;
/// A stamp that runs ahead of the board's clock by this much (s) does, too (the counter has wrapped or was reset).
const REBOOT_AHEAD_S: f64 = 10.0;

/// Where the vehicle is now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Present {
    /// Position in the local frame (m).
    pub position: Vector3<f64>,
    /// Velocity in the local frame (m/s).
    pub velocity: Vector3<f64>,
    /// Heading (rad).
    pub yaw_rad: f64,
    /// Sum of all jumps of the estimator so far (m): a fixed place in the world moves by its change.
    pub shift: Vector3<f64>,
}

/// What a stamp says about its message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Order {
    Next,
    Late,
    Reboot,
}

/// What became of an attitude.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AttitudeNews {
    /// The state has changed.
    Taken,
    /// It was no rotation, or came late.
    Ignored,
    /// Its stamp shows that the autopilot has started anew (see [`VehicleTracker::take_position`]).
    Reboot,
}

/// The kinds of messages that are dated by the autopilot's clock.
#[derive(Clone, Copy, Debug)]
enum Dated {
    Position,
    Attitude,
}

/// The autopilot's clock as its messages show it: milliseconds since its start.
///
/// That it has started anew is believed when two messages in a row say so, of whichever kind, the second later than the first. One
/// alone is late, or somebody else's: a flight does not end with it.
#[derive(Clone, Copy, Debug, Default)]
struct BootClock {
    /// The last stamp of each kind.
    last: [Option<(u32, Timestamp)>; 2],
    /// The stamp that says so alone.
    anew: Option<(u32, Timestamp)>,
}

impl BootClock {
    fn take(&mut self, kind: Dated, boot_ms: u32, received: Timestamp) -> Order {
        let last = &mut self.last[kind as usize];
        let later_ms = last.map_or(0, |last| forward_ms(last, boot_ms));
        let is_anew =
            later_ms <= -REBOOT_BACK_MS || last.is_some_and(|last| runs_ahead(last, boot_ms, received));
        if is_anew {
            let first = self.anew.replace((boot_ms, received));
            let is_confirmed = first
                .is_some_and(|first| forward_ms(first, boot_ms) > 0 && !runs_ahead(first, boot_ms, received));
            return if is_confirmed { Order::Reboot } else { Order::Late };
        }
        self.anew = None;
        if later_ms < 0 {
            return Order::Late;
        }
        *last = Some((boot_ms, received));
        Order::Next
    }
}

/// By how much a stamp is later than the one before (ms); the counter may have wrapped.
fn forward_ms((last_ms, _): (u32, Timestamp), boot_ms: u32) -> i32 {
    boot_ms.wrapping_sub(last_ms) as i32
}

/// Whether a stamp is later than the time that has passed since the one before allows.
fn runs_ahead(last: (u32, Timestamp), boot_ms: u32, received: Timestamp) -> bool {
    f64::from(forward_ms(last, boot_ms)) * 1e-3 > received.seconds_since(last.1) + REBOOT_AHEAD_S
}

#[derive(Clone, Copy, Debug)]
struct Fix {
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    boot_ms: u32,
    time: Timestamp,
}

impl Fix {
    fn carried_to(&self, time: Timestamp) -> Vector3<f64> {
        let ahead_s = time
            .seconds_since(self.time)
            .clamp(-POSITION_VALID_S, POSITION_VALID_S);
        self.position + self.velocity * ahead_s
    }
}

/// Puts the vehicle's state together.
#[derive(Clone, Debug)]
pub struct VehicleTracker {
    fix: Option<Fix>,
    attitude: Attitude,
    rates: AngularRate<jink_shared_types::BodyFrd>,
    attitude_time: Timestamp,
    clock: BootClock,
    received: Timestamp,
    make: Option<AutopilotType>,
    mode: NavMode,
    /// When the last circle was left.
    orbit_left: Timestamp,
    custom_mode: u32,
    heartbeat_mode: (NavMode, bool),
    heartbeat_received: bool,
    armed: bool,
    landed_state: LandedState,
    home_down_m: f64,
    ground: (f64, Timestamp),
    resets: u32,
    shift: Vector3<f64>,
}

impl Default for VehicleTracker {
    fn default() -> Self {
        Self {
            fix: None,
            attitude: Attitude::default(),
            rates: AngularRate::ZERO,
            attitude_time: Timestamp::NEVER,
            clock: BootClock::default(),
            received: Timestamp::NEVER,
            make: None,
            mode: NavMode::Unknown,
            orbit_left: Timestamp::NEVER,
            custom_mode: 0,
            heartbeat_mode: (NavMode::Unknown, true),
            heartbeat_received: false,
            armed: false,
            landed_state: LandedState::Unknown,
            home_down_m: f64::NAN,
            ground: (f64::NAN, Timestamp::NEVER),
            resets: 0,
            shift: Vector3::zeros(),
        }
    }
}

impl VehicleTracker {
    /// Notes that the autopilot was seen.
    pub fn received(&mut self, received: Timestamp) {
        self.received = self.received.max(received);
    }

    /// Whether the autopilot was seen within the last 1.5 s.
    pub fn is_alive(&self, now: Timestamp) -> bool {
        self.received.is_set() && now.seconds_since(self.received) <= ALIVE_S
    }

    /// When it stops being alive, if it is seen no more.
    pub fn alive_until(&self) -> Timestamp {
        self.received.plus_seconds(ALIVE_S)
    }

    /// Mode in force.
    pub fn mode(&self) -> NavMode {
        self.mode
    }

    /// The number under which the autopilot has reported its mode last.
    pub fn custom_mode(&self) -> u32 {
        self.custom_mode
    }

    /// Mode of the last heartbeat, and whether it has a name here (see [`jink_mavlink_link::px4_mode::infer`]).
    pub fn heartbeat_mode(&self) -> (NavMode, bool) {
        self.heartbeat_mode
    }

    /// Takes over a mode that was inferred from the desired path; stands until the next heartbeat.
    pub fn infer_mode(&mut self, mode: NavMode) {
        self.change_mode(mode);
    }

    /// Takes a report of the circle that PX4 flies: it comes five times a second, the mode only once. Stands until the
    /// next heartbeat. A report that was on its way when PX4 left the circle says nothing.
    pub fn infer_orbit(&mut self) {
        let has_left =
            self.orbit_left.is_set() && self.received.seconds_since(self.orbit_left) <= ORBIT_REPORT_LATE_S;
        if !has_left {
            self.change_mode(NavMode::Orbit);
        }
    }

    fn change_mode(&mut self, mode: NavMode) {
        if self.mode == NavMode::Orbit && mode != NavMode::Orbit {
            self.orbit_left = self.received;
        }
        self.mode = mode;
    }

    /// Where the vehicle is at `now`; `None` before the first position.
    pub fn present(&self, now: Timestamp) -> Option<Present> {
        self.fix.map(|fix| Present {
            position: fix.carried_to(now),
            velocity: fix.velocity,
            yaw_rad: self.attitude.yaw_rad(),
            shift: self.shift,
        })
    }

    /// Whether the position may be used at `now`.
    pub fn is_position_valid(&self, now: Timestamp) -> bool {
        self.fix
            .is_some_and(|fix| now.seconds_since(fix.time) <= POSITION_VALID_S)
    }

    /// Whose firmware it is; `None` not seen yet, or not known here.
    pub fn make(&self) -> Option<AutopilotType> {
        self.make
    }

    /// Motors armed, as the last heartbeat said.
    pub fn is_armed(&self) -> bool {
        self.armed
    }

    /// The same; `None` before a heartbeat was received.
    pub fn armed(&self) -> Option<bool> {
        self.heartbeat_received.then_some(self.armed)
    }

    /// Neither on the ground nor on its way up from it; not before that was reported.
    pub fn has_taken_off(&self) -> bool {
        self.landed_state == LandedState::InAir
    }

    /// On the ground or not, as it was reported last.
    pub fn landed_state(&self) -> LandedState {
        self.landed_state
    }

    /// Goes on with what the gateway before has known, until the autopilot says otherwise.
    pub fn resume(&mut self, mode: NavMode, armed: bool, landed_state: LandedState) {
        self.mode = mode;
        self.armed = armed;
        self.landed_state = landed_state;
    }

    /// Takes the mode and the arming state.
    pub fn take_heartbeat(&mut self, heartbeat: &HEARTBEAT_DATA) {
        self.make = AutopilotType::of(heartbeat.autopilot);
        self.take_mode(heartbeat.custom_mode);
        self.heartbeat_received = true;
        self.armed = heartbeat
            .base_mode
            .contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
    }

    /// Takes a mode as it is numbered by the make that was seen.
    pub fn take_mode(&mut self, custom_mode: u32) {
        self.custom_mode = custom_mode;
        // Another make's numbers mean something else.
        let mode = self
            .make
            .map_or(NavMode::Unknown, |make| make.nav_mode(custom_mode));
        self.change_mode(mode);
        let unnamed = self.make.is_some_and(|make| make.is_unnamed_auto(custom_mode));
        self.heartbeat_mode = (self.mode, self.mode != NavMode::Unknown || !unnamed);
    }

    /// Takes the height of home as it follows from local and global position: sooner than the autopilot reports it.
    pub fn infer_home(&mut self, home_down_m: f64) {
        self.home_down_m = home_down_m;
    }

    /// Takes whether the vehicle stands on the ground.
    pub fn take_landed(&mut self, state: &EXTENDED_SYS_STATE_DATA) {
        self.landed_state = match state.landed_state {
            MavLandedState::MAV_LANDED_STATE_ON_GROUND => LandedState::OnGround,
            MavLandedState::MAV_LANDED_STATE_TAKEOFF => LandedState::TakingOff,
            MavLandedState::MAV_LANDED_STATE_IN_AIR | MavLandedState::MAV_LANDED_STATE_LANDING => {
                LandedState::InAir
            }
            MavLandedState::MAV_LANDED_STATE_UNDEFINED => return,
        };
    }

    /// Distance to the ground (m) and height above home (m), where they are known.
    pub fn heights_m(&self, now: Timestamp) -> [Option<f64>; 2] {
        let (ground_m, reported) = self.ground;
        let is_fresh = now.seconds_since(reported) <= GROUND_VALID_S;
        let above_home_m = self.fix.map(|fix| self.home_down_m - fix.position.z);
        [Some(ground_m).filter(|_| is_fresh), above_home_m].map(|height| height.filter(|m| m.is_finite()))
    }

    /// Takes the distance to the ground; negative ones and NaN mean "not known".
    pub fn take_altitude(&mut self, altitude: &ALTITUDE_DATA, received: Timestamp) {
        let clearance_m = f64::from(altitude.bottom_clearance);
        let known = (0.0..MAX_COORDINATE_M).contains(&clearance_m);
        self.ground = (if known { clearance_m } else { f64::NAN }, received);
    }

    /// Takes the height of the home position.
    pub fn take_home(&mut self, home: &HOME_POSITION_DATA) {
        let down_m = f64::from(home.z);
        if down_m.abs() <= MAX_COORDINATE_M {
            self.home_down_m = down_m;
        }
    }

    /// Takes a position. Returns `true` if its stamp, the second in a row, shows that the autopilot has started anew; all motion is then
    /// forgotten, the coordinates count as reset, and the message itself is left out because its time is not known yet.
    pub fn take_position(
        &mut self,
        message: &LOCAL_POSITION_NED_DATA,
        received: Timestamp,
        time: Timestamp,
    ) -> bool {
        let position = Vector3::new(message.x, message.y, message.z).map(f64::from);
        let velocity = Vector3::new(message.vx, message.vy, message.vz).map(f64::from);
        let sane = position.iter().all(|c| c.abs() <= MAX_COORDINATE_M)
            && velocity.iter().all(|c| c.abs() <= MAX_SPEED_MPS);
        if !sane {
            return false;
        }
        match self.clock.take(Dated::Position, message.time_boot_ms, received) {
            Order::Late => return false,
            Order::Reboot => {
                self.forget_motion();
                return true;
            }
            Order::Next => {}
        }
        let fix = Fix {
            position,
            velocity,
            boot_ms: message.time_boot_ms,
            time,
        };
        if let Some(last) = self.fix {
            self.notice_jump(&last, &fix);
        }
        self.fix = Some(fix);
        false
    }

    fn notice_jump(&mut self, last: &Fix, fix: &Fix) {
        let passed_s = f64::from(fix.boot_ms.wrapping_sub(last.boot_ms)) * 1e-3;
        let expected = last.position + (last.velocity + fix.velocity) * (0.5 * passed_s);
        let jump = fix.position - expected;
        if jump.norm() > JUMP_FLOOR_M + 0.5 * JUMP_ACCELERATION_MPS2 * passed_s * passed_s {
            self.resets = self.resets.wrapping_add(1);
            self.shift += jump;
        }
    }

    /// Takes an attitude; says what became of it.
    pub fn take_attitude(
        &mut self,
        message: &ATTITUDE_QUATERNION_DATA,
        received: Timestamp,
        time: Timestamp,
    ) -> AttitudeNews {
        let components = [message.q1, message.q2, message.q3, message.q4].map(f64::from);
        let rates = Vector3::new(message.rollspeed, message.pitchspeed, message.yawspeed).map(f64::from);
        let rates_are_finite = rates.iter().all(|rate| rate.is_finite());
        let Some(local_q_body) = unit_quaternion(components).filter(|_| rates_are_finite) else {
            return AttitudeNews::Ignored;
        };
        match self.clock.take(Dated::Attitude, message.time_boot_ms, received) {
            Order::Late => return AttitudeNews::Ignored,
            Order::Reboot => {
                self.forget_motion();
                return AttitudeNews::Reboot;
            }
            Order::Next => {}
        }
        self.attitude = Attitude::from_rotation(local_q_body);
        self.rates = AngularRate::from_vector(rates);
        self.attitude_time = time.max(self.attitude_time);
        AttitudeNews::Taken
    }

    /// The autopilot's clock was set ahead by `ahead_s`: the last stamps are those of the clock as it is now, so that the next ones
    /// are neither late nor far ahead.
    pub fn clock_was_set(&mut self, ahead_s: f64) {
        let on_this_clock = |boot_ms: u32| boot_ms.wrapping_add((ahead_s * 1e3) as i64 as u32);
        for (boot_ms, _) in self.clock.last.iter_mut().flatten() {
            *boot_ms = on_this_clock(*boot_ms);
        }
        if let Some(fix) = &mut self.fix {
            fix.boot_ms = on_this_clock(fix.boot_ms);
        }
    }

    fn forget_motion(&mut self) {
        if self.fix.take().is_some() {
            self.resets = self.resets.wrapping_add(1);
        }
        self.ground = (f64::NAN, Timestamp::NEVER);
        self.landed_state = LandedState::Unknown;
        self.home_down_m = f64::NAN;
        self.clock = BootClock::default();
    }

    /// The state at the time of the last attitude, with that time; `None` before the first position and attitude.
    pub fn state(
        &self,
        now: Timestamp,
        system_id: u8,
        tracking: Tracking,
    ) -> Option<(VehicleState, Timestamp)> {
        let fix = self.fix?;
        if !self.attitude_time.is_set() {
            return None;
        }
        let alive = self.is_alive(now);
        let ground_is_fresh = now.seconds_since(self.ground.1) <= GROUND_VALID_S;
        let state = VehicleState {
            position: Point::<LocalNed>::from_vector(fix.carried_to(self.attitude_time)),
            velocity: Velocity::from_vector(fix.velocity),
            attitude: self.attitude,
            rates: self.rates,
            home_down_m: self.home_down_m,
            ground_distance_m: if ground_is_fresh { self.ground.0 } else { f64::NAN },
            estimator_resets: self.resets,
            system_id,
            mode: Coded::new(self.mode),
            armed: Flag::from(self.armed),
            landed: Flag::from(self.landed_state == LandedState::OnGround),
            position_valid: Flag::from(alive && self.is_position_valid(now)),
            autopilot_alive: Flag::from(alive),
            mode_pending: Flag::from(!self.heartbeat_received),
            position_time: fix.time,
            tracking,
            ..VehicleState::default()
        };
        Some((state, self.attitude_time))
    }
}
