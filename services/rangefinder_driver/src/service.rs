//! A rangefinder as a process: woken by its serial port, at the latest when a scan or a request is due.

use crate::ScanView;
use crate::config::{RangefinderSpec, SensorTable};
use crate::driver::RangefinderDriver;
use jink_runtime::serial::{Port, Read};
use jink_runtime::service::WATCHED_FDS;
use jink_runtime::{Clock, Cycle, DeviceOwnership, Output, Ports, Service, StartError, Wake};
use jink_shared_types::ranges::RangeScan;
use jink_shared_types::{SampleHeader, Stage, Timestamp, topics};
use std::fmt;
use std::os::fd::BorrowedFd;

/// Read at once: what an SF45/B sends in a tenth of a second at its usual rate.
const READ_BYTES: usize = 1024;
/// Reads per cycle at most: a port that never ends must not keep the heartbeat waiting.
const READS: usize = 16;
/// The standby of a scanning device's driver writes scans this often (Hz). The supervisor requires of a candidate that
/// it puts out half to twice as much as the owner, which publishes an eighth of a turn at a time.
const PARTS_HZ: f64 = 30.0;

/// The service: see [`crate`].
pub struct RangefinderService {
    driver: RangefinderDriver,
    clock: Clock,
    port: Port,
    scans: Output<RangeScan>,
    ownership: DeviceOwnership,
}

impl fmt::Debug for RangefinderService {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("RangefinderService")
    }
}

impl Service for RangefinderService {
    const PROGRAM: &'static str = "rangefinder_driver";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        let name = ports.setup().sensor_name()?;
        let tables: Vec<SensorTable> = jink_runtime::config::sensors(&ports.setup().config)?;
        let spec = RangefinderSpec::find(&tables, &name).map_err(|error| StartError::Needs {
            what: "the rangefinder".to_owned(),
            cause: error.to_string(),
        })?;
        Ok(Self {
            port: Port::new(&spec.device, spec.baud),
            scans: ports.range_output(topics::RANGE_SCAN, &spec.name, spec.rate_hz)?,
            ownership: DeviceOwnership::new(ports),
            clock: ports.clock(),
            driver: RangefinderDriver::new(spec),
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        let now = cycle.now;
        if !self.ownership.owns(now) {
            self.port.close();
            self.run_as_standby(now);
            return self.ownership.standby_wake(now);
        }
        if self.port.open_if_due(now) {
            self.driver.connected(now);
        }
        self.receive(now);
        while let Some(bytes) = self.driver.next_write(now).filter(|_| self.port.is_open()) {
            self.port.write(now, bytes);
        }
        if let Some(change) = self.driver.take_change(now) {
            cycle.events.publish(now, &change.event(&self.driver.spec().name));
        }
        self.report(now);
        Wake::at(
            DeviceOwnership::owner_due(now)
                .min(self.port.due())
                .min(self.driver.due(now)),
        )
    }

    fn watched(&self) -> [Option<BorrowedFd<'_>>; WATCHED_FDS] {
        let mut watched = [None; WATCHED_FDS];
        watched[0] = self.port.watched();
        watched
    }
}

impl RangefinderService {
    /// Reads what has arrived, and publishes what it completes.
    fn receive(&mut self, now: Timestamp) {
        let Self {
            driver,
            clock,
            port,
            scans,
            ..
        } = self;
        let mut publish = |view: &ScanView<'_>| {
            let header = SampleHeader {
                capture: view.capture,
                ..SampleHeader::default()
            };
            scans.write(header.derived(Stage::Sensor, view.capture), |scan| {
                view.write(scan);
            });
        };
        let mut bytes = [0; READ_BYTES];
        for _ in 0..READS {
            match port.read(now, &mut bytes) {
                Read::Bytes(count) => {
                    driver.bytes(clock.now(), &bytes[..count], &mut publish);
                    if count < READ_BYTES {
                        break;
                    }
                }
                Read::Nothing | Read::Lost => break,
            }
        }
        driver.tick(now, &mut publish);
    }

    /// Shows without the port that a standby runs and can write scans. None of them is published.
    fn run_as_standby(&mut self, now: Timestamp) {
        let spec = self.driver.spec();
        let rate_hz = if spec.model.scans { PARTS_HZ } else { spec.rate_hz };
        if !self.ownership.is_standby_due(now, rate_hz as u32) {
            return;
        }
        let view = ScanView {
            spec,
            first_beam: now,
            capture: now,
            angle_first_rad: 0.0,
            angle_step_rad: 0.0,
            range_m: &[f32::NAN],
        };
        self.scans.write(SampleHeader::at(now), |scan| view.write(scan));
    }

    fn report(&mut self, now: Timestamp) {
        if !self.ownership.is_report_due(now) {
            return;
        }
        let counters = self.driver.counters(now);
        tracing::info!(
            good = counters.good,
            damaged = counters.damaged,
            skipped_bytes = counters.skipped_bytes,
            rate_hz = counters.rate_hz,
            "{}",
            self.driver.spec().name
        );
    }
}
