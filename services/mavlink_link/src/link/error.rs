//! What can go wrong with a link, with what the operator needs to put it right.

use super::endpoint::Endpoint;
use jink_runtime::serial::SerialError;
use std::fmt;
use std::io;
use std::path::PathBuf;

/// Why a link could not be opened, or was lost. A lost link is opened again by itself.
#[derive(Debug)]
pub enum LinkError {
    /// The host's name has no address.
    Resolve {
        /// The link.
        endpoint: Endpoint,
        /// The system's error.
        source: io::Error,
    },
    /// Another program holds the port.
    AddressInUse {
        /// The link.
        endpoint: Endpoint,
        /// The port.
        port: u16,
    },
    /// The serial port is not open.
    Serial(SerialError),
    /// Anything else while opening.
    Open {
        /// The link.
        endpoint: Endpoint,
        /// The system's error.
        source: io::Error,
    },
    /// The socket over which a link passes to another process could not be made, or nobody listens there.
    Handover {
        /// Its path.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The link was open and broke.
    Lost {
        /// The link.
        endpoint: Endpoint,
        /// The system's error.
        source: io::Error,
    },
}

impl LinkError {
    /// Whether something is missing that may come by itself: a device that is not plugged in, an interface without its address, a
    /// peer that is not switched on.
    pub fn is_absence(&self) -> bool {
        match self {
            Self::Serial(error) => matches!(error, SerialError::NoDevice { .. } | SerialError::Lost { .. }),
            Self::Open { source, .. } => matches!(
                source.kind(),
                io::ErrorKind::NotFound
                    | io::ErrorKind::AddrNotAvailable
                    | io::ErrorKind::ConnectionRefused
                    | io::ErrorKind::HostUnreachable
                    | io::ErrorKind::NetworkUnreachable
                    | io::ErrorKind::NetworkDown
                    | io::ErrorKind::TimedOut
            ),
            Self::Lost { .. } => true,
            Self::Resolve { .. } | Self::AddressInUse { .. } | Self::Handover { .. } => false,
        }
    }
}

impl fmt::Display for LinkError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            LinkError::Resolve { endpoint, source } => write!(f, "{endpoint}: no address: {source}"),
            LinkError::AddressInUse { endpoint, port } => write!(
                f,
                "{endpoint}: port {port} is taken by another program (a second jink, MAVROS, MAVSDK, a router?); \
                 `ss -lpn | grep :{port}` names it"
            ),
            LinkError::Serial(error) => write!(f, "{error}"),
            LinkError::Open { endpoint, source } => write!(f, "{endpoint}: cannot open: {source}"),
            LinkError::Handover { path, source } => {
                write!(f, "{}: no handover of the link: {source}", path.display())
            }
            LinkError::Lost { endpoint, source } => write!(f, "{endpoint}: lost, reopening: {source}"),
        }
    }
}

impl std::error::Error for LinkError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            LinkError::Resolve { source, .. }
            | LinkError::Open { source, .. }
            | LinkError::Handover { source, .. }
            | LinkError::Lost { source, .. } => Some(source),
            LinkError::Serial(SerialError::NotSerial { source, .. }) => Some(source),
            LinkError::AddressInUse { .. } | LinkError::Serial(_) => None,
        }
    }
}
