//! A network lidar as the service runs it: its source of datagrams, its control, its step.

use crate::cloud::CloudAssembler;
use crate::config::LidarSpec;
use crate::counters::LidarCounters;
use crate::datagrams::{self, Datagrams};
use crate::decoder::Decoder;
use crate::driver::NetworkLidarDriver;
use crate::dump;
use crate::livox::control::{Addresses, Control, ControlReply, SDK1_BROADCAST_PORT, SdkVersion};
use crate::models::NetworkProtocol;
use crate::ouster::request::MetadataRequest;
use jink_runtime::Clock;
use jink_runtime::device::DeviceChange;
use jink_shared_types::Timestamp;
use std::fmt;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use std::os::fd::{AsFd, BorrowedFd};

/// Datagrams per cycle at most: a source that never ends must not keep the heartbeat waiting. A hundredth of a second
/// of the fastest lidar is 26 of them.
const DATAGRAMS: usize = 128;
/// Silence (s) after which an Ouster is set up again: it may have been switched off, and sends elsewhere.
const ASK_AGAIN_S: f64 = 5.0;
/// Answers of a Livox are shorter.
const ANSWER_BYTES: usize = 1_500;

/// The control sockets of a Livox.
#[derive(Debug)]
struct Livox {
    control: Control,
    commands: UdpSocket,
    /// Where a sensor of the first protocol announces itself.
    broadcasts: Option<UdpSocket>,
    said: Option<ControlReply>,
}

/// One network lidar.
pub struct NetworkLidar {
    driver: NetworkLidarDriver,
    datagrams: Datagrams,
    protocol: NetworkProtocol,
    request: Option<MetadataRequest>,
    asked: Timestamp,
    livox: Option<Livox>,
    livox_due: Timestamp,
}

impl fmt::Debug for NetworkLidar {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "NetworkLidar({})", self.driver.spec().name)
    }
}

impl NetworkLidar {
    /// Reads metadata, if the table names a file; opens nothing else yet.
    ///
    /// # Errors
    /// What is wrong with the metadata, in one sentence.
    pub fn new(spec: LidarSpec, protocol: NetworkProtocol) -> Result<Self, String> {
        let decoder = match &spec.metadata {
            Some(path) => Some(Decoder::ouster(
                dump::metadata(path).map_err(|error| error.to_string())?,
            )),
            None => Decoder::of(protocol, spec.rate_hz),
        };
        let datagrams = Datagrams::new(&spec.device);
        let lidar = Self {
            driver: NetworkLidarDriver::new(spec, decoder),
            datagrams,
            protocol,
            request: None,
            asked: Timestamp::NEVER,
            livox: None,
            livox_due: Timestamp::NEVER,
        };
        lidar.report_merging();
        Ok(lidar)
    }

    /// What it is.
    pub fn spec(&self) -> &LidarSpec {
        self.driver.spec()
    }

    /// Reads what has arrived, publishes what it completes, and keeps the sensor sending. Returns when to run again.
    pub fn run(
        &mut self,
        clock: &Clock,
        now: Timestamp,
        publish: &mut dyn FnMut(&CloudAssembler),
    ) -> Timestamp {
        if self.datagrams.open_if_due(now) {
            self.driver.connected();
        }
        self.ask(now);
        self.control(now);
        for _ in 0..DATAGRAMS {
            let arrived = clock.now();
            let Some((source, bytes)) = self.datagrams.next(arrived) else {
                break;
            };
            self.driver.datagram(arrived, source, bytes, publish);
        }
        self.driver.tick(clock.now(), publish);
        let control = if self.livox.is_some() {
            self.livox_due
        } else {
            Timestamp::from_ns(u64::MAX)
        };
        self.datagrams.due().min(self.driver.due()).min(control)
    }

    /// Closes everything: another instance has it now.
    pub fn close(&mut self) {
        self.datagrams.close();
        self.livox = None;
        self.livox_due = Timestamp::NEVER;
    }

    /// Whether the sensor has fallen silent, or measures again; once per change.
    pub fn take_change(&mut self, now: Timestamp) -> Option<DeviceChange> {
        self.driver.take_change(now)
    }

    /// By how much the sensor's clock was set ahead (s); once per step.
    pub fn take_clock_step(&mut self) -> Option<f64> {
        self.driver.take_clock_step()
    }

    /// What has become of its packets.
    pub fn counters(&mut self, now: Timestamp) -> LidarCounters {
        self.driver.counters(now)
    }

    /// What is to be watched for data.
    pub fn watched(&self) -> [Option<BorrowedFd<'_>>; 3] {
        let livox = self.livox.as_ref();
        [
            self.datagrams.watched(),
            livox.map(|livox| livox.commands.as_fd()),
            livox.and_then(|livox| livox.broadcasts.as_ref()).map(AsFd::as_fd),
        ]
    }

