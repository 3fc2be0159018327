//! What is sent to a Livox sensor so that it sends points, and what it answers: pure, the service has the sockets.
//!
//! | protocol | step | message |
//! |---|---|---|
//! | second | search | 0x0000 to the broadcast address, port 56000; the answer names type, serial number, address and control port |
//! | second | set up | 0x0100 to the control port 56100: data type, address and port for point data, work mode "sampling" |
//! | first | search | the sensor broadcasts itself to port 55000 |
//! | first | handshake | set 0, 0x01 to port 65000: our address, ports for points, commands, inertial data |
//! | first | set up | set 0, 0x05 Cartesian coordinates, then 0x04 sampling on |
//! | first | heartbeat | set 0, 0x03 every second: without it the sensor stops after five |
//!
//! A set-up is repeated every second as long as no points come, so that a sensor that was switched off is set up anew.
//!
//! Sources: the communication protocols of the Mid-360 (chapters "Control Command", "CMD Details") and of the first SDK
//! (V1.3.0).

use super::crc::{SDK1_CRC16, SDK1_CRC32, SDK2_CRC16, SDK2_CRC32};
use crate::decode::{bytes_at, u16_at, u32_at};
use jink_shared_types::Timestamp;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};

/// Between two attempts, and between two heartbeats (s).
const PERIOD_S: f64 = 1.0;
/// Silence (s) after which a sensor is set up anew.
const SILENCE_S: f64 = 1.0;
/// Longest message that is sent.
const MESSAGE_BYTES: usize = 64;

/// Ports of the second protocol.
const SDK2_SEARCH_PORT: u16 = 56_000;
const SDK2_CONTROL_PORT: u16 = 56_100;
const SDK2_POINT_PORT: u16 = 56_300;
const SDK2_HEAD: usize = 24;
const SDK2_SEARCH: u16 = 0x0000;
const SDK2_SET: u16 = 0x0100;
/// Device type of a Mid-360, and of its successor with the same protocol.
const SDK2_TYPES: [u8; 2] = [9, 35];
const KEY_DATA_TYPE: u16 = 0x0000;
const KEY_POINT_HOST: u16 = 0x0006;
const KEY_WORK_MODE: u16 = 0x001A;
const SAMPLING: u8 = 1;

/// Ports of the first protocol.
pub const SDK1_BROADCAST_PORT: u16 = 55_000;
const SDK1_CONTROL_PORT: u16 = 65_000;
const SDK1_HEAD: usize = 11;
const SDK1_FOOT: usize = 4;
const SDK1_BROADCAST: u8 = 0x00;
const SDK1_HANDSHAKE: u8 = 0x01;
const SDK1_HEARTBEAT: u8 = 0x03;
const SDK1_SAMPLE: u8 = 0x04;
const SDK1_COORDINATES: u8 = 0x05;

const START: u8 = 0xAA;
const COMMAND: u8 = 0;
const ACKNOWLEDGEMENT: u8 = 1;
const BROADCAST: u8 = 2;

/// Which protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SdkVersion {
    /// The Avia's.
    First,
    /// The Mid-360's.
    Second,
}

/// The addresses of sensor and host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Addresses {
    /// The sensor, if the configuration names it.
    pub sensor: Option<Ipv4Addr>,
    /// Its control port; zero: the usual one.
    pub control_port: u16,
    /// Port of this computer for points.
    pub point_port: u16,
    /// Port of this computer for answers to commands.
    pub command_port: u16,
}

/// A message to be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ControlMessage {
    bytes: [u8; MESSAGE_BYTES],
    length: usize,
    /// Its destination.
    pub to: SocketAddr,
}

impl ControlMessage {
    /// What is sent.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }
}

/// What the sensor has answered that is worth a line in the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ControlReply {
    /// A sensor was found at this address.
    Found(Ipv4Addr),
    /// It refuses a command with this code.
    Refused {
        /// Its return code.
        code: u8,
        /// The key that is wrong, in the second protocol; the command in the first.
        of: u16,
    },
    /// It has accepted the command.
    Accepted,
}

/// Commands of one set-up, in their order.
const STEPS: [&[u8]; 2] = [&[SDK1_HANDSHAKE, SDK1_COORDINATES, SDK1_SAMPLE], &[0]];

/// Sets one sensor up and keeps it sending.
#[derive(Clone, Copy, Debug)]
pub struct Control {
    version: SdkVersion,
    addresses: Addresses,
    /// Where its commands go.
    sensor: Option<SocketAddr>,
    /// The address of this computer on the way to it.
    host: Option<Ipv4Addr>,
    /// Command of the set-up that comes next.
    step: usize,
    due: Timestamp,
    sequence: u16,
}

