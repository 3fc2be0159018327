//! Where the autopilot is, as text: `udpin:127.0.0.1:14540`, `serial:/dev/ttyTHS1:921600`, and so on.

use std::fmt;
use std::str::FromStr;

/// What every error message about an address ends with.
pub const ACCEPTED_FORMS: &str = "udpin:[HOST:]PORT (listen), udpout:HOST:PORT (speak first), tcpin:[HOST:]PORT, \
     tcpout:HOST:PORT, serial:PATH:BAUD, unix:PATH (a datagram socket of this machine)";

/// Bytes of a path in `sockaddr_un` (unix(7)), without the zero at its end.
const UNIX_PATH_MAX: usize = 107;

/// Without a host a listening link receives from this machine only: a network must be asked for by name (0.0.0.0).
const LISTEN_HOST: &str = "127.0.0.1";

/// One end of a link.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Endpoint {
    /// Bind, and reply to the last sender that is an autopilot.
    UdpIn {
        /// Own address: name or number.
        host: String,
        /// Own port.
        port: u16,
    },
    /// Send to this address from a port of the system's choice.
    UdpOut {
        /// Peer: name or number.
        host: String,
        /// Peer's port.
        port: u16,
    },
    /// Listen, and serve one client at a time.
    TcpIn {
        /// Own address: name or number.
        host: String,
        /// Own port.
        port: u16,
    },
    /// Connect, again and again until it works.
    TcpOut {
        /// Peer: name or number.
        host: String,
        /// Peer's port.
        port: u16,
    },
    /// A serial port in raw mode, eight bits, no parity, one stop bit, no flow control.
    Serial {
        /// Device file.
        path: String,
        /// Speed (bit/s).
        baud: u32,
    },
    /// A datagram socket of this machine, bound by the other side; answered at the path with `.jink` behind it.
    Unix {
        /// The other side's path.
        path: String,
    },
}

/// What a [`Endpoint::Unix`] link's own socket is called: the other side's path and this.
pub const UNIX_ANSWER: &str = ".jink";

impl fmt::Display for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Endpoint::UdpIn { host, port } => write!(f, "udpin:{host}:{port}"),
            Endpoint::UdpOut { host, port } => write!(f, "udpout:{host}:{port}"),
            Endpoint::TcpIn { host, port } => write!(f, "tcpin:{host}:{port}"),
            Endpoint::TcpOut { host, port } => write!(f, "tcpout:{host}:{port}"),
            Endpoint::Serial { path, baud } => write!(f, "serial:{path}:{baud}"),
            Endpoint::Unix { path } => write!(f, "unix:{path}"),
        }
    }
}

/// Why a text is no [`Endpoint`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EndpointError {
    /// The text.
    pub text: String,
    /// What is wrong with it.
    pub reason: &'static str,
}

impl fmt::Display for EndpointError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "\"{}\" is no link: {}; accepted are {ACCEPTED_FORMS}",
            self.text, self.reason
        )
    }
}
impl std::error::Error for EndpointError {}

impl FromStr for Endpoint {
    type Err = EndpointError;

    fn from_str(text: &str) -> Result<Self, EndpointError> {
        let refuse = |reason| EndpointError {
            text: text.to_owned(),
            reason,
        };
        let (kind, rest) = text.split_once(':').ok_or(refuse("no kind before a colon"))?;
        let rest = match kind {
            "unix" => rest,
            _ => rest.strip_prefix("//").unwrap_or(rest),
        };
        match kind {
            "udpin" => own_address(rest).map(|(host, port)| Endpoint::UdpIn { host, port }),
            "tcpin" => own_address(rest).map(|(host, port)| Endpoint::TcpIn { host, port }),
            "udpout" => peer_address(rest).map(|(host, port)| Endpoint::UdpOut { host, port }),
            "tcpout" => peer_address(rest).map(|(host, port)| Endpoint::TcpOut { host, port }),
            "serial" => device(rest).map(|(path, baud)| Endpoint::Serial { path, baud }),
            "unix" => socket(rest).map(|path| Endpoint::Unix { path }),
            _ => Err("unknown kind"),
        }
        .map_err(refuse)
    }
}

fn port(text: &str) -> Result<u16, &'static str> {
    match text.parse() {
        Ok(0) | Err(_) => Err("the port is no number from 1 to 65535"),
        Ok(port) => Ok(port),
    }
}

fn own_address(text: &str) -> Result<(String, u16), &'static str> {
    let (host, number) = text.rsplit_once(':').unwrap_or(("", text));
    let host = if host.is_empty() { LISTEN_HOST } else { host };
    Ok((host.to_owned(), port(number)?))
}

fn peer_address(text: &str) -> Result<(String, u16), &'static str> {
    match text.rsplit_once(':') {
        Some((host, number)) if !host.is_empty() => Ok((host.to_owned(), port(number)?)),
        _ => Err("no host and port"),
    }
}

/// The speed stands behind the last colon: device names may hold colons themselves.
fn device(text: &str) -> Result<(String, u32), &'static str> {
    match text.rsplit_once(':') {
        Some((path, baud)) if path.starts_with('/') => match baud.parse() {
            Ok(0) | Err(_) => Err("the speed is no positive number"),
            Ok(baud) => Ok((path.to_owned(), baud)),
        },
        _ => Err("no device path and speed"),
    }
}

fn socket(text: &str) -> Result<String, &'static str> {
    match text.starts_with('/') && text.len() + UNIX_ANSWER.len() <= UNIX_PATH_MAX {
        true => Ok(text.to_owned()),
        false => Err("no absolute path of at most 102 bytes"),
    }
}

#[cfg(test)]
mod tests {
    use super::{ACCEPTED_FORMS, Endpoint};

    #[test]
    fn every_accepted_form_is_read_and_printed_back() {
        for text in [
            "unix:/run/autopilot.sock",
            "udpin:127.0.0.1:14540",
            "udpin:0.0.0.0:14540",
            "udpout:autopilot.local:14580",
            "udpout:[::1]:14580",
            "tcpin:127.0.0.1:5760",
            "tcpout:10.41.1.1:5760",
            "serial:/dev/serial/by-path/pci-0000:00:14.0-usb-0:3:1.0-port0:921600",
        ] {
            assert_eq!(text.parse::<Endpoint>().unwrap().to_string(), text);
        }
    }

    #[test]
    fn a_listener_without_a_host_accepts_this_machine_only() {
        for text in ["udpin:14540", "udpin::14540", "udpin://127.0.0.1:14540"] {
            assert_eq!(
                text.parse::<Endpoint>().unwrap().to_string(),
                "udpin:127.0.0.1:14540"
            );
        }
    }

    #[test]
    fn a_wrong_address_is_answered_with_what_is_accepted() {
        for text in [
            "",
            "udpin",
            "udp:1:2",
            "udpin:127.0.0.1:0",
            "udpin:127.0.0.1:99999",
            "udpout:14580",
            "tcpout::5760",
            "serial:/dev/ttyS0",
            "serial:/dev/ttyS0:fast",
            "serial:ttyS0:57600",
        ] {
            let message = text.parse::<Endpoint>().unwrap_err().to_string();
            assert!(
                message.contains(text) && message.contains(ACCEPTED_FORMS),
                "{message}"
            );
        }
    }
}
