//! The range topics of all configured sensors, for the services that read them all.

use crate::config::SensorOutput;
use crate::input::Input;
use crate::open_error::OpenError;
use crate::ports::Ports;
use jink_shared_types::ranges::{PointCloud, RangeScan};
use jink_shared_types::{Stamped, topics};

/// One sensor's topic.
#[derive(Debug)]
enum Source {
    Cloud(Input<PointCloud>),
    Scan(Input<RangeScan>),
}

/// A sample of one sensor.
#[derive(Debug)]
pub enum RangeSample<'a> {
    /// From a 3-D lidar or a depth camera.
    Cloud(Stamped<'a, PointCloud>),
    /// From a 2-D lidar or a single beam.
    Scan(Stamped<'a, RangeScan>),
}

/// All sensors, in the order of the configuration.
#[derive(Debug)]
pub struct RangeInputs {
    sources: Vec<Source>,
}

impl RangeInputs {
    /// Opens every configured sensor as a trigger. A sensor that sees an area is needed; a single beam is not: without
    /// it less is seen, but what is seen is still enough to fly in.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn open(ports: &mut Ports) -> Result<Self, OpenError> {
        let mut sources = Vec::new();
        for sensor in ports.config().sensors.clone() {
            sources.push(match sensor.output {
                SensorOutput::Cloud => {
                    Source::Cloud(ports.trigger_of(topics::RANGE_CLOUD, &sensor.name)?.needed())
                }
                SensorOutput::Scan => Source::Scan(ports.trigger_of(topics::RANGE_SCAN, &sensor.name)?),
            });
        }
        Ok(Self { sources })
    }

    /// Number of sensors.
    pub fn len(&self) -> usize {
        self.sources.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.sources.is_empty()
    }

    /// Hands every unread sample to `visit` with the sensor's number, oldest first within a sensor.
    pub fn each(&mut self, mut visit: impl FnMut(usize, RangeSample<'_>)) {
        for (number, source) in self.sources.iter_mut().enumerate() {
            match source {
                Source::Cloud(input) => input.each(|cloud| visit(number, RangeSample::Cloud(cloud))),
                Source::Scan(input) => input.each(|scan| visit(number, RangeSample::Scan(scan))),
            }
        }
    }
}
