//! A depth camera as a process: woken by its device, at the latest when the device is to be opened again.

use crate::camera::Camera;
use crate::cloud_view::CloudView;
use crate::config::{DepthCameraSpec, SensorTable};
use crate::driver::DepthCameraDriver;
use crate::v4l2::Wanted;
use jink_runtime::service::WATCHED_FDS;
use jink_runtime::{Clock, Cycle, DeviceOwnership, Output, Ports, Service, StartError, Wake};
use jink_shared_types::ranges::PointCloud;
use jink_shared_types::{SampleHeader, Stage, Timestamp, topics};
use std::fmt;
use std::os::fd::BorrowedFd;

/// The service: see [`crate`].
pub struct DepthCameraService {
    driver: DepthCameraDriver,
    clock: Clock,
    camera: Camera,
    clouds: Output<PointCloud>,
    ownership: DeviceOwnership,
}

impl fmt::Debug for DepthCameraService {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("DepthCameraService")
    }
}

impl Service for DepthCameraService {
    const PROGRAM: &'static str = "depth_driver";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        let name = ports.setup().sensor_name()?;
        let tables: Vec<SensorTable> = jink_runtime::config::sensors(&ports.setup().config)?;
        let spec = DepthCameraSpec::find(&tables, &name).map_err(|mistake| StartError::Needs {
            what: "the depth camera".to_owned(),
            cause: mistake.to_string(),
        })?;
        tracing::info!(
            "{name}: {} points an image, one for each {bin} x {bin} pixels",
            spec.points(),
            bin = spec.bin_px
        );
        let wanted = Wanted {
            size_px: spec.size_px,
            rate_hz: spec.rate_hz,
        };
        Ok(Self {
            camera: Camera::new(&spec.device, wanted),
            clouds: ports.range_output(topics::RANGE_CLOUD, &spec.name, spec.rate_hz)?,
            ownership: DeviceOwnership::new(ports),
            clock: ports.clock(),
            driver: DepthCameraDriver::new(spec),
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        let now = cycle.now;
        if !self.ownership.owns(now) {
            self.camera.close();
            self.run_as_standby(now);
            return self.ownership.standby_wake(now);
        }
        if self.camera.open_if_due(now) {
            self.driver.connected();
        }
        self.read(now);
        if let Some(change) = self.driver.take_change(now) {
            cycle.events.publish(now, &change.event(&self.driver.spec().name));
        }
        self.report(now);
        Wake::at(DeviceOwnership::owner_due(now).min(self.camera.due()))
    }

    fn watched(&self) -> [Option<BorrowedFd<'_>>; WATCHED_FDS] {
        let mut watched = [None; WATCHED_FDS];
        watched[0] = self.camera.watched();
        watched
    }
}

impl DepthCameraService {
    /// Reads what has arrived, and publishes what it completes.
    fn read(&mut self, now: Timestamp) {
        let Self {
            driver,
            clock,
            camera,
            clouds,
            ..
        } = self;
        let mut publish = |view: &CloudView<'_>| {
            let header = SampleHeader {
                capture: view.capture,
                ..SampleHeader::default()
            };
            clouds.write(header.derived(Stage::Sensor, view.capture), |cloud| {
                view.write(cloud);
            });
        };
        camera.read(now, || clock.now(), |image| driver.image(image, &mut publish));
    }

    /// What a second instance can show without the device: that it runs, and can write clouds. None of them is
    /// published.
    fn run_as_standby(&mut self, now: Timestamp) {
        let spec = self.driver.spec();
        if !self.ownership.is_standby_due(now, spec.rate_hz as u32) {
            return;
        }
        let view = CloudView {
            spec,
            capture: now,
            depths: &[],
        };
        self.clouds
            .write(SampleHeader::at(now), |cloud| view.write(cloud));
    }

    fn report(&mut self, now: Timestamp) {
        if !self.ownership.is_report_due(now) {
            return;
        }
        let counters = self.driver.counters(now);
        tracing::info!(
            good = counters.good,
            damaged = counters.damaged,
            short = counters.short,
            repeated = counters.repeated,
            missed = counters.missed,
            undated = counters.undated,
            flying_pixels = counters.flying_pixels,
            rate_hz = counters.rate_hz,
            "{}",
            self.driver.spec().name
        );
    }
}
