//! Which autopilot flies the vehicle, by its name in a configuration.

use jink_emulated_arducopter::{ArduCopter, ArduCopterConfig};
use jink_emulated_autopilot::{Autopilot, UnknownParameter};
use jink_emulated_px4::{Px4, Px4Config};
use jink_simulated_world::vehicle::VehicleConfig;
use jink_simulated_world::vehicle::estimator::EstimatorConfig;

/// Which autopilot, and how it is set.
#[derive(Clone, Debug)]
pub enum AutopilotConfig {
    /// One of the two firmwares of PX4.
    Px4(Px4Config),
    /// ArduCopter.
    ArduCopter(ArduCopterConfig),
}

/// Drag of the quadrotor that current PX4 flies in demonstrations (N s/m per kg): that of a light, real one.
const LIGHT_DRAG: f64 = 0.1;

impl AutopilotConfig {
    /// The names of those that [`AutopilotConfig::named`] knows.
    pub const NAMES: [&'static str; 3] = ["px4", "px4_current", "ardupilot"];

    /// By its name in a configuration; `None` for a name that means nothing.
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "px4" => Some(Self::Px4(Px4Config::default())),
            "px4_current" => Some(Self::Px4(Px4Config::current(LIGHT_DRAG))),
            "ardupilot" => Some(Self::ArduCopter(ArduCopterConfig::default())),
            _ => None,
        }
    }

    /// Sets its MAVLink system id.
    #[must_use]
    pub fn with_system_id(mut self, id: u8) -> Self {
        match &mut self {
            Self::Px4(config) => config.system_id = id,
            Self::ArduCopter(config) => config.system_id = id,
        }
        self
    }

    /// Sets a parameter, by the autopilot's own name.
    #[must_use]
    pub fn with_parameter(mut self, name: &str, value: f64) -> Self {
        let parameters = match &mut self {
            Self::Px4(config) => &mut config.parameters,
            Self::ArduCopter(config) => &mut config.parameters,
        };
        parameters.push((name.to_owned(), value));
        self
    }

    /// The vehicle it flies.
    pub fn vehicle_mut(&mut self) -> &mut VehicleConfig {
        match self {
            Self::Px4(config) => &mut config.vehicle,
            Self::ArduCopter(config) => &mut config.vehicle,
        }
    }

    /// Its estimator.
    pub fn estimator_mut(&mut self) -> &mut EstimatorConfig {
        match self {
            Self::Px4(config) => &mut config.estimator,
            Self::ArduCopter(config) => &mut config.estimator,
        }
    }

    /// Boots it; the vehicle stands on the ground.
    ///
    /// # Errors
    /// A parameter that it does not have.
    pub fn build(self) -> Result<Box<dyn Autopilot>, UnknownParameter> {
        Ok(match self {
            Self::Px4(config) => Box::new(Px4::new(config)?),
            Self::ArduCopter(config) => Box::new(ArduCopter::new(config)?),
        })
    }
}
