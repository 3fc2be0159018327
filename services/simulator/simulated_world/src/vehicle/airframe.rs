//! What is asked of an airframe, how it responds, and the steps in which that is computed.

use nalgebra::UnitQuaternion;

/// Duration of one step (s).
pub const STEP_S: f64 = 0.004;
/// Duration of one step (us).
pub const STEP_US: u64 = 4_000;
/// Standard gravity (m/s^2).
pub const GRAVITY_MPS2: f64 = 9.80665;
/// Share of the full thrust that carries the vehicle: PX4's MPC_THR_HOVER default.
pub const HOVER_THRUST: f64 = 0.5;

/// Lag of the rate loop (s). With it the tilt response is of second order, 13 rad/s with damping 0.98; among 0.03 to 0.1 s
/// the value matters little, the errors measured on PX4 in OFFBOARD (test `px4_current_tracking`) prefer the quick end.
const RATE_LAG_S: f64 = 0.04;

/// Time constants of the airframe (s).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    /// Motors, when thrust rises.
    pub thrust_rise_s: f64,
    /// Motors, when thrust falls.
    pub thrust_fall_s: f64,
    /// Tilt behind its setpoint: the inverse of MC_ROLL_P and MC_PITCH_P.
    pub tilt_s: f64,
    /// Body rates behind their setpoints.
    pub rates_s: f64,
}

impl Default for Response {
    /// The x500 motor model of PX4's simulator, and the lag of the rate loop.
    fn default() -> Self {
        Self {
            thrust_rise_s: 0.0125,
            thrust_fall_s: 0.025,
            tilt_s: 1.0 / 6.5,
            rates_s: RATE_LAG_S,
        }
    }
}

/// What the autopilot asks of the airframe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActuatorCommand {
    /// Attitude setpoint, `local_q_body`.
    pub attitude: UnitQuaternion<f64>,
    /// Heading rate fed forward (rad/s).
    pub yaw_rate_radps: f64,
    /// Collective thrust, 0 to 1; [`HOVER_THRUST`] carries the vehicle.
    pub thrust: f64,
}