impl Control {
    /// Nothing has been sent yet.
    pub fn new(version: SdkVersion, addresses: Addresses) -> Self {
        let usual = if version == SdkVersion::First {
            SDK1_CONTROL_PORT
        } else {
            SDK2_CONTROL_PORT
        };
        let port = if addresses.control_port == 0 {
            usual
        } else {
            addresses.control_port
        };
        Self {
            version,
            sensor: addresses
                .sensor
                .map(|sensor| SocketAddr::new(IpAddr::V4(sensor), port)),
            addresses,
            host: None,
            step: 0,
            due: Timestamp::NEVER,
            sequence: 0,
        }
    }

    /// Where commands go, once that is known.
    pub fn sensor(&self) -> Option<SocketAddr> {
        self.sensor
    }

    /// The address that the sensor shall send points to.
    pub fn set_host(&mut self, host: Ipv4Addr) {
        self.host = Some(host);
    }

    /// When there may be something to send.
    pub fn due(&self) -> Timestamp {
        self.due
    }

    /// The next message to send now; `None` when there are none left. `silent_s`: how long no points have come.
    pub fn next(&mut self, now: Timestamp, silent_s: f64) -> Option<ControlMessage> {
        if now < self.due {
            return None;
        }
        let Some((sensor, host)) = self.sensor.zip(self.host) else {
            self.due = now.plus_seconds(PERIOD_S);
            let broadcast = SocketAddr::new(IpAddr::V4(Ipv4Addr::BROADCAST), SDK2_SEARCH_PORT);
            let searches = self.version == SdkVersion::Second && self.sensor.is_none();
            return searches.then(|| self.second(SDK2_SEARCH, &[], broadcast));
        };
        if silent_s < SILENCE_S {
            self.step = 0;
            self.due = now.plus_seconds(PERIOD_S);
            return (self.version == SdkVersion::First).then(|| self.first(SDK1_HEARTBEAT, &[], sensor));
        }
        let steps = STEPS[usize::from(self.version == SdkVersion::Second)];
        let command = steps.get(self.step).copied();
        self.step = (self.step + 1) % (steps.len() + 1);
        // After the last command of the set-up the sensor needs time to begin.
        let Some(command) = command else {
            self.due = now.plus_seconds(PERIOD_S);
            return (self.version == SdkVersion::First).then(|| self.first(SDK1_HEARTBEAT, &[], sensor));
        };
        Some(match self.version {
            SdkVersion::Second => self.set_up(host, sensor),
            SdkVersion::First => self.first_command(command, host, sensor),
        })
    }

    /// Takes a datagram that came from `source` to the port for commands, or for broadcasts.
    pub fn received(&mut self, source: IpAddr, bytes: &[u8]) -> Option<ControlReply> {
        match self.version {
            SdkVersion::Second => self.second_received(bytes),
            SdkVersion::First => self.first_received(source, bytes),
        }
    }

    fn set_up(&mut self, host: Ipv4Addr, sensor: SocketAddr) -> ControlMessage {
        let mut data = [0; 27];
        let mut at = 4;
        data[0] = 3;
        let mut put = |bytes: &[u8]| {
            data[at..at + bytes.len()].copy_from_slice(bytes);
            at += bytes.len();
        };
        let key = |key: u16, length: u16| {
            let ([k0, k1], [l0, l1]) = (key.to_le_bytes(), length.to_le_bytes());
            [k0, k1, l0, l1]
        };
        put(&key(KEY_DATA_TYPE, 1));
        put(&[1]);
        put(&key(KEY_POINT_HOST, 8));
        put(&host.octets());
        put(&self.addresses.point_port.to_le_bytes());
        put(&SDK2_POINT_PORT.to_le_bytes());
        put(&key(KEY_WORK_MODE, 1));
        put(&[SAMPLING]);
        self.second(SDK2_SET, &data[..at], sensor)
    }

    fn first_command(&mut self, command: u8, host: Ipv4Addr, sensor: SocketAddr) -> ControlMessage {
        match command {
            SDK1_HANDSHAKE => {
                let mut data = [0; 10];
                data[..4].copy_from_slice(&host.octets());
                let ports = [
                    self.addresses.point_port,
                    self.addresses.command_port,
                    self.addresses.point_port,
                ];
                for (place, port) in data[4..].chunks_exact_mut(2).zip(ports) {
                    place.copy_from_slice(&port.to_le_bytes());
                }
                self.first(SDK1_HANDSHAKE, &data, sensor)
            }
            SDK1_COORDINATES => self.first(SDK1_COORDINATES, &[0], sensor),
            other => self.first(other, &[1], sensor),
        }
    }

