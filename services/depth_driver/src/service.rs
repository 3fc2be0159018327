//! A depth camera as a process: woken by its device, at the latest when the device is to be opened again.

use crate::camera::Camera;
use crate::cloud_view::CloudView;
use crate::config::{DepthCameraSpec, SensorTable};
use crate::driver::DepthCameraDriver;
use crate::v4l2::Wanted;
use jink_runtime::service::WATCHED_FDS;
use jink_runtime::{Clock, Cycle, ExclusiveOwnership, Output, Ports, Service, StartError, Wake};
use jink_shared_types::ranges::PointCloud;
use jink_shared_types::{SampleHeader, Stage, Timestamp, topics};
use std::fmt;
use std::os::fd::BorrowedFd;

/// Changes are looked for at least this often.
const CHECK_HZ: u32 = 10;
/// The counters go to the log this often (s).
const REPORT_S: f64 = 60.0;

/// The service: see [`crate`].
pub struct DepthCameraService {
    driver: DepthCameraDriver,
    clock: Clock,
    camera: Camera,
    clouds: Output<PointCloud>,
    exclusive_ownership: ExclusiveOwnership,
    standby_due: Timestamp,
    report_due: Timestamp,
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
            exclusive_ownership: ports.exclusive_ownership(),
            clock: ports.clock(),
            driver: DepthCameraDriver::new(spec),
            standby_due: Timestamp::NEVER,
            report_due: Timestamp::NEVER,
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        let now = cycle.now;
        let look = now.next_beat(CHECK_HZ);
        // A stream has one reader: the next owner opens it when it owns the sensor.
        let is_ours = self.exclusive_ownership.is_due(now);
        self.exclusive_ownership.declare(is_ours);
        if !is_ours {
            self.camera.close();
            self.run_as_standby(now);
            let change = self
                .exclusive_ownership
                .changes_at()
                .filter(|change| *change > now);
            return Wake::at(change.map_or(self.standby_due, |change| change.min(self.standby_due)));
        }
        if self.camera.open_if_due(now) {
            self.driver.connected();
        }
        self.read(now);
        if let Some(change) = self.driver.take_change(now) {
            cycle.events.publish(now, &change.event(&self.driver.spec().name));
        }
        self.report(now);
        Wake::at(look.min(self.camera.due()))
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
        if now < self.standby_due {
            return;
        }
        let spec = self.driver.spec();
        self.standby_due = now.next_beat(spec.rate_hz as u32);
        let view = CloudView {
            spec,
            capture: now,
            depths: &[],
        };
        self.clouds
            .write(SampleHeader::at(now), |cloud| view.write(cloud));
    }

    fn report(&mut self, now: Timestamp) {
        if now < self.report_due {
            return;
        }
        let counters = self.driver.counters(now);
        if self.report_due.is_set() {
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
        self.report_due = now.plus_seconds(REPORT_S);
    }
}
