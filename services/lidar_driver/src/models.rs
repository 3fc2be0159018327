//! The models: everything that differs between them but the decoding, in one table.
//!
//! docs/lidars.md says which devices they are.
//!
//! Ranges are those of the data sheets for targets that reflect well. A return from beyond `range_max_m` means that the
//! ray is free up to there; where nothing returned nothing is known, unless the table declares `no_return = "clear"`. A
//! Livox does not report where it got no return, so its table cannot declare that.

/// Where a model is connected, and its protocol.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Connection {
    /// Datagrams.
    Network(NetworkProtocol),
    /// A serial port.
    Serial(SerialProtocol),
}

/// The protocol of a network lidar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NetworkProtocol {
    /// [`crate::ouster`].
    Ouster,
    /// [`crate::velodyne`], with these lasers.
    Velodyne(&'static crate::velodyne::Lasers),
    /// [`crate::livox::sdk2`].
    Livox2,
    /// [`crate::livox::sdk1`].
    Livox1,
}

/// The protocol of a scanner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SerialProtocol {
    /// scanner ldrobot.
    Ldrobot,
    /// scanner rplidar.
    Rplidar {
        /// The motor turns while DTR is off (the A1's board).
        motor_by_dtr: bool,
        /// The motor is started by a command, with this duty cycle (A2, A3 on the accessory board).
        motor_pwm: Option<u16>,
    },
}

/// One model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LidarModel {
    /// Name in the configuration.
    pub name: &'static str,
    /// Connection.
    pub connection: Connection,
    /// Speed of its serial port as delivered (bit/s); zero on the network.
    pub baud: u32,
    /// UDP port to which it sends ranges as delivered; zero on a serial port.
    pub port: u16,
    /// Shortest range (m).
    pub range_min_m: f64,
    /// Longest range (m).
    pub range_max_m: f64,
    /// One standard deviation of a range (m).
    pub sigma_m: f64,
    /// Clouds or scans per second as delivered (Hz).
    pub rate_hz: f64,
    /// Beams of a published scan; zero of a cloud.
    pub beams: u32,
}

const fn network(name: &'static str, protocol: NetworkProtocol, port: u16, range_m: [f64; 2]) -> LidarModel {
    LidarModel {
        name,
        connection: Connection::Network(protocol),
        baud: 0,
        port,
        range_min_m: range_m[0],
        range_max_m: range_m[1],
        sigma_m: 0.03,
        rate_hz: 10.0,
        beams: 0,
    }
}

const fn ldrobot(name: &'static str, baud: u32, range_m: [f64; 2], beams: u32) -> LidarModel {
    LidarModel {
        name,
        connection: Connection::Serial(SerialProtocol::Ldrobot),
        baud,
        port: 0,
        range_min_m: range_m[0],
        range_max_m: range_m[1],
        sigma_m: 0.05,
        rate_hz: 10.0,
        beams,
    }
}

const fn rplidar(
    name: &'static str,
    baud: u32,
    range_m: [f64; 2],
    rate_hz: f64,
    protocol: SerialProtocol,
) -> LidarModel {
    LidarModel {
        name,
        connection: Connection::Serial(protocol),
        baud,
        port: 0,
        range_min_m: range_m[0],
        range_max_m: range_m[1],
        sigma_m: 0.06,
        rate_hz,
        beams: 360,
    }
}

const fn motor(by_dtr: bool, pwm: Option<u16>) -> SerialProtocol {
    SerialProtocol::Rplidar {
        motor_by_dtr: by_dtr,
        motor_pwm: pwm,
    }
}

/// Every model.
pub const TABLE: &[LidarModel] = &[
    network("ouster", NetworkProtocol::Ouster, 7502, [0.3, 240.0]),
    // The same protocol; a simulation distinguishes them.
    network("ouster_os0", NetworkProtocol::Ouster, 7502, [0.3, 100.0]),
    network("ouster_os1", NetworkProtocol::Ouster, 7502, [0.3, 200.0]),
    network("ouster_os2", NetworkProtocol::Ouster, 7502, [0.8, 240.0]),
    network(
        "vlp16",
        NetworkProtocol::Velodyne(&crate::velodyne::VLP16_LASERS),
        2368,
        [0.5, 100.0],
    ),
    network(
        "vlp16_hires",
        NetworkProtocol::Velodyne(&crate::velodyne::HI_RES_LASERS),
        2368,
        [0.5, 100.0],
    ),
    network("livox_mid360", NetworkProtocol::Livox2, 56_301, [0.1, 70.0]),
    network("livox_avia", NetworkProtocol::Livox1, 60_001, [1.0, 320.0]),
    ldrobot("ld06", 230_400, [0.02, 12.0], 360),
    ldrobot("ld19", 230_400, [0.02, 12.0], 360),
    ldrobot("stl27l", 921_600, [0.03, 25.0], 720),
    rplidar("rplidar_a1", 115_200, [0.15, 12.0], 5.5, motor(true, None)),
    rplidar("rplidar_a2", 115_200, [0.15, 16.0], 10.0, motor(true, Some(660))),
    rplidar("rplidar_a3", 256_000, [0.15, 25.0], 10.0, motor(true, Some(660))),
    rplidar("rplidar_s1", 256_000, [0.1, 40.0], 10.0, motor(false, None)),
    rplidar("rplidar_s2", 1_000_000, [0.05, 30.0], 10.0, motor(false, None)),
    rplidar("rplidar_c1", 460_800, [0.05, 12.0], 10.0, motor(false, None)),
];

/// The model called `name`.
pub fn find(name: &str) -> Option<&'static LidarModel> {
    TABLE.iter().find(|model| model.name == name)
}

impl LidarModel {
    /// The kind of sensor that it is in the configuration.
    pub fn kind(&self) -> &'static str {
        match self.connection {
            Connection::Network(_) => "lidar_3d",
            Connection::Serial(_) => "lidar_2d",
        }
    }
}
