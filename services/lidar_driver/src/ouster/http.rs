//! The sensor's HTTP API: its metadata, and where it sends its packets (firmware user manual, "HTTP API Reference
//! Guide").
//!
//! | request | for |
//! |---|---|
//! | `GET /api/v1/sensor/metadata` | geometry, format, and the configuration in force |
//! | `POST /api/v1/sensor/config` | `udp_dest` and `udp_port_lidar`, where they differ; the sensor starts its laser anew then, some seconds |
//!
//! Everything here waits, with limits; the service calls it from a thread of its own.

use super::metadata::{Metadata, MetadataError};
use serde_json::{Value, json};
use std::fmt;
use std::io::{Read, Write};
use std::net::{IpAddr, SocketAddr, TcpStream};
use std::time::{Duration, Instant};

/// The sensor's web server answers within milliseconds, after its start within a second: so long one request may take, from the
/// connection to the last byte of the answer.
const PATIENCE: Duration = Duration::from_secs(3);
/// Longest answer that is read (bytes): metadata have some ten thousand.
const ANSWER_BYTES: usize = 1 << 20;

/// Why a request to the sensor failed.
#[derive(Debug)]
pub enum HttpError {
    /// It cannot be reached, or falls silent.
    Connection {
        /// Its address.
        sensor: SocketAddr,
        /// The system's error.
        source: std::io::Error,
    },
    /// What answers is no HTTP server.
    NotHttp {
        /// Its address.
        sensor: SocketAddr,
    },
    /// It refuses.
    Status {
        /// Its address.
        sensor: SocketAddr,
        /// The path requested.
        path: &'static str,
        /// The status line.
        status: String,
    },
    /// Its metadata are of no use.
    Metadata {
        /// Its address.
        sensor: SocketAddr,
        /// Why.
        source: MetadataError,
    },
}

impl fmt::Display for HttpError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Connection { sensor, source } => {
                write!(f, "the sensor at {sensor} does not answer: {source}")
            }
            Self::NotHttp { sensor } => write!(f, "{sensor} answers, and not as a web server"),
            Self::Status { sensor, path, status } => {
                write!(f, "the sensor at {sensor} refuses {path}: {status}")
            }
            Self::Metadata { sensor, source } => {
                write!(f, "the sensor at {sensor} has metadata of no use: {source}")
            }
        }
    }
}
impl std::error::Error for HttpError {}

const METADATA: &str = "/api/v1/sensor/metadata";
const CONFIG: &str = "/api/v1/sensor/config";

/// The metadata of the sensor at `sensor`, after it has been made to send its packets to `port` of this computer: to
/// `host`, or where that is not given, to the address that this computer reaches it from.
///
/// # Errors
/// [`HttpError`].
pub fn set_up(sensor: SocketAddr, host: Option<IpAddr>, port: u16) -> Result<Metadata, HttpError> {
    let (text, ours) = request(sensor, "GET", METADATA, "")?;
    let destination = host.unwrap_or(ours);
    if !sends_to(&text, destination, port) {
        let wanted = json!({"udp_dest": destination.to_string(), "udp_port_lidar": port});
        request(sensor, "POST", CONFIG, &wanted.to_string())?;
    }
    let (text, _) = request(sensor, "GET", METADATA, "")?;
    Metadata::parse(&text).map_err(|source| HttpError::Metadata { sensor, source })
}

/// Whether the configuration in force sends packets there already.
fn sends_to(metadata: &str, destination: IpAddr, port: u16) -> bool {
    let value: Value = serde_json::from_str(metadata).unwrap_or_default();
    let config = &value["config_params"];
    config["udp_dest"].as_str() == Some(destination.to_string().as_str())
        && config["udp_port_lidar"].as_u64() == Some(u64::from(port))
}

/// Body of the answer to one request, and the address that this computer has on the way to the sensor.
fn request(
    sensor: SocketAddr,
    method: &str,
    path: &'static str,
    body: &str,
) -> Result<(String, IpAddr), HttpError> {
    let broken = |source: std::io::Error| HttpError::Connection {
        sensor,
        // A socket calls it so that the time is over.
        source: match source.kind() {
            std::io::ErrorKind::WouldBlock => std::io::ErrorKind::TimedOut.into(),
            _ => source,
        },
    };
    let deadline = Instant::now() + PATIENCE;
    let mut stream = TcpStream::connect_timeout(&sensor, PATIENCE).map_err(broken)?;
    let left = || match deadline.saturating_duration_since(Instant::now()) {
        Duration::ZERO => Err(broken(std::io::ErrorKind::TimedOut.into())),
        left => Ok(Some(left)),
    };
    stream.set_write_timeout(left()?).map_err(broken)?;
    let ours = stream.local_addr().map_err(broken)?.ip();
    let head = format!(
        "{method} {path} HTTP/1.0\r\nHost: {}\r\nContent-Type: application/json\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
        sensor.ip(),
        body.len()
    );
    stream.write_all(head.as_bytes()).map_err(broken)?;
    stream.write_all(body.as_bytes()).map_err(broken)?;
    let mut answer = Vec::new();
    let mut part = [0; 4_096];
    while answer.len() < ANSWER_BYTES {
        stream.set_read_timeout(left()?).map_err(broken)?;
        match stream.read(&mut part).map_err(broken)? {
            0 => break,
            count => answer.extend_from_slice(part.get(..count).unwrap_or_default()),
        }
    }
    let text = String::from_utf8_lossy(&answer);
    let Some((head, body)) = text
        .split_once("\r\n\r\n")
        .filter(|_| text.starts_with("HTTP/1."))
    else {
        return Err(HttpError::NotHttp { sensor });
    };
    let status = head.lines().next().unwrap_or_default();
    if !status.split(' ').nth(1).is_some_and(|code| code.starts_with('2')) {
        let status = status.to_owned();
        return Err(HttpError::Status { sensor, path, status });
    }
    Ok((body.to_owned(), ours))
}