    /// A command of the second protocol.
    fn second(&mut self, command: u16, data: &[u8], to: SocketAddr) -> ControlMessage {
        let mut bytes = [0; MESSAGE_BYTES];
        let length = SDK2_HEAD + data.len();
        bytes[0] = START;
        bytes[2..4].copy_from_slice(&(length as u16).to_le_bytes());
        bytes[4..8].copy_from_slice(&u32::from(self.numbered()).to_le_bytes());
        bytes[8..10].copy_from_slice(&command.to_le_bytes());
        bytes[10] = COMMAND;
        let crc = SDK2_CRC16.checksum(&bytes[..18]);
        bytes[18..20].copy_from_slice(&crc.to_le_bytes());
        let crc = if data.is_empty() {
            0
        } else {
            SDK2_CRC32.checksum(data)
        };
        bytes[20..24].copy_from_slice(&crc.to_le_bytes());
        bytes[SDK2_HEAD..length].copy_from_slice(data);
        ControlMessage { bytes, length, to }
    }

    fn second_received(&mut self, bytes: &[u8]) -> Option<ControlReply> {
        let length = usize::from(u16_at(bytes, 2));
        let sound = bytes.len() >= SDK2_HEAD
            && bytes[0] == START
            && length == bytes.len()
            && u16_at(bytes, 18) == SDK2_CRC16.checksum(&bytes[..18]);
        if !sound || bytes[10] != ACKNOWLEDGEMENT {
            return None;
        }
        let data = &bytes[SDK2_HEAD..];
        if !data.is_empty() && u32_at(bytes, 20) != SDK2_CRC32.checksum(data) {
            return None;
        }
        match u16_at(bytes, 8) {
            SDK2_SEARCH
                if data.len() >= 24
                    && data[0] == 0
                    && SDK2_TYPES.contains(&data[1])
                    && self.sensor.is_none() =>
            {
                let sensor = Ipv4Addr::from(bytes_at::<4>(data, 18));
                self.sensor = Some(SocketAddr::new(IpAddr::V4(sensor), u16_at(data, 22)));
                self.due = Timestamp::NEVER;
                Some(ControlReply::Found(sensor))
            }
            SDK2_SET if data.len() >= 3 => Some(answered(data[0], u16_at(data, 1))),
            _ => None,
        }
    }

    /// A command of the first protocol.
    fn first(&mut self, command: u8, data: &[u8], to: SocketAddr) -> ControlMessage {
        let mut bytes = [0; MESSAGE_BYTES];
        let length = SDK1_HEAD + data.len() + SDK1_FOOT;
        bytes[0] = START;
        bytes[1] = 1;
        bytes[2..4].copy_from_slice(&(length as u16).to_le_bytes());
        bytes[4] = COMMAND;
        bytes[5..7].copy_from_slice(&self.numbered().to_le_bytes());
        let crc = SDK1_CRC16.checksum(&bytes[..7]);
        bytes[7..9].copy_from_slice(&crc.to_le_bytes());
        bytes[10] = command;
        bytes[SDK1_HEAD..SDK1_HEAD + data.len()].copy_from_slice(data);
        let crc = SDK1_CRC32.checksum(&bytes[..length - SDK1_FOOT]);
        bytes[length - SDK1_FOOT..length].copy_from_slice(&crc.to_le_bytes());
        ControlMessage { bytes, length, to }
    }

    fn first_received(&mut self, source: IpAddr, bytes: &[u8]) -> Option<ControlReply> {
        let length = usize::from(u16_at(bytes, 2));
        let sound = bytes.len() >= SDK1_HEAD + SDK1_FOOT
            && bytes[0] == START
            && length == bytes.len()
            && u16_at(bytes, 7) == SDK1_CRC16.checksum(&bytes[..7])
            && u32_at(bytes, length - SDK1_FOOT) == SDK1_CRC32.checksum(&bytes[..length - SDK1_FOOT]);
        // Only the general set of commands is implemented.
        if !sound || bytes[9] != 0 {
            return None;
        }
        let code = bytes[SDK1_HEAD];
        match (bytes[4], bytes[10], source) {
            (BROADCAST, SDK1_BROADCAST, IpAddr::V4(sensor)) if self.sensor.is_none() => {
                self.sensor = Some(SocketAddr::new(source, SDK1_CONTROL_PORT));
                self.due = Timestamp::NEVER;
                Some(ControlReply::Found(sensor))
            }
            (ACKNOWLEDGEMENT, SDK1_HEARTBEAT, _) => None,
            (ACKNOWLEDGEMENT, command, _) if length > SDK1_HEAD + SDK1_FOOT => {
                Some(answered(code, command.into()))
            }
            _ => None,
        }
    }

    fn numbered(&mut self) -> u16 {
        self.sequence = self.sequence.wrapping_add(1);
        self.sequence
    }
}

fn answered(code: u8, of: u16) -> ControlReply {
    if code == 0 {
        ControlReply::Accepted
    } else {
        ControlReply::Refused { code, of }
    }
}
