//! The `[[sensor]]` table of one lidar or scanner. docs/lidars.md lists the keys.
//!
//! Position, mounting, ranges and rate have the keys that the simulator's sensors have, with the same meaning; keys
//! that only describe a simulated sensor are ignored. Every error is one sentence that names the sensor, the key and
//! what is possible.

mod keys;

use crate::models::{self, Connection, LidarModel, NetworkProtocol};
use jink_runtime::config::sensor_table::SensorKeys;
pub use jink_runtime::config::sensor_table::{Mistake, SensorTable};
use jink_shared_types::frames::Mounting;
use jink_shared_types::{BodyFrd, Point};
use keys::Keys;
use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;

/// The kinds of sensors that this driver is for.
pub const KINDS: [&str; 2] = ["lidar_3d", "lidar_2d"];

/// Where the data come from.
#[derive(Clone, Debug, PartialEq)]
pub enum Device {
    /// Datagrams to this address of this computer.
    Udp(SocketAddr),
    /// A recording.
    Pcap {
        /// Its path.
        path: PathBuf,
        /// It is played again and again.
        loops: bool,
    },
    /// A serial port.
    Serial {
        /// Its path.
        path: String,
        /// Its speed (bit/s).
        baud: u32,
    },
}

/// The meaning of a pulse without a return.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoReturn {
    /// Nothing.
    Unknown,
    /// Nothing is there up to `range_max_m`.
    Clear,
}

/// Which of several answers of one pulse count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Returns {
    /// The nearest.
    Nearest,
    /// The strongest.
    Strongest,
    /// All of them.
    Both,
}

/// A sector that the vehicle itself is in, in the sensor's own plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sector {
    /// From here (rad), clockwise from the sensor's front ...
    pub from_rad: f32,
    /// ... to here; may pass the front.
    pub to_rad: f32,
}

impl Sector {
    /// Whether a direction lies in it (rad, clockwise from the sensor's front).
    pub fn contains(&self, angle_rad: f32) -> bool {
        let turn = std::f32::consts::TAU;
        (angle_rad - self.from_rad).rem_euclid(turn) <= (self.to_rad - self.from_rad).rem_euclid(turn)
    }
}

/// What of a sensor's table concerns its clouds or scans.
#[derive(Clone, Debug, PartialEq)]
pub struct CloudSpec {
    /// Where it sits.
    pub position: Point<BodyFrd>,
    /// How it sits: `body_q_sensor`.
    pub mounting: Mounting,
    /// Shortest range (m).
    pub range_min_m: f32,
    /// Configured maximum (m).
    pub range_max_m: f32,
    /// One standard deviation of a range (m).
    pub sigma_m: f32,
    /// The meaning of a pulse without a return.
    pub no_return: NoReturn,
    /// Which answers of a pulse count.
    pub returns: Returns,
    /// Which of the answers, as the sensor lists them, is the strongest.
    pub strongest: u8,
    /// Where the vehicle itself is.
    pub blind: Vec<Sector>,
}

impl CloudSpec {
    /// Whether the vehicle itself is there; the direction is in the sensor frame, x forward, y left.
    pub fn is_blind(&self, direction: [f32; 3]) -> bool {
        if self.blind.is_empty() {
            return false;
        }
        let angle_rad = (-direction[1]).atan2(direction[0]);
        self.blind.iter().any(|sector| sector.contains(angle_rad))
    }
}

/// One lidar or scanner, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct LidarSpec {
    /// Its name.
    pub name: String,
    /// Its model.
    pub model: &'static LidarModel,
    /// Where its data come from.
    pub device: Device,
    /// Clouds or scans per second (Hz).
    pub rate_hz: f64,
    /// What concerns its clouds or scans.
    pub cloud: CloudSpec,
    /// Beams of a scan.
    pub beams: u32,
    /// Metadata of an Ouster sensor.
    pub metadata: Option<PathBuf>,
    /// Address of the sensor: data of others are foreign, and it is set up there.
    pub sensor_address: Option<IpAddr>,
    /// Address of this computer to which the sensor sends.
    pub host_address: Option<IpAddr>,
    /// UDP or TCP port of the sensor's control; zero: the model's.
    pub control_port: u16,
}

impl LidarSpec {
    /// The lidar called `name` among all sensors of a configuration.
    ///
    /// # Errors
    /// The first mistake found.
    pub fn find(tables: &[SensorTable], name: &str) -> Result<Self, Mistake> {
        Keys(SensorKeys::find(tables, name)?).spec()
    }

    /// Its protocol, if it is on the network.
    pub fn network(&self) -> Option<NetworkProtocol> {
        match self.model.connection {
            Connection::Network(protocol) => Some(protocol),
            Connection::Serial(_) => None,
        }
    }
}

/// Names of the models of a kind.
fn models_of(kind: &str) -> String {
    let models = models::TABLE.iter().filter(|model| model.kind() == kind);
    models.map(|model| model.name).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests;
