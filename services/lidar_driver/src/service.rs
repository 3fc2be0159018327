//! A lidar as a process: woken by its socket or serial port, at the latest when something is due.

use crate::cloud::CloudAssembler;
use crate::config::{Device, LidarSpec, Mistake, SensorTable};
use crate::counters::{LidarChange, LidarCounters};
use crate::models::{Connection, SerialProtocol};
use crate::network::NetworkLidar;
use crate::scanner::driver::ScannerDriver;
use crate::scanner::turn::Turn;
use jink_runtime::serial::{Port, Read};
use jink_runtime::service::WATCHED_FDS;
use jink_runtime::{Clock, Cycle, DeviceOwnership, Output, Ports, Service, StartError, Wake};
use jink_shared_types::ranges::{PointCloud, RangeScan};
use jink_shared_types::{SampleHeader, Stage, Timestamp, topics};
use std::fmt;
use std::os::fd::BorrowedFd;

/// Read at once: what the fastest scanner sends in a hundredth of a second.
const READ_BYTES: usize = 1024;
/// Reads per cycle at most: a port that never ends must not keep the heartbeat waiting.
const READS: usize = 16;

/// A network lidar or a scanner, with its topic.
#[allow(
    clippy::large_enum_variant,
    reason = "there is one in a process: a box would save nothing"
)]
enum LidarInterface {
    Network {
        lidar: NetworkLidar,
        clouds: Output<PointCloud>,
    },
    Serial {
        scanner: ScannerDriver,
        port: Port,
        /// The motor of the scanner turns while DTR is off.
        dtr_off: bool,
        scans: Output<RangeScan>,
    },
}

/// The service: see [`crate`].
pub struct LidarService {
    name: String,
    rate_hz: f64,
    interface: LidarInterface,
    clock: Clock,
    ownership: DeviceOwnership,
}

impl fmt::Debug for LidarService {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "LidarService({})", self.name)
    }
}

impl Service for LidarService {
    const PROGRAM: &'static str = "lidar_driver";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        let name = ports.setup().sensor_name()?;
        let folder = ports.setup().config.clone();
        let tables: Vec<SensorTable> = jink_runtime::config::sensors(&folder)?;
        let needs = |cause: String| StartError::Needs {
            what: "the lidar".to_owned(),
            cause,
        };
        let spec = LidarSpec::find(&tables, &name).map_err(|mistake| needs(located(&folder, &mistake)))?;
        let rate_hz = spec.rate_hz;
        let interface = match spec.model.connection {
            Connection::Network(protocol) => LidarInterface::Network {
                clouds: ports.range_output(topics::RANGE_CLOUD, &name, rate_hz)?,
                lidar: NetworkLidar::new(spec, protocol)
                    .map_err(|error| needs(format!("sensor {name:?}: metadata: {error}")))?,
            },
            Connection::Serial(protocol) => LidarInterface::Serial {
                scans: ports.range_output(topics::RANGE_SCAN, &name, rate_hz)?,
                port: port_of(&spec),
                dtr_off: matches!(
                    protocol,
                    SerialProtocol::Rplidar {
                        motor_by_dtr: true,
                        ..
                    }
                ),
                scanner: ScannerDriver::new(spec, protocol),
            },
        };
        Ok(Self {
            name,
            rate_hz,
            interface,
            ownership: DeviceOwnership::new(ports),
            clock: ports.clock(),
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        let now = cycle.now;
        if !self.ownership.owns(now) {
            self.interface.close();
            self.run_as_standby(now);
            return self.ownership.standby_wake(now);
        }
        let due = self.interface.run(&self.clock, now);
        if let Some(change) = self.interface.take_change(now) {
            cycle.events.publish(now, &change.event(&self.name));
        }
        self.report(now);
        Wake::at(DeviceOwnership::owner_due(now).min(due))
    }

    fn watched(&self) -> [Option<BorrowedFd<'_>>; WATCHED_FDS] {
        let mut watched = [None; WATCHED_FDS];
        match &self.interface {
            LidarInterface::Network { lidar, .. } => {
                for (place, fd) in watched.iter_mut().zip(lidar.watched()) {
                    *place = fd;
                }
            }
            LidarInterface::Serial { port, .. } => watched[0] = port.watched(),
        }
        watched
    }
}

impl LidarService {
    /// What a second instance can show without the sensor: that it runs, and can write its samples. None of them is
    /// published.
    fn run_as_standby(&mut self, now: Timestamp) {
        if self.ownership.is_standby_due(now, self.rate_hz.round() as u32) {
            self.interface.run_as_standby(now);
        }
    }

