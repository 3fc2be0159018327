//! Whether the sensors of a running jink can be flown with, judged by what they say over some seconds.
//!
//! | in | out |
//! |---|---|
//! | `range/scan/*`, `range/cloud/*` of every configured sensor ([`SensorSeen`]) | whether it sends data, in time, and credibly |
//! | `guard/ring` ([`RingSeen`]) | which directions no sensor covers, and what that means with these parameters |
//! | `map/local`, `plan/route` ([`KnownSpace`]) | what is declared, and which directions are missing |
//! | `map/local` | faults of sensors that showed in flight |
//! | `vehicle/state`, events | whether ranges can be placed, what was reported to the pilot |
//!
//! Coverage is counted as the guard counts it: in sectors of five degrees, each as a whole as soon as it is looked into.

mod circle;
mod frame;
mod judge;
mod ring;
mod sensor;
mod timing;

pub use circle::{Interval, Sectors};
pub use frame::SensorType;
pub use judge::{judge, subject};
pub use ring::{RingFigures, RingSeen};
pub use sensor::{OrientationKey, Rate, SensorFigures, SensorSeen, SensorTable};
pub use timing::Timing;

use jink_control::known_space::KnownSpace;
use jink_shared_types::events::EventSample;
use jink_shared_types::faults::SensorFault;
use jink_shared_types::params::{self, ParamSet};
use jink_shared_types::ranges::SENSORS;
use serde_json::{Map, Value, json};

/// How far beyond the vehicle's radius a range may still be the vehicle (m): landing gear, antennas, what hangs below.
const OWN_MARGIN_M: f64 = 0.2;

/// Everything that was seen.
#[derive(Clone, Debug)]
pub struct Seen {
    /// Every configured sensor.
    pub sensors: Vec<SensorSeen>,
    /// The guard's ring.
    pub ring: RingSeen,
    /// Vehicle states with a position that may be used.
    pub states: u64,
    /// What map and planner said last of all sensors together.
    pub space: Option<KnownSpace>,
    /// What was reported to the pilot.
    pub events: Vec<EventSample>,
    /// What the newest map says of each sensor, in the order of the configuration.
    pub faults: [SensorFault; SENSORS],
    /// For how long (s).
    pub seconds: f64,
    /// The parameters in force.
    pub params: ParamSet,
}

impl Seen {
    /// Nothing yet of `sensors`, in a vehicle with `params`.
    pub fn new(sensors: impl IntoIterator<Item = SensorTable>, params: ParamSet) -> Self {
        Self {
            sensors: sensors.into_iter().map(SensorSeen::new).collect(),
            ring: RingSeen::default(),
            states: 0,
            space: None,
            events: Vec::new(),
            faults: [SensorFault::Unknown; SENSORS],
            seconds: 0.0,
            params,
        }
    }

    /// What is nearer to the vehicle's centre than this may be the vehicle itself (m).
    pub fn own_m(&self) -> f64 {
        self.params.get(&params::OA_VEH_RADIUS) + OWN_MARGIN_M
    }

    /// For scripts: what stands beside the findings.
    pub fn figures(&self) -> Map<String, Value> {
        let sensors: Vec<SensorFigures> = self.sensors.iter().map(SensorSeen::figures).collect();
        let mut figures = Map::new();
        figures.insert("sensors".to_owned(), json!(sensors));
        figures.insert("ring".to_owned(), json!(self.ring.figures()));
        figures.insert("space".to_owned(), json!(self.space));
        figures
    }
}

#[cfg(test)]
mod tests;
