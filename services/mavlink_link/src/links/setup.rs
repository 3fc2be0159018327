//! One link as the configuration describes it, checked.

use crate::link::{Endpoint, EndpointError, ReplyPolicy};
use crate::signing::{Key, KeyError};
use jink_runtime::config::{LinkRow, Purpose, Signing};
use std::fmt;
use std::net::{IpAddr, ToSocketAddrs};
use std::path::Path;

/// Bits that a serial port needs for a byte: eight, a start bit and a stop bit.
const BITS_PER_BYTE: f64 = 10.0;

/// What is needed to open a link and to judge what comes in.
#[derive(Clone, Debug)]
pub struct LinkSetup {
    /// Its name in logs, events and counters.
    pub name: String,
    /// Where it is.
    pub endpoint: Endpoint,
    /// Who is at its other end.
    pub purpose: Purpose,
    /// What is asked of signatures.
    pub signing: Signing,
    /// The key; there is one whenever signatures are asked for.
    pub key: Option<Key>,
    /// Its number in our signatures.
    pub link_id: u8,
    /// Addresses from which the link receives; empty = any.
    pub peers: Vec<IpAddr>,
    /// What it carries (bytes/s); `None` = as much as comes.
    pub rate_bps: Option<f64>,
}

/// What is wrong with a link's table.
#[derive(Debug)]
pub struct SetupError {
    /// The table and key that it concerns.
    pub key: String,
    /// Why.
    pub cause: SetupCause,
}

/// Why a link's table is refused.
#[derive(Debug)]
pub enum SetupCause {
    /// The address is none.
    Address(EndpointError),
    /// Signatures are asked for, and there is no key.
    NoKeyFile,
    /// The key cannot be had.
    Key(KeyError),
    /// Peers on a link that can have only one.
    NeedlessPeers,
}

impl fmt::Display for SetupCause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SetupCause::Address(source) => write!(f, "{source}"),
            SetupCause::NoKeyFile => f.write_str(
                "signatures are asked for, and no file holds the key; name one, or set signing = \"off\"",
            ),
            SetupCause::Key(source) => write!(f, "{source}"),
            SetupCause::NeedlessPeers => {
                f.write_str("only udpin and tcpin hear more than one peer; leave it out")
            }
        }
    }
}

impl fmt::Display for SetupError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.key, self.cause)
    }
}

impl std::error::Error for SetupError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match &self.cause {
            SetupCause::Address(source) => Some(source),
            SetupCause::Key(source) => Some(source),
            SetupCause::NoKeyFile | SetupCause::NeedlessPeers => None,
        }
    }
}

impl LinkSetup {
    /// Checks what stands in the configuration, and reads the key.
    ///
    /// # Errors
    /// [`SetupError`].
    pub fn of(row: &LinkRow) -> Result<Self, SetupError> {
        let refuse = |key: &str, cause| SetupError {
            key: format!("{}.{key}", row.table),
            cause,
        };
        let endpoint: Endpoint = row.address.parse().map_err(|source| {
            let key = format!("address = {:?}", row.address);
            refuse(&key, SetupCause::Address(source))
        })?;
        let listens = matches!(endpoint, Endpoint::UdpIn { .. } | Endpoint::TcpIn { .. });
        if !listens && !row.peers.is_empty() {
            return Err(refuse("peers", SetupCause::NeedlessPeers));
        }
        let key = match (row.signing, row.key_file.as_str()) {
            (Signing::Off, _) => None,
            (_, "") => return Err(refuse("key_file", SetupCause::NoKeyFile)),
            (_, file) => {
                let key = Key::read(Path::new(file));
                Some(key.map_err(|source| refuse("key_file", SetupCause::Key(source)))?)
            }
        };
        let rate_bps = match (row.bytes_per_s, &endpoint) {
            (0, Endpoint::Serial { baud, .. }) => Some(f64::from(*baud) / BITS_PER_BYTE),
            (0, _) => None,
            (configured, _) => Some(f64::from(configured)),
        };
        Ok(Self {
            name: row.name.clone(),
            endpoint,
            purpose: row.purpose,
            signing: row.signing,
            key,
            link_id: row.link_id,
            peers: row.peers.iter().map(IpAddr::to_canonical).collect(),
            rate_bps,
        })
    }

    /// Whether any host on the network can send on it.
    pub fn is_exposed(&self) -> bool {
        let host = match &self.endpoint {
            Endpoint::UdpIn { host, .. } | Endpoint::TcpIn { host, .. } => host,
            Endpoint::UdpOut { .. }
            | Endpoint::TcpOut { .. }
            | Endpoint::Serial { .. }
            | Endpoint::Unix { .. } => return false,
        };
        let name = host.trim_start_matches('[').trim_end_matches(']');
        let stays_here =
            name == "localhost" || name.parse().is_ok_and(|address: IpAddr| address.is_loopback());
        !stays_here && self.peers.is_empty() && self.signing != Signing::Require
    }

