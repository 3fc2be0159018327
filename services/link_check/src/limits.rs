//! Where good ends: every threshold of the check, with its reason.

/// Bytes without one intact message that are no MAVLink: the longest frame has 293, so a whole one must have been among
/// these.
pub const NO_MAVLINK_BYTES: u64 = 600;
/// Part of the bytes that may belong to no message: a good line has none, and one in fifty is a setpoint lost each
/// second.
pub const GARBAGE_PART: f64 = 0.02;
/// The same for messages whose sequence number was never received.
pub const LOST_PART: f64 = 0.02;
/// Messages before a part of them is significant.
pub const PART_OF_AT_LEAST: u64 = 100;

/// Three heartbeats: an autopilot that has not been received for so long (s) is gone.
pub const SILENT_S: f64 = 3.0;
/// Below this rate of positions or attitudes (Hz) `vehicle/state`, stale after 100 ms, is stale for its readers, and
/// jink holds.
pub const STATE_RATE_MIN_HZ: f64 = 10.0;

/// PX4 takes part in a synchronisation of clocks only with round trips below this (s); longer ones never converge
/// there.
pub const PX4_ROUND_TRIP_MAX_S: f64 = 0.010;

/// What the reference flights were flown with, and what jink's tracking tube is measured for (m/s^2).
pub const MPC_ACC_HOR_MIN_MPS2: f64 = 3.0;
/// The same for the jerk (m/s^3).
pub const MPC_JERK_AUTO_MIN_MPS3: f64 = 4.0;

/// The shortest COM_OF_LOSS_T that was flown (s); with less, a restart of the gateway may count as a loss.
pub const COM_OF_LOSS_T_MIN_S: f64 = 0.3;
/// The shortest EAV_TIMEOUT with which a restart of the gateway goes unnoticed (s): several times the gap of some 60 ms
/// that a killed gateway leaves.
pub const EAV_TIMEOUT_MIN_S: f64 = 0.3;
/// PX4's default (s): from 4.5 m/s the vehicle then goes on for 5 to 7 m, and each further second is another 4.5.
pub const COM_OF_LOSS_T_MAX_S: f64 = 1.0;

/// Five setpoints at 50 Hz, and the shortest that was flown (s): with less, one late setpoint is a stop.
pub const GUID_TIMEOUT_MIN_S: f64 = 0.1;
/// With 0.5 s the vehicle goes 8 m past the last setpoint from 4.5 m/s, with ArduPilot's default of 3 s 19 m
/// (measured); up to this (s) there is no warning.
pub const GUID_TIMEOUT_MAX_S: f64 = 1.0;

/// Up to this speed (m/s) ArduCopter's defaults follow what jink sends; a weave at 8 m/s was lost by 8 m with them
/// (measured).
pub const FAST_MPS: f64 = 5.0;
/// Acceleration in which ArduCopter corrects errors: its default, and what followed 8 m/s (m/s^2).
pub const WP_ACC_MIN_MPS2: [f64; 2] = [2.5, 9.0];
/// The same for the jerk (m/s^3).
pub const PSC_JERK_MIN_MPS3: [f64; 2] = [5.0, 20.0];
/// The same for the lean (degrees).
pub const ANGLE_MAX_MIN_DEG: [f64; 2] = [30.0, 45.0];

/// PX4's default for multicopters up to 1.17 (m). With more it counts an item as reached from farther off, and does
/// there what the next item says.
pub const NAV_ACC_RAD_MAX_M: f64 = 2.0;

/// How long the check lasts at least once the autopilot is received (s): senders with one message in a second or two
/// are received by then, a second autopilot among them.
pub const LISTEN_S: f64 = 5.0;
/// Pause between two requests of any kind (s): two hundred bytes a second, a small part of what 57600 bit/s carry.
pub const REQUEST_PAUSE_S: f64 = 0.05;
/// An unanswered request is repeated after this (s) ...
pub const RETRY_S: f64 = 0.7;
/// ... and given up after so many attempts.
pub const ATTEMPTS_MAX: u8 = 3;
