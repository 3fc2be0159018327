//! A lidar as a process: woken by its socket or serial port, at the latest when something is due.

use crate::cloud::CloudAssembler;
use crate::config::{Device, LidarSpec, SensorTable};
use crate::dump;
use crate::models::{Connection, SerialProtocol};
use crate::network::NetworkLidar;
use crate::scanner::driver::ScannerDriver;
use crate::scanner::turn::Turn;
use jink_runtime::config::sensor_table::Told;
use jink_runtime::device::{DeviceChange, Driver, measured_at, needs, read_port};
use jink_runtime::serial::Port;
use jink_runtime::service::WATCHED_FDS;
use jink_runtime::{Clock, Output, Ports, StartError};
use jink_shared_types::events::{Event, LIDAR_BACK, LIDAR_LOST};
use jink_shared_types::ranges::{PointCloud, RangeScan};
use jink_shared_types::{SampleHeader, Stage, Timestamp, topics};
use std::os::fd::BorrowedFd;

/// The service: see [`crate`]. A network lidar or a scanner, with its topic.
#[derive(Debug)]
#[allow(
    clippy::large_enum_variant,
    reason = "there is one in a process: a box would save nothing"
)]
pub enum LidarService {
    /// On the network.
    Network {
        /// The lidar.
        lidar: NetworkLidar,
        /// Its topic.
        clouds: Output<PointCloud>,
    },
    /// On a serial port.
    Serial {
        /// The scanner.
        scanner: ScannerDriver,
        /// Its port.
        port: Port,
        /// The motor of the scanner turns while DTR is off.
        dtr_off: bool,
        /// Its topic.
        scans: Output<RangeScan>,
    },
}

impl Driver for LidarService {
    const PROGRAM: &'static str = "lidar_driver";
    const EVENTS: [&'static Event; 2] = [&LIDAR_LOST, &LIDAR_BACK];

    fn check(tables: &[SensorTable], name: &str) -> Result<(), Told> {
        let spec = LidarSpec::find(tables, name).map_err(|mistake| mistake.told())?;
        let metadata = spec
            .metadata
            .as_deref()
            .map_or(Ok(()), |file| dump::metadata(file).map(|_| ()));
        metadata.map_err(|error| (Some("metadata".to_owned()), format!("sensor {name:?}: {error}")))
    }

    fn open(ports: &mut Ports, name: &str, tables: &[SensorTable]) -> Result<Self, StartError> {
        const WHAT: &str = "the lidar";
        let spec = LidarSpec::find(tables, name).map_err(|mistake| needs(WHAT, &mistake))?;
        let rate_hz = spec.rate_hz;
        Ok(match spec.model.connection {
            Connection::Network(protocol) => Self::Network {
                clouds: ports.range_output(topics::RANGE_CLOUD, name, rate_hz)?,
                lidar: NetworkLidar::new(spec, protocol)
                    .map_err(|error| needs(WHAT, &format_args!("sensor {name:?}: metadata: {error}")))?,
            },
            Connection::Serial(protocol) => Self::Serial {
                scans: ports.range_output(topics::RANGE_SCAN, name, rate_hz)?,
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
        })
    }

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
                    scans.write(measured_at(turn.capture()), |scan| turn.write(scan));
                };
                read_port(port, clock, now, |arrived, bytes| {
                    scanner.bytes(arrived, bytes, &mut publish);
                });
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

    fn standby_hz(&self) -> u32 {
        self.spec().rate_hz.round() as u32
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

    fn take_change(&mut self, now: Timestamp) -> Option<DeviceChange> {
        match self {
            Self::Network { lidar, .. } => lidar.take_change(now),
            Self::Serial { scanner, .. } => scanner.take_change(now),
        }
    }

    fn take_clock_step(&mut self) -> Option<f64> {
        match self {
            Self::Network { lidar, .. } => lidar.take_clock_step(),
            Self::Serial { .. } => None,
        }
    }

    fn report(&mut self, now: Timestamp) {
        let counters = match self {
            Self::Network { lidar, .. } => lidar.counters(now),
            Self::Serial { scanner, .. } => scanner.counters(now),
        };
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
            self.spec().name
        );
    }

    fn watched(&self) -> [Option<BorrowedFd<'_>>; WATCHED_FDS] {
        let mut watched = [None; WATCHED_FDS];
        match self {
            Self::Network { lidar, .. } => {
                for (place, fd) in watched.iter_mut().zip(lidar.watched()) {
                    *place = fd;
                }
            }
            Self::Serial { port, .. } => watched[0] = port.watched(),
        }
        watched
    }
}

impl LidarService {
    fn spec(&self) -> &LidarSpec {
        match self {
            Self::Network { lidar, .. } => lidar.spec(),
            Self::Serial { scanner, .. } => scanner.spec(),
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
