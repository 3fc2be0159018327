//! A depth camera as a process: woken by its device, at the latest when the device is to be opened again.

use crate::camera::Camera;
use crate::cloud_view::CloudView;
use crate::config::{DepthCameraSpec, SensorTable};
use crate::driver::DepthCameraDriver;
use crate::v4l2::Wanted;
use jink_runtime::config::sensor_table::Told;
use jink_runtime::device::{DeviceChange, Driver, measured_at, needs};
use jink_runtime::service::WATCHED_FDS;
use jink_runtime::{Clock, Output, Ports, StartError};
use jink_shared_types::events::{DEPTH_CAMERA_BACK, DEPTH_CAMERA_LOST, Event};
use jink_shared_types::ranges::PointCloud;
use jink_shared_types::{SampleHeader, Timestamp, topics};
use std::os::fd::BorrowedFd;

/// The service: see [`crate`].
#[derive(Debug)]
pub struct DepthCameraService {
    driver: DepthCameraDriver,
    camera: Camera,
    clouds: Output<PointCloud>,
}

impl Driver for DepthCameraService {
    const PROGRAM: &'static str = "depth_driver";
    const EVENTS: [&'static Event; 2] = [&DEPTH_CAMERA_LOST, &DEPTH_CAMERA_BACK];

    fn check(tables: &[SensorTable], name: &str) -> Result<(), Told> {
        DepthCameraSpec::find(tables, name)
            .map(|_| ())
            .map_err(|mistake| mistake.told())
    }

    fn open(ports: &mut Ports, name: &str, tables: &[SensorTable]) -> Result<Self, StartError> {
        let spec =
            DepthCameraSpec::find(tables, name).map_err(|mistake| needs("the depth camera", &mistake))?;
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
            driver: DepthCameraDriver::new(spec),
        })
    }

    fn run(&mut self, clock: &Clock, now: Timestamp) -> Timestamp {
        let Self {
            driver,
            camera,
            clouds,
        } = self;
        if camera.open_if_due(now) {
            driver.connected();
        }
        let mut publish = |view: &CloudView<'_>| {
            clouds.write(measured_at(view.capture), |cloud| view.write(cloud));
        };
        camera.read(now, || clock.now(), |image| driver.image(image, &mut publish));
        camera.due()
    }

    fn close(&mut self) {
        self.camera.close();
    }

    fn standby_hz(&self) -> u32 {
        self.driver.spec().rate_hz as u32
    }

    fn run_as_standby(&mut self, now: Timestamp) {
        let view = CloudView {
            spec: self.driver.spec(),
            capture: now,
            depths: &[],
        };
        self.clouds
            .write(SampleHeader::at(now), |cloud| view.write(cloud));
    }

    fn take_change(&mut self, now: Timestamp) -> Option<DeviceChange> {
        self.driver.take_change(now)
    }

    fn report(&mut self, now: Timestamp) {
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

    fn watched(&self) -> [Option<BorrowedFd<'_>>; WATCHED_FDS] {
        let mut watched = [None; WATCHED_FDS];
        watched[0] = self.camera.watched();
        watched
    }
}
