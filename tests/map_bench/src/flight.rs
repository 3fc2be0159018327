//! The line that is flown: a way through a forest, rounded, at constant speed, with an attitude as a multicopter has it.

use jink_shared_types::frames::{AngularRate, Attitude, Point, Velocity};
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{Flag, Timestamp};
use jink_simulated_world::sensors::{Pose, PoseTrack};
use jink_simulated_world::world::{World, WorldSpec};
use nalgebra::{UnitQuaternion, Vector3};

/// Distance from the trees (m).
const CLEARANCE_M: f64 = 1.0;
/// Speed along the way (m/s): a forest of 1/25 trees/m2 is crossed at 3 to 7 m/s.
const SPEED_MPS: f64 = 5.0;
/// Corners are rounded over this length to both sides (m).
const ROUNDED_M: f64 = 2.0;
/// Points that a rounded position is the mean of, to each side.
const ROUNDING: i32 = 16;
/// Nose down in forward flight (rad), and how far it rolls to and fro.
const PITCH_RAD: f64 = -0.1;
const ROLL_RAD: f64 = 0.1;
/// The clock at the start of the flight (s).
const START_S: f64 = 1_000.0;
/// Rate of vehicle states (Hz), as the gateway publishes them.
pub const STATES_HZ: f64 = 50.0;
/// Step of the poses that sensors are rendered from (s).
pub const STEP_S: f64 = 0.004;
/// Half of the difference by which velocities and rates are taken (s).
const HALF_S: f64 = 0.002;

/// Where the vehicle is at every moment.
pub enum Motion {
    /// Along the corners (local NED, m).
    Along(Vec<Vector3<f64>>),
    /// At rest, level, heading north, there (local NED, m).
    Rest(Vector3<f64>),
}

/// The moment `t_s` after the start of the flight.
pub fn at(t_s: f64) -> Timestamp {
    Timestamp::from_seconds(START_S + t_s)
}

/// The forest of `seed` (1/25 trees/m2, 60 m by 30 m) and a flight through it.
///
/// # Errors
/// A sentence that says why there is none.
pub fn forest(seed: u64) -> Result<(World, Motion), String> {
    let spec = WorldSpec {
        kind: jink_simulated_world::world::WorldKind::ALL[0].clone(),
        seed,
        density_per_m2: None,
    };
    let world = World::from_spec(&spec).map_err(|error| error.to_string())?;
    let way = world.way(CLEARANCE_M).ok_or_else(|| {
        format!("the forest of seed {seed} has no way with {CLEARANCE_M} m to all sides; take another --seed")
    })?;
    let corners = way.iter().map(|corner| corner.vector()).collect();
    Ok((world, Motion::Along(corners)))
}

impl Motion {
    /// How long the flight can take (s).
    pub fn longest_s(&self) -> f64 {
        match self {
            Self::Along(corners) => {
                let length_m: f64 = corners.windows(2).map(|leg| (leg[1] - leg[0]).norm()).sum();
                (length_m / SPEED_MPS).floor()
            }
            Self::Rest(_) => f64::INFINITY,
        }
    }

    /// Position (local NED, m).
    fn position_m(&self, t_s: f64) -> Vector3<f64> {
        match self {
            Self::Along(corners) => {
                // Weights of a hat: the mean of the mean.
                let weights = (-ROUNDING..=ROUNDING).map(|i| (i, f64::from(ROUNDING + 1 - i.abs())));
                let (sum, weight) = weights.fold((Vector3::zeros(), 0.0), |(sum, total), (i, weight)| {
                    let along_m = SPEED_MPS * t_s + ROUNDED_M * (1.0 + f64::from(i) / f64::from(ROUNDING));
                    (sum + along(corners, along_m) * weight, total + weight)
                });
                sum / weight
            }
            Self::Rest(position_m) => *position_m,
        }
    }

    fn velocity_mps(&self, t_s: f64) -> Vector3<f64> {
        (self.position_m(t_s + HALF_S) - self.position_m(t_s - HALF_S)) / (2.0 * HALF_S)
    }

    /// `local_q_body`.
    fn attitude(&self, t_s: f64) -> UnitQuaternion<f64> {
        match self {
            Self::Along(_) => {
                let velocity = self.velocity_mps(t_s);
                let yaw_rad = velocity.y.atan2(velocity.x);
                UnitQuaternion::from_euler_angles(ROLL_RAD * (1.3 * t_s).sin(), PITCH_RAD, yaw_rad)
            }
            Self::Rest(_) => UnitQuaternion::identity(),
        }
    }

    /// The pose that sensors are rendered from.
    pub fn pose(&self, t_s: f64) -> Pose {
        Pose {
            position: Point::from_vector(self.position_m(t_s)),
            attitude: self.attitude(t_s),
        }
    }

    /// The state as the gateway publishes it.
    pub fn state(&self, t_s: f64) -> VehicleState {
        let (before, after) = (self.attitude(t_s - HALF_S), self.attitude(t_s + HALF_S));
        let rates_radps = (before.inverse() * after).scaled_axis() / (2.0 * HALF_S);
        VehicleState {
            position: Point::from_vector(self.position_m(t_s)),
            velocity: Velocity::from_vector(self.velocity_mps(t_s)),
            attitude: Attitude::from_rotation(self.attitude(t_s)),
            rates: AngularRate::from_vector(rates_radps),
            position_valid: Flag::YES,
            autopilot_alive: Flag::YES,
            armed: Flag::YES,
            ..VehicleState::default()
        }
    }

    /// Every pose from the start to `seconds` after it.
    pub fn track(&self, seconds: f64) -> PoseTrack {
        let mut track = PoseTrack::new(seconds + 1.0, STEP_S);
        let steps = (seconds / STEP_S).ceil() as u32;
        for step in 0..=steps {
            let t_s = f64::from(step) * STEP_S;
            track.push(at(t_s), self.pose(t_s));
        }
        track
    }
}

/// The place `along_m` behind the first of `corners`.
fn along(corners: &[Vector3<f64>], along_m: f64) -> Vector3<f64> {
    let mut left_m = along_m.max(0.0);
    for leg in corners.windows(2) {
        let length_m = (leg[1] - leg[0]).norm();
        if left_m <= length_m && length_m > 0.0 {
            return leg[0] + (leg[1] - leg[0]) * (left_m / length_m);
        }
        left_m -= length_m;
    }
    corners.last().copied().unwrap_or_default()
}