    /// Requests the metadata of an Ouster and has it send here, where the table has its address and no file.
    fn ask(&mut self, now: Timestamp) {
        let spec = self.driver.spec();
        let Some(sensor) = spec.sensor_address.filter(|_| spec.metadata.is_none()) else {
            return;
        };
        if self.protocol != NetworkProtocol::Ouster {
            return;
        }
        match self.request.as_ref().map(MetadataRequest::answer) {
            Some(Ok(None)) => {}
            Some(Ok(Some(metadata))) => {
                tracing::info!(
                    "{}: {} number {}, {} x {}, {}",
                    spec.name,
                    metadata.product,
                    metadata.serial,
                    metadata.columns,
                    metadata.rows,
                    metadata.profile.name
                );
                self.request = None;
                self.driver.known(Decoder::ouster(metadata));
                self.report_merging();
            }
            Some(Err(_)) => self.request = None,
            None => {
                let waits = self.asked.is_set() && now.seconds_since(self.asked) < ASK_AGAIN_S;
                let port = self.datagrams.port();
                if !waits && port != 0 && self.driver.is_silent(now, ASK_AGAIN_S) {
                    self.asked = now;
                    self.request = MetadataRequest::begin(sensor, spec.host_address, port, spec.control_port);
                }
            }
        }
    }

    /// Never silently.
    fn report_merging(&self) {
        if self.driver.merges() {
            tracing::warn!(
                "{}: a scan has more points than a cloud holds: of every two neighbouring columns the nearer answer of each row counts",
                self.driver.spec().name
            );
        }
    }

    /// Sets a Livox up and keeps it sending, where its point data come over the network.
    fn control(&mut self, now: Timestamp) {
        let version = match self.protocol {
            NetworkProtocol::Livox1 => SdkVersion::First,
            NetworkProtocol::Livox2 => SdkVersion::Second,
            NetworkProtocol::Ouster | NetworkProtocol::Velodyne(_) => return,
        };
        let point_port = self.datagrams.port();
        if point_port == 0 {
            return;
        }
        if self.livox.is_none() && now >= self.livox_due {
            self.livox = Livox::open(self.driver.spec(), version, point_port);
            self.livox_due = now.plus_seconds(1.0);
        }
        let Some(livox) = &mut self.livox else {
            return;
        };
        livox.receive(&self.driver.spec().name);
        if let Some(sensor) = livox.control.sensor() {
            let ours = match self.driver.spec().host_address {
                Some(IpAddr::V4(address)) => Some(address),
                _ => datagrams::address_towards(sensor.ip()),
            };
            if let Some(ours) = ours {
                livox.control.set_host(ours);
            }
        }
        let silent_s = if self.driver.is_silent(now, 1.0) { 1.0 } else { 0.0 };
        while let Some(message) = livox.control.next(now, silent_s) {
            // What is lost is repeated.
            let _ = livox.commands.send_to(message.bytes(), message.to);
        }
        self.livox_due = livox.control.due();
    }
}

impl Livox {
    fn open(spec: &LidarSpec, version: SdkVersion, point_port: u16) -> Option<Self> {
        let any = |port| SocketAddr::new(IpAddr::V4(Ipv4Addr::UNSPECIFIED), port);
        let commands = datagrams::bind(any(0)).and_then(|socket| {
            let address = socket
                .local_addr()
                .map_err(|source| datagrams::SourceError::Bind {
                    address: any(0),
                    source,
                })?;
            Ok((socket, address.port()))
        });
        let (commands, command_port) = match commands {
            Ok(opened) => opened,
            Err(error) => {
                tracing::warn!("{}: no socket for commands: {error}", spec.name);
                return None;
            }
        };
        let _ = commands.set_broadcast(true);
        let sensor = match spec.sensor_address {
            Some(IpAddr::V4(address)) => Some(address),
            _ => None,
        };
        let listens = version == SdkVersion::First && sensor.is_none();
        let broadcasts = listens.then(|| datagrams::bind(any(SDK1_BROADCAST_PORT)));
        let broadcasts = match broadcasts {
            Some(Err(error)) => {
                tracing::warn!("{}: {error}; give sensor_address instead", spec.name);
                None
            }
            other => other.and_then(Result::ok),
        };
        Some(Self {
            control: Control::new(
                version,
                Addresses {
                    sensor,
                    control_port: spec.control_port,
                    point_port,
                    command_port,
                },
            ),
            commands,
            broadcasts,
            said: None,
        })
    }

    /// Reads what has been answered; each kind of answer is worth one line.
    fn receive(&mut self, name: &str) {
        let mut bytes = [0; ANSWER_BYTES];
        for socket in [Some(&self.commands), self.broadcasts.as_ref()]
            .into_iter()
            .flatten()
        {
            for _ in 0..DATAGRAMS {
                let Ok((length, from)) = socket.recv_from(&mut bytes) else {
                    break;
                };
                let Some(answer) = self.control.received(from.ip(), &bytes[..length]) else {
                    continue;
                };
                if self.said != Some(answer) {
                    match answer {
                        ControlReply::Found(sensor) => tracing::info!("{name}: found at {sensor}"),
                        ControlReply::Refused { code, of } => {
                            tracing::warn!(
                                "{name}: the sensor refuses its set-up: code {code}, at {of:#06x}"
                            );
                        }
                        ControlReply::Accepted => tracing::info!("{name}: the sensor is set up"),
                    }
                    self.said = Some(answer);
                }
            }
        }
    }
}
