//! What an autopilot is given at its start.

use super::firmware::Firmware;
use super::pace::Pace;
use jink_shared_types::geo::GlobalPoint;
use jink_simulated_world::vehicle::VehicleConfig;
use jink_simulated_world::vehicle::estimator::EstimatorConfig;

/// What an autopilot is given at its start.
#[derive(Clone, Debug)]
pub struct Px4Config {
    /// MAVLink system id. PX4's own demand for Hold reaches system 1 only.
    pub system_id: u8,
    /// Which PX4 this is.
    pub firmware: Firmware,
    /// The vehicle.
    pub vehicle: VehicleConfig,
    /// The estimator.
    pub estimator: EstimatorConfig,
    /// Local origin on the globe.
    pub origin: GlobalPoint,
    /// Height of the local origin above sea level (m).
    pub origin_altitude_m: f64,
    /// From boot until the estimator has a position (s).
    pub ready_after_s: f64,
    /// Wall clock at boot, for SYSTEM_TIME only (us since 1970).
    pub unix_start_us: u64,
    /// How its time passes beside everybody else's.
    pub pace: Pace,
    /// Parameters that differ from the defaults, by PX4's name.
    pub parameters: Vec<(String, f64)>,
}

impl Default for Px4Config {
    fn default() -> Self {
        Self {
            system_id: 1,
            firmware: Firmware::default(),
            vehicle: VehicleConfig::default(),
            estimator: EstimatorConfig::default(),
            origin: GlobalPoint {
                latitude_deg: 47.397_742,
                longitude_deg: 8.545_594,
            },
            origin_altitude_m: 488.0,
            ready_after_s: 1.0,
            unix_start_us: 1_626_393_600_000_000,
            pace: Pace::default(),
            parameters: Vec::new(),
        }
    }
}

impl Px4Config {
    /// Current PX4 on the quadrotor of its built-in simulator, as it was observed. `drag_linear`:
    /// [`VehicleConfig::built_in`].
    pub fn current(drag_linear: f64) -> Self {
        Self {
            firmware: Firmware::Current,
            vehicle: VehicleConfig::built_in(drag_linear),
            estimator: EstimatorConfig {
                // On a straight way the real one strays 0.02 m to the side, at most 0.04.
                position_sigma_m: 0.015,
                ..EstimatorConfig::default()
            },
            ..Self::default()
        }
    }
}