    /// Where the link replies if it is a listening UDP link.
    pub fn reply_policy(&self) -> ReplyPolicy {
        match self.purpose {
            Purpose::Autopilot => ReplyPolicy::Autopilot,
            Purpose::GroundStation => ReplyPolicy::Anybody,
        }
    }

    /// The endpoint with a number for its host's name. A name is looked up once, at the start: to ask for it again
    /// whenever a link is lost would keep the autopilot waiting.
    pub(super) fn numeric_endpoint(&self) -> std::io::Result<Endpoint> {
        let mut endpoint = self.endpoint.clone();
        let (host, port) = match &mut endpoint {
            Endpoint::UdpIn { host, port }
            | Endpoint::UdpOut { host, port }
            | Endpoint::TcpIn { host, port }
            | Endpoint::TcpOut { host, port } => (host, *port),
            Endpoint::Serial { .. } | Endpoint::Unix { .. } => return Ok(endpoint),
        };
        let name = host.trim_start_matches('[').trim_end_matches(']');
        let found = (name, port).to_socket_addrs()?.next();
        let address = found.ok_or(std::io::ErrorKind::NotFound)?.ip();
        *host = match address {
            IpAddr::V4(address) => address.to_string(),
            IpAddr::V6(address) => format!("[{address}]"),
        };
        Ok(endpoint)
    }
}

#[cfg(test)]
mod tests {
    use super::LinkSetup;
    use jink_runtime::config::Config;
    use std::path::Path;

    /// The last link of a configuration.
    fn setup(text: &str) -> Result<LinkSetup, String> {
        let config = Config::parse(Path::new("jink.toml"), text).unwrap();
        let rows = config.link.rows();
        LinkSetup::of(rows.last().unwrap()).map_err(|error| error.to_string())
    }

    fn also(rest: &str) -> String {
        format!("[[link.also]]\nname = \"ground\"\n{rest}\n")
    }

    #[test]
    fn what_is_wrong_is_reported_with_its_key() {
        for (text, said) in [
            (
                "[link]\naddress = \"udp:1\"\n".to_owned(),
                "link.address = \"udp:1\": \"udp:1\" is no link",
            ),
            (
                also("address = \"udpin:1\"\nsigning = \"accept\""),
                "link.also \"ground\".key_file: signatures are asked for",
            ),
            (
                also("address = \"udpin:1\"\nsigning = \"require\"\nkey_file = \"/no/such/key\""),
                "link.also \"ground\".key_file: /no/such/key: cannot be read",
            ),
            (
                also("address = \"serial:/dev/ttyS1:57600\"\npeers = [\"10.0.0.1\"]"),
                "link.also \"ground\".peers: only udpin and tcpin",
            ),
        ] {
            let error = setup(&text).unwrap_err();
            assert!(error.starts_with(said), "{error}");
        }
    }

    #[test]
    fn a_serial_port_carries_a_tenth_of_its_bits_and_networks_are_not_limited() {
        for (rest, rate_bps) in [
            ("address = \"serial:/dev/ttyS1:57600\"", Some(5760.0)),
            (
                "address = \"serial:/dev/ttyS1:57600\"\nbytes_per_s = 1200",
                Some(1200.0),
            ),
            ("address = \"udpin:1\"", None),
            ("address = \"udpin:1\"\nbytes_per_s = 9000", Some(9000.0)),
        ] {
            assert_eq!(setup(&also(rest)).unwrap().rate_bps, rate_bps, "{rest}");
        }
    }

    #[test]
    fn a_link_that_anybody_can_reach_is_known_for_it() {
        for (rest, exposed) in [
            ("address = \"udpin:14550\"", false),
            ("address = \"tcpin:localhost:5760\"", false),
            ("address = \"udpin:[::1]:14550\"", false),
            ("address = \"udpout:10.0.0.1:14550\"", false),
            ("address = \"udpin:0.0.0.0:14550\"", true),
            ("address = \"tcpin:10.0.0.2:5760\"", true),
            ("address = \"udpin:0.0.0.0:14550\"\npeers = [\"10.0.0.1\"]", false),
        ] {
            assert_eq!(setup(&also(rest)).unwrap().is_exposed(), exposed, "{rest}");
        }
    }

    #[test]
    fn a_name_becomes_a_number_once() {
        let setup = setup(&also("address = \"tcpout:localhost:5760\"")).unwrap();
        let text = setup.numeric_endpoint().unwrap().to_string();
        assert!(
            ["tcpout:127.0.0.1:5760", "tcpout:[::1]:5760"].contains(&text.as_str()),
            "{text}"
        );
    }
}
