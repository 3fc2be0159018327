//! Ports of a simulated autopilot: those that its start-up scripts derive from its instance number, and free ones.

use super::build::Interface;
use std::fmt;
use std::net::{Ipv4Addr, SocketAddr, TcpListener, UdpSocket};

/// Highest instance number: from 10 on PX4's companions share one port.
pub const INSTANCE_MAX: u8 = 9;

/// The ports of one instance, all on loopback.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SitlPorts {
    /// Instance.
    pub instance: u8,
    /// Where this simulator waits for the autopilot's simulator interface (HIL: TCP; JSON, SIH: UDP).
    pub simulator: u16,
    /// Where the autopilot sends to its companion.
    pub companion: u16,
    /// Where the autopilot sends to the ground station of the demonstration.
    pub ground_station: u16,
    /// A free one for the autopilot's own use.
    pub own: u16,
}

/// A port that is needed and taken.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PortError {
    /// A given instance's port.
    Taken {
        /// Instance.
        instance: u8,
        /// UDP or TCP.
        protocol: &'static str,
        /// Port.
        port: u16,
        /// What for.
        what: &'static str,
    },
    /// No instance is free.
    NoneFree {
        /// What the last one lacked.
        last: Box<PortError>,
    },
    /// An instance number out of range.
    Instance {
        /// Number.
        asked: u8,
    },
    /// The system gave no port at all.
    Io {
        /// Why.
        cause: String,
    },
}

impl fmt::Display for PortError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Taken {
                instance,
                protocol,
                port,
                what,
            } => write!(
                f,
                "{protocol} port {port} ({what} of instance {instance}) is taken; is another simulation running?"
            ),
            Self::NoneFree { last } => {
                write!(
                    f,
                    "every instance from 0 to {INSTANCE_MAX} has a port that is taken; {last}"
                )
            }
            Self::Instance { asked } => write!(f, "instance {asked}: there are 0 to {INSTANCE_MAX}"),
            Self::Io { cause } => write!(f, "no free port: {cause}"),
        }
    }
}
impl std::error::Error for PortError {}

/// A fixed port of an autopilot: its number for instance 0, by how much it grows, what it is for.
struct Fixed {
    tcp: bool,
    base: u16,
    stride: u16,
    what: &'static str,
}

const fn udp(base: u16, stride: u16, what: &'static str) -> Fixed {
    Fixed {
        tcp: false,
        base,
        stride,
        what,
    }
}

const PX4_COMPANION: Fixed = udp(14540, 1, "PX4's companion link");
const PX4_HIL: Fixed = Fixed {
    tcp: true,
    base: 4560,
    stride: 1,
    what: "PX4's simulator link",
};
const PX4_TRUTH: Fixed = udp(19410, 1, "the truth of PX4's built-in vehicle");
const PX4_OWN: [Fixed; 4] = [
    udp(14580, 1, "PX4's companion link, its own end"),
    udp(18570, 1, "PX4's ground station link"),
    udp(14280, 1, "PX4's camera link"),
    udp(13030, 1, "PX4's gimbal link"),
];
const COPTER_OWN: [Fixed; 1] = [udp(5501, 10, "ArduPilot's radio control")];

impl Fixed {
    fn port(&self, instance: u8) -> u16 {
        self.base + self.stride * u16::from(instance)
    }

    /// The port, if nobody has it.
    fn free(&self, instance: u8) -> Result<u16, PortError> {
        let port = self.port(instance);
        let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
        let free = match self.tcp {
            true => TcpListener::bind(address).is_ok(),
            false => UdpSocket::bind(address).is_ok(),
        };
        if free {
            return Ok(port);
        }
        Err(PortError::Taken {
            instance,
            protocol: if self.tcp { "TCP" } else { "UDP" },
            port,
            what: self.what,
        })
    }
}

impl SitlPorts {
    /// Free ports for `interface`: those of `instance`, or of the first instance that has all of its own.
    ///
    /// # Errors
    /// The port that is taken.
    pub fn choose(interface: Interface, instance: Option<u8>) -> Result<Self, PortError> {
        if let Some(instance) = instance {
            return Self::of(interface, instance);
        }
        let mut last = PortError::Instance { asked: INSTANCE_MAX };
        for instance in 0..=INSTANCE_MAX {
            match Self::of(interface, instance) {
                Err(error @ PortError::Taken { .. }) => last = error,
                other => return other,
            }
        }
        Err(PortError::NoneFree { last: Box::new(last) })
    }

    fn of(interface: Interface, instance: u8) -> Result<Self, PortError> {
        if instance > INSTANCE_MAX {
            return Err(PortError::Instance { asked: instance });
        }
        let own = match interface {
            Interface::Px4Hil | Interface::Px4Sih => &PX4_OWN[..],
            Interface::ArduPilotJson => &COPTER_OWN[..],
        };
        for fixed in own {
            fixed.free(instance)?;
        }
        // All open at once, so that they differ.
        let any = [any_udp()?, any_udp()?, any_udp()?, any_udp()?];
        let port = |socket: &UdpSocket| Ok(socket.local_addr().map_err(io)?.port());
        let [first, second, third, fourth] = &any;
        Ok(Self {
            instance,
            simulator: match interface {
                Interface::Px4Hil => PX4_HIL.free(instance)?,
                Interface::Px4Sih => PX4_TRUTH.free(instance)?,
                Interface::ArduPilotJson => port(first)?,
            },
            companion: match interface {
                Interface::Px4Hil | Interface::Px4Sih => PX4_COMPANION.free(instance)?,
                Interface::ArduPilotJson => port(second)?,
            },
            ground_station: port(third)?,
            own: port(fourth)?,
        })
    }
}

/// A UDP port of loopback that nobody has.
pub(super) fn any_udp() -> Result<UdpSocket, PortError> {
    UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).map_err(io)
}

fn io(cause: std::io::Error) -> PortError {
    PortError::Io {
        cause: cause.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::{Interface, PortError, SitlPorts};
    use std::net::{Ipv4Addr, UdpSocket};

    #[test]
    fn a_taken_port_is_named_and_the_next_instance_is_chosen() {
        // Another simulation of this host may have any of them.
        let Ok(first) = SitlPorts::choose(Interface::Px4Sih, None) else {
            return;
        };
        let Ok(_taken) = UdpSocket::bind((Ipv4Addr::LOCALHOST, first.companion)) else {
            return;
        };
        let error = SitlPorts::choose(Interface::Px4Sih, Some(first.instance)).unwrap_err();
        assert!(
            error.to_string().contains(&first.companion.to_string()),
            "{error}"
        );
        if let Ok(second) = SitlPorts::choose(Interface::Px4Sih, None) {
            assert_ne!(second.instance, first.instance);
        }
        let error = SitlPorts::choose(Interface::Px4Hil, Some(10)).unwrap_err();
        assert_eq!(error, PortError::Instance { asked: 10 });
    }
}