    fn report(&mut self, now: Timestamp) {
        if !self.ownership.is_report_due(now) {
            return;
        }
        let counters = self.interface.counters(now);
        tracing::info!(
            published = counters.published,
            good = counters.good,
            lost = counters.lost,
            foreign = counters.foreign,
            damaged = counters.damaged,
            doubled = counters.doubled,
            late = counters.late,
            other = counters.other,
            overflow = counters.overflow,
            rate_hz = counters.rate_hz,
            "{}",
            self.name
        );
    }
}

impl LidarInterface {
    /// Reads what has arrived, and publishes what it completes. Returns when to run again.
    fn run(&mut self, clock: &Clock, now: Timestamp) -> Timestamp {
        match self {
            Self::Network { lidar, clouds } => lidar.run(clock, now, &mut |cloud: &CloudAssembler| {
                let header = cloud.header();
                clouds.write(header.derived(Stage::Sensor, header.capture), |slot| {
                    cloud.write(slot);
                });
            }),
            Self::Serial {
                scanner,
                port,
                dtr_off,
                scans,
            } => {
                if port.open_if_due(now) {
                    if *dtr_off {
                        switch_dtr_off(port, &scanner.spec().name);
                    }
                    scanner.connected(now);
                }
                let mut publish = |turn: &Turn| {
                    let header = SampleHeader {
                        capture: turn.capture(),
                        ..SampleHeader::default()
                    };
                    scans.write(header.derived(Stage::Sensor, turn.capture()), |scan| {
                        turn.write(scan);
                    });
                };
                let mut bytes = [0; READ_BYTES];
                for _ in 0..READS {
                    let Read::Bytes(count) = port.read(now, &mut bytes) else {
                        break;
                    };
                    scanner.bytes(clock.now(), &bytes[..count], &mut publish);
                    if count < READ_BYTES {
                        break;
                    }
                }
                while let Some(bytes) = scanner.next_write(now).filter(|_| port.is_open()) {
                    port.write(now, bytes);
                }
                port.due().min(scanner.due())
            }
        }
    }

    fn close(&mut self) {
        match self {
            Self::Network { lidar, .. } => lidar.close(),
            Self::Serial { port, .. } => port.close(),
        }
    }

    fn take_change(&mut self, now: Timestamp) -> Option<LidarChange> {
        match self {
            Self::Network { lidar, .. } => lidar.take_change(now),
            Self::Serial { scanner, .. } => scanner.take_change(now),
        }
    }

    fn counters(&mut self, now: Timestamp) -> LidarCounters {
        match self {
            Self::Network { lidar, .. } => lidar.counters(now),
            Self::Serial { scanner, .. } => scanner.counters(now),
        }
    }

    fn run_as_standby(&mut self, now: Timestamp) {
        match self {
            Self::Network { lidar, clouds } => {
                let mut cloud = CloudAssembler::new(lidar.spec().cloud.clone(), None);
                cloud.packet(now, now);
                clouds.write(SampleHeader::at(now), |slot| cloud.write(slot));
            }
            Self::Serial { scanner, scans, .. } => {
                let spec = scanner.spec();
                let turn = Turn::new(&spec.cloud, spec.beams);
                scans.write(SampleHeader::at(now), |scan| {
                    turn.write(scan);
                    scan.first_beam = now;
                });
            }
        }
    }
}

fn port_of(spec: &LidarSpec) -> Port {
    match &spec.device {
        Device::Serial { path, baud } => Port::new(path, *baud),
        // The table of a scanner has no other device.
        Device::Udp(_) | Device::Pcap { .. } => Port::new("", spec.model.baud),
    }
}

fn switch_dtr_off(port: &Port, name: &str) {
    let Some(fd) = port.watched() else {
        return;
    };
    let switched = fd
        .try_clone_to_owned()
        .and_then(|fd| serial2::SerialPort::from(fd).set_dtr(false));
    if let Err(error) = switched {
        tracing::debug!("{name}: DTR cannot be set: {error}");
    }
}

/// An error with the file and the line where it is, as far as they can be found.
fn located(folder: &std::path::Path, mistake: &Mistake) -> String {
    let place = mistake.place();
    let place = place.and_then(|(sensor, key)| jink_runtime::config::sensor_place(folder, sensor, key));
    match place {
        Some((file, line)) => format!("{}:{line}: {mistake}", file.display()),
        None => mistake.to_string(),
    }
}
