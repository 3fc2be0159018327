//! What flies the vehicle, whichever autopilot it is.
//!
//! | in | out |
//! |---|---|
//! | [`Packet`]s received on two links | [`Packet`]s to send, the truth about the flight |
//!
//! Processes, lock-step flights and the [`Observer`](crate::truth::Observer) speak to this and need not know the make.

use crate::ardupilot::{Abort, ArduCopter, ArduCopterConfig};
use crate::autopilot::{
    Autopilot, AutopilotConfig, MissionProgress, Packet, SetpointStatistics, UnknownParameter,
};
use crate::vehicle::estimator::Estimate;
use crate::vehicle::{VehicleConfig, VehicleTruth};
use jink_shared_types::vehicle::NavMode;
use nalgebra::Vector3;

/// Which autopilot, and how it is set.
#[derive(Clone, Debug)]
pub enum FlyerConfig {
    /// One of the two firmwares of PX4.
    Px4(AutopilotConfig),
    /// ArduCopter.
    ArduCopter(ArduCopterConfig),
}

/// Drag of the quadrotor that current PX4 flies in demonstrations (N s/m per kg): that of a light, real one.
const LIGHT_DRAG: f64 = 0.1;

impl FlyerConfig {
    /// The names of those that [`FlyerConfig::named`] knows.
    pub const NAMES: [&'static str; 3] = ["px4", "px4_current", "ardupilot"];

    /// By its name in a configuration; `None` for a name that means nothing.
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "px4" => Some(Self::Px4(AutopilotConfig::default())),
            "px4_current" => Some(Self::Px4(AutopilotConfig::current(LIGHT_DRAG))),
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

    /// Boots it; the vehicle stands on the ground.
    ///
    /// # Errors
    /// A parameter that it does not have.
    pub fn build(self) -> Result<Box<dyn Flyer>, UnknownParameter> {
        Ok(match self {
            Self::Px4(config) => Box::new(Autopilot::new(config)?),
            Self::ArduCopter(config) => Box::new(ArduCopter::new(config)?),
        })
    }
}

/// An autopilot with the vehicle it flies.
pub trait Flyer {
    /// 4 ms: takes `inbox`, flies, and appends what it has to say to `outbox`.
    fn step(&mut self, inbox: &[Packet], outbox: &mut Vec<Packet>);

    /// Time since boot (s).
    fn time_s(&self) -> f64;

    /// Where the vehicle really is.
    fn truth(&self) -> &VehicleTruth;

    /// Where it believes to be.
    fn estimate(&self) -> &Estimate;

    /// Mode in force.
    fn mode(&self) -> NavMode;

    /// Motors armed.
    fn is_armed(&self) -> bool;

    /// On the ground, as the land detector says.
    fn is_landed(&self) -> bool;

    /// How far the mission has come.
    fn mission(&self) -> MissionProgress;

    /// What arrived from the companion.
    fn setpoint_statistics(&self) -> &SetpointStatistics;

    /// Lets the estimated position jump by `by` (m, local NED), as a reset of the estimator does.
    fn jump_estimate(&mut self, by: Vector3<f64>);

    /// How often it fell to Hold because its companion failed it: only PX4 does.
    fn hold_count(&self) -> u32 {
        0
    }

    /// What ended the autopilot's process, if something did.
    fn aborted(&self) -> Option<Abort> {
        None
    }
}

macro_rules! delegate {
    ($of:ty { $($rest:tt)* }) => {
        impl Flyer for $of {
            fn step(&mut self, inbox: &[Packet], outbox: &mut Vec<Packet>) {
                self.step(inbox, outbox);
            }

            fn time_s(&self) -> f64 {
                self.time_s()
            }

            fn truth(&self) -> &VehicleTruth {
                self.truth()
            }

            fn estimate(&self) -> &Estimate {
                self.estimate()
            }

            fn mode(&self) -> NavMode {
                self.mode()
            }

            fn is_armed(&self) -> bool {
                self.is_armed()
            }

            fn is_landed(&self) -> bool {
                self.is_landed()
            }

            fn mission(&self) -> MissionProgress {
                self.mission()
            }

            fn setpoint_statistics(&self) -> &SetpointStatistics {
                self.setpoint_statistics()
            }

            fn jump_estimate(&mut self, by: Vector3<f64>) {
                self.jump_estimate(by);
            }

            $($rest)*
        }
    };
}

delegate!(Autopilot {
    fn hold_count(&self) -> u32 {
        self.hold_count()
    }
});

delegate!(ArduCopter {
    fn aborted(&self) -> Option<Abort> {
        self.aborted()
    }
});
