//! The two links of the simulated autopilot.
//!
//! | `link.address` | companion | ground station |
//! |---|---|---|
//! | `udpin:ADDRESS:PORT` | UDP, to that address | UDP, to `simulation.ground_station_port` |
//! | `unix:PATH` | binds PATH, talks to PATH`.jink` | binds PATH`.ground`, talks to PATH`.station` |

use super::local::{LocalSocket, MavLocal};
use super::settings;
use super::udp::{Arrival, MavUdp};
use jink_runtime::{Ports, StartError};
use mavlink::MavHeader;
use mavlink::dialect::MavMessage;
use std::net::{Ipv4Addr, SocketAddr};
use std::os::fd::BorrowedFd;
use std::path::Path;

/// Behind the path of a link: where the companion, the ground station, and the autopilot's side to that one are.
pub const UNIX_SUFFIXES: [&str; 3] = [".jink", ".station", ".ground"];

/// One link.
#[derive(Debug)]
pub enum Wire {
    /// Over UDP on loopback.
    Udp(MavUdp),
    /// Over datagram sockets of this machine.
    Local(MavLocal),
}

impl Wire {
    /// Readable when something has come.
    pub fn fd(&self) -> BorrowedFd<'_> {
        match self {
            Self::Udp(link) => link.fd(),
            Self::Local(link) => link.fd(),
        }
    }

    /// Appends every message that has come.
    pub fn receive(&mut self, arrivals: &mut Vec<Arrival>) {
        match self {
            Self::Udp(link) => link.receive(arrivals),
            Self::Local(link) => link.receive(arrivals),
        }
    }

    /// Sends one message.
    pub fn send(&mut self, header: &MavHeader, message: &MavMessage) {
        match self {
            Self::Udp(link) => link.send(header, message),
            Self::Local(link) => link.send(header, message),
        }
    }
}

/// Both links.
#[derive(Debug)]
pub struct Wires {
    /// To the companion.
    pub companion: Wire,
    /// To the ground station, if there is to be one.
    pub ground_station: Option<Wire>,
}

impl Wires {
    /// Opens them as the configuration says.
    ///
    /// # Errors
    /// The port or path is taken, or the link is of a kind that a simulated autopilot does not support.
    pub fn open(ports: &Ports) -> Result<Self, StartError> {
        let config = ports.config();
        if let Some(path) = config.link.address.strip_prefix("unix:") {
            let [companion, station, ground] = UNIX_SUFFIXES.map(|suffix| format!("{path}{suffix}"));
            return Ok(Self {
                companion: local(ports, path, &companion)?,
                ground_station: Some(local(ports, &ground, &station)?),
            });
        }
        let companion_at = settings::companion_address(&config.link.address)?;
        let ground_station = match config.simulation.ground_station_port {
            0 => None,
            port => Some(udp(0, SocketAddr::from((Ipv4Addr::LOCALHOST, port)))?),
        };
        Ok(Self {
            companion: udp(config.simulation.autopilot_port, companion_at)?,
            ground_station,
        })
    }
}

fn udp(port: u16, peer: SocketAddr) -> Result<Wire, StartError> {
    let local = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
    MavUdp::open(local, Some(peer))
        .map(Wire::Udp)
        .map_err(|error| StartError::Needs {
            what: format!("UDP port {port} for the simulated autopilot"),
            cause: format!("{error}; is another simulator running?"),
        })
}

fn local(ports: &Ports, own: &str, peer: &str) -> Result<Wire, StartError> {
    LocalSocket::bind(Path::new(own), Path::new(peer))
        .map(|socket| Wire::Local(MavLocal::new(socket, ports.clock())))
        .map_err(|error| StartError::Needs {
            what: format!("the socket {own} for the simulated autopilot"),
            cause: error.to_string(),
        })
}
