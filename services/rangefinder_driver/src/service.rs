//! A rangefinder as a process: woken by its serial port, at the latest when a scan or a request is due.

use crate::ScanView;
use crate::config::{RangefinderSpec, SensorTable};
use crate::driver::RangefinderDriver;
use jink_runtime::config::sensor_table::Told;
use jink_runtime::device::{DeviceChange, Driver, measured_at, needs, read_port};
use jink_runtime::serial::Port;
use jink_runtime::service::WATCHED_FDS;
use jink_runtime::{Clock, Output, Ports, StartError};
use jink_shared_types::events::{Event, RANGEFINDER_BACK, RANGEFINDER_LOST};
use jink_shared_types::ranges::RangeScan;
use jink_shared_types::{SampleHeader, Timestamp, topics};
use std::os::fd::BorrowedFd;

/// The standby of a scanning device's driver writes scans this often (Hz). The supervisor requires of a candidate that
/// it puts out half to twice as much as the owner, which publishes an eighth of a turn at a time.
const PARTS_HZ: f64 = 30.0;

/// The service: see [`crate`].
#[derive(Debug)]
pub struct RangefinderService {
    driver: RangefinderDriver,
    port: Port,
    scans: Output<RangeScan>,
}

impl Driver for RangefinderService {
    const PROGRAM: &'static str = "rangefinder_driver";
    const EVENTS: [&'static Event; 2] = [&RANGEFINDER_LOST, &RANGEFINDER_BACK];

    fn check(tables: &[SensorTable], name: &str) -> Result<(), Told> {
        RangefinderSpec::find(tables, name)
            .map(|_| ())
            .map_err(|mistake| mistake.told())
    }

    fn open(ports: &mut Ports, name: &str, tables: &[SensorTable]) -> Result<Self, StartError> {
        let spec =
            RangefinderSpec::find(tables, name).map_err(|mistake| needs("the rangefinder", &mistake))?;
        Ok(Self {
            port: Port::new(&spec.device, spec.baud),
            scans: ports.range_output(topics::RANGE_SCAN, &spec.name, spec.rate_hz)?,
            driver: RangefinderDriver::new(spec),
        })
    }

    fn run(&mut self, clock: &Clock, now: Timestamp) -> Timestamp {
        let Self { driver, port, scans } = self;
        if port.open_if_due(now) {
            driver.connected(now);
        }
        let mut publish = |view: &ScanView<'_>| {
            scans.write(measured_at(view.capture), |scan| view.write(scan));
        };
        read_port(port, clock, now, |arrived, bytes| {
            driver.bytes(arrived, bytes, &mut publish);
        });
        driver.tick(now, &mut publish);
        while let Some(bytes) = driver.next_write(now).filter(|_| port.is_open()) {
            port.write(now, bytes);
        }
        port.due().min(driver.due(now))
    }

    fn close(&mut self) {
        self.port.close();
    }

    fn standby_hz(&self) -> u32 {
        let spec = self.driver.spec();
        let rate_hz = if spec.model.scans { PARTS_HZ } else { spec.rate_hz };
        rate_hz as u32
    }

    fn run_as_standby(&mut self, now: Timestamp) {
        let view = ScanView {
            spec: self.driver.spec(),
            first_beam: now,
            capture: now,
            angle_first_rad: 0.0,
            angle_step_rad: 0.0,
            range_m: &[f32::NAN],
        };
        self.scans.write(SampleHeader::at(now), |scan| view.write(scan));
    }

    fn take_change(&mut self, now: Timestamp) -> Option<DeviceChange> {
        self.driver.take_change(now)
    }

    fn report(&mut self, now: Timestamp) {
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

    fn watched(&self) -> [Option<BorrowedFd<'_>>; WATCHED_FDS] {
        let mut watched = [None; WATCHED_FDS];
        watched[0] = self.port.watched();
        watched
    }
}
