//! The sessions of the two ends of a hop.

use jink_transport_chain::{Fault, StageArgs};
use std::net::TcpListener;
use std::path::Path;
use std::time::{Duration, Instant};
use zenoh::{Config, Session, Wait};

/// The other end has to be there within this.
const PATIENCE: Duration = Duration::from_secs(10);
/// A port that was free may be taken by somebody else before zenoh has it; it is tried so often.
const TRIES_OF_A_PORT: usize = 5;
/// The largest batch that zenoh sends (bytes).
const BATCH_BYTES: usize = 65535;
/// What zenoh puts around a message, and more.
const AROUND_BYTES: usize = 1024;
/// Most batches that zenoh lets a queue have.
const MOST_BATCHES: usize = 16;

/// What a message goes through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Stream sockets of the file system.
    Unix,
    /// TCP over the loopback interface.
    Tcp,
    /// Shared memory.
    Memory,
}

impl Kind {
    /// Names of the transports.
    pub const NAMES: [&str; 3] = ["zenoh-unix", "zenoh-tcp", "zenoh-shm"];

    /// The kind of the transport of this name.
    pub fn of(name: &str) -> Result<Kind, Fault> {
        match name {
            "zenoh-unix" => Ok(Kind::Unix),
            "zenoh-tcp" => Ok(Kind::Tcp),
            "zenoh-shm" => Ok(Kind::Memory),
            _ => Err(format!("no transport {name} here; there are {}", Kind::NAMES.join(", ")).into()),
        }
    }
}

/// The key of what passes hop `hop`.
pub fn key(hop: usize) -> String {
    format!("hop/{hop}")
}

/// The session of the end of hop `hop` that receives; it listens.
pub fn listen(args: &StageArgs, kind: Kind, hop: usize, bytes: usize) -> Result<Session, Fault> {
    if kind != Kind::Tcp {
        return open(kind, bytes, "listen", &socket(args, hop)?);
    }
    let mut outcome = Err("no port is free".into());
    for _ in 0..TRIES_OF_A_PORT {
        let port = TcpListener::bind(("127.0.0.1", 0))?.local_addr()?.port();
        outcome = open(kind, bytes, "listen", &format!("tcp/127.0.0.1:{port}"));
        if outcome.is_ok() {
            // Under its name there is never half a file.
            let half = args.hop_file(hop, "half");
            std::fs::write(&half, port.to_string())?;
            std::fs::rename(half, args.hop_file(hop, "port"))?;
            break;
        }
    }
    outcome
}

/// The session of the end of the hop after this process that sends; it connects.
pub fn connect(args: &StageArgs, kind: Kind, bytes: usize) -> Result<Session, Fault> {
    let endpoint = match kind {
        Kind::Tcp => {
            let port = wait_for(&args.hop_file(args.place, "port"))?;
            format!("tcp/127.0.0.1:{port}")
        }
        Kind::Unix | Kind::Memory => socket(args, args.place)?,
    };
    open(kind, bytes, "connect", &endpoint)
}

/// The endpoint of hop `hop` in the file system.
fn socket(args: &StageArgs, hop: usize) -> Result<String, Fault> {
    let path = std::path::absolute(args.hop_file(hop, "socket"))?;
    Ok(format!("unixsock-stream/{}", path.display()))
}

/// What is in a file, as soon as it is there.
fn wait_for(file: &Path) -> Result<String, Fault> {
    let until = Instant::now() + PATIENCE;
    loop {
        match std::fs::read_to_string(file) {
            Ok(text) => return Ok(text),
            Err(_) if Instant::now() < until => std::thread::sleep(Duration::from_millis(5)),
            Err(error) => return Err(format!("{}: {error}", file.display()).into()),
        }
    }
}

/// A session for messages of `bytes` bytes that has `endpoint` as its only one, to `listen` at or to `connect` to.
fn open(kind: Kind, bytes: usize, role: &str, endpoint: &str) -> Result<Session, Fault> {
    let mut config = Config::default();
    for (key, value) in settings(kind, bytes, role, endpoint) {
        config
            .insert_json5(key, &value)
            .map_err(|error| format!("zenoh: {key}: {error}"))?;
    }
    zenoh::open(config)
        .wait()
        .map_err(|error| format!("zenoh cannot {role}: {endpoint}: {error}").into())
}

fn settings(kind: Kind, bytes: usize, role: &str, endpoint: &str) -> Vec<(&'static str, String)> {
    let is_shared = kind == Kind::Memory;
    // What passes the socket if the message is in shared memory is no longer than what zenoh puts around it.
    let passing_bytes = if is_shared { 0 } else { bytes } + AROUND_BYTES;
    // The transport that the sender writes to in its own thread; it cannot cut messages into pieces.
    let is_direct = passing_bytes <= BATCH_BYTES;
    // As many as a message has pieces, and one: nobody waits for a batch to come free.
    let batches = (passing_bytes.div_ceil(BATCH_BYTES) + 1).clamp(2, MOST_BATCHES);
    let endpoints = |of: &str| {
        if of == role {
            format!("[{endpoint:?}]")
        } else {
            "[]".into()
        }
    };
    vec![
        ("mode", r#""peer""#.into()),
        ("listen/endpoints", endpoints("listen")),
        ("connect/endpoints", endpoints("connect")),
        ("connect/timeout_ms", PATIENCE.as_millis().to_string()),
        ("connect/exit_on_failure", "true".into()),
        (
            "connect/retry",
            "{ period_init_ms: 10, period_max_ms: 100, period_increase_factor: 2 }".into(),
        ),
        ("scouting/multicast/enabled", "false".into()),
        ("scouting/gossip/enabled", "false".into()),
        ("transport/unicast/qos/enabled", (!is_direct).to_string()),
        ("transport/unicast/lowlatency", is_direct.to_string()),
        ("transport/link/tx/queue/size/real_time", batches.to_string()),
        (
            "transport/link/rx/buffer_size",
            (2 * batches * BATCH_BYTES).to_string(),
        ),
        ("transport/shared_memory/enabled", is_shared.to_string()),
        // What it needs for that is there before the first message, or never.
        (
            "transport/shared_memory/mode",
            if is_shared { r#""init""# } else { r#""lazy""# }.into(),
        ),
        // Else zenoh would copy what is not in shared memory into it.
        (
            "transport/shared_memory/transport_optimization/enabled",
            "false".into(),
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::{Config, Kind, settings};

    #[test]
    fn zenoh_knows_all_settings() {
        for name in Kind::NAMES {
            for bytes in [8, 60_000, 400_000, 4_000_000] {
                let mut config = Config::default();
                for (key, value) in settings(Kind::of(name).unwrap(), bytes, "listen", "tcp/127.0.0.1:7447") {
                    config.insert_json5(key, &value).unwrap();
                }
            }
        }
    }

    #[test]
    fn only_what_fits_a_batch_goes_directly() {
        let is_direct = |kind, bytes| {
            let settings = settings(kind, bytes, "connect", "unixsock-stream/socket");
            let is_set =
                |(key, value): &(&str, String)| *key == "transport/unicast/lowlatency" && value == "true";
            settings.iter().any(is_set)
        };
        assert!(is_direct(Kind::Unix, 7456));
        assert!(!is_direct(Kind::Tcp, 65536));
        assert!(is_direct(Kind::Memory, 65536));
    }
}
