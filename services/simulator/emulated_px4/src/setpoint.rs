//! What passes between navigation, flight task and controller. NaN means "not given" in every vector and number.

use nalgebra::Vector3;

/// What a waypoint is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointKind {
    /// Fly there.
    Position,
    /// Stay there.
    Loiter,
    /// Take off to it.
    Takeoff,
    /// Land there.
    Land,
    /// Keep the motors idle.
    Idle,
}

/// The waypoint being flown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurrentPoint {
    /// Purpose.
    pub kind: PointKind,
    /// Place, local NED (m), in single precision; x and y NaN = where the vehicle is when it begins.
    pub position: Vector3<f64>,
    /// Heading (rad); NaN = none.
    pub yaw_rad: f64,
    /// Acceptance radius (m).
    pub acceptance_m: f64,
    /// Speed (m/s); NaN = MPC_XY_CRUISE.
    pub cruise_mps: f64,
}

/// The waypoint after it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NextPoint {
    /// Place, local NED (m), in single precision.
    pub position: Vector3<f64>,
    /// Heading (rad); NaN = none.
    pub yaw_rad: f64,
}

/// Previous, current and next waypoint. No current one: the vehicle is disarmed on the ground.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Triplet {
    /// Where the leg started.
    pub previous: Option<Vector3<f64>>,
    /// Where it leads.
    pub current: Option<CurrentPoint>,
    /// What comes then.
    pub next: Option<NextPoint>,
}

/// What the position controller follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionSetpoint {
    /// Position, local NED (m).
    pub position: Vector3<f64>,
    /// Velocity fed forward (m/s).
    pub velocity: Vector3<f64>,
    /// Acceleration fed forward (m/s^2).
    pub acceleration: Vector3<f64>,
    /// Heading (rad).
    pub yaw_rad: f64,
    /// Heading rate (rad/s).
    pub yaw_rate_radps: f64,
}

impl MotionSetpoint {
    /// Nothing given.
    pub fn unset() -> Self {
        Self {
            position: unset(),
            velocity: unset(),
            acceleration: unset(),
            yaw_rad: f64::NAN,
            yaw_rate_radps: f64::NAN,
        }
    }

    /// No thrust: a downward acceleration no rotor can give.
    pub fn idle() -> Self {
        Self {
            acceleration: Vector3::new(0.0, 0.0, 100.0),
            ..Self::unset()
        }
    }
}

/// Speed limits that come with a setpoint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedCaps {
    /// Horizontal (m/s).
    pub horizontal_mps: f64,
    /// Upwards (m/s).
    pub up_mps: f64,
    /// Downwards (m/s).
    pub down_mps: f64,
}

/// A vector of NaN.
pub fn unset() -> Vector3<f64> {
    Vector3::repeat(f64::NAN)
}

/// Whether all components are finite.
pub fn is_finite(v: &Vector3<f64>) -> bool {
    v.iter().all(|c| c.is_finite())
}
